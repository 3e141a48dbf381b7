"""Wall points -> polylines, for every drawing: points that are near each other are one wall, straight where they are.

The minimum spanning forest of the neighbourhood graph joins them, as few strokes as keep a wall together, so that noise
draws no mesh. Its chains are simplified (Douglas and Peucker 1973).
"""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial import cKDTree

from common.geometry import Points

JOIN_M = 0.25  # wall points nearer than this are one wall
THIN_M = 0.06  # of the points in a square of this side one is drawn
DRAWN_MAX = 100_000  # points: six kilometres of wall, drawn in a few seconds
STRAIGHT_M = 0.04  # as far may a point lie beside the line that stands for it: 0.4 mm on paper
SPUR_M = 0.15  # a side branch shorter than this is noise of the wall that it leaves


def wall_lines(points_m: Points) -> list[Points]:
    """Polylines (N, 2), N > 1, in metres; a point without neighbours is a polyline of no length."""
    thinned = thin(points_m)
    edges = _forest(thinned)
    alone = np.setdiff1d(np.arange(len(thinned)), edges)
    chains = [simplify(thinned[chain], STRAIGHT_M) for chain in _chains(_pruned(thinned, edges))]
    return chains + [thinned[[k, k]] for k in alone]


def thin(points_m: Points) -> Points:
    """One point, the mean, for every square of THIN_M that has any; larger squares where DRAWN_MAX would be passed."""
    side_m = THIN_M
    points_m = _means(points_m, side_m)
    while len(points_m) > DRAWN_MAX:
        side_m *= 2
        points_m = _means(points_m, side_m)
    return points_m


def _means(points_m: Points, side_m: float) -> Points:
    if not len(points_m):
        return points_m
    _, cell, count = np.unique(np.floor(points_m / side_m), axis=0, return_inverse=True, return_counts=True)
    cell = cell.reshape(-1)
    means = [np.bincount(cell, points_m[:, k]) / count for k in (0, 1)]
    return np.column_stack(means)


def _forest(points_m: Points) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
    """(E, 2) indices of the points that are joined."""
    if len(points_m) < 2:
        return np.empty((0, 2), np.int64)
    pairs = cKDTree(points_m).query_pairs(JOIN_M, output_type="ndarray")
    lengths_m = np.hypot(*(points_m[pairs[:, 0]] - points_m[pairs[:, 1]]).T)
    graph = coo_array((lengths_m, (pairs[:, 0], pairs[:, 1])), shape=(len(points_m), len(points_m)))
    forest = minimum_spanning_tree(graph.tocsr()).tocoo()
    return np.column_stack([forest.row, forest.col]).astype(np.int64)


_Neighbours = dict[int, list[int]]


def _pruned(points_m: Points, edges: np.ndarray[tuple[int, int], np.dtype[np.int64]]) -> _Neighbours:
    """The neighbours of each point, without branches that end within SPUR_M of where they leave a wall."""
    neighbours: _Neighbours = defaultdict(list)
    for a, b in edges.tolist():
        neighbours[a].append(b)
        neighbours[b].append(a)
    for leaf in [node for node, near in neighbours.items() if len(near) == 1]:
        spur, length_m = [leaf], 0.0
        while len(neighbours[spur[-1]]) == (1 if len(spur) == 1 else 2):
            further = next(node for node in neighbours[spur[-1]] if node not in spur[-2:])
            length_m += float(np.hypot(*(points_m[further] - points_m[spur[-1]])))
            spur.append(further)
            if length_m >= SPUR_M:
                break
        if length_m < SPUR_M and len(neighbours[spur[-1]]) > 2:
            neighbours[spur[-1]].remove(spur[-2])
            for node in spur[:-1]:
                del neighbours[node]
    return neighbours


def _chains(neighbours: _Neighbours) -> list[list[int]]:
    """Every edge once, in chains from one end or junction to the next; a forest has no rings."""
    chains = []
    for node, near in neighbours.items():
        if len(near) == 2:
            continue
        for further in near:
            chain = [node, further]
            while len(neighbours[chain[-1]]) == 2:
                a, b = neighbours[chain[-1]]
                chain.append(b if a == chain[-2] else a)
            if chain[0] < chain[-1]:  # the same chain begins at its other end too
                chains.append(chain)
    return chains


def simplify(line: Points, tolerance_m: float) -> Points:
    """The same polyline (N, 2) with as few of its points as keep every other within `tolerance_m` of it."""
    keep = np.zeros(len(line), dtype=bool)
    keep[[0, -1]] = True
    spans = [(0, len(line) - 1)]
    while spans:
        first, last = spans.pop()
        if last - first < 2:
            continue
        off_m = _distances_to_segment_m(line[first + 1 : last], line[first], line[last])
        farthest = int(off_m.argmax())
        if off_m[farthest] > tolerance_m:
            middle = first + 1 + farthest
            keep[middle] = True
            spans += [(first, middle), (middle, last)]
    return line[keep]


def _distances_to_segment_m(points_m: Points, a: Points, b: Points) -> Points:
    """(N,) distances of points (N, 2) to the segment from `a` to `b`."""
    along = b - a
    share = np.clip((points_m - a) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    return np.asarray(np.hypot(*(points_m - a - share[:, None] * along).T))
