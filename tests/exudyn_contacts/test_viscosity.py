"""Contacts of bodies with stiffness-proportional damping: the flexibility of the contact yields with the same time."""

import math

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
import scipy.optimize
from oracles import (
    MARBLE_RADIUS,
    SPHERE_MATERIAL,
    SPHERE_RADIUS,
    add_force,
    add_springs,
    relative,
    small_zone,
)

import exudyn_partition as ep
from exudyn_partition.algebra.products import dense
from exudyn_partition.contact.normal_rows import NormalRows
from exudyn_partition.errors import ModelLimitWarning

SPEED = 0.3
PLANE = ep.Material(E=1e19, nu=0.3, rho=1e4)
IMPACT = ep.hertz.impact(
    4 / 3 * math.pi * SPHERE_RADIUS**3 * ep.STEEL.rho, SPEED, SPHERE_RADIUS, math.inf, ep.STEEL, PLANE
)
T = IMPACT.duration


def kuwabara_kono(beta, mass, radius=SPHERE_RADIUS, speed=SPEED, parts=1, material=ep.STEEL):
    """Restitution of a ball of Kelvin-Voigt's material by F = k (d^1.5 + 1.5 beta d^0.5 d'), never pulling.

    On a rigid plane, or with parts = 2 against an equal body that is as stiff, with the mean of both times beta.
    """
    k = 4 / 3 * material.E / (1 - material.nu**2) / parts * math.sqrt(radius)

    def rates(t, y):
        depth, rate = max(y[0], 0.0), y[1]
        return [rate, -max(k * (depth**1.5 + 1.5 * beta * math.sqrt(depth) * rate), 0.0) / mass]

    def leaves(t, y):
        return y[0] - 1e-14

    leaves.terminal, leaves.direction = True, -1
    found = scipy.integrate.solve_ivp(
        rates, (0, 1e-3), [1e-13, speed], rtol=1e-9, atol=1e-16, max_step=1e-6, events=leaves
    )
    return -found.y[1, -1] / speed


def impact(body, beta, *, frame="inertial", method="explicit", friction=None, along=0.0, mbs=None, **options):
    """A ball with this damping hits a rigid plane."""
    mbs = mbs or exu.SystemContainer().AddSystem()
    damping = None if beta is None else ep.Rayleigh(0.0, beta)
    start = {"referencePosition": [0, 0, 1e-7], "initialVelocity": [along, 0, -SPEED]}
    item = ep.CreatePartitionBody(mbs, body, damping=damping, frame=frame, **start)
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), friction=friction)
    mbs.Assemble()
    options = {"end_time": 1.4 * T, "step": T / 300, **options}
    return mbs, item, contact, ep.solve_dynamic(mbs, method=method, **options)


def balance(items, contacts, result):
    """Largest change of all energy plus what was taken, relative."""
    total = sum(each.energy(result) + each.dissipated_energy(result) for each in (*items, *contacts))
    return abs(total / total[0] - 1).max()


@pytest.mark.parametrize("method", ["explicit", "implicit"])
@pytest.mark.parametrize("friction", [None, 0.2])
def test_a_ball_rebounds_by_the_law_of_kuwabara_and_kono(round_body, method, friction):
    beta = T / 50
    expected = kuwabara_kono(beta, round_body.total_mass)
    assert expected < 0.91
    _, item, contact, result = impact(round_body, beta, method=method, friction=friction)
    found = item.momentum(result)[-1, 2] / round_body.total_mass / SPEED
    assert found == pytest.approx(expected, abs=6e-3)
    assert balance([item], [contact], result) < 5e-4
    lost = 1 - item.energy(result)[-1] / item.energy(result)[0]
    assert contact.dissipated_energy(result)[-1] > 0.9 * lost * item.energy(result)[0]


def test_a_floating_frame_is_no_other(round_body):
    runs = [impact(round_body, T / 50, frame=frame, friction=0.1, along=0.2) for frame in ("inertial", "floating")]
    forces = [contact.force(result) for _, _, contact, result in runs]
    assert relative(forces[0], forces[1]) < 1e-3
    for _, item, contact, result in runs:
        assert balance([item], [contact], result) < 5e-4


def test_longer_steps_lose_little_and_the_error_is_of_first_order(round_body):
    ends = []
    for steps in (100, 200, 400):
        _, item, _, result = impact(round_body, T / 50, method="implicit", step=T / steps, spectral_radius=1.0)
        ends.append(item.momentum(result)[-1, 2])
    assert abs(ends[1] - ends[0]) < 3e-3 * ends[2]
    assert 1.5 < (ends[1] - ends[0]) / (ends[2] - ends[1]) < 3.0


