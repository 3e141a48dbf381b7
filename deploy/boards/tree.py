"""Assembles on the laptop what a board gets: `site`, its Python packages; `app`, this project; units and robot.toml.

`Config`, board -> `Tree`. pip takes wheels for the board's platform, in the versions of `constraints.txt`, once: a set
of packages stays in the cache, so that later pushes need no network. What has no wheel there, Debian has (`bootstrap`).
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import distributions
from pathlib import Path

from common.config import BoardSection, Config
from common.config_file import config_text
from common.errors import StartError
from common.release import RELEASE_FILE
from deploy.boards.layout import KEYS, boards_in_use, modules_on
from deploy.boards.platforms import python_of, wheel_platforms
from deploy.boards.ssh import Output, last_line
from deploy.boards.units import unit_texts

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("common", "onboard", "offboard", "deploy")
# Module -> the extra of pyproject.toml that it needs besides what all need
_EXTRAS = {"mmu": "mapping", "poi": "vision", "recorder": "laptop", "visualizer": "laptop", "command_center": "laptop"}
# There are no wheels of these for the BeagleBone: package -> Debian's
_FROM_DEBIAN = {"armv7l": {"numpy": "python3-numpy", "scipy": "python3-scipy", "msgpack": "python3-msgpack"}}
_ALONE = ("filterpy",)  # without what it requires: its plots, for which it requires matplotlib, are never drawn
_PIP_S = 1800.0
_NAME = re.compile(r"[A-Za-z0-9._-]+")


@dataclass(frozen=True, slots=True)
class Tree:
    """Of one board, on the laptop's disk."""

    release: str
    own: Path  # app, units, robot.toml
    site: Path

    def size_bytes(self) -> int:
        files = (file for folder in (self.own, self.site) for file in folder.rglob("*"))
        return sum(file.stat().st_size for file in files if file.is_file())


def assemble(config: Config, boards: Sequence[str], cache: Path, report: Output) -> dict[str, Tree]:
    """The trees of a release, by board; raises StartError.

    All boards of a robot have one release, also when only some of them get it now.
    """
    sites = {board: _site(config, board, cache, report) for board in boards}
    shared = _board_config(config)
    release = _release_name(shared, (_site_name(config, board) for board in boards_in_use(config)))
    return {board: _tree(shared, board, release, cache, site) for board, site in sites.items()}


def debian_packages(config: Config, board: str) -> list[str]:
    """What a board needs of Debian."""
    modules = modules_on(config, board)
    packages = ["python3", "rsync"]
    from_debian = _FROM_DEBIAN.get(config.boards[board].platform, {})
    packages += [from_debian[name] for name in _required(modules) if name in from_debian]
    if "bridge" in modules:
        packages.append("avrdude")
    if "poi" in modules and config.poi.source == "picamera":
        packages.append("python3-picamera2")
    return packages


def _required(modules: Iterable[str]) -> list[str]:
    """Names of the packages that pyproject.toml has for some modules."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = dict.fromkeys(_EXTRAS[module] for module in modules if module in _EXTRAS)
    lines = [*project["dependencies"], *(line for extra in extras for line in project["optional-dependencies"][extra])]
    return list(dict.fromkeys(found[0].lower() for line in lines if (found := _NAME.match(line))))


def _pins() -> dict[str, str]:
    """Package -> the version that constraints.txt has for it."""
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    return {_canonical(name): version for name, _, version in (line.partition("==") for line in lines) if version}


def _canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def _from_pip(config: Config, board: str) -> list[str]:
    """Names of the packages that a board does not get from Debian."""
    from_debian = _FROM_DEBIAN.get(config.boards[board].platform, {})
    return [name for name in _required(modules_on(config, board)) if name not in from_debian]


def _site_name(config: Config, board: str) -> str:
    """Of the folder of a board's packages: follows from what is in it."""
    section = config.boards[board]
    constraints = (ROOT / "constraints.txt").read_bytes()
    names = _from_pip(config, board)
    what = "\n".join([python_of(section), *wheel_platforms(section), *names]).encode() + constraints
    return f"{section.platform}-{python_of(section)}-{hashlib.sha256(what).hexdigest()[:12]}"


