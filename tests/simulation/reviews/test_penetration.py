"""Bodies within each other: at the start, deep in a run, and at corners that no mean gap holds; and what gaps tell."""

import re
import warnings

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
from exudyn.utilities import InertiaCuboid
from oracles import add_loads, box
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.errors import ContactPatchWarning, ModelLimitWarning
from exudyn_partition.fe.facets import flat_triangles

SIDE, LENGTH = 10e-3, 40e-3
INITIAL = exu.ConfigurationType.Initial


@pytest.fixture(scope="module")
def bars():
    """Two steel bars, one above the plane z = 0 and one beneath, and the first with a patch of three axes."""
    found = []
    for low, sign, axes in ((0.0, -1, "normal"), (-LENGTH, 1, "normal"), (0.0, -1, "xyz")):
        shape = occ.Box(occ.Pnt(-SIDE / 2, -SIDE / 2, low), occ.Pnt(SIDE / 2, SIDE / 2, low + LENGTH))
        fem = ep.fe_model(shape, ep.STEEL, maxh=8e-3)
        part = ep.Partition.ball(fem, (0, 0, 0), 0.75 * SIDE, direction=(0, 0, sign), axes=axes)
        found.append(ep.reduce(fem, part, f_cut=60e3))
    return found


MASTERS = {
    "plane": ep.RigidPlane(),
    "sphere": ep.RigidSphere((0, 0, -50.0), 50.0),
    "cylinder": ep.RigidCylinder((0, 0, -50.0), (1, 0, 0), 50.0),
    "bar": None,
}


def stands(bars, *, master="plane", friction=None, frame="inertial", **options):
    """Model, upper bar and contact, not assembled; it stands on something."""
    mbs = exu.SystemContainer().AddSystem()
    upper = ep.CreatePartitionBody(mbs, bars[0 if friction is None else 2], name="bar", frame=frame)
    other = MASTERS[master]
    if other is None:
        other = ep.CreatePartitionBody(mbs, bars[1], name="lower", frame=frame)
    contact = ep.CreatePartitionContact(mbs, upper, other, friction=friction, **options)
    return mbs, upper, contact


def lower_by(mbs, upper, depth):
    """Initial coordinates at which the upper bar is that deep in the other body."""
    q = np.array(mbs.systemData.GetODE2Coordinates(INITIAL))
    way = upper.body.rigid[:, 2] * -depth if upper.frame == "inertial" else np.r_[0, 0, -depth]
    q[: len(way)] = way
    mbs.systemData.SetODE2Coordinates(q, INITIAL)


@pytest.mark.parametrize(
    ("depth", "options"),
    [
        (1e-5, {}),
        (1e-6, {"frame": "floating"}),
        (1e-3, {}),
        (1e-5, {"master": "bar"}),
        (1e-5, {"master": "sphere"}),
        (1e-5, {"master": "cylinder"}),
        (1e-5, {"friction": 0.2}),
        (1e-5, {"formulation": "penalty"}),
    ],
)
def test_an_overlap_by_initial_coordinates_warns_and_gaps_tell_it(bars, depth, options):
    mbs, upper, contact = stands(bars, **options)
    mbs.Assemble()
    lower_by(mbs, upper, depth)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = ep.solve_dynamic(mbs, end_time=20e-6)
    (said,) = (str(w.message) for w in caught if "starts with an overlap" in str(w.message))
    assert f"overlap of {depth:.3g} m" in said
    assert contact.gap(result)[0] == pytest.approx(-depth, rel=1e-3)
    assert contact.depth(result.at(result.t[:1])) == pytest.approx(depth, rel=1e-3)


def test_a_carried_surface_that_starts_in_a_body_warns(mbs, bars):
    """Its place is not known after the run: the gap is that of the rows."""
    bar = ep.CreatePartitionBody(mbs, bars[0], name="bar")
    kind, cuboid = exu.NodeType.RotationRotationVector, InertiaCuboid(7800, [0.02] * 3)
    made = mbs.CreateRigidBody(inertia=cuboid, nodeType=kind, returnDict=True)
    mbs.SetNodeParameter(made["nodeNumber"], "initialCoordinates", [0, 0, 1e-5, 0, 0, 0])
    contact = ep.CreatePartitionContact(mbs, bar, ep.RigidPlane(), masterBody=made["bodyNumber"])
    mbs.Assemble()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = ep.solve_dynamic(mbs, end_time=5e-6, step=0.1e-6)
    assert any("overlap of 1e-05 m" in str(w.message) for w in caught)
    assert contact.gap(result)[0] == pytest.approx(-1e-5, rel=1e-6)


