"""Who may import what."""

from __future__ import annotations

import graphlib
from collections.abc import Callable

import pytest

from tests.architecture.project import Module, modules

MODULES = modules()


def inside(*folders: str) -> Callable[[str], bool]:
    """Is a path inside one of these folders, or one of these files?"""
    return lambda path: any(path == folder or path.startswith(f"{folder}/") for folder in folders)


def imported(module: Module, *packages: str) -> list[str]:
    """Where a module imports one of the packages."""
    return [
        f"{module.path}:{line} imports {name}"
        for name, line in module.imports()
        if any(name == package or name.startswith(f"{package}.") for package in packages)
    ]


def offences(who: Callable[[str], bool], *packages: str) -> list[str]:
    return [offence for module in MODULES if who(module.path) for offence in imported(module, *packages)]


def not_in(*folders: str) -> Callable[[str], bool]:
    allowed = inside(*folders)
    return lambda path: not allowed(path)


def test_common_imports_neither_side() -> None:
    assert offences(inside("common"), "onboard", "offboard", "deploy", "tests") == []


def test_onboard_never_imports_offboard() -> None:
    assert offences(inside("onboard"), "offboard", "deploy", "tests") == []


def test_offboard_never_imports_deploy() -> None:
    assert offences(inside("offboard"), "deploy") == []


def test_no_production_module_imports_the_simulator() -> None:
    assert offences(not_in("offboard/simulator", "deploy"), "offboard.simulator") == []


def test_no_program_imports_tests() -> None:
    assert offences(lambda _: True, "tests") == []


@pytest.mark.parametrize(
    ("package", "homes"),
    [
        (
            "zenoh",
            (
                "common/zenoh_bus.py",
                "common/zenoh_channel.py",
                "common/zenoh_end.py",
                "common/zenoh_inbox.py",
                "common/zenoh_links.py",
                "common/zenoh_outbox.py",
                "common/zenoh_session.py",
                "common/process.py",
                "deploy/bench/bus_overhead.py",  # measures our bus against it
            ),
        ),
        ("cv2", ("offboard", "onboard/poi")),
        ("serial", ("onboard/bridge",)),
        ("cryptography", ("deploy",)),
        ("mujoco", ("offboard/simulator",)),
        ("filterpy", ("onboard/mmu",)),
        ("scipy", ("onboard/mmu", "offboard")),
        *((package, ("offboard/export",)) for package in ("ezdxf", "mcap", "reportlab", "rosbags")),
        ("rclpy", ("offboard/ros/graph.py",)),
        ("rosidl_generator_c", ("offboard/ros/tf_message.py",)),
    ],
)
def test_package_is_imported_at_its_home_only(package: str, homes: tuple[str, ...]) -> None:
    assert offences(not_in(*homes), package) == []


# Of each folder with rooms, from the top down: a room imports itself and what stands below it. "." is the folder itself
ROOMS = {
    "onboard/mmu": (".", "back_end", "front_end", "map", "on_demand"),
    "onboard/planner": (".", "mission", "driving", "exploration", "routing", "grid", "zones"),
    "deploy": (".", "verbs", "bench", "service", "boards", "local"),
    "onboard/poi": (".", "doors", "signs", "placement", "camera"),
    "offboard/simulator": (
        *(".", "run", "camera", "physics", "sensors", "native", "electronics", "building"),
        *("error_profiles", "stopwatch"),  # modules: every room draws its errors from it, and is on its accounts
    ),
    "offboard": (
        *(".", "simulator", "command_center", "visualizer", "recorder", "ros", "operate"),
        *("replay", "evaluate", "export", "runs"),
    ),
}


def room_of(path: str, folder: str) -> str:
    """In which room of the folder a file or folder lies."""
    rest = path.removeprefix(f"{folder}/").removesuffix(".py").split("/")
    return rest[0] if rest[0] in ROOMS[folder] else "."


@pytest.mark.parametrize("folder", ROOMS)
def test_rooms_import_one_way(folder: str) -> None:
    rooms, package = ROOMS[folder], folder.replace("/", ".")
    upward = [
        f"{module.path}:{line} imports {name}"
        for module in MODULES
        if inside(folder)(module.path)
        for name, line in module.imports()
        if name.startswith(f"{package}.")
        and rooms.index(room_of(name.replace(".", "/"), folder)) < rooms.index(room_of(module.path, folder))
    ]
    assert upward == []


@pytest.mark.parametrize("module", ["bridge", "comm", "mmu", "planner", "poi"])
def test_no_module_of_the_robot_reaches_into_another(module: str) -> None:
    others = {"bridge", "comm", "mmu", "planner", "poi"} - {module}
    assert offences(inside(f"onboard/{module}"), *(f"onboard.{other}" for other in others)) == []


@pytest.mark.parametrize("program", ["command_center", "visualizer", "recorder", "ros"])
def test_no_program_of_the_laptop_reaches_into_another(program: str) -> None:
    others = {"command_center", "visualizer", "recorder", "ros"} - {program}
    assert offences(inside(f"offboard/{program}"), *(f"offboard.{other}" for other in others)) == []


def test_no_module_imports_itself_in_a_circle() -> None:
    """At run time: imports inside functions count, those for the type checker alone do not."""
    files = {module.path.removesuffix(".py").replace("/", "."): module for module in MODULES}
    graph = {
        name: {home for imported in module.imports_at_run_time() for home in (imported, imported.rpartition(".")[0])}
        & set(files)
        for name, module in files.items()
    }
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        pytest.fail(f"a circle of imports: {' <- '.join(error.args[1])}")


def test_imports_are_absolute() -> None:
    assert [f"{module.path}:{line}" for module in MODULES for line in module.relative_imports()] == []
