"""Equilibria with contact: balance of forces, stiffness by hand, nothing passes through, preloads, and frequencies."""

import functools
import logging
import math
import operator
import warnings

import exudyn as exu
import exudyn.itemInterface as items
import exudyn.utilities
import netgen.occ as occ
import numpy as np
import pytest
import scipy.linalg
from oracles import add_loads, add_springs, box, end, ground

import exudyn_partition as ep
from exudyn_partition.contact.formulations import compliance
from exudyn_partition.errors import (
    ComplementarityError,
    ContactPatchWarning,
    InputError,
    ModelLimitWarning,
    PartitionWarning,
    RunError,
    StoppedRunWarning,
)
from exudyn_partition.exudyn_bodies.model import start_of_step
from exudyn_partition.exudyn_contacts.model_run import ModelRun

FORCE, SPRING = 50.0, 1e5
pytestmark = pytest.mark.filterwarnings("ignore:contact .floor. at t = .* of 123 rows is closed at the peak")


def springs(mbs, item, stiffness):
    """Springs on the rigid motion: on translations [N/m], and stiff ones on rotations; returns their matrix."""
    return add_springs(mbs, item, np.diag([1e7, 1e7, stiffness, 1e3, 1e3, 1e3]))


def press(mbs, item, force, axis=2, **of_time):
    """A force [N] against an axis, spread over the mass; shapes are free of it."""
    load = np.asarray(item.body.mass @ item.body.rigid)[:, axis] * -force / item.body.total_mass
    own = {key: (lambda mbs, t, load, f=f: load * f(t)) for key, f in of_time.items()}
    add_loads(mbs, item, load, **own)


def pressed(mbs, body, stiffness=SPRING, gap=0.0, **of_time):
    """A ball on a plane, pressed down against a soft spring."""
    item = ep.CreatePartitionBody(mbs, body, name="ball", referencePosition=[0, 0, gap])
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), name="floor")
    K = springs(mbs, item, stiffness)
    press(mbs, item, FORCE, **of_time)
    mbs.Assemble()
    return item, contact, K


def sunk(item, result):
    return item.rigid_motion(item.coordinates(result))[:, 2]


def test_an_equilibrium_without_contact_is_said(mbs, bodies):
    """A load with the wrong sign; where one contact of several is closed, nothing is said."""
    item = ep.CreatePartitionBody(mbs, bodies[0])
    ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), name="floor")
    springs(mbs, item, SPRING)
    press(mbs, item, -FORCE)
    mbs.Assemble()
    with pytest.warns(
        ContactPatchWarning, match="no contact closed in any load step; open are contact 'floor' by 0.0005"
    ):
        ep.solve_static(mbs, load_steps=2)


def test_contact_and_spring_carry_the_load_in_each_step(mbs, bodies, tmp_path):
    shares = []
    item, contact, _ = pressed(mbs, bodies[0])
    result = ep.solve_static(mbs, load_steps=4, progress=shares.append)
    np.testing.assert_allclose(result.t, [0, 0.25, 0.5, 0.75, 1])
    assert (result.method, result.status, result.steps) == ("static", "finished", 4)
    force = contact.force(result)
    np.testing.assert_allclose(force, FORCE * result.t + SPRING * sunk(item, result), atol=1e-6)
    assert force[-1] > 0.9 * FORCE
    assert shares[-1] == 1.0
    assert result.work.newton_iterations >= 4
    assert not mbs.systemData.GetODE2Coordinates(exu.ConfigurationType.Initial).any()  # it was asked for nothing else
    with pytest.raises(InputError, match=r"result: .* a static answer has no impacts"):
        contact.impacts(result)
    page = result.report(tmp_path / "page.html").read_text()
    assert "peak force" in page
    assert "sub-impacts" not in page
    again = ep.solve_static(mbs, load_steps=1)
    assert contact.force(again)[-1] == pytest.approx(force[-1], rel=1e-9)


@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_a_preloaded_run_begins_at_rest(mbs, bodies, method):
    item, contact, _ = pressed(mbs, bodies[0])
    static = ep.solve_static(mbs, load_steps=2, update_initial=True)
    result = ep.solve_dynamic(mbs, end_time=20e-6, step=0.25e-6, method=method)
    np.testing.assert_allclose(contact.force(result), contact.force(static)[-1], rtol=1e-5)
    assert abs(item.momentum(result)).max() < 1e-5 * FORCE * 20e-6


