"""Bodies grown to a tolerance: the estimate against the full FE model, what is chosen, and what cannot be reached."""

import weakref

import exudyn as exu
import numpy as np
import pytest
import scipy.sparse as sp
from oracles import TOP, relative

import exudyn_partition as ep
from exudyn_partition.algebra.complementarity import Complementarity
from exudyn_partition.algebra.sparse.multifrontal import Factorisation
from exudyn_partition.algebra.sparse.solver import solved_by
from exudyn_partition.errors import ContactPatchWarning, InputError, ModelLimitWarning, ToleranceWarning
from exudyn_partition.prediction.modal_impact import Impact
from exudyn_partition.reduction.estimate import errors

SPEED = 1.0
END = 150e-6


@pytest.fixture(scope="module")
def pair(ball, block, top):
    """The ball hits the block; both grown to 2 %."""
    lifted = ep.FEModel(
        ball[0].points + np.array(TOP), ball[0].cells, ball[0].mass, ball[0].stiffness, ball[0].cell_mass,
        ball[0].material, ball[0].boundaries,
    )  # fmt: skip
    models = (lifted, ball[1]), (block, top)
    return models, ep.reduce_pair(*models, tolerance=0.02, speed=SPEED, duration=END)


def run(bodies):
    mbs = exu.SystemContainer().AddSystem()
    striker = ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=[0, 0, -SPEED])
    target = ep.CreatePartitionBody(mbs, bodies[1])
    contact = ep.CreatePartitionContact(mbs, striker, target)
    mbs.Assemble()
    return ep.solve_dynamic(mbs, end_time=END).history(contact)


def test_the_true_force_error_is_below_the_tolerance_and_near_the_estimate(pair):
    """At the default step, against the full FE model under the same contact rows, whose short steps count as exact.

    The impact asks for a shorter step than f_cut does, whose own error would be three times as large.
    """
    models, bodies = pair
    full = [
        ep.reference.FullBody(fem, partition, velocity=(0, 0, v))
        for (fem, partition), v in zip(models, (-SPEED, 0.0), strict=True)
    ]
    reference = ep.reference.simulate(full, end_time=END, step=0.2e-6, alpha=0.0)
    error = ep.compare(run(bodies), reference).error["force"]
    estimate = bodies[0].estimate
    assert error < estimate.tolerance == 0.02
    assert estimate.force / 1.5 < error < 1.5 * estimate.force
    assert bodies[1].estimate == estimate
    assert estimate.limit == ""
    assert estimate.error <= 0.02


def test_errors_fall_as_the_estimate_says(pair, block, top):
    """A tighter tolerance takes more coordinates and a higher truncation."""
    models, coarse = pair
    fine = ep.reduce_pair(*models, tolerance=0.006, speed=SPEED, duration=END)
    assert fine[0].f_cut > 1.4 * coarse[0].f_cut
    assert sum(b.n_dofs for b in fine) > sum(b.n_dofs for b in coarse)
    assert fine[0].estimate.error < 0.006


def test_steps_that_follow_the_truncation_are_finer_too():
    """A slow press, whose modes are all kept: the error is that of the step alone, which falls with its square.

    A body of 1 kg and one mode of 100 Hz on a soft spring; f_cut is 200 Hz, and it is not released before 10 ms.
    """
    omega, f_cut = np.array([0.0, 2 * np.pi * 100]), 200.0
    rows, flexibility = np.array([[1.0, 0.5]]), np.array([[1 / (np.pi / 15e-3) ** 2]])
    impact = Impact(np.zeros(1), rows, flexibility, omega, np.array([-1.0, 0.0]), size=1e-3)
    assert impact.step(f_cut, 2.0) == impact.step(f_cut)  # f_cut, not the impact, decides on the step
    force, finer = (errors(impact, 4 * f_cut, [f_cut], 8e-3, by)[0, 0] for by in (1.0, 2.0))
    assert finer == pytest.approx(force / 4, rel=0.02)


def test_a_pair_never_holds_factors_of_both_bodies(pair):
    """They are most of the memory that a reduction needs: the first body's two go before the second's are made."""
    living, at_once = weakref.WeakSet(), []

    class Counted(Factorisation):
        def __init__(self, matrix, **options):
            super().__init__(matrix, **options)
            living.add(self)
            at_once.append(len(living))

    with solved_by(Counted):
        ep.reduce_pair(*pair[0], tolerance=0.1, speed=SPEED, duration=50e-6)
    assert len(at_once) >= 4
    assert max(at_once) == 2


def test_a_body_alone_hits_a_rigid_plane(ball):
    body = ep.reduce(*ball, tolerance=0.02)
    assert body.estimate.against == "a rigid plane"
    assert body.estimate.error <= 0.02
    assert body.f_cut == body.estimate.f_cut
    assert 6 <= body.n_dofs < 40


def force_on_a_plane(fem, patch, speed, end_time, step):
    """Full FE: times and mean forces of the steps of a body whose patch, facing upwards, hits a rigid plane."""
    nodes = patch.nodes
    where = np.arange(len(nodes)), 3 * nodes + 2
    rows = sp.csr_matrix((-np.ones(len(nodes)), where), shape=(len(nodes), fem.n_dofs))
    M, K = fem.mass, fem.stiffness
    factor, push = Factorisation(M + step**2 / 4 * K), Factorisation(M).solve(rows.T.toarray())
    answer = step**2 / 2 * factor.solve(rows.T.toarray())
    contact = Complementarity(rows @ answer)
    u, v, a = np.zeros(fem.n_dofs), np.tile([0, 0, speed], fem.n_nodes), np.zeros(fem.n_dofs)
    forces = []
    for _ in range(round(end_time / step)):
        predicted = u + step * v + step**2 / 4 * a
        lam = contact.solve(rows @ (free := predicted - step**2 / 4 * factor.solve(K @ predicted)))
        u = free + answer @ lam
        after = 4 * (u - predicted - step**2 / 2 * (push @ lam)) / step**2
        v, a = v + step / 2 * (a + after) + step * (push @ lam), after
        forces.append(lam.sum())
    return step * (np.arange(len(forces)) + 0.5), np.array(forces)


