"""Models that Ansys writes by CDWRITE (`.cdb`): blocks of nodes and elements, components, and materials."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..errors import InputError
from ..support.arrays import Array
from .deck_lines import Line
from .deck_materials import DeckMaterial
from .deck_parts import Assembly, Elements, Member, Part, Set
from .file_mesh import SOLIDS, FileMesh, with_groups

_LOG = logging.getLogger(__name__)

ENDINGS = (".cdb",)
# Kinds of solids by the numbers of their types, such as SOLID186.
_SOLID = {
    45: "hexahedron", 185: "hexahedron", 95: "hexahedron20", 186: "hexahedron20", 92: "tetra10", 187: "tetra10",
    285: "tetra",
}  # fmt: skip
# Types without mass or stiffness of their own: loads on surfaces, contact and its targets, meshes of faces.
_BESIDE = (*range(151, 157), *range(169, 179), 200)
_FORMAT = re.compile(r"\(?\s*(\d*)i(\d+)(?:\s*,\s*(\d*)[eEfFgG](\d+)(?:\.\d+)?(?:[eE]\d+)?)?", re.IGNORECASE)
_HEAD = 11  # numbers of an element before its nodes
_MATERIAL = {"EX": "E", "NUXY": "nu", "PRXY": "nu", "DENS": "rho"}
_ORTHOTROPIC = ("EY", "EZ", "GXY", "NUYZ", "PRYZ")


def read_ansys(path: Path, only_solids: bool = False) -> FileMesh:
    """Read nodes, elements, components and materials of a file of CDWRITE.

    Parameters
    ----------
    path : Path
    only_solids : bool
        Whether other elements are left out, with what they weigh and hold; the log names them.

    Returns
    -------
    FileMesh

    Raises
    ------
    InputError
        If it has no block of nodes.
    MeshError
        If a line cannot be read, or it has mass or stiffness besides its solid elements, without `only_solids`.
    """
    deck = _Deck(only_solids)
    lines = _lines(path)
    for line in lines:
        deck.read(line, lines)
    if not deck.part.nodes:
        raise InputError(f"source: {path}: expected a file of CDWRITE with a block of nodes (NBLOCK), got none")
    if deck.left_out:
        listed = ", ".join(f"{count} of type {kind}" for kind, count in deck.left_out.items())
        _LOG.info("%s: left out %s, which are no solid elements", path, listed)
    for kind, solids in deck.elements.items():
        labels = np.array([solid.label for solid in solids], dtype=np.int64)
        nodes = np.array([solid.nodes for solid in solids], dtype=np.int64)
        lines_of = [solid.line for solid in solids]
        deck.part.elements.append(Elements(kind, kind, "", labels, nodes, lines_of[0], lines_of))
    mesh = Assembly([deck.part], {}).mesh(path)
    in_order = [solid for kind in mesh.solids for solid in deck.elements[kind]]
    material = np.array([solid.material for solid in in_order], dtype=np.int64)
    kind_of = np.array([solid.type for solid in in_order], dtype=np.int64)
    mesh = with_groups(mesh, {"type": kind_of, "material": material})
    known = {str(number): of for number, of in deck.materials.items()}
    if len(np.unique(material)) == 1:
        known[""] = known.get(str(material[0]), DeckMaterial(str(material[0]), str(path)))
    return replace(mesh, materials=known)


def _lines(path: Path) -> Iterator[Line]:
    for number, text in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
        yield Line(text, path, number)


class _Solid(NamedTuple):
    """A solid element: its line and number, the numbers of its nodes, and those of its material and type."""

    line: Line
    label: int
    nodes: list[int]
    material: int
    type: int


class _Deck:
    """What the lines of a file have said so far."""

    def __init__(self, only_solids: bool) -> None:
        self.only_solids = only_solids
        self.part = Part()
        self.types: dict[int, int] = {}  # SOLID186 and such, by the numbers of types
        self.elements: dict[str, list[_Solid]] = {}  # by their kinds
        self.materials: dict[int, DeckMaterial] = {}
        self.left_out: dict[str, int] = {}

    def read(self, line: Line, rest: Iterator[Line]) -> None:
        """Read a command, and its block from the lines that follow; most commands say nothing of a mesh."""
        name, *fields = (part.strip() for part in line.text.split(","))
        name = name.upper()
        if name == "ET" and len(fields) > 1:
            digits = re.search(r"(\d+)$", fields[1])
            self.types[_whole(fields[0], line)] = int(digits[1]) if digits else 0
        elif name == "NBLOCK":
            self.part.nodes += _nodes(line, rest)
        elif name == "EBLOCK":
            self._read_elements(line, rest)
        elif name == "CMBLOCK" and len(fields) > 2:
            self._read_component(line, fields, rest)
        elif name in ("MPDATA", "MP"):
            fields = [field for field in fields if not re.fullmatch(r"R\d+\.\d+", field)]
            self._read_material(line, fields[1:3] + fields[4:] if name == "MPDATA" else fields)

    def _read_elements(self, line: Line, rest: Iterator[Line]) -> None:
        """Read a block of elements: 11 numbers of each, the last one but two tells how many nodes it has."""
        if "SOLID" not in line.text.upper():
            _LOG.info("%s: left out a block of elements without SOLID", line.where)
            _skip(rest)
            return
        width = _format(line, rest)[1]
        for head in rest:
            row = _integers(head, width)
            if not row or row[0] == -1:
                return
            if len(row) < _HEAD:
                raise head.refuse(f"expected {_HEAD} numbers of an element and its nodes, got {len(row)}")
            material, number, count, label = row[0], row[1], row[8], row[10]
            nodes = row[_HEAD:]
            while len(nodes) < count:
                following = next(rest, None)
                if following is None:
                    raise head.refuse(f"element {label} has {len(nodes)} nodes, expected {count}")
                nodes += _integers(following, width)
            self._add(head, self.types.get(number, 0), number, label, nodes[:count], material)

    def _add(self, line: Line, kind: int, number: int, label: int, nodes: list[int], material: int) -> None:
        solid = _SOLID.get(kind)
        if solid is None:
            if kind not in _BESIDE and not self.only_solids:
                raise line.refuse(
                    f"element {label} is of type {kind}, expected solids of {', '.join(map(str, sorted(_SOLID)))}. Its "
                    "mass and stiffness would be missing. Give only_solids=True to leave such elements out"
                )
            self.left_out[str(kind)] = self.left_out.get(str(kind), 0) + 1
            return
        if len(nodes) > SOLIDS[solid]:
            raise line.refuse(f"element {label} has {len(nodes)} nodes, expected {SOLIDS[solid]}")
        nodes += [0] * (SOLIDS[solid] - len(nodes))  # middles that it does not have
        self.elements.setdefault(solid, []).append(_Solid(line, label, nodes, material, number))

    def _read_component(self, line: Line, fields: list[str], rest: Iterator[Line]) -> None:
        """Read a named set of nodes or elements; a negative number ends a range."""
        width = _format(line, rest)[1]
        count, numbers = _whole(fields[2].split("!")[0], line), list[int]()
        while len(numbers) < count:
            following = next(rest, None)
            if following is None:
                raise line.refuse(f"component {fields[0]!r} has {len(numbers)} numbers, expected {count}")
            numbers += _integers(following, width)
        members: list[int] = []
        for number in numbers:
            members += range(members[-1] + 1, 1 - number) if number < 0 and members else [number]
        of_elements = fields[1].upper().startswith("ELEM")
        sets = self.part.element_sets if of_elements else self.part.node_sets
        member = Member(line, None, np.array(members, dtype=np.int64))
        sets.setdefault(fields[0].upper(), Set(fields[0])).members.append(member)

    def _read_material(self, line: Line, fields: list[str]) -> None:
        """Read a property of a material: its name, the material's number, and its values by temperature."""
        if len(fields) < 3 or not fields[1].isdecimal():
            return
        prop, number = fields[0].upper(), int(fields[1])
        known = self.materials.setdefault(number, DeckMaterial(str(number), line.where))
        values = [_real(field, line) for field in fields[2:] if field]
        if prop in _ORTHOTROPIC:
            known = replace(known, besides="orthotropic, expected EX, NUXY or PRXY, and DENS alone")
        elif prop in _MATERIAL and values:
            by_temperature = len(set(values)) > 1 and f"given {prop} by temperature, expected one value"
            number_of: dict[str, Any] = {_MATERIAL[prop]: values[0]}
            known = replace(known, besides=known.besides or by_temperature or "", **number_of)
        self.materials[number] = known