@pytest.mark.filterwarnings("ignore:the bodies have lost")  # in steps for bodies at rest, too long for such a start
def test_an_overlap_by_initial_modal_coordinates_warns(bars):
    """The bar is stretched, so that its end lies in the plane."""
    mbs, _, contact = stands(bars)
    mbs.Assemble()
    body = bars[0]
    q = np.zeros(body.n_dofs)
    rows = body.rows(body.partition.patch_nodes)[2::3]
    q[6 + np.argmax(abs(rows[:, 6:].mean(axis=0)))] = 1.0
    q *= -2e-6 / abs(rows @ q).max() * np.sign((rows @ q)[abs(rows @ q).argmax()])
    mbs.systemData.SetODE2Coordinates(q, INITIAL)
    with pytest.warns(ModelLimitWarning, match="starts with an overlap of 2e-06 m"):
        result = ep.solve_dynamic(mbs, end_time=10e-6)
    assert contact.gap(result)[0] == pytest.approx(-2e-6, rel=1e-3)


def test_multipliers_throw_overlapping_bodies_apart_too(block, top, kept):
    body = ep.reduce(block, top, basis="craig-bampton", f_cut=100e3, cache=kept)
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body)
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane((0, 0, 0.03), (0, 0, -1)), formulation="lagrange")
    mbs.Assemble()
    mbs.systemData.SetODE2Coordinates(body.rigid[:, 2] * 1e-5, INITIAL)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = ep.solve_dynamic(mbs, end_time=1e-6, method="implicit", step=0.1e-6)
    assert any("overlap of 1e-05 m, but multipliers close it" in str(w.message) for w in caught)
    assert contact.gap(result)[0] == pytest.approx(-1e-5, rel=1e-6)


def test_a_run_that_goes_on_in_contact_is_no_overlap(bars):
    """Neither in the middle of an impact nor under a load that a static answer has balanced."""
    mbs, _, contact = stands(bars)
    mbs.Assemble()
    mbs.systemData.SetODE2Coordinates_t(bars[0].rigid[:, 2] * -0.1, INITIAL)
    first = ep.solve_dynamic(mbs, end_time=5e-6)
    assert contact.force(first)[-1] > 0
    mbs.systemData.SetSystemState(mbs.systemData.GetSystemState(), INITIAL)
    for _ in range(2):  # the last run ended elsewhere, but the one before it ended in the initial state
        second = ep.solve_dynamic(mbs, end_time=5e-6)
        assert contact.gap(second)[0] == contact.gap(first)[-1] < 0


@pytest.mark.filterwarnings("ignore:body 'bar'. nothing holds it")
def test_bodies_that_rest_on_each_other_may_begin_so(bars):
    """A load presses the bar on the plane; its equilibrium is the initial state of another model."""

    def model():
        mbs, upper, contact = stands(bars)
        add_loads(mbs, upper, np.asarray(bars[0].mass @ bars[0].rigid)[:, 2] * -1e5)
        mbs.Assemble()
        return mbs, contact

    mbs, contact = model()
    q = mbs.systemData.GetODE2Coordinates(INITIAL)
    ep.solve_static(mbs, load_steps=1)
    rests = mbs.systemData.GetODE2Coordinates()
    assert (rests != q).any()
    other, contact = model()
    other.systemData.SetODE2Coordinates(rests, INITIAL)
    result = ep.solve_dynamic(other, end_time=20e-6)
    weight = 1e5 * bars[0].total_mass
    np.testing.assert_allclose(contact.force(result), weight, rtol=1e-3)
    assert contact.gap(result)[0] < 0


def test_a_soft_penalty_lets_bodies_through_and_says_so(bars):
    mbs = exu.SystemContainer().AddSystem()
    upper = ep.CreatePartitionBody(mbs, bars[0], initialVelocity=[0, 0, -1.0])
    lower = ep.CreatePartitionBody(mbs, bars[1])
    contact = ep.CreatePartitionContact(mbs, upper, lower, formulation="penalty", stiffness=1e9)
    mbs.Assemble()
    with pytest.warns(ModelLimitWarning, match=r"penetrate each other .*stiffness of 1e\+09 N/m3 is too soft"):
        result = ep.solve_dynamic(mbs, end_time=0.4e-3, step=0.5e-6)
    way = lower.displacement(result, (0, 0, 0))[:, 2] - upper.displacement(result, (0, 0, 0))[:, 2]
    np.testing.assert_allclose(contact.gap(result), -way, atol=2e-3 * way.max())
    assert contact.depth(result) == pytest.approx(way.max(), rel=2e-3)


