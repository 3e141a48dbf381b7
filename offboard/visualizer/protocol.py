"""What the server sends to a page: `LiveModel` -> messages of the WebSocket. Pure. The page's side is `page/link.js`.

A message is text (JSON) or binary: the length of a JSON head (4 bytes, little endian), the head, padded with blanks to
a multiple of 4, and raw little-endian values. Each has `channel`; the newest of a channel replaces what came before,
except that `map` goes on at its `start` (0 begins anew). What is longer than PIECE_BYTES travels as messages `part`, of
which the page makes the whole again. Lengths in metres in the message `map`, angles in radians, times in seconds on the
server's clock: the page learns from the heartbeat what that shows, and so counts the transit too.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterable, Iterator
from math import isfinite
from typing import Any, cast

import numpy as np

from common.constants import SONAR_BEARINGS_RAD
from common.errors import ErrorCode
from common.mission_state import mission_state
from common.modules import MODULES, SPECIFIED
from common.zones import as_json
from offboard.export.formats import EXPORTS
from offboard.operate.alerts import error_info
from offboard.operate.health_history import SAMPLE_S
from offboard.visualizer.live_model import LiveModel, ShownRun, Token

PageMessage = str | bytes
Seen = dict[str, Token]  # per client: what it has of every channel

PIECE_BYTES = 4000  # 0.2 s of a link of 20 kB/s
MAP_POINTS = 400  # of one message: nine bytes each, so that it fits into a piece


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


def hello(robot: str, exports: Iterable[str], model_id: str, run: ShownRun, token: str, over: str = "") -> PageMessage:
    """The first message of a connection; `exports` are those that the page offers.

    `token`: with which it may order something; empty where it may only look, and stop. `over`: the name of the run
    whose walls it shows too.
    """
    offered = [{"form": form, "title": EXPORTS[form].title} for form in exports]
    names = {"robot": robot, "run": run.name, "recorded": run.recorded, "over": over}
    bearings = [round(bearing_rad, 4) for bearing_rad in SONAR_BEARINGS_RAD]
    return text_message("hello", **names, exports=offered, model=model_id, token=token, sonar_bearings_rad=bearings)


def heartbeat(model: LiveModel, now_s: float, skipped: int, echo: tuple[float, float] | None) -> PageMessage:
    """When everything that has an age arrived. The page counts on from here, and takes silence for what it is.

    `skipped`: how many poses this client was too slow for. `echo`: the page's clock at its newest confirmation, and the
    server's when that arrived.
    """
    arrived_s = {name: round(arrived_s, 3) for name, arrived_s in model.arrived_s.items()}
    answer = None if echo is None else (echo[0], round(now_s - echo[1], 4))
    return text_message("heartbeat", now_s=round(now_s, 4), echo=answer, arrived_s=arrived_s, skipped=skipped)


def _modules(model: LiveModel) -> Iterator[dict[str, Any]]:
    """The specification's eight, and whoever else reports."""
    for shown in MODULES:
        name, status = shown.name, model.statuses.get(shown.name)
        if shown not in SPECIFIED and status is None:
            continue
        module: dict[str, Any] = {"name": name, "title": shown.title}
        if status is not None:
            error = error_info(status.error_code)
            module |= {
                "state": status.state,
                "ready": status.ready,
                "memory_kb": status.memory_kb,
                "cpu_share": status.cpu_share,
                "detail": status.detail,
                "error": status.error_code,
                "meaning": error.meaning,
                "action": error.action,
            }
        yield module


def urgent(model: LiveModel, seen: Seen) -> PageMessage | None:
    """The next short message that must not be late, and marks it as seen."""
    for channel in _URGENT:
        message = _change(model, seen, channel)
        if message is not None:
            return message
    return None


def bulk(model: LiveModel, seen: Seen, channel: str) -> PageMessage | None:
    """The next message of a channel whose messages may be long, and marks it as seen."""
    return _next_points(model, seen) if channel == "map" else _change(model, seen, channel)


def _change(model: LiveModel, seen: Seen, channel: str) -> PageMessage | None:
    token = model.tokens.get(channel)
    if token is None or seen.get(channel) == token:
        return None
    seen[channel] = token
    return _MAKERS[channel](model)


def _next_points(model: LiveModel, seen: Seen) -> PageMessage | None:
    """The map from where this client has it, or anew where its past was corrected."""
    epoch, total = model.tokens["map"]
    known = seen.get("map")
    if known is None and total == 0:
        return None  # a page that shows a map from before a restart keeps it until there is another
    start = known[1] if known is not None and known[0] == epoch else 0
    end = min(total, start + MAP_POINTS)
    if known == (epoch, end):
        return None
    seen["map"] = epoch, end
    body = model.points_m[start:end].astype("<f4", copy=False).data, model.inferred[start:end].data
    return binary_message("map", *body, epoch=epoch, start=start, count=end - start, total=total)


