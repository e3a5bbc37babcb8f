"""Steps that grow in lasting contact: at rest, struck, dropped, lifted; forces and impulses stay as they are."""

import re

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
import pytest
from oracles import add_springs

import exudyn_partition as ep

WEIGHT = 500.0  # [N]
pytestmark = pytest.mark.filterwarnings("ignore::exudyn_partition.errors.ModelLimitWarning")
AS_BEFORE = {"velocity_tolerance": 1e-12}  # steps in contact do not grow


def standing(body, *, height=0.0, pulse=None, weight=WEIGHT, spring=1e7, velocity=(0.0, 0.0, 0.0), **options):
    """A ball under a weight and on springs above a plane; `pulse`, (begin, end, force), acts along the normal."""
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(
        mbs,
        body,
        name="ball",
        referencePosition=[0, 0, height],
        initialVelocity=velocity,
        gravity=[0, 0, -weight / body.total_mass],
        damping=options.pop("damping", 0.1),
        frame=options.pop("frame", "inertial"),
    )
    contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), **options)
    if ball.frame == "inertial" and spring is not None:
        add_springs(mbs, ball, spring)
    if pulse is not None:
        up = body.mass @ body.rigid[:, 2] / body.total_mass

        def push(mbs, t, i, q, q_t):
            return (pulse[2] if pulse[0] < t < pulse[1] else 0.0) * up

        mbs.AddObject(
            items.ObjectGenericODE2(
                nodeNumbers=ball.nodes, forceUserFunction=push, visualization=items.VObjectGenericODE2(show=False)
            )
        )
    mbs.Assemble()
    return mbs, ball, contact


def run(mbs, end_time, **options):
    return ep.solve_dynamic(mbs, end_time=end_time, method="implicit", adaptive=True, **options)


@pytest.mark.parametrize(
    "options",
    [{}, {"friction": 0.3}, {"rows": "node-to-segment"}],
    ids=["compliance", "friction", "node-to-segment"],
)
def test_a_constant_state_takes_few_steps(round_body, options):
    """Whatever holds it: a ball that is pressed and at rest."""
    end = 1e-3
    mbs, _, contact = standing(round_body, **options)
    ep.solve_static(mbs, update_initial=True)
    result = run(mbs, end)
    force = contact.force(result)
    assert result.steps < 0.1 * end / result.step
    np.testing.assert_allclose(force, force[0], rtol=1e-5)


@pytest.mark.filterwarnings("error::exudyn_partition.errors.ModelLimitWarning")
def test_a_block_that_friction_holds_takes_few_steps():
    """What Newton's method leaves of a light block's forces is no motion to resolve, nor energy to warn of."""
    shape = occ.Box((-10e-3, -10e-3, 0), (10e-3, 10e-3, 8e-3))
    shape.faces.Min(occ.Z).name = "bottom"
    fem = ep.fe_model(shape, ep.STEEL, maxh=8e-3)
    body = ep.reduce(fem, ep.Partition.surface(fem, "bottom", axes="xyz"), f_cut=60e3)
    tilt, mbs, end = 0.9 * np.arctan(0.3), exu.SystemContainer().AddSystem(), 0.6e-3
    gravity = [9.81 * np.sin(tilt), 0, -9.81 * np.cos(tilt)]
    item = ep.CreatePartitionBody(mbs, body, frame="floating", gravity=gravity)
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), friction=0.3)
    mbs.Assemble()
    ep.solve_static(mbs, load_steps=3, update_initial=True)
    result = run(mbs, end)
    assert result.steps < 0.5 * end / result.step
    np.testing.assert_allclose(contact.force(result), body.total_mass * -gravity[2], rtol=1e-3)
    along = contact.friction.tangential_force(result)[:, 0]
    np.testing.assert_allclose(along, -body.total_mass * gravity[0], rtol=1e-3)


@pytest.fixture(scope="module")
def struck(round_body):
    """A pressed ball that a pulse strikes; with growing steps, and as before."""
    runs = []
    for options in ({}, AS_BEFORE):
        mbs, _, contact = standing(round_body, pulse=(10e-6, 40e-6, -100.0), spring=1e8, damping=0.19)
        ep.solve_static(mbs, update_initial=True)
        runs.append((contact, run(mbs, 1.5e-3, **options)))
    return runs


def test_a_struck_ball_keeps_its_forces(struck):
    (contact, result), (before, fine) = struck
    assert result.steps < 0.7 * fine.steps
    assert contact.force(result).max() == pytest.approx(before.force(fine).max(), rel=2e-3)
    total = [np.trapezoid(c.force(r), r.t) for c, r in struck]
    assert total[0] == pytest.approx(total[1], rel=1e-3)


