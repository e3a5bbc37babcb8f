"""A clip whose ends touch each other, by two patches or by one that folds, against the full FE model."""

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
from oracles import relative

import exudyn_partition as ep
from exudyn_partition.algebra.complementarity import Complementarity, regularised
from exudyn_partition.algebra.friction import OPEN, SLIP, STICK
from exudyn_partition.algebra.products import dense
from exudyn_partition.algebra.sparse.multifrontal import Factorisation
from exudyn_partition.contact.normal_rows import NormalRows
from exudyn_partition.errors import EmptyRegionError, InputError
from exudyn_partition.reference.full_body import rows_on_dofs
from exudyn_partition.reference.integrator import HHT
from exudyn_partition.reference.laws import Frictional, Frictionless
from exudyn_partition.surfaces.rows import pair_surfaces

ARM, THICK, MOUTH, R, CLEARANCE = 20e-3, 4e-3, 3e-3, 20e-3, 5e-6  # of the clip, and of the tip on its lower arm [m]
END, STEP, SPEED = 30e-6, 0.25e-6, 1.0  # [s], [s], of the arms to each other [m/s]; they touch from 5 to 17 us
FRICTION = 0.3
TIP, FACE = (17e-3, 0, -CLEARANCE), (17e-3, 0, 0)


@pytest.fixture(scope="module")
def clip():
    """FE model and partition of a C; a ball on its lower arm is the tip that meets the upper arm."""
    outside = occ.Box(occ.Pnt(-THICK, -THICK / 2, -MOUTH - THICK), occ.Pnt(ARM, THICK / 2, THICK))
    mouth = occ.Box(occ.Pnt(0, -THICK, -MOUTH), occ.Pnt(2 * ARM, THICK, 0))
    ball = occ.Sphere(occ.Pnt(TIP[0], 0, TIP[2] - R), R)
    lower = occ.Box(occ.Pnt(0, -THICK / 2, -MOUTH - THICK), occ.Pnt(ARM, THICK / 2, 0))
    shape = (outside - mouth) + ball * lower
    refine = [ep.Refine(place, 1e-3, 0.35e-3) for place in (TIP, FACE)]
    fem = ep.fe_model(shape, ep.STEEL, maxh=3e-3, refine=refine)
    tip = ep.Partition.ball(fem, TIP, 1e-3, direction=(0, 0, 1), name="tip")
    return fem, tip | ep.Partition.ball(fem, FACE, 1e-3, direction=(0, 0, -1), name="face")


@pytest.fixture(scope="module")
def body(clip):
    return ep.reduce(*clip, f_cut=200e3)


@pytest.fixture(scope="module")
def folded(clip):
    """The clip with one patch, which has facets of both arms, and rows with friction."""
    inside = [(13e-3, -1.6e-3, -MOUTH + 0.1e-3), (19.5e-3, 1.6e-3, 0.1e-3)]
    return ep.reduce(clip[0], ep.Partition.surface(clip[0], inside, axes="xyz", name="mouth"), f_cut=200e3)


@pytest.fixture(scope="module")
def rough(clip):
    """The clip with two patches that have friction."""
    tip = ep.Partition.ball(clip[0], TIP, 1e-3, direction=(0, 0, 1), axes="xyz", name="tip")
    face = ep.Partition.ball(clip[0], FACE, 1e-3, direction=(0, 0, -1), axes="xyz", name="face")
    return ep.reduce(clip[0], tip | face, f_cut=200e3)


def closing(body, axis=2):
    """Velocities of the coordinates, (n_dofs,), of the lowest shape that moves the ends to each other, with SPEED."""
    shapes, (tip, face) = np.eye(body.n_dofs), [patch.nodes for patch in body.partition.patches]
    moved = [body.displacement(shape)[:, axis] for shape in shapes]
    speed = np.array([x[tip].mean() - x[face].mean() for x in moved])
    first = np.flatnonzero(np.abs(speed) > 0.5 * np.abs(speed).max())[0]
    return shapes[first] * SPEED / speed[first]


