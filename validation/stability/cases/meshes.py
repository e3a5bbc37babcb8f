"""Slivers, fine meshes, bodies of one element."""

import numpy as np

import exudyn_partition as ep
from validation.stability.cases.registry import case
from validation.stability.scenes import (
    UNIT,
    ball,
    ball_model,
    bar_model,
    error,
    grid,
    hertz,
    kept,
    penetration,
    read,
    strike,
)


def bar_hits_wall(method, z, **model):
    """Saint-Venant: 0.4 N for twice the length over the wave speed, the velocity is reversed.

    The last modes below `f_cut` keep vibrating. By `f_cut` that takes 0 to 3.1 % of the speed, and which frequency the
    mesh resolves differs a little between machines.
    """
    fem, part = bar_model(tuple(z), UNIT, **model)
    body = ep.reduce(fem, part, f_cut=min(0.45, fem.resolved_frequency))
    run = strike(method, body, speed=0.1, gap=0.05, end_time=26.0, step=0.02)
    force = run.force
    t = run.result.t
    middle = (t > 5.5) & (t < 15.5)
    window = np.hanning(middle.sum())
    return kept(run) | {
        "force": error(window @ force[middle] / window.sum(), 0.4, 0.03),
        "speed after": error(run.velocity()[-1, 2], 0.1, 0.04),
    }


@case(
    "bar on a wall",
    "Saint-Venant, force 3 %, speed 4 %; warns that a flat end rings",
    quick=True,
    warns=("ModelLimitWarning",),
)
def regular_bar(method):
    return bar_hits_wall(method, np.linspace(0, 10, 31))


@case(
    "slivers of 1:1e4",
    "Saint-Venant, force 3 %, speed 4 %; warns of the slivers",
    warns=("MeshQualityWarning", "ModelLimitWarning"),
)
def slivers(method):
    z = np.linspace(0, 10, 31)
    return bar_hits_wall(method, np.sort(np.r_[z, 4.0 + 1e-4, 8.0 + 1e-4]))


@case(
    "sliver at the contact, 1:1e3",
    "Saint-Venant, force 3 %, speed 4 %; warns of the slivers",
    warns=("MeshQualityWarning", "ModelLimitWarning"),
)
def sliver_at_contact(method):
    return bar_hits_wall(method, np.sort(np.r_[np.linspace(0, 10, 31), 1e-3]))


@case(
    "elements without volume",
    "InvertedElementsError",
    methods=("explicit",),
    raises="InvertedElementsError",
    quick=True,
)
def flat_elements(method):
    z = np.array([0.0, 1.0, 1.0, 2.0])
    bar_model(tuple(z), UNIT)


@case("0.02 mm local mesh", "Hertz 5 %; the step is not that of the mesh")
def fine_mesh(method):
    body = ball(h=0.002, reach=0.0065)
    run = strike(method, body, speed=1e-3, end_time=320e-6)
    return kept(run) | hertz(run, 1e-3) | {"0.1 us over the step": (1e-7 / run.result.step, 1.0)}


@case("0.02 mm local mesh, nodes with mass", "StepSizeError", methods=("explicit",), raises="StepSizeError")
def fine_mesh_with_mass(method):
    fem, part = ball_model(h=0.002, reach=0.0065)
    body = ep.reduce(fem, part, basis="free", f_cut=150e3)
    strike(method, body, contact={"formulation": "lagrange"}, end_time=1e-6, step=0.2e-6)


@case(
    "one linear hexahedron, all nodes kept",
    "no penetration; the nodes that meet lose their half of the energy, which warns",
    quick=True,
    warns=("ModelLimitWarning",),
)
def one_element(method):
    points, cells = grid([0, 1.0], [0, 1.0], [0, 1.0])
    fem = read(points, "hexahedron", cells, UNIT)
    body = ep.reduce(fem, ep.Partition.ball(fem, (0.5, 0.5, 0), 2.0, contact_radius=0.9), basis="free", f_cut=0.1)
    lagrange = {"formulation": "lagrange"}
    run = strike(method, body, speed=1e-3, gap=1e-3, contact=lagrange, end_time=8.0, step=0.02)
    return kept(run, energy=0.51) | {
        "energy made": (float(run.energy.max() / run.energy[0] - 1), 1e-3),
        "penetration over approach": (penetration(run) / 1e-3, 1e-2),
        "pushed back": (float(run.velocity()[-1, 2] <= 0), 0.0),
    }


@case("one quadratic tetrahedron, default basis", "no mode is resolved: rigid but for its contact; energy",
      quick=True)  # fmt: skip
def one_tetrahedron(method):
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    middle = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]
    points = np.vstack([points, [points[list(m)].mean(axis=0) for m in middle]])
    fem = read(points, "tetra10", np.arange(10)[None], UNIT)
    body = ep.reduce(
        fem, ep.Partition.ball(fem, (0.4, 0.1, 0), 0.6, direction=(0, 0, -1)), f_cut=fem.resolved_frequency
    )
    return kept(strike(method, body, speed=1e-3, gap=1e-3, end_time=10.0, step=0.01))
