"""Checks of mesh files that meshio does not make: regions, and cards of input decks that it drops or misreads."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import MeshError
from ..support.arrays import Array
from ..support.foreign import MeshioMesh

NASTRAN_ENDINGS = (".bdf", ".nas", ".fem")

# Names that programs give to the numbers of an element's region or material.
_REGION = re.compile(r"physical|mat|region|domain|propert|:ref$|:tag$|cell_tags|body|part_?id|group", re.IGNORECASE)
# Abaqus keywords that make or move nodes and elements; meshio ignores them.
_NOT_APPLIED = ("INCLUDE", "SYSTEM", "NGEN", "NFILL", "NMAP", "NCOPY", "ELGEN", "ELCOPY")
# Abaqus keywords and Nastran cards with mass or stiffness besides the solid elements.
_STRUCTURE = (
    "SHELL SECTION",
    "SHELL GENERAL SECTION",
    "MEMBRANE SECTION",
    "BEAM SECTION",
    "BEAM GENERAL SECTION",
    "MASS",
    "ROTARY INERTIA",
    "SPRING",
    "DASHPOT",
    "CONNECTOR SECTION",
)
_STRUCTURE_CARDS = re.compile(r"(CONM[12]|CBAR|CBEAM|CROD|CELAS[1-4]|CBUSH|PSHELL)\b")
_SOLID_CARDS = re.compile(r"(CTETRA|CHEXA|CPENTA|CPYRA)")


class CellRegions(NamedTuple):
    """Regions of a mesh: what they are, their names, and the number of each element's region, (ne,) int."""

    kind: str
    names: tuple[str | None, ...]
    number: Array

    @classmethod
    def one(cls, n: int) -> CellRegions:
        """Return the one region of n elements."""
        return cls("regions", ("",), np.zeros(n, dtype=np.int64))


class _Keyword(NamedTuple):
    """A keyword of an Abaqus deck without its asterisk, its options, and the number of its data lines."""

    name: str
    options: dict[str, str]
    data_lines: int


def check_deck(path: Path, mesh: MeshioMesh, several: bool = False) -> None:
    """Refuse decks of Abaqus and Nastran of which meshio would silently drop, move or duplicate something.

    Raises
    ------
    MeshError
        If nodes or elements are generated, included, placed by instances, or given in other coordinate systems; if the
        deck has mass or stiffness besides its solid elements; or if meshio read fewer solid elements than it has.
    """
    suffix = path.suffix.lower()
    if suffix == ".inp":
        _check_abaqus(path, list(_keywords(path.read_text(errors="replace"))), several)
    elif suffix in NASTRAN_ENDINGS:
        _check_nastran(path, mesh, _cards(path.read_text(errors="replace")))


def _keywords(text: str) -> Iterator[_Keyword]:
    name, options, data = "", dict[str, str](), 0
    lines = iter(text.splitlines())
    for line in lines:
        if line.startswith("**") or not line.strip():
            continue
        if not line.startswith("*"):
            data += 1
            continue
        if name:
            yield _Keyword(name, options, data)
        while line.rstrip().endswith(","):  # the options continue in the next line
            line = line.rstrip() + next(lines, "")
        name, *rest = (part.strip() for part in line[1:].split(","))
        name, data = name.upper(), 0
        pairs = (part.partition("=") for part in rest if part)
        options = {key.strip().upper(): value.strip() for key, _, value in pairs}
    if name:
        yield _Keyword(name, options, data)


