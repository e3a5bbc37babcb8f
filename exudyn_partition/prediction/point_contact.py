"""Hertz's static contact at a point, circular or elliptic: approach, semi-axes and stored energy under a force.

Theory: examples/site/theory.md, "A contact that the mesh does not resolve".

References
----------
K.L. Johnson, Contact Mechanics, 1985, section 4.2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from ..errors import InputError

_ROUND = 1e-6  # relative difference of curvatures up to which a contact is circular: the ellipse is 0 / 0 there
_LONGEST = 1e-4  # smallest ratio of the semi-axes that is looked for


@dataclass(frozen=True)
class PointContact:
    """Two surfaces that touch at a point, each a half-space with curvatures.

    Parameters
    ----------
    curvatures : (float, float)
        Principal relative curvatures, the sums of those of both surfaces [1/m]; both above zero.
    modulus : float
        E* of both bodies [Pa].

    Raises
    ------
    InputError
        If the surfaces do not touch at a point.
    """

    curvatures: tuple[float, float]
    modulus: float

    def __post_init__(self) -> None:
        if not min(self.curvatures) > 0:
            raise InputError(
                f"curvatures: expected two above zero, of surfaces that touch at a point, got {self.curvatures} 1/m"
            )

    @cached_property
    def radius(self) -> float:
        """Effective radius, the inverse of the geometric mean of the curvatures [m]."""
        return 1 / math.sqrt(math.prod(self.curvatures))

    @property
    def circular(self) -> bool:
        """Whether both curvatures are equal."""
        small, large = sorted(self.curvatures)
        return large - small <= _ROUND * large

    @cached_property
    def ratio(self) -> float:
        """Minor semi-axis by the major one."""
        if self.circular:
            return 1.0
        small, large = sorted(self.curvatures)

        def excess(ratio: float) -> float:
            E, K = _elliptic(ratio)
            return math.log((E / ratio**2 - K) / (K - E) * small / large)

        return float(brentq(excess, _LONGEST, 1 - _ROUND / 4, xtol=1e-14))

    @cached_property
    def _axes_of_unit(self) -> tuple[float, float]:
        """Semi-axes under a force of 1 N [m], the larger first; they grow with the third root of the force."""
        circle = 3 * self.radius / (4 * self.modulus)
        ratio = self.ratio
        if ratio < 1.0:
            E, K = _elliptic(ratio)
            circle *= 4 / (math.pi * (1 - ratio**2)) * ratio**1.5 * math.sqrt((E / ratio**2 - K) * (K - E))
        mean = circle ** (1 / 3)
        return mean / math.sqrt(ratio), mean * math.sqrt(ratio)

    @cached_property
    def yielding(self) -> float:
        """Approach of the bodies under a force of 1 N, k [m/N^(2/3)]: the approach is k P^(2/3)."""
        a, _ = self._axes_of_unit
        K = math.pi / 2 if self.ratio == 1.0 else _elliptic(self.ratio)[1]
        return 3 / (2 * math.pi * a * self.modulus) * K

    def semi_axes(self, force: float) -> tuple[float, float]:
        """Semi-axes of the ellipse of contact under a force [N], the larger first [m]."""
        a, b = self._axes_of_unit
        return a * force ** (1 / 3), b * force ** (1 / 3)

    def force(self, radius: float) -> float:
        """Force under which the mean semi-axis, sqrt(a b), is a radius [m]: [N]."""
        a, b = self._axes_of_unit
        return (radius / math.sqrt(a * b)) ** 3


def _elliptic(ratio: float) -> tuple[float, float]:
    """Complete elliptic integrals E and K of an ellipse with this ratio of its semi-axes."""
    square = 1 - ratio**2
    return float(ellipe(square)), float(ellipk(square))
