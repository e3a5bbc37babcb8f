"""A law of one's own that acts ahead of each step, from the contributing page alone: a stiff layer on the rows."""

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
import pytest
from oracles import TOP, contributed, relative

import exudyn_partition as ep
from exudyn_partition.errors import RunError

pytestmark = pytest.mark.filterwarnings("ignore::exudyn_partition.errors.ModelLimitWarning")


def strike(bodies, formulation, method="explicit", friction=None, speed=(0, 0, -0.5)):
    """A ball strikes a block."""
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP, initialVelocity=speed)
    block = ep.CreatePartitionBody(mbs, bodies[1])
    contact = ep.CreatePartitionContact(mbs, ball, block, formulation=formulation, friction=friction, name="tip")
    mbs.Assemble()
    step = None if method == "explicit" else 0.2e-6
    result = ep.solve_dynamic(mbs, end_time=10e-6, step=step, method=method, sample_period=0.2e-6)
    return result, (ball, block), contact


def layers(stiffness):
    """The formulation of the page with a stiffness of its rows [N/m]."""
    page = contributed("class Layer(Law)")
    page["K"] = stiffness
    return page["Layers"]()


@pytest.mark.parametrize("friction", [None, 0.3])
@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_momentum_is_kept_and_energy_never_grows(pair_of, method, friction):
    speed = (0.3 if friction else 0.0, 0, -0.5)
    result, bodies, contact = strike(pair_of("free"), layers(1e8), method, friction, speed)
    momentum = sum(item.momentum(result) for item in bodies)
    assert contact.force(result).max() > 100
    assert abs(momentum - momentum[0]).max() < 1e-6 * abs(momentum[0]).max()
    energy = sum(item.energy(result) for item in bodies)
    assert energy.max() < energy[0] * (1 + 2e-3)
    if friction:
        along = np.linalg.norm(contact.friction.tangential_force(result), axis=1)
        assert 0 < along.max() <= friction * contact.force(result).max()
        assert contact.friction.work(result)[-1] > 0


def test_a_stiff_layer_is_a_multiplier_and_a_soft_one_yields(pair_of):
    nodal, force = pair_of("free"), {}
    for name, formulation in (("stiff", layers(1e13)), ("soft", layers(1e6)), ("rigid", "lagrange")):
        result, _, contact = strike(nodal, formulation)
        force[name] = contact.force(result)
    assert relative(force["stiff"], force["rigid"]) < 1e-2
    assert force["soft"].max() < 0.8 * force["rigid"].max()


def test_laws_that_differ_are_not_solved_by_one_of_them(pair_of):
    """In a model with joints one law finds the forces of all contacts ahead of a step."""
    nodal, mbs = pair_of("free"), exu.SystemContainer().AddSystem()
    block = ep.CreatePartitionBody(mbs, nodal[1])
    ball = ep.CreatePartitionBody(mbs, nodal[0], referencePosition=TOP, initialVelocity=(0, 0, -0.5))
    ep.CreatePartitionContact(mbs, ball, block, formulation=layers(1e7))
    others = [
        ep.CreatePartitionBody(mbs, body, referencePosition=np.add(at, (0.1, 0, 0)))
        for body, at in zip(nodal, (TOP, (0, 0, 0)), strict=True)
    ]
    ep.CreatePartitionContact(mbs, *others, formulation=layers(1e6))
    ground = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(items.NodePointGround()), coordinate=0))
    first = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=block.nodes[0], coordinate=0))
    mbs.AddObject(items.CoordinateConstraint(markerNumbers=[ground, first]))
    mbs.Assemble()
    with pytest.raises(RunError, match="one law has to find all their forces"):
        ep.solve_dynamic(mbs, end_time=1e-6)
