#!/usr/bin/python3 -IS
"""systemctl and journalctl as far as `deploy` uses them, for a machine without systemd: starts what the units name.

A service of `Type=notify` is up once it reports so, any other after a moment; none is restarted.
"""

import os
import shlex
import signal
import socket
import subprocess
import sys
import time
from contextlib import suppress
from fnmatch import fnmatch
from pathlib import Path

UNITS, STATE = Path("/etc/systemd/system"), Path("/run/fake-systemd")
MOMENT_S, READY_S = 0.2, 60.0


def values(unit, key):
    lines = (UNITS / unit).read_text().splitlines() if (UNITS / unit).exists() else []
    return [line.partition("=")[2] for line in lines if line.startswith(f"{key}=")]


def state(unit):
    if unit.endswith(".target"):
        return "active" if (STATE / unit).exists() else "inactive"
    try:
        pid = int((STATE / unit).read_text())
        status = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except FileNotFoundError:
        return "failed" if (STATE / unit).exists() else "inactive"
    return "failed" if status == "Z" else "active"


def start(unit):
    if unit.endswith(".target"):
        (STATE / unit).write_text("")
        for wanted in values(unit, "Wants"):
            [start(name) for name in wanted.split()]
        return True
    if state(unit) == "active":
        return True
    command = values(unit, "ExecStart")
    if not command:
        return False
    environment = dict(os.environ, RUNTIME_DIRECTORY="/run/indoor-mapping")
    environment.update(shlex.split(line)[0].partition("=")[::2] for line in values(unit, "Environment"))
    Path("/run/indoor-mapping").mkdir(exist_ok=True)
    receiver = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    receiver.settimeout(0.05)
    if values(unit, "Type") == ["notify"]:
        address = STATE / f"{unit}.{time.monotonic_ns()}"
        receiver.bind(str(address))
        environment["NOTIFY_SOCKET"] = str(address)
    journal = (STATE / f"{unit}.journal").open("ab")
    stream = os.fstat(journal.fileno())
    environment["JOURNAL_STREAM"] = f"{stream.st_dev}:{stream.st_ino}"
    process = subprocess.Popen(
        shlex.split(command[-1]), env=environment, stdin=subprocess.DEVNULL, stdout=journal, stderr=journal, cwd="/",
        start_new_session=True,
    )  # fmt: skip
    (STATE / unit).write_text(str(process.pid))
    end_s = time.monotonic() + (READY_S if "NOTIFY_SOCKET" in environment else MOMENT_S)
    while time.monotonic() < end_s:
        if process.poll() is not None:
            sys.stderr.write(f"Job for {unit} failed.\n")
            return False
        with suppress(OSError):
            if b"READY=1" in receiver.recv(4096):
                return True
    return "NOTIFY_SOCKET" not in environment


def stop(unit):
    with suppress(FileNotFoundError, ProcessLookupError, ValueError):
        pid = int((STATE / unit).read_text())
        os.kill(pid, signal.SIGTERM)
        end_s = time.monotonic() + 5.0
        while state(unit) == "active" and time.monotonic() < end_s:
            time.sleep(0.02)
        os.killpg(pid, signal.SIGKILL)
    (STATE / unit).unlink(missing_ok=True)


def matching(patterns):
    names = {path.name for path in UNITS.glob("indoor-mapping*")} | set(patterns)
    return [name for pattern in patterns for name in sorted(names) if fnmatch(name, pattern) and "*" not in name]


def main(words):
    STATE.mkdir(exist_ok=True)
    if Path(sys.argv[0]).name == "journalctl":
        for journal in sorted(STATE.glob("*.journal")):
            sys.stdout.write(journal.read_text())
        return 0
    names = [word for word in words if not word.startswith("-")]
    verb, units = names[0], matching([name for name in names[1:] if name.startswith("indoor-mapping")])
    if verb == "start":
        started = [start(unit) for unit in units]
        return 0 if all(started) else 1
    if verb == "stop":
        [stop(unit) for unit in units]
    if verb == "is-active":
        return 0 if state(units[0]) == "active" else 3
    if verb == "is-system-running":
        print("running")
    if verb == "show":
        shown = {"ActiveState": state(units[0]), "NRestarts": "0"}
        print("\n".join(value for key, value in shown.items() if key in words))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
