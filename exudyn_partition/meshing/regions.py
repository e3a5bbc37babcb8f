"""Regions of the meshes that meshio reads, by the numbers that it keeps for each element."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import numpy as np

from ..support.arrays import Array
from ..support.foreign import MeshioMesh
from .file_mesh import CellRegions

# Names that programs give to the numbers of an element's region or material.
_REGION = re.compile(r"physical|mat|region|domain|propert|:ref$|:tag$|cell_tags|body|part_?id|group", re.IGNORECASE)


def regions_of(mesh: MeshioMesh) -> Iterator[CellRegions]:
    """Regions of volume elements by each of their numbers that tells of more than one.

    They are physical groups of Gmsh, or its volumes if there are no groups, and data named like a material or region.
    """
    volumes = [i for i, block in enumerate(mesh.cells) if block.dim == 3 and len(block)]
    kinds = list(dict.fromkeys(mesh.cells[i].type for i in volumes))
    volumes.sort(key=lambda i: kinds.index(mesh.cells[i].type))  # the elements are taken kind by kind
    data = {name: _values(blocks, volumes) for name, blocks in mesh.cell_data.items() if _REGION.search(name)}
    names = {int(tag): name for name, (tag, dimension) in _groups(mesh).items() if dimension == 3}
    physical = data.pop("gmsh:physical", np.zeros(0))
    data["Gmsh's physical groups"] = physical
    if not physical.any() and "gmsh:geometrical" in mesh.cell_data:
        names = {}
        data["Gmsh's volumes"] = _values(mesh.cell_data["gmsh:geometrical"], volumes)
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
