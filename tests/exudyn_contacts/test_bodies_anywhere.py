"""Contact of bodies that are only named: which pairs there are, and that what sleeps changes nothing."""

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
from exudyn.utilities import InertiaCuboid
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.contact.landings import stiffest_landing
from exudyn_partition.contact.patch_contact import PatchContact
from exudyn_partition.contact.side import Side
from exudyn_partition.errors import EmptyRegionError, InputError, PenetrationError, RunError
from exudyn_partition.exudyn_contacts.broad_phase import BroadPhase, motion_bound
from exudyn_partition.exudyn_contacts.contact_pairs import is_skin
from exudyn_partition.exudyn_contacts.model_run import ModelRun

pytestmark = pytest.mark.filterwarnings("ignore::exudyn_partition.errors.PartitionWarning")  # of coarse meshes

SIZE, R, F_CUT = (8e-3, 6e-3, 4e-3), 3e-3, 60e3
STEP = 0.4e-6
FLOOR, WALL = ep.RigidPlane(), ep.RigidPlane((-10e-3, 0, 0), (1, 0, 0))
TURN = Rotation.from_euler("xyz", (20, 15, 10), degrees=True).as_matrix()


@pytest.fixture(scope="module")
def fem():
    return ep.fe_model(occ.Box((0, 0, 0), SIZE), ep.STEEL, maxh=4e-3)


@pytest.fixture(scope="module")
def brick(fem):
    return ep.reduce(fem, skin=True, f_cut=F_CUT)


@pytest.fixture(scope="module")
def pebble():
    return ep.reduce(ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), R), ep.STEEL, maxh=2e-3), skin=True, f_cut=F_CUT)


def put(mbs, body, place, velocity=(0, 0, 0), turn=None, name="", **options):
    return ep.CreatePartitionBody(
        mbs, body, name=name, frame="floating", referencePosition=list(place), initialVelocity=list(velocity),
        referenceRotationMatrix=np.eye(3) if turn is None else turn, **options,
    )  # fmt: skip


def lowest(body, turn):
    return (body.points @ turn.T)[:, 2].min()


def falling(brick, pebble, damping=None, **options):
    """A tilted brick that falls on the floor, a pebble that hits it from above, and another one far away."""
    mbs = exu.SystemContainer().AddSystem()
    low, high = lowest(brick, TURN), (brick.points @ TURN.T)[:, 2].max()
    top = (brick.points @ TURN.T)[(brick.points @ TURN.T)[:, 2].argmax()]
    items = [
        put(mbs, brick, (0, 0, 2e-6 - low), (0.2, 0, -1.0), TURN, name="brick", damping=damping),
        put(mbs, pebble, (top[0], top[1], high - low + R + 10e-6), (0, 0, -3.0), name="near"),
        put(mbs, pebble, (0.05, 0, R + 1e-3), (0, 0, 0), name="far"),
    ]
    contacts = ep.CreatePartitionContact(mbs, [*items, FLOOR, WALL], **options)
    mbs.Assemble()
    return mbs, items, contacts


def run(made, **options):
    mbs, items, contacts = made
    return ep.solve_dynamic(mbs, **{"end_time": 60e-6, "step": STEP} | options), items, contacts


# Which pairs there are.


def test_all_that_may_meet_has_a_contact(brick, pebble):
    _, (brick_item, near, far), contacts = falling(brick, pebble, name="c")
    found = {(frozenset(map(id, (c.slave, c.master))), c.rows == "edges") for c in contacts}
    bodies, edges = [brick_item, near, far], ({brick_item, near}, {brick_item, far})
    pairs = [{a, b} for i, a in enumerate(bodies) for b in bodies[:i]]
    pairs += [{a, surface} for a in bodies for surface in (FLOOR, WALL)]
    known = {(frozenset(map(id, pair)), False) for pair in pairs}
    # A pebble has no sharp edges; the brick is the slave if its facets are not much larger, and has them as rows.
    assert found - {(frozenset(map(id, pair)), True) for pair in edges} == known
    assert {c.name.removesuffix(" edges") for c in contacts} == {f"c {i}" for i in range(1, 10)}
    assert len({id(c.group) for c in contacts}) == 1


