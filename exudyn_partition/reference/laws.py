"""Forces that the rows of the reference ask for in a step, without and with friction."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..algebra.complementarity import Complementarity
from ..algebra.coulomb import Coulomb, coefficients
from ..algebra.friction import SLIP, FrictionProblem
from ..results.history import History, at_times
from ..support.arrays import Array
from ..surfaces.rows import ContactRows


class Frictionless:
    """Normal forces that close the gaps at the end of a step.

    Attributes
    ----------
    matrices : two csr matrices
        Rows on the nodal displacements of the slave's and the master's patch, xyz interleaved.
    dissipated : float
        Energy that friction has taken so far [J].
    """

    def __init__(self, rows: ContactRows, patch_nodes: Sequence[int], steps: int) -> None:
        self.rows = rows
        self.matrices = rows.matrices(*patch_nodes)
        self._normal = np.zeros(steps + 1)  # entry n acts from t[n - 1] to t[n]
        self.dissipated = 0.0

    def begin(self, compliance: Array) -> None:
        """Take the flexibility of the rows in a step [m/N]."""
        self._contact = Complementarity(compliance)

    def forces(self, motion: Array) -> Array:
        """Forces on the rows in a step [N], for the motion that the rows would have without them [m]."""
        return self._contact.solve(self.rows.gap + motion)

    def record(self, lam: Array, n: int) -> None:
        """Keep forces that `forces` found for step n."""
        self._normal[n] = lam.sum()

    def history(self, t: Array, velocity: dict[str, Array], info: dict[str, Any]) -> History:
        """Return the history of the first steps; `t` are their times, (n,) [s]."""
        return History(t, at_times(t, self._normal[: len(t)]), velocity, info)


class Frictional(Frictionless):
    """Normal and tangential forces by Coulomb's law.

    Each row also has two tangents, perpendicular to its mean normal. Its slip in a step is the mean motion of its
    points along them, relative to the master. A row that sticks does not move in the step, one that slips has mu times
    its normal force, against its slip. The work of the forces on the slips is what friction takes, without an error.
    """

    def __init__(
        self, rows: ContactRows, patch_nodes: Sequence[int], steps: int, *, friction: Coulomb, step: float
    ) -> None:
        super().__init__(rows, patch_nodes, steps)
        self._friction, self._step = friction, step
        self._tangents = tangents_of(rows.normal)
        parts = zip(self.matrices, rows.interpolation(*patch_nodes), (1.0, -1.0), strict=True)
        of_slave, of_master = (
            interleaved(normal, *(directed(sign * weights, along) for along in self._tangents))
            for normal, weights, sign in parts
        )
        self.matrices = of_slave, of_master
        self._tangential, self._taken = np.zeros((steps + 1, 3)), np.zeros(steps + 1)
        self._place, self._path = np.zeros((len(rows), 2)), np.zeros(len(rows))
        self._slipped, self._speed = np.zeros(len(rows), dtype=bool), np.zeros(len(rows))

    def begin(self, compliance: Array) -> None:
        """Take the flexibility of the rows in a step [m/N]."""
        self._problem, self._compliance = FrictionProblem(compliance), compliance

    def forces(self, motion: Array) -> Array:
        """Forces on the rows in a step [N], for the motion that the rows would have without them [m]."""
        h = motion.reshape(-1, 3).copy()
        h[:, 0] += self.rows.gap
        h[:, 1:] -= self._place
        self._motion = h
        return self._problem.solve(h, coefficients(self._friction, self._slipped, self._speed)).ravel()

    def record(self, lam: Array, n: int) -> None:
        """Keep forces that `forces` found for step n, and what has slipped in it."""
        problem, lam = self._problem, lam.reshape(-1, 3)
        slip = self._motion[:, 1:]
        if problem.index.size:
            slip = slip + (self._compliance @ lam.ravel()).reshape(-1, 3)[:, 1:]
        self._place = self._place + slip
        way = np.where(problem.state == SLIP, np.hypot(*slip.T), 0.0)
        self._path += way
        self._slipped, self._speed = problem.state == SLIP, way / self._step
        self._normal[n] = lam[:, 0].sum()
        self._tangential[n] = np.einsum("rk,krd->d", lam[:, 1:], self._tangents)
        self.dissipated -= float(np.sum(lam[:, 1:] * slip))
        self._taken[n] = self.dissipated

    def history(self, t: Array, velocity: dict[str, Array], info: dict[str, Any]) -> History:
        """Return the history of the first steps; `t` are their times, (n,) [s]."""
        rows = {
            "friction": dataclasses.asdict(self._friction),
            "dissipated_J": self.dissipated,
            "row_nodes": self.rows.points.row_nodes.tolist(),
            "row_states": self._problem.state.tolist(),
            "slip_path_m": self._path.tolist(),
        }
        return History(
            t,
            at_times(t, self._normal[: len(t)]),
            velocity,
            info | rows,
            tangential_force=at_times(t, self._tangential[: len(t)]),
            dissipated=self._taken[: len(t)],
        )


def tangents_of(normals: Array) -> Array:
    """Two unit vectors perpendicular to each normal and each other, (2, nr, 3), of normals, (nr, 3)."""
    axes = np.eye(3)[abs(normals).argmin(axis=1)]
    first = np.cross(axes, normals)
    second = np.cross(normals, first)
    return np.stack([along / np.linalg.norm(along, axis=1)[:, None] for along in (first, second)])


def directed(weights: sp.csr_matrix, along: Array) -> sp.csr_matrix:
    """Rows on nodal displacements, (nr, 3n), of weights of the nodes, (nr, n), along a vector for each row, (nr, 3)."""
    found = weights.tocoo()
    values, columns = found.data[:, None] * along[found.row], 3 * found.col[:, None] + np.arange(3)
    entries = values.ravel(), (np.repeat(found.row, 3), columns.ravel())
    return sp.csr_matrix(entries, shape=(weights.shape[0], 3 * weights.shape[1]))


def interleaved(*parts: sp.csr_matrix) -> sp.csr_matrix:
    """The first row of each part, (nr, n), then the second of each, and so on."""
    order = np.arange(len(parts) * parts[0].shape[0]).reshape(len(parts), -1).T.ravel()
    return sp.csr_matrix(sp.vstack(parts, format="csr")[order])
