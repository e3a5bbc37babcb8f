"""Contacts in Exudyn models: rigid counterparts, rotating bodies, several contacts, and what they report."""

import functools
from dataclasses import replace
from itertools import pairwise

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
from exudyn.itemInterface import NodeRigidBodyRotVecLG, ObjectRigidBody
from exudyn.utilities import InertiaSphere
from oracles import MARBLE_RADIUS as R
from oracles import SPHERE_RADIUS, TOP
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.contact.patch_gaps import PatchGaps
from exudyn_partition.errors import (
    ContactPatchWarning,
    InputError,
    ModelLimitWarning,
)
from exudyn_partition.exudyn_contacts.model_run import runs_of
from exudyn_partition.frames.rotations import rotation_matrix


@pytest.fixture(scope="module")
def tilted(kept):
    """A steel rod with a round tip at the origin and a block, with all three directions, by the name of a basis.

    They are coarser for bases that keep the motion of the nodes.
    """
    rod = occ.Sphere(occ.Pnt(0, 0, 6e-3), 6e-3) + occ.Cylinder(occ.Pnt(0, 0, 6e-3), occ.Z, r=6e-3, h=0.03)
    block = occ.Box(occ.Pnt(-0.02, -0.02, -0.02), occ.Pnt(0.02, 0.02, 0))

    @functools.cache
    def reduced(basis):
        coarser, found = 2.0 if basis in ("free", "craig-bampton") else 1.0, []
        for shape, material, maxh, radius, h in (
            (rod, ep.STEEL, 5e-3, 1.2e-3, 0.3e-3),
            (block, ep.ALUMINIUM, 8e-3, 1.5e-3, 0.4e-3),
        ):
            fine = [ep.Refine((0, 0, 0), radius / 1.5, coarser * h)]
            fem = ep.fe_model(shape, material, maxh=maxh, refine=fine, grading=0.5)
            part = ep.Partition.ball(fem, (0, 0, 0), radius, axes="xyz")
            found.append(ep.reduce(fem, part, basis=basis, f_cut=90e3, cache=kept))
        return found

    return reduced


def drop(mbs, marble, master, velocity=(0, 0, -0.5), frame="inertial", position=(0, 0, R), moment=False, **options):
    """The marble on its way into a rigid surface."""
    item = ep.CreatePartitionBody(mbs, marble, initialVelocity=velocity, referencePosition=position, frame=frame)
    contact = ep.CreatePartitionContact(mbs, item, master, slavePatch="south", name="drop", **options)
    if moment:
        contact.AddMomentSensor(mbs)
    mbs.Assemble()
    return item, contact


@pytest.mark.parametrize("options", [
    {}, {"rows": "node-to-segment"}, {"formulation": "penalty"}, {"frame": "floating"}, {"method": "implicit"},
])  # fmt: skip
def test_a_ball_bounces_off_a_rigid_plane(mbs, marble, options):
    """Momentum turns round but for what vibrates, and the impulse is its change."""
    options = dict(options)
    method = options.pop("method", "explicit")
    item, contact = drop(mbs, marble, ep.RigidPlane(), **options)
    result = ep.solve_dynamic(mbs, end_time=50e-6, step=0.1e-6, method=method)
    change = item.momentum(result)[-1, 2] + 0.5 * marble.total_mass
    assert change == pytest.approx(2 * 0.5 * marble.total_mass, rel=1e-3)
    assert contact.impacts(result)[0].impulse == pytest.approx(change, rel=1e-4)
    energy = item.energy(result) + contact.energy(result)
    assert abs(energy / energy[0] - 1).max() < 1e-4
    np.testing.assert_allclose(contact.force_on_slave(result)[:, 2], contact.force(result), rtol=1e-9)
    assert len(contact.impacts(result)) == 1