def _check_abaqus(path: Path, keywords: list[_Keyword], several: bool) -> None:
    counts: dict[str, int] = {}
    for keyword in keywords:
        counts[keyword.name] = counts.get(keyword.name, 0) + 1
    if counts.get("NODE", 0) > 1:
        raise MeshError(
            f"{path}: expected one *NODE section, got {counts['NODE']}, of which meshio keeps the last alone. Export "
            "one part without reference points"
        )
    for name in _NOT_APPLIED:
        if name in counts:
            raise MeshError(
                f"{path}: expected all nodes and elements as they are, got *{name}, which meshio does not apply as "
                "Abaqus does. Export a flat deck with one *NODE section in global coordinates"
            )
    if any("SYSTEM" in k.options and k.options["SYSTEM"].upper() != "R" for k in keywords if k.name == "NODE"):
        raise MeshError(f"{path}: expected nodes in rectangular coordinates, got *NODE with SYSTEM=")
    placed = sum(k.data_lines for k in keywords if k.name == "INSTANCE")
    if counts.get("PART", 0) > 1 or counts.get("INSTANCE", 0) > 1 or placed:
        raise MeshError(
            f"{path}: expected one part at the place of its nodes, got {counts.get('PART', 0)} *PART and "
            f"{counts.get('INSTANCE', 0)} *INSTANCE with {placed} lines of translation or rotation, which meshio does "
            "not apply. Export one part, or a flat deck, and place the body by referencePosition"
        )
    _refuse_structure(path, [name for name in _STRUCTURE if name in counts], "*")
    if several:
        return
    sections = [k.options for k in keywords if k.name == "SOLID SECTION"]
    materials = {options.get("MATERIAL", "").upper() for options in sections}
    if len(materials) > 1:
        refuse_regions(
            path, "*SOLID SECTION", [f"{o.get('MATERIAL', '')!r} of ELSET={o.get('ELSET', '')}" for o in sections]
        )
    solids = [k.options for k in keywords if k.name == "ELEMENT" and k.options.get("TYPE", "").upper().startswith("C3")]
    sets = list(dict.fromkeys(options["ELSET"] for options in solids if "ELSET" in options))
    if len(sets) > 1 and not sections:
        refuse_regions(path, "*ELEMENT, ELSET", list(map(repr, sets)))


def _cards(text: str) -> list[list[str]]:
    """First three fields of every bulk data card of a Nastran deck, in free, small or large format."""
    cards = []
    for line in text.splitlines():
        if line[:1] in ("$", "+", "*", " ", ""):
            continue
        if "," in line:
            fields = line.split(",")[:3]
        else:
            width = 16 if "*" in line[:8] else 8
            fields = [line[:8], line[8 : 8 + width], line[8 + width : 8 + 2 * width]]
        cards.append([field.strip().upper() for field in fields])
    return cards


def _check_nastran(path: Path, mesh: MeshioMesh, cards: list[list[str]]) -> None:
    names = [card[0].rstrip("*") for card in cards]
    if any(name.startswith("INCLUDE") for name in names):
        raise MeshError(f"{path}: expected all nodes and elements in it, got INCLUDE, which meshio ignores")
    if np.any(mesh.point_data.get("nastran:ref", 0)):
        raise MeshError(
            f"{path}: some GRID entries refer to a coordinate system of their own, which meshio ignores. Export the "
            "nodes in the basic system"
        )
    said = sum(_SOLID_CARDS.match(name) is not None for name in names)
    read = sum(len(block) for block in mesh.cells if block.dim == 3)
    if said != read:
        raise MeshError(
            f"{path}: it has {said} cards of solid elements, of which meshio reads {read}. Export them all as "
            "CTETRA or all as CHEXA, in free or small format"
        )
    _refuse_structure(path, sorted({name for name in names if _STRUCTURE_CARDS.match(name)}), "")


def _refuse_structure(path: Path, found: list[str], mark: str) -> None:
    if found:
        raise MeshError(
            f"{path}: expected solid elements alone, got {', '.join(mark + name for name in found)}, whose mass and "
            "stiffness would be missing. Delete them from the deck, and put them into the Exudyn model"
        )


def check_regions(path: Path, mesh: MeshioMesh) -> None:
    """Refuse a mesh with several regions, for which one material is given.

    Raises
    ------
    MeshError
        Names the regions.
    """
    for regions in _regions(path, mesh):
        refuse_regions(path, regions.kind, [repr(name) for name in regions.names])


def regions_of(path: Path, mesh: MeshioMesh) -> CellRegions:
    """Regions of the volume elements of a file.

    They are the materials of Abaqus' solid sections, or its sets of elements if it has no sections; or numbers that
    meshio keeps for each volume element: physical groups of Gmsh, or its volumes if there are no groups; properties of
    Nastran that differ in their materials; and data named like a material or region.

    Raises
    ------
    MeshError
        If some elements of an Abaqus deck are in no section or set.
    """
    if path.suffix.lower() == ".inp":
        return _abaqus_regions(path, mesh)
    count = sum(len(block) for block in mesh.cells if block.dim == 3)
    return next(iter(_regions(path, mesh)), CellRegions.one(count))


