"""Universal files of I-DEAS (`.unv`), as Salome, Gmsh, Siemens and others write them: nodes, elements and groups."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..support.arrays import Array
from .deck_lines import Line
from .deck_parts import Assembly, Elements, Member, Part, Set
from .file_mesh import SOLIDS, SURFACES, FileMesh, with_groups

_LOG = logging.getLogger(__name__)

_SOLID = {111: "tetra", 118: "tetra10", 112: "wedge", 113: "wedge15", 115: "hexahedron", 116: "hexahedron20"}
_SURFACE = {
    **dict.fromkeys((41, 51, 61, 74, 81, 91), "triangle"), **dict.fromkeys((42, 52, 62, 72, 82, 92), "triangle6"),
    **dict.fromkeys((44, 54, 64, 71, 84, 94), "quad"), **dict.fromkeys((45, 55, 65, 75, 85, 95), "quad8"),
}  # fmt: skip
_LINES = (11, 21, 22, 23, 24, 31, 32)  # have a line more, of their section
_STRUCTURE = (*range(136, 143), 151, 152, 161, 162)  # springs, dampers and masses
# Quadratic elements are listed around each face, with the nodes on edges in between.
_ORDER = {
    "tetra10": [0, 2, 4, 9, 1, 3, 5, 6, 7, 8],
    "wedge15": [0, 2, 4, 9, 11, 13, 1, 3, 5, 10, 12, 14, 6, 7, 8],
    "hexahedron20": [0, 2, 4, 6, 12, 14, 16, 18, 1, 3, 5, 7, 13, 15, 17, 19, 8, 9, 10, 11],
    "triangle6": [0, 2, 4, 1, 3, 5],
    "quad8": [0, 2, 4, 6, 1, 3, 5, 7],
}
ENDINGS = (".unv", ".uff")
_NODES = (15, 781, 2411)  # datasets
_ELEMENTS = (780, 2412)
_GROUPS = {2429: 2, 2430: 2, 2432: 2, 2435: 4, 2452: 4, 2467: 4, 2477: 4}  # numbers by which each member is named
_NODE, _ELEMENT = 7, 8  # kinds of members


def read_universal(path: Path, only_solids: bool = False) -> FileMesh:
    """Read nodes, elements and groups of a universal file; groups of elements and nodes name bodies and boundaries.

    Parameters
    ----------
    path : Path
    only_solids : bool
        Whether springs and masses are left out; the log names them.

    Raises
    ------
    InputError
        If it has no dataset of nodes.
    MeshError
        If a line cannot be read, or there are other solids, or springs and masses without `only_solids`.
    """
    part = Part()
    numbers: dict[str, list[tuple[int, int]]] = {}  # property and material of each solid
    for kind, lines in _datasets(path):
        if kind in _NODES and lines:
            part.nodes.append(_nodes(kind, lines))
        elif kind in _ELEMENTS:
            _read_elements(kind, lines, part, numbers, only_solids)
        elif kind in _GROUPS:
            _read_groups(_GROUPS[kind], lines, part)
    if not part.nodes:
        raise InputError(f"source: {path}: expected a universal file with a dataset of nodes (2411), got none")
    mesh = Assembly([part], {}).mesh(path)
    values = np.array([pair for kind in mesh.solids for pair in numbers[kind]], dtype=np.int64).reshape(-1, 2)
    return with_groups(mesh, {"property": values[:, 0], "material": values[:, 1]})


def _datasets(path: Path) -> Iterator[tuple[int, list[Line]]]:
    """Numbers of the datasets, and the lines of each; lines of -1 are around them."""
    inside, lines = False, list[Line]()
    for number, text in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
        if text.strip() != "-1":
            if inside:
                lines.append(Line(text, path, number))
            continue
        if inside and lines:
            kind = lines[0].text.split()[0].rstrip("bB")
            yield (int(kind) if kind.isdecimal() else 0), lines[1:]
        inside, lines = not inside, []


def _integers(line: Line) -> list[int]:
    try:
        return [int(text) for text in line.text.split()]
    except ValueError as error:
        raise line.refuse(f"expected whole numbers, got {line.text[:60]!r}") from error


def _reals(line: Line) -> list[float]:
    try:
        return [float(text) for text in line.text.upper().replace("D", "E").split()]
    except ValueError as error:
        raise line.refuse(f"expected numbers, got {line.text[:60]!r}") from error


def _nodes(kind: int, lines: list[Line]) -> tuple[Line, Array, Array]:
    """Numbers, (n,), and places, (n, 3), of nodes: of dataset 15 in a line each, of others in two."""
    if kind == 15:
        rows = [(line, [*map(int, values[:1]), *values[4:]]) for line in lines for values in [_reals(line)]]
    else:
        rows = [
            (name, [_integers(name)[0], *_reals(place)]) for name, place in zip(lines[::2], lines[1::2], strict=False)
        ]
    wrong = next((line for line, row in rows if len(row) != 4), None)
    if wrong or not rows:
        raise (wrong or lines[0]).refuse("expected a node's number and its place in space")
    values = np.array([row for _, row in rows])
    return rows[0][0], values[:, 0].astype(np.int64), values[:, 1:]


def _listed(kinds: dict[int, str]) -> str:
    return ", ".join(f"{number} ({name})" for number, name in kinds.items())


def _read_elements(
    kind: int, lines: list[Line], part: Part, numbers: dict[str, list[tuple[int, int]]], only_solids: bool
) -> None:
    """Take elements of a dataset; lines and rigid ones are left out."""
    rows: dict[str, list[tuple[Line, int, list[int]]]] = {}
    left_out: dict[int, int] = {}
    rest = iter(lines)
    for line in rest:
        head = _integers(line)
        if len(head) < 6:
            raise line.refuse("expected an element's number, kind, property, material, colour and number of nodes")
        label, descriptor, count = head[0], head[1], head[-1]
        of_property, of_material = (head[2], head[3]) if kind == 2412 else (head[3], head[5])
        if descriptor in _LINES:
            next(rest, None)
        nodes: list[int] = []
        while len(nodes) < count:
            following = next(rest, None)
            if following is None:
                raise line.refuse(f"element {label} has {len(nodes)} nodes, expected {count}")
            nodes += _integers(following)
        name = _SOLID.get(descriptor) or _SURFACE.get(descriptor)
        if name is None and (110 <= descriptor < 120 or (descriptor in _STRUCTURE and not only_solids)):
            advice = "Give only_solids=True to leave them out" if descriptor in _STRUCTURE else "Mesh with tetrahedra"
            raise line.refuse(f"element {label} is of kind {descriptor}, expected {_listed(_SOLID)}. {advice}")
        if name is None:
            left_out[descriptor] = left_out.get(descriptor, 0) + 1
            continue
        if len(nodes) != (SOLIDS | SURFACES)[name]:
            raise line.refuse(f"element {label} has {len(nodes)} nodes, expected {(SOLIDS | SURFACES)[name]}")
        rows.setdefault(name, []).append((line, label, nodes))
        if name in SOLIDS:
            numbers.setdefault(name, []).append((of_property, of_material))
    for name, of_kind in rows.items():
        labels = np.array([label for _, label, _ in of_kind], dtype=np.int64)
        nodes_of = np.array([nodes for _, _, nodes in of_kind], dtype=np.int64)[:, _ORDER.get(name, slice(None))]
        part.elements.append(
            Elements(name, name, "", labels, nodes_of, of_kind[0][0], [line for line, _, _ in of_kind])
        )
    if left_out:
        listed = ", ".join(f"{count} of kind {descriptor}" for descriptor, count in left_out.items())
        _LOG.info("%s: left out elements without volume or surface: %s", lines[0].path, listed)


def _read_groups(width: int, lines: list[Line], part: Part) -> None:
    """Take groups, whose members are elements and nodes; `width` numbers tell of each, first its kind and number."""
    rest = iter(lines)
    for line in rest:
        count = _integers(line)[-1]
        name_line = next(rest, None)
        if name_line is None:
            raise line.refuse("expected the name of a group in the next line")
        name, members = name_line.text.strip(), list[int]()
        while len(members) < width * count:
            following = next(rest, None)
            if following is None:
                raise line.refuse(f"group {name!r} has {len(members) // width} members, expected {count}")
            members += _integers(following)
        rows = np.array(members, dtype=np.int64).reshape(-1, width)
        for kind, sets in ((_ELEMENT, part.element_sets), (_NODE, part.node_sets)):
            labels = rows[rows[:, 0] == kind, 1]
            if len(labels):
                sets.setdefault(name.upper(), Set(name)).members.append(Member(line, None, labels))
