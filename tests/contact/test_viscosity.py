"""Viscous flexibilities with friction against fields of displacements by brute force, and what is left of them."""

import numpy as np
import pytest
from oracles import broken_law

import exudyn_partition as ep
from exudyn_partition.algebra.friction import SLIP, STICK
from exudyn_partition.algebra.products import dense
from exudyn_partition.contact.formulations.choices import Compliance
from exudyn_partition.contact.patch_contact import PatchContact
from exudyn_partition.contact.patch_gaps import PatchGaps
from exudyn_partition.contact.rigid import RigidGaps, RigidPlane
from exudyn_partition.contact.side import Side
from exudyn_partition.contact.viscosity import moved as displacements
from exudyn_partition.frames.inertial import InertialKinematics

MU, BETAS = 0.3, (2e-6, 0.5e-6)  # times of ball and plate [s]
STEPS = [  # lengths [us] and ways of the ball [um]: down, aside with stick and slip, at rest, up, away, and down again
    (0.4, (0, 0, -9)), (0.401, (0.3, 0, -9.5)), (0.8, (2.0, 0.8, -9)), (3.0, (2.0, 0.8, -9)), (0.2, (1.2, 1.2, -7)),
    (0.3, (1.2, 1.2, 3)), (0.5, (1.2, 1.2, -5)),
]  # fmt: skip


@pytest.fixture(scope="module", params=[1, 2], ids=["plane", "plate"])
def contact(round_body, flat_body, request):
    """A ball on a rigid plane, or on a plate whose flexibility has another time."""
    both = zip((round_body, flat_body), BETAS, strict=True)
    sides = [Side.of(InertialKinematics(body, np.zeros(3)), beta=beta) for body, beta in both]
    gaps = RigidGaps(sides[0], RigidPlane()) if request.param == 1 else PatchGaps(*sides)
    return PatchContact(gaps, Compliance(), ep.Coulomb(MU)).for_run()


def coordinates(contact, way):
    q = np.zeros(contact.gaps.n)
    ball = contact.gaps.sides[0].kinematics.body
    q[: ball.n_dofs] = ball.rigid[:, :3] @ np.multiply(way, 1e-6)
    return q


def test_forces_energy_and_work_are_those_of_fields_of_displacements(contact):
    """Each side has displacements u of its nodes with u + beta u' = F G' lambda, by implicit steps of Euler's method.

    Tangential places count from the end of the last step, where displacements are not zero.
    """
    law = contact.for_run()
    sides = range(len(law.gaps.sides))
    G, F = [law.rows.side_rows(side) for side in sides], [np.asarray(side.flexibility) for side in law.gaps.sides]
    H = dense(law.rows.jacobian(np.arange(len(law.gaps.row_nodes))))
    u, last_q, t = [np.zeros(len(own)) for own in F], coordinates(law, (0, 0, 0)), 0.0
    elastic = last = np.zeros((len(sides), len(law.gaps.row_nodes), 3))
    work = rubbed = 0.0
    states = set()
    for step, way in STEPS:
        law.accept(t, t + 1e-6 * step)
        t, q = t + 1e-6 * step, coordinates(law, way)
        law.at(q)
        share = [1e-6 * step / (1e-6 * step + beta) for beta in BETAS[: len(sides)]]
        whole = sum(share[s] * G[s] @ F[s] @ G[s].T for s in sides)
        before = [(G[s] @ u[s]).reshape(-1, 3) for s in sides]
        h = (H @ (q - last_q)).reshape(-1, 3) - sum(share[s] * before[s] for s in sides)
        h[:, 0] = law.gaps.at(q) + sum((1 - share[s]) * before[s][:, 0] for s in sides)
        lam = law.evaluation.on_rows
        assert broken_law(whole, h, np.full(len(h), MU), lam) < 1e-6
        u = [share[s] * F[s] @ (G[s].T @ lam.ravel()) + (1 - share[s]) * u[s] for s in sides]
        elastic = [share[s] * lam + (1 - share[s]) * elastic[s] for s in sides]
        now = [(G[s] @ u[s]).reshape(-1, 3) for s in sides]
        stored = 0.5 * sum(np.vdot(elastic[s], now[s]) for s in sides)
        work += 0.5 * sum(np.vdot(lam + last[0], now[s] - before[s]) for s in sides)
        slips = (h + (whole @ lam.ravel()).reshape(-1, 3))[:, 1:]
        if law.evaluation.index.size:
            rubbed -= 0.5 * np.vdot((lam + last[0])[:, 1:], slips)
        assert law.evaluation.stored == pytest.approx(stored, rel=1e-5)
        assert law.evaluation.viscous_work == pytest.approx(work - stored, rel=1e-5)
        assert law.evaluation.dissipated == pytest.approx(rubbed, rel=1e-5, abs=1e-6 * stored)
        last, last_q = [lam.copy()], q
        states |= {*law.evaluation.status}
    assert not law.gaps.moving
    assert {STICK, SLIP} < states
    assert law.evaluation.viscous_work > 0.5 * stored > 0