def model(body, frame="inertial", **options):
    """The assembled model of the clip, the clip in it, and its contact."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, frame=frame)
    patches = {"slavePatch": 0, "masterPatch": len(body.partition.patches) - 1}
    contact = ep.CreatePartitionContact(mbs, item, item, passes="given", **patches, **options)
    mbs.Assemble()
    return mbs, item, contact


def reduced(body, velocity, method, step, **options):
    """The run of a clip that closes, the clip, and its contact; `velocity` is that of the basis' coordinates."""
    mbs, item, contact = model(body, **options)
    mbs.systemData.SetODE2Coordinates_t(item.kinematics.from_basis @ velocity, exu.ConfigurationType.Initial)
    result = ep.solve_dynamic(mbs, end_time=END, step=step, method=method)
    assert contact.impacts(result)[0].speed_before is None  # rigid motion of one body tells nothing of its ends
    return result, item, contact


def full_rows(fem, partition, friction=None):
    """Law of the contact, and its rows on all dofs of the full FE model, csr (m, 3n)."""
    sides = [ep.reference.FullBody(fem, partition, patch=name) for name in ("tip", "face")]
    given = pair_surfaces(*(side.surface for side in sides)), [len(side.contact.nodes) for side in sides]
    steps = round(END / STEP)
    if friction is None:
        law = Frictionless(*given, steps)
    else:
        law = Frictional(*given, steps, friction=ep.Coulomb(friction), step=STEP)
    return law, sum(rows_on_dofs(side, rows) for side, rows in zip(sides, law.matrices, strict=True))


def full(fem, partition, velocity, friction=None):
    """Forces over the run of the full FE model with the same rows, as a history."""
    law, G = full_rows(fem, partition, friction)
    steps = HHT(fem.mass, fem.stiffness, G, STEP, velocity=velocity)
    law.begin(regularised(steps.compliance()))
    for n in range(1, round(END / STEP) + 1):
        lam = law.forces(steps.predict())
        steps.correct(lam)
        law.record(lam, n)
    return law.history(STEP * np.arange(n + 1), {}, {})


@pytest.fixture(scope="module")
def meeting(clip, body):
    """The full FE model's answer without friction to the motion that closes the clip; its velocities, (3n,)."""
    velocity = body.displacement(closing(body)).ravel()
    return full(*clip, velocity), velocity


