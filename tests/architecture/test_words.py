"""The names in the code are the field's standard terms, so that an engineer finds things by search.

Each word on the left was once used here; on the right stands what the field calls it. A name holds a word when one of
its parts does, separated by underscores or capitals.
"""

from __future__ import annotations

import ast
import dataclasses
import re
from collections.abc import Iterator
from itertools import pairwise

from common.messages.topics import TOPICS
from tests.architecture.project import Module, modules

STANDARD = {
    "tie": "constraint, factor",
    "ties": "constraints, factors",
    "strain": "chi2 (Mahalanobis)",
    "slow": "calibration state",
    "belief": "prior",
    "beliefs": "priors",
    "rival": "second best, ambiguity",
    "upright": "orthogonality (Manhattan)",
    "approach": "range to wall",
    "surroundings": "range features",
    "carried": "kidnapped",
    "concluded": "inferred",
    "prospect": "frontier",
    "prospects": "frontiers",
    "setback": "recovery memory",
    "setbacks": "recovery memory",
    "unwinding": "net rotation balancing",
    "way": "path; channel or link of communication",
    "ways": "paths; channels",
    "hull": "footprint",
    "emergency": "collision monitor",
    "stance": "QoS profile",
    "tap": "recording subscriber",
    "tapped": "recorded",
    "seal": "signature",
    "sealed": "signed",
    "beat": "heartbeat",
    "beats": "heartbeat count",
    "sighting": "observation",
    "sightings": "observations",
    "joined": "merged, associated",
    "say": "publish, report",
    "says": "publishes",
    "said": "published, reported",
    "hear": "receive, subscribe",
    "hears": "receives",
    "heard": "received",
    "tell": "publish, report",
    "tells": "publishes, reports",
    "told": "published, reported",
    "ask": "request, query",
    "asks": "requests, queries",
    "asked": "requested, queried",
}
# Words that are plain alone: together they once named something that the field names otherwise
PHRASES = {
    ("known", "map"): "prior map",
    ("put", "off"): "deferred",
    ("given", "up"): "blacklisted",
    ("looked", "into"): "visited",
    ("gyro", "rest"): "zero-velocity update",
    ("last", "words"): "crash buffer",
}
# Name -> why it may hold its word
ALLOWED = {
    "EMERGENCY_ROUTINE": "error of the specification's Emergency routine of the Planner",
    "UNDER_WAY": "of a mission that goes on; no path is meant",
}
# `Frame` is a picture of the camera
FRAMES = ("onboard/poi/", "offboard/simulator/")

MODULES = modules()


def parts_of(name: str) -> list[str]:
    """nearTie_way -> near, tie, way"""
    return [part.lower() for part in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)]


def names_in(module: Module) -> Iterator[tuple[str, int]]:
    """Of the module and its folders, its classes and functions, their attributes, and constants; with their lines."""
    yield from ((part, 1) for part in module.path.removesuffix(".py").split("/"))
    for node in ast.walk(module.tree):
        match node:
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
                yield name, node.lineno
            case ast.Attribute(attr=name, ctx=ast.Store()) | ast.AnnAssign(target=ast.Name(id=name)):
                yield name, node.lineno
        if isinstance(node, (ast.Module, ast.ClassDef)):
            made = (statement for statement in node.body if isinstance(statement, ast.Assign))
            targets = (target for statement in made for target in statement.targets)
            yield from ((n.id, n.lineno) for target in targets for n in ast.walk(target) if isinstance(n, ast.Name))


def better(name: str) -> str:
    """What the field calls that which the name names; empty for a name that may stay."""
    if name in ALLOWED:
        return ""
    parts = parts_of(name)
    terms = [STANDARD[part] for part in parts if part in STANDARD]
    terms += [term for phrase, term in PHRASES.items() if phrase in pairwise(parts)]
    return "; ".join(terms)


def test_names_are_the_terms_of_the_field() -> None:
    found = ((module.path, line, name) for module in MODULES for name, line in names_in(module))
    assert [f"{path}:{line} {name}: {term}" for path, line, name in found if (term := better(name))] == []


def test_topics_and_their_fields_are_named_by_the_terms_of_the_field() -> None:
    fields = {field.name for topic in TOPICS for field in dataclasses.fields(topic.payload)}  # type: ignore[arg-type]
    names = fields | {part for topic in TOPICS for part in topic.key.split("/")}
    assert [f"{name}: {term}" for name in sorted(names) if (term := better(name))] == []


def test_a_frame_is_a_picture_of_the_camera() -> None:
    classes = [
        f"{module.path}:{node.lineno}"
        for module in MODULES
        for node in ast.walk(module.tree)
        if isinstance(node, ast.ClassDef) and node.name == "Frame" and not module.path.startswith(FRAMES)
    ]
    assert classes == []


def test_every_name_that_is_allowed_is_there_and_needs_it() -> None:
    there = {name for module in MODULES for name, _ in names_in(module)}
    assert [name for name in ALLOWED if name not in there or not set(parts_of(name)) & set(STANDARD)] == []
