"""Error of velocities in implicit steps of lasting contact, and the steps that it allows.

A trapezoidal step s with accelerations a at its start and a' at its end misplaces the bodies by s^2 / 12 (a' - a)
(Zienkiewicz and Xie 1991). Divided by the step, this is a velocity. Its norm in the mass is compared with the largest
change of velocities so far. A mode of circular frequency w has errors of (w s)^2 / 12 of its share of the velocity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..support.arrays import Array

TOLERANCE = 1e-3  # share of velocities; at ten times as much, contacts that chatter never come to rest
_FADING = 0.9  # of the error from one step to the next: the error of a vibration has two zeros in each period
_GROWTH, _STRIDE = 1.5, 1.6  # from one step to the next, if a step longer by the second factor is allowed
_REFUSED = 2.0  # tolerances: errors above are not accepted
_SHORTEST = 0.25  # of a step that is not accepted
# Share of the energy stored at present that errors are compared with at least, for bodies at rest: that of a vibration
# by a tenth of the forces that contacts carry. Newton's method leaves some 1e-5 of these forces where friction holds.
_STORED = 1e-2


class BodyMotion(NamedTuple):
    """Velocities and accelerations of all bodies at a time.

    Parameters
    ----------
    q_t, q_tt : (n,) arrays
        Of all bodies' coordinates, one body after the other.
    """

    q_t: Array
    q_tt: Array


class Judgement(NamedTuple):
    """The end of a step.

    Parameters
    ----------
    now : BodyMotion
    squares : (nb,) array
        Twice the kinetic energy of each body's largest change of velocity until then [J].
    error : float
        Error of the step.
    """

    now: BodyMotion
    squares: Array
    error: float


@dataclass(frozen=True, eq=False)
class VelocityError:
    """Error of velocities in the steps so far: a value from which the next step follows.

    Errors are shares of the largest changes of velocity since the start. So neither a common velocity nor constant spin
    makes errors look small. The error of a body compares with the geometric mean of its own energy in these changes and
    that of all bodies. So a heavy body hardly hides the errors of a light one.

    Parameters
    ----------
    tolerance : float
        Error that a step may have.
    mass : (n,) array
        Diagonal mass of all bodies' coordinates.
    firsts : (nb,) int array
        Number of each body's first coordinate.
    start : (n,) array
        Velocities at the start of the run.
    stored : float
        Energy that bodies and contacts store [J]. Errors of bodies at rest are compared with a small share of it.
    squares : (nb,) array
        Twice the kinetic energy of each body's largest change of velocity so far [J].
    before : (n,) array
        Accelerations at the end of the last step.
    rate : float
        Error by the square of the step, as its maximum that fades [1/s2].
    """

    tolerance: float
    mass: Array
    firsts: Array
    start: Array
    stored: float
    squares: Array
    before: Array
    rate: float = 0.0

    @classmethod
    def at_start(cls, tolerance: float, masses: list[Array], now: BodyMotion) -> VelocityError:
        """Errors at the start of a run in this motion of bodies with these masses, (n_dofs,) each."""
        firsts = np.cumsum([0, *map(len, masses)])[:-1]
        none = np.zeros(len(masses))
        return cls(tolerance, np.concatenate(masses), firsts, now.q_t, 0.0, none, now.q_tt)

    @property
    def energy(self) -> float:
        """Kinetic energy of all bodies' largest changes of velocity [J], at least a small share of what is stored."""
        return max(0.5 * float(self.squares.sum()), _STORED * self.stored)

    def error(self, step: float, now: BodyMotion) -> float:
        """Error of a step [s] that ends in this motion."""
        return self.judged(step, now).error

    def judged(self, step: float, now: BodyMotion) -> Judgement:
        """Error of a step [s] that ends in this motion, with the motion."""
        errors, squares = self._squares(now.q_tt - self.before), self._moved(now)
        scale = np.maximum(np.sqrt(squares * squares.sum()), 2 * _STORED * self.stored)
        if scale.all():
            return Judgement(now, squares, step / 12 * math.sqrt((errors / scale).max()))
        return Judgement(now, squares, math.inf if errors.any() else 0.0)

    def after(self, step: float, end: Judgement) -> VelocityError:
        """Return the errors after a step [s] that was accepted with this end."""
        rate = max(_FADING * self.rate, end.error / step**2)
        same = self.tolerance, self.mass, self.firsts, self.start, self.stored
        return VelocityError(*same, end.squares, end.now.q_tt, rate)

    def jumped(self, step: float, now: BodyMotion, stored: float) -> VelocityError:
        """Return the errors where a contact has closed or opened: no step longer than `step` [s] may follow at once.

        Bodies and contacts now store another energy [J].
        """
        rate = max(self.rate, self._goal / step**2)
        return replace(self, squares=self._moved(now), before=now.q_tt, rate=rate, stored=stored)

    def next_step(self, last: float, share: float = 1.0) -> float:
        """Return the step [s] that may follow one of length `last` [s], for a share of the tolerance."""
        chosen = math.sqrt(share * self._goal / self.rate) if self.rate > 0 else math.inf
        if self.rate * last**2 > share * self.tolerance:
            return chosen
        return _GROWTH * last if chosen >= _STRIDE * last else last

    def shorter_step(self, step: float, error: float, share: float = 1.0) -> float | None:
        """Return the step [s] that replaces one whose error is too large; None if it may stay."""
        if error <= _REFUSED * share * self.tolerance:
            return None
        return step * max(_SHORTEST, math.sqrt(share * self._goal / error))

    @property
    def _goal(self) -> float:
        """Error of the steps that are chosen: half of what is allowed, so that few are not accepted."""
        return 0.5 * self.tolerance

    def _moved(self, now: BodyMotion) -> Array:
        """Return `squares` with the changes of velocity until now."""
        value: Array = np.maximum(self.squares, self._squares(now.q_t - self.start))
        return value

    def _squares(self, changes: Array) -> Array:
        """Squares of changes of all coordinates in the mass, summed over each body, (nb,)."""
        value: Array = np.add.reduceat(self.mass * changes * changes, self.firsts)
        return value
