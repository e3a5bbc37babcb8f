"""The state of a run is one value: from a file, in a new model, a run goes on as if nothing had been between.

What goes on from a `Result` that was read from a file has nothing but the arrays in it: new items and contacts, no kept
flexibility, no guesses. A cache that decided would show here.
"""

import pickle
from dataclasses import replace

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
import pytest
from exudyn.utilities import InertiaCuboid
from oracles import MARBLE_RADIUS as R
from oracles import add_springs, contributed

import exudyn_partition as ep
from exudyn_partition.errors import InputError
from exudyn_partition.reduction import free_body

pytestmark = pytest.mark.filterwarnings("ignore")
NEXT = 1e-9  # of the largest force: the next force of a fresh contact
ROUND_OFF = 1e-12  # the same of pairs that follow facets
NEWTON = 5e-8  # the same in implicit steps: what Newton's method leaves
SINGLE = 1e-6  # the same of plastic zones in explicit steps, whose products are in single precision
MU, STEP = 0.3, 0.25e-6


# Bodies.


@pytest.fixture(scope="module")
def pair(round_body, flat_body):
    """A ball and a plate."""
    return round_body, flat_body


@pytest.fixture(scope="module")
def nodal_pair():
    """A coarse ball and a coarse plate with every node of their patches."""
    refine = [ep.Refine((0, 0, 0), 0.6e-3, 0.5e-3)]
    plate = occ.Box(occ.Pnt(-6e-3, -6e-3, -4e-3), occ.Pnt(6e-3, 6e-3, 0))
    found = []
    for shape, maxh, radius in (
        (occ.Sphere(occ.Pnt(0, 0, 0.01), 0.01), 4e-3, 0.7e-3),
        (plate, 3.8e-3, 1.0e-3),
    ):
        fem = ep.fe_model(shape, ep.STEEL, maxh=maxh, refine=refine, grading=0.8)
        partition = ep.Partition.ball(fem, (0, 0, 0), radius, axes="xyz")
        found.append(ep.reduce(fem, partition, basis="free", f_cut=150e3))
    return found


@pytest.fixture(scope="module")
def marble_fem():
    refine = [ep.Refine(p, 0.5e-3, 0.2e-3) for p in ((0, 0, -R), (0, 0, R))]
    return ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), R), ep.STEEL, maxh=2.5e-3, refine=refine, grading=0.5)


@pytest.fixture(scope="module")
def marbles(marble_fem):
    """A marble with a patch at either pole, by axes."""

    def marble(axes):
        south, north = (
            ep.Partition.ball(marble_fem, (0, 0, z), 0.5e-3, name=name, axes=axes)
            for z, name in ((-R, "south"), (R, "north"))
        )
        return ep.reduce(marble_fem, south | north, f_cut=300e3)

    return {axes: marble(axes) for axes in ("normal", "xyz")}


@pytest.fixture(scope="module")
def rolling_parts():
    """FE model and partition of a ball over whose skin contact wanders."""
    fine = [ep.Refine((0, 0, 0), 0.8e-3, 0.25e-3)]
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, R), R), ep.STEEL, maxh=2.5e-3, refine=fine, grading=0.6)
    return fem, ep.Partition.surface(fem, near=(0, 0, 0), axes="xyz")


@pytest.fixture(scope="module")
def rolling(rolling_parts):
    """This ball."""
    return ep.reduce(*rolling_parts, f_cut=100e3)


@pytest.fixture(scope="module")
def grooved():
    """A ball with one patch for both planes of a groove."""
    normals = np.array([[1, 0, 1], [-1, 0, 1]]) / np.sqrt(2)
    fine = [ep.Refine(-R * normal, 0.3e-3, 0.12e-3) for normal in normals]
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), R), ep.STEEL, maxh=2.5e-3, refine=fine, grading=0.6)
    below = np.flatnonzero(fem.points[fem.facets[:, :3], 2].mean(axis=1) < -0.5 * R)
    return ep.reduce(fem, ep.Partition.surface(fem, below, name="below", axes="xyz"), f_cut=100e3), normals


