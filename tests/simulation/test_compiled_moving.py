"""Compiled runs of bodies in floating frames and on curved rigid surfaces are those of Exudyn, up to round-off."""

from dataclasses import replace

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
import pytest
from oracles import each_way
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.errors import CompiledRunError, InputError
from exudyn_partition.support.compiled import kernels

pytestmark = pytest.mark.filterwarnings("ignore::exudyn_partition.errors.PartitionWarning")
R, CLOSE, END = 0.01, 1e-9, 20e-6
SPIN = (2000.0, -1500.0, 1000.0)  # 0.05 rad in a run: flexibility is found several times
AXES = ("normal", "xyz")
BELOW = (-700.0, 400.0, 900.0)
ASIDE = np.array([0.5, 0.0, -np.sqrt(0.75)])  # from the centre to a second patch


def marble(material, *all_axes):
    """A marble with three patches, by the axes of its flexibility."""
    places = {"south": (0, 0, -R), "slope": tuple(R * ASIDE), "north": (0, 0, R)}
    refine = [ep.Refine(p, 0.7e-3, 0.3e-3) for p in places.values()]
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), R), material, maxh=4e-3, refine=refine, grading=0.7)
    found = {}
    for axes in all_axes:
        parts = [ep.Partition.ball(fem, place, 0.8e-3, name=name, axes=axes) for name, place in places.items()]
        f_cut = 120e3 * np.sqrt(material.E / ep.STEEL.E)  # with the same modes
        found[axes] = ep.reduce(fem, parts[0] | parts[1] | parts[2], f_cut=f_cut)
    return found


@pytest.fixture(scope="module")
def marbles():
    """Of steel."""
    return marble(ep.STEEL, *AXES)


def thrown(
    body, *surfaces, frame="floating", loaded=False, name="ball", mbs=None, place=(0.0, 0.0), friction=(), **options
):
    """A marble between rigid surfaces, of which the first ones have `friction`: model, body and contacts."""
    mbs = exu.SystemContainer().AddSystem() if mbs is None else mbs
    motion = {"referencePosition": [*place, R + 5e-7], "initialVelocity": [0.2, 0.1, -1.0], "damping": 0.02}
    if frame == "floating":
        motion["initialAngularVelocity"] = SPIN
    ball = ep.CreatePartitionBody(mbs, body, name=name, frame=frame, **(motion | options))
    contacts = [
        ep.CreatePartitionContact(mbs, ball, surface, slavePatch=patch, name=f"{name} {patch}", friction=mu)
        for surface, patch, mu in zip(surfaces, ("south", "slope"), (*friction, None, None), strict=False)
    ]
    if loaded:
        marker = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=ball["nRigid"], coordinate=2))
        mbs.AddLoad(items.LoadCoordinate(markerNumber=marker, load=-50.0))
    mbs.Assemble()
    return mbs, [ball], contacts


PLANE, SLOPE = ep.RigidPlane(), ep.RigidPlane((0, 0, R) + (R + 2e-7) * ASIDE, -ASIDE)
HILL, BORE = ep.RigidSphere((0, 0, -2 * R), 2 * R), ep.RigidCylinder((0, 0, 3 * R), (0, 1, 0), 3 * R, hollow=True)
ROLL = ep.RigidCylinder((0, 0, -2 * R), (1, 0, 0), 2 * R)


def beside(marbles):
    """A marble that spins beside two that do not and touch each other, with frozen pairs."""
    mbs, balls, contacts = thrown(marbles["xyz"], PLANE)
    for i, speed in enumerate((0.0, -0.5)):
        at = {"referencePosition": [5 * R, 0, (2 * R + 1e-7) * i], "initialVelocity": [0, 0, speed]}
        balls.append(ep.CreatePartitionBody(mbs, marbles["normal"], name=str(i), **at))
    contacts.append(ep.CreatePartitionContact(mbs, balls[2], balls[1], slavePatch="south", masterPatch="north"))
    mbs.Assemble()
    return mbs, balls, contacts


def beside_friction(marbles):
    """A marble in an inertial frame that rubs on a plane, one that tumbles, and one that is fixed to its frame."""
    mbs = exu.SystemContainer().AddSystem()
    at = {"referencePosition": [5 * R, 0, R + 5e-7], "initialVelocity": [0.3, 0.1, -1.0], "damping": 0.02}
    rubs = ep.CreatePartitionBody(mbs, marbles["xyz"], name="rubs", **at)
    rough = ep.CreatePartitionContact(mbs, rubs, PLANE, slavePatch="south", friction=0.2, name="rough")
    _, [tumbles], [smooth] = thrown(marbles["xyz"], PLANE, mbs=mbs)
    _, [stays], [hill] = thrown(marbles["normal"], HILL, mbs=mbs, frame="inertial", name="stays")
    return mbs, [rubs, tumbles, stays], [rough, smooth, hill]


def rubs(*surfaces, friction=(0.2,), **options):
    """Return a function of marbles that makes one which rubs on rigid surfaces."""
    return lambda m: thrown(m["xyz"], *surfaces, friction=friction, **options)


