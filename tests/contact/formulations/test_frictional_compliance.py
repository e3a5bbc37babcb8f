"""Friction with residual flexibility or a penalty's layer: stick, slip, dissipation and tangents."""

import numpy as np
import pytest
from oracles import compliant, floating, moved, relative
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.algebra.complementarity import regularised
from exudyn_partition.algebra.friction import SLIP, STICK, FrictionProblem
from exudyn_partition.algebra.products import dense
from exudyn_partition.contact.formulations.choices import Compliance, Penalty
from exudyn_partition.contact.patch_contact import PatchContact
from exudyn_partition.contact.patch_gaps import PatchGaps
from exudyn_partition.contact.rigid import RigidGaps, RigidPlane
from exudyn_partition.contact.side import Side
from exudyn_partition.frames.inertial import InertialKinematics

DEPTH = 1e-6  # [m]
MU = 0.3


@pytest.fixture(scope="module", params=[Compliance, Penalty])
def law(round_body, flat_body, request):
    """Ball on plate, at their places of the start."""
    sides = [Side.of(InertialKinematics(body, np.zeros(3))) for body in (round_body, flat_body)]
    return PatchContact(PatchGaps(*sides), request.param(), ep.Coulomb(MU))


def pressed(law, along=(0.0, 0.0)):
    """Coordinates with the slave pressed in by DEPTH, and shifted along the plane."""
    slave = law.gaps.sides.bodies[0]
    way = np.array([*along, -DEPTH])
    return np.concatenate([slave.rigid[:, :3] @ way, np.zeros(law.gaps.sides.bodies[1].n_dofs)])


def begin(law):
    """A fresh law that was pressed in without sliding, and has accepted that."""
    law = law.for_run()
    law.at(np.zeros(law.gaps.n))
    law.accept(0.0)
    law.at(pressed(law))
    law.accept(1.0)
    return law


def tangential(law):
    return law.evaluation.traction.sum(axis=0)


def test_a_small_shift_sticks_and_pulls_back(law):
    law = begin(law)
    before = tangential(law)
    law.at(pressed(law, (1e-3 * DEPTH, 0)))
    inner = law.evaluation.status == STICK
    assert inner.sum() > len(law.evaluation.index) / 2
    pull = tangential(law) - before
    assert pull[0] < 0
    assert abs(pull[1:]).max() < 0.05 * abs(pull[0])


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.6, -0.8)])
def test_a_large_shift_slips_at_the_limit_against_its_direction(law, direction):
    law = begin(law)
    law.at(pressed(law, 5 * DEPTH * np.array(direction)))
    assert (law.evaluation.status[law.evaluation.index] == SLIP).all()
    limit = MU * law.evaluation.lam.sum()
    np.testing.assert_allclose(tangential(law)[:2], -limit * np.array(direction), atol=2e-2 * limit)
    np.testing.assert_allclose(
        np.linalg.norm(law.evaluation.traction[law.evaluation.index], axis=1),
        MU * law.evaluation.lam[law.evaluation.index],
        rtol=1e-8,
    )


def test_secants_of_slips_times_the_way_are_friction(law):
    law = begin(law)
    shift = pressed(law, (3 * DEPTH, -4 * DEPTH)) - pressed(law)
    law.at(pressed(law) + shift)
    H = dense(law.evaluation.row_jacobian())
    opposing, friction = (
        -law.evaluation.slip_secants(H) @ shift,
        H.T @ np.where([0, 1, 1], law.evaluation.on_rows[law.evaluation.index], 0.0).ravel(),
    )
    np.testing.assert_allclose(opposing, friction, atol=2e-2 * abs(friction).max())


