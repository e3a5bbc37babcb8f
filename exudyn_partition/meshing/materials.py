"""Which element of a mesh is of which material."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..fe.material import Material, Regions
from ..support.arrays import Array
from ..support.checks import answer_of, validate_array, validate_callable
from .file_mesh import CellRegions, refuse_regions

Modulus = Callable[[Array], Array]  # Young's modulus by place, (k, 3) [m] -> (k,) [Pa]

_TASK = "places, (k, 3) [m], that returns (k,) [Pa]"
_UNNAMED = (None, "", "default")  # names of regions that nobody has named


@dataclass(frozen=True)
class GivenMaterial:
    """The material, or one for each region, and the modulus by place, as the user gives them.

    Parameters
    ----------
    material : Material or dict of str to Material
    modulus : callable or None
        See `fe_model`.

    Raises
    ------
    InputError
        If they are no such things.
    """

    material: Material | Mapping[str, Material]
    modulus: Modulus | None = None

    def __post_init__(self) -> None:
        several = isinstance(self.material, Mapping)
        for material in self.material.values() if isinstance(self.material, Mapping) else (self.material,):
            if not isinstance(material, Material):
                expected = (
                    "one ep.Material for each name of a region" if several else "an ep.Material, such as ep.STEEL"
                )
                raise InputError(f"material: expected {expected}, got {type(material).__name__}")
        if several and not self.material:
            raise InputError("material: expected at least one {name: Material}, got an empty dict")
        if self.modulus is not None:
            validate_callable("modulus", self.modulus, f"a function of {_TASK}")

    @property
    def several(self) -> bool:
        """Whether each region has its own."""
        return isinstance(self.material, Mapping)

    def check(self, source: str, kind: str, names: Sequence[str | None]) -> None:
        """Raise unless there is a material for each region.

        Parameters
        ----------
        source : str
            For messages.
        kind : str
            What the regions are.
        names : sequence of str or None
            Of all regions.

        Raises
        ------
        MeshError
            If one material is given, and regions have different names, or several have none.
        InputError
            If a dict lacks a region's name or has another one.
        """
        if isinstance(self.material, Material):
            if len(names) > 1 and (len(set(names)) > 1 or names[0] in _UNNAMED):
                listed = [f"{i}: {'without name' if name in _UNNAMED else repr(name)}" for i, name in enumerate(names)]
                refuse_regions(source, kind, listed)
        elif set(names) != set(self.material):
            raise InputError(
                f"material: expected one for each region of {source}, {_listed(names)}, got "
                f"{_listed(self.material)}. Name the solids of an OCC shape by solid.mat('name')"
            )

    def on(self, source: str, regions: CellRegions, centres: Array) -> Material | Regions:
        """Material of a mesh's elements.

        Parameters
        ----------
        source : str
            For messages.
        regions : CellRegions
        centres : (ne, 3) array
            Of the elements [m].

        Raises
        ------
        MeshError, InputError
            As `check`; or if the modulus is no positive number somewhere.
        """
        names, number = regions.names, regions.number
        self.check(source, regions.kind, names if not self.several else [names[i] for i in np.unique(number)])
        if isinstance(self.material, Material):
            if self.modulus is None:
                return self.material
            return Regions(("",), (self.material,), np.zeros(len(number), dtype=np.int64), self._moduli(centres))
        keys = list(self.material)
        key_of_element = np.array([keys.index(name) if name in keys else -1 for name in names])[number]
        materials = tuple(self.material.values())
        moduli = (
            np.array([material.E for material in materials])[key_of_element]
            if self.modulus is None
            else self._moduli(centres)
        )
        return Regions(tuple(keys), materials, key_of_element, moduli)

    def _moduli(self, centres: Array) -> Array:
        assert self.modulus is not None
        return validate_array("modulus", answer_of("modulus", self.modulus, centres, _TASK), (len(centres),))


def _listed(names: Sequence[str | None] | Mapping[str, Material]) -> str:
    return ", ".join("one without name" if name in _UNNAMED else repr(name) for name in dict.fromkeys(names))
