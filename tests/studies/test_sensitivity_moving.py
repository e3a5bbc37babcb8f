"""Derivatives of runs whose rows follow the motion on rigid surfaces are those of differences between runs.

Rows follow bodies on curved surfaces, and bodies in floating frames on all.
"""

from dataclasses import replace

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
import scipy.sparse as sp
from oracles import MARBLE_RADIUS as R
from oracles import each_way

import exudyn_partition as ep
from exudyn_partition.errors import CompiledRunError

pytestmark = pytest.mark.filterwarnings("ignore::exudyn_partition.errors.PartitionWarning")
STEP, END = 0.2e-6, 16e-6
WITHIN = 1e-6  # of the number, or of the largest derivative of a kind
VELOCITY = np.array([4.0, 1.0, -1.0])  # normals change by 0.03 in a run: flexibility is found several times
SIZES = {
    "initialVelocity": 0.5, "initialAngularVelocity": 100.0, "referencePosition": 1e-6, "gravity": 1e4,
    "damping": 0.02, "E": ep.STEEL.E, "rho": ep.STEEL.rho,
}  # fmt: skip
DIRECTION = np.array([0.3, 0.1, 1.0])


def reduced(axes, material=ep.STEEL):
    """A ball with a patch at either pole."""
    refine = [ep.Refine((0, 0, z), 0.3e-3, 0.15e-3) for z in (-R, R)]
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), R), material, maxh=5e-3, refine=refine, grading=0.9)
    patches = [ep.Partition.ball(fem, (0, 0, z), 0.35e-3, name=name, axes=axes) for z, name in ((-R, "s"), (R, "n"))]
    return ep.reduce(fem, patches[0] | patches[1], f_cut=250e3 * np.sqrt(material.E / ep.STEEL.E))


@pytest.fixture(scope="module")
def balls():
    return {axes: reduced(axes) for axes in ("normal", "xyz")}


HILL, ROOF = ep.RigidSphere((0, 0, -2e-3), 2e-3), ep.RigidSphere((0, 0, 2 * R + 2e-3 + 3e-7), 2e-3)
BORE = ep.RigidCylinder((0, 0, 1.6 * R), (0.1, 1, 0), 1.6 * R, hollow=True)
FLOOR, CEILING = ep.RigidPlane(), ep.RigidPlane((0, 0, 2 * R + 3e-7), (0, 0, -1))
SPIN = np.array([900.0, -1500.0, 1200.0])  # the ball turns by 0.03 in a run, and grows by its spin
SCENES = {  # frame, axes of the flexibility, and surfaces below and above
    "hill": ("inertial", "xyz", HILL),
    "bore": ("inertial", "normal", BORE),
    "under a plane": ("inertial", "xyz", HILL, CEILING),
    "between": ("inertial", "xyz", HILL, ROOF),
    "spinning on a floor": ("floating", "xyz", FLOOR),
    "spinning between floor and ceiling": ("floating", "normal", FLOOR, CEILING),
    "spinning in a bore": ("floating", "xyz", BORE),
}


def flies(ball, *surfaces, frame="inertial"):
    """A ball that flies along a surface, perhaps beneath another one."""
    mbs = exu.SystemContainer().AddSystem()
    motion = {"referencePosition": [0, 0, R + 1e-7], "initialVelocity": VELOCITY, "gravity": [0, 0, -2e4]}
    spin = {"initialAngularVelocity": SPIN} if frame == "floating" else {}
    item = ep.CreatePartitionBody(mbs, ball, name="ball", damping=0.03, frame=frame, **motion, **spin)
    contacts = [
        ep.CreatePartitionContact(mbs, item, surface, slavePatch=patch, name=patch)
        for surface, patch in zip(surfaces, "sn", strict=False)
    ]
    mbs.Assemble()
    return mbs, item, contacts


def differences(mbs, item, name, share):
    """Central differences by a parameter's entries: peak of the first contact, its impulse, momentum and energy."""
    given = {"initialVelocity": VELOCITY, "gravity": (0, 0, -2e4), "referencePosition": item.position, "damping": 0.03}
    given |= {"initialAngularVelocity": SPIN} if item.frame == "floating" else {}
    value, change = np.array(given.get(name, SIZES[name] if name in ("E", "rho") else np.zeros(3))), share * SIZES[name]
    ways = change * np.concatenate([np.eye(max(value.size, 1)), -np.eye(max(value.size, 1))])
    vary = {item: {name: value + (ways if value.ndim else ways[:, 0])}}
    runs = ep.run_many(mbs, end_time=END, step=STEP, vary=vary, histories=())
    found = {
        "peak_force": runs.peak[:, 0],
        "impulse": runs.impulse[:, 0],
        "velocity": runs.momentum[:, 1, 0] @ DIRECTION / item.body.total_mass,
        "energy": runs.energy[:, 1, 0],
    }
    return {of: (more - less) / (2 * change) for of, (more, less) in ((k, np.split(v, 2)) for k, v in found.items())}


