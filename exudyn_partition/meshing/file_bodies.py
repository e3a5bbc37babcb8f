"""The bodies of a mesh file by their names, and which of them it ties together or lets touch."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import InputError, MeshError
from ..fe.elements import BY_NAME, faces_of, rows_of_cells
from ..fe.facets import area_vectors, facet_corners, parts_of
from ..fe.facing import Side, facing_facets
from ..fe.patch_facets import show
from ..support.arrays import Array
from ..support.checks import validate_path, validate_positive, validate_text, validate_type
from .file_mesh import FileMesh

_LOG = logging.getLogger(__name__)

_TOUCH = 0.1  # of the length of their facets' edges, within which bodies touch
_LISTED = 8  # names in a message
_LINES = 100  # bodies that are printed


class BodyPair(NamedTuple):
    """Two bodies that a deck connects, or that touch.

    Parameters
    ----------
    kind : {"tie", "contact", "touch"}
        The first two as a deck has them; the last one by geometry alone, where a deck says nothing.
    bodies : (str, str)
        Names of the bodies.
    surfaces : (str, str)
        Names of the surfaces in the deck, which are boundaries of the FE models; blank for bodies that touch.
    """

    kind: str
    bodies: tuple[str, str]
    surfaces: tuple[str, str] = ("", "")

    def __str__(self) -> str:
        first, second = (
            f"{body} by {surface}" if surface else body
            for body, surface in zip(self.bodies, self.surfaces, strict=True)
        )
        return f"{self.kind}: {first} and {second}"


@dataclass(frozen=True, eq=False)
class FileBodies:
    """The bodies of a mesh file, each where it stands; `ep.read_bodies` returns it.

    A body is a connected piece of volume elements. It has the name of the instance, part, set, material or group of
    just its elements, if the file has one. `ep.fe_model(bodies, ..., solid="rod")` makes a model of one body, or of any
    elements that have a name; `ep.fe_models` makes those of several. `print` lists all names.

    Parameters
    ----------
    path : Path
        The file.
    file : FileMesh
        What it holds.
    scale : float
        Factor on all lengths.
    """

    path: Path
    file: FileMesh = field(repr=False)
    scale: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "path", validate_path("path", self.path))
        validate_type("file", self.file, FileMesh, "ep.read_bodies()")
        object.__setattr__(self, "scale", validate_positive("scale", self.scale))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the bodies."""
        return tuple(self.pieces)

    @property
    def other_names(self) -> tuple[str, ...]:
        """Other names that choose elements of one body or several, such as those of materials."""
        return tuple(dict.fromkeys(group.name for group in self.file.groups if group.name not in self.pieces))

    @cached_property
    def pairs(self) -> tuple[BodyPair, ...]:
        """Bodies that the deck ties or lets touch; and those that touch by geometry, of which it says nothing."""
        nodes = {name: np.unique(self._corners[0][rows]) for name, rows in self.pieces.items()}
        pairs: dict[BodyPair, None] = {}
        for link in self.file.links:
            first, second = (
                [name for name, of_body in nodes.items() if np.isin(of_body, on).any()] for on in link.nodes
            )
            pairs |= {BodyPair(link.kind, (a, b), link.names): None for a in first for b in second}
        known = {frozenset(pair.bodies) for pair in pairs}
        for touching in self._touching():
            if frozenset(touching) not in known:
                pairs[BodyPair("touch", touching)] = None
        return tuple(pairs)

    def rows(self, name: str) -> Array:
        """Rows of the volume elements of a name, (k,) int, ascending; capitals matter only if they must.

        Where a material and a property have the same name, that of the first alone is "material 3".

        Raises
        ------
        InputError
            If there are none of this name, or several that differ in capitals.
        """
        known = dict(self.pieces)
        for group in self.file.groups:
            known.setdefault(group.name, group.rows)
            known.setdefault(f"{group.kind} {group.name}", group.rows)
        if validate_text("solid", name) in known:
            return known[name]
        same = [key for key in known if key.upper() == name.upper()]
        if len(same) == 1:
            return known[same[0]]
        beside = f"; or of {listed_names(self.other_names)}" if self.other_names else ""
        raise InputError(f"solid: expected one of {listed_names(self.names)}{beside} in {self.path}, got {name!r}")

    @cached_property
    def _corners(self) -> tuple[Array, bool]:
        """Corners of all elements as those of one kind, (ne, 4) or (ne, 8), and whether these are hexahedra."""
        kinds = [(BY_NAME[name], cells) for name, cells in self.file.solids.items()]
        return rows_of_cells([(kind.name.rstrip("0123456789"), cells[:, : kind.corners]) for kind, cells in kinds])

    @cached_property
    def _faces(self) -> tuple[Array, Array]:
        return faces_of(*self._corners)

    @cached_property
    def _part(self) -> Array:
        """Number of each element's connected piece, (ne,)."""
        return parts_of(self._faces[1])

    @cached_property
    def pieces(self) -> dict[str, Array]:
        """Rows of the elements, (k,) int, of each connected piece, by its name."""
        sizes = np.bincount(self._part)
        names: list[str] = [""] * len(sizes)
        within: list[str] = [""] * len(sizes)  # of the smallest group around each piece
        for group in sorted(self.file.groups, key=lambda group: len(group.rows)):
            count = np.bincount(self._part[group.rows], minlength=len(sizes))
            whole = np.flatnonzero(count == sizes)
            if len(whole) == 1 and len(group.rows) == sizes[whole[0]]:
                names[whole[0]] = names[whole[0]] or group.name
            for piece in whole:
                within[piece] = within[piece] or group.name
        pieces: dict[str, Array] = {}
        by_part = np.split(np.argsort(self._part, kind="stable"), np.cumsum(sizes)[:-1])
        count_within: dict[str, int] = {}
        for name, around, rows in zip(names, within, by_part, strict=True):
            if not name or name in pieces:
                around = name or around or ("body" if len(sizes) > 1 else "")
                count_within[around] = number = count_within.get(around, 1 if name in pieces else 0) + 1
                name = f"{around}.{number}" if around else "body"
            pieces[name] = rows
        return pieces

    def _touching(self) -> list[tuple[str, str]]:
        """Names of bodies whose surfaces face each other nearby."""
        faces, number = self._faces
        flat = number.ravel()
        outer = np.flatnonzero((np.bincount(flat[flat >= 0])[flat] == 1) & (flat >= 0))
        element = outer // number.shape[1]
        points = np.asarray(self.file.points, dtype=float)
        corners = points[facet_corners(faces[outer])]
        inside = points[self._corners[0][element]].mean(axis=1)
        # Elements may list their nodes in either order.
        outward = np.sign(np.einsum("fi,fi->f", area_vectors(points, faces[outer]), corners.mean(axis=1) - inside))
        order = np.argsort(self._part[element], kind="stable")
        sides = []
        for of_body in np.split(order, np.cumsum(np.bincount(self._part[element]))[:-1]):
            side = Side.of(points, faces[outer[of_body]])
            sides.append(side._replace(normals=outward[of_body, None] * side.normals))
        length = float(np.median(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)))
        names = self.names
        near = facing_facets(sides, _TOUCH * length)
        return [(names[j], names[i]) for i, others in enumerate(near) for j in sorted(others) if j < i]

    def __str__(self) -> str:
        count = len(self.names)
        lines = [f"{self.path}: {count} {'body' if count == 1 else 'bodies'}"]
        for name, rows in [*self.pieces.items()][:_LINES]:
            places = self.scale * self.file.points[np.unique(self._corners[0][rows])]
            low, high = places.min(axis=0), places.max(axis=0)
            size = " x ".join(f"{x:.4g}" for x in high - low)
            lines.append(f"  {name}: {len(rows)} elements, {size} m around {show((low + high) / 2)} m")
        if count > _LINES:
            lines.append(f"  and {count - _LINES} more")
        said = [f"{group.kind} {group.name}" for group in self.file.groups if group.name not in self.pieces]
        if said:
            lines.append(f"  other names of elements: {', '.join(dict.fromkeys(said))}")
        lines += [f"  {pair}" for pair in self.pairs]
        return "\n".join(lines)