def pair(
    body, *, frames=("floating", "floating"), along=0.2, gap=5e-7, mbs=None, aside=0.0, spin=SPIN, below=None,
    friction=None, **options,
):  # fmt: skip
    """Two marbles that meet, the upper one with a spin if its frame is floating, and the lower one with another."""
    mbs = exu.SystemContainer().AddSystem() if mbs is None else mbs
    motion = {"referencePosition": [aside, 0, 2 * R + gap], "initialVelocity": [along, 0.1, -1.0], "damping": 0.02}
    if frames[0] == "floating":
        motion["initialAngularVelocity"] = spin
    upper = ep.CreatePartitionBody(mbs, body, name="upper", frame=frames[0], **(motion | options))
    turns = {} if below is None else {"initialAngularVelocity": below}
    lower = ep.CreatePartitionBody(mbs, body, name="lower", frame=frames[1], referencePosition=[aside, 0, 0], **turns)
    contact = ep.CreatePartitionContact(
        mbs, upper, lower, slavePatch="south", masterPatch="north", name="pair", friction=friction
    )
    mbs.Assemble()
    return mbs, [upper, lower], [contact]


def row_of(body, *frames, friction=(None, None, None)):
    """Three marbles in a row, of which the middle one has two contacts, and a plane under the last one.

    The upper one spins if its frame is floating. If there is friction, all that float spin, so that contacts slip, and
    are slower, so that they stay on their patches.
    """
    mbs, rough = exu.SystemContainer().AddSystem(), any(friction)
    spins = [np.multiply(SPIN, 1 / (1 + rough)) if i == 2 or rough else None for i in range(3)]
    balls = [
        ep.CreatePartitionBody(
            mbs, body, name=str(i), frame=frame, damping=0.02, referencePosition=[0, 0, R + i * (2 * R + 2e-7)],
            initialVelocity=[(3.0 if rough else 8.0) * (i == 2), 0, -0.5 * (i + rough)],
            **({} if frame == "inertial" or spin is None else {"initialAngularVelocity": spin}),
        )
        for i, (frame, spin) in enumerate(zip(frames, spins, strict=True))
    ]  # fmt: skip
    contacts = [
        ep.CreatePartitionContact(
            mbs, balls[i + 1], balls[i], slavePatch="south", masterPatch="north", name=f"pair {i}", friction=friction[i]
        )
        for i in range(2)
    ]
    last = {"slavePatch": "south", "name": "plane", "friction": friction[2]}
    contacts.append(ep.CreatePartitionContact(mbs, balls[0], PLANE, **last))
    mbs.Assemble()
    return mbs, balls, contacts


def pair_and_friction(marbles):
    """A pair that slides beside a marble that rubs on a plane."""
    mbs, bodies, contacts = pair(marbles["xyz"], frames=("inertial", "inertial"), along=20.0)
    at = {"referencePosition": [5 * R, 0, R + 5e-7], "initialVelocity": [0.3, 0.1, -1.0], "damping": 0.02}
    rubs = ep.CreatePartitionBody(mbs, marbles["xyz"], name="rubs", **at)
    rough = ep.CreatePartitionContact(mbs, rubs, PLANE, slavePatch="south", friction=0.2, name="rough")
    mbs.Assemble()
    return mbs, [*bodies, rubs], [*contacts, rough]


@pytest.fixture(scope="module")
def skins():
    """A marble with one large patch, over which contact wanders."""
    refine = [ep.Refine((0, 0, z), 1.2e-3, 0.4e-3) for z in (-R, R)]
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), R), ep.STEEL, maxh=4e-3, refine=refine, grading=0.7)
    around = np.array([1.5e-3, 1.5e-3, 1.5e-4])
    parts = [ep.Partition.surface(fem, (p - around, p + around)) for p in np.array([[0, 0, -R], [0, 0, R]])]
    return ep.reduce(fem, parts[0] | parts[1], f_cut=120e3)


def apart(marbles):
    """Two equal marbles that rub on surfaces of their own."""
    mbs, first, [flat] = thrown(marbles["xyz"], PLANE, friction=(0.2,))
    _, second, [round_one] = thrown(marbles["xyz"], HILL, friction=(0.1,), mbs=mbs, name="other")
    return mbs, [*first, *second], [flat, round_one]


