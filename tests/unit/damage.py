"""What happens to files: bits flip, halves are missing, people write nonsense, somebody puts a folder there instead.

`Damage` makes one such case after the other from sound files, the same ones for the same seed.
"""

from __future__ import annotations

import copy
import json
import os
import re
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from random import Random
from typing import Any

Content = Any

# Of every type, of every size, and what only some readers take for a number
WILD: tuple[Content, ...] = (
    *(None, True, False, 0, -1, 7, 2**31, 2**63, -(2**64), 10**400),
    *(0.0, -1e-9, 1e-320, 1e7, 1e308, float("nan"), float("inf"), float("-inf")),
    *(
        "",
        "x",
        "x" * 5000,
        "\x1b[2J\x07",
        "a\nb",
        "\u202e\ufeff",
        "\ud800",
        "nan",
        "../../etc",
        "/",
        "-",
        "[/a]",
        "0x1",
    ),
    *([], {}, [[]], [None], [[1, 2], [3]], {"x_m": {}}, [[0, 0]] * 3, {"a": {"a": {"a": []}}}, [1] * 3000),
)
WILD_WORDS = (
    *("", "nan", "inf", "-inf", "1e400", "1e7", "-1e7", "9" * 400, "9" * 5000, "0x10", "1_0", "x", ",", "\t", "\x00"),
    *("1 2", "--5", "1e", "١", "\ufeff", '"', "1.0,2.0,3.0", "#", "\x1b[2J"),
)
WILD_TOML = (
    *("9" * 400, "9" * 5000, f"0x{'f' * 9000}", f"-{'9' * 400}.5", "1e400", "nan", "inf", "-inf", "-1", "0", "1e7"),
    *(
        "true",
        '""',
        '"x"',
        '"a\\nb"',
        '"\\u001b[2J"',
        f'"{"x" * 5000}"',
        '"((((a+)+)+)+)+$"',
        '"("',
        '"a{99999999999}"',
    ),
    *('"[[a]"', '"~nobody/x"', '"\\u0000"', "[]", "{}", "[[[]]]", "[1, 2]", '["a", 1]', "[nan, inf, 1, 2, 3]"),
    *("2026-01-01", "1979-05-27T07:32:00", "{a = {b = 1}}", "[" * 3000, "'''", "=", f"[{'1,' * 3000}]", "\x00", "\\"),
)


def spoil_schema(file: Path) -> None:
    """What the file says of its tables is no text any more."""
    content = file.read_bytes()
    assert b"CREATE TABLE" in content
    file.write_bytes(content.replace(b"CREATE TABLE", b"CREATE T\xa0BLE"))


