"""Base classes of contact laws: the rows, the present forces on them, and the resultants."""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from ...algebra.coulomb import Coulomb
from ...algebra.friction import OPEN, SLIP
from ...frames.kinematics import Rows
from ...support.arrays import Array
from ..gaps import Gaps
from ..plasticity.yielding_patches import Zones
from .formulation import Law, Method, Motion

if TYPE_CHECKING:
    from typing import Self


class ContactLaw:
    """Forces on the rows of a contact in a run. This base stores no energy and has no memory; see `Law`.

    Attributes
    ----------
    gaps : Gaps
    lam : (nr,) array
        Forces on the present rows of `gaps` [N].
    index : (na,) int array
        Rows that are closed.
    least_gap : float
        Smallest gap of the present rows, without the deformation by the contact's own flexibility [m].
    """

    elastic = False
    compliant = False
    ahead = False
    remembers = False
    friction: Coulomb | None = None
    yielding: Zones | None = None

    def __init__(self, gaps: Gaps) -> None:
        self.gaps = gaps
        self._zero = np.zeros(gaps.n)
        self.reset()

    def fresh(self) -> Self:
        """Return the same law in its start state, for another run; constant data are shared."""
        result = copy.copy(self)
        result.gaps = self.gaps.fresh()
        result.reset()
        return result

    def for_run(self, method: Method) -> Law:
        """See `Law`."""
        return self.fresh()

    def reset(self) -> None:
        """Go back to the start."""
        self.gaps.reset()
        self.least_gap = np.inf
        self._closed_nodes = np.zeros(len(self.gaps.slave.surface.points), dtype=bool)
        self.open_rows()

    @property
    def iterations(self) -> int:
        """See `Law`."""
        return 0

    @property
    def searches(self) -> int:
        """See `Law`."""
        return self.gaps.searches

    @property
    def impulse(self) -> Array | None:
        """See `Law`."""
        return None

    def force(self, q: Array) -> Array:
        """See `Law`."""
        raise NotImplementedError(f"{type(self).__name__} is no elastic law")

    def evaluate(self, motion: Motion) -> Array:
        """See `Law`; the force element applies no force."""
        return self._zero

    def tangent_matrix(self, by_q: float, by_q_t: float) -> sp.csr_matrix:
        """See `Law`."""
        return sp.csr_matrix((self.gaps.n,) * 2)

    def commit(self, start: float) -> None:
        """See `Law`."""

    def flies_on(self, start: float) -> bool:
        """See `Law`."""
        return False

    def rollback(self) -> None:
        """See `Law`."""

    def ended_at(self, q: Array) -> bool:
        """Whether the coordinates, (n,), are those of the last evaluation."""
        return np.array_equal(self.gaps.q, q)

    def resume(self, earlier: Law, q: Array) -> bool:
        """See `Law`."""
        return False

    def closed_stiffness(self) -> Array | None:
        """See `Law`."""
        return None

    def potential(self, q: Array) -> float:
        """See `Law`."""
        return 0.0

    def stored(self) -> float:
        """See `Law`."""
        return 0.0

    def dissipated(self) -> float:
        """See `Law`."""
        return 0.0

    def press(self, gap: Array) -> tuple[float, int]:
        """See `Law`."""
        raise NotImplementedError(f"{type(self).__name__} is no elastic law")

    def row_stiffness(self) -> Array:
        """See `Law`."""
        raise NotImplementedError(f"{type(self).__name__} is no elastic law")

    def row_jacobian(self) -> Rows:
        """See `Law`."""
        return self.gaps.jacobian(self.index)

    def row_carrier(self) -> Array:
        """See `Law`."""
        return self.gaps.carrier_rows(self.index)

    def check(self, q: Array) -> None:
        """See `Law`."""

    @property
    def traction(self) -> Array:
        """See `Law`."""
        return np.zeros((len(self.lam), 3))

    @property
    def state(self) -> Array:
        """See `Law`; closed rows slip freely."""
        state = np.full(len(self.lam), OPEN, dtype=np.int8)
        state[self.index] = SLIP
        return state

    @property
    def slip_path(self) -> Array:
        """See `Law`; it is not counted without friction."""
        return np.zeros(len(self._closed_nodes))

    def closing(self, q: Array, q_t: Array, q_tt: Array) -> tuple[Array, Array, Array]:
        """Gaps, rates and accelerations of an open contact, see `Gaps.closing`."""
        found = self.gaps.closing(q, q_t, q_tt)
        self.open_rows()  # the rows may have changed
        return found

    def open_rows(self) -> Array:
        """Open all rows."""
        self.lam, self.index = np.zeros(len(self.gaps.row_nodes)), np.empty(0, dtype=np.int64)
        self._closed_nodes[:] = False
        return self._zero

    def close_rows(self, lam: Array, index: Array) -> None:
        """Close the rows `index` with forces lam, (nr,) [N]; their nodes are the first guess of the next step."""
        self.lam, self.index = lam, index
        self._closed_nodes[:] = False
        self._closed_nodes[self.gaps.row_nodes[index]] = True

    @property
    def row_nodes(self) -> Array:
        """Node of the slave's patch for each present row, (nr,)."""
        return self.gaps.row_nodes

    @property
    def node_areas(self) -> Array:
        """Area of the row of each node of the slave's patch, (np,) [m2]; zero for a node without a row."""
        return self.gaps.node_areas

    @property
    def node_pressures(self) -> sp.csr_matrix:
        """Matrix from forces of the rows to pressures around the nodes of the slave's patch, (np, np) [1/m2]."""
        return self.gaps.node_pressures

    def resultant(self) -> Array:
        """Force on the slave, (3,) [N]."""
        return self.gaps.resultant(self.lam)

    def nodal_forces(self) -> list[Array]:
        """Forces on the nodes of the patches, in axes of space, (np, 3) for each side [N]."""
        return self.gaps.nodal_forces(self.lam)

    def forces_on_nodes(self, q: Array, nodes: Array, lam: Array, traction: Array) -> list[Array]:
        """See `Law`."""
        self.gaps.at(q)
        forces = np.zeros(len(self._closed_nodes))
        forces[nodes] = lam
        return self.gaps.nodal_forces(forces[self.gaps.row_nodes])

    def moment(self, point: Array) -> Array:
        """Moment on the slave about a point in space, (3,) [N m]."""
        return self.gaps.moment(self.lam, point) if self.index.size else np.zeros(3)

    def on_carrier(self, point: Array) -> Array:
        """See `Law`."""
        return -np.concatenate([self.resultant(), self.moment(point)])

    def edge_reached(self) -> Array | None:
        """Place of a closed row at the edge of the contact patch, (3,) [m]; None if there is none."""
        rows = self.index[self.gaps.at_edge[self.index]]
        if not len(rows):
            return None
        value: Array = self.gaps.places_now()[0][self.gaps.row_nodes[rows[0]]]
        return value


