"""Multipliers with friction: a guided slider, rows that share a load with frictionless ones, oblique impacts."""

import exudyn.itemInterface as items
import numpy as np
import pytest
from oracles import TOP, add_force, box, end, ground

import exudyn_partition as ep

MU, LOAD, SPEED, HEIGHT = 0.2, 2e4, 1.0, 0.003
END = 15e-6


@pytest.fixture(scope="module")
def slider(kept):
    """A steel plate of 8 x 8 x 3 mm with its lower face at z = 0, which a joint can hold at its upper face."""
    fem = ep.fe_model(box(0.008, 0.008, HEIGHT), ep.STEEL, maxh=2.5e-3)
    part = ep.Partition.ball(fem, (0, 0, 0), 2.5e-3, axes="xyz")
    part |= ep.Partition.interface(fem, "head", end(fem, HEIGHT), kind="averaged")
    return ep.reduce(fem, part, basis="craig-bampton", f_cut=400e3, cache=kept)


def loaded(mbs, body):
    item = ep.CreatePartitionBody(mbs, body, initialVelocity=[SPEED, 0, 0])
    add_force(mbs, item, body.total_mass * np.array([0.0, 0.0, -LOAD]))
    return item


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.PartitionWarning")  # the patch ends within the face
def test_a_guided_slider_decelerates_by_the_normal_force(mbs, slider):
    """A joint leaves it free along the plane and across: the contact bears the load, and friction is mu times that."""
    item = loaded(mbs, slider)
    joint = items.GenericJoint(markerNumbers=[ground(mbs, (0, 0, HEIGHT)), item.CreateInterfaceMarker(mbs, "head")])
    joint.constrainedAxes = [0, 1, 0, 1, 1, 1]
    mbs.AddObject(joint)
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), formulation="lagrange", friction=MU)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=END)
    velocity = item.momentum(result)[-1] / slider.total_mass
    normal = LOAD * result.t[-1] + velocity[2]
    assert velocity[0] - SPEED == pytest.approx(-MU * normal, rel=1e-3)
    taken = np.trapezoid(contact.friction.tangential_force(result)[:, 0], result.t)
    assert taken == pytest.approx(-MU * np.trapezoid(contact.force(result), result.t), rel=1e-3)


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.PartitionWarning")
def test_only_the_rows_with_friction_drag(mbs, slider):
    """Two equal planes share the load, of which one has no friction: the drag is that of the other one."""
    item = loaded(mbs, slider)
    rough, smooth = (
        ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), formulation="lagrange", friction=mu) for mu in (MU, None)
    )
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=END)
    velocity = item.momentum(result)[-1] / slider.total_mass
    borne, shared = (np.trapezoid(contact.force(result), result.t) for contact in (rough, smooth))
    mass = slider.total_mass
    assert borne + shared == pytest.approx(mass * (LOAD * result.t[-1] + velocity[2]), rel=1e-3)
    assert borne == pytest.approx(shared, rel=0.05)
    assert velocity[0] - SPEED == pytest.approx(-MU * borne / mass, rel=1e-3)


@pytest.mark.parametrize(("method", "step"), [("explicit", None), ("implicit", 0.4e-6)])
def test_an_oblique_impact_keeps_momentum_and_energy(mbs, pair_of, method, step):
    """Ball on block: what friction and the nodes' own impacts take is all that is lost."""
    ball, block = pair_of("craig-bampton")
    items_ = [
        ep.CreatePartitionBody(mbs, ball, referencePosition=TOP, initialVelocity=[1.0, 0, -1.0]),
        ep.CreatePartitionBody(mbs, block),
    ]
    contact = ep.CreatePartitionContact(mbs, *items_, formulation="lagrange", friction=MU)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=15e-6, step=step, method=method)
    momentum = sum(item.momentum(result) for item in items_)
    assert abs(momentum - momentum[0]).max() < 1e-9 * abs(momentum[0]).max()
    normal, along = contact.force(result), contact.friction.tangential_force(result)[:, 0]
    impulse = items_[0].momentum(result)[-1] - items_[0].momentum(result)[0]
    assert np.trapezoid(along, result.t) == pytest.approx(impulse[0], rel=0.02)
    assert impulse[0] == pytest.approx(-MU * impulse[2], rel=0.02)  # it slips all the time
    assert np.trapezoid(normal, result.t) == pytest.approx(impulse[2], rel=0.02)
    total = sum(item.energy(result) for item in items_) + contact.dissipated_energy(result)
    assert 0.98 < total[-1] / total[0] < 1.005
    assert contact.dissipated_energy(result)[-1] > 0.02 * total[0]