def test_what_is_closed_ahead_of_the_first_step_is_at_rest(contact):
    """Exudyn asks for forces before it begins: nothing moves then, and nothing creeps in the first steps."""
    law, q = contact.for_run(), coordinates(contact, (0, 0, -9))
    law.accept(0.0, 0.0)
    law.at(q)
    at_rest = law.evaluation.on_rows.copy()
    assert at_rest.any()
    for start, end in ((0.0, 1e-6), (1e-6, 1.3e-6)):
        law.accept(start, end)
        law.at(q)
        np.testing.assert_allclose(law.evaluation.on_rows, at_rest, atol=1e-6 * at_rest.max())
        assert law.evaluation.viscous_work < 1e-9 * law.evaluation.stored


def test_nothing_is_left_after_a_long_time(contact):
    """Elastic forces fade by 1 / (1 + h / beta) in a step; then runs are as before the impact, but for the energy."""
    law, t = contact.for_run(), 0.0
    for way in [(0, 0, -3)] + 70 * [(0, 0, 50)]:
        law.accept(t, t + 1e-6)
        t += 1e-6
        law.at(coordinates(law, way))
    law.accept(t)
    assert not law.state.creep.elastic


@pytest.mark.parametrize("friction", [None, ep.Coulomb(MU)])
def test_sides_of_a_body_that_touches_itself_move_each_other(round_body, flat_body, friction):
    """Both together are moved by the flexibility of the rows, which is symmetric; what goes across is not."""
    sides = [Side.of(InertialKinematics(body, np.zeros(3))) for body in (round_body, flat_body)]
    size = 1e-3 * abs(np.asarray(sides[0].flexibility)).max()
    shape = [len(np.asarray(side.flexibility)) for side in sides]
    between = size * np.random.default_rng(0).standard_normal(shape)
    gaps = PatchGaps(*sides, between=between)
    rows = PatchContact(gaps, Compliance(), friction).rows
    gaps.at(np.zeros(gaps.n))
    forces = [np.random.default_rng(n).standard_normal((len(gaps.row_nodes), rows.d)) for n in (1, 2)]
    G = [dense(rows.side_rows(side)) for side in (0, 1)]
    own = [G[s] @ np.asarray(sides[s].flexibility) @ (G[s].T @ forces[s].ravel()) for s in (0, 1)]
    right = (
        own[0] + G[0] @ between @ (G[1].T @ forces[1].ravel()),
        own[1] + G[1] @ between.T @ (G[0].T @ forces[0].ravel()),
    )
    for found, expected in zip(displacements(rows, forces), right, strict=True):
        np.testing.assert_allclose(found.ravel(), expected, rtol=0, atol=1e-9 * abs(expected).max())
    assert abs(right[0] - own[0]).max() > 1e-3 * abs(own[0]).max()
