"""Impacts with friction in Exudyn's solvers: impulses, balances and what results tell."""

import exudyn as exu
import numpy as np
import pytest
from exudyn.utilities import InertiaCuboid
from oracles import MARBLE_RADIUS, SPHERE_RADIUS, energy_by_start

import exudyn_partition as ep
from exudyn_partition.contact.formulations.coupled import Coupled

MU, SPEED, ALONG = 0.2, 0.3, 0.2
END = 70e-6


def impact(mbs, body, *, frame="inertial", friction=MU, method="explicit", along=ALONG, **options):
    """The ball hits a rigid plane at an angle."""
    item = ep.CreatePartitionBody(
        mbs, body, referencePosition=[0, 0, 1e-6], initialVelocity=[along, 0, -SPEED], frame=frame
    )
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), friction=friction)
    mbs.Assemble()
    return item, contact, ep.solve_dynamic(mbs, end_time=END, method=method, **options)


def balance(item, contact, result):
    """Largest change of mechanical energy plus what friction took, relative."""
    return abs(energy_by_start([item], contact, result) - 1).max()


@pytest.fixture(params=["explicit", "implicit"])
def method(request):
    return request.param


def test_gross_slip_has_coulombs_impulse(mbs, round_body, frame, method):
    """At mu = 0.05 the ball slides all the time: the tangential impulse is mu times the normal one."""
    item, contact, result = impact(mbs, round_body, frame=frame, method=method, friction=0.05)
    normal = np.trapezoid(contact.force(result), result.t)
    along = np.trapezoid(contact.friction.tangential_force(result), result.t, axis=0)
    assert along[0] == pytest.approx(-0.05 * normal, rel=2e-3)
    assert balance(item, contact, result) < 1e-4
    assert item.momentum(result)[-1, 0] == pytest.approx(round_body.total_mass * ALONG + along[0], rel=1e-6)


@pytest.mark.parametrize("friction", [None, 0.05, 0.5])
def test_restitution_is_that_of_normal_speeds(mbs, round_body, frame, friction):
    """Friction turns the impulse, but takes nothing of the normal speed of a ball."""
    item, contact, result = impact(mbs, round_body, frame=frame, friction=friction, along=0.5)
    (found,) = contact.impacts(result)
    normal = item.momentum(result)[:, 2] / round_body.total_mass
    assert found.speed_before == pytest.approx(-normal[0], rel=2e-3)
    assert found.speed_after == pytest.approx(normal[-1], rel=1e-2)
    assert found.speed_after / found.speed_before == pytest.approx(-normal[-1] / normal[0], rel=1e-2)


def test_the_centre_of_a_contact_slides_with_the_ball(mbs, round_body):
    """Beside the place of the largest force, the spin by friction would count as normal speed: 1.5 % of it."""
    item, contact, result = impact(mbs, round_body, frame="floating", friction=0.1, along=10.0)
    (found,) = contact.impacts(result)
    normal = item.momentum(result)[:, 2]
    assert found.restitution == pytest.approx(-normal[-1] / normal[0], abs=2e-3)


def test_sticking_reverses_the_contact_point(mbs, round_body):
    """Maw, Barber and Fawcett: at psi1 = 1.1 of mu = 0.5 the contact's tangential velocity all but vanishes."""
    item, contact, result = impact(mbs, round_body, friction=0.5)
    mass = round_body.total_mass
    # The tangential impulse changes the velocity of the contact point of a solid ball by 7 / 2 of its share.
    change = 3.5 * np.trapezoid(contact.friction.tangential_force(result)[:, 0], result.t) / mass
    assert -0.15 * ALONG < ALONG + change < 0.05 * ALONG
    assert contact.friction.stuck_rows(result).max() > 0
    assert balance(item, contact, result) < 1e-4


def test_friction_takes_what_results_say(mbs, round_body):
    item, contact, result = impact(mbs, round_body)
    taken = contact.dissipated_energy(result)
    assert (np.diff(taken) > -1e-6 * taken[-1]).all()
    assert taken[-1] == pytest.approx(item.energy(result)[0] - item.energy(result)[-1], rel=1e-3)
    peak = int(contact.force(result).argmax())
    states, tractions = contact.friction.states(result), contact.friction.row_forces(result)
    assert (states[peak] > 0).sum() == contact.closed_rows(result)[peak]
    assert (states[peak] == 1).sum() == contact.friction.stuck_rows(result)[peak]
    np.testing.assert_allclose(tractions[peak].sum(axis=0), contact.friction.tangential_force(result)[peak], rtol=1e-9)
    assert contact.friction.slip_path(result).max() > 0
    (on_nodes,) = contact.nodal_forces(result)
    np.testing.assert_allclose(on_nodes[peak].sum(axis=0), contact.force_on_slave(result)[peak], rtol=1e-6)