def test_secants_of_a_row_in_the_middle_of_a_turn_are_bounded(round_body):
    """Its way is nearly zero: it counts as a thousandth of the longest way."""
    gaps = RigidGaps(Side.of(InertialKinematics(round_body, np.zeros(3))), RigidPlane(), "node-to-segment")
    law, rigid = compliant(gaps, ep.Coulomb(1e-7)), round_body.rigid  # everything slips
    law.at(rigid[:, 2] * -8 * DEPTH)
    middle = law.evaluation.index[
        np.linalg.norm(gaps.slave.surface.points[law.gaps.row_nodes[law.evaluation.index], :2], axis=1).argmin()
    ]
    law.accept(0.0)
    rows = dense(law.rows.jacobian(np.array([middle])))[1:]
    turn, aside = 1e-2 * rigid[:, 5], np.array([1e-5, 0]) * DEPTH
    law.at(rigid[:, 2] * -8 * DEPTH + turn + rigid[:, :2] @ np.linalg.solve(rows @ rigid[:, :2], aside - rows @ turn))
    assert (law.evaluation.status[law.evaluation.index] == SLIP).all()
    ways, friction = (
        np.hypot(*law.rows.way()[law.evaluation.index].T),
        np.hypot(*law.evaluation.on_rows[law.evaluation.index, 1:].T),
    )
    assert ways.min() < 1e-4 * ways.max()
    found = np.trace(
        law.evaluation.slip_secants(np.eye(3 * len(ways))).reshape(len(ways), 3, len(ways), 3), axis1=1, axis2=3
    )
    expected = friction / np.where(law.evaluation.index == middle, 1e-3 * ways.max(), ways)
    np.testing.assert_allclose(found.diagonal(), expected, rtol=1e-3)


def test_rows_that_stick_need_no_secants(law):
    law = begin(law)
    law.at(pressed(law, (1e-3 * DEPTH, 0)))
    assert (law.evaluation.status == STICK).any()
    assert not law.evaluation.slip_secants(dense(law.evaluation.row_jacobian())).any()


def test_no_row_is_beyond_the_limit_and_none_that_sticks_moves(law):
    law = begin(law)
    for n in range(1, 6):
        law.at(pressed(law, (0.15 * n * DEPTH, 0.05 * n * DEPTH)))
        assert (np.linalg.norm(law.evaluation.traction, axis=1) <= MU * law.evaluation.lam * (1 + 1e-8) + 1e-12).all()
        slip = np.linalg.norm(law.evaluation.slips, axis=1)
        assert slip[law.evaluation.status == STICK].max(initial=0.0) < 1e-9 * DEPTH
        law.accept(1.0 + n)


def test_what_is_asked_between_accepted_steps_leaves_no_trace(law):
    """Newton's iterations and repeated steps evaluate forces that are not accepted; nor do those of another run."""
    straight = begin(law)
    asked = begin(straight)
    for n in (1, 2, 3):
        q = pressed(law, (0.3 * n * DEPTH, 0))
        before = asked.at(q)
        stiffness, tangent, force = before.row_stiffness(), before.tangent(), before.resultant()
        for elsewhere in (pressed(law, (4 * DEPTH, -2 * DEPTH)), 0.3 * q, -q):  # which opens some rows, and all
            asked.at(elsewhere)
        np.testing.assert_array_equal(before.row_stiffness(), stiffness)
        np.testing.assert_array_equal(before.tangent(), tangent)
        np.testing.assert_array_equal(before.resultant(), force)
        expected = straight.at(q).generalised
        np.testing.assert_allclose(asked.at(q).generalised, expected, rtol=1e-7, atol=1e-7 * abs(expected).max())
        straight.accept(1.0 + n)
        asked.accept(1.0 + n)
    assert asked.evaluation.dissipated == pytest.approx(straight.evaluation.dissipated, rel=1e-6)


@pytest.mark.parametrize("opens", [False, True])
def test_a_run_that_goes_on_from_another_is_as_one_run(law, opens):
    """Also if the contact opens at once: what stuck before is then forgotten."""
    one, n = begin(law), 3.0
    here = pressed(law, (0.3 * DEPTH, 0.1 * DEPTH))
    one.at(here)
    resumed = law.for_run()
    resumed.begin(one.at_end(n), n)
    for q in [pressed(law, (0.6 * DEPTH, 0))] * (not opens) + [-here, pressed(law, (0.6 * DEPTH, 0)), here]:
        for each in (one, resumed):
            each.accept(n)
        n += 1.0
        expected = one.at(q).generalised
        np.testing.assert_allclose(resumed.at(q).generalised, expected, rtol=1e-7, atol=1e-7 * abs(expected).max())
    assert abs(tangential(one)).max() > 0


