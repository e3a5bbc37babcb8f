"""Two-pass contact: the mean of the forces for both choices of slave and master.

Theory: examples/site/theory.md, "Penalty and two passes".
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ...algebra.coulomb import Coulomb
from ...frames.kinematics import Rows
from ...support.arrays import Array
from ..plasticity.yielding_patches import YieldingPatches
from .formulation import Law, Method, Motion
from .law import ElasticContact


class TwoPass:
    """Half of the forces of a law with one side as slave, plus half with the other: no side is preferred.

    No row is redundant. The forces of each pass are the gradient of a potential, and so is their mean. Each pass alone
    would carry the whole force.

    Parameters
    ----------
    there, back : ElasticContact
        Laws of the two passes; `back` has slave and master exchanged.
    """

    elastic = True
    compliant = True
    ahead = False
    remembers = False
    friction: Coulomb | None = None
    yielding: YieldingPatches | None = None

    def __init__(self, there: ElasticContact, back: ElasticContact) -> None:
        self.passes = (there, back)
        self.gaps = there.gaps
        n, n_back = there.gaps.n, back.gaps.sides[0].n
        self._exchange = np.r_[n - n_back : n, : n - n_back]  # master first
        self._restore = np.argsort(self._exchange)

    def for_run(self, method: Method) -> TwoPass:
        """See `Law`."""
        return TwoPass(*(law.fresh() for law in self.passes))

    def evaluate(self, motion: Motion) -> Array:
        """See `Law`."""
        return self.force(motion.q)

    def force(self, q: Array) -> Array:
        """Generalised contact force, (n,), at the coordinates q, (n,), of slave and master."""
        there, back = self.passes
        return 0.5 * (there.force(q) + back.force(q[self._exchange])[self._restore])

    def closing(self, q: Array, q_t: Array, q_tt: Array) -> tuple[Array, Array, Array]:
        """Gaps, rates and accelerations of both passes, see `Gaps.closing`."""
        there, back = self.passes
        both = there.closing(q, q_t, q_tt), back.closing(*(x[self._exchange] for x in (q, q_t, q_tt)))
        gap, rate, acceleration = (np.concatenate(pair) for pair in zip(*both, strict=True))
        return gap, rate, acceleration

    def tangent(self) -> Array:
        """Contact stiffness -d force / d q, (n, n)."""
        there, back = (law.tangent() for law in self.passes)
        return 0.5 * (there + back[np.ix_(self._restore, self._restore)])

    def tangent_matrix(self, by_q: float, by_q_t: float) -> sp.csr_matrix:
        """See `Law`."""
        return sp.csr_matrix(by_q * self.tangent())

    def row_stiffness(self) -> Array:
        """See `Law`; only carriers of rigid surfaces ask for it, and these contacts have one pass."""
        raise NotImplementedError("contact in two passes has rows of two kinds")

    def commit(self, start: float) -> None:
        """See `Law`."""

    def flies_on(self, start: float) -> bool:
        """See `Law`."""
        return False

    def rollback(self) -> None:
        """See `Law`."""

    def resume(self, earlier: Law, q: Array) -> bool:
        """See `Law`."""
        return False

    def check(self, q: Array) -> None:
        """See `Law`."""

    def dissipated(self) -> float:
        """See `Law`."""
        return 0.0

    def stored(self) -> float:
        """See `Law`."""
        return 0.5 * sum(law.stored() for law in self.passes)

    def press(self, gap: Array) -> tuple[float, int]:
        """See `Law`; from the first pass alone, because each pass alone carries the whole force."""
        return self.passes[0].press(gap)

    def closed_stiffness(self) -> Array:
        """Contact stiffness with all rows closed, (n, n)."""
        there, back = (law.closed_stiffness() for law in self.passes)
        return 0.5 * (there + back[np.ix_(self._restore, self._restore)])

    def potential(self, q: Array) -> float:
        """Energy stored in the contact [J]."""
        there, back = self.passes
        return 0.5 * (there.potential(q) + back.potential(q[self._exchange]))

    @property
    def iterations(self) -> int:
        """See `Law`."""
        return sum(law.iterations for law in self.passes)

    @property
    def searches(self) -> int:
        """See `Law`."""
        return sum(law.searches for law in self.passes)

    @property
    def impulse(self) -> None:
        """See `Law`."""
        return None

    @property
    def lam(self) -> Array:
        """Forces on the rows of the first pass, then of the second [N]; their sum is the total force."""
        return 0.5 * np.concatenate([law.lam for law in self.passes])

    @property
    def index(self) -> Array:
        """Numbers of the closed rows in `lam`, (na,)."""
        there, back = self.passes
        value: Array = np.r_[there.index, len(there.lam) + back.index]
        return value

    @property
    def row_nodes(self) -> Array:
        """Patch nodes of the rows, (nr,); nodes of the second slave are numbered after those of the first."""
        there, back = self.passes
        value: Array = np.r_[there.row_nodes, len(there.node_areas) + back.row_nodes]
        return value

    @property
    def node_areas(self) -> Array:
        """Half the areas of the rows of all patch nodes [m2]; their sum is the area of one side."""
        return 0.5 * np.concatenate([law.node_areas for law in self.passes])

    @property
    def node_pressures(self) -> sp.csr_matrix:
        """Matrix from forces of the rows, half of each side's, to pressures around all patch nodes [1/m2]."""
        return 2.0 * sp.block_diag([law.node_pressures for law in self.passes], format="csr")

    @property
    def traction(self) -> Array:
        """See `Law`; zero, for there is no friction in two passes."""
        return np.zeros((len(self.row_nodes), 3))

    @property
    def state(self) -> Array:
        """See `Law`."""
        value: Array = np.concatenate([law.state for law in self.passes])
        return value

    @property
    def slip_path(self) -> Array:
        """See `Law`."""
        return np.concatenate([law.slip_path for law in self.passes])

    @property
    def least_gap(self) -> float:
        """Smallest gap of both passes [m]."""
        return min(law.least_gap for law in self.passes)

    def resultant(self) -> Array:
        """Force on the slave of the first pass, (3,) [N]."""
        there, back = self.passes
        return 0.5 * (there.resultant() - back.resultant())

    def nodal_forces(self) -> list[Array]:
        """Forces on the nodes of the patches, in axes of space, (np, 3) for each side of the first pass [N]."""
        there, back = (law.nodal_forces() for law in self.passes)
        return [0.5 * (one + other) for one, other in zip(there, back[::-1], strict=True)]

    def forces_on_nodes(self, q: Array, nodes: Array, lam: Array, traction: Array) -> list[Array]:
        """See `Law`."""
        raise NotImplementedError("contact in two passes has no friction")

    def row_jacobian(self) -> Rows:
        """See `Law`; only carriers of rigid surfaces ask for it, and these contacts have one pass."""
        raise NotImplementedError("contact in two passes has rows of two kinds")

    def row_carrier(self) -> Array:
        """See `Law`, and `row_jacobian`."""
        raise NotImplementedError("contact in two passes has rows of two kinds")

    def on_carrier(self, point: Array) -> Array:
        """See `Law`, and `row_jacobian`."""
        raise NotImplementedError("contact in two passes has two partition bodies")

    def moment(self, point: Array) -> Array:
        """Moment on the slave of the first pass about a point in space, (3,) [N m]."""
        there, back = self.passes
        return 0.5 * (there.moment(point) - back.moment(point))

    def edge_reached(self) -> Array | None:
        """Place of a closed row at the edge of the contact patch, (3,) [m]; None if there is none."""
        places = [law.edge_reached() for law in self.passes]
        return next((place for place in places if place is not None), None)
