"""Which release of the programs runs here, and which message table it has. Different tables do not belong together.

`deploy push` writes the file `RELEASE` beside the packages of a board; without one the programs run from their sources.
Every module's liveliness token carries its release (`zenoh_end`), which comm compares with its own.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Any, get_type_hints

from common.messages.topics import TOPICS, Topic

RELEASE_FILE = "RELEASE"
SOURCES = "sources"  # name of what was not deployed
_ROOT = Path(__file__).resolve().parents[1]
_WORD = re.compile(r"[A-Za-z0-9._-]{1,64}")
_HASH_CHARACTERS = 12


@dataclass(frozen=True, slots=True)
class Release:
    name: str
    messages: str  # hash of its message table

    @property
    def key(self) -> str:
        """As the end of a key on the bus."""
        return f"{self.name}/{self.messages}"


def release_of_key(text: str) -> Release | None:
    """What `Release.key` has written; None for anything else."""
    name, _, messages = text.partition("/")
    return Release(name, messages) if _WORD.fullmatch(name) and _WORD.fullmatch(messages) else None


@cache
def own_release() -> Release:
    """Of the programs that run here."""
    try:
        name = (_ROOT / RELEASE_FILE).read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError):
        name = SOURCES
    return Release(name if _WORD.fullmatch(name) else SOURCES, messages_hash(TOPICS))


def messages_hash(topics: Iterable[Topic[Any]]) -> str:
    """Changes with a topic, a field, its type, or a value of an enumeration; is the same under every Python."""
    text = "\n".join(line for topic in topics for line in _lines(topic))
    return hashlib.sha256(text.encode()).hexdigest()[:_HASH_CHARACTERS]


def _lines(topic: Topic[Any]) -> Iterator[str]:
    """Of one topic. A type is taken as the source has it: how Python shows it differs between versions."""
    yield f"{topic.key} {topic.payload.__name__} {topic.qos.name} {topic.bundle_key}"
    for field in fields(topic.payload):
        yield f"{field.name}: {field.type}"
    for kind in get_type_hints(topic.payload).values():
        if isinstance(kind, type) and issubclass(kind, Enum):
            yield f"{kind.__name__} {[(member.name, str(member.value)) for member in kind]}"
