"""A formulation of one's own, made here alone: a linear spring on each row, used through the public functions."""

import exudyn as exu
import numpy as np
import pytest
import scipy.linalg
from oracles import TOP

import exudyn_partition as ep
from exudyn_partition.contact.formulations.formulation import Formulation
from exudyn_partition.contact.law import Forces, Law
from exudyn_partition.errors import InputError

STIFFNESS = 2e6  # of each row [N/m]


class Spring(Law):
    """Each row pushes with a stiffness times the depth that its gap is closed."""

    def answer(self, at):
        """Forces by gaps."""
        lam = STIFFNESS * np.maximum(-at.gap, 0.0)
        self.closed = np.flatnonzero(lam)
        return Forces(lam[:, None], self.closed)

    def stiffness(self):
        """Of the closed rows."""
        return STIFFNESS * np.eye(len(self.closed))

    def closed_stiffness(self, rows):
        """Stiffness with all rows closed."""
        H = rows.jacobian(np.arange(len(rows.gaps.row_nodes)))
        return STIFFNESS * (H.T @ H)

    def fresh(self, rows):
        """Nothing is kept."""
        return Spring()


class Springs(Formulation):
    """Springs on the rows of any basis."""

    rows = "node-to-segment"

    def law(self, rows):
        """The law of a contact with these rows."""
        return Spring()


def strike(bodies, method="explicit", formulation=None, **options):
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP, initialVelocity=[0, 0, -0.5], **options)
    block = ep.CreatePartitionBody(mbs, bodies[1])
    contact = ep.CreatePartitionContact(mbs, ball, block, formulation=formulation or Springs(), name="tip")
    mbs.Assemble()
    return ep.solve_dynamic(mbs, end_time=80e-6, step=0.1e-6, method=method), (ball, block), contact


@pytest.mark.filterwarnings("ignore:contact 'tip' reached the edge of its patch")
@pytest.mark.parametrize(
    ("method", "frame"), [("explicit", "inertial"), ("implicit", "inertial"), ("explicit", "floating")]
)
def test_springs_on_rows_conserve_and_are_springs(bodies, method, frame):
    result, items, contact = strike(bodies, method, frame=frame)
    force = contact.force(result)
    assert force.max() > 100
    # What each row's force is, by the coordinates alone.
    gaps = contact.law.gaps.fresh()
    q = np.hstack([item.coordinates(result) for item, _ in contact.sides])
    depths = [np.maximum(-gaps.at(x), 0.0) for x in q]
    np.testing.assert_allclose(force, [STIFFNESS * depth.sum() for depth in depths], rtol=1e-6, atol=1e-6 * force.max())
    stored = [STIFFNESS * (depth**2).sum() / 2 for depth in depths]
    np.testing.assert_allclose(contact.energy(result), stored, rtol=1e-6, atol=1e-6 * max(stored))
    momentum = sum(item.momentum(result) for item in items)
    assert abs(momentum - momentum[0]).max() < 1e-6 * abs(momentum[0]).max()
    energy = sum(item.energy(result) for item in items) + contact.energy(result)
    assert abs(energy / energy[0] - 1).max() < 2e-3
    np.testing.assert_allclose(contact.row_forces(result).sum(axis=1).A1, force, rtol=1e-12)


def test_the_stability_limit_knows_the_springs(bodies):
    """That of the dense matrices."""
    mbs = exu.SystemContainer().AddSystem()
    items = [ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP), ep.CreatePartitionBody(mbs, bodies[1])]
    mbs.Assemble()
    free = ep.stability_limit(mbs)
    contact = ep.CreatePartitionContact(mbs, *items, formulation=Springs())
    K = scipy.linalg.block_diag(*(item.body.stiffness.toarray() for item, _ in contact.sides))
    H = contact.law.gaps.jacobian(np.arange(contact.n_rows))
    highest = np.linalg.eigvalsh(K + STIFFNESS * H.T @ H)[-1]
    assert ep.stability_limit(mbs) == pytest.approx(2 / np.sqrt(highest), rel=1e-6)
    assert ep.stability_limit(mbs) < free


def test_work_is_counted(bodies):
    """Implicit steps tell of Newton's method; nothing slides, so that pairs are those of the start."""
    result, *_ = strike(bodies, "implicit")
    assert result.work.newton_iterations >= result.steps
    assert 0 < result.work.jacobians < result.work.newton_iterations
    assert 0 < result.work.contact_s < result.time_s
    assert result.work.active_set_iterations == result.work.pair_searches == 0
    by_flexibility, _, contact = strike(bodies, formulation="compliance")
    assert by_flexibility.work.active_set_iterations >= np.count_nonzero(contact.force(by_flexibility)[:-1])
    assert by_flexibility.work.newton_iterations == 0


def test_what_is_no_formulation_is_refused(mbs, bodies):
    items = [ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP), ep.CreatePartitionBody(mbs, bodies[1])]
    with pytest.raises(InputError, match="formulation: expected one of 'compliance', 'lagrange', 'penalty'"):
        ep.CreatePartitionContact(mbs, *items, formulation=object())