@pytest.mark.parametrize("update_initial", [False, True])
@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_velocities_of_the_start_have_no_forces_in_statics(mbs, bodies, frame, update_initial):
    """The ball turns and flies, with a damper and inertia of its turning; its equilibrium is that of one at rest."""
    forces, velocity, omega = [], [0.3, 0, -0.5], [0, 20.0, 0]
    for moves in (1.0, 0.0):
        mbs.Reset()
        item = ep.CreatePartitionBody(
            mbs, bodies[0], name="ball", frame=frame, referencePosition=[0, 0, 0],
            initialVelocity=moves * np.array(velocity), initialAngularVelocity=moves * np.array(omega),
        )  # fmt: skip
        contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), name="floor")
        if frame == "inertial":
            springs(mbs, item, SPRING)
            press(mbs, item, FORCE)
        else:
            held = mbs.AddMarker(items.MarkerNodeRigid(nodeNumber=item["nRigid"]))
            mbs.AddObject(
                items.ObjectConnectorRigidBodySpringDamper(
                    markerNumbers=[ground(mbs), held],
                    stiffness=np.diag([1e7, 1e7, SPRING, 1e3, 1e3, 1e3]),
                    damping=np.diag([1e3] * 3 + [1.0] * 3),
                )
            )
            mbs.AddLoad(items.LoadForceVector(markerNumber=held, loadVector=[0, 0, -FORCE]))
        mbs.Assemble()
        start = mbs.systemData.GetODE2Coordinates_t(exu.ConfigurationType.Initial)
        forces.append(contact.force(ep.solve_static(mbs, load_steps=2, update_initial=update_initial))[-1])
        np.testing.assert_array_equal(mbs.systemData.GetODE2Coordinates_t(exu.ConfigurationType.Initial), start)
    assert forces[0] == pytest.approx(forces[1], rel=1e-9)
    assert forces[0] > 0.5 * FORCE


@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_a_preloaded_run_goes_on_with_what_sticks(mbs, round_body, method):
    """Friction holds the ball against a force along the plane; without its memory, the ball would start to swing."""
    item = ep.CreatePartitionBody(mbs, round_body, name="ball")
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), name="floor", friction=0.5)
    springs(mbs, item, SPRING)
    press(mbs, item, 10 * FORCE)
    press(mbs, item, 2 * FORCE, axis=0)
    mbs.Assemble()
    static = ep.solve_static(mbs, load_steps=3, update_initial=True)
    stuck = contact.friction.tangential_force(static)[-1, 0]
    assert stuck > 0.2 * FORCE
    for _ in range(2):  # the second run too begins in that state
        result = ep.solve_dynamic(mbs, end_time=20e-6, step=0.2e-6, method=method)
        np.testing.assert_allclose(contact.friction.tangential_force(result)[:, 0], stuck, rtol=1e-4)
        assert abs(item.momentum(result)[:, 0]).max() < 1e-4 * stuck * 20e-6
    mbs.systemData.SetODE2Coordinates(np.zeros(round_body.n_dofs), exu.ConfigurationType.Initial)
    result = ep.solve_dynamic(mbs, end_time=1e-6, step=0.2e-6, method=method)
    assert abs(contact.friction.tangential_force(result)[0]).max() == 0.0  # another start has no memory


@pytest.mark.parametrize("gap", [0.0, 2e-4])
def test_nothing_passes_through_the_plane(mbs, bodies, gap):
    """A soft spring gives way by 50 mm in the first step, past a plane that is not felt before it is touched."""
    item, contact, _ = pressed(mbs, bodies[0], stiffness=1e3, gap=gap)
    result = ep.solve_static(mbs, load_steps=1)
    assert contact.force(result)[-1] == pytest.approx(FORCE + 1e3 * sunk(item, result)[-1], rel=1e-6)
    assert -1e-5 < sunk(item, result)[-1] + gap < 0


def test_loads_as_functions_of_the_static_time(mbs, bodies):
    item, contact, _ = pressed(mbs, bodies[0], loadUserFunction=lambda t: math.sin(math.pi * t))
    result = ep.solve_static(mbs, load_steps=4, load_factor=False)
    load = FORCE * np.sin(np.pi * result.t)
    np.testing.assert_allclose(contact.force(result), load + SPRING * sunk(item, result), atol=1e-6)
    assert contact.force(result)[2] > 0.9 * FORCE
    assert contact.force(result)[-1] == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize(("axes", "frame"), [((1, 1, 0, 1, 1, 1), "floating"), ((0, 1, 0, 1, 1, 1), "inertial")])
