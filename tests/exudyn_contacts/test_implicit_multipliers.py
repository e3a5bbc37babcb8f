"""Multipliers in implicit steps keep energy whatever the step: bases, frames, rows, friction, carriers."""

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
import pytest

import exudyn_partition as ep
from exudyn_partition.errors import StoppedRunWarning
from exudyn_partition.simulation.causes import unsettled

SPEED, END = 1.0, 60e-6  # of the ball, whose impact lasts some 50 us
STEPS = (0.25e-6, 0.6e-6, 1.2e-6)


def drop(body, step, velocity=(0, 0, -SPEED), frame="inertial", **options):
    """The ball hits a rigid plane: body, contact and result."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, initialVelocity=velocity, frame=frame, referencePosition=[0, 0, 1e-7])
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), formulation="lagrange", **options)
    mbs.Assemble()
    return item, contact, ep.solve_dynamic(mbs, end_time=END, step=step, method="implicit")


@pytest.mark.parametrize(("basis", "frame", "rows"), [
    ("craig-bampton", "inertial", "node-to-segment"), ("free", "inertial", "integrated"),
    ("craig-bampton", "floating", "node-to-segment"),
])  # fmt: skip
def test_no_step_makes_energy_or_is_divided(pair_of, basis, frame, rows):
    """Some gave a third of it, and were divided as rows opened and closed from one iteration to the next."""
    body, peaks, momenta = pair_of(basis)[0], [], []
    for step in STEPS if frame == "inertial" else STEPS[-1:]:
        item, contact, result = drop(body, step, frame=frame, rows=rows)
        assert result.status == "finished"
        assert result.steps == round(END / result.step)
        energy = item.energy(result) / item.energy(result)[0] - 1
        assert energy.max() < 1e-3
        assert energy[-1] > -0.01
        force = contact.force(result)
        assert not force[-1]
        change = np.diff(item.momentum(result)[[0, -1], 2])[0]
        assert np.trapezoid(force, result.t) == pytest.approx(change, rel=1e-7)
        peaks.append(force.max())
        momenta.append(change)
    np.testing.assert_allclose(peaks, peaks[0], rtol=0.02)
    np.testing.assert_allclose(momenta, momenta[0], rtol=0.005)


@pytest.mark.parametrize(("basis", "mu"), [("craig-bampton", 0.1), ("free", 0.5), ("craig-bampton", 0.8)])
def test_what_friction_takes_only_grows_and_is_what_the_bodies_lose(pair_of, basis, mu):
    """The ball slides over a plane that it hits: peaks were a half too high, and friction gave energy back."""
    fine = mu > 0.5  # few rows, most of which stick, are not yet the same in all steps
    body, taken, peaks = pair_of(basis, fine)[0], [], []
    for step in STEPS[::2]:
        item, contact, result = drop(body, step, velocity=(0.3, 0, -SPEED), friction=mu)
        assert result.steps == round(END / result.step)
        energy, lost = item.energy(result), contact.dissipated_energy(result)
        assert np.diff(lost).min() > -1e-12 * energy[0]
        balance = (energy + lost) / energy[0] - 1
        assert balance.max() < 1e-3
        assert balance[-1] > -0.01
        along, change = contact.friction.tangential_force(result), np.diff(item.momentum(result)[[0, -1]], axis=0)[0]
        np.testing.assert_allclose(np.trapezoid(along, result.t, axis=0)[:2], change[:2], atol=1e-9 * abs(change).max())
        taken.append(lost[-1] / energy[0])
        peaks.append(contact.force(result).max())
    assert taken[0] > 0.003
    np.testing.assert_allclose(taken, taken[0], rtol=0.05)
    np.testing.assert_allclose(peaks, peaks[0], rtol=0.02)


@pytest.fixture(scope="module")
def balls(kept):
    """An aluminium ball above a soft one, coarse, basis "craig-bampton"."""
    bodies = []
    for material, side, f_cut in ((ep.ALUMINIUM, 1, 175e3), (ep.Material(E=2e9, nu=0.4, rho=1100.0), -1, 50e3)):
        shape = occ.Sphere(occ.Pnt(0, 0, side * 8e-3), 8e-3)
        fem = ep.fe_model(shape, material, maxh=6e-3, refine=[ep.Refine((0, 0, 0), 1.2e-3, 7e-4)], grading=0.7)
        part = ep.Partition.ball(fem, (0, 0, 0), 1.6e-3, direction=(0, 0, -side))
        bodies.append(ep.reduce(fem, part, f_cut=f_cut, basis="craig-bampton", cache=kept))
    return bodies


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.ContactPatchWarning")  # the patches are coarse
@pytest.mark.parametrize(("method", "step", "friction"), [
    ("explicit", None, None), ("implicit", None, None), ("implicit", 5e-7, None), ("implicit", 5e-7, 0.3),
])  # fmt: skip
def test_balls_in_floating_frames_that_roll_over_edges_between_facets(mbs, balls, method, step, friction):
    """Both methods stopped: normals jump where a node passes from one facet to the next."""
    upper = ep.CreatePartitionBody(
        mbs, balls[0], frame="floating", referencePosition=[0, 0, 1e-6], initialVelocity=[0.4, 0, -4.0],
        initialAngularVelocity=[0, 21.4, 0],
    )  # fmt: skip
    lower = ep.CreatePartitionBody(mbs, balls[1], frame="floating")
    contact = ep.CreatePartitionContact(mbs, upper, lower, formulation="lagrange", friction=friction)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=8e-6 if method == "explicit" else 30e-6, method=method, step=step)
    assert result.status == "finished"
    assert contact.force(result).max() > 3
    energy = upper.energy(result) + lower.energy(result) + contact.dissipated_energy(result)
    np.testing.assert_allclose(energy, energy[0], rtol=2e-3)
    momentum = upper.momentum(result) + lower.momentum(result)
    np.testing.assert_allclose(momentum, momentum[:1] + 0 * momentum, atol=1e-9 * abs(momentum).max())


@pytest.mark.parametrize(("share", "friction"), [(0.01, None), (1.0, None), (1.0, 0.3)])
def test_a_body_that_carries_the_plane(mbs, pair_of, share, friction):
    """A light or a heavy hammer takes the opposite impulse, and the forces are found although it yields."""
    body = pair_of("craig-bampton")[0]
    mass = share * body.total_mass
    node = mbs.AddNode(items.NodeRigidBodyRotVecLG(referenceCoordinates=[0, 0, -0.01, 0, 0, 0]))
    hammer = mbs.AddObject(items.ObjectRigidBody(nodeNumber=node, mass=mass, inertia=[1e-5] * 3 + [0] * 3))
    item = ep.CreatePartitionBody(mbs, body, initialVelocity=[0.3, 0, -SPEED], referencePosition=[0, 0, 1e-7])
    plane = ep.RigidPlane((0, 0, 0.01))
    contact = ep.CreatePartitionContact(mbs, item, plane, masterBody=hammer, formulation="lagrange", friction=friction)
    velocity = mbs.AddSensor(
        items.SensorBody(bodyNumber=hammer, outputVariableType=exu.OutputVariableType.Velocity, storeInternal=True)
    )
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=END, step=0.4e-6, method="implicit")
    assert result.steps == 150
    v = result.sensor(velocity)
    momentum = item.momentum(result) + mass * v
    np.testing.assert_allclose(momentum, momentum[:1] + 0 * momentum, atol=1e-9 * abs(momentum[0]).max())
    energy = item.energy(result) + 0.5 * mass * (v**2).sum(axis=1) + contact.dissipated_energy(result)
    np.testing.assert_allclose(energy, energy[0], rtol=0.01)
    assert v[-1, 2] == pytest.approx(-2 * SPEED / (1 + share), rel=0.1)  # as rigid, elastic bodies


def test_two_contacts_of_one_patch_share_the_force(mbs, pair_of):
    """Each would take all of it alone: the iteration finds that rows move by the other's forces too."""
    body = pair_of("craig-bampton")[0]
    item = ep.CreatePartitionBody(mbs, body, initialVelocity=[0, 0, -SPEED], referencePosition=[0, 0, 1e-7])
    contacts = [ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), formulation="lagrange") for _ in range(2)]
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=END, step=0.4e-6, method="implicit")
    assert result.steps == 150
    both = sum(contact.force(result) for contact in contacts)
    alone = drop(body, 0.4e-6)
    np.testing.assert_allclose(both, alone[1].force(alone[2]), atol=0.01 * both.max())
    assert item.energy(result)[-1] == pytest.approx(item.energy(result)[0], rel=0.01)