def test_the_usual_penalty_says_nothing(bars):
    mbs, _, contact = stands(bars, formulation="penalty")
    mbs.Assemble()
    mbs.systemData.SetODE2Coordinates_t(bars[0].rigid[:, 2] * -0.1, INITIAL)
    result = ep.solve_dynamic(mbs, end_time=30e-6)
    assert 0 < contact.depth(result) < 1e-4 * SIDE
    gap, force = contact.gap(result), contact.force(result)
    assert (gap[force > 0] < 0).all()


@pytest.fixture(scope="module")
def cube():
    """A steel cube about the origin; its patch is the whole skin."""
    shape = box(0.1, 0.1, 0.1).Move((0, 0, -0.05))
    for face in shape.faces:
        face.name = "skin"
    fem = ep.fe_model(shape, ep.STEEL, maxh=0.05)
    return fem, ep.reduce(fem, ep.Partition.surface(fem, "skin", name="skin"), f_cut=9e3)


@pytest.mark.parametrize(
    ("turn", "options", "told"),
    [
        ([0.2, 0.4, 0.6], {"formulation": "penalty"}, True),
        ([np.pi / 4, 0, 0], {"formulation": "penalty"}, True),
        ([0.2, 0.4, 0.6], {"formulation": "penalty", "rows": "node-to-segment"}, False),
        ([0.2, 0.4, 0.6], {}, False),
        ([np.pi / 4, 0, 0], {}, False),
        ([0, 0, 0], {}, False),
    ],
)
def test_a_corner_or_edge_that_sinks_into_a_rigid_surface_is_told(cube, turn, options, told):
    """A cube falls on its corner, its edge or its face; the rows of a penalty layer are all means around nodes."""
    fem, body = cube
    turned = Rotation.from_euler("xyz", turn).as_matrix()
    lowest = (fem.points @ turned.T)[:, 2].min()
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(
        mbs,
        body,
        name="cube",
        frame="floating",
        referencePosition=[0, 0, 1e-6 - lowest],
        referenceRotationMatrix=turned,
        initialVelocity=[0, 0, -1.0],
    )
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), **options)
    mbs.Assemble()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = ep.solve_dynamic(mbs, end_time=1e-3 if told else 20e-6, method="implicit", step=1e-5 if told else 1e-6)
    said = [w for w in caught if "with no closed row around" in str(w.message)]
    assert bool(said) == told
    if told:
        assert said[0].category is ContactPatchWarning
        assert "of body 'cube' are below the rigid surface" in str(said[0].message)
        assert not contact.force(result).any()
        assert contact.gap(result)[-1] == pytest.approx(-1e-3, rel=0.02)


@pytest.mark.parametrize(("degrees", "told", "carried"), [(5.0, True, False), (5.0, True, True), (0.0, False, False)])
def test_an_edge_at_the_end_of_a_patch_that_sinks_is_told(cube, degrees, told, carried):
    """The patch is a region of the lower face, up to its edges; only patches of faces have rows there."""
    fem, _ = cube
    body = ep.reduce(fem, ep.Partition.ball(fem, (0, 0, -0.05), 0.08, direction=(0, 0, -1)), f_cut=9e3)
    turn = Rotation.from_euler("xyz", [np.radians(degrees), 0, 0]).as_matrix()
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(
        mbs, body, frame="floating", referencePosition=[0, 0, 1e-6 - (fem.points @ turn.T)[:, 2].min()],
        referenceRotationMatrix=turn, initialVelocity=[0, 0, -1.0],
    )  # fmt: skip
    below = {}
    if carried:  # the plane in axes of a ground that is 0.1 m beneath
        below["masterBody"] = mbs.CreateGround(referencePosition=[0, 0, -0.1])
    ep.CreatePartitionContact(mbs, item, ep.RigidPlane((0, 0, 0.1 * carried)), **below)
    mbs.Assemble()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        ep.solve_dynamic(mbs, end_time=1.5e-3 if told else 1e-4, method="implicit", step=1e-5)
    said = [w for w in caught if "with no closed row around" in str(w.message)]
    assert bool(said) == told
    assert not told or "patches of Partition.surface have rows of their own" in str(said[0].message)


@pytest.fixture(scope="module")
def faces(cube):
    """Lower and upper face of the cube alone, as patches of a body each; the faces end at the edges that cross."""
    fem, _ = cube
    return [
        ep.reduce(fem, ep.Partition.surface(fem, plane=((0, 0, z), (0, 0, z)), axes="xyz"), f_cut=9e3)
        for z in (-0.05, 0.05)
    ]


TURNS = {
    "edges that cross": ([np.pi / 4, 0, 0], [0, np.pi / 4, 0]),
    "ends of faces that cross": ([0.3, 0, 0], [0, 0.3, 0]),
    "a corner of the master": ([0, 0, 0], [0.2, 0.4, 0.6]),
    "rows of the master's edges": ([0, 0, 0], [0.2, 0.4, 0.6]),
    "a corner of the slave": ([0.2, 0.4, 0.6], [0, 0, 0]),
    "faces": ([0, 0, 0], [0, 0, 0]),
}


