"""What a contact remembers between two steps, as one value of arrays.

A contact that begins from such a value gives the next force as the one whose state it is, whatever else both have kept.
Runs begin, repeat steps, go on, are saved and are loaded by it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..support.arrays import Array
from .gaps import GapState
from .memory import RowMemory
from .plasticity.zone_state import NodalState, ZoneState
from .viscosity import ViscousMemory


@dataclass(frozen=True, eq=False)
class ContactState:
    """State of a contact at the end of an accepted step.

    Parameters
    ----------
    gaps : GapState
    memory : RowMemory
        Forces on the rows, and with friction their slip.
    creep : ViscousMemory
    zones : tuple of ZoneState or NodalState
        Plastic zones beneath the patches.
    opening : float
        How much of an overlap that is meant is still open [m].
    stored : float
        Energy that the contact stores [J].
    power : float
        Energy that the law takes per time [W], see `law.Forces`.
    dissipated : float
        Energy that the law has taken so far [J].
    least_gap : float
        Smallest gap of the rows [m].
    law : (np, k) array
        What the law remembers of each of the slave's nodes, see `law.Law.memory`.
    """

    gaps: GapState
    memory: RowMemory
    creep: ViscousMemory
    zones: Sequence[ZoneState | NodalState] = ()
    opening: float = 0.0
    stored: float = 0.0
    power: float = 0.0
    dissipated: float = 0.0
    least_gap: float = np.inf
    law: Array = field(default_factory=lambda: np.empty((0, 0)))

    def at_rest(self) -> ContactState:
        """Return the state for a run after statics, which know no speeds."""
        still = np.zeros(len(self.memory.path))
        return replace(self, memory=replace(self.memory, slipped=still.astype(bool), speed=still), power=0.0)

    def without_energies(self) -> ContactState:
        """Return the state for a run that counts energies taken, and slip, from zero."""
        memory = replace(RowMemory.none(*self.memory.forces.shape), forces=self.memory.forces)
        zones = [replace(zone, work=0.0) for zone in self.zones]
        creep = replace(self.creep, dissipated=0.0)
        return replace(self, memory=memory, creep=creep, zones=tuple(zones), dissipated=0.0)