def test_edges_of_both_have_rows(brick):
    mbs = exu.SystemContainer().AddSystem()
    items = [put(mbs, brick, (0, 0, 0)), put(mbs, brick, (0, 0, 20e-3))]
    first, edges = ep.CreatePartitionContact(mbs, items)
    assert (first.rows, edges.rows) == ("integrated", "edges")
    assert first.beside == edges
    assert edges.slave == first.master


def test_a_distance_limits_the_pairs(brick, pebble):
    mbs = exu.SystemContainer().AddSystem()
    items = [put(mbs, brick, (0, 0, 1e-3)), put(mbs, pebble, (4e-3, 3e-3, 9e-3)), put(mbs, pebble, (0.05, 0, 9e-3))]
    pairs = ep.CreatePartitionContact(mbs, [*items, FLOOR], within=2e-3)
    assert {frozenset(map(id, (c.slave, c.master))) for c in pairs} == {
        frozenset(map(id, pair)) for pair in ((items[0], items[1]), (items[0], FLOOR))
    }


def test_patches_that_are_no_skins_meet_what_they_face(fem):
    bottom = ep.Partition.surface(fem, plane=((0, 0, 0), (0, 0, -1)), axes="xyz")
    body = ep.reduce(fem, bottom, f_cut=F_CUT)
    assert not is_skin(body, 0)
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, referencePosition=[0, 0, 1e-3])
    (contact,) = ep.CreatePartitionContact(mbs, [item, FLOOR, WALL])
    assert contact.master == FLOOR


def test_a_skin_beside_an_interface_is_one(fem):
    top = ep.Partition.interface(fem, "top", plane=((0, 0, SIZE[2]), (0, 0, 1)))
    body = ep.reduce(fem, top, skin=True, f_cut=F_CUT)
    assert is_skin(body, 0)
    assert body.partition.find_interface("top").name == "top"


def test_what_cannot_be(brick, fem):
    mbs = exu.SystemContainer().AddSystem()
    item, other = put(mbs, brick, (0, 0, 1e-3), name="a"), put(mbs, brick, (0, 0, 3e-3), name="b")
    for wrong, said in (
        ([item], "at least one body and something"),
        ([FLOOR, WALL], "0 bodies and 2 rigid"),
        ([item, item], "each of them once"),
        ([item, "floor"], "got str at index 1"),
    ):
        with pytest.raises(InputError, match=said):
            ep.CreatePartitionContact(mbs, wrong)
    with pytest.raises(PenetrationError, match="start inside"):
        ep.CreatePartitionContact(mbs, [item, other])
    with pytest.raises(InputError, match="compliance"):
        ep.CreatePartitionContact(mbs, [item, FLOOR], formulation="penalty")
    with pytest.raises(InputError, match="press fit"):
        ep.CreatePartitionContact(mbs, [item, FLOOR], interference=1e-6)
    with pytest.raises(InputError, match="skin=True"):
        ep.reduce(fem, f_cut=F_CUT)
    with pytest.raises(EmptyRegionError, match="within="):
        ep.CreatePartitionContact(mbs, [item, ep.RigidPlane((0, 0, -1))], within=1e-3)


# What sleeps.


def test_momentum_and_energy(brick, pebble):
    result, items, contacts = run(falling(brick, pebble))
    hit = {c.name or i for i, c in enumerate(contacts) if c.force(result).max() > 0}
    assert len(hit) >= 2
    gained = sum(item.momentum(result)[-1] - item.momentum(result)[0] for item in items)
    outside = [c for c in contacts if c.master in (FLOOR, WALL)]
    forces = sum(c.force_on_slave(result) for c in outside)
    impulse = np.sum((forces[1:] + forces[:-1]) / 2 * np.diff(result.t)[:, None], axis=0)
    np.testing.assert_allclose(gained, impulse, rtol=0, atol=1e-5 * np.linalg.norm(impulse))
    energy = sum(item.energy(result) for item in items) + sum(c.energy(result) for c in contacts)
    np.testing.assert_allclose(energy, energy[0], rtol=2e-3)