def test_a_block_shortens_as_a_bar(mbs, bricks, axes, frame):
    """Between a plane and a load that its head spreads evenly: F L / (E A), whatever Poisson's ratio is.

    Without its guide along x, it may stand anywhere on the plane, and that is told.
    """
    part = ep.Partition.ball(bricks, (0, 0, 0), 0.015)
    part |= ep.Partition.interface(bricks, "head", end(bricks, 0.03), kind="averaged")
    item = ep.CreatePartitionBody(mbs, ep.reduce(bricks, part, f_cut=30e3), name="block", frame=frame)
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane())
    head = item.CreateInterfaceMarker(mbs, "head")
    guide = items.GenericJoint(markerNumbers=[ground(mbs, (0, 0, 0.03)), head])
    guide.constrainedAxes = list(axes)
    mbs.AddObject(guide)
    mbs.AddLoad(items.LoadForceVector(markerNumber=head, loadVector=[0, 0, -1000.0]))
    position = exu.OutputVariableType.Displacement
    sensor = mbs.AddSensor(items.SensorMarker(markerNumber=head, outputVariableType=position, storeInternal=True))
    mbs.Assemble()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", PartitionWarning)
        result = ep.solve_static(mbs, load_steps=2)
    said = [str(warning.message) for warning in caught]
    assert ["body 'block': nothing holds it against some motion" in one for one in said] == [True] * (not axes[0])
    expected = 1000.0 * 0.03 / (ep.STEEL.E * 0.01 * 0.02)
    assert contact.force(result)[-1] == pytest.approx(1000, rel=1e-6)
    assert result.sensor(sensor)[-1, 2] == pytest.approx(-expected, rel=0.02)


@pytest.mark.filterwarnings("ignore:no contact closed in any load step")
@pytest.mark.parametrize(("frame", "gravity"), [("inertial", 0.0), ("inertial", 1e4), ("floating", 9.81)])
def test_a_block_that_only_stands_carries_its_weight(mbs, bricks, frame, gravity, capfd):
    """Nothing holds it against sliding and turning, and no force makes it slide or turn; without weight, it rests.

    The first try of Exudyn's solver fails, without a word of that on the terminal.
    """
    body = ep.reduce(bricks, ep.Partition.ball(bricks, (0, 0, 0), 0.015), f_cut=30e3)
    item = ep.CreatePartitionBody(mbs, body, name="block", frame=frame, gravity=[0, 0, -gravity])
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane())
    mbs.Assemble()
    with pytest.warns(ModelLimitWarning, match="body 'block': nothing holds it against some motion"):
        result = ep.solve_static(mbs, load_steps=2)
    np.testing.assert_allclose(contact.force(result)[1:], body.total_mass * gravity, rtol=1e-6)
    moved = item.rigid_motion(item.coordinates(result))
    assert abs(moved[-1, :2]).max() <= abs(moved[-1, 2])
    assert "FAILED" not in capfd.readouterr().out
    assert exu.config.printToConsole


def test_frequencies_about_the_equilibrium_are_those_of_its_stiffness(mbs, bodies):
    """Exudyn's eigenvalues at the preload, and those of springs, modes and differences of the contact force."""
    item, contact, K = pressed(mbs, bodies[0])
    result = ep.solve_static(mbs, load_steps=2, update_initial=True)
    found, _ = mbs.ComputeODE2Eigenvalues(convert2Frequencies=True)
    q, law = item.coordinates(result)[-1], contact.mechanics.for_run("static")
    small = 1e-9 * np.eye(len(q))
    tangent = np.array([(law.at(q - way).generalised - law.at(q + way).generalised) / 2e-9 for way in small])
    stiffness = item.body.stiffness.toarray() + K + (tangent + tangent.T) / 2
    square = scipy.linalg.eigh(stiffness, item.body.mass.toarray(), eigvals_only=True)
    np.testing.assert_allclose(found, np.sqrt(square) / (2 * np.pi), rtol=1e-3)
    open_square = scipy.linalg.eigh(stiffness - (tangent + tangent.T) / 2, item.body.mass.toarray(), eigvals_only=True)
    assert abs(np.sqrt(square / open_square) - 1).max() > 0.1  # the contact counts


def plain(mbs):
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    return mbs.SolveStatic(settings)