def test_modes_and_rows_have_the_flexibility_of_the_full_model(clip):
    """That of the clip between its ends: of modes, of both patches, and across from one patch to the other."""
    fem, partition = clip
    body = ep.reduce(fem, partition, f_cut=20e3)
    gaps = model(body)[2].mechanics.gaps
    every = np.arange(len(gaps.row_nodes))
    H = gaps.jacobian(every).reshape(len(every), 2, -1).sum(axis=1)  # both sides have the same coordinates
    found = H @ np.linalg.pinv(body.stiffness.toarray(), rcond=1e-8, hermitian=True) @ H.T + NormalRows(
        gaps
    ).flexibility(every)
    _, G = full_rows(fem, partition)
    a, b = fem.points[:, 0].argmin(), fem.points[:, 0].argmax()
    c = abs(np.cross(fem.points - fem.points[a], fem.points[b] - fem.points[a])[:, 1]).argmax()  # far from their line
    held = np.array([3 * a, 3 * a + 1, 3 * a + 2, 3 * b + 1, 3 * b + 2, 3 * c + 1])  # what carries no force
    free = np.setdiff1d(np.arange(fem.n_dofs), held)
    loads = G[:, free].T.toarray()
    expected = loads.T @ Factorisation(fem.stiffness[free][:, free]).solve(loads)
    assert relative(found, expected) < 1e-4  # 7e-4 without one of both parts across


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.ModelLimitWarning")  # a coarse mesh, both have it
def test_ends_of_a_clip_meet(body, meeting):
    """Explicit and implicit steps, against the full FE model."""
    expected, _ = meeting
    assert expected.force.max() > 10.0
    for method, step in (("explicit", None), ("implicit", STEP)):
        result, _, contact = reduced(body, closing(body), method, step)
        assert relative(np.interp(expected.t, result.t, contact.force(result)), expected.force) < 0.01, method


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.ModelLimitWarning")
@pytest.mark.parametrize(
    ("shear", "sticks", "method", "step", "frame"),
    [(0.4, True, "explicit", None, "floating"), (1.0, False, "implicit", STEP, "inertial")],
)
def test_ends_of_a_clip_rub(clip, rough, shear, sticks, method, step, frame):
    """They stick or slip as those of the full FE model; a clip alone keeps its momentum."""
    start = closing(rough) + shear * closing(rough, axis=1)
    expected = full(*clip, rough.displacement(start).ravel(), FRICTION)
    result, item, contact = reduced(rough, start, method, step, frame=frame, friction=FRICTION)
    found = contact.force(result), *contact.friction.tangential_force(result).T[:2]
    assert abs(found[2]).max() > 10.0
    assert (contact.friction.stuck_rows(result).max() > 3) == sticks
    for force, other in zip(found, (expected.force, *expected.tangential_force.T[:2]), strict=True):
        assert relative(np.interp(expected.t, result.t, force), other) < 0.02
    assert contact.dissipated_energy(result)[-1] == pytest.approx(expected.dissipated[-1], rel=0.02)
    impulse = found[0].max() * END
    assert abs(item.momentum(result)).max() < 1e-12 * impulse
    if frame == "floating":
        assert abs(item.angular_momentum(result)).max() < 1e-10 * impulse * ARM


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.ModelLimitWarning")
@pytest.mark.parametrize(
    ("frictions", "method", "step", "frame"),
    [((FRICTION, FRICTION), "explicit", None, "floating"), ((FRICTION, None), "implicit", 0.2e-6, "inertial")],
)
def test_the_tip_meets_a_plane_and_the_face(rough, frictions, method, step, frame):
    """Both contacts press the same patch at the same time, on the same nodes; energy balances."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, rough, frame=frame)
    patches, plane = {"slavePatch": "tip", "masterPatch": "face"}, ep.RigidPlane((17e-3, 0, -4e-6), (0, 0, -1))
    own = ep.CreatePartitionContact(mbs, item, item, passes="given", friction=frictions[0], **patches)
    other = ep.CreatePartitionContact(mbs, item, plane, slavePatch="tip", friction=frictions[1])
    mbs.Assemble()
    start = closing(rough) + 0.5 * closing(rough, axis=1)
    mbs.systemData.SetODE2Coordinates_t(item.kinematics.from_basis @ start, exu.ConfigurationType.Initial)
    result = ep.solve_dynamic(mbs, end_time=50e-6, step=step, method=method)
    forces = [contact.force(result) for contact in (own, other)]
    assert min(force.max() for force in forces) > 50.0
    assert np.minimum(*forces).max() > 10.0
    lost = [contact.dissipated_energy(result) for contact in (own, other)]
    energy = sum(each.energy(result) for each in (item, own, other)) + sum(lost)
    assert lost[0][-1] > 1e-3 * energy[0]
    assert (lost[1][-1] > 1e-3 * energy[0]) == (frictions[1] is not None)
    assert abs(energy / energy[0] - 1).max() < 1e-3


def test_friction_turns_with_the_clip(rough):
    """It closes, rubs and opens in a frame that turns by radians as in one at rest, and moves no frame."""
    item, contact = model(rough, "floating", friction=FRICTION)[1:]
    kinematics, n = item.kinematics, rough.n_dofs
    shapes = [kinematics.from_basis @ closing(rough, axis=axis) for axis in (2, 1)]
    ways = [(7e-6, 0), (10e-6, 1e-6), (12e-6, 4e-6), (11e-6, 2e-6), (8e-6, -3e-6), (2e-6, 0)]
    found = []
    for turn in (np.zeros(3), np.array([0.3, -0.5, 0.4])):
        law, forces, states = contact.mechanics.for_run("implicit"), [], set()
        law.gaps.follow()
        for step, (close, shear) in enumerate(ways):
            deformed = kinematics.moved(np.zeros(n), (close * shapes[0] + shear * shapes[1]) / SPEED)
            q = kinematics.moved(deformed, np.r_[3e-3 * step * turn, step * turn, np.zeros(n - 6)])
            law.accept(1e-6 * step)
            on_both = law.at(np.tile(q, 2)).generalised.reshape(2, n)
            on_frame = on_both.sum(axis=0)[:6]
            size = abs(on_both[:, :3]).max()
            assert abs(on_frame[:3]).max() <= 1e-12 * size
            assert abs(on_frame[3:]).max() <= 1e-12 * size * ARM
            forces.append(law.evaluation.on_rows)
            states |= {*law.evaluation.status.tolist()}
        assert states == {OPEN, STICK, SLIP}
        assert not forces[-1].any()
        found.append(np.concatenate(forces))
    assert relative(found[1], found[0]) < 1e-9


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.ModelLimitWarning")
@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_a_patch_that_folds_is_named_twice(clip, meeting, folded, frame):
    """The arms are found in it, whose forces are those of the full FE model; with friction the energy balances."""
    expected, velocity = meeting
    shapes = np.array([folded.displacement(shape).ravel() for shape in np.eye(folded.n_dofs)])
    weighted = clip[0].mass @ shapes.T
    start = np.linalg.solve(shapes @ weighted, weighted.T @ velocity)
    result, _, contact = reduced(folded, start, "explicit", None, frame=frame)
    assert relative(np.interp(expected.t, result.t, contact.force(result)), expected.force) < 0.01
    # The arms shear too.
    aside = shapes.reshape(folded.n_dofs, -1, 3)[:, :, 1]
    tip, face = (patch.nodes for patch in clip[1].patches)
    speed = aside[:, tip].mean(axis=1) - aside[:, face].mean(axis=1)
    first = np.flatnonzero(np.abs(speed) > 0.5 * np.abs(speed).max())[0]
    start[first] += SPEED / speed[first]
    result, item, contact = reduced(folded, start, "implicit", STEP / 2, frame=frame, friction=FRICTION)
    energy, lost = item.energy(result) + contact.energy(result), contact.dissipated_energy(result)
    assert lost[-1] > 0.1 * energy[0]
    assert abs(energy[-1] + lost[-1] - energy[0]) < 5e-4 * energy[0]
    assert abs(item.momentum(result)).max() < 1e-12 * contact.force(result).max() * END
    if frame == "floating":
        expected = full(*clip, folded.displacement(start).ravel(), FRICTION)
        for force, other in (
            (contact.force(result), expected.force),
            (contact.friction.tangential_force(result)[:, 1], expected.tangential_force[:, 1]),
        ):
            assert relative(np.interp(expected.t, result.t, force), other) < 0.02


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.ModelLimitWarning")  # a coarse mesh
@pytest.mark.parametrize(("frame", "axes"), [("inertial", "normal"), ("floating", "normal"), ("floating", "xyz")])
def test_a_clip_on_a_ball_touches_itself(clip, frame, axes):
    """Forces of both contacts are those of one problem for all rows; energy is kept, or lost by friction."""
    fem, friction = clip[0], 0.3 if axes == "xyz" else None
    inside = [(13e-3, -1.6e-3, -MOUTH + 0.1e-3), (19.5e-3, 1.6e-3, 0.1e-3)]
    bottom = -MOUTH - THICK
    foot = ep.Partition.ball(fem, (17e-3, 0, bottom), 1.5e-3, direction=(0, 0, -1), axes=axes, name="foot")
    mouth = ep.Partition.surface(fem, inside, axes=axes, name="mouth")
    body = ep.reduce(fem, mouth | foot, f_cut=100e3)
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, frame=frame, initialVelocity=[0.3, 0.2, -SPEED])
    own = ep.CreatePartitionContact(mbs, item, item, slavePatch="mouth", masterPatch="mouth", friction=friction)
    ball = ep.RigidSphere(center=(TIP[0], 0, bottom - 5e-6 - R), radius=R)
    other = ep.CreatePartitionContact(mbs, item, ball, slavePatch="foot", friction=friction)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=150e-6, step=STEP / 2, method="implicit")
    forces = [contact.force(result) for contact in (own, other)]
    assert min(force.max() for force in forces) > 50.0
    energy = sum(each.energy(result) for each in (item, own, other))
    if friction:
        energy += sum(each.dissipated_energy(result) for each in (own, other))
    assert abs(energy[-1] - energy[0]) < 5e-4 * energy[0]
    if friction:
        return
    # The mouth is closed a little later than the foot, which is pressed on the ball here.
    q = item.coordinates(result)[forces[0].argmax()]
    down = item.kinematics.from_basis @ body.rigid[:, 2]
    q = item.kinematics.moved(q, -(3e-6 + other.mechanics.for_run().gaps.at(q).min()) * down)
    group = own.together.for_run([member.mechanics.for_run() for member in own.group])
    states = [np.concatenate([q] * len(member.sides)) for member in own.group]
    group.forces(states)
    rows = [
        [dense(NormalRows(law.gaps).side_rows(side)) for side in range(len(law.gaps.sides))] for law in group.contacts
    ]
    patches = [[patch for _, patch in member.sides] for member in own.group]
    blocks = [
        [
            sum(left @ body.flexibility(p, r) @ right.T for left, p in zip(a, ps, strict=True)
                for right, r in zip(b, rs, strict=True))
            for b, rs in zip(rows, patches, strict=True)
        ]
        for a, ps in zip(rows, patches, strict=True)
    ]  # fmt: skip
    gaps = [law.gaps.at(state) for law, state in zip(group.contacts, states, strict=True)]
    expected = Complementarity(regularised(np.block(blocks))).solve(np.concatenate(gaps))
    pressed = np.split(expected, [len(gaps[0])])
    assert min(lam.sum() for lam in pressed) > 50.0
    assert relative(np.concatenate([law.evaluation.lam for law in group.contacts]), expected) < 1e-6


def test_the_flexibility_does_not_depend_on_the_number_of_modes(clip, rough):
    """Along the normals and both tangents: what modes leave out is across the mouth too."""
    found = []
    for body in (rough, ep.reduce(clip[0], rough.partition, f_cut=20e3)):
        law = model(body, friction=0.3)[2].mechanics
        every = np.arange(len(law.gaps.row_nodes))
        H = law.rows.jacobian(every)
        H = H.reshape(len(H), 2, -1).sum(axis=1)
        modes = np.linalg.pinv(body.stiffness.toarray(), rcond=1e-8, hermitian=True)
        found.append(H @ modes @ H.T + law.rows.flexibility(every))
    assert relative(*found) < 1e-9


def test_a_patch_that_does_not_fold(clip):
    fem = clip[0]
    lower = ep.Partition.surface(fem, [(13e-3, -1.6e-3, -0.3e-3), (19.5e-3, 1.6e-3, -2e-6)])
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, ep.reduce(fem, lower, f_cut=20e3))
    with pytest.raises(EmptyRegionError, match="has to fold"):
        ep.CreatePartitionContact(mbs, item, item)


def test_what_is_not_supported(body):
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, frame="inertial", referencePosition=[0, 0, 1])
    patches = {"slavePatch": "tip", "masterPatch": "face"}
    with pytest.raises(InputError, match="got patch 0 of one body twice"):
        ep.CreatePartitionContact(mbs, item, item, slavePatch="tip", masterPatch="tip")
    with pytest.raises(InputError, match="touches itself by formulation='compliance' alone"):
        ep.CreatePartitionContact(mbs, item, item, **patches, formulation="penalty")


def test_the_stability_limit_counts_both_ends_on_the_same_coordinates(body):
    """Both arms are moved by the stiffness of one contact; what moves one of them alone would be told from it."""
    mbs, _, contact = model(body)
    n, modes = body.n_dofs, np.diag(body.basis.omega**2)
    by_both = contact.mechanics.closed_stiffness().reshape(2, n, 2, n).sum(axis=2)
    limits = [2 / np.sqrt(np.linalg.eigvals(modes + K).real.max()) for K in (by_both.sum(axis=0), *by_both)]
    assert ep.stability_limit(mbs) == pytest.approx(limits[0], rel=3e-4)
    assert (abs(np.array(limits[1:]) / limits[0] - 1) > 1e-3).all()
