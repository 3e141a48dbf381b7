"""`pytest --requirements` prints which tests show which requirement, and runs none."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

import pytest
from hypothesis import settings

# A busy machine makes any single example slow; the tests' own time limit stays
settings.register_profile("project", deadline=None)
settings.load_profile("project")

# Every requirement of the specification's modules
REQUIREMENTS = tuple(
    f"{module}_{kind}_{number:02d}"
    for module, kind, numbers in (
        ("SIM", "MR", range(1, 6)),
        ("CAR", "MR", range(1, 7)),
        ("MMU", "MR", range(1, 4)),
        ("MMU", "SR", range(4, 6)),
        ("PLN", "MR", range(1, 6)),
        ("POI", "MR", range(1, 6)),
        ("CM", "MR", range(1, 3)),
        ("VSL", "MR", range(1, 6)),
        ("CC", "MR", range(1, 5)),
    )
    for number in numbers
)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--requirements", action="store_true", help="print requirement -> tests, run nothing")
    parser.addoption("--mission-minutes", type=float, default=60.0, help="length of the slow test of a whole hour (60)")


def shown_by(items: Iterable[pytest.Item]) -> dict[str, list[str]]:
    """Requirement id -> the tests that carry it; parameters of one test count once."""
    tests: dict[str, dict[str, None]] = defaultdict(dict)
    for item in items:
        for marker in item.iter_markers("requirement"):
            for requirement in marker.args:
                tests[requirement][item.nodeid.partition("[")[0]] = None
    return {requirement: list(names) for requirement, names in tests.items()}


def pytest_collection_finish(session: pytest.Session) -> None:
    unknown = sorted(set(shown_by(session.items)) - set(REQUIREMENTS))
    if unknown:
        raise pytest.UsageError(f"no such requirement in the specification: {', '.join(unknown)}")


def pytest_runtestloop(session: pytest.Session) -> bool | None:
    return True if session.config.getoption("requirements") else None


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    if not config.getoption("requirements"):
        return
    session = terminalreporter._session
    tests = shown_by(session.items if session else ())
    terminalreporter.section("requirements")
    for requirement in REQUIREMENTS:
        first, *others = tests.get(requirement, ["(no test)"])
        terminalreporter.write_line(f"{requirement:<10} {first}")
        for name in others:
            terminalreporter.write_line(f"{'':<10} {name}")