def test_the_slip_path_is_the_way_to_and_fro(law):
    """It adds up over all steps, also where a row comes back to its place."""
    law = begin(law)
    for n, x in enumerate((10, 0, 10)):
        law.at(pressed(law, (x * DEPTH, 0)))
        law.accept(2.0 + n)
    nodes = law.gaps.row_nodes[law.evaluation.index]
    assert law.state.memory.path[nodes] == pytest.approx(30 * DEPTH, rel=0.1)
    assert not np.delete(law.state.memory.path, law.gaps.row_nodes).any()


@pytest.mark.parametrize("formulation", [Compliance, Penalty])
def test_forces_turn_with_a_pair_that_turns_as_a_whole(round_body, flat_body, formulation):
    """Nothing slides then, and what sticks holds on; in floating frames."""
    law = PatchContact(PatchGaps(floating(round_body), floating(flat_body)), formulation(), ep.Coulomb(MU))
    centres = [side.kinematics.origin for side in law.gaps.sides]

    def pair(way, turn=(0.0, 0.0, 0.0)):
        """Coordinates with the slave moved, and then both turned about the origin."""
        R = Rotation.from_rotvec(turn).as_matrix()
        ways = [R @ (centre + extra) - centre for centre, extra in zip(centres, (way, np.zeros(3)), strict=True)]
        return np.concatenate([moved(side, w, turn) for side, w in zip(law.gaps.sides, ways, strict=True)])

    for n, way in enumerate([(0, 0, 0), (0, 0, -DEPTH), (0.2 * DEPTH, 0.1 * DEPTH, -DEPTH)]):
        law.at(pair(way))
        law.accept(float(n))
    before, lam = law.evaluation.traction.copy(), law.evaluation.lam.copy()
    assert abs(before.sum(axis=0)).max() > 0.05 * lam.sum()
    turn = np.array([0.5, 0.2, -0.9])
    law.at(pair(way, turn))
    np.testing.assert_allclose(law.evaluation.lam, lam, atol=1e-4 * lam.max())
    R = Rotation.from_rotvec(turn).as_matrix()
    np.testing.assert_allclose(law.evaluation.traction, before @ R.T, atol=1e-4 * lam.max())
    assert abs(law.evaluation.slips[law.evaluation.index]).max() < 1e-4 * DEPTH
    sides = [
        *zip(law.gaps.present.places, law.evaluation.nodal_forces(), strict=True)
    ]  # action and reaction are on one line
    assert abs(sum(force.sum(axis=0) for _, force in sides)).max() < 1e-9 * lam.sum()
    moments = sum(np.cross(np.nan_to_num(place), force).sum(axis=0) for place, force in sides)
    assert abs(moments).max() < 1e-3 * DEPTH * lam.sum()


