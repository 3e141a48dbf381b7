"""The command line loads what its verb needs, and no more."""

from __future__ import annotations

import argparse
import importlib
import subprocess
import sys

import pytest

from deploy.cli import FAMILIES
from tests.architecture.project import ROOT

HEAVY = {"scipy", "cv2", "mujoco", "shapely", "textual", "filterpy", "onnxruntime", "starlette"}


@pytest.mark.parametrize("family", FAMILIES)
def test_a_family_adds_the_verbs_by_which_it_is_found(family: str) -> None:
    verbs = argparse.ArgumentParser().add_subparsers()
    importlib.import_module(f"deploy.verbs.{family}").add_verbs(verbs)
    assert tuple(verbs.choices) == FAMILIES[family]


@pytest.mark.parametrize("verb", ["estop", "release", "pause"])
def test_a_verb_that_stops_the_robot_loads_no_heavy_library(verb: str) -> None:
    program = (
        "import sys\n"
        "from deploy.cli import main\n"
        f"main([{verb!r}, '--config', '/nowhere/robot.toml'])\n"
        "print(*{name.partition('.')[0] for name in sys.modules})\n"
    )
    shown = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    loaded = set(shown.stdout.split())
    assert "zenoh" in loaded
    assert loaded & HEAVY == set()