FALLS = ep.Coulomb(0.3, 0.15, 0.2)
RUBS = {
    "rubs on a plane": rubs(PLANE),
    "rubs on a sphere": rubs(HILL, friction=(FALLS,)),
    "rubs on a cylinder": rubs(ROLL, gravity=[10.0, 0.0, -2e4]),
    "rubs in a bore": rubs(BORE, friction=(0.05,)),
    "rubs on a sphere, inertial": rubs(HILL, frame="inertial", friction=(FALLS,)),
    "rubs in a bore, inertial": rubs(BORE, frame="inertial", initialVelocity=[0.3, 0.1, -1.0]),
    "rubs on two planes": rubs(PLANE, SLOPE, friction=(0.2, 0.1)),
    "rubs on one of two planes": rubs(PLANE, SLOPE),
    "rubs on a sphere and a plane, inertial": rubs(HILL, SLOPE, friction=(0.2, 0.1), frame="inertial"),
    "rubs on a plane beside a sphere, inertial": rubs(HILL, SLOPE, friction=(None, 0.1), frame="inertial"),
    "rubs on a plane, load": rubs(PLANE, loaded=True),
    "two rub on surfaces of their own": apart,
}
ROUGH = {
    "two that rub": lambda m: pair(m["xyz"], friction=0.2, below=BELOW),
    "two that rub fast": lambda m: pair(m["xyz"], friction=FALLS, below=BELOW, along=20.0),
    "a floating one rubs on an inertial one": lambda m: pair(
        m["xyz"], friction=FALLS, frames=("floating", "inertial"), gravity=[10.0, 0.0, -2e4]
    ),
    "an inertial one rubs on a floating one": lambda m: pair(
        m["xyz"], friction=0.1, frames=("inertial", "floating"), along=3.0, below=BELOW
    ),
    "two that rub in the first step": lambda m: pair(m["xyz"], friction=0.2, below=BELOW, gap=1e-8),
    "three that rub": lambda m: row_of(m["xyz"], *3 * ("floating",), friction=(0.2, FALLS, 0.1)),
    "three of which two rub": lambda m: row_of(m["xyz"], *3 * ("floating",), friction=(None, 0.2, None)),
    "three that rub in frames of both kinds": lambda m: row_of(
        m["xyz"], "inertial", "inertial", "floating", friction=(0.1, 0.2, None)
    ),
}
SCENES = (
    RUBS
    | ROUGH
    | {
        "two that tumble": lambda m: pair(m["xyz"]),
        "two that tumble, normals": lambda m: pair(m["normal"], gravity=[10.0, 0.0, -2e4]),
        "a floating one on an inertial one": lambda m: pair(m["xyz"], frames=("floating", "inertial")),
        "an inertial one on a floating one": lambda m: pair(m["normal"], frames=("inertial", "floating"), along=3.0),
        "far at first": lambda m: pair(m["xyz"], gap=8e-6),
        "a pair that slides": lambda m: pair(m["xyz"], frames=("inertial", "inertial"), along=20.0),
        "a pair that slides, normals": lambda m: pair(m["normal"], frames=("inertial", "inertial"), along=20.0),
        "three that tumble": lambda m: row_of(m["xyz"], *3 * ("floating",)),
        "three of which one slides": lambda m: row_of(m["normal"], *3 * ("inertial",)),
        "a pair that slides, and friction": pair_and_friction,
        "plane": lambda m: thrown(m["normal"], PLANE, gravity=[10.0, 0.0, -2e4]),
        "plane, all directions": lambda m: thrown(m["xyz"], PLANE),
        "plane, load": lambda m: thrown(m["xyz"], PLANE, loaded=True),
        "sphere": lambda m: thrown(m["xyz"], HILL),
        "cylinder": lambda m: thrown(m["normal"], ROLL),
        "bore": lambda m: thrown(m["xyz"], BORE),
        "without coupling": lambda m: thrown(m["xyz"], PLANE, inertiaTerms=("gyroscopic", "coriolis", "centrifugal")),
        "two planes": lambda m: thrown(m["xyz"], PLANE, SLOPE),
        "two planes, normals": lambda m: thrown(m["normal"], PLANE, SLOPE),
        "inertial, sphere": lambda m: thrown(m["xyz"], HILL, frame="inertial"),
        "inertial, bore and plane": lambda m: thrown(m["normal"], BORE, SLOPE, frame="inertial"),
        "beside frozen pairs": beside,
        "beside friction": beside_friction,
    }
)


def assert_same(right, found, bodies, contacts):
    """Two results of a model say the same."""
    assert (found.status, found.message, found.steps, found.step) == (
        right.status,
        right.message,
        right.steps,
        right.step,
    )
    np.testing.assert_allclose(found.t, right.t, rtol=1e-14)
    assert found.sensors.keys() == right.sensors.keys()
    for number, values in right.sensors.items():
        finite = np.isfinite(values)
        np.testing.assert_array_equal(np.isfinite(found.sensors[number]), finite)
        scale = np.where(finite, abs(values), 0.0).max()
        rounding = 1e-14 if values.shape[1] == 6 else 1e-300  # of places and rotations, which may be small
        assert abs(np.where(finite, found.sensors[number] - values, 0.0)).max() <= max(CLOSE * scale, rounding)
    for contact in contacts:
        for name in ("force", "energy"):
            values = getattr(contact, name)(right)
            np.testing.assert_allclose(getattr(contact, name)(found), values, rtol=0, atol=1e-8 * abs(values).max())
        rows = contact.row_forces(right)
        assert abs(contact.row_forces(found) - rows).max() <= 1e-8 * abs(rows).max()
        of_nodes = zip(contact.nodal_forces(found), contact.nodal_forces(right), strict=True)
        for one, other in of_nodes:
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-8 * abs(other).max())
        assert len(contact.impacts(found)) == len(contact.impacts(right))
        if contact.friction:
            np.testing.assert_array_equal(contact.friction.states(found), contact.friction.states(right))
            force = contact.friction.tangential_force(right)
            np.testing.assert_allclose(
                contact.friction.tangential_force(found), force, rtol=0, atol=CLOSE * abs(force).max()
            )
    for item in bodies:
        for name in ("energy", "momentum", "dissipated_energy"):
            values = getattr(item, name)(right)
            np.testing.assert_allclose(
                getattr(item, name)(found), values, rtol=0, atol=CLOSE * abs(values).max() + 1e-18
            )
    assert [text[:60] for text in found.warnings] == [text[:60] for text in right.warnings]