def test_without_stiffness_damping_nothing_changes(round_body):
    """Damping by the mass does not act on a static answer: no memory, and the same compiled way."""
    forces = []
    for damping in (None, ep.Rayleigh(1e-9, 0.0)):
        mbs = exu.SystemContainer().AddSystem()
        item = ep.CreatePartitionBody(mbs, round_body, damping=damping, initialVelocity=[0, 0, -SPEED])
        contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane())
        mbs.Assemble()
        assert contact.elastic
        result = ep.solve_dynamic(mbs, end_time=T, step=T / 200)
        forces.append(contact.force(result))
    assert relative(*forces) < 1e-9


def pair(round_body, flat_body, betas, friction=None):
    """A ball on a plate, each with its own damping, assembled."""
    mbs = exu.SystemContainer().AddSystem()
    items = [
        ep.CreatePartitionBody(mbs, body, damping=ep.Rayleigh(0.0, beta), referencePosition=[0, 0, height])
        for body, beta, height in zip((round_body, flat_body), betas, (0.0, 0.0), strict=True)
    ]
    contact = ep.CreatePartitionContact(mbs, *items, friction=friction)
    mbs.Assemble()
    return mbs, items, contact


@pytest.mark.parametrize("betas", [(2e-6, 2e-6), (2e-6, 0.0), (0.5e-6, 2e-6)])
def test_forces_are_those_of_two_fields_of_displacements(round_body, flat_body, betas):
    """By brute force: each side has displacements u of its nodes with u + beta u' = F G' lambda."""
    _, items, contact = pair(round_body, flat_body, betas)
    mechanics = contact.mechanics.for_run("explicit")
    slave = [item for item, _ in contact.sides].index(items[0])
    n = [item.body.n_dofs for item, _ in contact.sides]
    F = [item.body.flexibility() for item, _ in contact.sides]
    rows = [np.asarray(mechanics.rows.side_rows(side) @ np.eye(len(F[side]))) for side in (0, 1)]
    times = [item.beta for item, _ in contact.sides]
    u, t, taken, work, last = [np.zeros(len(part)) for part in F], 0.0, 0.0, 0.0, None
    for step, depth in [(0.4e-6, 1e-6), (0.4e-6, 3e-6), (0.8e-6, 3e-6), (0.2e-6, 2.8e-6), (0.3e-6, 2e-6),
                        (0.3e-6, -1e-6), (0.5e-6, 1e-6)]:  # fmt: skip
        q = [-depth * items[0].body.rigid[:, 2] if side == slave else np.zeros(n[side]) for side in (0, 1)]
        mechanics.accept(t, t + 2 * step)  # a longer step is tried first
        t += step
        mechanics.at(np.concatenate(q))
        mechanics.begin(end=t)
        mechanics.at(np.concatenate(q))
        shares = [step / (step + beta) for beta in times]
        parts = [*zip(rows, F, u, shares, strict=True)]
        h = mechanics.gaps.at(np.concatenate(q)) + sum((1 - share) * G @ own for G, _, own, share in parts)
        whole = sum(share * G @ flexible @ G.T for G, flexible, _, share in parts)
        L = np.linalg.cholesky(whole)
        lam = scipy.optimize.nnls(L.T, -np.linalg.solve(L, h), maxiter=10000)[0]
        np.testing.assert_allclose(mechanics.evaluation.lam, lam, atol=1e-5 * max(lam.max(), 1e-6 * depth))
        before, u = u, [share * flexible @ (G.T @ lam) + (1 - share) * own for G, flexible, own, share in parts]
        last = np.zeros(len(lam)) if last is None else last
        work += sum(0.5 * (lam + last) @ G @ (now - then) for G, now, then in zip(rows, u, before, strict=True))
        stored = sum(0.5 * own @ np.linalg.lstsq(flexible, own)[0] for own, flexible in zip(u, F, strict=True))
        taken, last = work - stored, lam
        assert mechanics.evaluation.viscous_work + mechanics.evaluation.stored == pytest.approx(work, rel=1e-5)
        if lam.any():
            assert mechanics.evaluation.stored == pytest.approx(stored, rel=1e-3)
            K = mechanics.evaluation.row_stiffness()
            some = mechanics.evaluation.index
            np.testing.assert_allclose(K @ whole[np.ix_(some, some)], np.eye(len(some)), atol=1e-5)
    assert taken > 0.1 * stored


