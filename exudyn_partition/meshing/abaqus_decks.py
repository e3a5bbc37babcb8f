"""Input decks of Abaqus and CalculiX, keyword by keyword."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..fe.elements import BY_NAME
from ..support.arrays import Array
from .abaqus_keywords import Block, blocks
from .deck_lines import LARGEST, Line
from .deck_materials import DeckMaterial
from .deck_parts import AskedLink, Assembly, Elements, Member, Part, Set, Surface
from .file_mesh import SOLIDS, SURFACES, FileMesh

_LOG = logging.getLogger(__name__)

_SOLID = re.compile(r"C3D(\d+)[A-Z]*$")
_SURFACE = re.compile(r"(?:CPS|CPEG?|CG?AX|STRI|D?S|M3D|SFM3D|R3D)(\d+)[A-Z]*\d?$")
# Lines, and what spreads loads over nodes: without mass or stiffness, as long as no section gives them one.
_LINE = re.compile(r"(?:[TBR]2D|T3D|B[23]|RB[23]D|RAX|PIPE[23]|ELBOW3|FRAME[23]D|DCOUP[23]D)\d*[A-Z]*$")
_SOLID_OF = {n: kind for kind, n in SOLIDS.items()}
_SURFACE_OF = {n: kind for kind, n in SURFACES.items()} | {65: "triangle6"}  # STRI65 has six nodes with five dofs
# Keywords, without blanks, that make or move nodes and elements and are not followed here.
_NOT_FOLLOWED = (
    "NGEN", "NFILL", "NMAP", "NCOPY", "ELGEN", "ELCOPY", "PARAMETER", "IMPERFECTION", "SYMMETRICMODELGENERATION",
)  # fmt: skip
# Keywords with mass or stiffness besides the solid elements.
_STRUCTURE = (
    "SHELLSECTION", "SHELLGENERALSECTION", "MEMBRANESECTION", "SURFACESECTION", "BEAMSECTION", "BEAMGENERALSECTION",
    "FRAMESECTION", "GASKETSECTION", "COHESIVESECTION", "MASS", "NONSTRUCTURALMASS", "ROTARYINERTIA", "SPRING",
    "DASHPOT", "CONNECTORSECTION", "JOINT", "USERELEMENT",
)  # fmt: skip
# Materials that are not linear, by their keywords.
_NOT_LINEAR = {
    "HYPERELASTIC": "hyperelastic", "ANISOTROPICHYPERELASTIC": "anisotropic and hyperelastic",
    "HYPERFOAM": "a hyperelastic foam", "LOWDENSITYFOAM": "a foam", "HYPOELASTIC": "hypoelastic",
    "POROUSELASTIC": "porous elastic", "USERMATERIAL": "a user's material",
}  # fmt: skip


def read_abaqus(path: Path, only_solids: bool = False) -> FileMesh:
    """Read nodes, elements, sets, surfaces, sections and materials of an input deck of Abaqus or CalculiX.

    Parameters
    ----------
    path : Path
    only_solids : bool
        Whether other elements are left out, with what they weigh and hold; the log names them.

    Returns
    -------
    FileMesh
        Nodes and elements in the order of the deck, those of instances in place.

    Raises
    ------
    InputError
        If it is no such deck.
    MeshError
        If a line cannot be read, or if the deck makes nodes or elements by keywords that are not followed, or has mass
        or stiffness besides its solid elements, without `only_solids`.
    """
    deck = _Deck(only_solids)
    for block in blocks(path):
        deck.read(block)
    structure = ["*" + line.text[1:].partition(",")[0].strip().upper() for line in deck.structure.values()]
    if structure and not only_solids:
        raise next(iter(deck.structure.values())).refuse(
            f"expected solid elements alone, got {', '.join(structure)}, whose mass and stiffness would be missing. "
            "Give only_solids=True to leave them out, and put them into the Exudyn model"
        )
    beside = [f"{count} {name}" for name, count in deck.left_out.items()] + structure
    if beside:
        _LOG.info("%s: left out %s, which are no solid elements", path, ", ".join(beside))
    placed = list(deck.instances.values()) or list(deck.parts.values())
    mesh = Assembly([*placed, deck.root], deck.instances, only_solids).mesh(path, deck.links)
    regions = [name for regions in mesh.regions for name in regions.names if name is not None]
    known = {name: deck.materials[name.upper()] for name in regions if name.upper() in deck.materials}
    if not known and len(deck.materials) == 1:
        known = dict.fromkeys(["", *regions], next(iter(deck.materials.values())))
    return replace(mesh, materials=known)


class _Deck:
    """What the keywords of a deck have said so far."""

    def __init__(self, only_solids: bool) -> None:
        self.only_solids = only_solids
        self.left_out: dict[str, int] = {}  # elements by their types
        self.materials: dict[str, DeckMaterial] = {}  # by their names in capitals
        self._material = ""  # the one that is told of
        self.root = Part()
        self.parts: dict[str, Part] = {}
        self.instances: dict[str, Part] = {}
        self.structure: dict[str, Line] = {}  # the first line of each keyword with mass or stiffness
        self.links: list[AskedLink] = []  # ties and contacts
        self._open = self.root  # where the next nodes and elements belong
        self._system = (np.eye(3), np.zeros(3))  # axes, in columns, and origin of *SYSTEM

    def read(self, block: Block) -> None:
        """Take what a keyword and its data say; most keywords say nothing of a mesh."""
        if block.name in _NOT_FOLLOWED:
            raise block.line.refuse(
                f"expected all nodes and elements as they are, got *{block.name}, which is not followed. Export a "
                "flat deck"
            )
        if block.name in _STRUCTURE:
            self.structure.setdefault(block.name, block.line)
        elif block.name in _TAKERS:
            _TAKERS[block.name](self, block)
        elif _SOLID.match(block.options.get("TYPE", "").upper()):
            raise block.line.refuse(f"expected *ELEMENT with TYPE={block.options['TYPE']}, got *{block.name}")

    def part(self, block: Block) -> None:
        """Open a part."""
        name = block.option("NAME")
        self._open = self.parts[name.upper()] = Part(name)

    def end(self, _: Block) -> None:
        """Close a part or instance."""
        self._open = self.root

    def instance(self, block: Block) -> None:
        """Open an instance, which is shifted by its first line, then turned by its second."""
        name, of = block.option("NAME"), block.options.get("PART", "")
        if of.upper() not in self.parts:
            raise block.line.refuse(f"expected PART= of a part that is there, got {of!r}")
        turn, shift = np.eye(3), np.zeros(3)
        if block.data:
            shift = np.array([*block.data[0].numbers, 0.0, 0.0, 0.0][:3])
        if len(block.data) > 1:
            ends = block.data[1].numbers
            if len(ends) != 7:
                raise block.data[1].refuse(f"expected two points of an axis and an angle, got {block.data[1].text!r}")
            begin = np.array(ends[:3])
            turn = _turn(np.array(ends[3:6]) - begin, ends[6], block.data[1])
            shift = turn @ (shift - begin) + begin
        self._open = self.instances[name.upper()] = Part(name, self.parts[of.upper()], turn, shift)

    def system(self, block: Block) -> None:
        """Take the system of the nodes that follow: its origin, and points on the x axis and in the x-y plane."""
        values = [value for line in block.data for value in line.numbers]
        origin, *ends = np.array([*values, *[0.0] * 9][:9]).reshape(3, 3)
        turn = np.eye(3)
        if len(values) > 3:
            x, y = ends[0] - origin, ends[1] - origin
            z = np.cross(x, y)
            if len(values) < 9 or not np.linalg.norm(z):
                raise block.line.refuse("*SYSTEM needs three points that are not on one line, or the origin alone")
            turn = np.column_stack([unit / np.linalg.norm(unit) for unit in (x, np.cross(z, x), z)])
        self._system = (turn, origin)

    def nodes(self, block: Block) -> None:
        """Take nodes, and the set that they make."""
        if not block.data:
            return
        written = np.array([[*line.numbers, 0.0, 0.0, 0.0][:4] for line in block.data])
        whole = (written[:, 0] == np.rint(written[:, 0])) & (abs(written[:, 0]) <= LARGEST)
        if not (whole & np.isfinite(written).all(axis=1)).all():
            wrong = block.data[int(np.argmin(whole & np.isfinite(written).all(axis=1)))]
            raise wrong.refuse(f"expected a node's whole number and its place, got {wrong.text[:60]!r}")
        labels = written[:, 0].astype(np.int64)
        turn, origin = self._system
        places = _rectangular(written[:, 1:], block.options.get("SYSTEM", "R").upper(), block.line) @ turn.T + origin
        self._open.nodes.append((block.line, labels, places))
        if block.options.get("NSET"):
            member = Member(block.line, None, labels)
            _set(self._open.node_sets, block.options["NSET"]).members.append(member)

    def elements(self, block: Block) -> None:
        """Take elements, and the set that they make."""
        name, set_name = block.option("TYPE").upper(), block.options.get("ELSET", "")
        kind, n, most = _kind(name, block.line, self.only_solids)
        if self.only_solids and kind not in SOLIDS and kind not in SURFACES:
            self.left_out[name] = self.left_out.get(name, 0) + len(block.data)
        read = list(_rows(block, name, n, most))
        width = len(read[0][1]) if read else n + 1
        for line, row in read:
            if len(row) != width:
                line, row = next((line, row) for line, row in read if len(row) > n + 1)
                raise line.refuse(f"element {row[0]} of TYPE={name} has {len(row) - 1} nodes, expected {n}")
        rows = np.array([row for _, row in read], dtype=np.int64).reshape(-1, width)
        lines = [line for line, _ in read]
        beyond = rows[:, n + 1 :] if width > n + 1 else None
        elements = Elements(kind, name, set_name, rows[:, 0], rows[:, 1 : n + 1], block.line, lines, beyond)
        self._open.elements.append(elements)
        if set_name:
            _set(self._open.element_sets, set_name).members.append(Member(block.line, None, rows[:, 0]))

    def node_set(self, block: Block) -> None:
        """Take a set of nodes, or those of a set of elements."""
        named = _set(self._open.node_sets, block.option("NSET"), "INTERNAL" in block.options)
        elements, instance = block.options.get("ELSET"), block.options.get("INSTANCE")
        if elements:
            named.members.append(Member(block.line, instance, name=elements, nodes_of_elements=True))
        named.members.extend(_members(block))

    def element_set(self, block: Block) -> None:
        """Take a set of elements."""
        named = _set(self._open.element_sets, block.option("ELSET"), "INTERNAL" in block.options)
        named.members.extend(_members(block))

    def surface(self, block: Block) -> None:
        """Take a surface of elements' faces, or of nodes."""
        kind = block.options.get("TYPE", "ELEMENT").upper()
        if kind not in ("ELEMENT", "NODE") or "COMBINE" in block.options:
            _LOG.info("%s: this surface is left out", block.line.where)
            return
        name = block.option("NAME")  # a surface of nodes and one of elements may have the same
        new = Surface(name, kind == "NODE", "INTERNAL" in block.options)
        named = self._open.surfaces.setdefault(f"{kind} {name.upper()}", new)
        for line in block.data:
            key, *face = line.fields
            named.members.append((_member(line, None, key), face[0].upper() if face and kind == "ELEMENT" else ""))

    def link(self, block: Block) -> None:
        """Take the pairs of surfaces of a tie or contact, slave and master."""
        kind = "tie" if block.name == "TIE" else "contact"
        self.links += [AskedLink(kind, line, line.fields[:2]) for line in block.data]

    def material(self, block: Block) -> None:
        """Open a material."""
        name = block.option("NAME")
        self._material = name.upper()
        self.materials[self._material] = DeckMaterial(name, block.line.where)

    def elastic(self, block: Block) -> None:
        """Take the modulus and Poisson's ratio of the open material."""
        kind = block.options.get("TYPE", "ISO").upper()
        if not kind.startswith("ISO"):
            self._tell(besides=f"elastic of TYPE={kind}, expected ISOTROPIC")
        elif len({tuple(line.numbers[:2]) for line in block.data}) > 1:
            self._tell(besides="elastic by temperature, expected one line of *ELASTIC")
        elif block.data:
            E, nu = [*block.data[0].numbers, 0.0][:2]
            self._tell(E=E, nu=nu)

    def not_linear(self, block: Block) -> None:
        """Take the name of a law that is not linear, with its form, such as NEO HOOKE."""
        parts = [part.strip().upper() for part in block.line.text.split(",")]
        law = ", ".join(part for part in parts if part and "=" not in part)
        self._tell(besides=f"{_NOT_LINEAR[block.name]} ({law}), expected *ELASTIC")

    def density(self, block: Block) -> None:
        """Take the density of the open material."""
        if len({line.numbers[0] for line in block.data}) > 1:
            self._tell(besides="given a density by temperature, expected one line of *DENSITY")
        elif block.data:
            self._tell(rho=block.data[0].numbers[0])

    def _tell(self, **what: Any) -> None:
        if self._material in self.materials:
            self.materials[self._material] = replace(self.materials[self._material], **what)

    def section(self, block: Block) -> None:
        """Take the material of a set of elements."""
        member = Member(block.line, None, name=block.option("ELSET"))
        self._open.sections.append((member, block.options.get("MATERIAL", "")))