@pytest.mark.parametrize("scene", SCENES)
def test_equal_to_exudyn(marbles, scene):
    mbs, bodies, contacts = SCENES[scene](marbles)
    right = ep.solve_dynamic(mbs, end_time=END)
    assert all(contact.force(right).any() for contact in contacts)
    assert_same(right, ep.solve_dynamic(mbs, end_time=END, solver="compiled"), bodies, contacts)


NUMPY = (
    "rubs on a sphere",
    "rubs on two planes",
    "rubs on one of two planes",
    "rubs on a plane beside a sphere, inertial",
    "plane, all directions",
    "sphere",
    "two planes",
    "beside friction",
    "two that tumble",
    "a pair that slides, normals",
    "two that rub",
    "a floating one rubs on an inertial one",
    "three of which two rub",
)


@pytest.mark.parametrize("scene", [*NUMPY, "three that tumble", "three of which one slides"])
def test_steps_by_numpy_are_the_same(marbles, scene):
    def found():
        mbs, [ball, *_], contacts = SCENES[scene](marbles)
        result = ep.solve_dynamic(mbs, end_time=12e-6, solver="compiled")
        return np.array([contact.force(result) for contact in contacts]), ball.coordinates(result)

    (compiled, q), (plain, q_plain) = each_way(found)
    assert compiled[:2].any(axis=1).all()
    np.testing.assert_allclose(plain, compiled, rtol=0, atol=CLOSE * compiled.max())
    np.testing.assert_allclose(q_plain, q, rtol=0, atol=CLOSE * abs(q).max())


def test_loops_are_compiled_for_what_a_run_has(marbles):
    """Not for contacts without friction, or frames that turn, where there are none."""
    loops, of_friction = kernels("compiled"), kernels("compiled", "friction_kernels")
    if loops is None:
        pytest.skip("numba is not there")
    for scene in ("rubs in a bore, inertial", "rubs on a plane", "beside friction"):
        mbs, *_ = SCENES[scene](marbles)
        ep.solve_dynamic(mbs, end_time=1e-6, step=0.1e-6, solver="compiled")
    kinds = [(str(some[1]), some[4]) for some in loops.advance.overloads]
    in_frames_at_rest = {contacts for contacts, moving in kinds if str(getattr(moving, "types", "?")[0]) == "none"}
    assert "none" in in_frames_at_rest
    # Without rows that follow the motion, with those on rigid surfaces, with those of two bodies, and with both.
    assert len(of_friction.solve_group.dispatcher.overloads) <= 4


@pytest.mark.parametrize(("first", "later"), [("compiled", "exudyn"), ("exudyn", "compiled"), ("compiled", "compiled")])
def test_go_on(marbles, first, later):
    """Also the place at which the flexibility was found goes on."""
    options = {"step": 0.15e-6}
    mbs, _, [contact] = thrown(marbles["xyz"], HILL)
    whole = contact.force(ep.solve_dynamic(mbs, end_time=24e-6, **options))
    mbs, _, [contact] = thrown(marbles["xyz"], HILL)
    parts = [
        contact.force(ep.solve_dynamic(mbs, end_time=end, solver=solver, go_on=goes_on, **options))
        for end, solver, goes_on in ((12e-6, first, False), (24e-6, later, True))
    ]
    assert parts[0].any()
    np.testing.assert_allclose(np.r_[parts[0], parts[1][1:]], whole, rtol=0, atol=CLOSE * whole.max())


@pytest.mark.parametrize(("first", "later"), [("compiled", "exudyn"), ("exudyn", "compiled"), ("compiled", "compiled")])
def test_friction_beside_what_moves_goes_on(marbles, first, later):
    """Rows remember what stuck and slipped, and moving contacts their anchors."""
    options = {"step": 0.15e-6}
    mbs, _, contacts = beside_friction(marbles)
    result = ep.solve_dynamic(mbs, end_time=24e-6, **options)
    whole, work = [contact.force(result) for contact in contacts], contacts[0].friction.work(result)
    mbs, _, contacts = beside_friction(marbles)
    ep.solve_dynamic(mbs, end_time=12e-6, solver=first, **options)
    result = ep.solve_dynamic(mbs, end_time=24e-6, solver=later, go_on=True, **options)
    for contact, right in zip(contacts, whole, strict=True):
        force = contact.force(result)
        np.testing.assert_allclose(force, right[-len(force) :], rtol=0, atol=CLOSE * right.max())
    found = contacts[0].friction.work(result)
    assert work[-1]
    np.testing.assert_allclose(found, work[-len(found) :], rtol=0, atol=CLOSE * abs(work).max())


def test_adaptive_steps_of_friction_beside_what_moves(marbles):
    mbs, _, contacts = beside_friction(marbles)
    right, found = (ep.solve_dynamic(mbs, end_time=30e-6, adaptive=True, solver=s) for s in ("exudyn", "compiled"))
    np.testing.assert_allclose(found.t, right.t, rtol=1e-7)
    for contact in contacts:
        force = contact.force(right)
        assert force.any()
        np.testing.assert_allclose(contact.force(found), force, rtol=0, atol=1e-6 * force.max())
    work = contacts[0].friction.work(right)
    np.testing.assert_allclose(contacts[0].friction.work(found), work, rtol=0, atol=1e-6 * abs(work).max())