@pytest.mark.parametrize(("friction", "method"), [(None, "explicit"), (0.3, "explicit"), (0.3, "implicit")])
def test_forces_are_those_without_a_broad_phase(brick, pebble, friction, method, monkeypatch):
    options = {"method": method, "step": STEP if method == "explicit" else 1e-6}
    result, _, contacts = run(falling(brick, pebble, friction=friction), **options)
    monkeypatch.setattr(BroadPhase, "look", lambda phase, q: phase.awake)
    whole, _, all_awake = run(falling(brick, pebble, friction=friction), **options)
    force, known = (np.array([c.force(r) for c in cs]) for r, cs in ((result, contacts), (whole, all_awake)))
    assert known.max() > 100.0
    np.testing.assert_allclose(force, known, rtol=0, atol=1e-9 * known.max())


def test_contacts_that_slept_have_the_pairs_of_those_that_did_not(brick, pebble, monkeypatch):
    """Between a ball and coarse facets, forces depend on the pose in which all points were searched."""
    found = []
    for sleeps in (True, False):
        if not sleeps:
            monkeypatch.setattr(BroadPhase, "look", lambda phase, q: phase.awake)
        mbs = exu.SystemContainer().AddSystem()
        items = [
            put(mbs, brick, (0, 0, 1e-9), (0, 0, -0.2), gravity=[0, 0, -1e5]),
            put(mbs, pebble, (3e-3, 2e-3, SIZE[2] + R + 1.5e-3), (2.0, 0, -40.0),
                initialAngularVelocity=[300, 500, 0]),
        ]  # fmt: skip
        contacts = ep.CreatePartitionContact(mbs, [*items, FLOOR])
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=60e-6, step=STEP / 2)
        found.append(np.array([contact.force(result) for contact in contacts]))
    assert found[0].max(axis=1)[:2].min() > 1e4
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=1e-9 * found[1].max())


def test_viscous_flexibilities_sleep_when_they_are_at_rest(brick, pebble, monkeypatch):
    """A row that was closed yields for a while; its energy counts also while others sleep."""
    options = {"damping": ep.Rayleigh(0.0, 2e-7), "friction": 0.3}
    found = []
    for sleeps in (True, False):
        if not sleeps:
            monkeypatch.setattr(BroadPhase, "look", lambda phase, q: phase.awake)
        result, _, contacts = run(falling(brick, pebble, **options), step=STEP / 4, end_time=24e-6)
        found.append([sum(c.force(result) for c in contacts), sum(c.dissipated_energy(result) for c in contacts)])
    (force, taken), (known_force, known_taken) = found
    np.testing.assert_allclose(force, known_force, rtol=0, atol=5e-3 * known_force.max())
    np.testing.assert_allclose(taken, known_taken, rtol=0, atol=5e-3 * known_taken.max())
    assert known_taken.max() > 0.0


@pytest.mark.parametrize("adaptive", [False, True])
def test_nobody_evaluates_what_sleeps(brick, pebble, adaptive, monkeypatch):
    asked, gap_at, closing = [], PatchContact.gap_at, PatchContact.closing
    monkeypatch.setattr(PatchContact, "gap_at", lambda contact, q: asked.append(contact.gaps) or gap_at(contact, q))
    monkeypatch.setattr(
        PatchContact, "closing", lambda contact, *motion: asked.append(contact.gaps) or closing(contact, *motion)
    )
    result, (_, _, far), contacts = run(falling(brick, pebble, friction=0.3), adaptive=adaptive)
    sleeping = [c for c in contacts if far in (c.slave, c.master)]
    assert 0 < len({id(gaps) for gaps in asked}) <= len(contacts) - len(sleeping)
    assert len(asked) < 4 * len(result.t)  # of nine contacts and more
    for contact in sleeping:
        assert not contact.force(result).any()
        assert contact.friction.work(result)[-1] == 0.0