def _pose(model: LiveModel) -> PageMessage:
    pose = model.pose
    assert pose is not None
    return text_message(
        "pose",
        x_m=round(pose.x_m, 4),
        y_m=round(pose.y_m, 4),
        heading_rad=round(pose.heading_rad, 4),
        sd_xy_m=round(pose.sd_xy_m, 3),
        sd_least_m=round(pose.sd_least_m, 3),
        worst_rad=round(pose.worst_rad, 3),
        sd_heading_rad=round(pose.sd_heading_rad, 4),
        valid=pose.valid,
        arrived_s=round(model.arrived_s["pose"], 3),
    )


def _ranges(model: LiveModel) -> PageMessage:
    ranges = model.ranges
    assert ranges is not None
    shown = [round(float(range_m), 2) if isfinite(range_m) else None for range_m in ranges.range_m]
    return text_message("ranges", range_m=shown, valid=ranges.valid, arrived_s=round(model.arrived_s["ranges"], 3))


def _vitals(model: LiveModel) -> PageMessage:
    figures = {
        name: None if value is None else round(value, 3)
        for name, value in dataclasses.asdict(model.vitals.figures()).items()
    }
    low = any(status.error_code == ErrorCode.BATTERY_LOW for status in model.statuses.values())
    return text_message("vitals", **figures, battery_low=low)


def _health(model: LiveModel) -> PageMessage:
    """Memory in kB and share of a core in per cent, oldest first."""
    modules = {
        module: {
            "memory_kb": [sample.memory_kb for sample in samples],
            "cpu_percent": [round(100 * sample.cpu_share) for sample in samples],
        }
        for module, samples in model.vitals.health().items()
    }
    return text_message("health", sample_s=SAMPLE_S, modules=modules)


def _alerts(model: LiveModel) -> PageMessage:
    return text_message("alerts", alerts=model.alerts)


def _trail(model: LiveModel) -> PageMessage:
    return binary_message("trail", np.ascontiguousarray(model.trail()[:, :2], "<f4").tobytes())


def _grid(model: LiveModel) -> PageMessage:
    grid = model.grid
    assert grid is not None
    size = {"rows": grid.rows, "columns": grid.columns, "cell_m": grid.cell_m}
    return binary_message("grid", grid.cells_zlib, origin=(grid.origin_x_m, grid.origin_y_m), **size)


def _plan(model: LiveModel) -> PageMessage:
    plan = model.plan
    assert plan is not None
    return text_message(
        "plan", path_m=np.asarray(plan.path_m, np.float64).round(2).tolist(), area_m2=round(plan.area_m2, 1)
    )


def _mission(model: LiveModel) -> PageMessage:
    """In words, which are the same everywhere."""
    state = mission_state(model.plan, model.permit)
    return text_message("mission", text=state.text, stage=state.stage.value, standing=state.standing, halls=state.halls)


def _operator(model: LiveModel) -> PageMessage:
    assert model.operator is not None
    return text_message("operator", **dataclasses.asdict(model.operator))


def _playback(model: LiveModel) -> PageMessage:
    return text_message("playback", **dataclasses.asdict(cast(Any, model.playback)))


def _moments(model: LiveModel) -> PageMessage:
    return text_message("moments", moments=[dataclasses.asdict(cast(Any, moment)) for moment in model.moments])


def _log(model: LiveModel) -> PageMessage:
    return text_message("log", lines=[dataclasses.asdict(cast(Any, line)) for line in model.log])


def _pois(model: LiveModel) -> PageMessage:
    return text_message("pois", pois=[dataclasses.asdict(record) for record in model.pois.values()])


def _zones(model: LiveModel) -> PageMessage:
    return text_message(
        "zones",
        zones=[entry | {"title": zone.title} for entry, zone in zip(as_json(model.zones), model.zones, strict=True)],
    )


def _module_list(model: LiveModel) -> PageMessage:
    return text_message("modules", modules=list(_modules(model)))


_MAKERS: dict[str, Callable[[LiveModel], PageMessage]] = {
    "pose": _pose,
    "ranges": _ranges,
    "alerts": _alerts,
    "vitals": _vitals,
    "health": _health,
    "mission": _mission,
    "operator": _operator,
    "playback": _playback,
    "moments": _moments,
    "log": _log,
    "plan": _plan,
    "modules": _module_list,
    "pois": _pois,
    "trail": _trail,
    "grid": _grid,
    "zones": _zones,
}
_URGENT = ("pose", "ranges", "mission", "operator", "playback", "alerts")
