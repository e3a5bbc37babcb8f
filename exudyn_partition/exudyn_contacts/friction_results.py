"""What a contact with friction tells of a run: tangential forces, stick and slip, slip paths and energy taken."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from ..algebra.coulomb import Coulomb
from ..algebra.friction import OPEN, SLIP
from ..contact.formulations.formulation import Law
from ..errors import InputError
from ..exudyn_bodies.model import Samples
from ..exudyn_bodies.partition_body import PartitionBody
from ..results.history import at_times
from ..support.arrays import Array
from ..support.checks import validate_result
from .contact_run import ContactRun
from .kept_run import KeptRun


class RunSamples(Samples, Protocol):
    """What a contact reads of a run: samples of sensors, and what it kept itself."""

    @property
    def runs(self) -> Sequence[ContactRun | KeptRun]:
        """What each contact kept of the run; empty if nothing was kept."""

    def kept(self, contact: Any) -> ContactRun | KeptRun:
        """What a contact kept of the run."""

    def at(self, times: Array) -> RunSamples:
        """Return the samples nearest to some times, each once."""


class FrictionResults(dict[str, Any]):
    """Results of a contact that exist with friction; without, they are an InputError."""

    name: str
    law: Law
    sides: tuple[tuple[PartitionBody, int], ...]

    @property
    def friction(self) -> Coulomb | None:
        """Coulomb's law of the contact; None without friction."""
        return self.law.friction

    def tangential_force(self, result: RunSamples) -> Array:
        """Sum of the tangential forces on the slave in space, (n, 3) [N].

        Raises
        ------
        InputError
            If the contact is frictionless, or the result is none or of another model.
        """
        self._friction_samples(result)
        return self._sampled(result, "sFriction", slice(0, 3), slice(7, 10))

    def _sampled(self, result: RunSamples, sensor: str, forces: slice, impulses: slice) -> Array:
        """Forces at the times of `result`; multipliers are means within steps, theirs come from the impulses."""
        validate_result(result)
        samples = result.sensor_of(self, self[sensor])
        if not self.law.ahead or len(result.t) < 2:
            return samples[:, forces]
        impulse = samples[:, impulses]
        means = np.diff(impulse, axis=0, prepend=impulse[:1]) / np.diff(result.t, prepend=-1.0)[:, None]
        return at_times(result.t, means)

    def stuck_rows(self, result: RunSamples) -> Array:
        """Number of rows that stick, (n,); the other closed rows slip.

        Raises
        ------
        InputError
            See `tangential_force`.
        """
        return self._friction_samples(result)[:, 3].astype(int)

    def dissipated_energy(self, result: RunSamples) -> Array:
        """Energy that friction has taken since the start of the run, (n,) [J]; zero without friction.

        Raises
        ------
        InputError
            If the result is none, or of another model.
        """
        validate_result(result)
        return np.zeros(len(result.t)) if self.friction is None else self._friction_samples(result)[:, 5]

    def row_states(self, result: RunSamples) -> Array:
        """Whether the row of each of the slave's patch nodes is open, 0, sticks, 1, or slips, 2, (n, np) int8.

        Raises
        ------
        InputError
            If the contact is frictionless, or nothing was kept of the run.
        """
        size = self._patch_size(result)
        states = np.full((len(result.t), size), OPEN, dtype=np.int8)
        for i, nodes, _, _, state in self._kept_samples(result):
            states[i, nodes] = state
        return states

    def row_tractions(self, result: RunSamples) -> Array:
        """Tangential force on the slave at the row of each of its patch nodes in space, (n, np, 3) [N].

        Raises
        ------
        InputError
            See `row_states`.
        """
        size = self._patch_size(result)
        forces = np.zeros((len(result.t), size, 3))
        for i, nodes, _, traction, _ in self._kept_samples(result):
            forces[i, nodes] = traction
        return forces

    def traction(self, result: RunSamples) -> Array:
        """Tangential traction on the slave around its patch nodes in space, (n, np, 3) [Pa]; means as of `pressure`.

        Raises
        ------
        InputError
            See `row_states`.
        """
        forces = self.row_tractions(result)
        value: Array = np.stack([(self.law.node_pressures @ forces[..., axis].T).T for axis in range(3)], axis=-1)
        return value

    def slip_path(self, result: RunSamples) -> Array:
        """Path that the row of each of the slave's patch nodes slipped in the whole run, (np,) [m].

        Raises
        ------
        InputError
            See `row_states`.
        """
        self._patch_size(result)
        return result.kept(self).slip_path.copy()

    def _patch_size(self, result: RunSamples) -> int:
        self._friction_samples(result)
        return len(result.kept(self).areas)

    def _friction_samples(self, result: RunSamples) -> Array:
        """Samples of the sensor `sFriction`, (n, 7); of explicit multipliers also their impulses so far, (n, 10)."""
        if self.friction is None:
            raise InputError(
                f"contact {self.name!r} is frictionless; give friction= to CreatePartitionContact for tangential forces"
            )
        validate_result(result)
        return result.sensor_of(self, self["sFriction"])

    def _kept_samples(self, result: RunSamples) -> list[tuple[int, Array, Array, Array, Array]]:
        """Of each sample with closed rows: its number, nodes of the rows, normal and tangential forces, and states."""
        run, place = result.kept(self), {t: i for i, t in enumerate(result.t)}
        found = []
        for t, nodes, lam in run.samples:
            if t in place:
                none = np.zeros((len(nodes), 3)), np.full(len(nodes), SLIP, dtype=np.int8)
                found.append((place[t], nodes, lam, *run.tangential.get(t, none)))
        return found

    def _kept_on_nodes(self, result: RunSamples) -> list[Array]:
        """Forces on the nodes of each side's patch, (n, np, 3) in space [N], from those that the run kept."""
        validate_result(result)
        law = self.law.for_run("explicit")
        q = np.hstack([item.coordinates(result) for item, _ in self.sides])
        forces = [np.zeros((len(result.t), len(side.surface.points), 3)) for side in law.gaps.sides]
        for i, nodes, lam, traction, _ in self._kept_samples(result):
            for on_side, now in zip(forces, law.forces_on_nodes(q[i], nodes, lam, traction), strict=True):
                on_side[i] = now
        return forces
