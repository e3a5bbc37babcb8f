"""Bulk data of Nastran: nodes in their coordinate systems, solid elements, and the materials of their properties."""

from __future__ import annotations

import logging
import re
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..support.arrays import Array
from .deck_lines import Line
from .deck_materials import DeckMaterial
from .deck_parts import Assembly, Elements, Part, corners_of_faces
from .file_mesh import FACE_CORNERS, SOLIDS, SURFACES, CellRegions, FileMesh, Group, Link
from .nastran_cards import Card, cards

_LOG = logging.getLogger(__name__)

ENDINGS = (".bdf", ".nas", ".fem", ".dat")
_CARDS = re.compile(r"^(GRID|BEGIN\s*,?\s*BULK|C(TETRA|HEXA|PENTA|PYRA))\b", re.IGNORECASE | re.MULTILINE)

# Kinds of solids by the names of their cards: linear and quadratic.
_SOLID = {
    "CTETRA": ("tetra", "tetra10"),
    "CHEXA": ("hexahedron", "hexahedron20"),
    "CPENTA": ("wedge", "wedge15"),
    "CPYRAM": ("pyramid", "pyramid13"),
    "CPYRA": ("pyramid", "pyramid13"),
}
# Nastran lists the nodes on upright edges before those of the upper face.
_ORDER = {"hexahedron20": [*range(12), *range(16, 20), *range(12, 16)], "wedge15": [*range(9), 12, 13, 14, 9, 10, 11]}
_SURFACE = {"CTRIA3": "triangle", "CTRIAR": "triangle", "CTRIA6": "triangle6"}
_SURFACE |= {"CQUAD4": "quad", "CQUADR": "quad", "CQUAD8": "quad8", "CQUAD9": "quad9"}
# Cards with mass or stiffness besides the solid elements.
_STRUCTURE = re.compile(
    r"(CONM[12]|CMASS[1-4]|CBEAM3|CBEND|CONROD|CELAS[1-4]|CDAMP[1-5]|CVISC|CBUSH|CBUSH[12]D|CGAP|CWELD|"
    r"CFAST|CSHEAR|GENEL|DMIG|CTRIAX6?|CQUADX[48]?|CTRAX[36]|CTRIX[36])$"
)
# Shells and lines, which have mass and stiffness by their property alone; Gmsh writes its surfaces and curves as such.
_LINES = ("CBAR", "CBEAM", "CROD", "CTUBE")
_PROPERTY = re.compile(r"P(SHELL|COMPG?|SHEAR|MEMBR|LPLANE|BARL?|BEAML?|BCOMP|BRSECT|BMSECT|ROD|TUBE)$")
# Materials that are not read, by their cards.
_NOT_ISOTROPIC = {
    "MAT2": "anisotropic, of shells", "MAT3": "orthotropic", "MAT8": "orthotropic, of shells", "MAT9": "anisotropic",
    "MAT10": "a fluid", "MAT11": "orthotropic", "MATHP": "hyperelastic", "MATHE": "hyperelastic",
    "MATHED": "hyperelastic", "MATG": "a gasket", "MATUSR": "a user's material", "MATDIGI": "of layers",
}  # fmt: skip
# Other elements with volume, and cards that make or move nodes and elements.
_NOT_READ = re.compile(r"C(HEX|TET|PEN|PYR|IHEX|WEDGE)")
_NOT_FOLLOWED = ("EGRID", "GRIDG", "CGEN", "CORD3G", "CORD3R", "CORD3C", "CORD3S")
_LINKS = re.compile(r"(RBE[123]|RBAR|RROD|RTRPLT|MPC)$")


class _System(NamedTuple):
    """A coordinate system: rectangular "R", cylindrical "C" or spherical "S"; its origin, and its axes in columns."""

    kind: str
    origin: Array
    axes: Array

    def basic(self, places: Array) -> Array:
        """Places, (k, 3), in the basic system; angles of `places` are in degrees."""
        first, second, third = places.T
        if self.kind == "C":
            turn = np.radians(second)
            places = np.column_stack([first * np.cos(turn), first * np.sin(turn), third])
        elif self.kind == "S":
            fall, turn = np.radians(second), np.radians(third)
            across = first * np.sin(fall)
            places = np.column_stack([across * np.cos(turn), across * np.sin(turn), first * np.cos(fall)])
        found: Array = self.origin + places @ self.axes.T
        return found


