"""Edges of the pose graph: what odometry and matches say of the relative pose of two key frames."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
import numpy.typing as npt

from common.geometry import FloatArray, Pose2
from onboard.mmu.map.growing_rows import GrowingRows


class Kind(Enum):
    """Where an edge comes from: what may be wrong with it."""

    ODOMETRY = 0
    NEAR = 1  # walls seen a little earlier on the way
    LOOP = 2  # a place visited before
    BEARING = 3  # a piece of a wall, whose direction is a value of its own
    UPRIGHT = 4  # a wall that stands at right angles to the others
    APPROACH = 5  # a wall ahead that came nearer


@dataclass(frozen=True, slots=True)
class Edge:
    """Pose of node `second` as seen from node `first`, with its information matrix (3, 3).

    Of a BEARING, `relative` turns the wall's direction into the heading of `second`; of an UPRIGHT, both of whose nodes
    are 0, the direction of the right angles into the wall's.
    `way_m` and `turn_rad` are what odometry drove in between, for its slow errors; zero for every other kind.
    """

    first: int
    second: int
    relative: Pose2
    information: FloatArray
    kind: Kind
    way_m: float = 0.0
    turn_rad: float = 0.0
    slot: int = 0  # which of the values per metre (odometry) or of the walls' directions holds here


_ROW = np.dtype(
    [
        ("first", np.int32),
        ("second", np.int32),
        ("relative", np.float64, 3),
        ("information", np.float64, (3, 3)),
        ("kind", np.int8),
        ("way_m", np.float64),
        ("turn_rad", np.float64),
        ("slot", np.int32),
    ],
    align=True,
)


class EdgeStore:
    """All edges, in the order in which they were found."""

    def __init__(self, edges: Iterable[Edge] = ()) -> None:
        self._kept = GrowingRows(_ROW)
        for edge in edges:
            self.append(edge)

    def __len__(self) -> int:
        return len(self._kept)

    def append(self, edge: Edge) -> None:
        relative, kind = edge.relative.as_array(), edge.kind.value
        row = edge.first, edge.second, relative, edge.information, kind, edge.way_m, edge.turn_rad, edge.slot
        self._kept.append(np.array([row], _ROW))

    @property
    def rows(self) -> npt.NDArray[Any]:
        """(E,), its fields named as those of `Edge`; `kind` holds the value."""
        return self._kept.rows

    def of_kind(self, kind: Kind) -> npt.NDArray[np.bool_]:
        """(E,) which edges are."""
        mask: npt.NDArray[np.bool_] = self.rows["kind"] == kind.value
        return mask

    def keep(self, mask: npt.NDArray[np.bool_]) -> None:
        """Only those (E,)."""
        self._kept.replace(self.rows[mask])
