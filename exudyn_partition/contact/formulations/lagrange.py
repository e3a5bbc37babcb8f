"""Contact by Lagrange multipliers on nodal coordinates, forward-increment central differences (paper, eq. 21-28).

Theory: examples/site/theory.md, "Explicit steps".
"""

from __future__ import annotations

import numpy as np

from ...algebra.complementarity import regularised
from ...algebra.coulomb import Coulomb
from ...algebra.friction import OPEN, SLIP, STICK
from ...algebra.products import dense
from ...errors import RunError
from ...frames.kinematics import Rows
from ...support.arrays import Array
from ..gaps import Gaps
from ..plasticity.nodal_zones import NodalZones
from .formulation import Law, Method, Motion
from .frictional import FrictionalRows
from .law import ContactLaw
from .stabilised import FrictionalStabilised, StabilisedContact

_CLOSED = 1e-3  # of a facet's size, to which gaps stay closed where points cross edges between facets
_SOONER = 10  # times sooner than it grew, the error of frozen pairs goes when they are followed
_SOONEST = 20  # steps in which it goes


def _not_central_differences(reason: str) -> RunError:
    return RunError(
        f"{reason}: contact with formulation 'lagrange' needs Exudyn's explicit solver VelocityVerlet with a constant "
        "step (solve_dynamic(..., method='explicit')), or its solver generalized-alpha (method='implicit')"
    )


class LagrangeContact(ContactLaw):
    """Multipliers for the paper's basis. They make all gaps zero or positive at the end of the step.

    Eq. 24 alone sets the relative acceleration to zero. A node that has just touched would keep its approach velocity
    and drift into penetration. Here lambda_n >= 0 and g(q_{n+1}) >= 0 are complementary: this is the forward-increment
    form (Carpenter, Taylor, Katona 1991) of the same central differences. Pairs are those at the predicted q_{n+1}.
    `forward_increment.ForwardIncrement` computes lambda for one contact or several.

    Where frozen pairs have slid and are followed from now on, gaps jump. Multipliers would close a jump within one
    step, by an impact that is none. So the difference to the frozen gaps is taken off, and fades in many steps.

    Parameters
    ----------
    gaps : Gaps

    Attributes
    ----------
    G, push : (nr, n), (n, nr) arrays or csr matrices
        Present rows, and the accelerations M^-1 G' that unit forces on the rows cause.
    F : (nr, nr) array
        G M^-1 G', with a small addition on the diagonal, because rows may be redundant.
    """

    ahead = True

    def for_run(self, method: Method) -> Law:
        """Return this law for explicit runs, or `StabilisedContact` for implicit ones; none is for statics."""
        if method == "static":
            raise RunError(
                "contact with formulation 'lagrange' has no statics, for its multipliers act on velocities: it needs "
                "Exudyn's explicit solver VelocityVerlet, or generalized-alpha (solve_dynamic). Take a basis with "
                "residual flexibility and formulation='compliance' for static runs, or press slowly in a damped run"
            )
        return StabilisedContact(self.gaps.fresh()) if method == "implicit" else self.fresh()

    def reset(self) -> None:
        """Go back to the start."""
        super().reset()
        self._expected: Array | None = None
        self._held: object = None
        self._jump, self._fading = np.zeros(len(self._closed_nodes)), 1.0  # what is left at the slave's nodes [m]
        self._frozen_steps = 0
        self.take_rows()

    def take_rows(self) -> bool:
        """Compute G, `push` and F of the present rows; return whether the rows have changed."""
        gaps = self.gaps
        if not gaps.moving and self._held is gaps.held:
            return False
        self.G = self._jacobian(np.arange(len(gaps.row_nodes)))
        self.push = gaps.accelerations(self.G)
        self.F = regularised(dense(self.G @ self.push))  # between flat patches there are more rows than coordinates
        self._held = gaps.held
        return True

    def _jacobian(self, index: Array) -> Rows:
        """Derivative of what multipliers act along, (na, n), of some rows by the coordinates."""
        return self.gaps.jacobian(index)

    @property
    def guess(self) -> Array:
        """Present rows that were closed in the last step, (nr,) bool."""
        return self._closed_nodes[self.gaps.row_nodes]

    def predict(self, q: Array, q_t: Array, q_tt: Array, step: float) -> Array:
        """Gaps, (nr,) [m], at the end of the coming step without contact forces.

        Parameters
        ----------
        q, q_t, q_tt : (n,) arrays
            Coordinates of slave and master, their velocities, and their accelerations without contact.
        step : float
            Length of the step [s].
        """
        gaps, frozen, nodes = self.gaps, self.gaps.linear, self.gaps.row_nodes
        self._check_last_step(q)  # which may find that the pairs have slid out of reach
        to = gaps.moved(q, step * q_t + 0.5 * step**2 * q_tt)
        gap = gaps.at(to)
        self._jump *= self._fading
        self._frozen_steps += 1
        if gaps.moving:
            if frozen is not None:
                start, before = gaps.of_present(q), np.zeros(len(self._jump))
                before[gaps.row_nodes] = np.maximum(start, 0.0)  # a row that was not there may be closed already
                before[nodes] = frozen.start + frozen.H @ q
                self._jump[gaps.row_nodes] += start - before[gaps.row_nodes]
                gap = gaps.at(to)
                self._fading = 1 - 1 / max(self._frozen_steps / _SOONER, _SOONEST)
            self._frozen_steps = 0
        gap = gap - self._jump[gaps.row_nodes]
        self._expected, self._predicted, self.least_gap = None, (to, gap), gap.min(initial=np.inf)
        return gap

    def open(self) -> None:
        """Leave all rows open in the coming step."""
        self.open_rows()

    def close(self, lam: Array, index: Array, gap: Array, scale: float) -> None:
        """Apply lam, (nr,) [N], to the rows `index` in the coming step.

        At its end the gaps are `gap`, (nr,) [m]. `scale` [m] is the largest change of a gap by one multiplier.
        """
        self.close_rows(lam, index)
        self._expected, self._scale = gap, scale

    @property
    def _rows(self) -> Rows:
        """Derivative of the gaps of the rows that `take_rows` has taken, (nr, n)."""
        return self.G

    def _check_last_step(self, q: Array) -> None:
        """Raise unless the last step moved the gaps as central differences with these multipliers do.

        With the pairs of that step: points that cross an edge between facets have other gaps than those.
        """
        if self._expected is None:
            return
        start, free = self._predicted
        gap = free + self._rows @ self.gaps.way(start, q)
        round_off = 1e-12 * (abs(q).max() + abs(gap).max())
        if abs(gap - self._expected).max() > 1e-3 * self._scale + round_off:
            raise _not_central_differences("the last step did not close the gaps as predicted")

    def check(self, q: Array) -> None:
        """Raise if a gap at coordinates q, (n,), is deep."""
        gap = self.gaps.of_present(q)
        faded = (1 / self._fading - 1) * abs(self._jump).max(initial=0.0)  # since the step that ended here
        deepest = (gap - self._jump[self.gaps.row_nodes]).min(initial=0.0)
        if deepest < -_CLOSED * self.gaps.size - faded:
            raise RunError(
                f"a gap is {deepest:.3g} m after a step whose multipliers should have closed it: in the step, points "
                "slid over edges between facets, where normals jump. Take a shorter step or a finer mesh of the master"
            )


