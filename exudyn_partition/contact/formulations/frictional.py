"""Bases of contact laws with friction: forces along the tangents too, and the memory of where each row stuck last."""

from __future__ import annotations

import copy
import math
from typing import TYPE_CHECKING

import numpy as np

from ...algebra.coulomb import Coulomb, coefficients
from ...algebra.friction import OPEN, SLIP
from ...errors import ComplementarityError
from ...frames.kinematics import Rows
from ...support.arrays import Array
from ..gaps import Gaps
from ..tangential import TangentialRows
from .formulation import Law, Motion
from .law import ContactLaw

if TYPE_CHECKING:
    from typing import Self


class FrictionalRows(ContactLaw):
    """Forces on rows with friction, along their normals and tangents.

    What the law remembers belongs to the end of the last accepted step: the forces on the rows, which of them slipped
    and how fast. It is kept by the slave's nodes, with tangential forces as vectors that turn with the master, so that
    it lives on when rows change. The coefficient of a row in a step follows from its state and slip speed then.

    Parameters
    ----------
    gaps : Gaps
    friction : Coulomb

    Attributes
    ----------
    tangential : TangentialRows
    forces : (nr, 3) array
        Forces on the present rows along the normal and both tangents [N]; the first column is `lam`.
    """

    _traction: Array

    def __init__(self, gaps: Gaps, friction: Coulomb) -> None:
        self.friction = self._law = friction
        self.tangential = TangentialRows(gaps)
        super().__init__(gaps)

    def fresh(self) -> Self:
        """Return the same law in its start state, for another run; constant data are shared."""
        result = copy.copy(self)
        result.gaps = self.gaps.fresh()
        result.tangential = self.tangential.fresh(result.gaps)
        result.reset()
        return result

    def reset(self) -> None:
        """Go back to the start."""
        super().reset()
        n = len(self._closed_nodes)
        self.tangential.release()
        self._last = np.zeros((n, 4))  # forces at the end of the last step: normal, and in the tangents' axes
        self._last_along: Array | None = None  # the tangents that `_last_on_rows` belong to
        self._traction_of: tuple[Array, Array] | None = None  # forces and tangents that `_traction` belongs to
        self._slipped, self._speed = np.zeros(n, dtype=bool), np.zeros(n)
        self._path = np.zeros(n)
        self._dissipated = 0.0

    def open_rows(self) -> Array:
        """Open all rows."""
        n = len(self.gaps.row_nodes)
        self.forces, self._state = np.zeros((n, 3)), np.full(n, OPEN, dtype=np.int8)
        return super().open_rows()

    def generalised(self) -> Array:
        """Generalised forces, (n,), from the present forces on the rows."""
        return self.tangential.generalised(self.forces) if self.index.size else self._zero

    def last_forces(self) -> Array:
        """Forces on the present rows at the end of the last accepted step, (nr, 3) [N]."""
        tangents = self.tangential.tangents  # other ones for each set of rows
        if self._last_along is not tangents:
            self._last_on_rows, self._last_along = self.on_rows(self._last), tangents
        return self._last_on_rows

    def on_rows(self, remembered: Array) -> Array:
        """Forces on the present rows, (nr, 3) [N], of those remembered by the slave's nodes, (np, 4)."""
        found = remembered[self.gaps.row_nodes]
        forces = np.empty((len(found), 3))
        forces[:, 0], forces[:, 1:] = found[:, 0], self.tangential.along(found[:, 1:] @ self.tangential.axes.T)
        return forces

    def coefficients(self) -> Array:
        """Coefficients of friction of the present rows in this step, (nr,)."""
        nodes = self.gaps.row_nodes
        return coefficients(self._law, self._slipped[nodes], self._speed[nodes])

    def remember(self, slips: Array, speeds: Array) -> None:
        """Remember the present forces and states for the next step.

        Parameters
        ----------
        slips : (nr, 2) array
            How far the rows have slipped in the step [m].
        speeds : (nr,) array
            Slip speed of the rows at its end [m/s].
        """
        nodes, slides = self.gaps.row_nodes, self.state == SLIP
        self._slipped[:], self._speed[:], self._last[:] = False, 0.0, 0.0
        self._path[nodes[slides]] += np.hypot(*slips[slides].T)
        self._slipped[nodes] = slides
        self._speed[nodes] = np.where(slides, speeds, 0.0)
        self._last[nodes, 0] = self.forces[:, 0]
        self._last[nodes, 1:] = self.traction @ self.tangential.axes
        self._last_along = None

    @property
    def traction(self) -> Array:
        """Tangential forces on the present rows in space, (nr, 3) [N]."""
        tangents = self.tangential.tangents
        if self._traction_of is None or self._traction_of[0] is not self.forces or self._traction_of[1] is not tangents:
            self._traction, self._traction_of = self.tangential.in_space(self.forces[:, 1:]), (self.forces, tangents)
        return self._traction

    def row_jacobian(self) -> Rows:
        """See `Law`; of gaps and tangential places."""
        return self.tangential.jacobian(self.index)

    def row_carrier(self) -> Array:
        """See `Law`; of gaps and tangential places."""
        return self.tangential.carrier_rows(self.index)

    def dissipated(self) -> float:
        """See `Law`."""
        return self._dissipated

    @property
    def state(self) -> Array:
        """See `Law`."""
        return self._state

    @property
    def slip_path(self) -> Array:
        """See `Law`; by the steps that were accepted."""
        path: Array = self._path
        return path

    def resultant(self) -> Array:
        """Force on the slave, (3,) [N]."""
        value: Array = self.gaps.resultant(self.lam) + self.traction.sum(axis=0)
        return value

    def nodal_forces(self) -> list[Array]:
        """Forces on the nodes of the patches, in axes of space, (np, 3) for each side [N]."""
        return self.tangential.nodal_forces(self.forces)

    def forces_on_nodes(self, q: Array, nodes: Array, lam: Array, traction: Array) -> list[Array]:
        """See `Law`."""
        self.gaps.at(q)
        row_of = np.full(len(self._closed_nodes), -1)
        row_of[self.gaps.row_nodes] = np.arange(len(self.gaps.row_nodes))
        rows, present = row_of[nodes], row_of[nodes] >= 0
        vectors = np.zeros((len(self.gaps.row_nodes), 3))
        vectors[rows[present]] = traction[present]
        forces = np.column_stack([np.zeros(len(vectors)), self.tangential.along(vectors)])
        forces[rows[present], 0] = lam[present]
        return self.tangential.nodal_forces(forces)

    def moment(self, point: Array) -> Array:
        """Moment on the slave about a point in space, (3,) [N m]."""
        if not self.index.size:
            return np.zeros(3)
        return self.gaps.moment_of(self.tangential.at_points(self.forces), point)