@pytest.mark.parametrize("scene", SCENES)
def test_derivatives_are_differences_of_runs(balls, scene):
    frame, axes, *surfaces = SCENES[scene]
    mbs, item, contacts = flies(balls[axes], *surfaces, frame=frame)
    options, shares = {"end_time": END, "step": STEP}, (1e-5, 1e-6) if frame == "inertial" else (1e-3, 1e-4)
    found = {of: ep.sensitivity(mbs, of=of, at=contacts[0], **options) for of in ("peak_force", "impulse")}
    found["velocity"] = ep.sensitivity(mbs, of="velocity", at=item, direction=DIRECTION, **options)
    found["energy"] = ep.sensitivity(mbs, of="energy", at=item, **options)
    assert {*found["energy"].by[item]} == {*SIZES} - ({"E", "rho"} if frame == "floating" else set())
    assert found["impulse"].changes > 1
    assert found["impulse"].edges == 0
    for name in found["energy"].by[item]:
        errors, size = [], SIZES[name]
        for share in shares:
            by_runs = differences(mbs, item, name, share)
            errors.append([])
            for of, one in found.items():
                if (of, name) == ("velocity", "rho"):
                    continue  # the mass is another one too
                right = np.atleast_1d(one.by[item][name])
                difference = abs(right - by_runs[of]).max() * size
                errors[-1].append(difference / max(abs(one.value), abs(right).max() * size))
        assert np.min(errors, axis=0).max() <= WITHIN, (name, errors)


@pytest.mark.parametrize(
    ("frame", "name", "value", "change"),
    [
        ("inertial", "initialVelocity", VELOCITY, 1e-6),
        ("floating", "initialVelocity", VELOCITY, 1e-4),
        ("floating", "initialAngularVelocity", SPIN, 0.1),  # by which the ball grows
    ],
)
def test_duration(balls, frame, name, value, change):
    """That of a short contact, of which both ends are within the run."""
    mbs, item, [contact] = flies(balls["normal"], BORE if frame == "inertial" else FLOOR, frame=frame)
    options = {"end_time": 40e-6, "step": STEP}
    found = ep.sensitivity(mbs, of="duration", at=contact, **options).by[item][name]
    entries = value + change * np.concatenate([np.eye(3), -np.eye(3)])
    runs = ep.run_many(mbs, vary={item: {name: entries}}, histories=(), **options)
    assert (runs.duration < 39e-6).all()
    more, less = np.split(runs.duration[:, 0], 2)
    np.testing.assert_allclose(found, (more - less) / (2 * change), rtol=0, atol=WITHIN * abs(found).max())


def test_a_spinning_ball_beside_one_that_does_not(balls):
    """Bodies that have nothing in common have the derivatives that each of them has alone, and none by the other."""

    def thrown(*frames):
        mbs = exu.SystemContainer().AddSystem()
        items = []
        for place, frame in enumerate(frames):
            motion = {"referencePosition": [0, 0, R + 1e-7], "initialVelocity": VELOCITY}
            items.append(ep.CreatePartitionBody(mbs, balls["xyz"], name=f"{place}", frame=frame, **motion))
            ep.CreatePartitionContact(mbs, items[-1], FLOOR if frame == "floating" else HILL, slavePatch="s")
        mbs.Assemble()
        return mbs, items

    (mbs, items), options = thrown("inertial", "floating"), {"end_time": 8e-6, "step": STEP}
    for item, other in zip(items, items[::-1], strict=True):
        alone, [single] = thrown(item.frame)
        right = ep.sensitivity(alone, of="energy", at=single, **options)
        found = ep.sensitivity(mbs, of="energy", at=item, **options)
        for name, value in right.by[single].items():
            assert found.by[item][name] == pytest.approx(value, rel=1e-9, abs=1e-12 * np.max(np.abs(value)))
            if name in found.by[other]:
                assert not np.any(found.by[other][name])


@pytest.mark.parametrize("frame", ["floating", "inertial"])
def test_rows_that_follow_the_motion_with_friction_are_refused(balls, frame):
    mbs = exu.SystemContainer().AddSystem()
    thrown = {"referencePosition": [0, 0, R + 1e-7], "initialVelocity": [0.2, 0, -1.0], "frame": frame}
    ball = ep.CreatePartitionBody(mbs, balls["xyz"], name="ball", **thrown)
    hill = ep.RigidSphere((0, 0, -R), R)
    contact = ep.CreatePartitionContact(mbs, ball, hill, slavePatch="s", name="rough", friction=0.2)
    mbs.Assemble()
    with pytest.raises(CompiledRunError, match="contact 'rough' has friction, or moves with one that has it"):
        ep.sensitivity(mbs, end_time=10e-6, of="impulse", at=contact)


TIMES = np.array([0.0, 3.3e-6, 9.1e-6, END])
GAUGE = sp.csr_matrix([[1.0, -1.0]]) / (2 * R)  # of two nodes