_TAKERS: dict[str, Callable[[_Deck, Block], None]] = {
    "PART": _Deck.part, "ENDPART": _Deck.end, "ASSEMBLY": _Deck.end, "ENDASSEMBLY": _Deck.end,
    "INSTANCE": _Deck.instance, "ENDINSTANCE": _Deck.end, "SYSTEM": _Deck.system, "NODE": _Deck.nodes,
    "ELEMENT": _Deck.elements, "NSET": _Deck.node_set, "ELSET": _Deck.element_set, "SURFACE": _Deck.surface,
    "TIE": _Deck.link, "CONTACTPAIR": _Deck.link,
    "SOLIDSECTION": _Deck.section, "MATERIAL": _Deck.material, "ELASTIC": _Deck.elastic, "DENSITY": _Deck.density,
    **dict.fromkeys(_NOT_LINEAR, _Deck.not_linear),
}  # fmt: skip


def _set(sets: dict[str, Set], name: str, internal: bool = False) -> Set:
    """Set of a name, whose capitals do not matter; one that is there already gets more members."""
    return sets.setdefault(name.upper(), Set(name, internal))


def _members(block: Block) -> Iterator[Member]:
    """Members of a set: numbers and names of sets, mixed, or ranges of numbers."""
    instance = block.options.get("INSTANCE")
    for line in block.data:
        if "GENERATE" in block.options:
            yield Member(line, instance, _generated(line))
        elif all(text.isdecimal() for text in line.fields):
            yield Member(line, instance, np.array(line.integers, dtype=np.int64))
        else:
            for text in line.fields:
                yield _member(line, instance, text)


