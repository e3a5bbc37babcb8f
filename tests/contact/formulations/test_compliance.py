"""The compliance law of frozen pairs: force, tangent and potential belong together."""

import functools

import numpy as np
import pytest
from oracles import SPHERE_RADIUS, TOP, compliant, floating, inertial, moved, relative
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.algebra.complementarity import Complementarity, regularised
from exudyn_partition.contact.normal_rows import NormalRows
from exudyn_partition.contact.patch_gaps import PatchGaps
from exudyn_partition.contact.row_flexibility import RowFlexibility
from exudyn_partition.contact.side import Side
from exudyn_partition.contact.tangential import directions
from exudyn_partition.frames.floating import FloatingKinematics
from exudyn_partition.frames.inertial import InertialKinematics


@pytest.fixture(scope="module")
def law(bodies):
    return compliant(PatchGaps(*sides(bodies)))


def sides(bodies, slave_at=TOP):
    """Patches of two bodies, the first shifted."""
    return [
        Side.of(InertialKinematics(body, np.array(at))) for body, at in zip(bodies, (slave_at, (0, 0, 0)), strict=True)
    ]


def closing_state(law, bodies, depth, seed=0):
    """Bodies pushed into each other by `depth`, with some random deformation."""
    rng = np.random.default_rng(seed)
    n = [body.n_dofs for body in bodies]
    q = np.concatenate([-depth * bodies[0].rigid[:, 2], np.zeros(n[1])])
    return q + 0.2 * depth * rng.standard_normal(sum(n)) / abs(law.gaps.stage.linear.H).max() / np.sqrt(sum(n))


@pytest.mark.parametrize("seed", range(4))
def test_contact_force_jacobian_and_potential_against_finite_differences(law, bodies, seed):
    depth = 1e-6
    q = closing_state(law, bodies, depth, seed)
    force = law.at(q).generalised.copy()
    tangent = law.evaluation.tangent()
    assert 0 < len(law.evaluation.index)
    rng = np.random.default_rng(seed)
    for _ in range(3):
        d = rng.standard_normal(len(q))
        d *= 1e-5 * depth / abs(law.gaps.stage.linear.H @ d).max()
        slope = law.at(q + d).generalised - law.at(q - d).generalised
        assert relative(-2 * tangent @ d, slope) < 1e-5
        work = law.at(q + d).stored - law.at(q - d).stored
        assert work == pytest.approx(-2 * force @ d, rel=1e-5)


def test_contact_pushes_both_bodies_with_the_same_force(law, bodies):
    force = law.at(closing_state(law, bodies, 1e-6)).generalised
    n = bodies[0].n_dofs
    on_slave, on_master = bodies[0].rigid[:, :3].T @ force[:n], bodies[1].rigid[:, :3].T @ force[n:]
    np.testing.assert_allclose(on_slave, [0, 0, law.evaluation.lam.sum()], atol=1e-9 * law.evaluation.lam.sum())
    np.testing.assert_allclose(on_master, -on_slave, atol=1e-9 * law.evaluation.lam.sum())


def test_forces_depend_on_no_state_before(round_body, flat_body, each_path):
    """A ball that rolls and slides over a plate, sinks in and is lifted: its law finds what a fresh one finds.

    That is the answer of all rows there are, though few of them enter.
    """
    slave, master = floating(round_body), floating(flat_body)
    law = compliant(PatchGaps(slave, master))
    rng, found = np.random.default_rng(0), []
    for n in range(40):
        x, depth = 6e-4 * np.sin(n / 8), 3e-6 * np.sin(n / 3) + 1e-6
        turn = np.array([0.0, x / SPHERE_RADIUS, 0.0])
        arm = slave.kinematics.origin - Rotation.from_rotvec(turn).apply(slave.kinematics.origin)
        q = np.r_[moved(slave, arm * [1, 1, 0] + [x, 0, -depth], turn), np.zeros(flat_body.n_dofs)]
        q += 1e-9 * rng.standard_normal(len(q)) * (n % 4 == 3)
        force, fresh = law.at(q).generalised, law.for_run()
        expected = fresh.at(q).generalised
        np.testing.assert_allclose(force, expected, rtol=0, atol=5e-3 * abs(expected).max())
        assert law.evaluation.least_gap == pytest.approx(fresh.evaluation.least_gap, abs=1e-12)
        if law.evaluation.index.size:
            F = regularised(NormalRows(fresh.gaps).flexibility(np.arange(len(fresh.evaluation.lam))))
            lam = Complementarity(F).solve(fresh.gaps.at(q))
            np.testing.assert_allclose(fresh.evaluation.lam, lam, rtol=0, atol=1e-6 * lam.max())
        found.append(law.evaluation.lam.sum())
    assert 0.3 < np.mean(np.array(found) > 0) < 0.9


