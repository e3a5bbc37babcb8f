"""Friction of a contact in a run: tangential forces, stick and slip, slip paths, and the energy that it takes."""

from __future__ import annotations

import numpy as np

from ..algebra.coulomb import Coulomb
from ..algebra.friction import OPEN
from ..errors import InputError
from ..support.arrays import Array
from ..support.checks import validate_result
from .contact_samples import ModelContact, RunSamples, kept_rows, mean_forces


class FrictionResults:
    """`contact.friction`: results of friction in a run.

    Every contact has this view. Without friction it is false (`if contact.friction:`), its work is zero, and its other
    results raise an InputError.

    Parameters
    ----------
    contact : PartitionContact
    """

    def __init__(self, contact: ModelContact) -> None:
        self._contact = contact

    def __bool__(self) -> bool:
        """Whether the contact has friction."""
        return self.coulomb is not None

    @property
    def coulomb(self) -> Coulomb | None:
        """Coulomb's law of the contact; None without friction."""
        return self._contact.mechanics.friction

    def tangential_force(self, result: RunSamples) -> Array:
        """Sum of the tangential forces on the slave in space, (n, 3) [N].

        Raises
        ------
        InputError
            If the contact is frictionless, or `result` is no result or is of another model.
        """
        self._samples(result)
        return mean_forces(self._contact, result, "sFriction", slice(0, 3), slice(7, 10))

    def stuck_rows(self, result: RunSamples) -> Array:
        """Number of rows that stick, (n,); the other closed rows slip.

        Raises
        ------
        InputError
            See `tangential_force`.
        """
        return self._samples(result)[:, 3].astype(int)

    def work(self, result: RunSamples) -> Array:
        """Energy that friction has taken since the start of the run, (n,) [J]; zero without friction.

        Raises
        ------
        InputError
            If `result` is no result, or is of another model.
        """
        validate_result(result)
        if not self:
            return np.zeros(len(result.sensor_of(self._contact, self._contact["sForce"])))
        return self._samples(result)[:, 5]

    def states(self, result: RunSamples) -> Array:
        """State of the row of each of the slave's patch nodes, (n, np) int8: 0 open, 1 sticks, 2 slips.

        Raises
        ------
        InputError
            If the contact is frictionless, or nothing was kept of the run.
        """
        size = self._patch_size(result)
        states = np.full((len(result.t), size), OPEN, dtype=np.int8)
        for i, nodes, _, _, state in kept_rows(self._contact, result):
            states[i, nodes] = state
        return states

    def row_forces(self, result: RunSamples) -> Array:
        """Tangential force on the slave at the row of each of its patch nodes in space, (n, np, 3) [N].

        Raises
        ------
        InputError
            See `states`.
        """
        size = self._patch_size(result)
        forces = np.zeros((len(result.t), size, 3))
        for i, nodes, _, tangential, _ in kept_rows(self._contact, result):
            forces[i, nodes] = tangential
        return forces

    def traction(self, result: RunSamples) -> Array:
        """Tangential traction on the slave around its patch nodes in space, (n, np, 3) [Pa].

        It is a mean over the same functions as `PartitionContact.pressure`.

        Raises
        ------
        InputError
            See `states`; also with formulation "hertz".
        """
        if self._contact.mechanics.law.semi_axes(1.0) is not None:
            raise InputError(
                "contact: with formulation 'hertz' facets do not resolve the traction; tangential_force(result) is its "
                "sum"
            )
        forces, means = self.row_forces(result), self._contact.mechanics.node_pressures
        value: Array = np.stack([(means @ forces[..., axis].T).T for axis in range(3)], axis=-1)
        return value

    def slip_path(self, result: RunSamples) -> Array:
        """Length of the slip of the row of each of the slave's patch nodes in the whole run, (np,) [m].

        Raises
        ------
        InputError
            See `states`.
        """
        self._patch_size(result)
        return result.kept(self._contact).slip_path.copy()

    def _patch_size(self, result: RunSamples) -> int:
        self._samples(result)
        return len(result.kept(self._contact).areas)

    def _samples(self, result: RunSamples) -> Array:
        """Samples of the sensor `sFriction`, (n, 7); (n, 10) with multipliers, which add their impulses so far."""
        if not self:
            raise InputError(
                f"contact {self._contact.name!r} is frictionless; give friction= to CreatePartitionContact for "
                "tangential forces"
            )
        validate_result(result)
        return result.sensor_of(self._contact, self._contact["sFriction"])
