"""Sharp edges and corners: rows there close at the touch, and the faces beside them carry an even pressure."""

from dataclasses import replace
from functools import partial
from itertools import product

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
import pytest
from oracles import box, ground
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.errors import InputError, ModelLimitWarning
from exudyn_partition.surfaces.near import pair_wandering
from exudyn_partition.surfaces.points import contact_points
from validation.contact.sharp_edges import bar, lowest

SIDE, SPEED, GAP, FORCE = 0.02, 1.0, 1e-6, 1e3
CORNER, EDGE, SLIGHT = (1.0, 2.0, 3.0), (0.0, 1.0, 2.0), (0.02, 0.03, 1.0)  # normals of planes that a cube meets
TURN = Rotation.from_euler("xyz", [0.2, 0.4, 0.6])
A_CORNER = pytest.mark.filterwarnings("ignore:.*only a sharp corner or edge touches")


def skin(shape):
    for face in shape.faces:
        face.name = "skin"
    return shape


@pytest.fixture(scope="module")
def cube():
    """A steel cube about the origin; its patch is the whole skin."""
    fem = ep.fe_model(skin(box(SIDE, SIDE, SIDE).Move((0, 0, -SIDE / 2))), ep.STEEL, maxh=SIDE / 2)
    return ep.reduce(fem, ep.Partition.surface(fem, "skin", name="skin"), f_cut=1e5)


@pytest.fixture(scope="module")
def one_face():
    """The same cube; its patch is its lower face alone, which ends at sharp edges."""
    fem = ep.fe_model(box(SIDE, SIDE, SIDE).Move((0, 0, -SIDE / 2)), ep.STEEL, maxh=SIDE / 2)
    part = ep.Partition.surface(fem, plane=((0, 0, -SIDE / 2), (0, 0, -1)), axes="xyz", name="skin")
    return ep.reduce(fem, part, f_cut=1e5)


@pytest.fixture(scope="module")
def on_corner():
    """The same cube, which stands on a corner."""
    turn = TURN.as_rotvec()
    axis = occ.Axis(occ.Pnt(0, 0, 0), occ.Dir(*turn))
    shape = box(SIDE, SIDE, SIDE).Move((0, 0, -SIDE / 2)).Rotate(axis, np.degrees(np.linalg.norm(turn)))
    fem = ep.fe_model(skin(shape), ep.STEEL, maxh=SIDE / 2)
    return ep.reduce(fem, ep.Partition.surface(fem, "skin", name="skin"), f_cut=8e4)


@pytest.fixture(scope="module")
def plate():
    """A plate with finer facets whose upper face is in the plane z = 0."""
    shape = box(0.06, 0.06, 0.03).Move((0, 0, -0.03))
    fem = ep.fe_model(shape, ep.STEEL, maxh=0.012, refine=[ep.Refine((0, 0, 0), radius=6e-3, h=3e-3)])
    return ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), radius=0.012, axes="xyz"), f_cut=8e4)


def fall(mbs, cube, plane, frame="floating", method="implicit", **options):
    """A cube falls on a rigid plane along its normal: body, contact, result, normal, and where it touches."""
    normal = np.array(plane) / np.linalg.norm(plane)
    place = lowest(cube.points, normal)
    item = ep.CreatePartitionBody(mbs, cube, frame=frame, initialVelocity=-SPEED * normal)
    surface = ep.RigidPlane(place - GAP * normal, normal)
    contact = ep.CreatePartitionContact(mbs, item, surface, **options)
    mbs.Assemble()
    step = {"step": 2e-7} if method == "implicit" else {}
    return item, contact, ep.solve_dynamic(mbs, end_time=5e-5, method=method, **step), normal, place


