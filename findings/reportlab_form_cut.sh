#!/usr/bin/env bash
# reportlab 5.1.0 (PyPI, the newest): what a form holds beyond the page's size is gone, also where it is drawn smaller.
#
# Expected: `beginForm` records a drawing, to be placed at any scale; one of 900 points at a scale of 0.25 is 225 points
# wide and fits a page of 300.
# Seen: it is 70 points wide: the form's box is the page's at the time when it is begun, from 0 to 300, and viewers cut
# the form there before they scale it. Nothing warns; the same lines drawn without a form are whole.
# Means: the overview of a plan that is larger than its paper shows the lower left corner only, and the sheets that are
# cut out of the same form have white parts. Give beginForm all four of its bounds (shown too).
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir/venv"
"$dir/venv/bin/pip" install -q 'reportlab==5.1.0' 'pymupdf==2.0'
cd "$dir"
venv/bin/python - <<'EOF'
import pymupdf
from reportlab.pdfgen.canvas import Canvas


def width_drawn(*bounds, form=True):
    canvas = Canvas("plan.pdf", pagesize=(300, 100))
    if form:
        canvas.beginForm("plan", *bounds)
        canvas.rect(20, 50, 900, 10, fill=1)
        canvas.endForm()
    canvas.scale(0.25, 0.25)
    canvas.doForm("plan") if form else canvas.rect(20, 50, 900, 10, fill=1)
    canvas.save()
    page = pymupdf.open("plan.pdf")[0].get_pixmap(colorspace=pymupdf.csGRAY)
    dark = [k % page.width for k, grey in enumerate(page.samples) if grey < 128]
    return max(dark) - min(dark) + 1


seen = width_drawn(), width_drawn(0, 0, 1000, 100), width_drawn(form=False)
print(f"drawn {seen[0]} points wide; with the form's bounds given {seen[1]}; without a form {seen[2]}")
assert seen[0] in (70, 71) and all(abs(width - 225) <= 1 for width in seen[1:]), "changed"
EOF