@pytest.mark.parametrize("call", [ep.solve_static, plain])
def test_multipliers_are_refused_before_the_first_step(mbs, pair_of, call):
    item = ep.CreatePartitionBody(mbs, pair_of("craig-bampton")[0])
    ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), formulation="lagrange")
    calls = []
    mbs.SetPreStepUserFunction(lambda mbs, t: calls.append(t) or True)
    mbs.Assemble()
    with pytest.raises(Exception, match="formulation 'lagrange' has no statics") as raised:
        call(mbs)
    assert not calls
    if call is ep.solve_static:
        assert isinstance(raised.value, RunError)


def test_a_body_that_slides_has_no_equilibrium():
    """On a table just steeper than its angle of friction; just less steep, friction carries its part of the weight."""
    fem = ep.fe_model(occ.Box((-0.01, -0.01, 0), (0.01, 0.01, 8e-3)), ep.STEEL, maxh=8e-3)
    foot = ep.Partition.surface(fem, plane=((0, 0, 0), (0, 0, -1)), axes="xyz")
    body, mu = ep.reduce(fem, foot, f_cut=60e3), 0.3
    for share in (0.99, 1.01):
        tilt, mbs = share * np.arctan(mu), exu.SystemContainer().AddSystem()
        gravity = 9.81 * np.array([np.sin(tilt), 0.0, -np.cos(tilt)])
        block = ep.CreatePartitionBody(mbs, body, frame="floating", gravity=gravity)
        contact = ep.CreatePartitionContact(mbs, block, ep.RigidPlane(), friction=mu)
        mbs.Assemble()
        if share < 1:
            along = contact.friction.tangential_force(ep.solve_static(mbs, load_steps=2))[-1, 0]
            assert -along == pytest.approx(body.total_mass * gravity[0], rel=1e-5)
            continue
        with pytest.raises(RunError, match="slides, because more pushes it along a contact than friction holds"):
            ep.solve_static(mbs, load_steps=2)


@pytest.mark.filterwarnings("ignore:.*only a sharp corner or edge touches")  # the crest of a coarse roller
def test_a_strip_that_bends_on_two_rollers_keeps_its_load_steps(mbs):
    """Its ends slide apart on both: no stiffness along them is left, and load steps became ever shorter."""
    length, radius, depth, load, maxh = 0.1, 0.01, 0.02, 200.0, 4e-3
    low, high = occ.Pnt(-length / 2, -depth / 2, 0), occ.Pnt(length / 2, depth / 2, 5e-3)
    fem = ep.fe_model(occ.Box(low, high), ep.STEEL, maxh=maxh)
    body = ep.reduce(fem, ep.Partition.surface(fem, near=(0, 0, 0), axes="xyz"), f_cut=30e3)
    strip, contacts = ep.CreatePartitionBody(mbs, body, name="strip"), []
    for x in (-0.03, 0.03):
        shape = occ.Cylinder(occ.Pnt(x, -depth / 2, -radius), occ.Y, radius, depth)
        fem = ep.fe_model(shape, ep.STEEL, maxh=maxh)
        across = np.hypot(fem.points[:, 0] - x, fem.points[:, 2] + radius)
        core = np.flatnonzero((abs(abs(fem.points[:, 1]) - depth / 2) < 1e-9) & (across < 0.7 * radius))
        held = ep.Partition.interface(fem, "core", core, position=(x, 0, -radius))
        part = ep.Partition.surface(fem, near=(x, 0, 0), axes="xyz") | held
        roller = ep.CreatePartitionBody(mbs, ep.reduce(fem, part, f_cut=30e3))
        place = items.MarkerBodyRigid(bodyNumber=mbs.CreateGround(), localPosition=[x, 0, -radius])
        mbs.AddObject(
            items.GenericJoint(markerNumbers=[mbs.AddMarker(place), roller.CreateInterfaceMarker(mbs, "core")])
        )
        contacts.append(ep.CreatePartitionContact(mbs, strip, roller, friction=0.3))
    middle = strip.CreatePointMarker(mbs, (0, 0, 5e-3))
    mbs.AddLoad(items.Force(markerNumber=middle, loadVector=[0, 0, -load]))
    mbs.Assemble()
    result = ep.solve_static(mbs)
    assert result.steps < 100
    pushes = [contact.force_on_slave(result)[-1] for contact in contacts]
    np.testing.assert_allclose(sum(pushes), [0, 0, load], atol=1e-5 * load)
    np.testing.assert_allclose([push[2] for push in pushes], load / 2, rtol=1e-2)
    assert pushes[0][0] > 0.1 * load / 2 > -0.1 * load / 2 > pushes[1][0]  # the lower face stretches


