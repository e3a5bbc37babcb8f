"""Springs and sensors on nodes without a static answer, against bodies that have it there."""

import re

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
import pytest
from oracles import box, ground, sensors

import exudyn_partition as ep
from exudyn_partition.errors import ModelLimitWarning

SIZE, RADIUS = 0.02, 0.003
STIFF, SOFT = 3e9, 1e6  # [N/m]


@pytest.fixture(scope="module")
def model():
    """A cube whose lower face is held, and the nodes around the middle of its upper one."""
    fem = ep.fe_model(box(SIZE, SIZE, SIZE), ep.STEEL, maxh=6e-3, refine=[ep.Refine((0, 0, SIZE), RADIUS, 1.5e-3)])
    foot = ep.Partition.interface(fem, "foot", plane=((0, 0, 0), (0, 0, -1)))
    top = (abs(fem.points[:, 2] - SIZE) < 1e-9) & (np.linalg.norm(fem.points[:, :2], axis=1) < RADIUS)
    return fem, foot, np.flatnonzero(top)


@pytest.fixture(scope="module")
def bodies(model):
    """Without a static answer at these nodes, and with it."""
    fem, foot, nodes = model
    answered = foot | ep.Partition.interface(fem, "top", nodes, kind="averaged")
    return [ep.reduce(fem, part, f_cut=0.5 * fem.resolved_frequency) for part in (foot, answered)]


def held(body, nodes, weights):
    """Model of the cube on a joint, and the marker of the nodes."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, name="cube")
    foot = item.CreateInterfaceMarker(mbs, "foot")
    mbs.AddObject(items.GenericJoint(markerNumbers=[ground(mbs), foot], constrainedAxes=[1] * 6))
    number = item["oFFRFreducedOrder"]
    mean = items.MarkerSuperElementPosition(bodyNumber=number, meshNodeNumbers=nodes, weightingFactors=weights)
    return mbs, mbs.AddMarker(mean)


def pressed(body, nodes, weights, sensed=True):
    """Displacement of the nodes under 1 N, by a sensor on the loaded marker, or None without one."""
    mbs, marker = held(body, nodes, weights)
    mbs.AddLoad(items.LoadForceVector(markerNumber=marker, loadVector=[0, 0, -1.0]))
    (sensor,) = sensors(mbs, marker, [exu.OutputVariableType.Displacement]) if sensed else (None,)
    mbs.Assemble()
    result = ep.solve_static(mbs, load_steps=1)
    return -result.sensor(sensor)[-1, 2] if sensed else None


def test_what_a_sensor_misses_is_told(model, bodies):
    """By a factor of two; nothing is told with the static answer, and of a load that nothing reads."""
    nodes = model[2]
    weights = bodies[1].partition.find_interface("top").weights
    with pytest.warns(ModelLimitWarning, match="sensor .* reads where load .* lacks their local dent") as caught:
        stiff = pressed(bodies[0], nodes, weights)
    true = pressed(bodies[1], nodes, weights)
    share = float(re.search(r"m/N, ([\d.]+) of the flexibility", str(caught[0].message))[1])
    assert 0.5 < share / (1 - stiff / true) < 2
    pressed(bodies[0], nodes, weights, sensed=False)


@pytest.mark.parametrize(("stiffness", "told"), [(STIFF, True), (SOFT, False)])
def test_a_stiff_spring_finds_a_body_too_stiff(model, bodies, stiffness, told):
    nodes = model[2]
    weights = bodies[1].partition.find_interface("top").weights
    for body in bodies:
        mbs, marker = held(body, nodes, weights)
        ends = [ground(mbs, (0, 0, SIZE)), marker]
        mbs.AddObject(items.CartesianSpringDamper(markerNumbers=ends, stiffness=[stiffness] * 3))
        mbs.Assemble()
        if told and len(body.partition.interfaces) == 1:
            with pytest.warns(ModelLimitWarning, match="ConnectorCartesianSpringDamper .* lacks their local dent"):
                ep.solve_static(mbs, load_steps=1)
        else:
            ep.solve_static(mbs, load_steps=1)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_spring_at_a_point_of_a_thin_ring_is_judged_without_a_word_of_numpy():
    """Some nodes around the point have negative weights, and so may their spread, of which NumPy took the root."""
    outside, wall, width = 0.0205, 0.001, 0.004
    rims = [occ.Cylinder((0, -width / 2, 0), occ.Y, radius, width) for radius in (outside, outside - wall)]
    fem = ep.fe_model(rims[0] - rims[1], ep.STEEL, maxh=6e-3)
    patch = ep.Partition.surface(fem, cylinder=((0, 0, 0), (0, 1, 0), outside), name="rim")
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, ep.reduce(fem, patch, f_cut=3e3))
    ends = [ground(mbs, (outside, 0, 0)), item.CreatePointMarker(mbs, (outside, 0, 0))]
    mbs.AddObject(items.CartesianSpringDamper(markerNumbers=ends, stiffness=[SOFT] * 3))
    mbs.Assemble()
    assert ep.solve_dynamic(mbs, end_time=1e-6, step=1e-6).status == "finished"
