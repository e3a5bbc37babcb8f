"""Linear elastic isotropic materials."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import InputError
from ..support.checks import validate_number, validate_positive


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
    """

    E: float
    nu: float
    rho: float

    def __post_init__(self) -> None:
        expected = "a Poisson's ratio in (-1, 0.5)"
        object.__setattr__(self, "E", validate_positive("E", self.E, "Pa"))
        object.__setattr__(self, "rho", validate_positive("rho", self.rho, "kg/m3"))
        object.__setattr__(self, "nu", validate_number("nu", self.nu, expected))
        if not -1 < self.nu < 0.5:
            raise InputError(f"nu: expected {expected}, got {self.nu!r}")

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


STEEL = Material(E=210e9, nu=0.3, rho=7800.0)
ALUMINIUM = Material(E=70e9, nu=0.33, rho=2700.0)