def test_of_two_bodies_the_mean_of_their_times_counts(sphere, other_sphere, reduced_sphere, kept):
    """Two equal balls: what both lose follows from the mean of the times, if these are short."""
    both, steel = (ep.reduce(*other_sphere, f_cut=200e3, cache=kept), reduced_sphere), SPHERE_MATERIAL
    mass, found = reduced_sphere.total_mass, []
    short = ep.hertz.impact(mass / 2, SPEED, SPHERE_RADIUS, SPHERE_RADIUS, steel, steel).duration / 200
    for betas in ((short, short), (2 * short, 0.0), (0.0, 2 * short)):
        mbs = exu.SystemContainer().AddSystem()
        items = [
            ep.CreatePartitionBody(
                mbs, body, damping=ep.Rayleigh(0.0, beta), referencePosition=[0, 0, sign * 1e-8],
                initialVelocity=[0, 0, -sign * SPEED / 2],
            )
            for body, beta, sign in zip(both, betas, (-1, 1), strict=True)
        ]  # fmt: skip
        contact = ep.CreatePartitionContact(mbs, *items)
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=250 * short, step=short / 2)
        apart = items[1].momentum(result)[-1, 2] - items[0].momentum(result)[-1, 2]
        found.append(apart / mass / SPEED)
        assert balance(items, [contact], result) < 3e-4
    assert found[0] == pytest.approx((found[1] + found[2]) / 2, abs=6e-4)  # which decreases with the squared time
    assert found[0] == pytest.approx(
        kuwabara_kono(short, mass / 2, SPHERE_RADIUS / 2, parts=2, material=steel), abs=2e-3
    )


def test_the_limit_of_explicit_steps_has_viscous_forces_half_a_step_late(round_body):
    beta = T / 30
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, round_body, damping=ep.Rayleigh(0.0, beta))
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane())
    mbs.Assemble()
    h = ep.stability_limit(mbs)
    gaps = contact.mechanics.gaps
    H, F = dense(gaps.jacobian(np.arange(len(gaps.row_nodes)))), NormalRows(gaps).problem().F
    H = H @ item.kinematics.from_basis
    K = item.body.stiffness + (1 + 2 * beta / h) * (H.T @ np.linalg.solve(F, H))
    square = scipy.linalg.eigh(K, dense(item.body.mass), eigvals_only=True)[-1]
    rate = (beta * round_body.basis.omega**2).max()
    assert h**2 * square + 2 * h * rate == pytest.approx(4, rel=0.03)


@pytest.mark.filterwarnings("ignore:.*the facets do not resolve")  # a few rows are closed
@pytest.mark.parametrize("friction", [None, 0.3])
def test_a_run_in_two_parts_is_one_run(round_body, friction, tmp_path):
    options = {"friction": friction, "along": 0.1, "step": T / 200}
    _, _, contact, whole = impact(round_body, T / 30, **options)
    mbs, *_ = impact(round_body, T / 30, end_time=0.7 * T, **options)
    then = ep.solve_dynamic(mbs, end_time=1.4 * T, go_on=True)
    part = then.contacts[0]
    late = whole.t > 0.7 * T * (1 + 1e-9)
    assert relative(contact.force(whole)[late], part.force(then)[1:]) < 1e-9
    assert relative(contact.dissipated_energy(whole)[late], part.dissipated_energy(then)[1:]) < 1e-9
    then.save(tmp_path / "run.npz")
    again = ep.Result.load(tmp_path / "run.npz")
    assert (again.contacts[0].dissipated_energy(again) == part.dissipated_energy(then)).all()
    assert (again.contacts[0].energy(again) == part.energy(then)).all()


@pytest.mark.filterwarnings("ignore:.*contact.* at t")  # a few rows are closed
def test_a_preload_is_at_rest(round_body, flat_body):
    """Statics know no rate. A dynamic run that begins with their answer stays there, by either method."""
    forces = []
    for betas in ((0.0, 0.0), (1e-6, 2e-6)):
        mbs, items, contact = pair(round_body, flat_body, betas, friction=0.3)
        for item, load in zip(items, (-50.0, 50.0), strict=True):
            add_springs(mbs, item, 1e9)
            add_force(mbs, item, [0.1 * load, 0, load])
        mbs.Assemble()
        forces.append(contact.force(ep.solve_static(mbs))[-1])
    assert forces[0] == pytest.approx(forces[1], rel=1e-7)
    for method, end in (("implicit", 10e-6), ("explicit", 20e-6)):
        result = ep.solve_dynamic(mbs, end_time=end, step=0.1e-6, method=method, go_on=True)
        np.testing.assert_allclose(contact.force(result), forces[1], rtol=2e-4)
        assert contact.dissipated_energy(result)[-1] < 1e-6 * contact.energy(result)[-1]


