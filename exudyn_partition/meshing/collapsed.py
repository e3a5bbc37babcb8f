"""Elements with nodes that have fallen together, as what they are, and those that lack nodes on their edges."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..fe.elements import BY_NAME, HEX_EDGES, HEXAHEDRA, Kind
from ..fe.shapes import CELL_FACES
from ..support.arrays import Array
from .file_mesh import FileMesh

_LOG = logging.getLogger(__name__)

_CORNERS_BY_FACES = {(4, 0): 4, (4, 1): 5, (2, 3): 6}  # of elements, by their numbers of triangles and quadrilaterals


def with_middles(path: Path, file: FileMesh) -> FileMesh:
    """Give elements that lack mid-side nodes, -1 in their rows, those of their neighbours or new ones."""
    kinds = [BY_NAME[name] for name in file.solids if name in BY_NAME]
    if not any((file.cells[kind.name][:, kind.corners :] < 0).any() for kind in kinds):
        return file
    quadratic = [kind for kind in kinds if kind.order == 2]
    cells = {kind.name: file.cells[kind.name].copy() for kind in quadratic}
    ends = [np.sort(cells[kind.name][:, kind.edges], axis=2).reshape(-1, 2) for kind in quadratic]
    edges, number = np.unique(np.concatenate(ends), axis=0, return_inverse=True)
    middle = np.full(len(edges), -1)
    np.maximum.at(middle, number.ravel(), np.concatenate([cells[k.name][:, k.corners :].ravel() for k in quadratic]))
    made = np.flatnonzero(middle < 0)
    middle[made] = len(file.points) + np.arange(len(made))
    points = np.vstack([file.points, file.points[edges[made]].mean(axis=1)])
    at = 0
    for kind, of_kind in zip(quadratic, ends, strict=True):
        given = cells[kind.name][:, kind.corners :]
        known = middle[number.ravel()[at : at + len(of_kind)]].reshape(given.shape)
        given[given < 0] = known[given < 0]
        at += len(of_kind)
    _LOG.info("%s: %d mid-side nodes that no element has were put in the middle of their edges", path, len(made))
    labels = file.labels if file.labels is None else np.append(file.labels, np.full(len(made), -1))
    return replace(file, points=points, cells=file.cells | cells, labels=labels)


def as_they_are(path: Path, file: FileMesh) -> FileMesh:
    """Take elements whose corners have fallen together as the wedges, pyramids and tetrahedra that they are.

    Those that are none of these stay as they are.
    """
    parts: dict[str, list[tuple[Array, Array]]] = {}  # cells, and their places among all
    start, changed = 0, 0
    for name, cells in file.solids.items():
        places = start + np.arange(len(cells))
        start += len(cells)
        kind = BY_NAME.get(name)
        corners = np.sort(cells[:, : kind.corners], axis=1) if kind else cells
        some = np.flatnonzero((np.diff(corners, axis=1) == 0).any(axis=1)) if kind else np.zeros(0, dtype=int)
        left = np.ones(len(cells), dtype=bool)
        for rows, new, columns in _patterns(kind, cells[some]) if kind and len(some) else []:
            parts.setdefault(new.name, []).append((columns, places[some[rows]]))
            left[some[rows]] = False
        changed += int(np.count_nonzero(~left))
        if left.any():
            parts.setdefault(name, []).insert(0, (cells[left], places[left]))
    if not changed:
        return file
    _LOG.info("%s: %d elements with nodes that have fallen together are taken as what they are", path, changed)
    solids = {name: np.concatenate([cells for cells, _ in pieces]) for name, pieces in parts.items()}
    order = np.concatenate([places for pieces in parts.values() for _, places in pieces])
    beside = {name: cells for name, cells in file.cells.items() if name not in file.solids}
    regions = [region._replace(number=region.number[order]) for region in file.regions]
    origins = file.origins if file.origins is None else file.origins.subset(order)
    place = np.argsort(order)
    groups = [group._replace(rows=np.sort(place[group.rows])) for group in file.groups]
    faces = {name: [rows for pieces in named for rows in _by_corners(pieces)] for name, named in file.faces.items()}
    return replace(file, cells=beside | solids, regions=regions, origins=origins, faces=faces, groups=groups)


def _patterns(kind: Kind, cells: Array) -> list[tuple[Array, Kind, Array]]:
    """Rows of cells whose corners fall together in one way, the kind that they are, and their nodes."""
    rows = cells[:, kind.of_row]
    same = (rows[:, :8, None] == rows[:, None, :8]).argmax(axis=2)  # the first corner that each one is
    patterns = []
    for pattern in np.unique(same, axis=0):
        of_pattern = np.flatnonzero((same == pattern).all(axis=1))
        made = _made_of(pattern, kind.order)
        if made is None:
            continue
        new, columns = made
        nodes = rows[of_pattern][:, columns]
        counts = [(np.diff(np.sort(some, axis=1), axis=1) != 0).sum(axis=1) for some in (nodes, rows[of_pattern])]
        whole = counts[0] == counts[1]  # no node is lost
        if whole.any():
            patterns.append((of_pattern[whole], new, nodes[whole]))
    return patterns


def _made_of(pattern: Array, order: int) -> tuple[Kind, Array] | None:
    """Kind of a hexahedron whose corners are those of `pattern`, (8,), and the columns of its nodes; None if none."""
    triangles: list[list[int]] = []
    quadrilaterals: list[list[int]] = []
    for face in pattern[CELL_FACES[8]]:
        ring = face[face != np.roll(face, 1)].tolist()
        if len(set(ring)) < len(ring):
            return None
        if len(ring) > 2:
            (triangles if len(ring) == 3 else quadrilaterals).append(ring)
    count = _CORNERS_BY_FACES.get((len(triangles), len(quadrilaterals)))
    corners = set(pattern.tolist())
    if count is None or len(corners) != count or len({frozenset(ring) for ring in triangles}) < len(triangles):
        return None
    foot = (quadrilaterals if count == 5 else triangles)[0]  # outward, but the foot of elements is listed inward
    foot = [foot[0], *foot[:0:-1]]
    if count == 6:
        sides = [{ring[i], ring[i - 1]} for ring in quadrilaterals for i in range(4)]
        above = [[corner for corner in triangles[1] if {below, corner} in sides] for below in foot]
        if any(len(candidates) != 1 for candidates in above):
            return None
        nodes = foot + [candidates[0] for candidates in above]
    else:
        nodes = foot + sorted(corners - set(foot))
    new = HEXAHEDRA[8 if order == 1 else 20][count]
    if order == 2:
        known = {frozenset(ends): 8 + i for i, ends in enumerate(pattern[HEX_EDGES].tolist())}
        nodes = nodes + [known[frozenset(ends)] for ends in np.array(nodes)[new.edges].tolist()]
    return new, np.array(nodes)


def _by_corners(faces: Array) -> list[Array]:
    """Faces, (k, 3) or (k, 4) nodes, without repeated corners: triangles and quadrilaterals."""
    repeated = faces == np.roll(faces, 1, axis=1)
    count = faces.shape[1] - repeated.sum(axis=1)
    by_count = [faces[count == faces.shape[1]]]
    if faces.shape[1] == 4:
        by_count.append(faces[count == 3][~repeated[count == 3]].reshape(-1, 3))
    return [rows for rows in by_count if len(rows)]
