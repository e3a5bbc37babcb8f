"""Coulomb's law of friction: how large a tangential force a normal force allows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..support.arrays import Array
from ..support.checks import validate_number, validate_positive

_HIGHEST = 10.0  # coefficients above it are taken for a slip of units, such as per cent or degrees


@dataclass(frozen=True)
class Coulomb:
    """Coulomb friction; the coefficient may fall when contact slips.

    A place that sticks bears a tangential force up to `static` times the normal force. Where it slips at speed v, the
    force is mu(v) times the normal force, opposite to the slip::

        mu(v) = kinetic + (static - kinetic) exp(-v / decay)

    Parameters
    ----------
    static : float
        Coefficient where contact sticks, 0 to 10.
    kinetic : float, optional
        Coefficient where it slips, 0 to `static`. Default: `static`.
    decay : float, optional
        Slip speed by which the coefficient falls from one to the other [m/s]. Default: it falls at once.

    Raises
    ------
    InputError
        If a coefficient is negative, not finite or above 10, if `kinetic` is above `static`, or if `decay` is given
        although both are the same.
    """

    static: float
    kinetic: float | None = None
    decay: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "static", _coefficient("static", self.static))
        kinetic = self.static if self.kinetic is None else _coefficient("kinetic", self.kinetic)
        object.__setattr__(self, "kinetic", kinetic)
        if kinetic > self.static:
            raise InputError(f"kinetic: expected at most the static coefficient, {self.static:g}, got {kinetic:g}")
        if self.decay is not None:
            object.__setattr__(self, "decay", validate_positive("decay", self.decay, "m/s"))
            if kinetic == self.static:
                raise InputError("decay: has no effect where both coefficients are the same; leave it out")

    @property
    def constant(self) -> bool:
        """Whether the coefficient is the same in stick and in slip."""
        return self.kinetic == self.static


def coefficients(friction: Coulomb, slips: Array, speed: Array) -> Array:
    """Coefficients of places, (n,).

    Parameters
    ----------
    friction : Coulomb
    slips : (n,) bool array
        Which places slip.
    speed : (n,) array
        Their slip speed [m/s].
    """
    kinetic = friction.static if friction.kinetic is None else friction.kinetic
    share = np.exp(-speed / friction.decay) if friction.decay is not None else 0.0
    return np.where(slips, kinetic + (friction.static - kinetic) * share, friction.static)


def friction_of(friction: float | Coulomb | None) -> Coulomb | None:
    """Coulomb's law of a coefficient, or the law itself; None without friction, also for a coefficient of zero.

    Raises
    ------
    InputError
        If it is neither, or the coefficient is out of range.
    """
    if friction is None or isinstance(friction, Coulomb):
        return friction if friction is None or friction.static > 0 else None
    coefficient = _coefficient("friction", validate_number("friction", friction, "a coefficient or Coulomb(...)"))
    return Coulomb(coefficient) if coefficient > 0 else None


def _coefficient(name: str, value: float) -> float:
    value = validate_number(name, value)
    if not 0 <= value <= _HIGHEST:
        raise InputError(f"{name}: expected a coefficient of friction, 0 to {_HIGHEST:g}, got {value:g}")
    return value