def _format(line: Line, rest: Iterator[Line]) -> tuple[int, int, int]:
    """How many whole numbers lead a line of a block, the width of these, and that of the others."""
    following = next(rest, None)
    form = _FORMAT.match(following.text.strip()) if following else None
    if form is None:
        raise line.refuse("expected the format of the block in the next line, such as (3i9,6e21.13e3)")
    return int(form[1] or 1), int(form[2]), int(form[4] or 0)


def _nodes(line: Line, rest: Iterator[Line]) -> Iterator[tuple[Line, Array, Array]]:
    """Numbers, (n,), and places, (n, 3), of a block of nodes."""
    count, whole, real = _format(line, rest)
    labels, places = [], []
    for row in rest:
        text = row.text
        if text.lstrip()[:1].upper() in ("N", "") or text.strip() == "-1":
            break
        labels.append(_whole(text[:whole], row))
        begin = count * whole
        parts = [text[begin + i * real : begin + (i + 1) * real].strip() for i in range(3)]
        places.append([_real(part, row) if part else 0.0 for part in parts])
    if labels:
        yield line, np.array(labels, dtype=np.int64), np.array(places)


def _skip(rest: Iterator[Line]) -> None:
    for line in rest:
        if line.text.strip() == "-1":
            return


def _integers(line: Line, width: int) -> list[int]:
    text = line.text.rstrip()
    return [_whole(text[i : i + width], line) for i in range(0, len(text), width)]


def _whole(text: str, line: Line) -> int:
    try:
        return int(text)
    except ValueError as error:
        raise line.refuse(f"expected a whole number, got {text.strip()!r}") from error


def _real(text: str, line: Line) -> float:
    try:
        return float(text.upper().replace("D", "E"))
    except ValueError as error:
        raise line.refuse(f"expected a number, got {text.strip()!r}") from error
