"""Isotropic materials: linear elastic, what is known of their yielding, and bodies of several."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..support.arrays import Array
from ..support.checks import check_floats, check_indices, read_only, validate_array, validate_number, validate_positive

# Densities of solids, 10 to 25e3 kg/m3, and speeds of waves in bars, 10 to 2e4 m/s, where lengths are in mm: in t, kg
# or g by mm3 with mm/s, and in kg or g by mm3 with mm/ms.
_MILLIMETRES = (((1e-11, 2.5e-2), (1e4, 2e7)), ((1e-8, 2.5e-2), (10.0, 2e4)))
_YIELD_STRAINS = 1e-6, 1.0  # yield stress by Young's modulus: less than soft crystals have, more than rubber


@dataclass(frozen=True)
class Material:
    """Isotropic material, linear elastic below its yield stress.

    Parameters
    ----------
    E : float
        Young's modulus [Pa].
    nu : float
        Poisson's ratio, in (-1, 0.5).
    rho : float
        Density [kg/m3].
    yield_stress : float, optional
        Stress at which a tensile specimen begins to deform for good [Pa]. Without `hardening` bodies stay elastic: the
        number only tells, after a run, whether a contact went beyond it. Default: not known, and nothing is told.
    hardening : float or sequence of (float, float), optional
        What the material does beyond: the slope of the true stress over the plastic strain [Pa], 0 for none; or that
        curve, pairs of plastic strain and flow stress [Pa] from (0, yield_stress) on, whose last slope goes on.
        Contact patches are plastic then, see `Partition.ball`. Default: elastic.
    kinematic_hardening : float
        Slope of the back stress over the plastic strain [Pa] (Prager): the part of the hardening that moves the yield
        surface, so that reversed loads yield earlier.
    """

    E: float
    nu: float
    rho: float
    yield_stress: float | None = None
    hardening: float | Sequence[tuple[float, float]] | None = None
    kinematic_hardening: float = 0.0

    def __post_init__(self) -> None:
        expected = "a Poisson's ratio in (-1, 0.5)"
        object.__setattr__(self, "E", validate_positive("E", self.E, "Pa"))
        object.__setattr__(self, "rho", validate_positive("rho", self.rho, "kg/m3"))
        object.__setattr__(self, "nu", validate_number("nu", self.nu, expected))
        if not -1 < self.nu < 0.5:
            raise InputError(f"nu: expected {expected}, got {self.nu!r}")
        if self.yield_stress is not None:
            object.__setattr__(self, "yield_stress", validate_positive("yield_stress", self.yield_stress, "Pa"))
            low, high = _YIELD_STRAINS
            if not low * self.E <= self.yield_stress <= high * self.E:
                raise InputError(
                    f"yield_stress: solids yield at {low:g} to {high:g} of Young's modulus, expected a number in the "
                    f"unit of E={self.E:.6g}, got {self.yield_stress:.6g}, {self.yield_stress / self.E:.2g} of it. Is "
                    "it in MPa, and E in Pa? 355 MPa are 355e6"
                )

        self._check_hardening()

    def _check_hardening(self) -> None:
        back = validate_number("kinematic_hardening", self.kinematic_hardening)
        if self.hardening is None:
            if back != 0:
                raise InputError("kinematic_hardening: needs hardening= too, 0 for none that is isotropic")
            return
        if self.yield_stress is None:
            raise InputError("hardening: begins at the yield stress; give yield_stress= too")
        curve: float | tuple[tuple[float, float], ...]
        if isinstance(self.hardening, Sequence | np.ndarray):
            points = validate_array("hardening", self.hardening, (None, 2))
            strain, stress = points.T
            if len(points) < 2 or strain[0] != 0 or not math.isclose(stress[0], self.yield_stress):
                raise InputError(
                    "hardening: expected at least two pairs of plastic strain and flow stress, the first (0, "
                    f"yield_stress) = (0, {self.yield_stress:.6g}), got {self.hardening!r}"
                )
            if not (np.diff(strain) > 0).all() or not (np.diff(stress) >= 0).all():
                raise InputError(
                    "hardening: expected plastic strains that grow and flow stresses that do not fall; where a "
                    f"material softens, results depend on the mesh. Got {self.hardening!r}"
                )
            curve, steepest = tuple((float(e), float(s)) for e, s in points), (np.diff(stress) / np.diff(strain)).max()
        else:
            expected = "a slope [Pa], or pairs of plastic strain and flow stress"
            curve = steepest = validate_number("hardening", self.hardening, expected)
        if steepest < 0 or back < 0 or max(steepest, back) > self.E:
            raise InputError(
                f"hardening: expected slopes from 0 to Young's modulus, {self.E:.6g} Pa, got "
                f"{self.hardening!r} and kinematic_hardening={back:.6g}. Are they in MPa, and E in Pa?"
            )
        object.__setattr__(self, "hardening", curve)
        object.__setattr__(self, "kinematic_hardening", back)

    @property
    def plastic(self) -> bool:
        """Whether its contact patches yield, and do not only tell that they would."""
        return self.hardening is not None

    @property
    def shear_modulus(self) -> float:
        """Lamé's second parameter mu = E / (2 (1 + nu)) [Pa]."""
        return self.E / (2 * (1 + self.nu))

    @property
    def lame(self) -> float:
        """Lamé's first parameter lambda = E nu / ((1 + nu) (1 - 2 nu)) [Pa]."""
        return self.E * self.nu / ((1 + self.nu) * (1 - 2 * self.nu))

    @property
    def plane_strain_modulus(self) -> float:
        """E / (1 - nu^2) [Pa], the modulus of Hertz contact."""
        return self.E / (1 - self.nu**2)

    @property
    def in_millimetres(self) -> bool:
        """Whether its numbers are those of a solid in mm, with t, kg or g and s, or with kg or g and ms."""
        speed = self.bar_wave_speed
        return any(low <= self.rho <= high and slow <= speed <= fast for (low, high), (slow, fast) in _MILLIMETRES)

    @property
    def bar_wave_speed(self) -> float:
        """Speed of longitudinal waves in a thin bar, sqrt(E / rho) [m/s]."""
        return float((self.E / self.rho) ** 0.5)

    @property
    def shear_wave_speed(self) -> float:
        """Speed of shear waves, sqrt(mu / rho) [m/s]."""
        return float((self.shear_modulus / self.rho) ** 0.5)