@pytest.mark.filterwarnings("ignore:.*rows are closed at the peak", "ignore:.*nothing holds it against some motion")
@pytest.mark.parametrize(("load_steps", "friction"), [(1, 0.3), (5, 0.3), (4, None)])
def test_a_table_settles_under_a_load_beside_its_middle(mbs, load_steps, friction):
    """With friction its legs slip a little, and with a stiffness along slips the run ended at 2 % of the load.

    Without it, the table may turn on the plane. Newton's method took such a turn for a change of the rotation vector,
    which tilts the table a little, and did not settle.
    """
    x, y, load = 0.18, 0.08, 100.0
    legs = [(-x, -y), (-x, y), (x, -y), (x, y)]
    shape = occ.Box((-0.2, -0.1, 0.1), (0.2, 0.1, 0.12))
    for a, b in legs:
        shape = shape + occ.Box((a - 0.01, b - 0.01, 0), (a + 0.01, b + 0.01, 0.1))
    fem = ep.fe_model(shape, ep.STEEL, maxh=0.02)
    feet = [
        ep.Partition.ball(fem, (a, b, 0), 0.015, direction=(0, 0, -1), axes="xyz", name=f"leg {i}")
        for i, (a, b) in enumerate(legs)
    ]
    body = ep.reduce(fem, feet[0] | feet[1] | feet[2] | feet[3], f_cut=4e3)
    table = ep.CreatePartitionBody(mbs, body, frame="floating", gravity=[0, 0, -9.81])
    contacts = [
        ep.CreatePartitionContact(mbs, table, ep.RigidPlane(), slavePatch=f"leg {i}", friction=friction)
        for i in range(4)
    ]
    mbs.AddLoad(items.Force(markerNumber=table.CreatePointMarker(mbs, (0.1, 0.05, 0.12)), loadVector=[0, 0, -load]))
    mbs.Assemble()
    result = ep.solve_static(mbs, load_steps=load_steps)
    assert result.status == "finished"
    pushes = [contact.row_forces(result).toarray()[-1] for contact in contacts]
    places = [contact.mechanics.gaps.slave.surface.points[:, :2] for contact in contacts]
    assert sum(push.sum() for push in pushes) == pytest.approx(load + 9.81 * body.total_mass, rel=1e-8)
    moments = sum(push @ place for push, place in zip(pushes, places, strict=True))
    np.testing.assert_allclose(moments, load * np.array([0.1, 0.05]), rtol=0.02)  # rows act a little within their nodes


@pytest.fixture(scope="module")
def slab():
    """A steel slab, 80 x 40 x 10 mm, with patches below and above."""
    fem = ep.fe_model(box(0.08, 0.04, 0.01), ep.STEEL, maxh=0.02)
    z = fem.points[fem.facets[:, :3]].mean(axis=1)[:, 2]
    low, high = (
        ep.Partition.surface(fem, np.flatnonzero(abs(z - at) < 1e-9), name=name)
        for name, at in (("low", 0.0), ("high", 0.01))
    )
    return ep.reduce(fem, low | high, f_cut=10e3)


@pytest.mark.filterwarnings("ignore:.*nothing holds it:exudyn_partition.errors.ModelLimitWarning")
@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.ContactPatchWarning")
@pytest.mark.parametrize(("load", "frame"), [(100.0, "inertial"), (100.0, "floating"), (1e4, "floating")])
def test_a_stack_without_friction_settles_or_is_refused(mbs, slab, load, frame):
    """A load beside the middle tilts it, so that contact pushes the upper slab a little aside, which nothing holds.

    A share of the load below 1e-5 is borne, in the load step in which Newton's method creeps alone. A larger one, in
    proportion to the load, slides it away.
    """
    options = {"frame": frame, "gravity": [0, 0, -9.81]}
    lower, upper = (ep.CreatePartitionBody(mbs, slab, referencePosition=[0, 0, z], **options) for z in (0.0, 0.01))
    floor = ep.CreatePartitionContact(mbs, lower, ep.RigidPlane(), slavePatch="low")
    between = ep.CreatePartitionContact(mbs, upper, lower, slavePatch="low", masterPatch="high")
    marker = upper.CreatePointMarker(mbs, (0.02, 0.01, 0.01))
    mbs.AddLoad(items.Force(markerNumber=marker, loadVector=[0, 0, -load]))
    mbs.Assemble()
    borne = []
    mbs.SetPostStepUserFunction(lambda mbs, t: not borne.append(mbs.sys["staticSolver"].newton.absoluteTolerance))
    if load > 1e3:
        with pytest.raises(RunError, match=r"finds no equilibrium.* nor a body that slides"):
            ep.solve_static(mbs, load_steps=4)
        return
    result = ep.solve_static(mbs, load_steps=4)
    assert (result.status, result.steps) == ("finished", 4)
    assert len(borne) >= 4
    assert len({*borne}) == 1
    weight = 9.81 * slab.total_mass
    assert between.force(result)[-1] == pytest.approx(load + weight, rel=1e-5)
    assert floor.force(result)[-1] == pytest.approx(load + 2 * weight, rel=1e-5)


