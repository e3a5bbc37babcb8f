"""A link that would yield in bending or torsion, away from contacts, against beam theory."""

import tracemalloc
import warnings
from dataclasses import replace

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
import pytest
from oracles import box, ground

import exudyn_partition as ep
from exudyn_partition.errors import YieldWarning
from exudyn_partition.simulation.reviews.bending import surface_stress

LENGTH, WIDTH, HEIGHT = 0.08, 0.010, 0.006
LIMIT = ep.ALUMINIUM.yield_stress
BENDS = LIMIT * WIDTH * HEIGHT**2 / 6  # moment at which beam theory has the yield stress [N m]


@pytest.fixture(scope="module")
def body():
    """A column along z with an interface at each end."""
    shape = box(WIDTH, HEIGHT, LENGTH)
    shape.faces.Min(occ.Z).name, shape.faces.Max(occ.Z).name = "foot", "head"
    fem = ep.fe_model(shape, ep.ALUMINIUM, maxh=8e-3)
    ends = [ep.Partition.interface(fem, name, name) for name in ("foot", "head")]
    return ep.reduce(fem, ends[0] | ends[1], f_cut=5e3)


def loaded(body, moment, frame="inertial"):
    """Result of a static run under a moment on the head (3,) [N m], clamped foot; and the body."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, name="link", frame=frame)
    foot, head = (item.CreateInterfaceMarker(mbs, name) for name in ("foot", "head"))
    mbs.AddObject(items.GenericJoint(markerNumbers=[ground(mbs), foot], constrainedAxes=[1] * 6))
    mbs.AddLoad(items.LoadTorqueVector(markerNumber=head, loadVector=list(moment)))
    mbs.Assemble()
    return ep.solve_static(mbs, load_steps=1), item


@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_a_link_that_bends_beyond_yield_is_told(body, frame):
    """From 1.1 times what beam theory says; nothing at 0.85 of it."""
    with pytest.warns(
        YieldWarning, match=r"'link' at t = 1 of the load steps: the von Mises stress of its surface .* away from its"
    ):
        loaded(body, [1.1 * BENDS, 0, 0], frame)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        loaded(body, [0.85 * BENDS, 0, 0], frame)


def stress_between(body, item, result, low, high):
    """Stress of the surface between two heights, (k,) [Pa], at the end."""
    inside = (body.points[:, 2] > low) & (body.points[:, 2] < high)
    deformed = item.kinematics.deformed(item.coordinates(result))[-1:]
    return surface_stress(body, body.facets[inside[body.facets].all(axis=1)], deformed, body.material)[0][0]


def test_bending_is_that_of_beams(body):
    """Largest on the wider sides, M / W, and the same along the link."""
    result, item = loaded(body, [0.3 * BENDS, 0, 0])
    assert stress_between(body, item, result, 0.3 * LENGTH, 0.7 * LENGTH).max() == pytest.approx(0.3 * LIMIT, rel=0.03)


def test_torsion_is_that_of_a_round_bar():
    """T R / J all over the surface."""
    radius = 0.005
    shape = occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, radius, LENGTH)
    shape.faces.Min(occ.Z).name, shape.faces.Max(occ.Z).name = "foot", "head"
    fem = ep.fe_model(shape, ep.ALUMINIUM, maxh=4e-3)
    ends = ep.Partition.interface(fem, "foot", "foot") | ep.Partition.interface(fem, "head", "head")
    twisted = ep.reduce(fem, ends, f_cut=5e3)
    result, item = loaded(twisted, [0, 0, 5.0])
    shear = 2 * 5.0 / (np.pi * radius**3)
    np.testing.assert_allclose(
        stress_between(twisted, item, result, 0.2 * LENGTH, 0.8 * LENGTH), np.sqrt(3) * shear, rtol=0.1
    )


def test_what_has_no_yield_stress_or_several_materials_is_not_judged():
    soft, hard = ep.Material(E=2e9, nu=0.3, rho=1200.0, yield_stress=30e6), ep.ALUMINIUM
    lower, upper = box(WIDTH, HEIGHT, LENGTH / 2), box(WIDTH, HEIGHT, LENGTH / 2).Move((0, 0, LENGTH / 2))
    lower.solids.name, upper.solids.name = "hard", "soft"
    for shape, material in (
        (occ.Glue([lower, upper]), {"hard": hard, "soft": soft}),
        (box(WIDTH, HEIGHT, LENGTH), ep.Material(E=70e9, nu=0.3, rho=2700.0)),
    ):
        fem = ep.fe_model(shape, material, maxh=8e-3)
        ends = [
            ep.Partition.interface(fem, name, plane=((0, 0, z), (0, 0, side)))
            for name, z, side in (("foot", 0, -1), ("head", LENGTH, 1))
        ]
        body = ep.reduce(fem, ends[0] | ends[1], f_cut=1e3)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            loaded(body, [2 * BENDS, 0, 0], "floating")


def test_a_body_of_all_its_nodes_is_reviewed_in_little_memory():
    """A matrix of facets and coordinates would take 200 MB for each of its parts."""
    fem = ep.fe_model(box(WIDTH, HEIGHT, LENGTH), ep.ALUMINIUM, maxh=4e-3)
    end = ep.Partition.ball(fem, (0, 0, LENGTH), 4e-3)
    body = ep.reduce(fem, replace(end, nodes=np.arange(fem.n_nodes)), basis="free", f_cut=5e3)
    assert body.n_dofs > 1500
    mbs = exu.SystemContainer().AddSystem()
    ep.CreatePartitionBody(mbs, body, name="link")
    mbs.Assemble()
    tracemalloc.start()
    ep.solve_dynamic(mbs, end_time=1e-6, step=1e-8)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 50e6
