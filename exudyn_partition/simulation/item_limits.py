"""Explicit steps that springs, dampers and other items of Exudyn allow, with the bodies that they hold.

Exudyn's VelocityVerlet computes damping forces with the velocities half a step before. With symmetric matrices, steps h
of M q'' + D q' + K q = 0 are stable as long as no eigenvalue of M^-1 (h^2 K + 2 h D) is above 4. Joints take motions
away: eigenvalues are those of the motions that they leave.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg

from ..algebra.sparse.assembly import Part, assembled
from ..exudyn_bodies.held_damping import independent, root_of_inverse
from ..exudyn_bodies.joints import mass_and_rows
from ..exudyn_bodies.model import dofs_of
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_bodies.tangents import Tangent, tangents
from ..exudyn_contacts.partition_contact import PartitionContact, partition_items
from ..support.arrays import Array
from ..support.foreign import MainSystem

DENSE = 150  # number of coordinates up to which all frequencies are found: Lanczos' iterations take longer
_CAUSES = 1.2  # limits: an item that allows steps no longer than this by itself is the cause of the limit

Group = tuple[list[PartitionBody], list[PartitionContact]]


def longest_step(omega: float, rate: float) -> float:
    """Longest stable step [s] of a frequency [rad/s] with damping 2 zeta omega [1/s]: h^2 omega^2 + 2 h d <= 4."""
    by_both = rate + math.hypot(rate, 2 * omega)
    return 4 / by_both if by_both > 0.0 else math.inf


def largest_eigenvalue(apply: Callable[[Array], Array], n: int) -> float:
    """Largest eigenvalue of a symmetric operator on n numbers, by Lanczos' iteration.

    It starts from random numbers, the same each time: springs between masses have no force against equal ones.
    """
    operator = scipy.sparse.linalg.LinearOperator((n, n), matvec=apply, dtype=float)
    start = np.random.default_rng(0).standard_normal(n)
    eigenvalues = scipy.sparse.linalg.eigsh(operator, k=1, which="LA", tol=1e-4, v0=start, return_eigenvectors=False)
    return float(eigenvalues[0])


@dataclass(frozen=True, eq=False)
class HeldByItems:
    """Motions of a model with items of Exudyn.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    items : list of Tangent
    root : (n, m) csr matrix
        R with R R' the inverse mass, of the coordinates that have one.
    prevented : (m, k) array
        Orthonormal motions that joints prevent, as parts of the columns of R.
    """

    mbs: MainSystem
    items: list[Tangent]
    root: sp.csr_matrix
    prevented: Array

    @property
    def damped(self) -> bool:
        """Whether an item has damping."""
        return any(item.damping.any() for item in self.items)

    def hold(self, bodies: Sequence[PartitionBody]) -> bool:
        """Whether an item acts on one of these bodies."""
        columns = np.concatenate([item.columns for item in self.items])
        return any(np.isin(dofs_of(self.mbs, body), columns).any() for body in bodies)

    def largest_square(self, groups: Sequence[Group], step: float) -> float:
        """Largest squared frequency [rad2/s2] of bodies with their contacts and all items, in steps h of some length.

        Damping D counts as a stiffness 2 D / h.
        """
        parts: list[Part] = [(item.columns, _in_steps(item, step)) for item in self.items]
        for bodies, contacts in groups:
            parts += [(dofs_of(self.mbs, body), body.kinematics.proportional_matrix(0.0, 1.0)) for body in bodies]
            for contact in contacts:
                if (stiffness := contact.mechanics.closed_stiffness(step)) is not None:
                    parts.append((np.concatenate([np.r_[place] for place in contact.slices(self.mbs)]), stiffness))
        return self._largest(assembled(parts, self.root.shape[0]))

    def fastest(self, step: float) -> tuple[str, float]:
        """Name of the item that allows the shortest steps by itself, and their length [s], near steps of a length."""
        squares = [self._alone(item, step) for item in self.items]
        most = int(np.argmax(squares))
        return self.items[most].name, longest_step(math.sqrt(max(squares[most], 0.0)), 0.0)

    def _alone(self, item: Tangent, step: float) -> float:
        """Largest squared frequency of an item alone [rad2/s2]: that of its k coordinates, as unit forces move them."""
        at, place = np.unique(item.columns, return_inverse=True)
        stiffness = assembled([(place, _in_steps(item, step))], len(at)).toarray()
        root = self.root[at].toarray()
        root -= (root @ self.prevented) @ self.prevented.T
        values, vectors = np.linalg.eigh(root @ root.T)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        return float(np.linalg.eigvalsh(root.T @ (stiffness + stiffness.T) @ root / 2)[-1])

    def _largest(self, matrix: sp.csr_matrix) -> float:
        """Largest eigenvalue of the symmetric part of a matrix on the model's coordinates, (n, n), by mass."""
        matrix = self.root.T @ (matrix + matrix.T) @ self.root / 2

        def apply(x: Array) -> Array:
            x = self._allowed(x.reshape(len(x), -1))
            value: Array = self._allowed(matrix @ x)
            return value

        m = matrix.shape[0]
        if m <= DENSE:
            return float(np.linalg.eigvalsh(apply(np.eye(m))).max(initial=0.0))
        return largest_eigenvalue(apply, m)

    def _allowed(self, x: Array) -> Array:
        value: Array = x - self.prevented @ (self.prevented.T @ x)
        return value


def shorter_steps(items: HeldByItems | None, limit: float) -> str:
    """What the user may do about a stability limit [s]: about the spring or damper that causes it, if one does."""
    if items is not None:
        name, alone = items.fastest(limit)
        if alone < _CAUSES * limit:
            return f"{name} causes it by its stiffness or damping. Take at most {limit:.3g} s, less of these"
    return f"Take at most {limit:.3g} s, a lower f_cut, a region with larger elements"


def held_by_items(mbs: MainSystem) -> HeldByItems | None:
    """Motions of a model with the items of Exudyn that hold or damp it; None if there are none."""
    items = [item for item in tangents(mbs) if item.stiffness.any() or item.damping.any()]
    if not items:
        return None
    mass, rows = mass_and_rows(mbs)
    bodies = [dofs_of(mbs, body) for body in partition_items(mbs)[0]]
    needed = np.concatenate([rows.nonzero()[1], *bodies, *(item.columns for item in items)])
    root = root_of_inverse(mass, np.unique(needed))
    root = root[:, np.flatnonzero(np.diff(root.tocsc().indptr))]
    push = (rows @ root).toarray()
    values, vectors = independent(push @ push.T)
    return HeldByItems(mbs, items, root, push.T @ (vectors / np.sqrt(values)))


def _in_steps(item: Tangent, step: float) -> Array:
    """Stiffness of an item in explicit steps of some length [s], (k, k)."""
    return item.stiffness + 2 / step * item.damping