def _abaqus_regions(path: Path, mesh: MeshioMesh) -> CellRegions:
    keywords = list(_keywords(path.read_text(errors="replace")))
    named = {k.options["ELSET"]: k.options["MATERIAL"] for k in keywords if k.name == "SOLID SECTION"}
    if not named:
        solids = [k for k in keywords if k.name == "ELEMENT" and k.options.get("TYPE", "").upper().startswith("C3")]
        named = {k.options["ELSET"]: k.options["ELSET"] for k in solids if "ELSET" in k.options}
    names = tuple(dict.fromkeys(named.values()))
    (kind,) = {block.type for block in mesh.cells if block.dim == 3}
    number = np.full(sum(len(block) for block in mesh.cells if block.dim == 3), -1)
    sets = {name.upper(): members for name, members in mesh.cell_sets_dict.items()}
    for elements, material in named.items():
        number[sets.get(elements.upper(), {}).get(kind, [])] = names.index(material)
    if (number < 0).any():
        raise MeshError(
            f"{path}: {np.count_nonzero(number < 0)} of {len(number)} elements are in no *SOLID SECTION, or in sets "
            "that meshio does not read; expected a material for each"
        )
    return CellRegions("*SOLID SECTION", names, number)


def _regions(path: Path, mesh: MeshioMesh) -> Iterator[CellRegions]:
    """Regions of volume elements by each of their numbers that tells of more than one."""
    volumes = [i for i, block in enumerate(mesh.cells) if block.dim == 3 and len(block)]
    data = {name: _values(blocks, volumes) for name, blocks in mesh.cell_data.items() if _REGION.search(name)}
    names = {int(tag): name for name, (tag, dimension) in _groups(mesh).items() if dimension == 3}
    physical = data.pop("gmsh:physical", np.zeros(0))
    data["Gmsh's physical groups"] = physical
    if not physical.any() and "gmsh:geometrical" in mesh.cell_data:
        names = {}
        data["Gmsh's volumes"] = _values(mesh.cell_data["gmsh:geometrical"], volumes)
    if path.suffix.lower() in NASTRAN_ENDINGS and "nastran:ref" in data:
        cards = _cards(path.read_text(errors="replace"))
        material = {int(card[1]): card[2] for card in cards if card[0].rstrip("*") == "PSOLID" and card[1].isdigit()}
        properties = data.pop("nastran:ref")
        if len({material.get(int(i), f"of property {i}") for i in np.unique(properties)}) > 1:
            data["Nastran's properties"] = properties
    for name, values in data.items():
        found, number = np.unique(values, return_inverse=True)
        if len(found) > 1:
            called = names if name.startswith("Gmsh") else {}
            yield CellRegions(name, tuple(called.get(int(i), str(int(i))) for i in found), number)


def _groups(mesh: MeshioMesh) -> dict[str, tuple[int, int]]:
    """Tag and dimension of Gmsh's named groups; entries of other formats are left out."""
    return {name: tuple(value) for name, value in mesh.field_data.items() if np.shape(value) == (2,)}


def _values(blocks: Sequence[object], volumes: list[int]) -> Array:
    """Whole numbers of the volume elements; empty if the data are others, such as results of an analysis."""
    found = [np.asarray(blocks[i]) for i in volumes if i < len(blocks)]
    values = np.concatenate(found) if found and all(part.ndim == 1 for part in found) else np.zeros(0)
    numeric = np.issubdtype(values.dtype, np.number)
    return values if numeric and np.isfinite(values).all() and (values == np.rint(values)).all() else np.zeros(0)


def refuse_regions(source: object, kind: str, names: list[str]) -> None:
    """Raise `MeshError` that lists the regions of a body, each with the name that is its key in quotes."""
    listed = ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")
    raise MeshError(
        f"{source}: expected a body of one material, got {len(names)} regions by {kind}: {listed}. All would be "
        "made of the one material that is given. Give one for each, {name: Material}; if all is of one material, give "
        "all regions one name, solid.mat('steel') of an OCC shape; or export only the body that you need"
    )
