"""Damping of a body's vibration: a ratio for each mode, or Rayleigh's proportional damping (paper, C_F of eq. 8d).

The modes are those of the body as joints of the model hold it. The damping force on a mode of circular frequency omega
is 2 zeta omega times its velocity, for unit modal mass. Rigid motion is not damped, because the force acts on the
deformation only. So it has no resultant and no moment.

Theory: examples/site/theory.md, "Damping".
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from ..errors import InputError
from ..support.arrays import Array
from ..support.checks import answer_of, validate_array, validate_number
from .kinematics import Kinematics, Rows

_TASK = "frequencies, (n,) [Hz], that returns a ratio for each, (n,)"
_STILL = 1e-12  # squared frequency of a deformation that joints prevent, as a share of the largest: round-off


@dataclass(frozen=True)
class Rayleigh:
    """Damping alpha M + beta K of the modes, with the ratio alpha / (2 omega) + beta omega / 2.

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


class Damping(Hashable, Protocol):
    """Damping of one body in its frame."""

    @property
    def beta(self) -> float:
        """That of stiffness-proportional damping [s], zero for other damping. A static answer yields with it, too."""

    def force(self, q_t: Array) -> Array:
        """Generalised forces against velocities q_t; both (..., n_dofs)."""

    def matrix(self) -> sp.csr_matrix:
        """(n_dofs, n_dofs) derivative of `force`."""

    def largest_rate(self, omega: float) -> float:
        """Upper bound of the eigenvalues of M^-1 D [1/s], for a body without frequencies above `omega` [rad/s]."""


@dataclass(frozen=True, eq=False)
class ModeDamping:
    """Damping of modes, D = rows' diag(rates) rows.

    Parameters
    ----------
    omega : (k,) array
        Circular frequencies of the modes [rad/s].
    rates : (k,) array
        2 zeta omega of each [1/s].
    rows : (k, n_dofs) array or csr matrix
        Velocities of the modes, which have unit mass, by those of the coordinates; zero for rigid motion.
    fastest : float, optional
        Largest eigenvalue of M^-1 D where joints hold the body [1/s]. Default: the largest rate.
    beta : float
        See `Damping`.
    """

    omega: Array
    rates: Array
    rows: Rows
    fastest: float | None = None
    beta: float = 0.0

    def power(self, q_t: Array) -> Array:
        """Power that the damping of each mode takes [W], (..., k), at velocities q_t, (..., n_dofs)."""
        power: Array = self.rates * self._of_modes(q_t) ** 2
        return power

    def force(self, q_t: Array) -> Array:
        """See `Damping.force`."""
        return np.asarray((self.rows.T @ (self.rates * self._of_modes(q_t)).T).T)

    def matrix(self) -> sp.csr_matrix:
        """See `Damping.matrix`."""
        return sp.csr_matrix(self.rows.T @ sp.diags(self.rates) @ self.rows)

    def largest_rate(self, omega: float) -> float:
        """See `Damping.largest_rate`."""
        return float(self.rates.max(initial=0.0)) if self.fastest is None else self.fastest

    def _of_modes(self, q_t: Array) -> Array:
        return np.asarray((self.rows @ q_t.T).T)


class ProportionalDamping:
    """Rayleigh damping of a basis that keeps nodes; the coordinates of nodes are no modes."""

    def __init__(self, kinematics: Kinematics, rayleigh: Rayleigh) -> None:
        self._kinematics, self._rayleigh, self.beta = kinematics, rayleigh, rayleigh.beta

    def force(self, q_t: Array) -> Array:
        """See `Damping.force`."""
        return self._kinematics.proportional_force(q_t, self._rayleigh.alpha, self._rayleigh.beta)

    def matrix(self) -> sp.csr_matrix:
        """See `Damping.matrix`; of an inertial frame without the dense part that leaves rigid motion undamped."""
        return self._kinematics.proportional_matrix(self._rayleigh.alpha, self._rayleigh.beta)

    def largest_rate(self, omega: float) -> float:
        """See `Damping.largest_rate`."""
        return self._rayleigh.alpha + self._rayleigh.beta * omega**2