def is_bulk_data(path: Path) -> bool:
    """Whether a file is one of Nastran, by its ending; other programs have .dat too, so these are looked into."""
    suffix = path.suffix.lower()
    return suffix in ENDINGS and (suffix != ".dat" or bool(_CARDS.search(path.read_text(errors="replace"))))


def read_nastran(path: Path, only_solids: bool = False) -> FileMesh:
    """Read nodes and elements of bulk data of Nastran, and the materials of the elements' properties.

    Parameters
    ----------
    path : Path
    only_solids : bool
        Whether other elements are left out, with what they weigh and hold; the log names them.

    Returns
    -------
    FileMesh
        Nodes and elements in the order of the file.

    Raises
    ------
    InputError
        If it has no cards.
    MeshError
        If a card cannot be read, or if the file makes nodes or elements by cards that are not followed, or has mass or
        stiffness besides its solid elements.
    """
    by_name: dict[str, list[Card]] = {}
    for card in cards(path):
        by_name.setdefault(card.name, []).append(card)
    for name, of_name in by_name.items():
        if name in _NOT_FOLLOWED or (_NOT_READ.match(name) and name not in _SOLID):
            raise of_name[0].line.refuse(f"expected {', '.join(_SOLID)} and their nodes, got {name}, which is not read")
    made = {card.field(1) for name, of_name in by_name.items() if _PROPERTY.match(name) for card in of_name}
    structure = sorted(
        name
        for name, of_name in by_name.items()
        if _STRUCTURE.match(name)
        or (name in (*_SURFACE, *_LINES) and any((card.field(2) or card.field(1)) in made for card in of_name))
    )
    if structure and only_solids:
        listed = ", ".join(f"{len(by_name[name])} {name}" for name in structure)
        _LOG.info("%s: left out %s, which are no solid elements", path, listed)
    elif structure:
        raise by_name[structure[0]][0].line.refuse(
            f"expected solid elements alone, got {', '.join(structure)}, whose mass and stiffness would be missing. "
            "Give only_solids=True to leave them out, and put them into the Exudyn model"
        )
    links = [name for name in by_name if _LINKS.match(name)]
    if links:
        _LOG.info("%s: %s and constraints are left out, the body is free", path, ", ".join(links))
    part = Part(nodes=_nodes(by_name))
    properties: dict[str, list[int]] = {}
    for name in [name for name in by_name if name in _SOLID or name in _SURFACE]:
        for kind, of_kind in _by_kind(name, by_name[name]).items():
            numbers = np.array([nodes for _, nodes in of_kind], dtype=np.int64)[:, _ORDER.get(kind, slice(None))]
            labels = np.array([card.integer(1) for card, _ in of_kind], dtype=np.int64)
            lines = [card.line for card, _ in of_kind]
            part.elements.append(Elements(kind, name, "", labels, numbers, lines[0], lines))
            if kind in SOLIDS:
                properties.setdefault(kind, []).extend(card.integer(2, 0) for card, _ in of_kind)
    mesh = Assembly([part], {}).mesh(path)
    of_solids = np.array([number for kind in mesh.solids for number in properties[kind]], dtype=np.int64)
    regions = _regions(by_name, of_solids)
    materials = _materials(by_name, of_solids, regions)
    surfaces = _surfaces(by_name, mesh)
    return replace(
        mesh,
        faces=surfaces,
        node_sets={},
        links=_links(by_name, surfaces),
        regions=regions,
        materials=materials,
        either_hand=True,
        groups=_groups(by_name, of_solids),
    )


def _nodes(by_name: dict[str, list[Card]]) -> list[tuple[Line, Array, Array]]:
    """Numbers, (n,), and places in the basic system, (n, 3), of the nodes, with the line of the first."""
    grids = by_name.get("GRID", [])
    if not grids:
        return []
    default = by_name["GRDSET"][0].integer(2, 0) if "GRDSET" in by_name else 0
    labels = np.array([card.integer(1) for card in grids], dtype=np.int64)
    written = np.array([[card.real(i) for i in (3, 4, 5)] for card in grids])
    of_system = np.array([card.integer(2, default) for card in grids])
    systems = _Systems(by_name, dict(zip(labels.tolist(), zip(written, of_system.tolist(), strict=True), strict=True)))
    places = written.copy()
    for number in np.unique(of_system):
        is_in = of_system == number
        if number:
            places[is_in] = systems.find(int(number), grids[int(np.argmax(is_in))].line).basic(written[is_in])
    _, first, number = np.unique(labels, return_index=True, return_inverse=True)
    moved = np.flatnonzero((places != places[first[number]]).any(axis=1))
    if len(moved):
        raise grids[moved[0]].line.refuse(
            f"node {labels[moved[0]]} has another place already. Give each a number of its own"
        )
    return [(grids[0].line, labels, places)]