class Damage:
    """One seed, one sequence of cases."""

    def __init__(self, seed: int) -> None:
        self.chance = Random(seed)

    def bytes_of(self, data: bytes) -> bytes:
        """As a disk, a cable or a power cut would leave them."""
        chance = self.chance
        at, length = chance.randrange(len(data) + 1), chance.choice((1, 16, 512, 4096))
        kind = chance.randrange(6)
        if kind == 0:
            flipped = bytearray(data)
            for _ in range(chance.choice((1, 1, 3, 30)) if data else 0):
                flipped[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
            return bytes(flipped)
        if kind == 1:
            return data[:at]
        if kind == 2:
            return data[:at] + b"\0" * len(data[at : at + length]) + data[at + length :]
        if kind == 3:
            return data[:at] + chance.randbytes(min(length, 64)) + data[at:]
        if kind == 4:
            return data[:at] + data[max(at - length, 0) : at] + data[at:]
        return chance.choice((b"", b"\n", b"\0" * 100, b"\xff\xfe", chance.randbytes(200), data[at:], data + data))

    def json_of(self, data: bytes) -> bytes:
        """Sound JSON with wrong content: a value of another type or size, a key that is missing."""
        content = json.loads(data)
        for _ in range(self.chance.choice((1, 1, 2))):
            content = self._changed(content)
        return json.dumps(content).encode()

    def _changed(self, content: Content) -> Content:
        keys: list[Any] = list(content) if isinstance(content, dict) else []
        if isinstance(content, list):
            keys = list(range(len(content)))
        if not keys or self.chance.random() < 0.2:
            return copy.deepcopy(self.chance.choice(WILD))
        key = self.chance.choice(keys)
        if self.chance.random() < 0.1:
            del content[key]
        else:
            content[key] = self._changed(content[key])
        return content

    def words_of(self, data: bytes) -> bytes:
        """Wrong cells in a table of text."""
        words = re.split(r"([ ,\n])", data.decode())
        for _ in range(self.chance.choice((1, 1, 5))):
            words[self.chance.randrange(len(words))] = self.chance.choice(WILD_WORDS)
        return "".join(words).encode()

    def toml_of(self, data: bytes) -> bytes:
        """Wrong values behind the keys, sometimes a key or section that is none."""
        lines = data.decode().split("\n")
        for _ in range(self.chance.choice((1, 1, 2))):
            at = self.chance.randrange(len(lines))
            key = lines[at].partition(" = ")[0]
            if self.chance.random() < 0.1:
                lines[at] = self.chance.choice(WILD_TOML)
            elif " = " in lines[at]:
                lines[at] = f"{key} = {self.chance.choice(WILD_TOML)}"
        return "\n".join(lines).encode()

    def text_of(self, data: bytes, content: Callable[[bytes], bytes]) -> bytes:
        """Mostly wrong content in a sound file, `content` being one of the above; else broken bytes."""
        return content(data) if self.chance.random() < 0.7 else self.bytes_of(data)

    def sqlite(self, file: Path) -> None:
        """A sound database that holds something else, or a broken one."""
        chance = self.chance
        if chance.random() < 0.4:
            file.write_bytes(self.bytes_of(file.read_bytes()))
            return
        database = sqlite3.connect(file, isolation_level=None)
        tables = [name for (name,) in database.execute("SELECT name FROM sqlite_schema WHERE type = 'table'")]
        table = chance.choice(tables)
        columns = [row[1] for row in database.execute(f"PRAGMA table_info({table})")]
        column = chance.choice(columns)
        value = chance.choice(
            (None, "x", b"\xff", "2026-13-40", -1, 2**62, 1e308, float("inf"), "9" * 400, b"\x94\x01")
        )
        action = chance.choice(
            (
                f"DROP TABLE {table}",
                f"ALTER TABLE {table} DROP COLUMN {column}",
                f"ALTER TABLE {table} RENAME COLUMN {column} TO other",
                f"DELETE FROM {table}",
                f"PRAGMA user_version = {chance.choice((-1, 0, 2, 2**31 - 1))}",
                f"UPDATE OR REPLACE {table} SET {column} = ?",
                f"UPDATE OR REPLACE {table} SET {column} = ?",
            )
        )
        # What SQLite itself refuses leaves a sound file, which is a case as well
        with suppress(sqlite3.Error):
            database.execute(action, (value,) if "?" in action else ())
        self._spoil_payloads(database)
        database.close()

    def _spoil_payloads(self, database: sqlite3.Connection) -> None:
        with suppress(sqlite3.Error):
            rows = database.execute("SELECT row, payload FROM messages WHERE typeof(payload) = 'blob'").fetchall()
            for row, payload in self.chance.sample(rows, min(len(rows), 3)):
                database.execute("UPDATE messages SET payload = ? WHERE row = ?", (self.bytes_of(payload), row))

    def in_place_of(self, file: Path) -> None:
        """Something that is no file, or cannot be followed."""
        file.unlink()
        kind = self.chance.randrange(5)
        if kind == 0:
            file.mkdir()
        elif kind == 1:
            file.symlink_to(file.name)
        elif kind == 2:
            file.symlink_to("nowhere")
        elif kind == 3:
            os.mkfifo(file)


def remove(path: Path) -> None:
    """Whatever stands there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


class RunFolder:
    """A run folder that is spoilt and made sound again."""

    def __init__(self, folder: Path, sound_run: Path) -> None:
        self.folder = folder
        folder.mkdir(parents=True)
        self._sound = {file.name: file.read_bytes() for file in sound_run.iterdir() if file.is_file()}
        self._touched = set(self._sound)
        self.mend()

    def mend(self) -> None:
        for name in (*self._touched, "run.sqlite-wal", "run.sqlite-shm", "run.sqlite-journal"):
            remove(self.folder / name)
        for name in self._touched:
            (self.folder / name).write_bytes(self._sound[name])
        self._touched = set()

    def spoil(self, damage: Damage) -> None:
        self._touched = set(damage.chance.sample(list(self._sound), damage.chance.choice((1, 1, 2))))
        for name in self._touched:
            file = self.folder / name
            if damage.chance.random() < 0.1:
                damage.in_place_of(file)
            elif name == "run.sqlite":
                damage.sqlite(file)
            else:
                wrong = damage.json_of if name.endswith(".json") else damage.words_of
                plain = name.endswith((".json", ".tum", ".csv"))
                data = file.read_bytes()
                file.write_bytes(damage.text_of(data, wrong) if plain else damage.bytes_of(data))


def assert_told(code: int, said: str) -> None:
    """Done, or refused in one line that a terminal may show."""
    assert code in (0, 2)
    if code == 2:
        (line,) = said.splitlines()
        assert re.fullmatch(r"indoor-mapping: .+\.", line), line
        assert line.isprintable()