@pytest.mark.parametrize(("rows", "first_gap"), [("node-to-segment", 0.0), ("integrated", 0.3e-6)])
def test_what_a_contact_reports(mbs, marble, rows, first_gap):
    """The mean gap around the lowest node is larger than its own."""
    _, contact = drop(mbs, marble, ep.RigidSphere((0, 0, -0.02 - 1e-6), 0.02), moment=True, rows=rows)
    result = ep.solve_dynamic(mbs, end_time=50e-6, step=0.1e-6)
    force, on_rows = contact.force(result), contact.row_forces(result)
    np.testing.assert_allclose(on_rows @ np.ones(on_rows.shape[1]), force, rtol=1e-12)
    assert (on_rows.data > 0).all()
    np.testing.assert_array_equal(np.diff(on_rows.indptr), contact.closed_rows(result))
    top = int(force.argmax())
    if rows == "integrated":
        np.testing.assert_allclose(
            contact.pressure(result)[top] @ contact.mechanics.gaps.all_points.node_areas, force[top], rtol=1e-12
        )
    radius = contact.radius(result)[top]
    effective = 1 / (1 / R + 1 / 0.02)
    stiffness = ep.STEEL.plane_strain_modulus
    hertz = (3 * force[top] * effective / (4 * stiffness)) ** (1 / 3)
    assert radius == pytest.approx(hertz, rel=0.2)  # some ten rows
    assert contact.pressure(result)[top].max() == pytest.approx(1.5 * force[top] / (np.pi * hertz**2), rel=0.3)
    (impact,) = contact.impacts(result)
    assert impact.peak == force.max()
    assert 0 < impact.start < impact.end < 50e-6
    gap, of_rows = contact.gap(result), result.sensor(contact["sForce"])[:, 5]
    assert gap[0] == pytest.approx(1e-6, rel=1e-2)
    assert 0.99e-6 < of_rows[0] < 1.01e-6 + first_gap
    np.testing.assert_array_equal(of_rows < 0, force > 0)
    assert (gap <= of_rows + 1e-12).all()
    assert contact.depth(result) == -gap.min() == pytest.approx(hertz**2 / effective, rel=0.1)  # the approach
    moment = contact.moment_on_slave(result)
    assert abs(moment).max() < 0.01 * R * force.max()  # about the point of contact, but for the unevenness of the mesh
    assert moment.any()
    assert contact.left_out


def test_a_force_aside_of_the_line_of_contact_is_told(mbs, marble):
    """A patch with one axis knows its flexibility along that line alone."""
    line = np.array([np.sin(0.7), 0, -np.cos(0.7)])
    patches = tuple(replace(patch, direction=line) for patch in marble.partition.patches)
    turned = replace(marble, partition=replace(marble.partition, patches=patches))
    drop(mbs, turned, ep.RigidPlane())
    with pytest.warns(ModelLimitWarning, match="the force on the slave is 40 degrees off the line of contact"):
        ep.solve_dynamic(mbs, end_time=20e-6, step=0.2e-6)


def test_a_rigid_body_carries_the_surface(mbs, marble):
    """The marble hits a body of its own mass, which is at rest: momentum goes over to it, and none is lost."""
    m = marble.total_mass
    node = mbs.AddNode(NodeRigidBodyRotVecLG(referenceCoordinates=[0, 0, -R, 0, 0, 0]))
    J = 0.4 * m * R**2
    carrier = mbs.AddObject(ObjectRigidBody(nodeNumber=node, mass=m, inertia=[J, J, J, 0, 0, 0]))
    item, contact = drop(mbs, marble, ep.RigidSphere((0, 0, 0), R), masterBody=carrier, velocity=(0.1, 0, -0.5))
    result = ep.solve_dynamic(mbs, end_time=60e-6, step=0.1e-6)
    velocity = mbs.GetObjectOutputBody(carrier, exu.OutputVariableType.Velocity, localPosition=[0, 0, 0])
    momentum = item.momentum(result)
    np.testing.assert_allclose(momentum[-1] + m * np.array(velocity), momentum[0], atol=1e-12 * m)
    assert velocity[2] == pytest.approx(-0.5, rel=5e-3)
    (impact,) = contact.impacts(result)
    assert impact.speed_before == pytest.approx(0.5, rel=1e-3)
    assert impact.speed_after == pytest.approx(item.momentum(result)[-1, 2] / m - velocity[2], rel=1e-3)