def point_and_strain(item):
    """What asks for these numbers, and functions of coordinates and velocities, (n, n_dofs), that give them."""
    point = item.body.points[item.body.nearest_node(np.array([0, R, 0]))]
    nodes = [item.body.nearest_node(np.array([0, 0, z])) for z in (R, -R)]
    rows = sp.csr_matrix((GAUGE.data, ([0, 0], [3 * node + 2 for node in nodes])), (1, 3 * len(item.body.points)))
    around = item.kinematics.at(np.array([item.body.nearest_node(point)]))

    def strain(q, q_t):
        growth = item.kinematics.products(q_t) @ item.body.growth_in(rows).T
        return (item.kinematics.elastic(q) @ item.body.reduced_rows(rows).T + growth)[:, 0]

    velocity = {"of": "velocity", "point": point, "direction": DIRECTION}
    return [
        (velocity, lambda q, q_t: around.velocities(q, q_t)[:, 0] @ DIRECTION),
        ({"of": "strain", "rows": rows}, strain),
    ]


@pytest.mark.parametrize("name", ["initialVelocity", "initialAngularVelocity", "gravity", "damping"])
def test_histories_in_a_floating_frame(balls, name):
    """Velocity of a point and strain, with growth by rotation; values are those of results."""
    mbs, item, _ = flies(balls["xyz"], FLOOR, frame="floating")
    options, size = {"end_time": END, "step": STEP}, SIZES[name]
    value = {"initialVelocity": VELOCITY, "initialAngularVelocity": SPIN, "gravity": np.array([0, 0, -2e4])}.get(name)
    value = np.array(0.03) if value is None else value
    found = [ep.sensitivity(mbs, at=item, times=TIMES, **wanted, **options) for wanted, _ in point_and_strain(item)]
    errors = []
    for share in (1e-3, 1e-4):
        ways = share * size * np.concatenate([np.eye(max(value.size, 1)), -np.eye(max(value.size, 1))])
        entries = value + (ways if value.ndim else ways[:, 0])
        runs = ep.run_many(mbs, vary={item: {name: entries}}, histories=("coordinates",), **options)
        errors.append([])
        for one, (_, history) in zip(found, point_and_strain(item), strict=True):
            of_runs = [history(q, q_t) for q, q_t in zip(runs.q, runs.q_t, strict=True)]
            at_times = np.array([np.interp(TIMES, runs.t, of_run) for of_run in of_runs])
            more, less = np.split(at_times, 2)
            by_runs = ((more - less) / (2 * share)).T
            right = size * one.by[item][name].reshape(by_runs.shape)
            errors[-1].append(abs(right - by_runs).max() / max(abs(one.value).max(), abs(right).max()))
    assert np.min(errors, axis=0).max() <= WITHIN, errors


def test_values_in_a_floating_frame_are_those_of_results(balls):
    mbs, item, _ = flies(balls["xyz"], FLOOR, frame="floating")
    (velocity, _), (strain, _) = point_and_strain(item)
    options = {"at": item, "end_time": END, "step": STEP, "times": TIMES}
    result = ep.solve_dynamic(mbs, end_time=END, step=STEP)
    for wanted, history in (
        (velocity, item.velocity(result, velocity["point"]) @ DIRECTION),
        (strain, item.recover(result, strain["rows"])[:, 0]),
    ):
        value = ep.sensitivity(mbs, **wanted, **options).value
        np.testing.assert_allclose(
            value, np.interp(TIMES, result.t, history), rtol=1e-9, atol=1e-9 * abs(history).max()
        )


@pytest.mark.parametrize(
    ("frame", "surfaces"), [("inertial", (HILL, ROOF)), ("floating", (BORE,)), ("floating", (FLOOR, CEILING))]
)
def test_without_loops_it_is_the_same(balls, frame, surfaces):
    def found():
        mbs, item, contacts = flies(balls["xyz"], *surfaces, frame=frame)
        one = ep.sensitivity(mbs, end_time=8e-6, step=STEP, of="impulse", at=contacts[0])
        return [one.value, one.margin, *map(np.array, one.by[item].values())]

    for right, plain in zip(*each_way(found), strict=True):
        np.testing.assert_allclose(plain, right, rtol=0, atol=1e-8 * max(abs(np.array(right)).max(), 1e-12))


def test_stiffness_on_a_curved_surface_is_that_of_a_new_reduction(balls):
    soft = replace(ep.STEEL, E=0.5 * ep.STEEL.E)
    mbs, item, _ = flies(balls["xyz"], HILL)
    runs = ep.run_many(mbs, end_time=END, step=STEP, vary={item: {"E": [soft.E]}}, histories=("force",))
    other, _, [contact] = flies(reduced("xyz", soft), HILL)
    force = contact.force(ep.solve_dynamic(other, end_time=END, step=STEP))
    np.testing.assert_allclose(runs.force[0, 0], force, rtol=0, atol=1e-6 * force.max())