def test_a_flat_patch_is_judged_on_a_plane_too(mbs, block, top):
    """The estimate is the true error there, which the sphere that just fills the patch knows nothing of."""
    end = 50e-6
    with pytest.warns(ToleranceWarning, match=r"against a rigid plane .* the mesh, .*; a flat patch may ring"):
        body = ep.reduce(block, top, tolerance=0.1, speed=SPEED, duration=end)
    t, exact = force_on_a_plane(block, top.patches[0], SPEED, end, 0.05e-6)
    item = ep.CreatePartitionBody(mbs, body, initialVelocity=[0, 0, SPEED])
    plane = ep.RigidPlane(TOP, (0, 0, -1))
    contact = ep.CreatePartitionContact(mbs, item, plane, rows="node-to-segment")
    mbs.Assemble()
    # It is a part of the face, and rings.
    with pytest.warns(ContactPatchWarning), pytest.warns(ModelLimitWarning, match="rings"):
        result = ep.solve_dynamic(mbs, end_time=end)
    error = relative(np.interp(t, result.t, contact.force(result)), exact)
    assert body.estimate.against == "a rigid plane"
    assert body.estimate.force / 2 < error < 2 * body.estimate.force


def test_a_flat_patch_that_rings_on_a_plane_is_good_for_a_sphere(block, top):
    with pytest.warns(ToleranceWarning, match=r"What limits it is that a flat patch .*on a rigid sphere .* is 0\.[12]"):
        body = ep.reduce(block, top, tolerance=0.5)
    assert body.estimate.error > 0.5 / 1.5
    assert body.f_cut < block.resolved_frequency / 2


def test_the_worst_patch_decides(ball):
    fem, south = ball
    north = ep.Partition.ball(fem, (0, 0, 0.02), 4e-3)
    alone = [ep.reduce(fem, part, tolerance=0.05).estimate for part in (south, north)]
    both = ep.reduce(fem, south | north, tolerance=0.05).estimate
    assert both.error <= 0.05
    assert both.f_cut >= 0.99 * max(estimate.f_cut for estimate in alone)


def test_a_tolerance_that_the_mesh_cannot_reach(block, top, tmp_path):
    for _ in range(2):  # computed, and from the cache
        with pytest.warns(
            ToleranceWarning, match=r"cannot be promised; .* is the mesh, which resolves .* Refine"
        ) as said:
            body = ep.reduce(block, top, tolerance=1e-5, cache=tmp_path / "cache")
        assert said[0].filename == __file__
    assert body.estimate.limit.startswith("the mesh")
    assert body.estimate.error > 1e-5
    assert body.f_cut == pytest.approx(block.resolved_frequency)  # the richest; a lower error of less were chance
    body.save(tmp_path / "body.npz")
    assert ep.load_body(tmp_path / "body.npz").estimate == body.estimate


def test_a_pair_is_kept_in_the_cache(pair, tmp_path):
    models, bodies = pair
    for _ in range(2):
        again = ep.reduce_pair(*models, tolerance=0.02, speed=SPEED, duration=END, cache=tmp_path)
        assert again[0].estimate == bodies[0].estimate
    assert len(list(tmp_path.iterdir())) == 1


def test_bad_arguments(block, top):
    for options in ({}, {"f_cut": 80e3, "tolerance": 0.01}):
        with pytest.raises(InputError, match="f_cut, tolerance: expected one of them"):
            ep.reduce(block, top, **options)
    with pytest.raises(InputError, match="expected a relative error below 1"):
        ep.reduce(block, top, tolerance=5)
    with pytest.raises(InputError, match="only basis 'contact-adapted' grows to a tolerance, got 'residual'"):
        ep.reduce(block, top, tolerance=0.01, basis="residual")
    with pytest.raises(InputError, match="speed: expected a finite number above zero in m/s"):
        ep.reduce(block, top, tolerance=0.01, speed=0)
    with pytest.raises(InputError, match="duration: expected a finite number above zero in s"):
        ep.reduce_pair((block, top), (block, top), tolerance=0.01, speed=1.0, duration=-1)
    foot = ep.Partition.interface(block, "foot", np.flatnonzero(block.points[:, 2] < 1e-9))
    with pytest.raises(InputError, match="has no contact patch whose force could be judged"):
        ep.reduce(block, foot, tolerance=0.01)
    with pytest.raises(InputError, match=r"the impact region holds all \d+ nodes, so that nothing is left"):
        ep.reduce(block, ep.Partition.ball(block, TOP, 1.0, contact_radius=7e-3), f_cut=80e3)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"friction": 0.3}, "tangential_speed"),
        ({"tangential_speed": 0.3}, "without friction"),
        ({"friction": 0.3, "tangential_speed": 0.3}, "axes='xyz'"),
        ({"friction": -0.3, "tangential_speed": 0.3}, "friction"),
    ],
)
def test_oblique_pairs_need_friction_speed_and_directions(block, top, options, said):
    with pytest.raises(ep.errors.InputError, match=said):
        ep.reduce_pair((block, top), (block, top), tolerance=0.01, speed=1.0, **options)
