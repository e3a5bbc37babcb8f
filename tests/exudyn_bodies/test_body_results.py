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


SPIN, HALF = 2500.0, 40e-3  # rad/s about an axis across a bar, and half its length


@pytest.fixture(scope="module")
def rod():
    """FE model of a bar about the origin along x, and its only load, a patch at one end."""
    material = ep.Material(E=E, nu=0.0, rho=2700.0)
    fem = ep.fe_model(occ.Box((-HALF, -4e-3, -4e-3), (HALF, 4e-3, 4e-3)), material, maxh=6e-3)
    return fem, ep.Partition.ball(fem, (HALF, 0, 0), 4e-3, direction=(1, 0, 0))


def spun(mbs, body, axis=(0, 0, 1), **options):
    """The bar in free rotation for a tenth of a turn, with its vibration damped."""
    turning = {"frame": "floating", "initialAngularVelocity": list(SPIN * np.array(axis)), **options}
    return ep.CreatePartitionBody(mbs, body, name="rod", damping=ep.Rayleigh(4e4, 0.0), **turning)


def run(mbs):
    mbs.Assemble()
    return ep.solve_dynamic(mbs, end_time=5e-4, method="implicit", step=1e-5, spectral_radius=0.5)


@pytest.mark.parametrize(("basis", "f_cut"), [("contact-adapted", 3e3), ("contact-adapted", 90e3), ("residual", 3e3)])
def test_a_bar_that_turns_grows_and_is_stretched_whatever_its_basis_keeps(mbs, rod, basis, f_cut):
    """rho w^2 L^3 / (3 E) at the ends and rho w^2 L^2 / (2 E) in the middle; ends move as their displacement says."""
    fem, part = rod
    body = ep.reduce(fem, part, f_cut=f_cut, basis=basis)
    item = spun(mbs, body)
    result = run(mbs)
    ends = [item.displacement(result, (x, 0, 0))[-1] + (x, 0, 0) for x in (-HALF, HALF)]
    grown = np.linalg.norm(ends[1] - ends[0]) / 2 - HALF
    assert abs(grown / (2700.0 * SPIN**2 * HALF**3 / (3 * E)) - 1) < 0.005
    stress = item.stress(result, np.zeros((1, 3)), fem)[-1, 0]
    assert abs(stress[0] / (2700.0 * SPIN**2 * HALF**2 / 2) - 1) < 0.01
    gauge = ep.recovery.gauge_rows(fem, [ep.StrainGauge((0, 0, 0), (1, 0, 0), HALF)])
    strain = 2700.0 * SPIN**2 * (HALF**2 - HALF**2 / 12) / (2 * E)  # a gauge has the mean
    assert abs(item.recover(result, gauge)[-1, 0] / strain - 1) < 0.005
    speed = np.linalg.norm(item.velocity(result, (HALF, 0, 0))[-1])
    rate = np.linalg.norm(item.coordinates_t(result)[-1, 3:6])  # less than at first, if coordinates have grown
    assert abs(speed / (rate * (HALF + grown)) - 1) < 0.02 * grown / HALF


def test_growth_turns_with_the_axes_of_the_mesh(mbs, rod):
    """The bar lies along y in space, and turns about a slanted axis: only what is across its length counts."""
    body = ep.reduce(*rod, f_cut=3e3)
    turned = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    item = spun(mbs, body, (0.0, 0.6, 0.8), referenceRotationMatrix=turned)
    result = run(mbs).at(np.array([1e-5]))
    ends = [item.displacement(result, (x, 0, 0))[0] + turned @ (x, 0, 0) for x in (-HALF, HALF)]
    grown = np.linalg.norm(ends[1] - ends[0]) / 2 - HALF
    assert abs(grown / (2700.0 * (0.8 * SPIN) ** 2 * HALF**3 / (3 * E)) - 1) < 0.01


def test_contact_sees_the_growth(mbs, rod):
    """A bar within a wide ring comes closer to it, in the run's own sensor and in what results find anew."""
    item = spun(mbs, ep.reduce(*rod, f_cut=3e3))
    ring = ep.RigidCylinder((0, 0, 0), (0, 0, 1), HALF + 1e-3, hollow=True)
    contact = ep.CreatePartitionContact(mbs, item, ring)
    result = run(mbs)
    grown = 2700.0 * SPIN**2 * HALF**3 / (3 * E)
    corner = HALF + 1e-3 - np.hypot(HALF, rod[0].points[item.body.partition.patch_nodes, 1].max())
    gap = contact.gap(result)
    assert abs((corner - gap[-1]) / grown - 1) < 0.01


def test_a_body_that_does_not_turn_does_not_grow(mbs, rod):
    item = spun(mbs, ep.reduce(*rod, f_cut=3e3), (0, 0, 0), initialVelocity=[1.0, 0, 0])
    result = run(mbs)
    way = item.displacement(result, (HALF, 0, 0))[-1]
    assert abs(way - [5e-4, 0, 0]).max() < 1e-15


def test_markers_on_nodes_move_by_the_coordinates_alone(mbs, rod):
    """A sensor there lacks the growth that `displacement` has, and the run says so."""
    item = spun(mbs, ep.reduce(*rod, f_cut=3e3))
    place = mbs.AddSensor(
        items.SensorMarker(
            markerNumber=item.CreateNodeMarker(mbs, (HALF, 0, 0)),
            outputVariableType=exu.OutputVariableType.Position,
            storeInternal=True,
        )
    )
    with pytest.warns(ModelLimitWarning, match="Markers on nodes and points lack that"):
        result = run(mbs)
    marked = np.linalg.norm(mbs.GetSensorStoredData(place)[-1, 1:])
    whole = np.linalg.norm(item.displacement(result, (HALF, 0, 0))[-1] + (HALF, 0, 0))
    grown = 2700.0 * SPIN**2 * HALF**3 / (3 * E)
    assert abs((whole - marked) / grown - 1) < 0.03
