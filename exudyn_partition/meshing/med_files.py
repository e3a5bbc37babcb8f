"""MED files of Salome and Code_Aster as meshio needs them: the mesh alone, with a family for every element."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np

_OF_MESHES = ("INFOS_GENERALES", "ENS_MAA", "FAS")  # fields and their profiles are beside these


def write_mesh_alone(path: Path, clean: Path) -> None:
    """Copy a MED file without its results, which meshio reads in some forms alone.

    Elements of a kind whose family is always 0 need not say so; here they do, as meshio expects.
    """
    h5py = importlib.import_module("h5py")
    with h5py.File(path) as given, h5py.File(clean, "w") as mesh:
        for name in _OF_MESHES:
            if name in given:
                given.copy(name, mesh)
        blocks: list[Any] = []
        mesh.visititems(lambda name, item: blocks.append(item) if "/MAI/" in name and "NOD" in item else None)
        if any("FAM" in block for block in blocks):
            for block in blocks:
                if "FAM" not in block:
                    block.create_dataset("FAM", data=np.zeros(block["NOD"].attrs["NBR"], dtype=np.int32))
