"""The pages tell the truth: generated parts are fresh, links lead somewhere, and what is named in code exists."""

from __future__ import annotations

import re
from fnmatch import fnmatch
from functools import cache
from pathlib import Path

import pytest

from common.config import Config
from common.config_file import parse_config
from common.messages.topics import TOPICS
from docs.generate import PARTS, expected, sample
from tests.architecture.project import PACKAGES, ROOT, is_ours, text_files

PAGES = sorted(
    path
    for path in ROOT.rglob("*.md")
    if is_ours(path.relative_to(ROOT).parts)
    and not any(part != ".github" and part.startswith(".") for part in path.relative_to(ROOT).parts)
)
# Names of former times stand in the changelog, names of the outside in the findings
NAMED_PAGES = [page for page in PAGES if page.name != "CHANGELOG.md" and page.parent.name != "findings"]
SOURCE = re.compile(r".*\.(py|cpp|h|ino|sh|js|css|tcss|html|md|toml|csv|svg|png|json)")
NAME = re.compile(r"[A-Za-z_]\w*((\.|::)[A-Za-z_]\w*)*(\(\))?")
FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
SPAN = re.compile(r"`([^`\n]+)`")
LINK = re.compile(r"\[([^\]]*)\]\(([^)\s]+)\)")
# Written by the programs, named by the specification alone, or of other programs and their files
NOT_IN_THE_SOURCES = {"map.svg", "map.png", "map.yaml", "map_points.csv", "pois.json", "summary.json", "runs/"}
NOT_IN_THE_SOURCES |= {"k_project_budget", "k_MMU_budget"}
NOT_IN_THE_SOURCES |= {"photos/", "process/", "settings.json", "areas.csv", "doors.csv", "zones.json", "doors.json"}


def prose(page: Path) -> str:
    """A page without its blocks of code."""
    return FENCE.sub("", page.read_text(encoding="utf-8"))