# Yield stresses are typical ones: grades differ more than any other constant. Structural steel S355 (EN 10025-2);
# hardened bearing steel has 2 GPa, mild steel 235 MPa. Aluminium 6061-T6 (EN 755-2); pure aluminium has 30 MPa, 7075-T6
# 500 MPa. Give your own by dataclasses.replace(STEEL, yield_stress=...); None asks for no judgement.
STEEL = Material(E=210e9, nu=0.3, rho=7800.0, yield_stress=355e6)
ALUMINIUM = Material(E=70e9, nu=0.33, rho=2700.0, yield_stress=240e6)


@dataclass(frozen=True, eq=False)
class Regions:
    """Materials of a body that consists of several, or whose modulus differs from place to place.

    Its constants have the names of `Material`'s, and one number an element.

    Parameters
    ----------
    names : tuple of str
    materials : tuple of Material
        One of each region.
    number : (ne,) int array
        Region of each element.
    E : (ne,) array
        Young's modulus of each element [Pa].
    """

    names: tuple[str, ...]
    materials: tuple[Material, ...]
    number: Array
    E: Array

    def __post_init__(self) -> None:
        check_indices("number", self.number, (None,), len(self.materials))
        check_floats("E", self.E, self.number.shape)
        if not (self.E > 0).all():
            raise InputError(f"modulus: expected positive numbers [Pa], got {self.E.min():.6g} in an element")
        read_only(self.number, self.E)

    def _each(self, name: str) -> Array:
        return np.array([getattr(material, name) for material in self.materials], dtype=float)[self.number]

    @property
    def nu(self) -> Array:
        """Poisson's ratio."""
        return self._each("nu")

    @property
    def rho(self) -> Array:
        """Density [kg/m3]."""
        return self._each("rho")

    @property
    def shear_modulus(self) -> Array:
        """Lamé's second parameter [Pa]."""
        shear: Array = self.E / (2 * (1 + self.nu))
        return shear

    @property
    def lame(self) -> Array:
        """Lamé's first parameter [Pa]."""
        lame: Array = self.E * self.nu / ((1 + self.nu) * (1 - 2 * self.nu))
        return lame

    @property
    def shear_wave_speed(self) -> Array:
        """Speed of shear waves [m/s]."""
        return np.sqrt(self.shear_modulus / self.rho)

    def largest(self, volume: Array) -> Material:
        """Return the material with the largest volume, by those of the elements, (ne,) [m3]; with its mean modulus."""
        most = int(np.bincount(self.number, volume).argmax())
        inside = self.number == most
        return replace(self.materials[most], E=_mean(self.E[inside], volume[inside]))

    def of_cells(self, cells: Array) -> Material:
        """Return the material of some elements, (k,) int: that of most, with their mean modulus.

        If they are of several materials, the lowest yield stress is kept.
        """
        most = int(np.bincount(self.number[cells]).argmax())
        material = replace(self.materials[most], E=_mean(self.E[cells], np.ones(len(cells))))
        known = [self.materials[i].yield_stress for i in np.unique(self.number[cells])]
        if len(known) == 1 or material.plastic:
            return material
        return replace(material, yield_stress=min((y for y in known if y is not None), default=None))

    def softest(self, cells: Array) -> tuple[tuple[Material, Array], ...]:
        """Material of each region with its lowest modulus, and the rows of `cells`, (k,) int, that lie there."""
        softest = []
        for i, material in enumerate(self.materials):
            rows = np.flatnonzero(self.number[cells] == i)
            if len(rows):
                softest.append((replace(material, E=float(self.E[cells[rows]].min())), rows))
        return tuple(softest)


def _mean(values: Array, weights: Array) -> float:
    """Mean by weights; of equal values, their value without rounding."""
    return float(values[0] + weights @ (values - values[0]) / weights.sum())