class FrictionalContact(FrictionalRows):
    """Forces on rows with friction that follow from the coordinates and from the last accepted step.

    Parameters
    ----------
    gaps : Gaps
    friction : Coulomb
    """

    remembers = True
    compliant = True

    def reset(self) -> None:
        """Go back to the start."""
        super().reset()
        self._start, self._answered, self._closed_before = -math.inf, False, False
        self._slid: tuple[Array, float] | None = None  # what `_sliding` has found for the present answer

    def evaluate(self, motion: Motion) -> Array:
        """See `Law`."""
        return self.force(motion.q)

    def force(self, q: Array) -> Array:
        """Generalised contact force, (n,), at the coordinates q, (n,), of slave and master."""
        self.answer(self.gaps.at(q))
        return self.generalised()

    def answer(self, gap: Array, pushed: Array | None = None) -> None:
        """Find the forces on the present rows from their gaps, (nr,) [m], and from how far they have slid.

        `pushed`, (nr, 3) [m], is what the forces of other contacts add to the gaps, and have added to the tangential
        places since the last accepted step.
        """
        self._answered, self._slid = True, None
        if not self.tangential.held:
            self.tangential.hold()
        self.least_gap = gap.min(initial=np.inf) if pushed is None else (gap + pushed[:, 0]).min(initial=np.inf)
        if math.isnan(self.least_gap):
            raise ComplementarityError("the gaps are not finite: the run has become unstable")
        if self.least_gap >= 0.0:
            if self.index.size or len(self.lam) != len(gap):
                self.open_rows()
            return
        self._find(gap, np.zeros((len(gap), 3)) if pushed is None else pushed)

    def _find(self, gap: Array, pushed: Array) -> None:
        """Find `forces` and `state` of the present rows, some of which are closed."""
        raise NotImplementedError

    def slips(self) -> Array:
        """How far the present rows have slipped since the last accepted step, (nr, 2) [m]; of open rows, have moved."""
        raise NotImplementedError

    def commit(self, start: float) -> None:
        """Begin a step at time `start` [s]: remember the forces and states at the end of the step before."""
        if self._answered and start > self._start:
            self._remember(start - self._start)
        self._start, self._answered = start, False

    def flies_on(self, start: float) -> bool:
        """See `Law`."""
        if not self._answered or self.index.size or self._closed_before or self.yielding is not None:
            return False
        self._start = start
        self.tangential.hold(soon=False)
        return True

    def _remember(self, step: float) -> None:
        closed = self.index.size > 0
        if closed or self._closed_before:
            self._remember_forces(step)
        self._closed_before = closed
        self.tangential.hold(soon=closed)

    def _remember_forces(self, step: float) -> None:
        slips = np.zeros((len(self.forces), 2))
        if self.index.size:
            slips, taken = self._sliding()
            self._dissipated += taken
        self.remember(slips, np.hypot(*slips.T) / step)

    def resume(self, earlier: Law, q: Array) -> bool:
        """See `Law`: rows stick where they stuck, with the forces that they had; the dissipation begins anew."""
        if not isinstance(earlier, FrictionalContact) or not earlier.index.size:
            return False
        if not earlier.ended_at(q):
            return False
        nodes = earlier.gaps.row_nodes
        self._last[nodes, 0] = earlier.forces[:, 0]
        self._last[nodes, 1:] = earlier.traction @ earlier.tangential.axes
        self._last_along, self._closed_before = None, True
        self.gaps.at(q)
        self.tangential.hold()
        return True

    def _sliding(self) -> tuple[Array, float]:
        """How far rows have slipped since the last accepted step, (nr, 2) [m], and the energy that it takes [J].

        By the trapezoid: the force at the end of the step alone would take too much or too little.
        """
        if self._slid is None:
            slips = self.slips()
            self._slid = slips, -0.5 * float(np.vdot(slips, (self.last_forces() + self.forces)[:, 1:]))
        return self._slid

    def dissipated(self) -> float:
        """See `Law`."""
        return self._dissipated + (self._sliding()[1] if self._answered and self.index.size else 0.0)