@pytest.mark.filterwarnings("ignore:.*nothing holds it against some motion", "ignore:.*reached the edge of its patch")
@pytest.mark.parametrize(
    ("frame", "feet", "friction"),
    [("inertial", 1, None), ("floating", 1, None), ("inertial", 2, None), ("floating", 2, None), ("inertial", 1, 0.3)],
)
def test_a_strip_that_bends_lifts_off_a_plane_in_part(mbs, monkeypatch, frame, feet, friction):
    """Rows closed with larger gaps than those that could: forces jumped, and no load, or not each, settled.

    With friction they settled where a row lay within the plane, by 0.4 of the largest depth: forces were others than if
    all rows entered at once.
    """
    size, height, load = np.array([0.1, 0.04]), 0.01, 100.0
    fem = ep.fe_model(occ.Box((*-size / 2, 0), (*size / 2, height)), ep.STEEL, maxh=0.015)
    centres = fem.points[fem.facets[:, :3]].mean(axis=1)
    down, x = centres[:, 2] < 1e-9, centres[:, 0]
    parts = [down] if feet == 1 else [down & (x < -0.015), down & (x > 0.015)]
    axes = "normal" if friction is None else "xyz"
    patches = [
        ep.Partition.surface(fem, np.flatnonzero(part), axes=axes, name=f"foot {i}") for i, part in enumerate(parts)
    ]
    body = ep.reduce(fem, functools.reduce(operator.or_, patches), f_cut=20e3)
    strip, found = ep.CreatePartitionBody(mbs, body, frame=frame, gravity=[0, 0, -9.81]), []
    contacts = [
        ep.CreatePartitionContact(mbs, strip, ep.RigidPlane(), slavePatch=f"foot {i}", friction=friction)
        for i in range(feet)
    ]
    mbs.AddLoad(items.Force(markerNumber=strip.CreatePointMarker(mbs, (0.02, 0.01, height)), loadVector=[0, 0, -load]))
    mbs.Assemble()
    for load_steps in (1, 10):
        result = ep.solve_static(mbs, load_steps=load_steps)
        assert result.status == "finished"
        found.append(np.concatenate([contact.row_forces(result).toarray()[-1] for contact in contacts]))
        assert found[-1].sum() == pytest.approx(load + 9.81 * body.total_mass, rel=1e-6)
        assert 0 < np.count_nonzero(found[-1]) < 0.5 * len(found[-1])
    np.testing.assert_allclose(*found, rtol=0, atol=(1e-4 if friction is None else 1e-3) * load)
    if friction is not None:
        monkeypatch.setattr(compliance, "CHOOSING", (np.inf, np.inf, *compliance.CHOOSING[2:]))
        whole = contacts[0].row_forces(ep.solve_static(mbs, load_steps=10)).toarray()[-1]
        np.testing.assert_allclose(found[-1], whole, rtol=0, atol=1e-8 * load)


@pytest.mark.parametrize("far", [0.0, 30.0])
@pytest.mark.parametrize("kind", ["rigid", "inertial", "floating"])
def test_stiff_springs_have_rounding_that_newton_s_method_knows(mbs, arm_body, kind, far):
    """A chain on springs, far from the origin too: it moves by F (1/k + 1/k), in any number of load steps."""
    place, stiffness = np.array([far, 0, 0]), 1e8
    before = ground(mbs, place)
    for i in range(2):
        at = place + 0.06 * i * np.array([0, 0, 1])
        if kind == "rigid":
            inertia = exudyn.utilities.InertiaCuboid(7850, [0.01, 0.01, 0.06])
            number = mbs.CreateRigidBody(referencePosition=at, inertia=inertia)
            ends = [mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=number, localPosition=[0, 0, z])) for z in (0, 0.06)]
        else:
            item = ep.CreatePartitionBody(mbs, arm_body, referencePosition=at, frame=kind)
            ends = [item.CreateInterfaceMarker(mbs, name) for name in ("foot", "head")]
        springs = np.diag([stiffness] * 3 + [1e-3 * stiffness] * 3)
        mbs.AddObject(items.RigidBodySpringDamper(markerNumbers=[before, ends[0]], stiffness=springs))
        before = ends[1]
    mbs.AddLoad(items.LoadForceVector(markerNumber=ends[0], loadVector=[0, 0, 1.0]))
    sensor = mbs.AddSensor(
        items.SensorMarker(
            markerNumber=ends[0], outputVariableType=exu.OutputVariableType.Displacement, storeInternal=True
        )
    )
    mbs.Assemble()
    for load_steps in (1, 7, 10):
        assert ep.solve_static(mbs, load_steps=load_steps).status == "finished"
        moved = mbs.GetSensorValues(sensor)[2]
        assert moved == pytest.approx(2 / stiffness, rel=0.5 if kind != "rigid" else 1e-6)


