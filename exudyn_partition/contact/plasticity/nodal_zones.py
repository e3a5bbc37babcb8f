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

if TYPE_CHECKING:
    from typing import Self


class NodalZone:
    """State of one zone in a run, see `yielding_patches.Zone`. Strains follow from the body's coordinates.

    Attributes
    ----------
    generalised : (n,) array
        Forces on the last coordinates of the body from the present pseudo-forces [N].
    """

    def __init__(self, motion: ZoneMotion) -> None:
        self.motion, self.zone = motion, motion.zone
        self.enter(motion.start)

    def fresh(self) -> Self:
        """Return the same zone in its start state, for another run."""
        result = copy.copy(self)
        result.enter(self.motion.start)
        return result

    def enter(self, state: PlasticState) -> None:
        """Take a state as the end of an accepted step."""
        self.committed, self._flows = state, False
        self._strain = self._committed_strain = np.zeros_like(state.strain)
        self._displacement = np.zeros(3 * len(self.zone.nodes))
        self.work = self._committed_work = 0.0
        self._take(state)

    def resume(self, last: Self) -> None:
        """Start from the present state of an earlier run."""
        self.enter(last.present)

    def count_on(self, work: float) -> None:
        """Count plastic work from what an earlier run has come to [J]."""
        self.work = self._committed_work = work

    def _take(self, state: PlasticState) -> None:
        self.present = state
        self._p = self.zone.pseudo_forces(state.strain)
        self.generalised: Array = np.asarray(self.motion.kinematics.rows.T @ self._p)

    def move(self, q: Array) -> None:
        """Find the state at coordinates q, (n,), of the body, by radial return from the last accepted step."""
        rows, before = self.motion.kinematics.rows, (self.committed, self._committed_strain)
        self._displacement = np.asarray(rows @ q[len(q) - rows.shape[1] :])
        self._strain = self.zone.strains(self._displacement)
        state = self.zone.flow.answer(self._strain, self.committed)
        flowed, self._flows = self._flows, state is not self.committed
        if flowed or self._flows:
            self._take(state)
        self.work = self._committed_work
        if self._flows:
            self.work += self.zone.work(before, (state, self._strain))

    def commit(self) -> None:
        """Accept the present state."""
        self.committed, self._committed_strain, self._committed_work = self.present, self._strain, self.work
        self._flows = False

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