def _member(line: Line, instance: str | None, text: str) -> Member:
    """Member by its text: a number or a name."""
    if text.isdecimal() and int(text) <= LARGEST:
        return Member(line, instance, np.array([int(text)]))
    return Member(line, instance, name=text)


def _generated(line: Line) -> range:
    """Numbers of a line of GENERATE: first, last and, if it is not one, the increment."""
    fields = line.fields
    if len(fields) not in (2, 3) or not all(field.isdecimal() for field in fields):
        raise line.refuse(f"GENERATE needs first, last and increment, got {line.text!r}")
    first, last, step = [*map(int, fields), 1][:3]
    if step < 1 or last < first or last > LARGEST:
        raise line.refuse(f"GENERATE needs an ascending range, got {line.text!r}")
    return range(first, last + 1, step)


def _kind(name: str, line: Line, only_solids: bool) -> tuple[str | None, int, int]:
    """Kind of an element by its type's name, its number of nodes, and how many a line may have.

    None for lines, whose nodes are not read.
    """
    solid, surface = _SOLID.match(name), _SURFACE.match(name)
    kind = _SOLID_OF.get(int(solid[1])) if solid else _SURFACE_OF.get(int(surface[1])) if surface else None
    if kind is not None:
        n = (SOLIDS | SURFACES)[kind]
        return kind, n, n + len(BY_NAME[kind].edges) if solid and BY_NAME[kind].order == 1 else n
    if _LINE.match(name) or only_solids:
        return None, 0, 0
    raise line.refuse(
        f"elements of TYPE={name} are not read. Give only_solids=True to leave them out, and put what they do into the "
        "Exudyn model"
    )