@pytest.mark.parametrize(("first", "later"), [("compiled", "exudyn"), ("exudyn", "compiled"), ("compiled", "compiled")])
@pytest.mark.parametrize(
    "scene",
    [
        "rubs on a sphere",
        "rubs on two planes",
        "rubs on a sphere and a plane, inertial",
        "two that rub",
        "three that rub",
    ],
)
def test_rows_that_rub_go_on(marbles, scene, first, later, tmp_path):
    """Their forces turn with the body; in the same model, and from a file in another one."""
    options, make, number = {"step": 0.15e-6}, SCENES[scene], int(scene == "three that rub")
    mbs, _, some = make(marbles)
    contact, whole = some[number], ep.solve_dynamic(mbs, end_time=24e-6, **options)
    force, work, along = contact.force(whole), contact.friction.work(whole), contact.friction.tangential_force(whole)
    mbs, _, some = make(marbles)
    contact = some[number]
    ep.solve_dynamic(mbs, end_time=12e-6, solver=first, **options).save(tmp_path / "cut.npz")
    fresh, _, others = make(marbles)
    again = others[number]
    cut = ep.Result.load(tmp_path / "cut.npz", fresh)
    for model, one, goes_on in ((mbs, contact, True), (fresh, again, cut)):
        result = ep.solve_dynamic(model, end_time=24e-6, solver=later, go_on=goes_on, **options)
        for values, right in (
            (one.force(result), force),
            (one.friction.tangential_force(result), along),
            (one.friction.work(result), work),
        ):
            np.testing.assert_allclose(values, right[-len(values) :], rtol=0, atol=CLOSE * abs(right).max())


@pytest.mark.parametrize("scene", ["rubs on a sphere", "rubs in a bore, inertial", "two that rub"])
def test_adaptive_steps_of_rows_that_rub(marbles, scene):
    mbs, _, [contact] = SCENES[scene](marbles)
    right, found = (ep.solve_dynamic(mbs, end_time=30e-6, adaptive=True, solver=s) for s in ("exudyn", "compiled"))
    np.testing.assert_allclose(found.t, right.t, rtol=1e-7)
    for values in (contact.force, contact.friction.tangential_force, contact.friction.work):
        assert np.any(values(right))
        np.testing.assert_allclose(values(found), values(right), rtol=0, atol=1e-6 * abs(values(right)).max())


@pytest.mark.parametrize("scene", ["rubs on a sphere", "rubs on one of two planes"])
def test_rows_that_rub_have_the_bits_of_single_runs(marbles, scene):
    """Whatever ran before, in any number of threads; and the forces of Exudyn's run."""
    mbs, [ball], [contact, *_] = RUBS[scene](marbles)
    vary = {
        ball: {
            "initialVelocity": np.array([[0.2, 0.1, -1.0], [0.1, 0, -1.0], [0.0, 0.2, -1.5]]),
            "initialAngularVelocity": np.array([SPIN, [0.0, 0, 0], [3e3, 0, 0]]),
            "referencePosition": np.array([[0, 0, R + 5e-7], [1e-5, 0, R + 3e-7], [0, 2e-5, R + 4e-7]]),
        },
        contact: {"friction": np.array([0.2, 0.1, 0.3])},
    }
    options = {"end_time": END, "step": 0.1e-6, "histories": ("force", "coordinates")}
    runs = ep.run_many(mbs, vary=vary, workers=2, **options)
    assert not runs.failures
    for entry in range(3):
        of_one = {item: {k: v[entry : entry + 1] for k, v in of_item.items()} for item, of_item in vary.items()}
        alone = ep.run_many(mbs, vary=of_one, **options)
        for name in ("force", "q", "q_t", "peak", "dissipated", "energy", "momentum"):
            np.testing.assert_array_equal(getattr(alone, name)[0], getattr(runs, name)[entry])
    surfaces = (HILL,) if scene == "rubs on a sphere" else (PLANE, SLOPE)
    other, _, [same, *_] = rubs(*surfaces, friction=(0.2,))(marbles)
    result = ep.solve_dynamic(other, end_time=END, step=0.1e-6)
    force, work = same.force(result), same.friction.work(result)[-1]
    np.testing.assert_allclose(runs.force[0, 0], force, rtol=0, atol=CLOSE * force.max())
    assert runs.dissipated[0, 0] == pytest.approx(work, rel=1e-8)