class ElasticContact(ContactLaw):
    """A law whose forces follow from the coordinates alone. It has a stiffness and a potential."""

    elastic = True
    compliant = True
    h: Array

    def force(self, q: Array) -> Array:
        """Generalised contact force, (n,), at the coordinates q, (n,), of slave and master."""
        self.answer(self.gaps.at(q))
        return self.generalised()

    def generalised(self) -> Array:
        """Generalised forces, (n,), from the present forces on the rows."""
        return self.gaps.generalised(self.lam) if self.index.size else self._zero

    def press(self, gap: Array) -> tuple[float, int]:
        """See `Law`."""
        self.answer(gap)
        return self.stored(), len(self.index)

    def answer(self, gap: Array) -> None:
        """Find the forces on the present rows from their gaps, (nr,) [m]."""
        raise NotImplementedError

    def stored(self) -> float:
        """Energy stored at present [J]: -1/2 lambda' h, half of the forces times the depths."""
        return -0.5 * float(self.lam[self.index] @ self.h[self.index])

    def tangent_of(self, H: Rows) -> Array:
        """Stiffness of the closed rows on some coordinates, (m, m); H, (na, m), are the derivatives of their gaps."""
        raise NotImplementedError

    def row_stiffness(self) -> Array:
        """See `Law`."""
        return np.asarray(self.tangent_of(np.eye(len(self.index))))

    def tangent(self) -> Array:
        """Contact stiffness -d force / d q of the closed rows, (n, n), with the pairs held."""
        return self.tangent_of(self.gaps.jacobian(self.index))

    def tangent_matrix(self, by_q: float, by_q_t: float) -> sp.csr_matrix:
        """See `Law`."""
        return sp.csr_matrix(by_q * self.tangent())

    def closed_stiffness(self) -> Array:
        """Contact stiffness with all rows closed, (n, n): the largest that the element can have."""
        raise NotImplementedError

    def potential(self, q: Array) -> float:
        """Energy stored in the contact's own flexibility [J]."""
        self.force(q)
        return self.stored()