def test_long_steps_end_before_what_sleeps_wakes(pebble):
    """In free flight steps are many times as long as in an impact, and no contact is asked where it will touch."""
    peaks = []
    for adaptive in (False, True):
        mbs = exu.SystemContainer().AddSystem()
        items = [put(mbs, pebble, (0, 0, 3 * R), (0, 0, -10.0)), put(mbs, pebble, (5 * R, 0, 2 * R), (-10.0, 0, -10.0))]
        contacts = ep.CreatePartitionContact(mbs, [*items, FLOOR])
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=1.1e-3, step=STEP, method="implicit", adaptive=adaptive)
        peaks.append([contact.force(result).max() for contact in contacts])
    assert len(result.t) < 0.5 * 1.1e-3 / STEP
    assert np.count_nonzero(peaks[0]) == 3
    np.testing.assert_allclose(peaks[1][1:], peaks[0][1:], rtol=5e-3)
    np.testing.assert_allclose(peaks[1][0], peaks[0][0], rtol=2e-2)  # they meet after the first has hit the floor


def test_what_sleeps_wakes(pebble):
    """A pebble that begins far above the floor bounces from it as one that begins near it."""
    forces = []
    for height in (2e-6, 2e-6 + 3e-3):
        mbs = exu.SystemContainer().AddSystem()
        items = [put(mbs, pebble, (0, 0, R + height), (0, 0, -10.0)), put(mbs, pebble, (0.02, 0, R + 1e-3))]
        contacts = ep.CreatePartitionContact(mbs, [*items, FLOOR])
        mbs.Assemble()
        (floor,) = (c for c in contacts if c.slave == items[0] and c.master == FLOOR)
        later = round(height / 10.0 / STEP)  # 750 steps
        result = ep.solve_dynamic(mbs, end_time=(later + 75) * STEP, step=STEP)
        assert not floor.force(result)[:later].any()
        forces.append(floor.force(result)[later:])
    assert forces[0].max() > 100.0
    np.testing.assert_allclose(forces[1], forces[0], rtol=0, atol=1e-3 * forces[0].max())


@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_no_node_moves_farther_than_its_bound(brick, frame, mbs):
    item = ep.CreatePartitionBody(mbs, brick, frame=frame)
    side, rng = Side.of(item.kinematics), np.random.default_rng(1)
    weights = motion_bound(side)
    scale = np.r_[np.full(3, 1e-3), np.full(3, 0.5), np.full(side.n - 6, 1e-8)] if frame == "floating" else 1e-6
    for _ in range(20):
        one, other = scale * rng.standard_normal((2, side.n))
        way = np.linalg.norm(side.place(one) - side.place(other), axis=1).max()
        assert 0.0 < way <= weights @ abs(one - other)


def test_a_run_goes_on(brick, pebble, tmp_path):
    """Contacts that sleep have a state, too."""
    whole, _, contacts = run(falling(brick, pebble, friction=0.3), end_time=40e-6)
    first, *_ = run(falling(brick, pebble, friction=0.3), end_time=20e-6)
    first.save(tmp_path / "first.npz")
    made = falling(brick, pebble, friction=0.3)
    again, _, others = run(made, end_time=40e-6, go_on=ep.Result.load(tmp_path / "first.npz", made[0]))
    known = np.array([c.force(whole) for c in contacts])
    found = np.array([c.force(again) for c in others])
    np.testing.assert_allclose(found, known[:, -found.shape[1] :], rtol=0, atol=1e-6 * known.max())


