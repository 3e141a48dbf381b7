"""Prepares a bare board with Debian: clock, packages, user, folders, its keys. What is there already stays as it is."""

from __future__ import annotations

import io
import shlex
import tarfile
import time
from collections.abc import Iterable
from pathlib import Path

from common.config import Config
from common.errors import StartError
from deploy.boards import layout
from deploy.boards.checks import CLOCK_OFF_S, roles_on
from deploy.boards.probe import Facts, clock_offset_s, probe
from deploy.boards.ssh import BoardError, Connection

_APT = "DEBIAN_FRONTEND=noninteractive apt-get"
_APT_S = 1800.0
_DEBS = "/var/cache/indoor-mapping-debs"
# The folder as a source of packages, of which apt takes what it needs: more may be there than this board lacks
_INSTALL_DEBS = f"""
set -e
trap 'rm -rf {_DEBS}' EXIT
mkdir -p {_DEBS}/lists/partial && cd {_DEBS} && tar x
for deb in *.deb; do
  dpkg-deb -f "$deb"
  echo "Filename: ./$deb"
  echo "Size: $(stat -c %s "$deb")"
  echo "SHA256: $(sha256sum "$deb" | cut -d ' ' -f 1)"
  echo
done > Packages
echo "deb [trusted=yes] file:{_DEBS} ./" > sources.list
apt() {{ {_APT} -qq -o Dir::Etc::sourcelist={_DEBS}/sources.list -o Dir::Etc::sourceparts=/dev/null \\
  -o Dir::State::lists={_DEBS}/lists "$@" >/dev/null; }}
apt update
apt install -y --no-install-recommends"""


def bootstrap(connection: Connection, config: Config, facts: Facts, debs: Path | None) -> None:
    """`debs`: a folder of Debian packages for a board without a network. Raises StartError."""
    board = connection.board
    if abs(facts.clock_offset_s) > CLOCK_OFF_S:
        set_clock(connection)
    if facts.missing_packages:
        _install_packages(connection, facts.missing_packages, debs)
        missing = () if connection.dry_run else probe(connection, config).missing_packages
        if missing:
            raise StartError(f"{board} still lacks {', '.join(missing)}{f', which {debs} has not' if debs else ''}.")
    if not facts.has_user:
        connection.change(
            f"useradd --system --user-group --home-dir {layout.STATE} --shell /usr/sbin/nologin {layout.USER}"
        )
    connection.change(
        f"install -d -m 755 {layout.HOME} {layout.RELEASES} && "
        f"install -d -m 750 -o {layout.USER} -g {layout.USER} {layout.STATE} && "
        f"install -d -m 711 $(dirname {layout.KEYS}) {layout.KEYS}"
    )
    for role in roles_on(config, board):
        _send_keys(connection, Path(config.mesh.keys).expanduser() / role)


def set_clock(connection: Connection) -> None:
    """To this machine's."""
    if connection.dry_run:
        connection.report("would set its clock")
        return
    connection.run(f"date -s @{time.time():.3f} >/dev/null")
    connection.report(f"its clock is set, {clock_offset_s(connection):+.2f} s off now")


def _install_packages(connection: Connection, packages: Iterable[str], debs: Path | None) -> None:
    connection.report(f"installing {', '.join(packages)} ...")
    if debs is None:
        words = f"{_APT} update -qq >/dev/null && {_APT} install -qq -y --no-install-recommends {' '.join(packages)}"
        try:
            connection.change(f"{words} >/dev/null", timeout_s=_APT_S)
        except BoardError as error:
            hint = "without a network there, give a folder of .deb files with --debs"
            raise StartError(f"{str(error).rstrip('.')}: {hint}.") from error
        return
    files = sorted(debs.glob("*.deb"))
    if not files:
        raise StartError(f"{debs} holds no .deb files.")
    data = b"" if connection.dry_run else _archive(files, numbered=True)
    words = f"{_INSTALL_DEBS} {' '.join(packages)}"
    connection.change(words, data, _APT_S, f"install {', '.join(packages)} from {debs}")


def _send_keys(connection: Connection, folder: Path) -> None:
    """The folder of one role, for nobody but the services."""
    target = shlex.quote(f"{layout.KEYS}/{folder.name}")
    connection.change(
        f"rm -rf {target} && install -d -m 700 {target} && tar x -C {target} && chmod 600 {target}/* && "
        f"chown -R {layout.USER}:{layout.USER} {target}",
        _archive(sorted(folder.iterdir())),
        what=f"copy the keys of {folder.name}",
    )


def _archive(files: Iterable[Path], *, numbered: bool = False) -> bytes:
    """A tar, for what a board takes before it has rsync; `numbered`: by plain names, without what a URI would quote."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as archive:
        for number, file in enumerate(files):
            archive.add(file.resolve(), arcname=f"{number}{file.suffix}" if numbered else file.name)
    return buffer.getvalue()