def test_forces_are_those_of_all_rows(round_body):
    """Few rows enter, but also those that opened in this step: what they bore is released."""
    gaps = RigidGaps(Side.of(InertialKinematics(round_body, np.zeros(3))), RigidPlane())
    law = compliant(gaps, ep.Coulomb(MU))
    F = regularised(law.rows.flexibility())
    whole, lam, last_q, entered = FrictionProblem(F), np.zeros((len(F) // 3, 3)), np.zeros(gaps.n), []
    H = law.rows.jacobian(np.arange(len(lam)))
    for n, (x, depth) in enumerate([(0, 0), (0, 8), (2, 8), (2, 1.3), (2.2, 1.3), (2, 0), (2, 5)]):
        law.accept(float(n))
        q = round_body.rigid[:, :3] @ [x * DEPTH, 0, -depth * DEPTH]
        law.at(q)
        h = (H @ (q - last_q) - F @ lam.ravel()).reshape(-1, 3)
        h[:, 0] = gaps.at(q)
        lam, last_q = whole.solve(h, np.full(len(h), MU)).copy(), q
        np.testing.assert_allclose(law.evaluation.on_rows, lam, rtol=0, atol=1e-6 * abs(lam).max())
        entered.append((len(law.evaluation.index), len(law.law.problem.lam) if law.evaluation.index.size else 0))
    assert 0 < entered[3][0] < entered[2][0] <= entered[3][1] < len(lam)
    assert entered[5][0] == 0


def test_what_rows_bore_before_the_last_step_is_forgotten(round_body, flat_body):
    """Also of patches that were so far apart that no rows were left."""
    law = compliant(PatchGaps(floating(round_body), floating(flat_body)), ep.Coulomb(MU))
    for n, height in enumerate([0.0, -5 * DEPTH, 1e-3, -5 * DEPTH]):
        law.accept(float(n))
        law.at(np.r_[moved(law.gaps.sides[0], [0, 0, height]), np.zeros(flat_body.n_dofs)])
        assert len(law.gaps.row_nodes) == 0 or n != 2
    assert law.evaluation.index.size
    assert not law.last.any()


@pytest.mark.parametrize("steps", [5, 400])
def test_work_of_a_cycle_is_what_friction_takes(law, steps):
    """Pressed by hand through a closed path: the work that comes in is stored or taken by friction.

    The trapezoidal rule is exact in long steps, too, but for the few rows that open and close.
    """
    law, work = begin(law), 0.0
    phase = np.linspace(0, 2 * np.pi, steps + 1)
    path = np.outer(np.sin(phase), [0.8, 0.3]) * DEPTH
    last_q, last_force = pressed(law), law.at(pressed(law)).generalised.copy()
    stored = law.evaluation.stored
    for n, along in enumerate(path[1:]):
        q = pressed(law, along)
        force = law.at(q).generalised.copy()
        work -= 0.5 * (force + last_force) @ (q - last_q)
        law.accept(2.0 + n)
        last_q, last_force = q, force
    law.at(last_q)
    assert law.evaluation.dissipated > 0
    assert work == pytest.approx(law.evaluation.dissipated + law.evaluation.stored - stored, rel=2e-3)


@pytest.mark.parametrize("along", [0.02, 0.5, 5.0])
def test_tangent_against_finite_differences(law, along):
    """In stick, in partial slip and in gross slip, where it is not symmetric."""
    law = begin(law)
    q = pressed(law, (along * DEPTH, 0.3 * along * DEPTH))
    law.at(q)
    tangent = law.evaluation.tangent()
    state = law.evaluation.status.copy()
    rng = np.random.default_rng(0)
    checked = 0
    for _ in range(6):
        d = rng.standard_normal(len(q))
        d *= 1e-6 * DEPTH / abs(law.rows.jacobian(law.evaluation.index) @ d).max()
        ahead, back = law.at(q + d).generalised.copy(), law.at(q - d).generalised.copy()
        if (law.evaluation.status == state).all():
            checked += 1
            assert relative(-2 * tangent @ d, ahead - back) < 1e-4
    assert checked


def test_frictional_needs_all_three_directions(pair_of, mbs):
    ball, block = (ep.CreatePartitionBody(mbs, body) for body in pair_of("residual"))
    del block
    with pytest.raises(ep.errors.InputError, match="axes='xyz'"):
        ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), friction=0.2)


@pytest.mark.parametrize("friction", [-0.1, float("nan"), "0.2", [0.2], 11, True])
def test_wrong_coefficients_are_named(round_body, mbs, friction):
    ball = ep.CreatePartitionBody(mbs, round_body)
    with pytest.raises(ep.errors.InputError, match="friction"):
        ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), friction=friction)


def test_rolling_keeps_the_material_point(round_body):
    """A rigid plane that is fixed: places count from where the slave's points were, along the plane."""
    gaps = RigidGaps(Side.of(InertialKinematics(round_body, np.zeros(3))), RigidPlane())
    law = compliant(gaps, ep.Coulomb(MU))
    law.at(np.zeros(gaps.n))
    law.accept(0.0)
    q = round_body.rigid[:, :3] @ np.array([2e-6, -1e-6, -DEPTH])
    law.at(q)
    way = law.rows.in_space(law.rows.way())
    np.testing.assert_allclose(way - [2e-6, -1e-6, 0], 0, atol=1e-15)