def listed_names(names: Sequence[str]) -> str:
    """Names in quotes for a message, the first ones if there are many."""
    return ", ".join(map(repr, names[:_LISTED])) + (", ..." if len(names) > _LISTED else "")


def elements_named(bodies: FileBodies, name: str | None) -> FileMesh:
    """Mesh of the elements of a name; of all, if it is None."""
    return bodies.file if name is None else bodies.file.alone(bodies.rows(name))


def check_one_body(bodies: FileBodies, name: str | None) -> None:
    """Raise MeshError that names the bodies, if the elements of a name, or all, are of several."""
    owner = _owner(bodies)
    rows = np.arange(len(owner)) if name is None else bodies.rows(name)
    parts, first, sizes = np.unique(owner[rows], return_index=True, return_counts=True)
    if len(parts) < 2:
        return
    names = [bodies.names[part] for part in parts]
    largest = np.argsort(-sizes, kind="stable")[:5]
    more = ", ..." if len(parts) > 5 else ""
    origins = bodies.file.origins
    begin = f", which begin with {origins.all_said(rows[first[largest]])}{more}" if origins else ""
    raise MeshError(
        f"{bodies.path}{f', {name!r}' if name else ''}: expected one connected body, got {len(parts)} parts that "
        f"share no face, of {', '.join(map(str, sizes[largest]))}{more} elements{begin}. Merge coincident nodes "
        f"where they touch; or choose one by solid=, of {listed_names(names)}. ep.read_bodies lists them, and "
        "ep.fe_models makes a model of each"
    )


def check_apart(bodies: FileBodies, names: Sequence[str]) -> None:
    """Raise InputError if an element has two of some names; the log tells of elements that have none."""
    owner = np.full(len(_owner(bodies)), -1)
    for number, name in enumerate(names):
        rows = bodies.rows(name)
        taken = owner[rows][owner[rows] >= 0]
        if len(taken):
            raise InputError(
                f"materials: {len(taken)} elements are of {names[taken[0]]!r} and of {name!r}, whose mass would "
                "count twice. Give bodies that have no element in common"
            )
        owner[rows] = number
    beside = [name for name, rows in bodies.pieces.items() if (owner[rows] < 0).all()]
    if beside:
        _LOG.info("%s: left out the bodies %s", bodies.path, ", ".join(beside))


def _owner(bodies: FileBodies) -> Array:
    """Number of each element's body, (ne,)."""
    owner = np.empty(sum(map(len, bodies.pieces.values())), dtype=np.int64)
    for number, rows in enumerate(bodies.pieces.values()):
        owner[rows] = number
    return owner
