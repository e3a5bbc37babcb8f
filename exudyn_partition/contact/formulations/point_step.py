"""A step of a contact at a point, whose forces are found from touch to touch, also while others move the point."""

from __future__ import annotations

from typing import Any, Protocol, TypeVar

import numpy as np

from ...support.arrays import Array
from ..law import Forces, Places

_MOST = 60
_NOT_MOVED = np.zeros(3)


class Touch(Protocol):
    """Forces at a point, as far as they are found.

    Attributes
    ----------
    on_row : (d,) array
        On the slave, along the directions of the row [N].
    settled : bool
        Whether the step before would have hardly changed them.
    """

    @property
    def on_row(self) -> Array:
        """See `Touch`."""

    @property
    def settled(self) -> bool:
        """See `Touch`."""


T = TypeVar("T", bound=Touch)


class PointLaw(Protocol):
    """A law of a contact at a point."""

    def step(self, places: Places) -> PointStep[Any]:
        """Step at places of the row without what other contacts do."""


class PointStep(Protocol[T]):
    """A step of a contact at a point, from the last accepted state; it does not change."""

    def begin(self) -> T:
        """Forces to begin with."""

    def better(self, touch: T, moved: Array) -> T:
        """Better forces where other contacts move the row by `moved`, (d,) [m]; the same ones if they have settled."""

    def forces(self, touch: T) -> Forces:
        """Answer of the law with settled forces."""


def settled(step: PointStep[T]) -> Forces:
    """Answer of a law where nothing moves the point besides its own forces."""
    touch = step.begin()
    for _ in range(_MOST):
        touch = step.better(touch, _NOT_MOVED)
        if touch.settled:
            break
    return step.forces(touch)