@pytest.mark.parametrize("corner", [True, False])
def test_a_corner_of_a_rigid_mesh_that_no_row_holds_is_told(cube, mbs, corner):
    """A cube falls flat on a rigid one, that stands on its corner or lies flat."""
    fem, body = cube
    turn = Rotation.from_euler("xyz", [0.2, 0.4, 0.6] if corner else [0, 0, 0]).as_matrix()
    points = (fem.points - fem.points.mean(axis=0)) @ turn.T
    tip = points[points[:, 2] > points[:, 2].max() - 1e-9].mean(axis=0)
    anvil = ep.RigidMesh(points - tip, flat_triangles(fem.facets)[0])
    middle = fem.points.mean(axis=0) * [1, 1, 0] + [0, 0, fem.points[:, 2].min()]
    upper = ep.CreatePartitionBody(mbs, body, referencePosition=[0, 0, 1e-6] - middle, initialVelocity=[0, 0, -1.0])
    contact = ep.CreatePartitionContact(mbs, upper, anvil)
    mbs.Assemble()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = ep.solve_dynamic(mbs, end_time=1e-3 if corner else 2e-4, method="implicit", step=1e-5)
    assert contact.force(result).any() != corner
    assert any("a sharp edge of the rigid surface" in str(w.message) for w in caught) == corner


def falling(fem, bodies, case, place):
    """Model, upper and lower cube: what is lowest of the upper one is above what is highest of the lower one."""
    turns = [Rotation.from_euler("xyz", turn).as_matrix() for turn in TURNS[case]]
    mbs, meet = exu.SystemContainer().AddSystem(), []
    for turn, up in zip(turns, (-1, 1), strict=True):  # the middle of the lowest points, and of the highest ones
        points = fem.points @ turn.T
        height = up * points[:, 2]
        meet.append(points[np.isclose(height, height.max(), atol=1e-9)].mean(axis=0))
    upper, lower = (
        ep.CreatePartitionBody(
            mbs, body, name=name, frame="floating", referencePosition=place, referenceRotationMatrix=turn,
            initialVelocity=[0, 0, speed],
        )
        for body, name, turn, place, speed in (
            (bodies[0], "upper", turns[0], place - meet[0], -1.0),
            (bodies[1], "lower", turns[1], -meet[1], 0.0),
        )
    )  # fmt: skip
    return mbs, upper, lower


def test_the_depth_of_edges_that_cross_is_the_way_they_have_passed(cube):
    """They cross 4.5 mm beside an end of the upper one, whose end face has edges there too."""
    fem, body = cube
    mbs, upper, lower = falling(fem, [body, body], "edges that cross", np.array([0.0455, 0.01, 1e-6]))
    ep.CreatePartitionContact(mbs, upper, lower, passes="given")
    mbs.Assemble()
    with pytest.warns(ContactPatchWarning, match="a sharp edge of body 'lower'") as caught:
        ep.solve_dynamic(mbs, end_time=1e-3, method="implicit", step=1e-5)
    time, depth = (
        float(found) for found in re.search(r"t = (\S+) s: .* is (\S+) m within", str(caught[0].message)).groups()
    )
    assert depth == pytest.approx(time - 1e-6, rel=1e-2)  # at 1 m/s


@pytest.mark.filterwarnings("ignore:.*only a sharp corner or edge touches")
@pytest.mark.parametrize("case", TURNS)
def test_edges_that_no_row_holds_are_told(cube, faces, case):
    """One cube falls on another one: edges that cross, and corners of the master, sink in without a force."""
    (fem, body), told = cube, case == "a corner of the master" or "cross" in case
    bodies = faces if case.startswith("ends") else [body, body]
    mbs, upper, lower = falling(fem, bodies, case, np.array([0.02, 0.01, 1e-6]))
    contacts = [ep.CreatePartitionContact(mbs, upper, lower, passes="given")]
    if case.startswith("rows"):
        contacts.append(ep.CreatePartitionContact(mbs, upper, lower, rows="edges"))
    mbs.Assemble()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = ep.solve_dynamic(mbs, end_time=1e-3 if told else 2e-4, method="implicit", step=1e-5)
    assert contacts[-1].force(result).any() != told
    said = [w for w in caught if "a sharp edge of body 'lower'" in str(w.message)]
    assert bool(said) == told
    if told:
        assert said[0].category is ContactPatchWarning
        assert "no closed row around" in str(said[0].message)
