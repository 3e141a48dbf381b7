#!/usr/bin/env bash
# textual 8.2.8 (PyPI, the newest): of keys that are typed faster than they are handled, later ones overtake earlier ones.
#
# Expected: "ab", backspace, "c" leaves "ac" in an Input, however busy the program is. "g" opens a dialog with an Input
# that has the focus; "106" typed after it stands there.
# Seen: "ab", backspace, "c" in one write to the terminal leaves "ab": a character is inserted where the key arrives, but
# backspace, enter and arrows are bindings, which are looked for only when the key has risen through the queues of all
# parents; "c" is there before. "g106" leaves the dialog empty: the digits were sent to the widget that had the focus
# before, and nothing reports them as lost.
# Means: a word that confirms something is another one than was typed, or enter takes it before its last letters, whenever
# the event loop is busy for the time between two keys (a remote shell that sends them in one packet is enough).
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir/venv"
"$dir/venv/bin/pip" install -q 'textual==8.2.8'
cat > "$dir/typed.py" <<'EOF'
import sys

from textual.app import App
from textual.screen import ModalScreen
from textual.widgets import Input


class Dialog(ModalScreen):
    def compose(self):
        yield Input(id="field")


class Typed(App):
    BINDINGS = [("g", "dialog", "")]

    def compose(self):
        if sys.argv[1] == "field":
            yield Input(id="field")

    def action_dialog(self):
        self.push_screen(Dialog())

    def on_mount(self):
        self.set_timer(4.0, self.end)

    def end(self):
        fields = self.screen.query("#field")
        self.exit(return_code=0)
        open(sys.argv[2], "w").write(fields.first().value if fields else "no dialog")


Typed().run()
EOF
cat > "$dir/type.py" <<'EOF'
import os
import pty
import select
import sys
import time

folder = os.path.dirname(sys.argv[0])


def left_by(case, keys):
    """What stands in the field after these bytes were typed at once."""
    file = f"{folder}/{case}"
    child, terminal = pty.fork()
    if child == 0:
        os.environ["TERM"] = "xterm-256color"
        os.execv(sys.executable, [sys.executable, f"{folder}/typed.py", case, file])
    began, typed = time.monotonic(), False
    while not os.waitpid(child, os.WNOHANG)[0]:
        if select.select([terminal], [], [], 0.05)[0]:
            try:
                os.read(terminal, 65536)
            except OSError:
                pass
        if not typed and time.monotonic() - began > 2.5:
            typed = True
            os.write(terminal, keys)
    return open(file).read()


field, dialog = left_by("field", b"ab\x7fc"), left_by("dialog", b"g106")
print(f"ab, backspace, c leaves {field!r}; g106 leaves {dialog!r} in the dialog")
assert field == "ab" and dialog == "", "changed"
EOF
"$dir/venv/bin/python" "$dir/type.py"