def test_steps_that_change_their_length(round_body):
    """A tolerance makes steps long and short; a repeated step begins from the last accepted one."""
    beta = T / 50
    found = {}
    for adaptive in (False, True):
        mbs = exu.SystemContainer().AddSystem()
        start = {"referencePosition": [0, 0, 0.3e-6], "initialVelocity": [0, 0, -SPEED]}
        item = ep.CreatePartitionBody(mbs, round_body, damping=ep.Rayleigh(0.0, beta), **start)
        contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane())
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=1.5 * T, step=T / 200, method="implicit", adaptive=adaptive)
        found[adaptive] = item.momentum(result)[-1, 2]
        assert balance([item], [contact], result) < 1e-3
    assert found[True] == pytest.approx(found[False], rel=2e-3)


MU = 0.3


def side_by_side(plate, marble, patches, betas, friction):
    """Two marbles hit a plate at once, at two patches or places of one, with damping of plate and marbles."""
    mbs = exu.SystemContainer().AddSystem()
    target = ep.CreatePartitionBody(mbs, plate, damping=ep.Rayleigh(0.0, betas[0]))
    marbles, contacts = [], []
    for side, patch, speed in zip((-1, 1), patches, (0.3, 0.2), strict=True):
        place = {"referencePosition": [side * 0.85e-3, 0, MARBLE_RADIUS + 1e-8], "initialVelocity": [0, 0, -speed]}
        marbles.append(ep.CreatePartitionBody(mbs, marble, damping=ep.Rayleigh(0.0, betas[1]), **place))
        named = {"slavePatch": "south", "masterPatch": patch, "friction": friction}
        contacts.append(ep.CreatePartitionContact(mbs, marbles[-1], target, **named))
    mbs.Assemble()
    return mbs, [target, *marbles], contacts


@pytest.fixture(scope="module")
def plate_of(kept):
    """A thick plate with one patch on its top, or two."""
    shape = occ.Box(occ.Pnt(-8e-3, -6e-3, -5e-3), occ.Pnt(8e-3, 6e-3, 0))
    places = [(-0.85e-3, 0, 0), (0.85e-3, 0, 0)]
    fem = ep.fe_model(shape, ep.STEEL, maxh=4e-3, refine=[ep.Refine(p, 0.6e-3, 0.2e-3) for p in places], grading=0.6)
    one = ep.Partition.ball(fem, (0, 0, 0), 1.6e-3, name="top", axes="xyz")
    two = [
        ep.Partition.ball(fem, p, 0.6e-3, name=n, axes="xyz") for p, n in zip(places, ("left", "right"), strict=True)
    ]
    parts = {"shared": one, "apart": two[0] | two[1]}
    return lambda kind: ep.reduce(fem, parts[kind], f_cut=150e3, cache=kept)


@pytest.fixture(scope="module")
def rough_marble(marble_parts, kept):
    """The marble with a south pole that has friction."""
    south = ep.Partition.ball(marble_parts[0], (0, 0, -MARBLE_RADIUS), 0.5e-3, name="south", axes="xyz")
    return ep.reduce(marble_parts[0], south, f_cut=300e3, cache=kept)


@pytest.mark.parametrize(("friction", "method"), [(None, "explicit"), (MU, "explicit"), (None, "implicit")])
@pytest.mark.filterwarnings("ignore:.*contact.* at t")  # a few rows are closed
def test_contacts_on_one_body_move_each_other_with_its_time(plate_of, rough_marble, friction, method):
    """All of the energy is known, and a shared patch gives the same as a patch for each contact."""
    forces = []
    for kind, patches in (("shared", ["top", "top"]), ("apart", ["left", "right"])):
        mbs, items, contacts = side_by_side(plate_of(kind), rough_marble, patches, (1e-6, 0.3e-6), friction)
        result = ep.solve_dynamic(mbs, end_time=16e-6, step=0.2e-6, method=method)
        taken = sum(contact.dissipated_energy(result) for contact in contacts)
        assert taken[-1] > 0.05 * items[1].energy(result)[0]
        assert balance(items, contacts, result) < 3e-4
        forces.append(contacts[0].force(result))
    assert relative(*forces) < 1e-3


