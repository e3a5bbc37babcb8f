"""Plastic zones whose nodes are coordinates with mass: the paper's impact region II in its own basis, explicit steps.

Theory: examples/site/theory.md, "Plastic zones".
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import RunError
from ...plasticity.flow import PlasticState
from ...support.arrays import Array
from .yielding_patches import Zones
from .zone_run import ZoneMotion
from .zone_state import NodalState

if TYPE_CHECKING:
    from typing import Self


class NodalZone:
    """One zone in a run, see `yielding_patches.Zone`. Strains follow from the body's coordinates.

    Attributes
    ----------
    state : NodalState
        At the end of the last accepted step.
    generalised : (n,) array
        Forces on the last coordinates of the body from the present pseudo-forces [N].
    """

    def __init__(self, motion: ZoneMotion) -> None:
        self.motion, self.zone = motion, motion.zone
        self.begin(NodalState(motion.start, np.zeros_like(motion.start.strain)))

    def fresh(self) -> Self:
        """Return the same zone in its start state, for another run."""
        result = copy.copy(self)
        result.begin(NodalState(self.motion.start, np.zeros_like(self.motion.start.strain)))
        return result

    def begin(self, state: NodalState) -> None:
        """Begin from a state."""
        self.state, self._flows, self._strain, self.work = state, False, state.total, state.work
        self._displacement = np.zeros(3 * len(self.zone.nodes))
        self._take(state.plastic)

    def after(self) -> NodalState:
        """State after a step that ends at the last coordinates."""
        return NodalState(self.present, self._strain, self.work)

    def accept(self, state: NodalState) -> None:
        """Accept the step whose end this state is, see `after`."""
        self.state, self._flows = state, False

    def retry(self) -> None:
        """Begin the step again: each evaluation starts from the last accepted state."""

    def _take(self, state: PlasticState) -> None:
        self.present = state
        self._p = self.zone.pseudo_forces(state.strain)
        self.generalised: Array = np.asarray(self.motion.kinematics.rows.T @ self._p)

    def move(self, q: Array) -> None:
        """Find the state at coordinates q, (n,), of the body, by radial return from the last accepted step."""
        rows, before = self.motion.kinematics.rows, (self.state.plastic, self.state.total)
        self._displacement = np.asarray(rows @ q[len(q) - rows.shape[1] :])
        self._strain = self.zone.strains(self._displacement)
        state = self.zone.flow.answer(self._strain, self.state.plastic)
        flowed, self._flows = self._flows, state is not self.state.plastic
        if flowed or self._flows:
            self._take(state)
        self.work = self.state.work
        if self._flows:
            self.work += self.zone.work(before, (state, self._strain))

    def stored(self) -> float:
        """Elastic energy that plastic strain adds to that of the body's coordinates [J]."""
        return self.zone.own_energy(self.present) - float(self._p @ self._displacement)


class NodalZones(Zones):
    """Plastic zones beneath the patches of a contact, in a run.

    Parameters
    ----------
    motions : sequence of (int, ZoneMotion)
        Number of the side, and the zone beneath its patch.
    """

    zones: list[tuple[int, NodalZone]]

    def __init__(self, motions: Sequence[tuple[int, ZoneMotion]]) -> None:
        self.zones = [(side, NodalZone(motion)) for side, motion in motions]

    def for_run(self, contact: Any, method: str) -> Self:
        """See `Zones`; only explicit runs have such zones.

        Raises
        ------
        RunError
            If the run has another method.
        """
        if method != "explicit":
            raise RunError(
                f"method: {method!r} knows no plastic zones of basis 'free'. Take method='explicit', or basis "
                "'contact-adapted' or 'residual' with formulation='compliance'"
            )
        result = copy.copy(self)
        result.zones = [(side, zone.fresh()) for side, zone in self.zones]
        return result

    def forces(self, parts: Sequence[Array]) -> Array:
        """Generalised forces, (n,), at the coordinates of each side."""
        result = [np.zeros(len(q)) for q in parts]
        for side, zone in self.zones:
            zone.move(parts[side])
            result[side][len(parts[side]) - len(zone.generalised) :] += zone.generalised
        return np.concatenate(result)
