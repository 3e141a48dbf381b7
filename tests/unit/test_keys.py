"""`deploy keys`, and what is said of files that cannot serve."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from common.access import ROLES
from common.errors import StartError
from common.keys import AUTHORITY, CERTIFICATE, COMMAND_KEY, PRIVATE_KEY, checked_folder, read_command_key
from deploy.verbs.keys import hosts_of

certificates = pytest.importorskip("deploy.boards.certificates", reason="pip install cryptography")
LATER = datetime.now(UTC) + timedelta(days=1)
HOSTS = {"robot": ["127.0.0.1", "robot.local"]}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("keys")
    certificates.make_keys(folder, HOSTS, replace=False, until=LATER)
    return folder


@pytest.fixture
def keys(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "keys"))


def test_every_role_gets_keys_that_serve_and_that_nobody_else_can_read(made: Path) -> None:
    for role in ROLES:
        folder = checked_folder(made, role)
        assert folder.stat().st_mode & 0o777 == 0o700
        assert all(file.stat().st_mode & 0o777 == 0o600 for file in folder.iterdir())


def test_only_robot_and_command_center_have_the_command_key(made: Path) -> None:
    assert {file.parent.name for file in made.glob(f"*/{COMMAND_KEY}")} == {"robot", "command_center"}
    assert read_command_key(made, "robot") == read_command_key(made, "command_center")


def test_keys_are_replaced_only_when_asked_to(keys: Path) -> None:
    before = (keys / "robot" / AUTHORITY).read_bytes()
    with pytest.raises(StartError, match="--replace"):
        certificates.make_keys(keys, HOSTS, replace=False, until=LATER)
    assert (keys / "robot" / AUTHORITY).read_bytes() == before
    certificates.make_keys(keys, HOSTS, replace=True, until=LATER)
    assert (keys / "robot" / AUTHORITY).read_bytes() != before
    checked_folder(keys, "robot")


def remove(file: str) -> Callable[[Path], object]:
    return lambda folder: (folder / file).unlink()


def overwrite(file: str, data: bytes) -> Callable[[Path], object]:
    return lambda folder: (folder / file).write_bytes(data)


def take_from_others(*files: str) -> Callable[[Path], object]:
    """From a role of another authority."""

    def change(folder: Path) -> None:
        other = folder.parent / "other"
        certificates.make_keys(other, HOSTS, replace=False, until=LATER)
        for file in files:
            shutil.copy(other / folder.name / file, folder / file)

    return change


def expire(folder: Path) -> None:
    certificates.make_keys(folder.parent, HOSTS, replace=True, until=datetime.now(UTC) - timedelta(days=1))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (remove(CERTIFICATE), "certificate.pem is missing: make the keys"),
        (remove(PRIVATE_KEY), "private_key.pem is missing"),
        (remove(AUTHORITY), "authority.pem is missing"),
        (overwrite(CERTIFICATE, b"nonsense"), "do not fit together"),
        (overwrite(AUTHORITY, b""), "do not fit together"),
        (take_from_others(PRIVATE_KEY), "do not fit together"),
        (take_from_others(AUTHORITY), "is not of the authority in"),
        (take_from_others(CERTIFICATE, PRIVATE_KEY), "is not of the authority in"),
        (expire, "has expired: make the keys"),
    ],
)
def test_files_that_cannot_serve_are_one_sentence_with_what_to_do(
    keys: Path, change: Callable[[Path], object], said: str
) -> None:
    change(keys / "robot")
    with pytest.raises(StartError) as raised:
        checked_folder(keys, "robot")
    assert said in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_clock_that_is_wrong_is_named(keys: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(certificates, "VALID_FROM", datetime.now(UTC) + timedelta(hours=1))
    certificates.make_keys(keys, HOSTS, replace=True, until=LATER)
    with pytest.raises(StartError, match="set this machine's clock"):
        checked_folder(keys, "robot")


@pytest.mark.parametrize(
    ("change", "said"), [(remove(COMMAND_KEY), "missing"), (overwrite(COMMAND_KEY, b"x"), "1 bytes")]
)
def test_a_command_key_that_is_none_is_named(keys: Path, change: Callable[[Path], object], said: str) -> None:
    change(keys / "robot")
    with pytest.raises(StartError, match=said):
        read_command_key(keys, "robot")


def test_machines_are_names_with_hosts() -> None:
    assert hosts_of(["robot=10.0.0.2", "laptop=desk", "robot=robot.local"]) == {
        "robot": ["10.0.0.2", "robot.local"],
        "laptop": ["desk"],
    }


@pytest.mark.parametrize(
    ("machines", "said"),
    [([], "robot=HOST_OR_IP is needed"), (["robot"], "not 'robot'"), (["robot=10.0.0.2", "cat=10.0.0.3"], "not 'cat=")],
)
def test_a_machine_that_is_none_is_named(machines: list[str], said: str) -> None:
    with pytest.raises(StartError, match=said):
        hosts_of(machines)


def test_a_host_that_is_none_is_named(tmp_path: Path) -> None:
    with pytest.raises(StartError, match="neither the name nor the address"):
        certificates.make_keys(tmp_path, {"robot": ["my robot"]}, replace=False, until=LATER)
    assert list(tmp_path.iterdir()) == []