class FrictionalLagrange(FrictionalRows, LagrangeContact):
    """Multipliers along normals and tangents. A row that sticks does not move along its tangents in the coming step.

    The gaps at the end of the step are zero or positive. With s the way that a row slides in the step::

        |lambda_t| <= mu lambda_n,    s = 0 where |lambda_t| < mu lambda_n,

    and where |lambda_t| = mu lambda_n, s is opposite to lambda_t. `forward_increment.FrictionalIncrement` computes
    lambda.

    In central differences, lambda acts at the start of the step. Friction takes its impulse times the mean of the slip
    rates half a step before and after: the change of kinetic energy. That includes what nodes with mass lose along the
    surface when they touch and stick at once. The coefficient follows from the step before. So do the places of a
    rigid surface that a body carries.

    Parameters
    ----------
    gaps : Gaps
    friction : Coulomb

    Attributes
    ----------
    G, push, F
        Of the three directions of each row, (3 nr, n), (n, 3 nr) and (3 nr, 3 nr).
    """

    def for_run(self, method: Method) -> Law:
        """Return this law for explicit runs, or `stabilised.FrictionalStabilised` for implicit ones."""
        return FrictionalStabilised(self.gaps.fresh(), self._law) if method == "implicit" else super().for_run(method)

    def reset(self) -> None:
        """Go back to the start."""
        super().reset()
        self._pose: Array | None = None

    def evaluate(self, motion: Motion) -> Array:
        """See `Law`; the force element applies no force."""
        return self._zero

    def _jacobian(self, index: Array) -> Rows:
        return self.tangential.jacobian(index)

    @property
    def _rows(self) -> Rows:
        return self.G[::3]

    def predict(self, q: Array, q_t: Array, q_tt: Array, step: float) -> Array:
        """Gaps at the end of the coming step, and ways along the tangents in it, (3 nr,) [m], without contact forces.

        The ways of rows that are far away are not computed.
        """
        gap = super().predict(q, q_t, q_tt, step)
        pose = self.gaps.evaluated_pose
        places, self._step, self._q_tt = np.zeros((len(gap), 3)), step, q_tt
        places[:, 0] = gap
        if self.least_gap < self.gaps.size:
            self.tangential.hold_at(q, pose if self._pose is None else self._pose)
            places[:, 1:] = self.tangential.way()
        self._pose, self._free = pose, places[:, 1:]
        return places.ravel()

    @property
    def last_states(self) -> Array:
        """Whether the present rows were open, stuck or slipped in the last step, (nr,) int8."""
        nodes = self.gaps.row_nodes
        closed = np.where(self._slipped[nodes], SLIP, STICK)
        return np.where(self._last[nodes, 0] > 0, closed, OPEN).astype(np.int8)

    def open(self) -> None:
        """Leave all rows open in the coming step."""
        if self.index.size:
            super().open()
            self.remember(np.zeros((len(self.forces), 2)), np.zeros(len(self.forces)))

    def act(self, forces: Array, state: Array, places: Array, scale: float) -> None:
        """Apply forces, (nr, 3) [N], to the rows in the coming step.

        Parameters
        ----------
        forces : (nr, 3) array
        state : (nr,) int8 array
            Whether rows are open, stick or slip.
        places : (nr, 3) array
            Gaps at the end of the step, and ways along the tangents in it [m].
        scale : float
            See `close`.
        """
        self.close(forces[:, 0], np.flatnonzero(state), places[:, 0], scale)
        self.forces, self._state, slips = forces, state, places[:, 1:]
        if self.index.size:
            before = self._free - self._step**2 * np.asarray(self.G @ self._q_tt).reshape(-1, 3)[:, 1:]
            self._dissipated -= 0.5 * float(np.sum(forces[:, 1:] * (before + slips)))
        self.remember(slips, np.linalg.norm(slips, axis=1) / self._step)