@pytest.mark.parametrize("friction", [None, ep.Coulomb(0.3)], ids=["smooth", "rough"])
@pytest.mark.parametrize(("depths", "on_demand"), [(0.2, False), (0.9, False), (0.4, True)])
def test_rows_that_bulge_shut_are_closed(round_body, flat_body, monkeypatch, each_path, depths, on_demand, friction):
    """Material that is pressed out beside a contact closes small gaps there: rows whose forces push others nearer.

    Those of a plate that bends close with larger gaps than the deepest row is deep. Where nothing is known of rows that
    did not enter, as on skins, such rows must lie near closed ones.
    """
    law = compliant(PatchGaps(floating(round_body), floating(flat_body)), friction)
    q = np.r_[moved(law.gaps.slave, [0, 0, -3e-6]), np.zeros(flat_body.n_dofs)]
    h = np.linspace(-1e-6, 3e-6, len(law.gaps.at(q)))
    if on_demand:
        h[(h > 0.11e-6) & (h < 0.3e-6)] = 2e-6
        law.gaps.sides.on_demand = True
    pushed = h < -depths * h.min()
    F = 1e-9 * (np.eye(len(h)) - 0.95 / pushed.sum() * np.outer(pushed, pushed))
    flexible = RowFlexibility(F)
    monkeypatch.setattr(NormalRows, "row_flexibility", lambda *_: flexible)
    if friction is not None:  # nothing moves along tangents
        wide = np.kron(F, np.diag([1.0, 0.0, 0.0])) + 1e-9 * np.diag(np.tile([0.0, 1.0, 1.0], len(h)))
        some = [functools.cache(lambda index: wide[np.ix_(*[directions(np.array(index))] * 2)])]
        monkeypatch.setattr(law.rows, "flexibility", lambda index: some[0](tuple(index)))
        monkeypatch.setattr(law.rows, "pushing", lambda index: wide[::3].take(directions(index), axis=1))
    law.answer(h)
    expected = Complementarity(regularised(F)).solve(h)
    np.testing.assert_array_equal(expected > 0, pushed)
    np.testing.assert_allclose(law.evaluation.lam, expected, rtol=0, atol=1e-8 * expected.max())
    law.answer(h)  # as before
    np.testing.assert_allclose(law.evaluation.lam, expected, rtol=0, atol=1e-8 * expected.max())


@pytest.mark.parametrize(("depth", "friction"), [(3e-5, None), (3e-4, None), (1e-4, ep.Coulomb(0.2))])
def test_rows_that_bending_pushes_shut_are_followed(thin_plate, depth, friction):
    """Tilted plates that bend as they are pressed close rows whose gaps are beyond those that are followed at first.

    The forces are those of all rows that there are.
    """
    places = (1.3e-3, 0.7e-3, 1e-3), (0.0, 0.0, 0.0)
    motions = (FloatingKinematics(thin_plate, np.array(at), np.zeros(3)) for at in places)
    slave, master = (Side.of(motion, patch) for patch, motion in enumerate(motions))
    law, every = (compliant(PatchGaps(slave, master), friction) for _ in range(2))
    for tilt in ([400, 0, 0], [0, 270, 0], [-250, 170, 0]):
        q = np.r_[moved(slave, [0, 0, -depth], depth * np.array(tilt)), np.zeros(master.n)]
        law.at(q)
        every.gaps.at(q)
        every.answer(every.gaps.widen(q))
        expected, gap = every.evaluation.lam, every.evaluation.h
        assert gap[expected > 0].max() > 0.4 * depth
        found = np.zeros(len(slave.surface.points))
        found[law.gaps.row_nodes] = law.evaluation.lam
        np.testing.assert_allclose(found[every.gaps.row_nodes], expected, rtol=0, atol=1e-8 * expected.max())