class _Systems:
    """Coordinate systems by their numbers, each found when it is asked for.

    Parameters
    ----------
    by_name : dict of str to list of Card
    grids : dict of int to (place, number of its system)
        Nodes as they are written.
    """

    def __init__(self, by_name: dict[str, list[Card]], grids: dict[int, tuple[Array, int]]) -> None:
        self._grids = grids
        self._known: dict[int, _System] = {0: _System("R", np.zeros(3), np.eye(3))}
        self._asked: list[int] = []
        self._by_points = {card.integer(1): card for kind in "RCS" for card in by_name.get(f"CORD2{kind}", [])}
        self._by_nodes = {  # two in a card
            card.integer(first): (card, first)
            for kind in "RCS"
            for card in by_name.get(f"CORD1{kind}", [])
            for first in (1, 5)
            if card.field(first)
        }

    def find(self, number: int, line: Line) -> _System:
        """System of a number that stands in a line."""
        if number in self._asked:
            raise line.refuse(f"expected systems that others define, got {number}, which is defined by itself")
        if number not in self._known:
            self._asked.append(number)
            self._known[number] = self._made(number, line)
            self._asked.pop()
        return self._known[number]

    def _made(self, number: int, line: Line) -> _System:
        if number in self._by_points:
            card = self._by_points[number]
            corners = np.array([[card.real(i + j) for j in range(3)] for i in (3, 6, 9)])
            points = self.find(card.integer(2, 0), card.line).basic(corners)
        elif number in self._by_nodes:
            card, first = self._by_nodes[number]
            points = np.array([self._place(card.integer(first + i), card.line) for i in (1, 2, 3)])
        else:
            raise line.refuse(f"there is no coordinate system {number}")
        origin, on_z, in_xz = points
        z, y = on_z - origin, np.cross(on_z - origin, in_xz - origin)
        if not np.linalg.norm(y):
            raise card.line.refuse(f"coordinate system {number}: expected three points that are not on one line")
        axes = np.column_stack([axis / np.linalg.norm(axis) for axis in (np.cross(y, z), y, z)])
        return _System(card.name[-1], origin, axes)

    def _place(self, node: int, line: Line) -> Array:
        if node not in self._grids:
            raise line.refuse(f"there is no node {node}")
        written, system = self._grids[node]
        (place,) = self.find(system, line).basic(written[None])
        found: Array = place
        return found


def _surfaces(by_name: dict[str, list[Card]], mesh: FileMesh) -> dict[str, list[Array]]:
    """Corner nodes of the faces of each BSURFS, which names an element and three corners of its face."""
    cards = by_name.get("BSURFS", [])
    if not cards or mesh.labels is None or mesh.origins is None:
        return {}
    cells = [(kind, row) for kind, rows in mesh.solids.items() for row in rows.tolist()]
    element = dict(zip(mesh.origins.labels.tolist(), cells, strict=True))
    node = {label: row for row, label in enumerate(mesh.labels.tolist())}
    surfaces: dict[str, list[Array]] = {}
    for card in cards:
        faces = surfaces.setdefault(f"BSURFS {card.integer(1)}", [])
        for i in range(5, len(card.fields) + 1, 4):
            if not card.field(i):
                continue
            kind, row = element.get(card.integer(i), ("", []))
            three = {node.get(card.integer(i + j), -1) for j in (1, 2, 3)}
            corners = [[row[k] for k in face] for face in corners_of_faces(kind)] if kind else []
            faces += [np.array([face]) for face in corners if three <= set(face)]
    return surfaces


def _links(by_name: dict[str, list[Card]], surfaces: dict[str, list[Array]]) -> list[Link]:
    """Pairs of surfaces that are glued, BGSET, or may touch, BCTSET: their numbers stand in each line of the card."""
    links = []
    for kind, name in (("tie", "BGSET"), ("contact", "BCTSET")):
        for card in by_name.get(name, []):
            for i in range(2, len(card.fields), 8):
                names = f"BSURFS {card.field(i)}", f"BSURFS {card.field(i + 1)}"
                if all(surfaces.get(surface) for surface in names):
                    first, second = (np.unique(np.concatenate([f.ravel() for f in surfaces[n]])) for n in names)
                    links.append(Link(kind, names, (first, second)))
    return links


