"""Regions of the meshes that meshio reads, by the numbers that it keeps for each element."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ..support.arrays import Array
from ..support.foreign import MeshioMesh
from .file_mesh import CellRegions, Group

# Names that programs give to the numbers of an element's region or material.
_REGION = re.compile(r"physical|mat|region|domain|propert|:ref$|:tag$|cell_tags|body|part_?id|group", re.IGNORECASE)


_KINDS = {"Gmsh's physical groups": "physical group", "Gmsh's volumes": "volume", "cell_tags": "family"}


def regions_of(mesh: MeshioMesh) -> Iterator[CellRegions]:
    """Regions of volume elements by each of their numbers that tells of more than one.

    They are physical groups of Gmsh, or its volumes if there are no groups, and data named like a material or region.
    """
    volumes = _volumes(mesh)
    data = {name: _values(blocks, volumes) for name, blocks in mesh.cell_data.items() if _REGION.search(name)}
    names = {int(tag): name for name, (tag, dimension) in _groups(mesh).items() if dimension == 3}
    families = {number: groups[0] for number, groups in tags_of_cells(mesh).items() if len(groups) == 1}
    physical = data.pop("gmsh:physical", np.zeros(0))
    data["Gmsh's physical groups"] = physical
    if not physical.any() and "gmsh:geometrical" in mesh.cell_data:
        names = {}
        data["Gmsh's volumes"] = _values(mesh.cell_data["gmsh:geometrical"], volumes)
    for name, values in data.items():
        tags, number = np.unique(values, return_inverse=True)
        if len(tags) > 1:
            called = names if name.startswith("Gmsh") else families if name == "cell_tags" else {}
            yield CellRegions(name, tuple(called.get(int(i), str(int(i))) for i in tags), number)


def groups_of(mesh: MeshioMesh, regions: Sequence[CellRegions]) -> Iterator[Group]:
    """Names of volume elements: sets, groups of MED, and each region of `regions_of`."""
    volumes = _volumes(mesh)
    for name, members in mesh.cell_sets.items():
        if not name.startswith("gmsh:"):
            starts = np.cumsum([0, *(len(mesh.cells[i]) for i in volumes)])
            rows = [start + np.asarray(members[i], dtype=np.int64) for start, i in zip(starts, volumes, strict=False)]
            yield Group("set", name, np.sort(np.concatenate([np.zeros(0, dtype=np.int64), *rows])))
    families = _values(mesh.cell_data.get("cell_tags", ()), volumes)
    for name in names_of_families(tags_of_cells(mesh)):
        yield Group("group", name, np.flatnonzero(np.isin(families, families_of(tags_of_cells(mesh), name))))
    for region in regions:
        kind = _KINDS.get(region.kind, region.kind)
        for i, text in enumerate(region.names):
            if text != "0":  # elements of no group
                yield Group(kind, str(text), np.flatnonzero(region.number == i))


def tags_of_cells(mesh: MeshioMesh) -> Mapping[int, Sequence[str]]:
    """Groups of each family of elements in a MED file; none of other formats."""
    return getattr(mesh, "cell_tags", {})


def families_of(tags: Mapping[int, Sequence[str]], name: str) -> list[int]:
    """Numbers of the families of MED that are in a group; `tags` has the groups of each family."""
    return [int(number) for number, groups in tags.items() if name in groups]


def names_of_families(tags: Mapping[int, Sequence[str]]) -> list[str]:
    """Names of all groups of MED."""
    return list(dict.fromkeys(name for groups in tags.values() for name in groups))


def _volumes(mesh: MeshioMesh) -> list[int]:
    """Numbers of the blocks of volume elements, kind by kind, as these are taken."""
    volumes = [i for i, block in enumerate(mesh.cells) if block.dim == 3 and len(block)]
    kinds = list(dict.fromkeys(mesh.cells[i].type for i in volumes))
    return sorted(volumes, key=lambda i: kinds.index(mesh.cells[i].type))


def _groups(mesh: MeshioMesh) -> dict[str, tuple[int, int]]:
    """Tag and dimension of Gmsh's named groups; entries of other formats are left out."""
    return {name: tuple(value) for name, value in mesh.field_data.items() if np.shape(value) == (2,)}


def _values(blocks: Sequence[object], volumes: list[int]) -> Array:
    """Whole numbers of the volume elements; empty if the data are others, such as results of an analysis."""
    parts = [np.asarray(blocks[i]) for i in volumes if i < len(blocks)]
    values = np.concatenate(parts) if parts and all(part.ndim == 1 for part in parts) else np.zeros(0)
    numeric = np.issubdtype(values.dtype, np.number)
    return values if numeric and np.isfinite(values).all() and (values == np.rint(values)).all() else np.zeros(0)