def test_pairs_that_rub_have_the_bits_of_single_runs(marbles):
    """Whatever ran before, in any number of threads; and the forces of Exudyn's run. The first entry is the model."""
    mbs, [upper, lower], [contact] = SCENES["two that rub"](marbles)
    vary = {
        upper: {
            "initialVelocity": np.array([[0.2, 0.1, -1.0], [10.0, 0, -1.0], [0.0, 0.2, -1.5]]),
            "initialAngularVelocity": np.array([SPIN, [0.0, 0, 0], [3e3, 0, 0]]),
            "referencePosition": np.array([[0, 0, 2 * R + 5e-7], [1e-5, 0, 2 * R + 3e-7], [0, 2e-5, 2 * R + 4e-7]]),
        },
        contact: {"friction": np.array([0.2, 0.1, 0.3])},
    }
    options = {"end_time": END, "step": 0.1e-6, "histories": ("force", "coordinates")}
    runs = ep.run_many(mbs, vary=vary, workers=2, **options)
    assert not runs.failures
    for entry in range(3):
        of_one = {item: {k: v[entry : entry + 1] for k, v in of_item.items()} for item, of_item in vary.items()}
        alone = ep.run_many(mbs, vary=of_one, **options)
        for name in ("force", "q", "q_t", "peak", "dissipated", "energy", "momentum"):
            np.testing.assert_array_equal(getattr(alone, name)[0], getattr(runs, name)[entry])
    result = ep.solve_dynamic(mbs, end_time=END, step=0.1e-6)
    force, work = contact.force(result), contact.friction.work(result)[-1]
    np.testing.assert_allclose(runs.force[0, 0], force, rtol=0, atol=CLOSE * force.max())
    assert runs.dissipated[0, 0] == pytest.approx(work, rel=1e-8)
    with pytest.raises(InputError, match="E of body 'lower'"):
        ep.run_many(mbs, vary={lower: {"E": [2e11]}}, **options)


def test_a_softer_body_that_rubs(marbles):
    """Of several contacts: in groups of rows that follow the motion, and of frozen ones."""
    make, options = RUBS["rubs on a sphere and a plane, inertial"], {"end_time": END, "step": 0.1e-6}
    mbs, [ball], stiff = make(marbles)
    runs = ep.run_many(mbs, vary={ball: {"E": [0.5 * ep.STEEL.E, ep.STEEL.E]}}, histories=("force",), **options)
    assert not runs.failures
    softer, _, soft = make(marble(replace(ep.STEEL, E=0.5 * ep.STEEL.E), "xyz"))
    for entry, (model, some) in enumerate(((softer, soft), (mbs, stiff))):
        result = ep.solve_dynamic(model, **options)
        forces = np.array([contact.force(result) for contact in some])
        assert forces.any(axis=1).all()
        np.testing.assert_allclose(runs.force[entry], forces, rtol=0, atol=1e-7 * forces.max())


def test_go_on_from_a_file(marbles, tmp_path):
    """In a new model, which knows nothing of the first run."""
    options = {"step": 0.15e-6, "solver": "compiled"}
    mbs, _, [contact] = thrown(marbles["xyz"], PLANE)
    whole = contact.force(ep.solve_dynamic(mbs, end_time=24e-6, **options))
    ep.solve_dynamic(mbs, end_time=12e-6, **options).save(tmp_path / "cut.npz")
    fresh, _, [contact] = thrown(marbles["xyz"], PLANE)
    later = ep.solve_dynamic(fresh, end_time=24e-6, go_on=ep.Result.load(tmp_path / "cut.npz", fresh), **options)
    force = contact.force(later)
    np.testing.assert_allclose(force, whole[-len(force) :], rtol=0, atol=CLOSE * whole.max())


GOES_ON = {
    "tumbles": lambda m: pair(m["xyz"]),
    "slides": lambda m: pair(m["normal"], frames=("inertial", "inertial"), along=20.0),
}


@pytest.mark.parametrize(("first", "later"), [("compiled", "exudyn"), ("exudyn", "compiled"), ("compiled", "compiled")])
@pytest.mark.parametrize("kind", GOES_ON)
def test_pairs_go_on(marbles, kind, first, later, tmp_path):
    """In the same model, and from a file in another one."""
    options, make = {"step": 0.15e-6}, GOES_ON[kind]
    mbs, _, [contact] = make(marbles)
    whole = contact.force(ep.solve_dynamic(mbs, end_time=24e-6, **options))
    mbs, _, [contact] = make(marbles)
    cut = ep.solve_dynamic(mbs, end_time=12e-6, solver=first, **options)
    cut.save(tmp_path / "cut.npz")
    found = contact.force(ep.solve_dynamic(mbs, end_time=24e-6, solver=later, go_on=True, **options))
    np.testing.assert_allclose(found, whole[-len(found) :], rtol=0, atol=CLOSE * whole.max())
    fresh, _, [contact] = make(marbles)
    result = ep.Result.load(tmp_path / "cut.npz", fresh)
    again = contact.force(ep.solve_dynamic(fresh, end_time=24e-6, solver=later, go_on=result, **options))
    np.testing.assert_allclose(again, whole[-len(again) :], rtol=0, atol=CLOSE * whole.max())


def test_pairs_that_come_to_rest_are_frozen_again(marbles):
    """The upper marble slides, and turns round in the middle of the steps after which one asks whether it slides."""
    motion = {"initialVelocity": [0.3, 0, 0], "gravity": [-3300.0, 0, -1e4], "referencePosition": [0, 0, 2 * R + 1e-7]}
    mbs, bodies, contacts = pair(marbles["normal"], frames=("inertial", "inertial"), **motion)
    right, found = (ep.solve_dynamic(mbs, end_time=130e-6, step=0.2e-6, solver=s) for s in ("exudyn", "compiled"))
    for result in (right, found):
        gaps = result.end.contacts.contacts[0].contact.gaps
        assert gaps.frozen.any()  # elsewhere than at the start
        assert gaps.stood is not None
    assert_same(right, found, bodies, contacts)