@pytest.mark.parametrize("carried", [False, True])
def test_the_first_sample_is_the_state_in_which_statics_begin(mbs, bodies, carried):
    """Of a start without load, and of a preload: force, rows and energy were zero there, and the gap infinite."""
    item, more = ep.CreatePartitionBody(mbs, bodies[0], name="ball"), {}
    if carried:
        more["masterBody"] = mbs.CreateRigidBody(inertia=exudyn.utilities.InertiaCuboid(1e3, [0.1] * 3))
        marker = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=more["masterBody"]))
        mbs.AddObject(items.GenericJoint(markerNumbers=[ground(mbs), marker], constrainedAxes=[1] * 6))
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), name="floor", **more)
    springs(mbs, item, SPRING)
    press(mbs, item, FORCE)
    mbs.Assemble()
    pressed = ep.solve_static(mbs, load_steps=2, update_initial=True)
    assert contact.force(pressed)[0] == 0.0
    assert abs(contact.gap(pressed)[0]) < 1e-5
    held = ep.solve_static(mbs, load_steps=2, load_factor=False)
    for values in (contact.force(held), contact.energy(held), contact.area(held)):
        np.testing.assert_allclose(values, values[-1], rtol=1e-6)
    assert contact.force(held)[0] == pytest.approx(contact.force(pressed)[-1], rel=1e-6)
    assert (contact.closed_rows(held) == contact.closed_rows(pressed)[-1]).all()
    np.testing.assert_allclose(contact.gap(held), contact.gap(pressed)[-1], rtol=1e-5)


def test_what_nothing_holds_has_no_equilibrium(mbs, bodies):
    item = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=[0, 0, 1e-5])
    ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), name="floor")
    press(mbs, item, FORCE)
    mbs.Assemble()
    said = r"finds no equilibrium.*Open at the start: contact 'floor' by 1e-05 m.*hold it by joints or soft springs"
    with pytest.raises(RunError, match=said):
        ep.solve_static(mbs)


def test_a_convex_tip_whose_rows_are_open_is_named(mbs, bodies):
    """Its lowest point touches, but rows are means around nodes; the message spoke of bodies that do not touch."""
    item = ep.CreatePartitionBody(mbs, bodies[0])
    ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), name="floor")
    press(mbs, item, FORCE)
    mbs.Assemble()
    said = (
        r"finds no equilibrium.*contact 'floor' by .* m in its first row, though surfaces touch.*smaller facets there"
    )
    with pytest.raises(RunError, match=said):
        ep.solve_static(mbs)


@pytest.mark.parametrize(("options", "message"), [
    ({"load_steps": 0}, "load_steps: expected"), ({"load_steps": 1.5}, "load_steps: expected"),
    ({"load_factor": 2}, "load_factor: expected"), ({"update_initial": "yes"}, "update_initial: expected"),
    ({"settings": {}}, "settings: expected"), ({"progress": 1}, "progress: expected"),
])  # fmt: skip
def test_options_that_are_none(mbs, bodies, options, message):
    pressed(mbs, bodies[0])
    with pytest.raises(InputError, match=message):
        ep.solve_static(mbs, **options)


def settling(monkeypatch, settles):
    """Let contact forces settle only where `settles(start, end)` of a load step says so."""
    force = ModelRun.force

    def forces(run, mbs, t):
        if not settles(start_of_step(mbs), t):
            raise ComplementarityError("the forces did not settle")
        return force(run, mbs, t)

    monkeypatch.setattr(ModelRun, "force", forces)