@A_CORNER
@pytest.mark.parametrize(
    ("plane", "frame", "method", "options"),
    [
        (CORNER, "floating", "implicit", {}),
        (CORNER, "inertial", "explicit", {}),
        (CORNER, "floating", "explicit", {"friction": 0.2}),
        (EDGE, "inertial", "implicit", {}),
        (EDGE, "floating", "implicit", {"friction": 0.2}),
        (SLIGHT, "floating", "implicit", {}),
        (SLIGHT, "inertial", "explicit", {"rows": "node-to-segment"}),
    ],
)
@pytest.mark.parametrize("patch", ["cube", "one_face"])
def test_a_force_acts_while_a_corner_or_edge_touches(mbs, request, patch, plane, frame, method, options):
    """From the touch on, and with the impulse of rigid bodies; the patch goes around the edge, or ends there."""
    cube = request.getfixturevalue(patch)
    item, contact, result, normal, place = fall(mbs, cube, plane, frame, method, **options)
    force, deep = contact.force(result), contact.gap(result) < 0
    np.testing.assert_array_equal(force[1:] > 0, deep[1:])
    first = result.t[np.argmax(force > 0)]
    assert GAP / SPEED <= first <= GAP / SPEED + 2 * result.step
    (impact,) = contact.impacts(result)
    energy = item.energy(result) + contact.energy(result) + contact.dissipated_energy(result)
    assert abs(energy / energy[0] - 1).max() < 0.01
    momentum = item.momentum(result)
    np.testing.assert_allclose((momentum[-1] - momentum[0]) @ normal, impact.impulse, rtol=1e-3)
    if "friction" not in options:
        arm, mass = np.cross(place, normal), cube.total_mass
        apparent = 1 / (1 / mass + arm @ arm / (mass * SIDE**2 / 6))
        assert impact.impulse == pytest.approx(apparent * (impact.speed_before + impact.speed_after), rel=0.01)
        if plane != EDGE:  # a corner is so soft that hardly anything vibrates
            assert impact.impulse == pytest.approx(2 * apparent * SPEED, rel=0.01)


@A_CORNER
@pytest.mark.parametrize(
    ("frame", "method", "friction"), [("floating", "implicit", None), ("inertial", "explicit", 0.3)]
)
def test_a_corner_meets_the_face_of_another_body(mbs, cube, on_corner, plate, frame, method, friction):
    """It is the slave although the plate is finer and given first; both bodies together lose no momentum."""
    if frame == "inertial":
        body, turn = on_corner, np.eye(3)
    else:
        body, turn = cube, TURN.as_matrix()
    place = lowest(body.points @ turn.T, np.array([0.0, 0.0, 1.0]))
    lower = ep.CreatePartitionBody(mbs, plate, name="plate")
    upper = ep.CreatePartitionBody(
        mbs, body, name="cube", frame=frame, referencePosition=[*-place[:2], GAP - place[2]],
        initialVelocity=[0, 0, -SPEED], **({} if frame == "inertial" else {"referenceRotationMatrix": turn}),
    )  # fmt: skip
    contact = ep.CreatePartitionContact(mbs, lower, upper, friction=friction)
    assert contact.slave.name == "cube"
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=6e-5, method=method, **({"step": 4e-7} if method == "implicit" else {}))
    force = contact.force(result)
    np.testing.assert_array_equal(force[1:] > 0, contact.gap(result)[1:] < 0)
    assert GAP / SPEED <= result.t[np.argmax(force > 0)] <= GAP / SPEED + 2 * result.step
    momenta = [item.momentum(result) for item in (upper, lower)]
    np.testing.assert_allclose(momenta[0] + momenta[1], [momenta[0][0]] * len(force), atol=1e-9)
    energy = sum(item.energy(result) for item in (upper, lower))
    energy = energy + contact.energy(result) + contact.dissipated_energy(result)
    assert abs(energy / energy[0] - 1).max() < 0.01
    assert np.trapezoid(force, result.t) == pytest.approx(momenta[0][-1, 2] - momenta[0][0, 2], rel=1e-3)
    assert force[-1] == 0