@pytest.fixture(scope="module")
def strip():
    """A strip that is clamped at one end, and hits with the other."""
    shape = occ.Box(occ.Pnt(0, -1e-3, 0), occ.Pnt(20e-3, 1e-3, 1.5e-3))
    fem = ep.fe_model(shape, ep.STEEL, maxh=2e-3)
    interface = ep.Partition.interface(fem, "foot", plane=((0, 0, 0), (-1, 0, 0)))
    return ep.reduce(fem, ep.Partition.ball(fem, (18e-3, 0, 0), 2e-3, axes="xyz") | interface, f_cut=60e3)


# Models: functions that make one, its bodies and its contacts.


def on_surface(body, *, frame="inertial", carried=False, surface=None, speed=(0.5, 0, -1.0), damping=None, **options):
    """A ball that hits a rigid surface at an angle; `carried`: a plane on a body that turns."""
    mbs = exu.SystemContainer().AddSystem()
    place = {"referencePosition": [0, 0, 1e-6], "initialVelocity": [*speed]}
    spin = {"initialAngularVelocity": [0, 300.0, 0]} if frame == "floating" else {}
    item = ep.CreatePartitionBody(mbs, body, frame=frame, damping=damping, **place, **spin)
    surface = ep.RigidPlane() if surface is None else surface
    if carried:
        kind = exu.NodeType.RotationRotationVector
        carrier = {"referencePosition": [0, 0, -0.01], "initialAngularVelocity": [5.0, 3.0, 0], "nodeType": kind}
        options["masterBody"] = mbs.CreateRigidBody(inertia=InertiaCuboid(7800, [0.02] * 3), **carrier)
        surface = ep.RigidPlane((0, 0, 0.01), (0, 0, 1))
    contact = ep.CreatePartitionContact(mbs, item, surface, **options)
    mbs.Assemble()
    return mbs, [item], [contact]


def on_plate(pair, *, frame="inertial", speed=(3.0, 0, -1.0), x=0.0, **options):
    """A ball that hits a plate at an angle, x [m] beside its middle, and slides on it."""
    mbs, (ball, plate) = exu.SystemContainer().AddSystem(), pair
    place = {"referencePosition": [x, 0, 1e-6], "initialVelocity": [*speed]}
    items = [ep.CreatePartitionBody(mbs, ball, frame=frame, **place), ep.CreatePartitionBody(mbs, plate, frame=frame)]
    contact = ep.CreatePartitionContact(mbs, *items, **options)
    mbs.Assemble()
    return mbs, items, [contact]


def in_a_row(body, *, frame="inertial", along=2.0, damping=None, **options):
    """Three marbles, whose two contacts move each other."""
    mbs, balls = exu.SystemContainer().AddSystem(), []
    for i in range(3):
        velocity = [along, 0, -0.5] if i == 2 else [0, 0, 0]
        place = {"referencePosition": [0, 0, (2 * R + 1e-7) * i], "initialVelocity": velocity}
        balls.append(ep.CreatePartitionBody(mbs, body, name=str(i), frame=frame, damping=damping, **place))
    patches = {"slavePatch": "south", "masterPatch": "north", **options}
    contacts = [ep.CreatePartitionContact(mbs, balls[i + 1], balls[i], **patches) for i in range(2)]
    mbs.Assemble()
    return mbs, balls, contacts


def in_groove(grooved, **options):
    """A ball that slides along a groove of two planes, which press one patch."""
    mbs, (body, normals) = exu.SystemContainer().AddSystem(), grooved
    ball = ep.CreatePartitionBody(mbs, body, initialVelocity=[0, 6.0, -0.5])
    planes = [ep.RigidPlane(-(R + 1e-7) * normal, normal) for normal in normals]
    contacts = [ep.CreatePartitionContact(mbs, ball, plane, **options) for plane in planes]
    mbs.Assemble()
    return mbs, [ball], contacts


