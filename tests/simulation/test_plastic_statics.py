"""Equilibrium of a patch that yields: large load steps, and the next load."""

from dataclasses import replace

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
import pytest
from oracles import small_zone

import exudyn_partition as ep

MATERIAL = ep.Material(E=70e9, nu=0.33, rho=2700.0, yield_stress=240e6, hardening=500e6)
RADIUS, SIDE, HEIGHT, REACH, FORCE = 5e-3, 6e-3, 3e-3, 0.35e-3, 25.0


@pytest.fixture(scope="module", params=[500e6, 0.0], ids=["hardening", "perfect"])
def body(request):
    """A block of aluminium that yields on its top, with its bottom as interface."""
    material = replace(MATERIAL, hardening=request.param)
    shape = occ.Box((-SIDE / 2, -SIDE / 2, -HEIGHT), (SIDE / 2, SIDE / 2, 0))
    shape.faces.Min(occ.Z).name = "bottom"
    fem = ep.fe_model(shape, material, maxh=3e-3, refine=[ep.Refine((0, 0, 0), 0.45e-3, 0.15e-3)], grading=0.6)
    top = ep.Partition.ball(fem, (0, 0, 0), REACH, direction=(0, 0, 1), plastic_radius=0.45e-3)
    return ep.reduce(fem, top | ep.Partition.interface(fem, "bottom", "bottom", kind="averaged"), f_cut=150e3)


def pressed(body, load_steps, state=None, places=((0, 0, 0),)):
    """Contacts and result of rigid balls, against which a force presses the block from below."""
    mbs = exu.SystemContainer().AddSystem()
    block = ep.CreatePartitionBody(mbs, body, plasticStates=None if state is None else {0: state})
    bottom = block.CreateInterfaceMarker(mbs, "bottom")
    ground = mbs.CreateGround(referencePosition=[0, 0, -HEIGHT])
    guide = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground))
    mbs.AddObject(items.ObjectJointGeneric(markerNumbers=[guide, bottom], constrainedAxes=[1, 1, 0, 1, 1, 1]))
    mbs.AddObject(items.CartesianSpringDamper(markerNumbers=[guide, bottom], stiffness=[0, 0, 1e4]))
    mbs.AddLoad(items.LoadForceVector(markerNumber=bottom, loadVector=[0, 0, FORCE * len(places)]))
    balls = [ep.RigidSphere(center=np.add(place, (0, 0, RADIUS)), radius=RADIUS) for place in places]
    contacts = [ep.CreatePartitionContact(mbs, block, ball, slavePatch=i) for i, ball in enumerate(balls)]
    mbs.Assemble()
    with small_zone():
        return contacts, ep.solve_static(mbs, load_steps=load_steps)


def test_large_load_steps_settle_and_the_next_load_is_elastic(body):
    (contact,), result = pressed(body, 5)
    assert result.steps == 5  # none was divided
    assert contact.force(result)[-1] == pytest.approx(FORCE, rel=0.01)  # the spring has the rest
    work = contact.plastic.work(result)[-1]
    (state,) = contact.plastic.states(result).values()
    (again,), repeated = pressed(body, 2, state)
    assert again.force(repeated)[-1] == pytest.approx(contact.force(result)[-1], rel=1e-3)
    assert again.plastic.work(repeated)[-1] < 1e-3 * work
    assert np.all(np.diff(contact.plastic.work(result)) >= 0)


def test_small_load_steps_agree(body):
    forces, works = [], []
    for steps in (5, 20):
        (contact,), result = pressed(body, steps)
        forces.append(contact.force(result)[-1])
        works.append(contact.plastic.work(result)[-1])
    assert forces[1] == pytest.approx(forces[0], rel=1e-4)
    assert works[1] == pytest.approx(works[0], rel=0.01)


def test_contacts_on_one_body_settle_too():
    """Each contact corrects its own part of the stiffness."""
    places = [np.array([x, 0, 0]) for x in (-2.4e-3, 2.4e-3)]
    shape = occ.Box((-4.5e-3, -3e-3, -HEIGHT), (4.5e-3, 3e-3, 0))
    shape.faces.Min(occ.Z).name = "bottom"
    refine = [ep.Refine(place, 0.4e-3, 0.15e-3) for place in places]
    fem = ep.fe_model(shape, MATERIAL, maxh=3e-3, refine=refine, grading=0.7)
    first, second = (
        ep.Partition.ball(fem, place, REACH, direction=(0, 0, 1), plastic_radius=0.33e-3) for place in places
    )
    bottom = ep.Partition.interface(fem, "bottom", "bottom", kind="averaged")
    contacts, result = pressed(ep.reduce(fem, first | second | bottom, f_cut=100e3), 6, places=places)
    assert result.steps == 6
    assert sum(contact.force(result)[-1] for contact in contacts) == pytest.approx(2 * FORCE, rel=0.01)
    assert all(contact.plastic.work(result)[-1] > 0 for contact in contacts)
