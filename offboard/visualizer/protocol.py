"""What the server sends to a page: `LiveModel` -> messages of the WebSocket. Pure. The page's side is `page/link.js`.

A message is text (JSON) or binary: the length of a JSON head (4 bytes, little endian), the head, padded with blanks to
a multiple of 4, and raw little-endian values. Each has `channel`; the newest of a channel replaces what came before,
except that `map` goes on at its `start` (0 begins anew). Lengths in metres, angles in radians, ages in seconds.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterable, Iterator
from math import isfinite
from typing import Any

import numpy as np

from common.errors import ERRORS, ErrorInfo
from common.mission_state import mission_state
from common.modules import MODULES, SPECIFIED
from offboard.export.formats import EXPORTS
from offboard.visualizer.live_model import LiveModel, Token

PageMessage = str | bytes
Seen = dict[str, Token]  # per client: what it has of every channel

_ERRORS = {int(code): info for code, info in ERRORS.items()}
_UNKNOWN_ERROR = ErrorInfo("an error that this version does not know", "update this laptop")


def text_message(channel: str, **values: Any) -> str:
    """A number that is none goes out as null: JSON has no other value for it."""
    message = {"channel": channel} | values
    try:
        return json.dumps(message, separators=(",", ":"), allow_nan=False)
    except ValueError:
        return json.dumps(_without_nan(message), separators=(",", ":"))


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and not isfinite(value) else value


def binary_message(channel: str, *body: bytes | memoryview, **values: Any) -> bytes:
    head = text_message(channel, **values).encode()
    head += b" " * (-len(head) % 4)
    return b"".join((len(head).to_bytes(4, "little"), head, *body))


def hello(robot: str, exports: Iterable[str]) -> PageMessage:
    """The first message of a connection; `exports` are those that the page offers."""
    offered = [{"form": form, "title": EXPORTS[form].title} for form in exports]
    return text_message("hello", robot=robot, exports=offered)


def heartbeat(model: LiveModel, now_s: float, skipped: int) -> PageMessage:
    """What has an age: the page counts on from here, and takes silence for what it is.

    `skipped`: how many poses this client was too slow for.
    """
    ages = {name: model.age_s(name, now_s) for name in ("pose", "robot")}
    return text_message("heartbeat", age_s=ages, modules=list(_modules(model, now_s)), skipped=skipped)


def _modules(model: LiveModel, now_s: float) -> Iterator[dict[str, Any]]:
    """The specification's eight, and whoever else reports."""
    for shown in MODULES:
        name, status = shown.name, model.statuses.get(shown.name)
        if shown not in SPECIFIED and status is None:
            continue
        module: dict[str, Any] = {"name": name, "title": shown.title, "age_s": model.age_s(name, now_s)}
        if status is not None:
            error = _ERRORS.get(status.error_code, _UNKNOWN_ERROR)
            module |= {
                "state": status.state,
                "ready": status.ready,
                "memory_kb": status.memory_kb,
                "detail": status.detail,
                "error": status.error_code,
                "meaning": error.meaning,
                "action": error.action,
            }
        yield module


def changes(model: LiveModel, seen: Seen, now_s: float) -> Iterator[PageMessage]:
    """One message for every channel of which the client has not seen the newest, and marks them as seen."""
    for channel, make in _CHANNELS.items():
        token = model.tokens.get(channel)
        if token is not None and seen.get(channel) != token:
            yield make(model, seen.get(channel), now_s)
            seen[channel] = token


def _pose(model: LiveModel, _: Token | None, now_s: float) -> PageMessage:
    pose = model.pose
    assert pose is not None
    return text_message(
        "pose",
        x_m=round(pose.x_m, 4),
        y_m=round(pose.y_m, 4),
        heading_rad=round(pose.heading_rad, 4),
        sd_xy_m=round(pose.sd_xy_m, 3),
        valid=pose.valid,
        age_s=model.age_s("pose", now_s),
    )


def _map(model: LiveModel, seen: Token | None, _: float) -> PageMessage:
    epoch, length = model.tokens["map"]
    start = seen[1] if seen is not None and seen[0] == epoch else 0
    body = model.points_m[start:length].astype("<f4", copy=False).data, model.inferred[start:length].data
    return binary_message("map", *body, start=start, count=length - start, base=model.base_point())


def _trail(model: LiveModel, _: Token | None, __: float) -> PageMessage:
    return binary_message("trail", np.ascontiguousarray(model.trail()[:, :2], "<f4").tobytes())


def _grid(model: LiveModel, _: Token | None, __: float) -> PageMessage:
    grid = model.grid
    assert grid is not None
    size = {"rows": grid.rows, "columns": grid.columns, "cell_m": grid.cell_m}
    return binary_message("grid", grid.cells_zlib, origin=(grid.origin_x_m, grid.origin_y_m), **size)


def _plan(model: LiveModel, _: Token | None, __: float) -> PageMessage:
    plan = model.plan
    assert plan is not None
    return text_message(
        "plan", path_m=np.asarray(plan.path_m, np.float64).round(2).tolist(), area_m2=round(plan.area_m2, 1)
    )


def _mission(model: LiveModel, _: Token | None, __: float) -> PageMessage:
    """In words, which are the same everywhere."""
    state = mission_state(model.plan, model.permit)
    return text_message("mission", text=state.text, stage=state.stage.value, standing=state.standing, halls=state.halls)


def _pois(model: LiveModel, _: Token | None, __: float) -> PageMessage:
    return text_message("pois", pois=[dataclasses.asdict(record) for record in model.pois.values()])


# The robot first: it is what must not be late
_CHANNELS: dict[str, Callable[[LiveModel, Token | None, float], PageMessage]] = {
    "pose": _pose,
    "mission": _mission,
    "plan": _plan,
    "map": _map,
    "pois": _pois,
    "trail": _trail,
    "grid": _grid,
}
