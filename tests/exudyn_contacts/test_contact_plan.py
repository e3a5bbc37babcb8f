"""Plans of contacts: what they choose, and that they leave the model as it is."""

from functools import partial

import exudyn as exu
import pytest
from exudyn.utilities import InertiaCuboid
from oracles import TOP

import exudyn_partition as ep
from exudyn_partition.contact.patch_gaps import PatchGaps
from exudyn_partition.contact.rigid import RigidGaps
from exudyn_partition.errors import InputError, PenetrationError
from exudyn_partition.exudyn_bodies.model import registered
from exudyn_partition.exudyn_contacts.contact_plan import plan_contact


def content(mbs):
    """Numbers of all items of a model, and of the library's contacts in it."""
    system = mbs.systemData
    count = (system.NumberOfObjects, system.NumberOfNodes, system.NumberOfSensors, system.NumberOfLoads)
    return [*(of() for of in count), system.NumberOfMarkers(), len(registered(mbs).contacts)]


@pytest.fixture
def items(mbs, bodies):
    """A ball of small facets above a block of large ones."""
    ball = ep.CreatePartitionBody(mbs, bodies[0], name="ball", referencePosition=TOP)
    return ball, ep.CreatePartitionBody(mbs, bodies[1], name="block")


def test_a_plan_leaves_the_model_as_it_is(mbs, items):
    before = content(mbs)
    carrier = mbs.CreateRigidBody(inertia=InertiaCuboid(1.0, [1.0, 1.0, 1.0]))
    with_carrier = content(mbs)
    for planned in (
        partial(plan_contact, mbs, *items, name="contact"),
        partial(plan_contact, mbs, *items, name="contact"),  # a name is free until the contact is built
        partial(plan_contact, mbs, items[0], ep.RigidPlane(), masterBody=carrier),
    ):
        assert planned().mechanics.evaluation.lam.sum() == 0.0
    for wrong in (
        {"passes": "two"},
        {"rows": "nodes"},
        {"formulation": "lagrange"},
        {"masterPatch": "side"},
        {"friction": -0.1},
    ):
        with pytest.raises(InputError):
            plan_contact(mbs, *items, **wrong)
    assert content(mbs) == with_carrier
    assert with_carrier != before
    contact = ep.CreatePartitionContact(mbs, *items, name="contact")
    assert content(mbs)[-1] == 1
    assert contact.name == "contact"


def test_the_finer_body_is_the_slave_if_nothing_else_is_said(mbs, items):
    ball, block = items
    sizes = [
        plan_contact(mbs, *pair, passes="given").mechanics.gaps.slave.surface.facet_size
        for pair in (items, items[::-1])
    ]
    finer = ball if sizes[0] < sizes[1] else block
    assert max(sizes) > 1.2 * min(sizes)
    for pair in (items, items[::-1]):
        plan = plan_contact(mbs, *pair)
        assert plan.sides[0][0] is finer
        assert plan.mechanics.gaps.slave.surface.facet_size == min(sizes)
        assert plan_contact(mbs, *pair, passes="given").sides[0][0] is pair[0]


def test_gaps_are_those_of_the_master(mbs, items):
    ball, block = items
    floor, carrier = ep.RigidPlane(), mbs.CreateRigidBody(inertia=InertiaCuboid(1.0, [1.0, 1.0, 1.0]))
    to_block, to_floor = plan_contact(mbs, ball, block), plan_contact(mbs, ball, floor, formulation="penalty")
    carried = plan_contact(mbs, ball, floor, masterBody=carrier)
    assert [type(plan.mechanics.gaps) for plan in (to_block, to_floor, carried)] == [PatchGaps, RigidGaps, RigidGaps]
    assert [plan.rigid for plan in (to_block, to_floor)] == [None, floor]
    assert [plan.carrier is None for plan in (to_block, to_floor, carried)] == [True, True, False]
    assert [len(plan.sides) for plan in (to_block, to_floor)] == [2, 1]
    assert [plan.mechanics.gaps.n - ball.body.n_dofs for plan in (to_block, to_floor)] == [block.body.n_dofs, 0]


def test_bodies_that_overlap_are_named(mbs, bodies):
    low = ep.CreatePartitionBody(mbs, bodies[0], name="ball", referencePosition=[*TOP[:2], TOP[2] - 2e-4])
    block = ep.CreatePartitionBody(mbs, bodies[1])
    with pytest.raises(PenetrationError, match=r"^the slave is body ('ball'|1), the master body ('ball'|1); "):
        plan_contact(mbs, low, block)
    other = exu.SystemContainer().AddSystem()
    with pytest.raises(InputError, match="slave: body 'ball' belongs to another model"):
        plan_contact(other, low, block)


def test_contacts_without_a_name_are_named_by_their_bodies(mbs, bodies, items):
    """Each has a name of its own, by which results tell it from others; names that are given stay."""
    ball, block = items
    nameless = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=[1, 0, 0])
    carrier = mbs.CreateRigidBody(inertia=InertiaCuboid(1.0, [1.0, 1.0, 1.0]))
    floor, wall = ep.RigidPlane(point=(0, 0, -1)), ep.RigidPlane(point=(0, 0, -2))
    names = [
        ep.CreatePartitionContact(mbs, first, second, **options).name
        for first, second, options in (
            (ball, block, {}),
            (ball, floor, {"name": "ball on plane 2"}),
            (ball, wall, {}),
            (nameless, wall, {}),
            (nameless, ep.RigidSphere((0, 0, -2), 1.0), {"masterBody": carrier}),
        )
    ]
    assert names == [
        "ball on block",
        "ball on plane 2",
        "ball on plane 2 (2)",  # for the name is taken
        "body 2 on plane 2",
        "body 2 on sphere",
    ]
    assert all(int(mbs.GetSensorNumber(name)) >= 0 for name in names)