def test_a_step_that_fails_leaves_no_trace(brick, pebble, monkeypatch):
    """Forces are found again where it began, also of contacts that remember, while others sleep."""
    whole, _, contacts = run(falling(brick, pebble, friction=0.3), end_time=12e-6)
    made, force = falling(brick, pebble, friction=0.3), ModelRun.force

    def fails(model, mbs, t):
        found = force(model, mbs, t)
        if t > 8e-6:
            raise RunError("the step fails")
        return found

    with monkeypatch.context() as patch:
        patch.setattr(ModelRun, "force", fails)
        first, *_ = run(made, end_time=12e-6)
    assert first.status == "unstable"
    again, _, others = run(made, end_time=12e-6, go_on=True)
    known, stopped, found = (
        np.array([c.force(result) for c in some])
        for result, some in ((whole, contacts), (first, others), (again, others))
    )
    assert known[:, stopped.shape[1] - 1].max() > 100.0
    np.testing.assert_allclose(found, known[:, -found.shape[1] :], rtol=0, atol=1e-9 * known.max())


# The step.


@pytest.mark.parametrize("sticks", [False, True])
def test_few_nodes_tell_how_stiff_a_landing_is(brick, sticks):
    """All nodes of each face, held at once, by the full flexibility."""
    nodes = brick.partition.patches[0].nodes
    scale, F, stiffest = 1 / np.sqrt(brick.mass.diagonal()), np.asarray(brick.flexibility()), 0.0
    rows = brick.shape_rows(nodes)
    for axis in range(3):
        for end in (0.0, SIZE[axis]):
            on = np.flatnonzero(abs(brick.points[nodes, axis] - end) < 1e-9)
            dofs = (3 * on[:, None] + np.arange(3)).ravel() if sticks else 3 * on + axis
            K = brick.stiffness.toarray() + rows[dofs].T @ np.linalg.solve(F[np.ix_(dofs, dofs)], rows[dofs])
            stiffest = max(stiffest, np.linalg.eigvalsh(scale[:, None] * K * scale)[-1])
    assert 0.9 * stiffest < stiffest_landing(brick, 0, sticks=sticks) <= 1.01 * stiffest


def test_the_limit_is_that_of_a_flat_landing(brick, pebble, mbs):
    """A brick that lies flat on the floor under a large weight: a step a little below the limit is stable."""
    gravity = 1e5
    item = put(mbs, brick, (0, 0, 1e-9), gravity=[0, 0, -gravity])
    contacts = ep.CreatePartitionContact(mbs, [item, FLOOR, put(mbs, pebble, (0.05, 0, R))])
    (floor,) = (c for c in contacts if c.slave == item and c.master == FLOOR)
    mbs.Assemble()
    limit = ep.stability_limit(mbs)
    result = ep.solve_dynamic(mbs, end_time=400 * limit, step=0.95 * limit)
    assert result.status == "finished"
    assert floor.closed_rows(result).max() >= 7
    weight = brick.total_mass * gravity
    np.testing.assert_allclose(floor.force(result)[100:].mean(), weight, rtol=0.05)
    with pytest.raises(ep.errors.StepSizeError):
        ep.solve_dynamic(mbs, end_time=60 * limit, step=1.05 * limit)


@pytest.mark.parametrize("friction", [None, 0.3])
def test_the_limit_is_the_same_for_contacts_by_two_names(brick, friction):
    limits = []
    for by_list in (True, False):
        mbs = exu.SystemContainer().AddSystem()
        item = put(mbs, brick, (0, 0, 20e-3), turn=TURN)
        ep.CreatePartitionContact(mbs, *([[item, FLOOR]] if by_list else [item, ep.RigidPlane((0, 0, -0.02))]),
                                  friction=friction)  # fmt: skip
        mbs.Assemble()
        limits.append(ep.stability_limit(mbs))
    assert limits[0] == limits[1]


def test_a_single_body_and_its_floor(brick, mbs):
    item = put(mbs, brick, (0, 0, 1e-6), (0, 0, -1.0))
    (contact,) = ep.CreatePartitionContact(mbs, [item, FLOOR])
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=20e-6)
    assert contact.force(result).max() > 0.0


