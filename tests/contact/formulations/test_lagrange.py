"""Multipliers of explicit steps: the solver that they need, and redundant rows."""

from types import SimpleNamespace

import numpy as np
import pytest
from oracles import TOP, multipliers

from exudyn_partition.contact.formulations.explicit_multipliers import ForwardIncrement, ForwardRows
from exudyn_partition.contact.gaps import GapState
from exudyn_partition.contact.patch_gaps import PatchGaps
from exudyn_partition.contact.side import Side
from exudyn_partition.errors import (
    RunError,
)
from exudyn_partition.frames.inertial import InertialKinematics


def sides(bodies, slave_at=TOP):
    """Patches of two bodies, the first shifted."""
    return [
        Side.of(InertialKinematics(body, np.array(at))) for body, at in zip(bodies, (slave_at, (0, 0, 0)), strict=True)
    ]


@pytest.fixture(scope="module")
def nodal(pair_of):
    """Ball and block in the paper's basis."""
    return pair_of("free")


def test_multipliers_notice_a_solver_that_is_not_central_differences(nodal):
    gaps = PatchGaps(*sides(nodal), "node-to-segment")
    law = multipliers(gaps)
    q = np.zeros(sum(body.n_dofs for body in nodal))
    v = np.concatenate([-nodal[0].rigid[:, 2], np.zeros(nodal[1].n_dofs)])
    h, rows = 1e-9, ForwardRows(law)
    together = ForwardIncrement([rows], [np.arange(len(q))])
    (c,), answers = together.increment([rows.begin()], [(q, v, 0 * q)], h)
    gap = gaps.stage.linear.start + gaps.stage.linear.H @ (q + h * (v + h * c))
    assert gap.min() > -1e-18
    together.increment(answers, [(q + h * (v + h * c), v, 0 * q)], h)  # the step that central differences take
    with pytest.raises(RunError, match="needs Exudyn's explicit solver VelocityVerlet"):
        together.increment(answers, [(q + h * v, v, 0 * q)], h)


class FlatSides(tuple):
    """Sides of a plate of two coordinates."""

    def moved(self, q, way):
        return q + way

    def accelerations(self, q, rows):
        return rows.T / np.array([[2.0], [0.5]])  # mass and inertia


class FlatRows:
    """Gaps of a plate of two coordinates, heave and tilt, on forty rows: all but two are redundant."""

    n, size, moving, row_nodes, sides = 2, 1.0, False, np.arange(40), FlatSides()
    H = np.column_stack([np.ones(40), np.linspace(-1, 1, 40)])
    slave = SimpleNamespace(surface=SimpleNamespace(points=np.zeros((40, 3))))

    def after(self):
        return GapState(np.zeros(2), np.empty(0))

    stage = SimpleNamespace(
        linear=None, rows=None, normal=np.tile([0.0, 0.0, 1.0], (40, 1)),
        resultant=lambda lam: np.array([0.0, 0.0, lam.sum()]),
    )  # fmt: skip
    present = SimpleNamespace(stage=stage, q=None)

    def return_to(self, present):
        """The rows are never elsewhere."""

    def accept(self, state):
        self.accepted = state

    def begin(self, state=None):
        self.accepted = self.after()

    def at(self, q):
        return self.H @ q

    def jacobian(self, index):
        return self.H[index]

    def generalised(self, lam):
        return lam @ self.H


def test_redundant_rows_have_a_unique_total_force():
    """The plate falls flat: the impulse of all multipliers together stops it in a step."""
    law, h, mass = multipliers(FlatRows()), 1e-3, 2.0
    falling = np.zeros(2), np.array([-1.0, 0.0]), np.zeros(2)
    rows = ForwardRows(law)
    (push,), (answer,) = ForwardIncrement([rows], [np.arange(2)]).increment([rows.begin()], [falling], h)
    lam = answer.forces.on_rows[:, 0]
    assert lam.sum() == pytest.approx(mass * 1.0 / h, rel=1e-8)
    assert answer.impulse[0] == pytest.approx(mass * 1.0, rel=1e-8)
    np.testing.assert_allclose(push, [1.0 / h, 0.0], atol=1e-6 / h)
    assert (lam >= 0).all()
