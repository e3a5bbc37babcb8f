"""A puck under load on a rigid plane, in every formulation with friction: it slides, sticks and keeps balances."""

import exudyn as exu
import numpy as np
import pytest
from exudyn.utilities import InertiaCuboid
from oracles import add_force, box

import exudyn_partition as ep

MU, LOAD, SPEED = 0.2, 2e4, 1.0  # the load is a mass times this acceleration [m/s2], the speed in m/s
END = 60e-6
STEPS = {"explicit": None, "implicit": 0.2e-6}

WAYS = [("penalty", "residual"), ("penalty", "craig-bampton"), ("lagrange", "craig-bampton")]


@pytest.fixture(scope="session")
def puck(kept):
    """A steel puck of 8 x 8 x 2 mm with its lower face at z = 0, by the name of a basis."""
    fem = ep.fe_model(box(0.008, 0.008, 0.002), ep.STEEL, maxh=2.5e-3)
    part = ep.Partition.ball(fem, (0, 0, 0), 2.5e-3, axes="xyz")
    return lambda basis: ep.reduce(fem, part, basis=basis, f_cut=400e3, cache=kept)


@pytest.fixture(params=["explicit", "implicit"])
def method(request):
    return request.param


def slide(body, formulation, *, speed=SPEED, push=0.0, friction=MU, load=LOAD, end=END, **options):
    """The puck under a load and a push along x, both accelerations; it begins with a speed along x."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, initialVelocity=[speed, 0, 0])
    add_force(mbs, item, body.total_mass * np.array([push, 0.0, -load]))
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), formulation=formulation, friction=friction)
    mbs.Assemble()
    return item, contact, ep.solve_dynamic(mbs, end_time=end, **options)


@pytest.mark.parametrize(("formulation", "basis"), WAYS)
@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.PartitionWarning")  # the patch ends within the face
def test_a_sliding_puck_decelerates_at_mu_g(puck, formulation, basis, method):
    """Its momentum falls by mu times the impulse of the normal force, which is what the load leaves unbalanced."""
    body = puck(basis)
    item, contact, result = slide(body, formulation, method=method, end=0.3 * END, step=STEPS[method])
    velocity = item.momentum(result) / body.total_mass
    normal = LOAD * result.t[-1] + velocity[-1, 2]  # impulse of the plane on the puck, by its mass
    assert velocity[-1, 0] - SPEED == pytest.approx(-MU * normal, rel=1e-3)
    assert normal == pytest.approx(LOAD * result.t[-1], rel=0.05)  # it rings under the load
    taken = 0.5 * body.total_mass * (SPEED**2 - velocity[-1, 0] ** 2)
    assert contact.dissipated_energy(result)[-1] == pytest.approx(taken, rel=5e-3)


@pytest.mark.parametrize(("formulation", "basis"), WAYS)
@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.PartitionWarning")
def test_a_push_below_the_limit_moves_nothing(puck, formulation, basis):
    """The puck stays: it swings on its elastic rows, by a small share of the way that it would go."""
    push = 0.25 * MU * LOAD
    item, _, result = slide(puck(basis), formulation, speed=0.0, push=push)
    velocity = item.momentum(result)[:, 0] / item.body.total_mass
    way = np.trapezoid(velocity, result.t)
    assert abs(way) < 0.04 * 0.5 * push * END**2


@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_energy_and_friction_of_an_impact_on_a_layer(mbs, round_body, method):
    """What bodies and layer lose is what friction takes."""
    item = ep.CreatePartitionBody(mbs, round_body, referencePosition=[0, 0, 1e-6], initialVelocity=[0.2, 0, -0.3])
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), formulation="penalty", friction=MU)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=70e-6, step=0.4e-6, method=method)
    total = item.energy(result) + contact.energy(result) + contact.dissipated_energy(result)
    assert abs(total / total[0] - 1).max() < 1e-4
    assert contact.dissipated_energy(result)[-1] > 0.05 * total[0]


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.PartitionWarning")  # the whole face closes at once
def test_rounding_of_a_stiff_patch_does_not_hold_up_newtons_method():
    """A light block on a moving belt: its rows turn the rounding of places into more force than a fixed residual."""
    fem = ep.fe_model(box(0.02, 0.02, 0.01), ep.STEEL, maxh=10e-3)
    part = ep.Partition.ball(fem, (0, 0, 0), 0.016, direction=(0, 0, -1), axes="xyz")
    body = ep.reduce(fem, part, f_cut=60e3)
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, gravity=[0, 0, -9.81], initialVelocity=[0.05, 0, 0])
    belt = mbs.CreateRigidBody(inertia=InertiaCuboid(1e4, [0.1, 0.1, 0.1]), initialVelocity=[0.05, 0, 0])
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), masterBody=belt, friction=0.3)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=16e-3, step=0.4e-3, method="implicit", spectral_radius=0.5)
    assert (result.status, result.steps) == ("finished", 40)
    assert result.work.newton_iterations < 8 * result.steps
    carried = body.total_mass * 9.81 / (1 + body.total_mass / (1e4 * 0.1**3))  # the belt, 10 kg, sinks
    assert contact.force(result)[-1] == pytest.approx(carried, rel=1e-4)
