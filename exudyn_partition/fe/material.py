"""Linear elastic isotropic materials."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..errors import InputError
from ..support.checks import validate_number, validate_positive

_YIELD_STRAINS = 1e-6, 1.0  # yield stress by Young's modulus: less than soft crystals have, more than rubber


@dataclass(frozen=True)
class Material:
    """Linear elastic isotropic material.

    Parameters
    ----------
    E : float
        Young's modulus [Pa].
    nu : float
        Poisson's ratio, in (-1, 0.5).
    rho : float
        Density [kg/m3].
    yield_stress : float, optional
        Stress at which a tensile specimen begins to deform for good [Pa]. Bodies stay elastic: the number only tells,
        after a run, whether a contact went beyond it. Default: not known, and nothing is told.
    """

    E: float
    nu: float
    rho: float
    yield_stress: float | None = field(default=None, metadata={"added": True})

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