def damping_of(kinematics: Kinematics, damping: Ratios, mobility: Array | None = None) -> Damping:
    """Damping of a body in its frame.

    Let a be the velocities of the free body's modes with frequencies W, and V their mobility with closed joints. The
    modes of the held body are the eigenvectors u of A = W V W, with their squared frequencies. They are strains
    W a / omega of unit energy, and D = W f(A) W, with f the rate of a mode over its squared frequency. So each mode has
    its rate, and D has no part in rigid motion. Joints prevent the strains in the null space of A. These have the
    frequencies that the static answers to such motions of interfaces have with the body's own mass.

    Parameters
    ----------
    kinematics : Kinematics
    damping : float, (n_elastic,) sequence, callable or Rayleigh
        One ratio for all modes; one for each elastic mode, in order; a function that returns the ratios for
        frequencies (n_elastic,) [Hz]; or Rayleigh damping. Deformations that joints prevent come last.
    mobility : (n_dofs, n_dofs) array, optional
        Velocities of the coordinates by unit impulses on them, with what holds the body. Default: a free body.

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
        if mobility is None or not damping.alpha:  # that of the stiffness is the same for all modes
            return ProportionalDamping(kinematics, damping)
    omega, rows = _free_modes(kinematics)
    if mobility is not None:
        omega, rows = _held_modes(omega, rows, mobility)
    beta = damping.beta if isinstance(damping, Rayleigh) else 0.0
    return ModeDamping(omega, _rates(omega, damping), rows, beta=beta)


def _free_modes(kinematics: Kinematics) -> tuple[Array, Rows]:
    """Frequencies of the free body's elastic modes, (k,), and their velocities by the coordinates', (k, n_dofs)."""
    basis, n = kinematics.body.basis, kinematics.body.n_dofs
    if not len(basis.nodal):  # rigid shapes stand first in both frames
        return basis.omega[6:], sp.eye(n, format="csr")[6:]
    root = np.sqrt(kinematics.mass)
    stiffness = kinematics.proportional_matrix(0.0, 1.0).toarray()
    squares, shapes = np.linalg.eigh(stiffness / root / root[:, None])
    return np.sqrt(squares[6:]), shapes[:, 6:].T * root


def _held_modes(omega: Array, rows: Rows, mobility: Array) -> tuple[Array, Array]:
    """Frequencies and rows, as of `_free_modes`, of the held body, and of the deformations that joints prevent."""
    strains = sp.diags(omega) @ rows
    squares, shapes = np.linalg.eigh(np.asarray(strains @ np.asarray(strains @ mobility).T))
    still = np.count_nonzero(squares <= _STILL * squares.max(initial=0.0))
    kept, prevented = shapes[:, still:], shapes[:, :still]
    slowness, turn = np.linalg.eigh(prevented.T @ (prevented / omega[:, None] ** 2))
    omega = np.sqrt(np.r_[squares[still:], 1 / slowness[::-1]])
    shapes = np.hstack([kept, prevented @ turn[:, ::-1]])
    return omega, np.asarray((shapes / omega).T @ strains)


def _rates(omega: Array, damping: Ratios) -> Array:
    """2 zeta omega, (k,) [1/s], of modes with frequencies omega, (k,) [rad/s]."""
    if isinstance(damping, Rayleigh):
        return damping.alpha + damping.beta * omega**2
    if callable(damping):
        ratios = validate_array("damping", answer_of("damping", damping, omega / (2 * np.pi), _TASK), (len(omega),))
    elif getattr(damping, "ndim", 0) or (isinstance(damping, Sequence) and not isinstance(damping, str)):
        ratios = validate_array("damping", damping, (len(omega),))
    else:
        ratios = np.full(len(omega), validate_number("damping", damping, "a ratio, zero or above"))
    if (ratios < 0).any():
        raise InputError(f"damping: expected ratios of zero or above, got {ratios.min():.6g}")
    return 2 * ratios * omega
