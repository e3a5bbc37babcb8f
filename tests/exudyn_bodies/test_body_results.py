"""Strain and stress of bodies that have yielded."""

import warnings
from dataclasses import replace
from fractions import Fraction

import exudyn as exu
import exudyn.itemInterface as items
import meshio
import netgen.occ as occ
import numpy as np
import pytest

import exudyn_partition as ep
from exudyn_partition.errors import InputError, ModelLimitWarning, YieldWarning

E, YIELD_STRESS, SLOPE = 70e9, 200e6, 2e9
LENGTH, WIDTH = 30e-3, 10e-3
POINTS = np.array([(0, 0, -5e-3), (2e-3, -1e-3, -12e-3), (1e-3, 2e-3, -26e-3)])


@pytest.fixture(scope="module")
def pressed():
    """FE model, item, contact and result of a bar that a rigid plane presses to twice its yield strain, and releases.

    An averaged interface holds its base without friction, so that its stress is uniform.
    """
    material = ep.Material(E=E, nu=0.33, rho=2700.0, yield_stress=YIELD_STRESS, hardening=SLOPE)
    shape = occ.Box((-WIDTH / 2, -WIDTH / 2, -LENGTH), (WIDTH / 2, WIDTH / 2, 0))
    shape.faces.Min(occ.Z).name = "base"
    fem = ep.fe_model(shape, material, maxh=WIDTH)
    part = ep.Partition.ball(fem, (0, 0, 0), 0.8 * WIDTH, direction=(0, 0, 1), plastic_radius=2 * LENGTH)
    body = ep.reduce(fem, part | ep.Partition.interface(fem, "base", "base", kind="averaged"), f_cut=50e3)
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, name="bar")
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane((0, 0, 0), (0, 0, -1)))
    place = np.eye(4)
    place[2, 3] = -LENGTH
    ground = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.CreateGround(), localHT=place))
    joint = items.GenericJoint(markerNumbers=[ground, item.CreateInterfaceMarker(mbs, "base")])
    travel = [0, 2 * LENGTH * YIELD_STRESS / E, 1.6 * LENGTH * YIELD_STRESS / E]
    joint.offsetUserFunction = lambda mbs, t, i, offset: [0, 0, np.interp(t, [0, 0.6, 1], travel), 0, 0, 0]
    mbs.AddObject(joint)
    mbs.Assemble()
    return fem, item, contact, ep.solve_static(mbs, load_steps=10)


def test_stress_in_a_bar_that_yields_is_force_by_area(pressed):
    """Hooke's law of the whole strain would give about twice the yield stress."""
    fem, item, contact, result = pressed
    pressure = contact.force(result) / WIDTH**2
    plastic = contact.plastic.strain(result)
    assert plastic[-1] > 2e-3
    np.testing.assert_allclose(pressure.max(), YIELD_STRESS + SLOPE * plastic[-1], rtol=1e-6)
    stress = item.stress(result, POINTS, fem)
    expected = np.zeros_like(stress)
    expected[..., 2] = -pressure[:, None]
    np.testing.assert_allclose(stress, expected, atol=1e-6 * YIELD_STRESS)


def test_strain_has_its_plastic_part(pressed):
    fem, item, contact, result = pressed
    with pytest.warns(YieldWarning, match=r"rows 0 to 17 lie where the material has yielded.*stress\("):
        strain = item.recover(result, ep.recovery.strain_rows(fem, POINTS), fem=fem).reshape(-1, 3, 6)
    elastic = contact.force(result) / WIDTH**2 / E
    expected = -np.broadcast_to((elastic + contact.plastic.strain(result))[:, None], (len(result.t), 3))
    np.testing.assert_allclose(strain[..., 2], expected, atol=1e-6 * abs(expected).max())


def test_rows_of_a_body_that_stayed_elastic_do_not_warn(pressed):
    fem, item, _, result = pressed
    first = result.at(result.t[:3])  # a fifth of the travel
    item.recover(first, ep.recovery.stress_rows(fem, POINTS), fem=fem)


def test_fields_know_plastic_strain(pressed, tmp_path):
    fem, item, contact, result = pressed
    fields = ["stress", "von_mises"]
    ep.output.write_paraview(tmp_path, result, [(item, fem)], fields=fields, times=[0.6, 1.0], surface=False)
    for path, t in zip(sorted(tmp_path.glob("*.vtu")), (0.6, 1.0), strict=True):
        pressure = contact.force(result)[abs(result.t - t).argmin()] / WIDTH**2
        data = meshio.read(path).point_data
        np.testing.assert_allclose(data["von_mises"], pressure, rtol=1e-6)
        np.testing.assert_allclose(data["stress"][:, 2], -pressure, rtol=1e-6)


def test_a_result_without_plastic_strain_has_no_stress(pressed):
    fem, item, _, result = pressed
    read = replace(result, runs=())
    with pytest.raises(InputError, match="nothing was kept of forces of rows"):
        item.stress(read, POINTS, fem)


def test_points_are_used_as_they_were_checked(bodies, mbs, recwarn):
    """The warning near a contact once took what the user gave: numbers of other kinds ended in NumPy's own error."""
    item = ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=[0, 0, -1])
    ep.CreatePartitionContact(mbs, item, ep.RigidPlane(point=bodies[0].points.min(axis=0)), rows="node-to-segment")
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=2e-6)
    node = bodies[0].points[bodies[0].partition.patches[0].nodes[0]]
    for motion in (item.velocity, item.displacement):
        expected = motion(result, node)
        np.testing.assert_array_equal(motion(result, [Fraction(x) for x in node.tolist()]), expected)


def test_numbers_are_kept_as_they_were_checked():
    """What is kept is a plain number, whatever kind it came as."""
    one = np.array(1.0)
    kept = [ep.RigidSphere((0, 0, 0), one).radius, ep.RigidCylinder((0, 0, 0), (0, 0, 1), one).radius]
    kept += [ep.Refine((0, 0, 0), one, 0.1 * one).radius, ep.Rayleigh(one, Fraction(1)).beta]
    assert {type(number) for number in kept} == {float}


def test_a_body_at_rest_lacks_nothing_and_one_that_is_hit_is_told(mbs, round_body):
    """Round-off is no motion of which a share could be missing: the force that holds a ball at rest stays the same."""
    ball = ep.CreatePartitionBody(mbs, round_body, name="ball", gravity=[0, 0, -9.81], damping=0.05)
    floor = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane())
    mbs.Assemble()
    place = round_body.points[round_body.partition.patches[0].nodes[0]]
    down = -ball.kinematics.weight(np.array([0, 0, 1.0])) / ball.kinematics.mass
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the contact of a ball at rest is smaller than its facets
        ep.settle(mbs)
        resting = ep.solve_dynamic(mbs, end_time=10e-6)
        mbs.systemData.SetODE2Coordinates_t(down, exu.ConfigurationType.Initial)
        hit = ep.solve_dynamic(mbs, end_time=20e-6)
    np.testing.assert_allclose(floor.force(resting), 9.81 * round_body.total_mass, rtol=1e-3)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ball.velocity(resting, place)
        assert np.ptp(ball.displacement(resting, place), axis=0).max() < 1e-9
    assert floor.force(hit).max() > 10 * floor.force(hit)[0]
    with pytest.warns(ModelLimitWarning, match="near a contact the displacement of a point lacks its static answer"):
        ball.displacement(hit, place)