def test_load_steps_are_halved_where_forces_do_not_settle_and_grow_again(mbs, bodies, monkeypatch):
    """All levels that were asked for are there, and contact and spring carry the load in each."""
    item, contact, _ = pressed(mbs, bodies[0])
    settling(monkeypatch, lambda start, end: not 0.25 - 1e-9 < start < 0.5 - 1e-9 or end - start < 0.1)
    result = ep.solve_static(mbs, load_steps=4)
    assert result.status == "finished"
    levels = np.array([0.25, 0.5, 0.75, 1.0])
    at = abs(result.t[:, None] - levels).argmin(axis=0)
    np.testing.assert_allclose(result.t[at], levels, rtol=1e-9)
    short = np.diff(result.t)
    assert short.min() == pytest.approx(0.0625)
    assert short[-1] > 2 * short.min()
    np.testing.assert_allclose(contact.force(result) - sunk(item, result) * SPRING, FORCE * result.t, atol=1e-4 * FORCE)


def test_a_load_step_that_ends_at_a_level_does_not_shorten_the_next(mbs, bodies, monkeypatch):
    """After four short steps, an eighth would pass the level 0.5; half of it ends there, and the next is an eighth."""
    pressed(mbs, bodies[0])
    settling(monkeypatch, lambda start, end: not 0.25 - 1e-9 < start < 0.26 or end - start < 0.04)
    result = ep.solve_static(mbs, load_steps=4)
    expected = [0.25, *[1 / 32] * 2, *[1 / 16] * 2, 1 / 16, 1 / 8, 1 / 8, 0.25]
    np.testing.assert_allclose(np.diff(np.r_[0.0, result.t[result.t > 0]]), expected, rtol=1e-9)


def test_forces_that_settle_in_no_load_step_are_named_as_the_cause(mbs, bodies, monkeypatch):
    pressed(mbs, bodies[0])
    settling(monkeypatch, lambda start, end: end < 0.51)
    with pytest.warns(StoppedRunWarning) as said:
        result = ep.solve_static(mbs, load_steps=4)
    assert result.status == "unstable"
    assert result.t[-1] <= 0.51
    text = str(said[0].message)
    assert "the forces did not settle. Shorter load steps did not help" in text
    assert "hold it by joints" not in text


def test_bodies_that_newton_s_method_throws_away_are_held_in_the_next_try(mbs, bodies, monkeypatch, caplog):
    """As the plates of a stack of three without friction: such a run ended at once."""
    item, contact, _ = pressed(mbs, bodies[0])
    force = ModelRun.force

    def forces(run, mbs, t):
        if "held by springs" not in caplog.text:
            raise ComplementarityError("the places of the patches are not finite: the run has become unstable")
        return force(run, mbs, t)

    monkeypatch.setattr(ModelRun, "force", forces)
    with caplog.at_level(logging.INFO, logger="exudyn_partition"):
        result = ep.solve_static(mbs, load_steps=1)
    assert result.status == "finished"
    assert contact.force(result)[-1] == pytest.approx(FORCE + SPRING * sunk(item, result)[-1], rel=1e-6)


@pytest.mark.filterwarnings("ignore:.* rows is closed at the peak:exudyn_partition.errors.ModelLimitWarning")
@pytest.mark.parametrize("load", [15.0, 150.0])
def test_a_ball_comes_to_lie_on_its_first_row(mbs, load):
    """Rows are means, so that the first one closes 1.5 um after the ball touches. Until then nothing holds it."""
    R = 10e-3
    refine = [ep.Refine((0, 0, 0), 0.9e-3, 0.5e-3)]
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, R), R), ep.ALUMINIUM, maxh=8e-3, refine=refine)
    back = np.flatnonzero(fem.points[:, 2] > 1.7 * R)
    part = ep.Partition.ball(fem, (0, 0, 0), 1e-3)
    part |= ep.Partition.interface(fem, "back", back, kind="averaged", position=(0, 0, 2 * R))
    item = ep.CreatePartitionBody(mbs, ep.reduce(fem, part, f_cut=60e3), name="ball")
    marker = item.CreateInterfaceMarker(mbs, "back")
    ground = mbs.CreateGround(referencePosition=[0, 0, 2 * R])
    guide = [mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground)), marker]
    mbs.AddObject(items.GenericJoint(markerNumbers=guide, constrainedAxes=[1, 1, 0, 1, 1, 1]))
    mbs.AddLoad(items.LoadForceVector(markerNumber=marker, loadVector=[0, 0, -load]))
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane())
    mbs.Assemble()
    result = ep.solve_static(mbs, load_steps=4)
    assert result.status == "finished"
    assert contact.force(result)[-1] == pytest.approx(load, rel=1e-4)