def test_stocky_bodies_push_no_row_shut(round_body, flat_body):
    """So that nothing more than their bulge has to be followed: forces on half-spaces press everything inwards."""
    gaps = PatchGaps(floating(round_body), floating(flat_body))
    assert gaps.lifting == 0.0
    slave, master = gaps.sides
    pressed = np.zeros((len(slave.surface.points), 3))
    pressed[5] = -slave.outward[5]
    assert slave.lifted(np.zeros(slave.n), pressed) == 0.0
    assert slave.lifted(np.zeros(slave.n), -pressed) > 0.0
    assert master.lifting == 0.0


def test_pairs_that_stand_still_again_keep_their_forces(round_body, flat_body):
    """They are frozen then, with all rows, after some hundred evaluations in one place."""
    law = compliant(PatchGaps(inertial(round_body), inertial(flat_body)))
    states = [np.r_[moved(law.gaps.slave, [x, 0, -3e-6]), np.zeros(flat_body.n_dofs)] for x in (0.0, 5e-5)]
    law.at(states[0])
    assert not law.gaps.moving
    expected = law.at(states[1]).generalised
    assert law.gaps.moving
    count = 0
    while law.gaps.moving:
        found, count = law.at(states[1]).generalised, count + 1
        law.accept(float(count))
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-2 * abs(expected).max())
        assert count < 1000
    np.testing.assert_allclose(law.at(states[1]).generalised, expected, rtol=0, atol=1e-2 * abs(expected).max())
    assert len(law.evaluation.lam) == len(law.gaps.row_nodes)


@pytest.mark.parametrize("kind", ["integrated", "node-to-segment"])
@pytest.mark.parametrize("friction", [False, True])
def test_forces_that_were_kept_are_put_on_the_nodes_again(round_body, flat_body, kind, friction):
    """By a law that was elsewhere, for places that a run has told; a ball that rolls closes a row at its edge."""
    gaps = PatchGaps(floating(round_body), floating(flat_body), kind)
    law = compliant(gaps, ep.Coulomb(0.3)) if friction else compliant(gaps)
    slave = law.gaps.slave
    for n, (depth, turn) in enumerate([(0.0, 0.0), (1e-6, 0.0), (4e-6, 0.085)]):
        law.accept(float(n))
        q = np.r_[moved(slave, [0, 0, -depth], [0, turn, 0]), np.zeros(flat_body.n_dofs)]
        law.at(q)
    index, fresh = law.evaluation.index, law.for_run()
    found = fresh.forces_on_nodes(
        q, law.gaps.row_nodes[index], law.evaluation.lam[index], law.evaluation.traction[index]
    )
    for again, told in zip(found, law.evaluation.nodal_forces(), strict=True):
        np.testing.assert_allclose(again, told, rtol=0, atol=1e-4 * abs(told).max())
    place, nodes = law.evaluation.edge_reached(), law.gaps.centre + law.gaps.present.places[0]
    closed_at_edge = law.gaps.row_nodes[index[np.isfinite(law.gaps.stage.rows.leaves_at[index])]]
    assert abs(nodes[closed_at_edge] - place).max(axis=1).min() == 0.0
    law.closing(0.0 * q, 0.0 * q, 0.0 * q)  # as a run asks whose bodies have parted
    assert len(law.evaluation.lam) == len(law.gaps.row_nodes)
    assert not law.evaluation.lam.any()
    assert not law.evaluation.index.size


def test_no_force_without_contact(law, bodies):
    q = -closing_state(law, bodies, 1e-6)
    assert not law.at(q).generalised.any()
    assert not law.evaluation.tangent().any()