def test_steps_with_a_tiny_tolerance_are_the_contact_s_own(struck):
    result = struck[1][1]
    moves = result.t[:-2] > 15e-6  # until the pulse all is at rest, and the last step has the rest of the time
    np.testing.assert_allclose(np.diff(result.t)[:-1][moves], result.step, rtol=1e-6)


def test_a_contact_that_opens_or_closes_in_a_long_step_does_so_in_a_short_one(round_body):
    """A ball at rest is thrown up after a while; the force that holds it brings it back."""
    mbs, _, contact = standing(round_body, pulse=(600e-6, 700e-6, 1500.0))
    ep.solve_static(mbs, update_initial=True)
    result = run(mbs, 1.5e-3)
    closed, steps = contact.force(result) > 0, np.diff(result.t)
    assert steps[result.t[1:] < 590e-6].max() > 10 * result.step
    opens, closes = (np.flatnonzero(np.diff(closed.astype(int)) == sign)[0] for sign in (-1, 1))
    assert steps[opens] < 2.001 * result.step
    assert steps[closes] < 1.001 * result.step
    np.testing.assert_allclose(steps[closes + 1 : closes + 10], result.step, rtol=1e-6)


def test_a_ball_that_drops_has_the_same_impacts(round_body):
    runs = []
    for options in ({}, AS_BEFORE):
        mbs, _, contact = standing(round_body, height=1e-6, spring=None, damping=0.19)
        runs.append((contact, run(mbs, 0.6e-3, **options)))
    impulses = [[impact.impulse for impact in contact.impacts(result)[:3]] for contact, result in runs]
    np.testing.assert_allclose(*impulses, rtol=1e-3)


@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_growing_steps_go_on(round_body, frame):
    """The second part knows the errors of the first one, and how long the contact has been closed."""
    mbs, _, contact = standing(round_body, frame=frame, spring=1e6, damping=0.19)
    whole = run(mbs, 150e-6)
    first = run(mbs, 75e-6)
    rest = run(mbs, 150e-6, go_on=True)
    assert len(first.t) + len(rest.t) - 1 == pytest.approx(len(whole.t), rel=0.1)
    assert contact.force(rest)[-1] == pytest.approx(contact.force(whole)[-1], rel=1e-3)


def test_what_rings_for_long_is_logged_with_its_frequency_and_energy(round_body, caplog):
    """A ball without damping swings on its contact: by crossings of its mean height, and by its velocity's square."""
    caplog.set_level("INFO", logger="exudyn_partition")
    mbs, ball, contact = standing(round_body, pulse=(0.0, 20e-6, -100.0), damping=None, spring=1e8)
    ep.solve_static(mbs, update_initial=True)
    result = run(mbs, 0.6e-3, velocity_tolerance=1e-5)
    (said,) = (record.getMessage() for record in caplog.records if "rings at" in record.getMessage())
    told = re.search(r"rings at (\S+) kHz .* with (\S+) of the largest energy", said)
    late = result.t > 0.1e-3
    force = contact.force(result)[late] - contact.force(result)[late].mean()
    period = 2 * (result.t[late][-1] - result.t[late][0]) / np.count_nonzero(np.diff(np.sign(force)))
    assert 1e3 * float(told[1]) == pytest.approx(1 / period, rel=0.1)
    energy = ball.energy(result) + contact.energy(result)
    kinetic = 0.5 * ball.momentum(result)[late, 2] ** 2 / round_body.total_mass
    assert float(told[2]) == pytest.approx(2 * kinetic.mean() / energy.max(), rel=0.3)
    caplog.clear()
    mbs, *_ = standing(round_body, spring=1e8)
    ep.solve_static(mbs, update_initial=True)
    run(mbs, 0.6e-3)
    assert not [record for record in caplog.records if "rings at" in record.getMessage()]


def test_a_body_that_slides_steadily_does_not_ring_by_that(round_body, caplog):
    """It swings on its contact with a twentieth of the speed with which it slides, without friction."""
    caplog.set_level("INFO", logger="exudyn_partition")
    springs = np.diag([1.0, 3e6, 3e6, 300.0, 300.0, 300.0])  # hardly any along the slide [N/m, N m]
    mbs, *_ = standing(round_body, spring=springs, velocity=(1.0, 0.0, -0.05), damping=None)
    ep.solve_static(mbs, update_initial=True)
    run(mbs, 0.6e-3, velocity_tolerance=1e-5)
    (said,) = (record.getMessage() for record in caplog.records if "rings at" in record.getMessage())
    share = float(re.search(r"with (\S+) of the largest energy", said)[1])
    assert 0.5 * 0.05**2 < share < 2 * 0.05**2