def test_a_run_that_does_not_converge_names_the_multipliers_and_what_helps(mbs, pair_of):
    """Exudyn says that it terminated, and no more."""
    item = ep.CreatePartitionBody(mbs, pair_of("craig-bampton")[0], initialVelocity=[0, 0, -SPEED])
    ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), formulation="lagrange", name="tip")
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.timeIntegration.verboseMode, settings.solution.file.write = 0, False
    settings.timeIntegration.newton.maxIterations, settings.timeIntegration.adaptiveStep = 1, False
    with pytest.warns(StoppedRunWarning, match=r"multipliers of contact 'tip' does not converge.*shorter step") as told:
        ep.solve_dynamic(mbs, end_time=END, step=0.4e-6, method="implicit", settings=settings)
    assert "rows=" not in str(told[0].message)  # a plane has one normal


@pytest.mark.parametrize(("rows", "helps"), [("node-to-segment", True), ("integrated", False)])
def test_rows_whose_normals_jump_less_are_named_to_those_who_have_others(mbs, balls, rows, helps):
    pair = [ep.CreatePartitionBody(mbs, ball, frame="floating", referencePosition=[0, 0, z]) for ball, z in zip(
        balls, (1e-6, 0.0), strict=True)]  # fmt: skip
    ep.CreatePartitionContact(mbs, *pair, formulation="lagrange", rows=rows)
    mbs.Assemble()
    assert ("rows='integrated'" in unsettled(mbs, "SolveDynamic terminated")) == helps
