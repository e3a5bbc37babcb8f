"""Parts of an input deck in place: which nodes and elements its sets, surfaces and sections have."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..fe.elements import BY_NAME
from ..support.arrays import Array
from .deck_lines import LARGEST, Line
from .file_mesh import FACE_CORNERS, SOLIDS, SURFACES, CellRegions, FileMesh, Group, Link, Origins

_LOG = logging.getLogger(__name__)

# Corner nodes of the faces S1, S2, ... of solids, by the number of their corners.
_FACES = {
    4: ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    5: ((0, 1, 2, 3), (0, 4, 1), (1, 4, 2), (2, 4, 3), (3, 4, 0)),
    6: ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    8: ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
}
_CORNERS = {"tetra": 4, "pyramid": 5, "wedge": 6, "hexahedron": 8}
_SECTIONS = "*SOLID SECTION"  # what regions are
_BESIDE_MIDDLE = 0.25  # of an edge's length, how far from its middle a node may lie that is left out


class Elements(NamedTuple):
    """Elements of one keyword: kind, None for lines; type and set; numbers, (k,), and numbers of nodes, (k, n).

    The number of a mid-side node that an element has not is zero. `lines` has the line of each element. `beyond`,
    (k, m), are more nodes than an element of this type has, which lie on its edges.
    """

    kind: str | None
    type: str
    set_name: str
    labels: Array
    nodes: Array
    line: Line
    lines: Sequence[Line]
    beyond: Array | None = None


class Member(NamedTuple):
    """Members of a set: numbers, or the name of another set; perhaps of an instance."""

    line: Line
    instance: str | None
    numbers: Array | range | None = None  # of a range, those that are there
    name: str = ""
    nodes_of_elements: bool = False  # the name is that of a set of elements, whose nodes are meant


@dataclass
class Set:
    """A set as it is written; internal ones, which Abaqus/CAE makes, name no faces."""

    name: str
    internal: bool = False
    members: list[Member] = field(default_factory=list)


@dataclass
class Surface:
    """A surface as it is written: of elements, with "S1" or "" for all their faces, or of nodes."""

    name: str
    of_nodes: bool
    internal: bool = False
    members: list[tuple[Member, str]] = field(default_factory=list)


@dataclass
class Part:
    """What is numbered together: a part, what an instance adds to one, or a deck without parts.

    Names are keys in capitals. An instance is turned, then shifted.
    """

    name: str = ""
    parent: Part | None = None
    turn: Array = field(default_factory=lambda: np.eye(3))
    shift: Array = field(default_factory=lambda: np.zeros(3))
    nodes: list[tuple[Line, Array, Array]] = field(default_factory=list)  # numbers, (k,), and places, (k, 3)
    elements: list[Elements] = field(default_factory=list)
    node_sets: dict[str, Set] = field(default_factory=dict)
    element_sets: dict[str, Set] = field(default_factory=dict)
    surfaces: dict[str, Surface] = field(default_factory=dict)
    sections: list[tuple[Member, str]] = field(default_factory=list)  # sets of elements, and their material

    @property
    def scopes(self) -> list[Part]:
        """The part of which it is an instance, and itself."""
        return [self] if self.parent is None else [self.parent, self]


class AskedLink(NamedTuple):
    """A tie or contact as a deck has it: its kind, its line, and the names of the surfaces."""

    kind: str
    line: Line
    names: list[str]


class _Numbering:
    """Rows, from a first one on, by the numbers of one part."""

    def __init__(self, labels: Array, first: int) -> None:
        self._order = np.argsort(labels, kind="stable")
        self._labels, self._first = labels[self._order], first

    def rows(self, labels: Array | range) -> Array:
        """Rows of numbers, -1 for those that are not there; of a range, of those that are there."""
        if isinstance(labels, range):
            first, last = np.searchsorted(self._labels, [labels.start, labels.stop])
            labels = self._labels[first:last][(self._labels[first:last] - labels.start) % labels.step == 0]
        if not len(self._labels):
            return np.full(np.shape(labels), -1)
        place = np.minimum(np.searchsorted(self._labels, labels), len(self._labels) - 1)
        rows: Array = np.where(self._labels[place] == labels, self._order[place] + self._first, -1)
        return rows


class Assembly:
    """All parts in place, and the rows of their nodes and elements among those of the model.

    Parameters
    ----------
    placed : sequence of Part
        Instances, or parts that have none, and what belongs to no part.
    instances : dict of str to Part
    only_solids : bool
        Whether other elements of a *SOLID SECTION are left out.
    """

    def __init__(self, placed: Sequence[Part], instances: dict[str, Part], only_solids: bool = False) -> None:
        self._placed, self._instances, self._only_solids = placed, instances, only_solids
        self._nodes: dict[int, _Numbering] = {}  # by the part's id, and so below
        self._elements: dict[int, _Numbering] = {}
        self._blocks: list[tuple[int, Elements, Array]] = []  # first row, and rows of the nodes, (k, n)
        self._blocks_of: dict[int, list[tuple[int, Elements, Array]]] = {}
        points: list[Array] = []
        numbers = []
        self._points_so_far = points
        n, self._count = 0, 0
        for part in placed:
            labels, places = _nodes_once([nodes for scope in part.scopes for nodes in scope.nodes])
            points.append(places @ part.turn.T + part.shift)
            numbers.append(labels)
            self._nodes[id(part)] = _Numbering(labels, n)
            n += len(labels)
            blocks = [block for scope in part.scopes for block in scope.elements]
            _check_elements_once(blocks)
            self._elements[id(part)] = _Numbering(_joined(block.labels for block in blocks), self._count)
            blocks_of_part = self._blocks_of[id(part)] = []
            for block in blocks:
                blocks_of_part.append((self._count, block, self._rows_of_nodes(part, block)))
                self._count += len(block.labels)
            self._blocks += blocks_of_part
        self._points = np.concatenate([np.zeros((0, 3)), *points])
        self._labels = _joined(iter(numbers))
        kinds = dict.fromkeys(block.kind for _, block, _ in self._blocks if block.kind is not None)
        self._of_kind = {kind: [block for block in self._blocks if block[1].kind == kind] for kind in kinds}
        self._solids = _joined(
            start + np.arange(len(rows))
            for kind, of_kind in self._of_kind.items()
            if kind in SOLIDS
            for start, _, rows in of_kind
        )

    def _rows_of_nodes(self, part: Part, block: Elements) -> Array:
        rows = self._nodes[id(part)].rows(block.nodes)
        left_out = block.nodes == 0
        if block.kind in SOLIDS:
            left_out[:, : _CORNERS[block.kind.rstrip("0123456789")]] = False
        missing = np.argwhere((rows < 0) & ~left_out)
        if len(missing):
            element, column = missing[0]
            raise block.lines[element].refuse(
                f"{len(np.unique(missing[:, 0]))} elements of type {block.type} name nodes that are not in the file, "
                f"the first is element {block.labels[element]} with node {block.nodes[element, column]}. Export nodes "
                "and elements together"
            )
        if block.beyond is not None:
            self._check_beyond(part, block, rows)
        return rows

    def _check_beyond(self, part: Part, block: Elements, rows: Array) -> None:
        """Leave out nodes beyond those of a type, as CalculiX does, if they lie on edges of their elements."""
        assert block.kind is not None
        assert block.beyond is not None
        points = np.vstack(self._points_so_far)
        beyond = self._nodes[id(part)].rows(block.beyond)
        ends = points[rows[:, BY_NAME[block.kind].edges[: beyond.shape[1]]]]
        away = np.linalg.norm(points[beyond] - ends.mean(axis=2), axis=2)
        off = (beyond < 0) | (away > _BESIDE_MIDDLE * np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2))
        if off.any():
            element = int(off.any(axis=1).argmax())
            n = rows.shape[1]
            raise block.lines[element].refuse(
                f"element {block.labels[element]} of TYPE={block.type} has {n + beyond.shape[1]} nodes, expected {n}"
            )
        _LOG.info(
            "%s: left out %d nodes of each element beyond those of TYPE=%s", block.line.where, beyond.shape[1],
            block.type,
        )  # fmt: skip

    def mesh(self, path: Path, asked: Sequence[AskedLink] = ()) -> FileMesh:
        """Mesh of all parts, with their surfaces, sets and bodies, the materials of their sections, and links."""
        cells = {kind: np.concatenate([rows for _, _, rows in of_kind]) for kind, of_kind in self._of_kind.items()}
        _tell_of_integration(path, [block for _, block, _ in self._blocks])
        faces: dict[str, list[Array]] = {}
        node_sets: dict[str, Array] = {}
        for part, before, scope in self._scopes():
            self._name_surfaces(part, scope, before, faces, node_sets)
            self._name_sets(part, scope, before, faces, node_sets)
        first = next((block.line.where for _, block, _ in self._blocks), "")
        regions = self._regions()
        return FileMesh(
            self._points, cells, faces, node_sets, regions, self._labels, origins=self._origins(), first_line=first,
            groups=self._groups(regions), links=list(self._links(asked)),
        )  # fmt: skip

    def _scopes(self) -> Iterator[tuple[Part, str, Part]]:
        """Parts in place, what stands before names in them, and the scopes of each; what is of no part comes first."""
        several = sum(bool(part.name) for part in self._placed) > 1
        for part in self._placed[::-1]:
            for scope in part.scopes:
                yield part, f"{part.name}." if several and part.name else "", scope

    def _groups(self, regions: Sequence[CellRegions]) -> list[Group]:
        """Solid elements of each instance, part, set and material."""
        place = np.full(self._count, -1)
        place[self._solids] = np.arange(len(self._solids))
        elements_of: dict[tuple[str, str], list[Array]] = {}
        for part in self._placed:
            if part.name:
                of_part = _joined(start + np.arange(len(rows)) for start, _, rows in self._blocks_of[id(part)])
                elements_of[("part" if part.parent is None else "instance", part.name)] = [of_part]
        for part in self._placed:
            if part.parent is not None:
                elements_of.setdefault(("part", part.parent.name), []).extend(elements_of["instance", part.name])
        for part, before, scope in self._scopes():
            for elements in scope.element_sets.values():
                if not elements.internal:
                    elements_of.setdefault(
                        ("element set", before + elements.name), [self._members(part, elements, of_elements=True)]
                    )
        groups = [
            Group(kind, name, np.unique(place[_joined(iter(rows))])) for (kind, name), rows in elements_of.items()
        ]
        groups = [group._replace(rows=group.rows[group.rows >= 0]) for group in groups]
        for materials in regions:
            if materials.kind == _SECTIONS:
                groups += [
                    Group("material", str(name), np.flatnonzero(materials.number == i))
                    for i, name in enumerate(materials.names)
                ]
        return [group for group in groups if len(group.rows)]

    def _links(self, asked: Sequence[AskedLink]) -> Iterator[Link]:
        """Pairs of surfaces, with the rows of their nodes."""
        surfaces: dict[str, tuple[Part, Surface, str]] = {}
        for part, before, scope in self._scopes():
            for surface in scope.surfaces.values():
                for key in (surface.name, f"{part.name}.{surface.name}"):
                    surfaces.setdefault(key.upper(), (part, surface, before))
        for kind, line, names in asked:
            pair = [surfaces.get(name.upper()) for name in names]
            if len(names) != 2 or None in pair:
                _LOG.info("%s: this %s is left out, for its surfaces are not in the deck", line.where, kind)
                continue
            nodes = [self._nodes_on(part, surface) for part, surface, _ in filter(None, pair)]
            said = [before + surface.name for _, surface, before in filter(None, pair)]
            yield Link(kind, (said[0], said[1]), (nodes[0], nodes[1]))

    def _nodes_on(self, part: Part, surface: Surface) -> Array:
        """Rows of the nodes of a surface."""
        if surface.of_nodes:
            return _union(self._rows(part, member, of_elements=False) for member, _ in surface.members)
        return _union(
            corners.ravel()
            for member, face in surface.members
            for corners in self._faces(self._rows(part, member, of_elements=True), face, member.line)
        )

    def _origins(self) -> Origins:
        """Numbers and lines of the solid elements."""
        solids = [block for kind, of_kind in self._of_kind.items() if kind in SOLIDS for _, block, _ in of_kind]
        lines = [line for block in solids for line in block.lines]
        return Origins(
            _joined(block.labels for block in solids),
            np.array([line.path for line in lines], dtype=object),
            np.array([line.number for line in lines], dtype=np.int64),
        )

    def _name_surfaces(
        self, part: Part, scope: Part, before: str, faces: dict[str, list[Array]], node_sets: dict[str, Array]
    ) -> None:
        for surface in scope.surfaces.values():
            name = before + surface.name
            if surface.of_nodes:
                node_sets.setdefault(name, _union(self._rows(part, m, of_elements=False) for m, _ in surface.members))
            elif not surface.internal:
                faces_of_members = (
                    self._faces(self._rows(part, member, of_elements=True), face, member.line)
                    for member, face in surface.members
                )
                faces.setdefault(name, [rows for of_member in faces_of_members for rows in of_member])

    def _name_sets(
        self, part: Part, scope: Part, before: str, faces: dict[str, list[Array]], node_sets: dict[str, Array]
    ) -> None:
        for named in scope.element_sets.values():
            skin = np.setdiff1d(self._members(part, named, of_elements=True), self._solids)
            if len(skin) and not named.internal:
                faces.setdefault(before + named.name, self._faces(skin, "", named.members[0].line))
        for named in scope.node_sets.values():
            members = self._members(part, named, of_elements=False)
            if not named.internal:
                node_sets.setdefault(before + named.name, members)

    def _members(self, part: Part, named: Set, *, of_elements: bool, above: tuple[str, ...] = ()) -> Array:
        """Rows of all members of a set, ascending."""
        return _union(self._rows(part, member, of_elements=of_elements, above=above) for member in named.members)

    def _rows(self, part: Part, member: Member, *, of_elements: bool, above: tuple[str, ...] = ()) -> Array:
        """Rows of elements or nodes of one member of a set that stands in a part."""
        if member.instance is not None and self._instances:
            if member.instance.upper() not in self._instances:
                raise member.line.refuse(f"there is no instance {member.instance!r}")
            part = self._instances[member.instance.upper()]
        elif member.instance is not None:  # a flat deck, as CalculiX takes them
            _LOG.info("%s: left out INSTANCE=%s, for there is none", member.line.where, member.instance)
        if member.nodes_of_elements:
            plain = member._replace(instance=None, nodes_of_elements=False)
            return self._nodes_of(self._rows(part, plain, of_elements=True))
        kind = "elements" if of_elements else "nodes"
        if member.numbers is not None:
            rows = (self._elements if of_elements else self._nodes)[id(part)].rows(member.numbers)
            missing = np.count_nonzero(rows < 0)
            if missing:
                _LOG.info("%s: %d members of a set are no %s of the deck", member.line.where, missing, kind)
            return rows[rows >= 0]
        key = member.name.upper()
        for scope in part.scopes[::-1]:
            named = (scope.element_sets if of_elements else scope.node_sets).get(key)
            if named is not None:
                if key in above:
                    raise member.line.refuse(f"expected sets of others, got {member.name!r}, which contains itself")
                return self._members(part, named, of_elements=of_elements, above=(*above, key))
        for placed in [] if self._instances else self._placed:  # parts without instances are in place as they are
            if key in (placed.element_sets if of_elements else placed.node_sets):
                return self._rows(placed, member, of_elements=of_elements, above=above)
        owner, _, inner = member.name.partition(".")
        if owner.upper() in self._instances:
            numbers = np.array([int(inner)]) if inner.isdecimal() and int(inner) <= LARGEST else None
            member = member._replace(instance=owner, name=inner, numbers=numbers)
            return self._rows(part, member, of_elements=of_elements, above=above)
        raise member.line.refuse(f"there is no set of {kind} {member.name!r}")

    def _each(self, elements: Array) -> Iterator[tuple[str | None, Array]]:
        """Kind of elements, and rows of their nodes, (k, n), of each keyword."""
        for start, block, rows in self._blocks:
            within = elements[(elements >= start) & (elements < start + len(rows))] - start
            if len(within):
                yield block.kind, rows[within]

    def _nodes_of(self, elements: Array) -> Array:
        return _union(rows[rows >= 0] for _, rows in self._each(elements))

    def _faces(self, elements: Array, face: str, line: Line) -> list[Array]:
        """Corner nodes of faces: one, such as "S1", or all of solids, and of surface elements themselves."""
        faces = []
        for kind, rows in self._each(elements):
            if kind in SURFACES:
                faces.append(rows[:, : FACE_CORNERS[kind]])
            elif kind is not None:
                of_kind = corners_of_faces(kind)
                number = int(face[1:]) if re.fullmatch(r"S\d", face) else 0
                if face and not 1 <= number <= len(of_kind):
                    raise line.refuse(f"expected a face S1 to S{len(of_kind)} of these elements, got {face}")
                faces += [rows[:, corners] for corners in (of_kind[number - 1 : number] if face else of_kind)]
        return faces

    def _regions(self) -> list[CellRegions]:
        """Materials of the solid sections; or sets of elements that keywords name, if there are no sections."""
        number = np.full(self._count, -1)
        names: dict[str, int] = {}  # whose capitals do not matter; the first spelling counts
        spelling: dict[str, str] = {}
        sections = [(part, *section) for part in self._placed for scope in part.scopes for section in scope.sections]
        for part, member, material in sections:
            rows = self._rows(part, member, of_elements=True)
            others = np.setdiff1d(rows, self._solids)
            if len(others) and self._only_solids:
                _LOG.info(
                    "%s: left out %d elements of a *SOLID SECTION that are no solids", member.line.where, len(others)
                )
            elif len(others):
                raise member.line.refuse(
                    f"expected solid elements alone, got {len(others)} others of a *SOLID SECTION, whose mass and "
                    "stiffness would be missing. Give only_solids=True to leave them out"
                )
            number[rows] = names.setdefault(spelling.setdefault(material.upper(), material), len(names))
        if sections:  # a later section of the same elements counts
            used, position = np.unique(number[self._solids], return_inverse=True)
            listed = [name for name, i in names.items() if i in used]
            return [CellRegions(_SECTIONS, tuple(listed), position.ravel() - (-1 in used))]
        for start, block, rows in self._blocks:
            if block.set_name and block.kind in SOLIDS:
                name = spelling.setdefault(block.set_name.upper(), block.set_name)
                number[start : start + len(rows)] = names.setdefault(name, len(names))
        return [CellRegions("*ELEMENT, ELSET", tuple(names), number[self._solids])] if names else []


def corners_of_faces(kind: str) -> tuple[tuple[int, ...], ...]:
    """Corners of the faces of a kind of solids, as decks number them."""
    return _FACES[_CORNERS[kind.rstrip("0123456789")]]


def _joined(parts: Iterator[Array]) -> Array:
    return np.concatenate([np.zeros(0, dtype=np.int64), *parts])


def _union(parts: Iterator[Array]) -> Array:
    return np.unique(_joined(parts))


def _nodes_once(nodes: list[tuple[Line, Array, Array]]) -> tuple[Array, Array]:
    """Numbers, (n,), and places, (n, 3), of nodes in the order of the deck, each once.

    Raises
    ------
    MeshError
        If a node has two places.
    """
    labels = _joined(numbers for _, numbers, _ in nodes)
    places = np.concatenate([np.zeros((0, 3)), *(of_line for _, _, of_line in nodes)])
    kept, first, number = np.unique(labels, return_index=True, return_inverse=True)
    if len(kept) < len(labels):
        moved = np.flatnonzero((places != places[first[number]]).any(axis=1))
        if len(moved):
            ends = np.cumsum([len(numbers) for _, numbers, _ in nodes])
            line = nodes[int(np.searchsorted(ends, moved[0], side="right"))][0]
            raise line.refuse(f"node {labels[moved[0]]} has another place already. Give each node a number of its own")
        first = np.sort(first)
        return labels[first], places[first]
    return labels, places


def _check_elements_once(blocks: list[Elements]) -> None:
    labels = _joined(block.labels for block in blocks if block.kind in SOLIDS)
    numbers, count = np.unique(labels, return_counts=True)
    if (count > 1).any():
        twice = numbers[count > 1][0]
        block = next(block for block in reversed(blocks) if twice in block.labels)
        raise block.lines[np.flatnonzero(block.labels == twice)[-1]].refuse(
            f"element {twice} is there already. Give each element a number of its own"
        )


def _tell_of_integration(path: Path, blocks: list[Elements]) -> None:
    """Log the elements whose integration or shape functions are others in Abaqus."""
    others: dict[str, int] = {}
    for block in blocks:
        if re.match(r"C3D\d+.*[RIM]", block.type):
            others[block.type] = others.get(block.type, 0) + len(block.labels)
    if others:
        listed = ", ".join(f"{count} {name}" for name, count in others.items())
        _LOG.info("%s: %s are taken with full integration and plain shape functions", path, listed)
