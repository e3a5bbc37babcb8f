"""Hertz's static contact at a point, circular or elliptic: approach, semi-axes and stored energy under a force.

Theory: examples/site/theory.md, "A contact that the mesh does not resolve".

References
----------
K.L. Johnson, Contact Mechanics, 1985, section 4.2.

P.J. Vermeulen, K.L. Johnson, Contact of nonspherical elastic bodies transmitting tangential forces, Journal of Applied
Mechanics 31 (1964) 338; H. Deresiewicz, Oblique contact of nonspherical elastic bodies, ibid. 24 (1957) 623.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from scipy.special import ellipe, ellipk

from ..errors import InputError
from ..fe.material import Material
from ..support.optional import require

_ROUND = 1e-6  # relative difference of curvatures up to which a contact is circular: the ellipse is 0 / 0 there
_NEARLY_ROUND = 1e-5  # the same for the ratio of the semi-axes, where shares of directions would be 0 / 0
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

        return float(require("scipy.optimize").brentq(excess, _LONGEST, 1 - _ROUND / 4, xtol=1e-14))

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

    @property
    def sphere(self) -> float:
        """Radius of the ball on a plane that yields as much under any force [m]."""
        return 9 / (16 * self.modulus**2 * self.yielding**3)

    def shear_moduli(self, materials: Sequence[Material]) -> tuple[float, float]:
        """Tangential stiffness by the normal one, times E*, along the major semi-axis and the minor one [Pa].

        Both stiffnesses are those of a contact whose ellipse stays as it is. In round contacts this is G*, with 4 / G*
        the sum of (2 - nu) / G. In elliptic ones, the tangential displacement under the traction of a sliding contact
        follows both curvatures as the normal one does, so that partial slip is that of round contacts with these
        moduli (Vermeulen and Johnson, Deresiewicz).

        Parameters
        ----------
        materials : sequence of Material
            Of the bodies that yield.
        """
        along, across = self._shares
        first, second = (
            2 / sum((1 - material.nu * share) / material.shear_modulus for material in materials)
            for share in (along, across)
        )
        return first, second

    @cached_property
    def _shares(self) -> tuple[float, float]:
        """Integrals of sin^2 and cos^2 over the directions of the ellipse, B and D, by their sum K."""
        if self.ratio > 1 - _NEARLY_ROUND:
            return 0.5, 0.5
        E, K = _elliptic(self.ratio)
        across = (1 - E / K) / (1 - self.ratio**2)
        return 1 - across, across

    def semi_axes(self, force: float) -> tuple[float, float]:
        """Semi-axes of the ellipse of contact under a force [N], the larger first [m]."""
        a, b = self._axes_of_unit
        return a * force ** (1 / 3), b * force ** (1 / 3)

    def mean_axis(self, force: float) -> float:
        """Mean semi-axis sqrt(a b) under a force [N]: [m]."""
        return math.sqrt(math.prod(self.semi_axes(force)))

    def force(self, radius: float) -> float:
        """Force under which the mean semi-axis, sqrt(a b), is a radius [m]: [N]."""
        a, b = self._axes_of_unit
        return (radius / math.sqrt(a * b)) ** 3


def _elliptic(ratio: float) -> tuple[float, float]:
    """Complete elliptic integrals E and K of an ellipse with this ratio of its semi-axes."""
    square = 1 - ratio**2
    return float(ellipe(square)), float(ellipk(square))