@A_CORNER
@pytest.mark.parametrize(
    ("frame", "method", "friction"), [("floating", "implicit", None), ("inertial", "explicit", 0.3)]
)
def test_an_edge_of_the_master_presses_as_if_it_were_the_slaves(cube, on_corner, plate, frame, method, friction):
    """Its rows are a contact beside that of the slave's rows, which stay open."""
    body, turn = (on_corner, np.eye(3)) if frame == "inertial" else (cube, TURN.as_matrix())
    place = lowest(body.points @ turn.T, np.array([0.0, 0.0, 1.0]))
    forces = []
    for cube_first in (True, False):
        mbs = exu.SystemContainer().AddSystem()
        rotated = {} if frame == "inertial" else {"referenceRotationMatrix": turn}
        upper = ep.CreatePartitionBody(
            mbs, body, name="cube", frame=frame, referencePosition=[*-place[:2], GAP - place[2]],
            initialVelocity=[0, 0, -SPEED], **rotated,
        )  # fmt: skip
        both = [upper, ep.CreatePartitionBody(mbs, plate, name="plate")][:: 1 if cube_first else -1]
        contacts = [ep.CreatePartitionContact(mbs, *both, passes="given", friction=friction)]
        if not cube_first:
            contacts.append(ep.CreatePartitionContact(mbs, *both, rows="edges", friction=friction))
            assert contacts[1].slave.name == "cube"
        mbs.Assemble()
        step = {"step": 4e-7} if method == "implicit" else {}
        result = ep.solve_dynamic(mbs, end_time=6e-5, method=method, **step)
        forces.append(np.array([contact.force(result) for contact in contacts]))
    assert not forces[1][0].any()
    np.testing.assert_allclose(forces[1][1], forces[0][0], rtol=1e-6, atol=1e-6 * forces[0].max())


@pytest.fixture(scope="module")
def bar_on_step():
    """A bar that stands with its end on the floor and leans on the edge of a step, and the step: bodies, turn, place.

    The patch of the bar is its lower face; that of the step has the floor, the tread and the riser between.
    """
    height, way, length = 10e-3, 20e-3, 60e-3
    low = occ.Box((-0.04, -0.01, -0.02), (0.03, 0.01, 0)) + occ.Box((0, -0.01, -0.02), (0.03, 0.01, height))
    step = ep.fe_model(low, ep.STEEL, maxh=10e-3)
    at = step.points[step.facets]
    x, y, _ = at.mean(axis=1).T
    faces = (at[..., 2] > -1e-9).all(axis=1) & (abs(y) < 0.0099) & (x < 0.0299)
    beam = ep.fe_model(box(length, way / 2, 8e-3), ep.STEEL, maxh=8e-3)
    face = ep.Partition.surface(beam, plane=((0, 0, 0), (0, 0, -1)), axes="xyz")
    turn = Rotation.from_euler("y", -np.arctan2(height, way)).as_matrix()
    place = np.array([-way, 0, GAP]) - turn @ [-length / 2, 0, 0]
    return ep.reduce(beam, face, f_cut=6e4), ep.reduce(step, ep.Partition.surface(step, faces), f_cut=5e4), turn, place


@pytest.mark.parametrize("friction", [None, 0.2])
def test_edges_of_both_bodies_touch_faces_at_once(bar_on_step, friction):
    """The bar's end meets the floor while the step's edge meets the bar, in implicit steps as in explicit ones."""
    beam, step, turn, place = bar_on_step
    impulses = []
    for method in ("implicit", "explicit"):
        mbs = exu.SystemContainer().AddSystem()
        options = {"referencePosition": place, "referenceRotationMatrix": turn, "initialVelocity": [0, 0, -0.5]}
        upper = ep.CreatePartitionBody(mbs, beam, frame="floating", **options)
        lower = ep.CreatePartitionBody(mbs, step, frame="floating")
        faces = ep.CreatePartitionContact(mbs, upper, lower, passes="given", friction=friction)
        edges = ep.CreatePartitionContact(mbs, upper, lower, rows="edges", friction=friction)
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=6e-5, method=method, **({"step": 3e-7} if method == "implicit" else {}))
        for contact in (faces, edges):
            first = result.t[np.argmax(contact.force(result) > 0)]
            assert GAP / 0.5 <= first <= 1.2 * GAP / 0.5 + result.step
        momentum = upper.momentum(result) + lower.momentum(result)
        np.testing.assert_allclose(momentum, momentum[[0]] + 0 * momentum, atol=1e-12)
        stored = sum(item.energy(result) for item in (upper, lower, faces, edges))
        energy = stored + faces.dissipated_energy(result) + edges.dissipated_energy(result)
        assert abs(energy / energy[0] - 1).max() < 2e-3
        impulses.append([np.trapezoid(contact.force(result), result.t) for contact in (faces, edges)])
    np.testing.assert_allclose(*impulses, rtol=0.01)
    assert np.min(impulses) > 1e-3