def _site(config: Config, board: str, cache: Path, report: Output) -> Path:
    """The board's packages, from the cache where it has them."""
    section, names = config.boards[board], _from_pip(config, board)
    site = cache / "sites" / _site_name(config, board)
    if not site.exists():
        report(f"{board}: fetching {', '.join(names)} for {section.platform}, Python {python_of(section)} ...")
        site.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=site.parent) as folder:
            new = Path(folder) / "site"
            _install(section, [name for name in names if name not in _ALONE], new)
            _install(section, [name for name in names if name in _ALONE], new, "--no-deps")
            _verify(new, names, board)
            new.replace(site)
    return site


def _install(section: BoardSection, names: Sequence[str], target: Path, *options: str) -> None:
    if not names:
        return
    platforms = [word for tag in wheel_platforms(section) for word in ("--platform", tag)]
    command = [
        *(sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-input"),
        *("--target", str(target), "--only-binary=:all:", "--no-compile", "--implementation", "cp"),
        *("--python-version", python_of(section), *platforms, "-c", str(ROOT / "constraints.txt"), *options, *names),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=_PIP_S, check=False)
    if done.returncode != 0:
        lines = [line for line in done.stderr.splitlines() if line.startswith("ERROR: ")]
        why = last_line(lines[-1].removeprefix("ERROR: ") if lines else done.stderr)
        raise StartError(f"pip has no packages for {section.platform}, Python {python_of(section)}: {why}.")


def _verify(site: Path, names: Iterable[str], board: str) -> None:
    """Raises StartError for a package that is missing, or has not the version that was tested."""
    found = {_canonical(d.metadata["Name"]): d.version for d in distributions(path=[str(site)])}
    missing = [name for name in names if _canonical(name) not in found]
    pins = _pins()
    wrong = [f"{name} {version}" for name, version in found.items() if pins.get(name) != version]
    if missing or wrong:
        told = f"without {', '.join(missing)}" if missing else f"with {', '.join(wrong)}, unlike constraints.txt"
        raise StartError(f"pip has packed the packages of {board} {told}.")


def _board_config(config: Config) -> Config:
    """robot.toml as all boards get it: their keys are elsewhere."""
    keys = KEYS if config.mesh.keys else ""
    return replace(config, mesh=replace(config.mesh, keys=keys))


def _sources() -> Iterator[Path]:
    """The project's own files, from its root on."""
    for package in PACKAGES:
        for file in sorted((ROOT / package).rglob("*")):
            if file.is_file() and "__pycache__" not in file.parts:
                yield file.relative_to(ROOT)


def _release_name(config: Config, sites: Iterable[str]) -> str:
    """The commit, and a hash of everything that the boards get: the same content has the same name."""
    content = hashlib.sha256(config_text(config).encode())
    for site in sites:
        content.update(site.encode())
    for file in _sources():
        content.update(f"{file.as_posix()}\n".encode() + (ROOT / file).read_bytes())
    return f"{_commit()}-{content.hexdigest()[:8]}"


def _commit() -> str:
    command = ["git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"]
    try:
        shown = subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()
    except OSError:
        shown = ""
    return shown or "nocommit"


def _tree(config: Config, board: str, release: str, cache: Path, site: Path) -> Tree:
    """Everything but the site, made anew: files keep their times, by which rsync knows what has not changed."""
    own = cache / "trees" / board
    shutil.rmtree(own, ignore_errors=True)
    for file in _sources():
        target = own / "app" / file
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / file, target)
    texts = {f"units/{name}": text for name, text in unit_texts(config, board).items()}
    texts |= {"robot.toml": config_text(config), f"app/{RELEASE_FILE}": f"{release}\n"}
    for name, text in texts.items():
        (own / name).parent.mkdir(parents=True, exist_ok=True)
        (own / name).write_text(text, encoding="utf-8")
        os.utime(own / name, (0, 0))
    return Tree(release, own, site)