def test_frictionless_contacts_have_no_tangential_results(mbs, round_body):
    _, contact, result = impact(mbs, round_body, friction=None)
    with pytest.raises(ep.errors.InputError, match="frictionless"):
        contact.friction.tangential_force(result)
    assert not contact.friction
    assert contact.friction.coulomb is None
    assert not contact.friction.work(result).any()
    assert any("frictionless" in said for said in contact.left_out)


def test_adaptive_steps_agree(round_body):
    found = []
    for options in ({}, {"adaptive": True}):
        mbs = exu.SystemContainer().AddSystem()
        _, contact, result = impact(mbs, round_body, method="implicit", **options)
        found.append(np.trapezoid(contact.friction.tangential_force(result)[:, 0], result.t))
    assert found[1] == pytest.approx(found[0], rel=0.02)


def test_a_belt_pulls_as_much_as_the_ball_would_slide(round_body):
    """Only relative motion counts: a ball that slides on a floor, or one at rest that falls on a moving belt."""
    found = []
    for along, belt in ((ALONG, 0.0), (0.0, -ALONG)):
        mbs = exu.SystemContainer().AddSystem()
        heavy = InertiaCuboid(1e9, [1.0, 1.0, 1.0])
        node = exu.NodeType.RotationRotationVector
        carrier = mbs.CreateRigidBody(inertia=heavy, nodeType=node, initialVelocity=[belt, 0, 0])
        item = ep.CreatePartitionBody(
            mbs, round_body, referencePosition=[0, 0, 1e-6], initialVelocity=[along, 0, -SPEED]
        )
        contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), masterBody=carrier, friction=MU)
        mbs.Assemble()
        found.append(contact.friction.tangential_force(ep.solve_dynamic(mbs, end_time=40e-6))[:, 0])
    assert found[0].min() < 0
    np.testing.assert_allclose(found[1], found[0], atol=1e-5 * abs(found[0]).max())


def test_contacts_on_one_body_are_solved_together(mbs, marble_parts, kept):
    """A marble in a narrow slot, pushed sideways: both contacts slip or stick, and no energy is lost in between."""
    fem, _ = marble_parts
    poles = [
        ep.Partition.ball(fem, (0, 0, z), 0.35e-3, axes="xyz", name=name)
        for z, name in ((-MARBLE_RADIUS, "south"), (MARBLE_RADIUS, "north"))
    ]
    body = ep.reduce(fem, poles[0] | poles[1], f_cut=300e3, cache=kept)
    item = ep.CreatePartitionBody(mbs, body, initialVelocity=[0.2, 0, -0.3])
    walls = [ep.RigidPlane((0, 0, sign * (MARBLE_RADIUS + 0.1e-6)), (0, 0, -sign)) for sign in (-1, 1)]
    contacts = [
        ep.CreatePartitionContact(mbs, item, wall, slavePatch=patch, friction=MU)
        for wall, patch in zip(walls, ("south", "north"), strict=True)
    ]
    mbs.Assemble()
    assert isinstance(contacts[0].together, Coupled)
    result = ep.solve_dynamic(mbs, end_time=40e-6)
    assert all(contact.friction.tangential_force(result).any() for contact in contacts)
    total = item.energy(result) + sum(c.energy(result) + c.dissipated_energy(result) for c in contacts)
    np.testing.assert_allclose(total, total[0], rtol=2e-4)


@pytest.mark.filterwarnings("ignore:.*the facets do not resolve")  # a few rows are closed
def test_two_bodies_keep_momentum_and_angular_momentum(mbs, round_body, flat_body):
    items = [
        ep.CreatePartitionBody(
            mbs, round_body, referencePosition=[0, 0, 1e-6], initialVelocity=[ALONG, 0, -SPEED], frame="floating"
        ),
        ep.CreatePartitionBody(mbs, flat_body, frame="floating"),
    ]
    contact = ep.CreatePartitionContact(mbs, *items, friction=MU)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=40e-6)
    assert contact.friction.tangential_force(result).any()
    momentum = sum(item.momentum(result) for item in items)
    assert abs(momentum - momentum[0]).max() < 1e-9 * abs(momentum[0]).max()
    spin = sum(item.angular_momentum(result, np.zeros(3)) for item in items)
    assert abs(spin - spin[0]).max() < 1e-6 * round_body.total_mass * SPEED * SPHERE_RADIUS
    np.testing.assert_allclose(energy_by_start(items, contact, result), 1.0, rtol=2e-4)
