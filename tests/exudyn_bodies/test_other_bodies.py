"""Where Exudyn's own bodies were in a run, and what shapes they have."""

import exudyn as exu
import numpy as np
import pytest
from exudyn import graphics
from exudyn.utilities import InertiaCuboid
from scipy.spatial.transform import Rotation

import exudyn_partition as ep

SPEED, SPIN = np.array([2.0, -1.0, 0.5]), np.array([0.0, 0.0, 300.0])
START = np.array([0.1, 0.2, 0.3])


def flight(body, *, contact=True, node=exu.NodeType.RotationRotationVector, shapes=None):
    """A partition body at rest, and a brick of Exudyn that flies and spins freely; returns model and brick."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body)
    if contact:
        ep.CreatePartitionContact(mbs, item, ep.RigidPlane((0, 0, -0.005)))
    brick = mbs.CreateRigidBody(
        name="brick", referencePosition=START.tolist(), inertia=InertiaCuboid(7800, [0.01] * 3), nodeType=node,
        initialVelocity=SPEED.tolist(), initialAngularVelocity=SPIN.tolist(),
        graphicsDataList=[graphics.Brick(size=[0.01, 0.02, 0.03])] if shapes is None else shapes,
    )  # fmt: skip
    mbs.Assemble()
    return mbs, brick


def assert_it_flew(other, times):
    place, turn = other.at(times)
    np.testing.assert_allclose(place, START + np.outer(times, SPEED), atol=1e-9)
    expected = Rotation.from_rotvec(np.outer(times, SPIN)).as_matrix()
    np.testing.assert_allclose(turn, expected, atol=1e-6)


@pytest.mark.parametrize("contact", [True, False])
def test_a_body_is_known_at_any_time(round_body, contact, tmp_path):
    mbs, brick = flight(round_body, contact=contact)
    result = ep.solve_dynamic(mbs, end_time=2e-3, step=1e-6)
    (other,) = result.others
    assert (other.number, other.name, other.moves) == (int(brick), "brick", True)
    assert len(other.t) <= 1001  # of 2000 steps
    assert_it_flew(other, np.linspace(0, 2e-3, 37))
    np.testing.assert_allclose(np.ptp(other.points, axis=0), [0.01, 0.02, 0.03])
    result.save(tmp_path / "run.npz")
    (read,) = ep.Result.load(tmp_path / "run.npz").others
    np.testing.assert_array_equal(read.place, other.place)
    np.testing.assert_array_equal(read.triangles, other.triangles)


def test_runs_by_exudyn_itself_know_it_too(round_body):
    mbs, _ = flight(round_body)
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = 2e-3, 2000
    mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.VelocityVerlet)
    (other,) = ep.collect(mbs).others  # Exudyn read its sensors at the start and the end alone
    assert len(other.t) > 300
    assert_it_flew(other, np.linspace(0, 2e-3, 37))


def test_shapes_are_those_that_the_user_gave(round_body):
    ball = graphics.Sphere(point=[0, 0, 1.0], radius=0.5)
    pin = graphics.Cylinder(pAxis=[0, 0, 0], vAxis=[0, 0, 2.0], radius=0.1)
    mbs, brick = flight(round_body, shapes=[ball, pin, graphics.Text(text="brick")])
    (other,) = ep.solve_dynamic(mbs, end_time=1e-5, step=1e-6).others
    np.testing.assert_allclose(other.points.max(axis=0), [0.5, 0.5, 2.0], atol=0.02)
    a, b, c = other.points[other.triangles].swapaxes(0, 1)
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6  # of closed surfaces, outward
    assert volume == pytest.approx(4 / 3 * np.pi * 0.5**3 + np.pi * 0.1**2 * 2, rel=0.05)
    mbs.SetObjectParameter(brick, "Vshow", False)
    assert ep.solve_dynamic(mbs, end_time=1e-5, step=1e-6).others == ()


def test_a_body_without_a_shape_is_not_kept_unless_it_carries(round_body):
    def run(carries):
        mbs = exu.SystemContainer().AddSystem()
        item = ep.CreatePartitionBody(mbs, round_body)
        ground = mbs.CreateGround(referencePosition=[0, 0, -0.005])
        ep.CreatePartitionContact(mbs, item, ep.RigidPlane((0, 0, -0.005)), masterBody=ground if carries else None)
        mbs.Assemble()
        return ep.solve_dynamic(mbs, end_time=1e-5, step=1e-6).others

    assert run(carries=False) == ()
    (carrier,) = run(carries=True)
    assert not carrier.moves
    assert not len(carrier.triangles)