def test_edges_of_the_master_take_nothing_from_an_even_pressure(mbs):
    """A bar stands on one whose face ends at the same edges."""
    upper, lower = (ep.CreatePartitionBody(mbs, column(sign, False)) for sign in (1, -1))
    contacts = [ep.CreatePartitionContact(mbs, upper, lower, rows=rows) for rows in ("integrated", "edges")]
    even_pressure(mbs, contacts[0], [(upper, 1), (lower, -1)], 0.03)


def test_where_rows_of_edges_are_refused(mbs, cube, one_face, plate):
    upper = ep.CreatePartitionBody(mbs, one_face, name="cube", referencePosition=[0, 0, SIDE / 2 + GAP])
    lower = ep.CreatePartitionBody(mbs, plate, name="plate")
    edges = partial(ep.CreatePartitionContact, mbs, upper, lower, rows="edges")
    with pytest.raises(InputError, match="call CreatePartitionContact without rows='edges' first"):
        edges()
    ep.CreatePartitionContact(mbs, upper, lower)
    with pytest.raises(InputError, match="the master, body 'plate', has no sharp edges"):
        edges()
    with pytest.raises(InputError, match="need formulation='compliance'"):
        edges(formulation="penalty")
    with pytest.raises(InputError, match="interference: give it to the contact beside which"):
        edges(interference=1e-6)
    for master in (ep.RigidPlane(), upper):
        with pytest.raises(InputError, match="another partition body"):
            ep.CreatePartitionContact(mbs, upper, master, rows="edges", passes="given")
    with pytest.raises(InputError, match="of two bodies at a time"):
        ep.CreatePartitionContact(mbs, [upper, lower], rows="edges")
    mbs = exu.SystemContainer().AddSystem()
    upper = ep.CreatePartitionBody(mbs, one_face, referencePosition=[0, 0, SIDE / 2 + GAP])
    lower = ep.CreatePartitionBody(mbs, plate)
    ep.CreatePartitionContact(mbs, lower, upper, passes="given")
    ep.CreatePartitionContact(mbs, lower, upper, rows="edges")
    with pytest.raises(InputError, match="already have the contact"):
        ep.CreatePartitionContact(mbs, upper, lower, rows="edges")


def test_rows_of_edges_beside_a_plastic_zone_are_refused(mbs, one_face):
    """Both contacts would use the flexibility of the zone."""
    steel = replace(ep.STEEL, yield_stress=3e8, hardening=1e9)
    fem = ep.fe_model(box(0.04, 0.04, 0.02).Move((0, 0, -0.02)), steel, maxh=0.012)
    soft = ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 0.02, axes="xyz", plastic_radius=8e-3), f_cut=3e4)
    upper = ep.CreatePartitionBody(mbs, one_face, referencePosition=[0, 0, SIDE / 2 + GAP])
    lower = ep.CreatePartitionBody(mbs, soft)
    ep.CreatePartitionContact(mbs, lower, upper, passes="given")
    with pytest.raises(InputError, match="without plastic zones"):
        ep.CreatePartitionContact(mbs, lower, upper, rows="edges")


def column(sign, all_around):
    """A bar above or below the plane z = 0; its patch is its end, and perhaps the sides beside it."""
    return bar(sign, SIDE / (2 if sign > 0 else 2.5), all_around)