def _rows(block: Block, name: str, n: int, most: int) -> Iterator[tuple[Line, list[int]]]:
    """First line, number and nodes of each element, which may continue in lines that follow.

    One that stands on a line of its own may have up to `most` nodes.
    """
    pending: list[int] = []
    begin = block.line
    for line in block.data:
        begin = begin if pending else line
        allowed = n if pending else most
        pending += line.integers
        if len(pending) > allowed + 1 and n:
            raise begin.refuse(f"element {pending[0]} of TYPE={name} has {len(pending) - 1} nodes, expected {n}")
        if len(pending) > n:
            yield begin, pending if n else pending[:1]
            pending = []
    if pending:
        raise begin.refuse(f"element {pending[0]} of TYPE={name} has {len(pending) - 1} nodes, expected {n}")


def _rectangular(places: Array, system: str, line: Line) -> Array:
    """Rectangular coordinates, (k, 3), of such, or of cylindrical ones with angles in degrees."""
    if system == "R":
        return places
    if system != "C":
        raise line.refuse(f"expected SYSTEM=R or C, got {system}. Export the nodes in rectangular coordinates")
    radius, turn = places[:, 0], np.radians(places[:, 1])
    return np.column_stack([radius * np.cos(turn), radius * np.sin(turn), places[:, 2]])


def _turn(axis: Array, degrees: float, line: Line) -> Array:
    """Matrix of a rotation about an axis, (3, 3); Rodrigues' formula."""
    length = np.linalg.norm(axis)
    if not length:
        raise line.refuse("expected two different points of an axis")
    x, y, z = axis / length
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    turn: Array = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross)
    return turn