@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_a_carrier_has_its_part_in_approach_and_separation(mbs, marble, method):
    """The marble flies at a body of twice its mass, which comes to meet it; both leave as fast as they came."""
    m, come, meet = marble.total_mass, 0.4, 0.2
    carrier = mbs.CreateRigidBody(
        inertia=InertiaSphere(2 * m, R),
        nodeType=exu.NodeType.RotationRotationVector,
        referencePosition=[0, 0, -R],
        initialVelocity=[0, 0, meet],
    )
    start = {"position": (0, 0, R + 2e-6), "velocity": (0, 0, -come)}
    item, contact = drop(mbs, marble, ep.RigidSphere((0, 0, 0), R), masterBody=carrier, **start)
    result = ep.solve_dynamic(mbs, end_time=80e-6, step=0.1e-6, method=method)
    (impact,) = contact.impacts(result)
    assert impact.speed_before == pytest.approx(come + meet, rel=1e-6)
    velocity = mbs.GetObjectOutputBody(carrier, exu.OutputVariableType.Velocity, localPosition=[0, 0, 0])
    assert impact.speed_after == pytest.approx(item.momentum(result)[-1, 2] / m - velocity[2], rel=1e-5)
    assert impact.restitution == pytest.approx(1.0, abs=0.01)


def test_a_carrier_that_turns_has_the_speed_of_the_point_that_is_hit(mbs, marble):
    """A heavy lever, whose plane meets the marble at rest at its reach; away from the axis, by the rate of turning."""
    reach, rate = 0.02, 30.0
    lever = mbs.CreateRigidBody(
        inertia=InertiaSphere(1e3, 1.0),
        nodeType=exu.NodeType.RotationRotationVector,
        referencePosition=[-reach, 0, -R],
        initialAngularVelocity=[0, -rate, 0],
    )
    plane = ep.RigidPlane((0, 0, R))
    _, contact = drop(mbs, marble, plane, masterBody=lever, position=(0, 0, R + 6e-6), velocity=(0, 0, 0))
    result = ep.solve_dynamic(mbs, end_time=80e-6, step=0.1e-6)
    (impact,) = contact.impacts(result)
    assert impact.speed_before == pytest.approx(rate * reach, rel=1e-3)
    assert impact.restitution == pytest.approx(1.0, abs=0.01)


def chain_of_hertz(mass, speed, end_time):
    """Velocities after the impact of three rigid balls on Hertz springs, the first moving."""
    stiffness = 4 / 3 * ep.STEEL.plane_strain_modulus / 2 * np.sqrt(R / 2)

    def rates(t, y):
        force = stiffness * np.maximum(y[:2] - y[1:3], 0.0) ** 1.5
        return np.r_[y[3:], np.array([-force[0], force[0] - force[1], force[1]]) / mass]

    run = solve_ivp(rates, (0, end_time), [0, 0, 0, speed, 0, 0], rtol=1e-9, atol=1e-15)
    return run.y[3:, -1]


def row(marble, speeds):
    """Marbles that touch along z with speeds up [m/s], assembled: model, items and contacts."""
    mbs = exu.SystemContainer().AddSystem()
    balls = [
        ep.CreatePartitionBody(
            mbs, marble, referencePosition=[0, 0, 2 * R * i], initialVelocity=[0, 0, v], name=f"ball {i}"
        )
        for i, v in enumerate(speeds)
    ]
    contacts = [
        ep.CreatePartitionContact(mbs, a, b, slavePatch="north", masterPatch="south", passes="given")
        for a, b in pairwise(balls)
    ]
    mbs.Assemble()
    return mbs, balls, contacts


def cradle(marble):
    """Momenta of three marbles in a row, (3, n) [N s], after the first has hit the others at 0.5 m/s, and energies."""
    mbs, balls, contacts = row(marble, (0.5, 0.0, 0.0))
    result = ep.solve_dynamic(mbs, end_time=120e-6, step=0.1e-6)
    energy = sum(x.energy(result) for x in (*balls, *contacts))
    return np.array([ball.momentum(result)[:, 2] for ball in balls]), energy


