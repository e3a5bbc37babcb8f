"""Plastic zones whose nodes are coordinates with mass: the paper's impact region II in its own basis, explicit steps.

Theory: examples/site/theory.md, "Plastic zones".
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import RunError
from ...plasticity.flow import PlasticState
from ...support.arrays import Array
from ...support.attributes import copied
from .yielding_patches import Zones, ZonesAnswer
from .zone_motion import ZoneMotion
from .zone_state import NodalState

if TYPE_CHECKING:
    from typing import Self


class NodalZone:
    """A zone whose strains follow from the body's coordinates.

    Attributes
    ----------
    start : NodalState
        At the start of each run.
    """

    def __init__(self, motion: ZoneMotion) -> None:
        self.motion = motion
        plastic = motion.start
        energy = motion.zone.own_energy(plastic)
        self.start = NodalState(plastic, np.zeros_like(plastic.strain), self._generalised(plastic), energy)

    def at(self, state: NodalState, q: Array) -> NodalState:
        """State after a step that ends at coordinates q, (n,), of the body, by radial return from the state before."""
        zone, rows = self.motion.zone, self.motion.kinematics.rows
        total = zone.strains(np.asarray(rows @ q[len(q) - rows.shape[1] :]))
        plastic, generalised, work = zone.flow.answer(total, state.plastic), state.generalised, state.work
        if plastic is not state.plastic:
            generalised = self._generalised(plastic)
            work += zone.work((state.plastic, state.total), (plastic, total))
        stored = zone.own_energy(plastic) - float(np.vdot(zone.stress_volumes(plastic.strain), total))
        return NodalState(plastic, total, generalised, stored, work)

    def _generalised(self, plastic: PlasticState) -> Array:
        """Forces on the last coordinates of the body, (n,) [N], by plastic strain."""
        return np.asarray(self.motion.kinematics.rows.T @ self.motion.zone.pseudo_forces(plastic.strain))


class NodalZones(Zones):
    """Plastic zones beneath the patches of a contact, in explicit runs.

    Parameters
    ----------
    zones : sequence of (int, ZoneMotion)
        Number of the side, and the zone beneath its patch.
    sizes : sequence of int
        Numbers of coordinates of the contact's sides.
    """

    zones: list[tuple[int, NodalZone]]

    def __init__(self, zones: Sequence[tuple[int, ZoneMotion]], sizes: Sequence[int]) -> None:
        super().__init__([(side, NodalZone(motion)) for side, motion in zones], sizes)

    def for_run(self, method: str) -> Self:
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
        return copied(self)

    def at(self, states: Sequence[Any], parts: Sequence[Array]) -> ZonesAnswer:
        """Find the states after a step.

        Parameters
        ----------
        states : sequence of NodalState
            Of the zones at its begin.
        parts : sequence of (n,) arrays
            Coordinates of each side at its end.
        """
        by_zone = zip(self.zones, states, strict=True)
        return self._answer(states, [zone.at(state, parts[side]) for (side, zone), state in by_zone])