def test_pairs_have_the_bits_of_single_runs(marbles):
    """Whatever ran before, in any number of threads; and the forces of Exudyn's run."""
    mbs, [upper, _], [contact] = pair(marbles["xyz"])
    vary = {
        upper: {
            "initialVelocity": np.array([[0.2, 0.1, -1.0], [0.0, 0, -0.5], [3.0, 0, -1.0]]),
            "initialAngularVelocity": np.array([SPIN, [0.0, 0, 0], [3e3, 0, 0]]),
        }
    }
    options = {"end_time": 18e-6, "step": 0.15e-6, "histories": ("force", "coordinates")}
    runs = ep.run_many(mbs, vary=vary, workers=2, **options)
    assert not runs.failures
    for entry in range(3):
        alone = ep.run_many(mbs, vary={upper: {k: v[entry : entry + 1] for k, v in vary[upper].items()}}, **options)
        for name in ("force", "q", "q_t", "peak", "restitution", "energy", "momentum"):
            np.testing.assert_array_equal(getattr(alone, name)[0], getattr(runs, name)[entry])
    force = contact.force(ep.solve_dynamic(mbs, end_time=18e-6, step=0.15e-6))
    np.testing.assert_allclose(runs.force[0, 0], force, rtol=0, atol=CLOSE * force.max())


def test_rows_that_bending_pushes_shut_are_followed(thin_plate):
    """Of thin plates that meet tilted, as in Exudyn's run; the rows between them are all that may close."""
    mbs = exu.SystemContainer().AddSystem()
    tilt = Rotation.from_rotvec([0.0, 0.008, 0.002]).as_matrix()
    falls = {"referencePosition": [1.3e-3, 0.7e-3, 1.115e-3], "initialVelocity": [0.5, 0, -20.0]}
    upper, lower = (
        ep.CreatePartitionBody(mbs, thin_plate, frame="floating", name=name, **motion)
        for name, motion in (("upper", falls | {"referenceRotationMatrix": tilt}), ("lower", {}))
    )
    contact = ep.CreatePartitionContact(mbs, upper, lower, slavePatch="low", masterPatch="high")
    mbs.Assemble()
    right, found = (contact.force(ep.solve_dynamic(mbs, end_time=12e-6, solver=s)) for s in ("exudyn", "compiled"))
    assert right[-1] > 0
    np.testing.assert_allclose(found, right, rtol=0, atol=1e-6 * right.max())


def test_adaptive_steps_of_pairs(marbles):
    mbs, _, contacts = pair(marbles["xyz"], gap=8e-6)
    right, found = (ep.solve_dynamic(mbs, end_time=30e-6, adaptive=True, solver=s) for s in ("exudyn", "compiled"))
    np.testing.assert_allclose(found.t, right.t, rtol=1e-7)
    force = contacts[0].force(right)
    assert force.any()
    np.testing.assert_allclose(contacts[0].force(found), force, rtol=0, atol=1e-6 * force.max())


@pytest.mark.parametrize("frame", ["floating", "inertial"])
def test_contact_that_wanders(skins, frame):
    mbs = exu.SystemContainer().AddSystem()
    spin = {"initialAngularVelocity": SPIN} if frame == "floating" else {}
    upper = ep.CreatePartitionBody(
        mbs,
        skins,
        name="upper",
        frame=frame,
        referencePosition=[0, 0, 2 * R + 5e-7],
        initialVelocity=[20.0, 0, -1.0],
        **spin,
    )
    lower = ep.CreatePartitionBody(mbs, skins, name="lower", frame=frame)
    contact = ep.CreatePartitionContact(mbs, upper, lower, slavePatch=0, masterPatch=1)
    mbs.Assemble()
    right, found = (ep.solve_dynamic(mbs, end_time=END, solver=s) for s in ("exudyn", "compiled"))
    assert contact.force(right).any()
    assert_same(right, found, [upper, lower], [contact])


def test_adaptive_steps_are_those_of_exudyn(marbles):
    mbs, _, contacts = thrown(marbles["xyz"], PLANE, referencePosition=[0, 0, R + 8e-6])
    right, found = (ep.solve_dynamic(mbs, end_time=40e-6, adaptive=True, solver=s) for s in ("exudyn", "compiled"))
    assert np.ptp(np.diff(right.t)) > 0.0
    np.testing.assert_allclose(found.t, right.t, rtol=1e-7)
    force = contacts[0].force(right)
    assert force.any()
    np.testing.assert_allclose(contacts[0].force(found), force, rtol=0, atol=1e-6 * force.max())


def test_an_impact_keeps_momentum_and_energy(marbles):
    """Of a body that spins: what the plane gives, and nothing else; compared with no other run."""
    mbs, [ball], [contact] = thrown(marbles["xyz"], PLANE, damping=None)
    result = ep.solve_dynamic(mbs, end_time=60e-6, solver="compiled")
    force = contact.force(result)
    assert force.any()
    assert not force[-1]
    momentum, impulse = ball.momentum(result), np.trapezoid(force, result.t)
    np.testing.assert_allclose(momentum[-1] - momentum[0], [0, 0, impulse], rtol=0, atol=1e-6 * impulse)
    kinetic = ball.energy(result) + contact.energy(result)
    np.testing.assert_allclose(kinetic, kinetic[0], rtol=2e-4)
    spin = ball.kinematics.angular_momentum(ball.coordinates(result), ball.coordinates_t(result), np.zeros(3))
    assert abs(spin[:, 2] - spin[0, 2]).max() < 1e-6 * np.linalg.norm(spin[0])