def _by_kind(name: str, of_name: list[Card]) -> dict[str, list[tuple[Card, list[int]]]]:
    """Cards of one name, each with the numbers of its nodes, by the kind of the element."""
    kinds = _SOLID.get(name) or (_SURFACE[name],)
    counts = [(SOLIDS | SURFACES)[kind] for kind in kinds]
    corners = FACE_CORNERS[kinds[0]] if name in _SURFACE else counts[0]
    by_kind: dict[str, list[tuple[Card, list[int]]]] = {}
    for card in of_name:
        given = card.fields[2 : 2 + counts[-1]] if name in _SURFACE else card.fields[2:]
        while given and given[-1] in ("", "0"):
            given.pop()
        if not corners <= len(given) <= counts[-1] or not all(given[:corners]):
            raise card.line.refuse(
                f"{name} {card.field(1)} has {sum(map(bool, given))} nodes, expected "
                f"{' or '.join(map(str, counts))}, of which only those on edges may be blank"
            )
        kind = kinds[-1] if len(given) > counts[0] else kinds[0]
        nodes = [card.integer(i, 0) for i in range(3, 3 + (SOLIDS | SURFACES)[kind])]
        by_kind.setdefault(kind, []).append((card, nodes))
    return by_kind


def _materials(
    by_name: dict[str, list[Card]], properties: Array, regions: list[CellRegions]
) -> dict[str, DeckMaterial]:
    """Materials of the properties of solid elements, (ne,), by the names of the regions."""
    weight = [card.real(2) for card in by_name.get("PARAM", []) if card.field(1).upper() == "WTMASS"]
    known = {}
    for card in by_name.get("MAT1", []):
        E, G, nu = (card.real(i) if card.field(i) else None for i in (2, 3, 4))
        if nu is None and E and G:
            nu = E / (2 * G) - 1
        elif E is None and G and nu is not None:
            E = 2 * G * (1 + nu)
        rho = card.real(5) * (weight[-1] if weight else 1.0)
        known[card.field(1)] = DeckMaterial(f"MAT1 {card.field(1)}", card.line.where, E, nu, rho)
    for kind, called in _NOT_ISOTROPIC.items():
        for card in by_name.get(kind, []):
            name = f"{kind} {card.field(1)}"
            known.setdefault(card.field(1), DeckMaterial(name, card.line.where, besides=f"{called}, expected MAT1"))
    of_property = {
        str(card.integer(1)): known[card.field(2)]
        for name in ("PSOLID", "PLSOLID")
        for card in by_name.get(name, [])
        if card.field(1) and card.field(2) in known
    }
    names = [str(name) for name in np.unique(properties)]
    if not regions:
        return {"": of_property[names[0]]} if names and names[0] in of_property else {}
    return {name: of_property[name] for name in names if name in of_property}


def _groups(by_name: dict[str, list[Card]], properties: Array) -> list[Group]:
    """Solid elements by the numbers of their properties, (ne,), and by those of their materials."""
    material = _materials_of_properties(by_name)
    written = [material.get(int(number), "") for number in properties]
    numbers = np.array([int(text) if text.isdecimal() else 0 for text in written], dtype=np.int64)
    return [
        Group(kind, str(number), np.flatnonzero(values == number))
        for kind, values in (("property", properties), ("material", numbers))
        for number in np.unique(values)
        if number
    ]


def _materials_of_properties(by_name: dict[str, list[Card]]) -> dict[int, str]:
    """Numbers of materials, as they are written, by those of the properties of solid elements."""
    return {
        card.integer(1): card.field(2)
        for name in ("PSOLID", "PLSOLID")
        for card in by_name.get(name, [])
        if card.field(1)
    }


def _regions(by_name: dict[str, list[Card]], properties: Array) -> list[CellRegions]:
    """Properties of the solid elements, (ne,), as regions, if they differ in their materials."""
    material = _materials_of_properties(by_name)
    names, number = np.unique(properties, return_inverse=True)
    if len({material.get(int(name), f"of property {name}") for name in names}) < 2:
        return []
    return [CellRegions("Nastran's properties", tuple(str(name) for name in names), number)]
