"""Energy of all bodies in motion and vibration, in few calls: step control asks for it in each step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..exudyn_bodies.partition_body import PartitionBody
from ..support.arrays import Array, consecutive


class Vibration:
    """Vibration of bodies, by their coordinates, one body after the other: (n,) arrays.

    A basis with nodal columns has no modes: all its vibration counts as if it had the frequency `f_cut`.

    Parameters
    ----------
    bodies : sequence of PartitionBody
    """

    def __init__(self, bodies: Sequence[PartitionBody]) -> None:
        slices = consecutive([item.body.n_dofs for item in bodies])
        modal, self._nodal = [], []
        for item, dofs in zip(bodies, slices, strict=True):
            if item.body.n_shapes == item.body.n_dofs:
                modal.append((np.arange(dofs.start + 6, dofs.stop), item.body.basis.omega[6:]))
            else:
                self._nodal.append((item, dofs))
        places, omega = np.concatenate([[], *(p for p, _ in modal)]), np.concatenate([[], *(w for _, w in modal)])
        cut = np.array([2 * np.pi * item.body.f_cut for item, _ in self._nodal])
        order = np.argsort(-np.concatenate([omega, cut]), kind="stable")
        modes = np.flatnonzero(order < len(omega))
        self._frequencies = np.concatenate([omega, cut])[order] / (2 * np.pi)
        self._mass = np.concatenate([[], *(item.kinematics.mass for item in bodies)])
        self._modes, self._places = modes, places[order[modes]].astype(int)
        self._omega = omega[order[modes]]
        self._of_nodal = np.argsort(order)[len(omega) :]

    def kinetic_energy(self, q_t: Array) -> float:
        """Kinetic energy of all bodies [J], by their constant mass."""
        return 0.5 * float(self._mass @ (q_t * q_t))

    def fastest(self, q: Array, q_t: Array, least: float) -> float:
        """Highest frequency [Hz] that, with all above it, has more energy than `least` [J]; zero if none has."""
        energies = q_t[self._places] ** 2 + (self._omega * q[self._places]) ** 2
        if self._nodal:
            of_modes, energies = energies, np.empty(len(self._frequencies))
            energies[self._modes] = of_modes
            energies[self._of_nodal] = [_energy(item, q[dofs], q_t[dofs]) for item, dofs in self._nodal]
        first = int(energies.cumsum().searchsorted(2 * least, side="right"))
        return float(self._frequencies[first]) if first < len(self._frequencies) else 0.0


def _energy(item: PartitionBody, q: Array, q_t: Array) -> float:
    """Twice the energy of a body's deformation [J]."""
    q, q_t = item.kinematics.deformed(q), item.kinematics.deformed(q_t)
    return float(q_t @ (item.body.mass @ q_t) + q @ (item.body.stiffness @ q))