def place(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


@cache
def sources() -> dict[str, str]:
    """Path -> text of everything that is not a page, but for this file."""
    return {path: text for path, text in text_files() if not path.endswith((".md", "/test_docs.py"))}


@cache
def words() -> tuple[frozenset[str], ...]:
    """The words of each source."""
    return tuple(frozenset(re.findall(r"\w+", text)) for text in sources().values())


@cache
def anchors(page: Path) -> frozenset[str]:
    """The anchors that a forge makes of a page's headings."""
    titles = re.findall(r"^#+ +(.+)$", prose(page), re.MULTILINE)
    return frozenset(re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles)


def dead_link(page: Path, target: str) -> bool:
    if target.startswith(("http://", "https://")):
        return False
    file, _, anchor = target.partition("#")
    path = (page.parent / file).resolve() if file else page
    return not path.exists() or (bool(anchor) and anchor not in anchors(path))


@cache
def files() -> frozenset[str]:
    """Every file and folder, and every end of its path: `docs/modules/poi.md`, `modules/poi.md`, `modules/`."""
    paths = [Path(path) for path in (*sources(), *map(place, PAGES))]
    places = [path.as_posix() for path in paths] + [
        f"{folder.as_posix()}/" for path in paths for folder in path.parents
    ]
    return frozenset("/".join(place.split("/")[start:]) for place in places for start in range(place.count("/") + 1))


def file_exists(page: Path, name: str) -> bool:
    return name in files() or any(any(base.glob(name)) for base in (ROOT, page.parent))


def is_known(page: Path, token: str) -> bool:
    """Does what a piece of a code span names exist? What is no name of ours is taken for known."""
    token = token.strip(",;:'\"").removeprefix("./")
    if re.fullmatch(r"(\*|\w+)/\w+", token) and token.split("/")[0] in {"*", *(topic.producer for topic in TOPICS)}:
        return any(fnmatch(topic.key, token) for topic in TOPICS)
    if token in files() or token in NOT_IN_THE_SOURCES:
        return True
    if re.fullmatch(r"[\w.*-]+(/[\w.*-]+)*/?", token) and (SOURCE.fullmatch(token) or token.endswith("/")):
        return file_exists(page, token)
    if token.startswith("--"):
        return any(f'"{token.partition("=")[0]}"' in text for text in sources().values()) or token == "--"
    if re.fullmatch(r"_\w+", token):
        return any(word.endswith(token) for held in words() for word in held)
    if token.split(".")[0] in PACKAGES and "." in token:
        return file_exists(page, token.replace(".", "/") + ".py") or file_exists(page, token.replace(".", "/") + "/")
    if NAME.fullmatch(token):
        return any(held.issuperset(re.findall(r"\w+", token)) for held in words())
    return True


def is_placeholder(token: str) -> bool:
    """DIR, for what a person types there."""
    return re.fullmatch(r"[A-Z_,]+", token) is not None


def unknown_names(page: Path) -> list[str]:
    spans = SPAN.findall(prose(page))
    return sorted(
        span
        for span in set(spans)
        if not all(is_known(page, token) or (" " in span and is_placeholder(token)) for token in span.split())
    )


def test_generated_parts_are_fresh() -> None:
    stale = [place(path) for path, text in expected().items() if path.read_text(encoding="utf-8") != text]
    assert stale == [], "run: .venv/bin/python docs/generate.py"


def test_every_generated_part_stands_on_a_page() -> None:
    text = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    assert [name for name in PARTS if f"<!-- generated: {name} -->" not in text] == []


def test_sample_configuration_is_read_as_all_defaults() -> None:
    assert parse_config(sample()) == Config()


@pytest.mark.parametrize("page", PAGES, ids=place)
def test_links_lead_somewhere(page: Path) -> None:
    assert [target for _, target in LINK.findall(prose(page)) if dead_link(page, target)] == []


@pytest.mark.parametrize("page", NAMED_PAGES, ids=place)
def test_names_in_code_exist(page: Path) -> None:
    assert unknown_names(page) == []


@pytest.mark.parametrize("page", NAMED_PAGES, ids=place)
def test_links_of_names_lead_to_files_that_hold_them(page: Path) -> None:
    """[`Thing.method`](path/of/file.py): the file has these words."""
    for title, target in LINK.findall(prose(page)):
        if title.startswith("`") and NAME.fullmatch(title.strip("`")) and (page.parent / target).is_file():
            held = set(re.findall(r"\w+", (page.parent / target).read_text(encoding="utf-8")))
            assert set(re.findall(r"\w+", title)) <= held, f"{title} is not in {target}"


@pytest.mark.parametrize(
    "token",
    [
        "onboard/mmu/gone.py",
        "onboard.mmu.gone",
        "gone.py",
        "modules/gone/",
        "mmu/gone",
        "mmu/pose",
        "GONE_M",
        "StopSender.wall_landmarks",
        "--gone",
    ],
)
def test_a_name_that_is_gone_is_found(token: str) -> None:
    assert is_known(ROOT / "README.md", token) == (token == "mmu/pose")


@pytest.mark.parametrize("target", ["docs/gone.md", "README.md#gone", "README.md#status"])
def test_a_link_to_what_is_gone_is_found(target: str) -> None:
    assert dead_link(ROOT / "README.md", target) == ("gone" in target)


def test_every_page_of_docs_is_reached_from_the_readme() -> None:
    reached: set[Path] = set()
    ahead = [ROOT / "README.md"]
    while ahead:
        page = ahead.pop()
        reached.add(page)
        targets = (page.parent / target.partition("#")[0] for _, target in LINK.findall(prose(page)))
        ahead += [path.resolve() for path in targets if path.suffix == ".md" and path.resolve() not in reached]
    assert [place(page) for page in PAGES if "docs" in page.parts[-3:-1] and page not in reached] == []


def test_pre_commit_runs_the_checks_of_the_test_command() -> None:
    hooks = re.findall(r"entry: \.venv/bin/python -m (.+)", (ROOT / ".pre-commit-config.yaml").read_text("utf-8"))
    command = (ROOT / "deploy" / "test.sh").read_text(encoding="utf-8")
    checks = re.findall(r'"\$PYTHON" -m (.+)$', command.partition('if [ "$#" -gt 0 ]')[0], re.MULTILINE)
    assert hooks[: len(checks)] == checks