def test_newton_s_cradle(marble, marble_parts):
    """Three balls in a row: two Hertz springs in series, but for the waves and the finite size of the balls."""
    momentum, energy = cradle(marble)
    np.testing.assert_allclose(momentum.sum(axis=0), momentum[0, 0], rtol=1e-9)
    assert abs(energy / energy[0] - 1).max() < 1e-5
    expected = chain_of_hertz(marble.total_mass, 0.5, 120e-6)
    np.testing.assert_allclose(momentum[:, -1] / marble.total_mass, expected, atol=0.02 * 0.5)
    # What is left to the residual flexibility, the modes of the other basis answer; neglecting its coupling between the
    # two contacts of the middle ball makes a difference ten times as large.
    other, _ = cradle(ep.reduce(*marble_parts, basis="residual", f_cut=300e3))
    np.testing.assert_allclose(other[:, -1], momentum[:, -1], atol=1e-3 * momentum[0, 0])


@pytest.mark.parametrize(("basis", "options", "step"), [
    ("contact-adapted", {"rows": "node-to-segment"}, 0.2e-6), ("contact-adapted", {"rows": "integrated"}, 0.2e-6),
    ("free", {"formulation": "penalty"}, 0.028e-6), ("free", {"formulation": "lagrange"}, 0.011e-6),
    ("craig-bampton", {"formulation": "lagrange"}, 0.011e-6),
])  # fmt: skip
def test_a_rotating_body_strikes_obliquely(mbs, tilted, basis, options, step):
    """Frictionless, both bodies in floating frames: linear and angular momentum of the system."""
    bodies = tilted(basis)
    A = Rotation.from_euler("y", 4, degrees=True).as_matrix()
    centre = np.array([0, 0, 6e-3])  # of the tip
    rod = ep.CreatePartitionBody(
        mbs,
        bodies[0],
        frame="floating",
        referencePosition=centre - A @ centre + [0, 0, 1e-6],
        referenceRotation=A,
        initialVelocity=[0.5, 0, -1.0],
        initialAngularVelocity=[30, 60, 100],
    )
    block = ep.CreatePartitionBody(mbs, bodies[1], frame="floating")
    contact = ep.CreatePartitionContact(mbs, rod, block, passes="given", **options)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=250 * step, step=step)
    assert contact.force(result).max() > 20
    momentum = rod.momentum(result) + block.momentum(result)
    np.testing.assert_allclose(momentum - momentum[0], 0, atol=1e-12 * np.linalg.norm(momentum[0]))
    angular = rod.angular_momentum(result) + block.angular_momentum(result)
    np.testing.assert_allclose(angular - angular[0], 0, atol=1e-7 * np.linalg.norm(angular[0]))
    energy = rod.energy(result) + block.energy(result) + contact.energy(result)
    assert abs(energy / energy[0] - 1).max() < 2e-3


def test_multipliers_follow_a_sliding_tip(mbs, pair_of):
    """The paper's basis: gaps stay closed, and the frictionless contact takes nothing of the sliding."""
    bodies = pair_of("free")
    tip = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP, initialVelocity=[300.0, 0, -1.0])
    target = ep.CreatePartitionBody(mbs, bodies[1])
    contact = ep.CreatePartitionContact(mbs, tip, target, formulation="lagrange")
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=1e-6, sample_period=1e-8)
    assert runs_of(mbs).at_work(contact).mechanics.gaps.moving
    assert contact.force(result).max() > 10
    momentum = tip.momentum(result) + target.momentum(result)
    np.testing.assert_allclose(momentum - momentum[0], 0, atol=1e-9 * abs(momentum[0]).max())


def test_the_finer_body_is_the_slave_unless_given(mbs, bodies):
    items = [ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP), ep.CreatePartitionBody(mbs, bodies[1])]
    ball, block = items
    assert ep.CreatePartitionContact(mbs, block, ball, name="a").slave is ball
    with pytest.raises(InputError, match="these two already have the contact 'a'"):
        ep.CreatePartitionContact(mbs, block, ball, passes="given")