class _YieldingNodes(LagrangeContact):
    """Multipliers on patches above plastic zones whose nodes have mass; the force element applies the pseudo-forces.

    The state of the zones follows from the coordinates at the end of each step, so that steps are as long as those of
    elastic zones: plastic flow only softens them.
    """

    remembers = True
    yielding: NodalZones

    def __init__(self, gaps: Gaps, *options: Coulomb) -> None:
        self.yielding = NodalZones([(n, side.zone) for n, side in enumerate(gaps.sides) if side.zone is not None])
        super().__init__(gaps, *options)

    def for_run(self, method: Method) -> Law:
        """Return this law for explicit runs; there is none for others."""
        if method != "explicit":
            raise RunError(
                f"method: {method!r} knows no plastic zones of basis 'free'. Take method='explicit', or basis "
                "'contact-adapted' or 'residual' with formulation='compliance'"
            )
        result = self.fresh()
        result.yielding = self.yielding.fresh()
        return result

    def reset(self) -> None:
        """Go back to the start."""
        super().reset()
        self._start, self._at = -np.inf, np.empty(0)

    def evaluate(self, motion: Motion) -> Array:
        """See `Law`; of the zones alone."""
        self._at = motion.q
        return self.yielding.forces(self.gaps.split(self._at))

    def stored(self) -> float:
        """See `Law`."""
        return self.yielding.stored()

    def commit(self, start: float) -> None:
        """See `Law`."""
        if start > self._start > -np.inf:
            self.yielding.commit()
        self._start = start

    def resume(self, earlier: Law, q: Array) -> bool:
        """See `Law`."""
        if not isinstance(earlier, _YieldingNodes) or not np.array_equal(earlier._at, q):
            return False
        self.yielding.resume(earlier.yielding)
        return True


class PlasticLagrange(_YieldingNodes):
    """Frictionless multipliers on patches that yield."""


class PlasticFrictionalLagrange(_YieldingNodes, FrictionalLagrange):
    """Multipliers with friction on patches that yield."""