def test_what_has_no_time_is_told(round_body, flat_body):
    """A ratio has no time for a static answer, and a layer is not damped: that warns where it matters."""
    mbs, _, contact = pair(round_body, flat_body, (1e-6, 1e-6))
    assert not any("damping" in said for said in contact.left_out)
    item = ep.CreatePartitionBody(mbs, round_body, damping=0.02)
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane((0, 0, -1.0)))
    assert contact.elastic
    assert any("damping of the contact's flexibility" in said for said in contact.left_out)


@pytest.mark.filterwarnings("ignore:.*contact.* at t")
def test_a_layer_without_the_damping_of_its_bodies_warns(round_body):
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, round_body, damping=ep.Rayleigh(0.0, 1e-6), initialVelocity=[0, 0, -SPEED])
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), formulation="penalty")
    mbs.Assemble()
    assert any("damping of the contact's layer" in said for said in contact.left_out)
    with pytest.warns(ModelLimitWarning, match="has no damping, though its bodies have one"):
        ep.solve_dynamic(mbs, end_time=T, step=T / 200)


@pytest.fixture(scope="module")
def dents_of(kept):
    """A soft plate with two plastic zones in its top, 2.4 mm apart, with patches in one direction or in three."""
    soft = ep.Material(E=70e9, nu=0.33, rho=2700.0, yield_stress=200e6, hardening=500e6)
    shape = occ.Box(occ.Pnt(-6e-3, -6e-3, -3e-3), occ.Pnt(6e-3, 6e-3, 0))
    places = {"left": (-1.2e-3, 0, 0), "right": (1.2e-3, 0, 0)}
    fem = ep.fe_model(shape, soft, maxh=4e-3, refine=[ep.Refine(p, 0.4e-3, 0.2e-3) for p in places.values()])

    def reduced(friction):
        ways = {"direction": (0, 0, 1)} if friction is None else {"axes": "xyz"}
        left, right = (ep.Partition.ball(fem, p, 0.5e-3, name=name, **ways) for name, p in places.items())
        return ep.reduce(fem, left | right, f_cut=150e3, cache=kept)

    return reduced


@pytest.mark.parametrize(
    ("friction", "sides", "beta", "method"),
    [
        (None, (-1,), 0.6e-6, "implicit"),
        (None, (-1, 1), 0.0, "explicit"),
        (None, (-1, 1), 0.6e-6, "explicit"),
        (None, (-1, 1), 0.6e-6, "implicit"),
        (0.2, (-1, 1), 0.6e-6, "explicit"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*contact")  # a few rows are closed, and few elements flow
@pytest.mark.filterwarnings("ignore:contact")
def test_a_plate_that_yields_knows_all_of_its_energy(dents_of, friction, sides, beta, method):
    """A plate hits one or two rigid balls: plastic flow, friction and viscosity take what is missing."""
    mbs = exu.SystemContainer().AddSystem()
    start = {"initialVelocity": [0.2 if friction else 0.0, 0, 0.25]}
    plate = ep.CreatePartitionBody(mbs, dents_of(friction), damping=ep.Rayleigh(0.0, beta), **start)
    contacts = [
        ep.CreatePartitionContact(
            mbs, plate, ep.RigidSphere((1.2e-3 * side, 0, 5e-3), 5e-3), slavePatch=name, friction=friction,
        )
        for side, name in ((-1, "left"), (1, "right")) if side in sides
    ]  # fmt: skip
    mbs.Assemble()
    with small_zone():
        result = ep.solve_dynamic(mbs, end_time=11e-6, step=0.1e-6, method=method)
    start = plate.energy(result)[0]
    assert all(contact.plastic.work(result)[-1] > 0.03 * start for contact in contacts)
    assert balance([plate], contacts, result) < 5e-4


def test_rows_that_a_rolling_ball_leaves_behind_lose_no_energy(round_body):
    """Rows come and go, and forces on them rise in one step. What the balance lacks is an error of first order."""
    missing, spin = [], 800.0
    for steps in (200, 400):
        mbs = exu.SystemContainer().AddSystem()
        start = {"initialVelocity": [spin * SPHERE_RADIUS, 0, -SPEED], "initialAngularVelocity": [0, spin, 0]}
        place = {"referencePosition": [0, 0, 1e-9], "frame": "floating"}
        item = ep.CreatePartitionBody(mbs, round_body, damping=ep.Rayleigh(0.0, T / 50), **place, **start)
        contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane())
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=T, step=T / steps)
        total = sum(each.energy(result) + each.dissipated_energy(result) for each in (item, contact))
        missing.append(abs(total - total[0]).max() / (0.5 * round_body.total_mass * SPEED**2))
    assert missing[0] < 6e-3
    assert missing[1] < 0.6 * missing[0]