def test_a_sensor_that_is_read_again_counts_once(mbs, marble):
    _, contact = drop(mbs, marble, ep.RigidPlane())
    result = ep.solve_dynamic(mbs, end_time=10e-6)  # ends in contact
    mbs.GetSensorValues(contact["sForce"])
    force = contact.force(result)
    assert force[-1] > 0
    rows = contact.row_forces(result)
    np.testing.assert_allclose(rows @ np.ones(rows.shape[1]), force, rtol=1e-12)


def test_moments_are_asked_for(mbs, marble):
    _, contact = drop(mbs, marble, ep.RigidPlane())
    result = ep.solve_dynamic(mbs, end_time=1e-6)
    with pytest.raises(InputError, match=r"call AddMomentSensor.*nodal_forces\(result\) has the forces"):
        contact.moment_on_slave(result)
    contact.AddMomentSensor(mbs)
    with pytest.raises(InputError, match=r"stored nothing in this run: it was added later.*Run the model again"):
        contact.moment_on_slave(result)
    mbs.Assemble()
    assert contact.moment_on_slave(ep.solve_dynamic(mbs, end_time=2e-6, go_on=True)).shape[1] == 3


def test_bad_contacts(mbs, marble):
    item = ep.CreatePartitionBody(mbs, marble, referencePosition=[0, 0, R])
    with pytest.raises(InputError, match="RigidProfile or RigidMesh, got str"):
        ep.CreatePartitionContact(mbs, item, "floor", slavePatch="south")
    with pytest.raises(InputError, match=r"^passes: expected one of 'finer', 'given', got 'two'"):
        ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), slavePatch="south", passes="two")
    with pytest.raises(InputError, match=r"^slavePatch: expected the name or number of one of the"):
        ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), slavePatch="west")
    with pytest.raises(InputError, match=r"^plasticStates: expected the name or number of one of the"):
        ep.CreatePartitionBody(mbs, marble, plasticStates={"west": None})
    other = ep.CreatePartitionBody(mbs, marble, referencePosition=[0, 0, -R])
    options = {"slavePatch": "south"}
    with pytest.raises(InputError, match="masterPatch: a RigidPlane has no patches"):
        ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), masterPatch=0, **options)
    with pytest.raises(InputError, match="stiffness: formulation 'compliance' has none"):
        ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), stiffness=1e12, **options)
    with pytest.raises(InputError, match=r"stiffness: expected at most .* got 1e\+30"):
        ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), formulation="penalty", stiffness=1e30, **options)
    with pytest.raises(InputError, match="masterBody: only a rigid surface"):
        ep.CreatePartitionContact(mbs, item, other, slavePatch="south", masterPatch="north", masterBody=0)
    with pytest.raises(InputError, match="stiffness"):
        ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), slavePatch="south", formulation="penalty", stiffness=-1.0)
    with pytest.raises(InputError, match="rows"):
        ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), slavePatch="south", rows="mortar")


def test_the_energy_of_many_contacts_is_linear_work(marble, monkeypatch):
    """A run tells energies without work. From a file, contacts are found together, once, with the same energies."""
    answers = 0
    gaps_at = PatchGaps.at

    def counted(*args):
        nonlocal answers
        answers += 1
        return gaps_at(*args)

    def work(n):
        nonlocal answers
        mbs, _, contacts = row(marble, [-0.2 * i for i in range(n)])
        result = ep.solve_dynamic(mbs, end_time=5e-6, step=0.5e-6)
        answers = 0
        told = [contact.energy(result) for contact in contacts]
        assert answers == 0
        result = replace(result, runs=())  # nothing was kept
        energies = [contact.energy(result) for contact in contacts]
        np.testing.assert_allclose(told, energies, rtol=1e-6, atol=1e-12 * np.max(energies))
        assert all(energy[-1] > 0 for energy in energies)
        np.testing.assert_array_equal(energies[0], contacts[0].energy(result))
        return answers / len(contacts) / len(result.t)

    monkeypatch.setattr(PatchGaps, "at", counted)
    few, many = work(3), work(9)
    assert few >= 1
    assert many < 1.5 * few


@pytest.fixture(scope="module")
def nodal(pair_of):
    """Ball and block in the paper's basis."""
    return pair_of("free")


