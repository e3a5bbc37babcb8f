"""Damping of a body's vibration: a ratio for each kept mode, or Rayleigh's proportional damping (paper, C_F of eq. 8d).

The damping force on a mode of circular frequency omega is 2 zeta omega times the velocity of its coordinate. Rigid
motion is not damped, because the force acts on the deformation only.

Theory: examples/site/theory.md, "Damping".
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from ..errors import InputError
from ..reduction.body import ReducedBody
from ..support.arrays import Array
from ..support.checks import validate_array, validate_number
from .kinematics import Kinematics


@dataclass(frozen=True)
class Rayleigh:
    """Damping D = alpha M + beta K of the deformation, with the ratio alpha / (2 omega) + beta omega / 2.

    Parameters
    ----------
    alpha : float
        Of the mass [1/s], >= 0.
    beta : float
        Of the stiffness [s], >= 0.

    Raises
    ------
    InputError
        If one is negative or not finite.
    """

    alpha: float = 0.0
    beta: float = 0.0

    def __post_init__(self) -> None:
        for name in ("alpha", "beta"):
            value = validate_number(name, getattr(self, name), "a finite number, zero or above")
            if value < 0:
                raise InputError(f"{name}: expected a finite number, zero or above, got {value}")
            object.__setattr__(self, name, value)


Ratios = float | Sequence[float] | Callable[[Array], Array] | Rayleigh
"""What `CreatePartitionBody` takes as `damping`."""


class Damping(Protocol):
    """Damping of one body in its frame."""

    def force(self, q_t: Array) -> Array:
        """Generalised forces against velocities q_t; both (..., n_dofs)."""

    def matrix(self) -> sp.csr_matrix:
        """(n_dofs, n_dofs) derivative of `force`."""

    def largest_rate(self, omega: float) -> float:
        """Upper bound of the eigenvalues of M^-1 D [1/s], for a body without frequencies above `omega` [rad/s]."""


class ModeDamping:
    """Damping of coordinates that are modes.

    Parameters
    ----------
    rates : (n_dofs,) array
        2 zeta omega of each coordinate [1/s], zero for rigid motion.
    """

    def __init__(self, rates: Array) -> None:
        self.rates = rates

    def force(self, q_t: Array) -> Array:
        """See `Damping.force`."""
        return self.rates * q_t

    def matrix(self) -> sp.csr_matrix:
        """See `Damping.matrix`."""
        return sp.diags(self.rates, format="csr")

    def largest_rate(self, omega: float) -> float:
        """See `Damping.largest_rate`."""
        return float(self.rates.max(initial=0.0))


class ProportionalDamping:
    """Rayleigh damping of a basis that keeps nodes; the coordinates of nodes are no modes."""

    def __init__(self, kinematics: Kinematics, rayleigh: Rayleigh) -> None:
        self._kinematics, self._rayleigh = kinematics, rayleigh

    def force(self, q_t: Array) -> Array:
        """See `Damping.force`."""
        return self._kinematics.proportional_force(q_t, self._rayleigh.alpha, self._rayleigh.beta)

    def matrix(self) -> sp.csr_matrix:
        """See `Damping.matrix`; of an inertial frame without the dense part that leaves rigid motion undamped."""
        return self._kinematics.proportional_matrix(self._rayleigh.alpha, self._rayleigh.beta)

    def largest_rate(self, omega: float) -> float:
        """See `Damping.largest_rate`."""
        return self._rayleigh.alpha + self._rayleigh.beta * omega**2


def damping_of(kinematics: Kinematics, damping: Ratios) -> Damping:
    """Damping of a body in its frame.

    Parameters
    ----------
    kinematics : Kinematics
    damping : float, (n_elastic,) sequence, callable or Rayleigh
        One ratio for all modes; one for each elastic mode, in order; a function that returns the ratios for
        frequencies (n_elastic,) [Hz]; or Rayleigh damping.

    Raises
    ------
    InputError
        If a ratio is negative or not finite, if there are more or fewer ratios than modes, or if the basis keeps nodes,
        which have no ratio.
    """
    body = kinematics.body
    if len(body.basis.nodal):
        if not isinstance(damping, Rayleigh):
            raise InputError(
                f"damping: basis {body.basis.name!r} keeps nodes, whose coordinates are no modes and have no ratio; "
                "expected ep.Rayleigh(alpha, beta)"
            )
        return ProportionalDamping(kinematics, damping)
    # Rigid shapes stand first in both frames.
    return ModeDamping(np.r_[np.zeros(6), _rates(body, damping)])


def _rates(body: ReducedBody, damping: Ratios) -> Array:
    """2 zeta omega, (n_elastic,) [1/s], of the elastic modes."""
    omega = body.basis.omega[6:]
    if isinstance(damping, Rayleigh):
        return damping.alpha + damping.beta * omega**2
    if callable(damping):
        ratios = validate_array("damping", damping(omega / (2 * np.pi)), (len(omega),))
    elif getattr(damping, "ndim", 0) or (isinstance(damping, Sequence) and not isinstance(damping, str)):
        ratios = validate_array("damping", damping, (len(omega),))
    else:
        ratios = np.full(len(omega), validate_number("damping", damping, "a ratio, zero or above"))
    if (ratios < 0).any():
        raise InputError(f"damping: expected ratios of zero or above, got {ratios.min():.6g}")
    return 2 * ratios * omega