def clamped(strip, frame):
    """A strip with damping that is pressed on a plane by its weight, which is large."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, strip, frame=frame, damping=0.02, gravity=[0, 0, -3e4])
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(point=(0, 0, -1e-6)), friction=MU)
    ground = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.CreateGround(), localPosition=[0, 0, 0.75e-3]))
    foot = item.CreateInterfaceMarker(mbs, "foot")
    mbs.AddObject(items.GenericJoint(markerNumbers=[ground, foot], constrainedAxes=[1] * 6))
    mbs.Assemble()
    return mbs, [item], [contact]


# Checks.


def cut_run(make, cut, path, **options):
    """Run a model to `cut`, and write the result."""
    mbs, _, contacts = make()
    result = ep.solve_dynamic(mbs, end_time=cut, **options)
    result.save(path)
    return contacts, result


def gone_on(make, path, end, **options):
    """A new model goes on from the file: its contacts and the result."""
    mbs, _, contacts = make()
    result = ep.solve_dynamic(mbs, end_time=end, go_on=ep.Result.load(path, mbs), **options)
    assert result.status == "finished"
    return contacts, result


def assert_goes_on(make, cut, path, within=NEXT, later=None, first=0, **options):
    """The next force after a cut, and all that one sees of ten steps, are those of one run.

    Impulses of multipliers are known from step to step: the `first` force that is a mean over both sides of the cut is
    not.
    """
    options = {"step": STEP} | options
    end = cut + 10 * options["step"]
    mbs, _, contacts = make()
    whole = ep.solve_dynamic(mbs, end_time=cut if "adaptive" in options else end, **options)
    if "adaptive" in options:  # whose last step ends with the run
        whole = ep.solve_dynamic(mbs, end_time=end, go_on=True, **options)
    cut_run(make, cut, path, **options)
    fresh, result = gone_on(make, path, end, **options)
    start = int(np.flatnonzero(abs(whole.t - cut) < 1e-3 * options["step"])[0])
    closed = 0.0
    for contact, other in zip(fresh, contacts, strict=True):
        force, right = contact.force(result), other.force(whole)
        largest = abs(right).max()
        closed = max(closed, abs(right[start]))
        np.testing.assert_allclose(force[first:2], right[start + first : start + 2], rtol=0, atol=within * largest)
        np.testing.assert_allclose(force[1:], right[start + 1 :], rtol=0, atol=(later or 10 * within) * largest)
        for name in ("energy", "dissipated_energy"):
            energy, known = getattr(contact, name)(result), getattr(other, name)(whole)
            np.testing.assert_allclose(energy, known[start:], rtol=0, atol=1e2 * within * abs(known).max() + 1e-18)
    assert closed > 0.0  # otherwise nothing would be shown


# Explicit steps.

LAWS = {
    "compliance": {},
    "friction": {"friction": MU},
    "penalty": {"formulation": "penalty"},
    "penalty, friction": {"formulation": "penalty", "friction": MU},
    "two coefficients": {"friction": ep.Coulomb(0.4, 0.2, decay=0.1)},
}


@pytest.mark.parametrize("frame", ["inertial", "floating"])
@pytest.mark.parametrize("law", LAWS)
def test_patches_that_slide(pair, law, frame, tmp_path):
    assert_goes_on(lambda: on_plate(pair, frame=frame, **LAWS[law]), 12e-6, tmp_path / "cut.npz", ROUND_OFF)


@pytest.mark.parametrize("solver", ["exudyn", "compiled"])
@pytest.mark.parametrize(("friction", "where"), [(None, 1.45e-3), (MU, 1.3e-3)])
def test_contact_that_slides_past_the_end_of_a_patch(pair, friction, where, solver, tmp_path):
    """Which points face a patch is found from time to time. One that left it meanwhile counted on, until a new run."""
    make = lambda: on_plate(pair, frame="floating", speed=(10, 2, -0.5), x=where, friction=friction)  # noqa: E731
    assert_goes_on(make, 20e-6, tmp_path / "cut.npz", solver=solver)


def test_corners_that_slide_over_each_other(tmp_path):
    """Points leave one face past a sharp edge, and enter others. Some were points of a face that they had not met."""
    fem = ep.fe_model(occ.Box(occ.Pnt(-4e-3, -3e-3, 0), occ.Pnt(4e-3, 3e-3, 3e-3)), ep.STEEL, maxh=1.5e-3)
    block = ep.reduce(fem, ep.Partition.skin(fem), f_cut=150e3)

    def make():
        mbs = exu.SystemContainer().AddSystem()
        place = {"referencePosition": [3.7e-3, 2.5e-3, 3.01e-3], "initialVelocity": [20.0, 10.0, -2.0]}
        turning = {"initialAngularVelocity": [2000.0, 900.0, 500.0]}
        upper = ep.CreatePartitionBody(mbs, block, frame="floating", **place, **turning)
        both = upper, ep.CreatePartitionBody(mbs, block, frame="floating")
        contact = ep.CreatePartitionContact(mbs, *both, friction=0.2)
        mbs.Assemble()
        return mbs, both, [contact]

    assert_goes_on(make, 4e-6, tmp_path / "cut.npz", step=0.1e-6)


@pytest.mark.parametrize("cut", [12e-6, 16e-6, 23e-6])
def test_at_other_times(pair, cut, tmp_path):
    assert_goes_on(lambda: on_plate(pair, friction=MU), cut, tmp_path / "cut.npz")


@pytest.mark.parametrize("friction", [None, MU])
@pytest.mark.parametrize("carried", [False, True])
@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_rigid_surfaces(pair, frame, carried, friction, tmp_path):
    make = lambda: on_surface(pair[0], frame=frame, friction=friction, carried=carried)  # noqa: E731
    assert_goes_on(make, 20e-6, tmp_path / "cut.npz")


@pytest.mark.parametrize("friction", [None, MU])
def test_a_curved_surface(pair, friction, tmp_path):
    surface = ep.RigidCylinder((0, 0, -0.02), (0, 1, 0), 0.02)
    make = lambda: on_surface(pair[0], friction=friction, surface=surface, speed=(5.0, 0, -1.0))  # noqa: E731
    assert_goes_on(make, 20e-6, tmp_path / "cut.npz")


@pytest.mark.parametrize("friction", [None, MU])
def test_contact_that_wanders_over_a_skin(rolling, friction, tmp_path):
    make = lambda: on_surface(rolling, frame="floating", friction=friction, speed=(20.0, 0, -1.0))  # noqa: E731
    assert_goes_on(make, 12e-6, tmp_path / "cut.npz")


@pytest.mark.parametrize("friction", [None, MU])
@pytest.mark.parametrize(
    ("where", "method"), [("plane", "explicit"), ("plane", "implicit"), ("carried", "explicit"), ("plate", "explicit")]
)
def test_contact_at_a_point_that_wanders(pair, rolling, where, method, friction, tmp_path):
    """Its kernels are made anew on the way, and springs of friction remember their elongations."""
    options = {"frame": "floating", "friction": friction, "formulation": "hertz"}
    if where == "plate":
        make = lambda: on_plate((rolling, pair[1]), speed=(12.0, 0, -1.0), **options)  # noqa: E731
    else:
        make = lambda: on_surface(rolling, carried=where == "carried", speed=(20.0, 0, -1.0), **options)  # noqa: E731
    cut, within = (12e-6, NEXT) if method == "explicit" else (5e-6, NEWTON)
    assert_goes_on(make, cut, tmp_path / "cut.npz", within, method=method)


@pytest.mark.parametrize("friction", [None, MU])
def test_a_skin_whose_flexibility_is_found_on_demand(rolling_parts, friction, tmp_path, monkeypatch):
    """Each model has a body from a file: it lacks what an earlier run has found."""
    monkeypatch.setattr(free_body, "SMALL", 100)
    ep.reduce(*rolling_parts, f_cut=100e3).save(tmp_path / "body")

    def make():
        body = ep.load_body(tmp_path / "body")
        return on_surface(body, frame="floating", friction=friction, speed=(20.0, 0, -1.0))

    assert_goes_on(make, 12e-6, tmp_path / "cut.npz")


@pytest.mark.parametrize("friction", [None, MU])
def test_viscous_flexibilities(pair, friction, tmp_path):
    damping = ep.Rayleigh(0.0, 2e-7)
    make = lambda: on_surface(pair[0], friction=friction, damping=damping)  # noqa: E731
    assert_goes_on(make, 20e-6, tmp_path / "cut.npz")


@pytest.mark.parametrize("method", ["explicit", "implicit"])
@pytest.mark.parametrize("carried", [False, True])
def test_a_law_that_takes_energy(pair, carried, method, tmp_path):
    law = contributed("class HuntCrossley(Law)")["HuntCrossleys"]()
    make = lambda: on_surface(pair[0], formulation=law, carried=carried)  # noqa: E731
    within = NEXT if method == "explicit" else NEWTON
    assert_goes_on(make, 20e-6, tmp_path / "cut.npz", within, method=method)


@pytest.mark.parametrize("frame", ["inertial", "floating"])
@pytest.mark.parametrize("wanders", [False, True])
def test_a_law_that_pulls(pair, rolling, wanders, frame, tmp_path):
    """Cut before the surfaces touch, within reach."""
    law = contributed("class Attraction(Law)")["Attractions"]()
    ball = rolling if wanders else pair[0]
    make = lambda: on_plate((ball, pair[1]), frame=frame, formulation=law, speed=(0.5, 0, -0.1))  # noqa: E731
    assert_goes_on(make, 5e-6, tmp_path / "cut.npz")


@pytest.mark.parametrize("friction", [None, MU])
def test_contacts_that_share_a_patch(grooved, friction, tmp_path):
    assert_goes_on(lambda: in_groove(grooved, friction=friction), 12e-6, tmp_path / "cut.npz")


@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_joints_and_the_damping_of_what_they_hold(strip, frame, tmp_path):
    make = lambda: clamped(strip, frame)  # noqa: E731
    assert_goes_on(make, 20e-6, tmp_path / "cut.npz", step=0.1e-6)


@pytest.mark.parametrize("friction", [None, MU])
@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_contacts_that_move_each_other(marbles, friction, frame, tmp_path):
    body = marbles["xyz" if friction else "normal"]
    make = lambda: in_a_row(body, frame=frame, friction=friction)  # noqa: E731
    assert_goes_on(make, 14e-6, tmp_path / "cut.npz", step=0.1e-6)


@pytest.mark.parametrize("friction", [None, MU])
def test_viscous_contacts_that_move_each_other(marbles, friction, tmp_path):
    body, damping = marbles["xyz" if friction else "normal"], ep.Rayleigh(0.0, 2e-7)
    make = lambda: in_a_row(body, friction=friction, damping=damping)  # noqa: E731
    assert_goes_on(make, 14e-6, tmp_path / "cut.npz", step=0.1e-6)


@pytest.mark.parametrize("friction", [None, MU])
def test_plastic_zones(yielding, friction, tmp_path):
    assert_goes_on(lambda: on_surface(yielding, friction=friction), 12e-6, tmp_path / "cut.npz", SINGLE, later=1e-4)


@pytest.mark.parametrize("friction", [None, MU])
def test_explicit_multipliers(nodal_pair, friction, tmp_path):
    make = lambda: on_plate(nodal_pair, formulation="lagrange", friction=friction)  # noqa: E731
    cut = 8e-6
    step = cut / np.ceil(cut / (0.5 * ep.stability_limit(make()[0])))
    assert_goes_on(make, cut, tmp_path / "cut.npz", first=1, step=step)


def test_adaptive_steps(pair, tmp_path):
    make = lambda: on_surface(pair[0], friction=MU)  # noqa: E731
    assert_goes_on(make, 20e-6, tmp_path / "cut.npz", adaptive=True, free_step=2e-6)


# Implicit steps, and statics.

IMPLICIT = {"method": "implicit", "spectral_radius": 0.6}


@pytest.mark.parametrize("friction", [None, MU])
def test_implicit_steps(pair, friction, tmp_path):
    make = lambda: on_plate(pair, friction=friction, frame="floating")  # noqa: E731
    assert_goes_on(make, 20e-6, tmp_path / "cut.npz", NEWTON, **IMPLICIT)


@pytest.mark.parametrize("friction", [None, MU])
def test_implicit_steps_of_plastic_zones(yielding, friction, tmp_path):
    make = lambda: on_surface(yielding, friction=friction)  # noqa: E731
    assert_goes_on(make, 12e-6, tmp_path / "cut.npz", 1e-6, **IMPLICIT)


@pytest.mark.parametrize("friction", [None, MU])
def test_implicit_multipliers(nodal_pair, friction, tmp_path):
    make = lambda: on_plate(nodal_pair, formulation="lagrange", friction=friction)  # noqa: E731
    assert_goes_on(make, 12e-6, tmp_path / "cut.npz", NEWTON, first=1, **IMPLICIT)


@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_a_static_preload(pair, method, tmp_path):
    """A ball that statics have pressed onto a plane sticks on: from a file as in the same process."""

    def make():
        mbs = exu.SystemContainer().AddSystem()
        ball = ep.CreatePartitionBody(mbs, pair[0], gravity=[0, 0, -3e4])
        contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), friction=MU)
        add_springs(mbs, ball, 1e5 / pair[0].total_mass)
        mbs.Assemble()
        return mbs, contact

    options, path = {"end_time": 5e-6, "step": STEP, "method": method}, tmp_path / "pressed.npz"
    mbs, contact = make()
    ep.solve_static(mbs).save(path)
    expected = contact.force(ep.solve_dynamic(mbs, go_on=True, **options))
    mbs, contact = make()
    found = contact.force(ep.solve_dynamic(mbs, go_on=ep.Result.load(path, mbs), **options))
    assert expected[0] > 10
    np.testing.assert_allclose(found, expected, rtol=0, atol=NEWTON * expected[0])


def test_results_of_other_models_and_of_broken_runs_are_refused(pair, tmp_path):
    make = lambda **options: on_surface(pair[0], **options)  # noqa: E731
    mbs, *_ = make(friction=MU)
    result = ep.solve_dynamic(mbs, end_time=2e-6, step=STEP)
    other, *_ = make(friction=0.5 * MU)
    with pytest.raises(InputError, match="with other friction"):
        ep.solve_dynamic(other, end_time=4e-6, step=STEP, go_on=result)
    same, *_ = make(friction=MU)
    again = ep.solve_dynamic(same, end_time=4e-6, step=STEP, go_on=result)
    assert again.t[0] == result.t[-1]
    with pytest.raises(InputError, match="go_on: the run of this result did not end with a whole step"):
        ep.solve_dynamic(same, end_time=6e-6, step=STEP, go_on=replace(result, end=None))
    with pytest.raises(InputError, match="go_on"):
        ep.solve_dynamic(same, end_time=6e-6, step=STEP, go_on="yes")


def test_a_run_goes_on_from_a_copy_and_from_an_end_before_others(pair):
    """The value stays what it was, whatever has run since: each run from it is the same."""
    mbs, _, (contact,) = on_surface(pair[0], friction=MU)
    result = ep.solve_dynamic(mbs, end_time=12e-6, step=STEP)
    sent = pickle.loads(pickle.dumps(result))
    found = []
    for end in (result, sent, result):
        found.append(contact.force(ep.solve_dynamic(mbs, end_time=20e-6, step=STEP, go_on=end)))
        ep.solve_dynamic(mbs, end_time=30e-6, step=STEP, go_on=True)
    np.testing.assert_array_equal(found[0], found[2])
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-9 * found[0].max())