def placed(mbs, bodies, position=TOP):
    """Partition bodies of a model, the first shifted."""
    return [ep.CreatePartitionBody(mbs, bodies[0], referencePosition=position), ep.CreatePartitionBody(mbs, bodies[1])]


def test_formulations_name_the_bases_that_they_need(mbs, bodies, nodal):
    flexible, massive = placed(mbs, bodies), placed(mbs, nodal)
    with pytest.raises(InputError, match="'compliance' needs a residual flexibility"):
        ep.CreatePartitionContact(mbs, *massive)
    with pytest.raises(InputError, match="'lagrange' needs contact patches that move"):
        ep.CreatePartitionContact(mbs, *flexible, formulation="lagrange")


@pytest.mark.parametrize("surface", [None, ep.RigidPlane()])
def test_a_body_that_faces_away_turns_until_it_hits(round_body, flat_body, surface):
    """A rolling ball of which the patch points aside at first, against the same when it nearly faces the plate."""
    omega, speed, late = 800.0, 0.5, 0.2  # [rad/s], [m/s], rad before the patch is lowest
    forces = []
    for angle in (1.6, late):
        wait = (angle - late) / omega
        turn = rotation_matrix(np.array([angle, 0.0, 0.0]))
        centre = np.array([0.0, 0.0, SPHERE_RADIUS + 1e-6 + speed * angle / omega])
        mbs = exu.SystemContainer().AddSystem()
        roll, down = [-omega, 0.0, 0.0], [0.0, 0.0, -speed]
        slave = ep.CreatePartitionBody(
            mbs, round_body, frame="floating", referencePosition=centre - turn @ round_body.centre_of_mass,
            referenceRotation=turn, initialVelocity=down, initialAngularVelocity=roll,
        )  # fmt: skip
        contact = ep.CreatePartitionContact(mbs, slave, surface or ep.CreatePartitionBody(mbs, flat_body))
        mbs.Assemble()
        assert contact.mechanics.gaps.placement.faced == (angle == late)
        assert any("do not face" in sentence for sentence in contact.left_out) == (angle != late)
        limit = ep.stability_limit(mbs)
        result = ep.solve_dynamic(mbs, end_time=wait + 0.36e-3, step=0.8e-6)
        force = contact.force(result)[result.t > wait]
        forces.append((force.max(), force.sum() * result.step, limit))
    np.testing.assert_allclose(forces[0][:2], forces[1][:2], rtol=5e-3)
    assert forces[0][2] == pytest.approx(forces[1][2], rel=0.03)
    assert forces[0][0] > 100


def test_a_contact_that_never_faces_says_so(round_body):
    mbs = exu.SystemContainer().AddSystem()
    slave = ep.CreatePartitionBody(mbs, round_body, frame="floating", initialVelocity=[0, 0, -1])
    ep.CreatePartitionContact(mbs, slave, ep.RigidPlane((0, 0, 0.1), (0, 0, -1)), name="ceiling")
    mbs.Assemble()
    with pytest.warns(ContactPatchWarning, match="'ceiling' never closed, and at the start .* did not face"):
        ep.solve_dynamic(mbs, end_time=1e-5, step=1e-6)


def test_growth_by_a_spin_at_the_start_is_no_sliding(round_body):
    """A ball that touches in its first step has the force of one that has flown for a step; its pole hardly slides."""
    step, speed = 1e-7, 6.0

    def tangential(flies):
        mbs = exu.SystemContainer().AddSystem()
        ball = ep.CreatePartitionBody(
            mbs, round_body, frame="floating", referencePosition=[0, 0, 1e-8 + flies * speed * step],
            initialVelocity=[20.0, 0, -speed], initialAngularVelocity=[0, 2000, 2000],
        )  # fmt: skip
        contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), friction=5.0)
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=4e-7, step=step)
        return contact.friction.tangential_force(result)[1 + flies], contact.force(result)[1 + flies]

    (at_once, force), (later, other) = tangential(0), tangential(1)
    assert force > 0.0
    assert force == pytest.approx(other, rel=0.05)
    np.testing.assert_allclose(at_once, later, rtol=0, atol=0.1 * np.linalg.norm(later))