def test_contacts_of_a_list_are_named_by_their_bodies(brick, pebble, mbs):
    """Two skins with sharp edges have two contacts, and the name of one says that it is of the edges."""
    items = [put(mbs, brick, (0, 0, 0.1 * i), name=name) for i, name in enumerate(("low", "high"), 1)]
    contacts = ep.CreatePartitionContact(mbs, [*items, put(mbs, pebble, (0.05, 0, R)), FLOOR])
    names = [contact.name for contact in contacts]
    assert len({*names}) == len(names)
    assert {"low on high", "low on high edges", "low on body 2", "low on plane", "body 2 on plane"} <= {*names}


# Surfaces that a body of another kind carries.


def struck(pebble, named):
    """A pebble at rest that a fast rigid plane reaches after 20 us, by a list or by two names; contact and result."""
    mbs = exu.SystemContainer().AddSystem()
    item = put(mbs, pebble, (0, 0, 0))
    motion = {"referencePosition": [0, 0, R + 0.2e-3], "initialVelocity": [0, 0, -10.0]}
    motion["nodeType"] = exu.NodeType.RotationRotationVector
    carrier = mbs.CreateRigidBody(inertia=InertiaCuboid(7800, [0.05] * 3), **motion)
    face = ep.RigidPlane(normal=(0, 0, -1))  # in the axes of the carrier
    if named:
        contact = ep.CreatePartitionContact(mbs, item, face, masterBody=carrier)
    else:
        (contact,) = ep.CreatePartitionContact(mbs, [item, (face, carrier)])
    mbs.Assemble()
    return contact, ep.solve_dynamic(mbs, end_time=40e-6, step=STEP)


def test_a_carried_surface_may_be_in_a_list(pebble):
    """It reaches a skin that does not move itself, and never sleeps."""
    (contact, result), (by_name, same) = struck(pebble, False), struck(pebble, True)
    assert contact.force(result).max() > 1000.0
    np.testing.assert_allclose(contact.force(result), by_name.force(same), rtol=1e-12)


@pytest.mark.parametrize(("height", "meets"), [(0.0, True), (-0.05, False)])
def test_a_carried_surface_is_near_where_its_body_is(fem, mbs, height, meets):
    """Patches that are no skins meet what is near; the surface itself passes through the origin of its body."""
    body = ep.reduce(fem, ep.Partition.surface(fem, plane=((0, 0, 0), (0, 0, -1)), axes="xyz"), f_cut=F_CUT)
    item = ep.CreatePartitionBody(mbs, body, referencePosition=[0, 0, 1e-3])
    turned = Rotation.from_euler("x", 90, degrees=True).as_matrix()
    carrier = mbs.CreateRigidBody(
        inertia=InertiaCuboid(7800, [0.05] * 3), referencePosition=[0, 0, height], referenceRotationMatrix=turned
    )
    members = [item, (ep.RigidPlane(normal=(0, 1, 0)), carrier)]  # upwards, as the carrier is turned
    if meets:
        assert len(ep.CreatePartitionContact(mbs, members)) == 1
    else:
        with pytest.raises(EmptyRegionError, match="no two patches"):
            ep.CreatePartitionContact(mbs, members)


def test_what_cannot_be_carried(pebble, mbs):
    item = put(mbs, pebble, (0, 0, 0))
    ground = mbs.CreateGround()
    for members, expected in (
        ([item, (FLOOR, 99)], "body of index 1: expected the number of a body of this model"),
        ([item, (FLOOR, None)], "body of index 1: expected the number of a body"),
        ([item, (item, ground)], r"a pair in the list, \(surface, body\), got tuple at index 1"),
        ([item, FLOOR, (FLOOR, ground)], "each of them once, got 1 bodies and 2 rigid surfaces"),
    ):
        with pytest.raises(InputError, match=expected):
            ep.CreatePartitionContact(mbs, members)
    with pytest.raises(InputError, match=r"a pair in the sequence, \(surface, body\)"):
        ep.CreatePartitionContact(mbs, [item, FLOOR], masterBody=ground)
