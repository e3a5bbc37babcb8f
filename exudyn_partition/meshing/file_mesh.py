"""What a mesh file holds, whoever reads it: points, elements, named faces and nodes, regions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ..errors import MeshError
from ..support.arrays import Array
from .deck_materials import DeckMaterial

# Number of nodes of each kind of element that decks have, by the names of meshio.
SOLIDS = {
    "tetra": 4,
    "tetra10": 10,
    "hexahedron": 8,
    "hexahedron20": 20,
    "wedge": 6,
    "wedge15": 15,
    "pyramid": 5,
    "pyramid13": 13,
}
SURFACES = {"triangle": 3, "quad": 4, "triangle6": 6, "quad8": 8, "quad9": 9}
FACE_CORNERS = {"triangle": 3, "triangle6": 3, "quad": 4, "quad8": 4, "quad9": 4}

# Names of kinds in meshio, which continue with the number of nodes or the order.
_VOLUMES = (
    "tetra",
    "hexahedron",
    "wedge",
    "pyramid",
    "polyhedron",
    "VTK_LAGRANGE_T",
    "VTK_LAGRANGE_H",
    "VTK_LAGRANGE_W",
    "VTK_LAGRANGE_P",
)
_FACES = ("triangle", "quad", "polygon")


class Origins(NamedTuple):
    """Where elements, kind by kind, stand in a deck: their numbers, files and lines there, (ne,)."""

    labels: Array
    paths: Array
    lines: Array

    def subset(self, rows: Array) -> Origins:
        """Those of some rows."""
        return Origins(self.labels[rows], self.paths[rows], self.lines[rows])

    def said(self, row: int) -> str:
        """Name an element for messages."""
        return f"element {self.labels[row]} ({self.paths[row]}, line {self.lines[row]})"

    def all_said(self, rows: Array) -> str:
        """Name elements for messages."""
        return (" and " if len(rows) == 2 else ", ").join(map(self.said, rows))


class CellRegions(NamedTuple):
    """Regions of a mesh: what they are, their names, and the number of each element's region, (ne,) int.

    The number is -1 for an element of no region.
    """

    kind: str
    names: tuple[str | None, ...]
    number: Array

    @classmethod
    def single(cls, n: int) -> CellRegions:
        """Return the one region of n elements."""
        return cls("regions", ("",), np.zeros(n, dtype=np.int64))

    def subset(self, rows: Array) -> CellRegions:
        """Regions of some elements; those of no element that is left are left out."""
        used, number = np.unique(self.number[rows], return_inverse=True)
        outside = int(len(used) > 0 and used[0] < 0)
        return CellRegions(self.kind, tuple(self.names[i] for i in used[outside:]), number.ravel() - outside)


class Group(NamedTuple):
    """Volume elements that a file names: what kind of name it is, the name, and the elements' rows, (k,) int."""

    kind: str
    name: str
    rows: Array


class Link(NamedTuple):
    """Two surfaces that a deck ties or lets touch: "tie" or "contact", their names, and rows of their nodes."""

    kind: str
    names: tuple[str, str]
    nodes: tuple[Array, Array]


@dataclass(frozen=True, eq=False)
class FileMesh:
    """Points and elements of a mesh file as they stand there.

    Parameters
    ----------
    points : (n, 3) array
    cells : dict of str to (k, nodes) int array
        Rows of `points`, by the kind of element, with meshio's names and order of nodes.
    faces : dict of str to sequence of (k, 3) or (k, 4) int array
        Corner nodes of named faces.
    node_sets : dict of str to (k,) int array
        Rows of `points`.
    regions : sequence of CellRegions
        Of the solid elements, if they have several, or names that a user may give materials to.
    labels : (n,) int array or None
        Numbers of the nodes in the file, if it has some.
    materials : dict of str to DeckMaterial
        Of a deck, by the names of the regions; by "" if it has one for all.
    origins : Origins or None
        Of the volume elements, kind by kind as in `solids`; of a deck.
    either_hand : bool
        Whether each element may list its nodes in the order that mirrors it, as in Nastran.
    first_line : str
        File and line of the first elements; of a deck.
    groups : sequence of Group
        All names of volume elements, those of whole bodies first; rows are those of the elements kind by kind.
    links : sequence of Link
        Of a deck.
    """

    points: Array
    cells: dict[str, Array]
    faces: dict[str, list[Array]] = field(default_factory=dict)
    node_sets: dict[str, Array] = field(default_factory=dict)
    regions: Sequence[CellRegions] = ()
    labels: Array | None = None
    materials: dict[str, DeckMaterial] = field(default_factory=dict)
    origins: Origins | None = None
    either_hand: bool = False
    first_line: str = ""
    groups: Sequence[Group] = ()
    links: Sequence[Link] = ()

    @property
    def solids(self) -> dict[str, Array]:
        """Volume elements by kind."""
        return {kind: rows for kind, rows in self.cells.items() if len(rows) and kind.startswith(_VOLUMES)}

    @property
    def surfaces(self) -> dict[str, Array]:
        """Surface elements by kind."""
        return {kind: rows for kind, rows in self.cells.items() if len(rows) and kind.startswith(_FACES)}

    def alone(self, rows: Array) -> FileMesh:
        """The same file without volume elements other than those of some rows, ascending."""
        starts = np.cumsum([0, *map(len, self.solids.values())])
        solids = {
            kind: cells[rows[(rows >= start) & (rows < start + len(cells))] - start]
            for start, (kind, cells) in zip(starts[:-1], self.solids.items(), strict=True)
        }
        return replace(
            self,
            cells=self.cells | solids,
            regions=[regions.subset(rows) for regions in self.regions],
            origins=None if self.origins is None else self.origins.subset(rows),
            groups=(),
            links=(),
        )

    def said(self, row: int, kind: str, of_kind: int) -> str:
        """Name a volume element for messages: its row among all, and its kind and row there."""
        nodes = self.cells[kind][of_kind]
        if self.origins is None:
            return f"element {of_kind} (counted from 0), a {kind} of nodes {nodes.tolist()}"
        numbers = nodes if self.labels is None else self.labels[nodes]
        return f"{self.origins.said(row)}, a {kind} of nodes {numbers.tolist()}"


def with_groups(mesh: FileMesh, numbers: dict[str, Array]) -> FileMesh:
    """Mesh with groups of solid elements by numbers that these have, (ne,); those of materials are its regions.

    The number 0 is that of none.
    """
    groups = [
        Group(kind, str(number), np.flatnonzero(values == number))
        for kind, values in numbers.items()
        for number in np.unique(values)
        if number
    ]
    names, number = np.unique(numbers["material"], return_inverse=True)
    regions = [CellRegions("materials", tuple(map(str, names)), number.ravel())] if len(names) > 1 else []
    return replace(mesh, groups=[*mesh.groups, *groups], regions=regions)


def refuse_regions(source: object, kind: str, names: list[str]) -> None:
    """Raise `MeshError` that lists the regions of a body, each with the name that is its key in quotes."""
    listed = ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")
    raise MeshError(
        f"{source}: expected a body of one material, got {len(names)} regions by {kind}: {listed}. All would be "
        "made of the one material that is given. Give one for each, {name: Material}; if all is of one material, give "
        "all regions one name, solid.mat('steel') of an OCC shape; or export only the body that you need"
    )