def test_many_runs_have_the_bits_of_single_ones(marbles):
    mbs, [ball], _ = thrown(marbles["xyz"], HILL)
    vary = {
        ball: {
            "initialVelocity": np.array([[0.0, 0, -0.5], [0.1, 0, -1.0], [0.0, 0.2, -1.5]]),
            "initialAngularVelocity": np.array([[0.0, 0, 0], [3e3, 0, 0], SPIN]),
            "referencePosition": np.array([[0, 0, R + 3e-7], [1e-5, 0, R + 3e-7], [0, 2e-5, R + 4e-7]]),
        }
    }
    options = {"end_time": END, "step": 0.1e-6, "histories": ("force", "coordinates")}
    runs = ep.run_many(mbs, vary=vary, workers=2, **options)
    assert not runs.failures
    for entry in range(3):
        alone = ep.run_many(mbs, vary={ball: {k: v[entry : entry + 1] for k, v in vary[ball].items()}}, **options)
        for name in ("force", "q", "q_t", "peak", "restitution", "energy", "momentum"):
            np.testing.assert_array_equal(getattr(alone, name)[0], getattr(runs, name)[entry])
    place, velocity, spin = (
        vary[ball][k][2] for k in ("referencePosition", "initialVelocity", "initialAngularVelocity")
    )
    other, [same], [contact] = thrown(
        marbles["xyz"], HILL, referencePosition=place, initialVelocity=velocity, initialAngularVelocity=spin
    )
    result = ep.solve_dynamic(other, end_time=END, step=0.1e-6)
    force, energy = contact.force(result), same.energy(result)
    np.testing.assert_allclose(runs.force[2, 0], force, rtol=0, atol=1e-7 * force.max())
    np.testing.assert_allclose(runs.energy[2].sum(axis=0), energy[[0, -1]].sum(), rtol=1e-7)


def test_many_runs_of_friction_beside_what_moves(marbles):
    """The second entry is the model as it is."""
    mbs, [_, tumbles, _], contacts = beside_friction(marbles)
    options = {"end_time": END, "step": 0.15e-6}
    vary = {tumbles: {"initialAngularVelocity": [[0.0] * 3, SPIN]}, contacts[0]: {"friction": [0.1, 0.2]}}
    runs = ep.run_many(mbs, vary=vary, histories=("force",), **options)
    assert not runs.failures
    result = ep.solve_dynamic(mbs, **options)
    forces = np.array([contact.force(result) for contact in contacts])
    np.testing.assert_allclose(runs.force[1], forces, rtol=0, atol=CLOSE * forces.max())
    assert runs.dissipated[1, 0] == pytest.approx(contacts[0].friction.work(result)[-1], rel=1e-9)
    assert runs.dissipated[0, 0] > 1.2 * runs.dissipated[1, 0] > 0.0  # slips longer
    assert not runs.dissipated[:, 1:].any()
    assert abs(runs.force[0, 1] - forces[1]).max() > 1e-3 * forces[1].max()


def test_a_file_of_entries_is_of_one_surface(marbles, tmp_path):
    options = {"end_time": 12e-6, "step": 0.15e-6, "file": tmp_path / "map.jsonl", "histories": ()}
    for radius in (2 * R, 2.1 * R):
        mbs, [ball], _ = thrown(marbles["normal"], ep.RigidSphere((0, 0, -radius), radius))
        vary = {ball: {"initialVelocity": [[0.0, 0.0, -0.5]]}}
        if radius == 2 * R:
            assert ep.run_many(mbs, vary=vary, **options).peak.item() > 0.0
        else:
            with pytest.raises(InputError, match="is of other model"):
                ep.run_many(mbs, vary=vary, **options)


def test_gravity_and_damping_vary_too(marbles):
    mbs, [ball], _ = thrown(marbles["xyz"], PLANE)
    vary = {ball: {"gravity": np.array([[0.0, 50.0, -3e4]]), "damping": np.array([0.1])}}
    runs = ep.run_many(mbs, vary=vary, end_time=END, step=0.1e-6, histories=("force",))
    other, _, [contact] = thrown(marbles["xyz"], PLANE, gravity=[0.0, 50.0, -3e4], damping=0.1)
    force = contact.force(ep.solve_dynamic(other, end_time=END, step=0.1e-6))
    np.testing.assert_allclose(runs.force[0, 0], force, rtol=0, atol=1e-9 * force.max())


def test_what_cannot_vary(marbles):
    mbs, [ball], _ = thrown(marbles["normal"], PLANE)
    with pytest.raises(InputError, match="vary: E of body 'ball', which has a floating frame"):
        ep.run_many(mbs, end_time=END, vary={ball: {"E": [2e11]}})


def test_what_is_refused(marbles):
    mbs, _, _ = thrown(marbles["normal"], PLANE, inertiaTerms=("gyroscopic",))
    with pytest.raises(CompiledRunError, match="body 'ball' leaves out inertia forces by inertiaTerms"):
        ep.solve_dynamic(mbs, end_time=END, solver="compiled")