@pytest.mark.parametrize("all_around", [True, False])
@pytest.mark.parametrize(("frame", "master"), [("inertial", "plane"), ("floating", "plane"), ("inertial", "bar")])
def test_a_face_between_sharp_edges_bears_an_even_pressure(mbs, frame, master, all_around):
    """Pressed on a plane, or on a bar whose mesh does not match; the patch goes around its edges, or ends there."""
    upper = ep.CreatePartitionBody(mbs, column(1, all_around), frame=frame)
    other = ep.RigidPlane() if master == "plane" else ep.CreatePartitionBody(mbs, column(-1, False), frame=frame)
    contact = ep.CreatePartitionContact(mbs, upper, other)
    bars = [(upper, 1)] if master == "plane" else [(upper, 1), (other, -1)]
    even_pressure(mbs, contact, bars, 1e-6 if master == "plane" else 0.03)


def even_pressure(mbs, contact, bars, error):
    """Press the first of some bars, each with the side of z = 0 on which it is, and look at the pressure."""
    for item, sign in bars:
        head = item.CreateInterfaceMarker(mbs, "head")
        guide = items.GenericJoint(markerNumbers=[ground(mbs, (0, 0, sign * 2 * SIDE)), head])
        guide.constrainedAxes = [1, 1, int(sign < 0), 1, 1, 1]
        mbs.AddObject(guide)
        if sign > 0:
            mbs.AddLoad(items.LoadForceVector(markerNumber=head, loadVector=[0, 0, -FORCE]))
    mbs.Assemble()
    result = ep.solve_static(mbs, load_steps=2)
    surface = contact.mechanics.gaps.slave.surface
    inner = np.isclose(surface.points[:, 2], 0, atol=1e-6) & (abs(surface.points[:, :2]).max(axis=1) < 0.49 * SIDE)
    pressure = contact.pressure(result).toarray()[-1, inner] / (FORCE / SIDE**2)
    assert inner.any()
    np.testing.assert_allclose(pressure, 1.0, rtol=error)
    assert contact.area(result)[-1] == pytest.approx(SIDE**2, rel=1e-6)
    at_edges = contact.row_forces(result).toarray()[-1, surface.sharp]
    assert at_edges.sum() < min(error, 0.02) * FORCE


@pytest.mark.parametrize("master", ["plane", "plate"])
def test_a_penalty_layer_has_no_rows_of_edges(cube, plate, master):
    """Its force is that of an area, also if another model has the same bodies with another formulation."""
    areas = []
    for formulation in ("compliance", "penalty", "compliance"):
        mbs = exu.SystemContainer().AddSystem()
        item = ep.CreatePartitionBody(mbs, cube, referencePosition=[0, 0, SIDE / 2 + 1e-3])
        other = ep.RigidPlane() if master == "plane" else ep.CreatePartitionBody(mbs, plate)
        contact = ep.CreatePartitionContact(mbs, item, other, formulation=formulation, passes="given")
        points, *_ = contact.mechanics.gaps.placed_rows()
        areas.append(points.area)
    assert [bool((area == 0).any()) for area in areas] == [True, False, True]


@A_CORNER
def test_the_body_whose_edge_meets_a_face_is_the_slave(cube, on_corner, one_face):
    """Both have sharp edges; each is given first, and passes="given" keeps the order."""
    up = np.array([0, 0, SIDE / 2])
    corner = lowest(on_corner.points, np.array([0.0, 0.0, 1.0]))
    lower_face = ep.fe_model(box(2 * SIDE, 2 * SIDE, SIDE).Move((0, 0, -SIDE)), ep.STEEL, maxh=SIDE / 3)
    top = ep.Partition.surface(lower_face, plane=((0, 0, 0), (0, 0, 1)), axes="xyz")
    floor = ep.reduce(lower_face, top, f_cut=3e4)
    for upper, at, lower, base in (
        (on_corner, [*up[:2], GAP - corner[2]] - np.r_[corner[:2], 0], cube, -up),  # a corner
        (one_face, up + np.array([0, 0, GAP]), floor, np.zeros(3)),  # a face, whose edges lie within the other one
    ):
        for order, passes in product((1, -1), ("finer", "given")):
            mbs = exu.SystemContainer().AddSystem()
            high = ep.CreatePartitionBody(mbs, upper, name="upper", referencePosition=at)
            low = ep.CreatePartitionBody(mbs, lower, name="lower", referencePosition=base)
            given = [high, low][::order]
            slave = ep.CreatePartitionContact(mbs, *given, passes=passes).slave
            assert slave == (high if passes == "finer" else given[0])


@pytest.mark.parametrize("way", [(0.3, 0.1), (-0.9, 0.5)])
def test_a_face_that_stands_over_an_edge_has_not_left_a_patch(cube, way):
    """Beyond a sharp edge of the master there is no surface that the patch does not have."""
    master = cube.surface(np.zeros(3))
    slave = cube.surface(np.array([way[0] * SIDE, way[1] * SIDE, SIDE + GAP]))
    rows = pair_wandering(slave, master)
    assert len(rows) > 0
    assert not np.isfinite(rows.leaves_at).any()
    np.testing.assert_allclose(rows.gap, GAP, rtol=1e-6)


def test_mean_normals_at_edges_are_told(mbs):
    """The patch then yields along them only; without the option it yields along all axes."""
    fem = ep.fe_model(box(SIDE, SIDE, SIDE).Move((0, 0, -SIDE / 2)), ep.STEEL, maxh=SIDE / 2)
    faces = np.arange(len(fem.facets))
    assert ep.Partition.surface(fem, faces).patches[0].axes == "xyz"
    body = ep.reduce(fem, ep.Partition.surface(fem, faces, axes="normal"), f_cut=8e4)
    with pytest.warns(ModelLimitWarning, match="more than 30 degrees off the normals of its nodes.*Leave axes= out"):
        fall(mbs, body, EDGE)


@pytest.mark.filterwarnings("ignore:.*only a sharp corner or edge touches")
def test_a_face_that_ends_at_an_edge_needs_axes(mbs):
    """It has no sharp edge within: without the option it yields along its normal."""
    fem = ep.fe_model(box(SIDE, SIDE, SIDE).Move((0, 0, -SIDE / 2)), ep.STEEL, maxh=SIDE / 2)
    side = ep.Partition.surface(fem, plane=((SIDE / 2, 0, 0), (1, 0, 0)))
    body = ep.reduce(fem, side, f_cut=8e4)
    low = -SIDE / 2 * (np.sin(0.3) + np.cos(0.3))
    turn = Rotation.from_euler("y", 0.3).as_matrix()
    options = {"referencePosition": [0, 0, 1e-6 - low], "referenceRotationMatrix": turn}
    item = ep.CreatePartitionBody(mbs, body, frame="floating", initialVelocity=[0, 0, -1.0], **options)
    ep.CreatePartitionContact(mbs, item, ep.RigidPlane())
    mbs.Assemble()
    with pytest.warns(ModelLimitWarning, match='off the normals of its nodes.*Give its partition axes="xyz"'):
        ep.solve_dynamic(mbs, end_time=20e-6)


@pytest.mark.parametrize("patch", ["cube", "one_face"])
def test_uniform_pressure_needs_no_force_at_edges(request, patch):
    """The rows of all other nodes make the nodal forces of a uniform pressure."""
    cube = request.getfixturevalue(patch)
    surface = cube.surface(np.zeros(3))
    points = contact_points(surface, "integrated")
    at_edges = np.isin(points.row_nodes, surface.sharp)
    assert at_edges.sum() == np.count_nonzero((np.isclose(abs(surface.points), SIDE / 2)).sum(axis=1) > 1)
    assert not points.area[at_edges].any()
    on_nodes = np.zeros(len(surface.points))
    np.add.at(on_nodes, points.nodes, points.weights * (points.mean.T @ points.area)[:, None])
    plain = contact_points(surface.without_edges, "integrated")
    expected = np.zeros(len(surface.points))
    np.add.at(expected, plain.nodes, plain.weights * (plain.mean.T @ plain.area)[:, None])
    np.testing.assert_allclose(on_nodes, expected, atol=1e-12 * expected.max())
    np.testing.assert_allclose(points.pressures @ points.area, 1.0, rtol=1e-12)
