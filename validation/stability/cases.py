"""The stiff and extreme cases: each function makes a run and returns what must hold, name -> (value, limit).

`@case` says what must happen: that all of it holds, with the library's warnings in `warns` and no other, or that the
error in `raises` comes. Functions take the integrator, "explicit" or "implicit".
"""

import contextlib
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
from exudyn.utilities import InertiaSphere
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.contact.formulations.penalty import bed_stiffness
from validation.stability.scenes import (
    PLANE,
    RADIUS,
    Run,
    ball,
    ball_in_units,
    ball_model,
    bar_model,
    block,
    error,
    finite,
    free_flexibility,
    grid,
    hertz,
    kept,
    penetration,
    read,
    strike,
)

BOTH = ("explicit", "implicit")
QUIET = {"progress": lambda share: None}
CASES = []


@dataclass(frozen=True)
class Case:
    """One line of the table, for each integrator in `methods`; those in tests are `quick`."""

    name: str
    must: str
    function: Callable
    methods: tuple = BOTH
    raises: str = ""
    warns: tuple = ()
    quick: bool = False


def case(name, must, **options):
    def register(function):
        CASES.append(Case(name, must, function, **options))
        return function

    return register


def soft(factor):
    """Steel softened by a factor, and as light as a foam: waves slower than in any solid would warn."""
    return ep.Material(E=210e9 * factor, nu=0.3, rho=2000.0)


# Speeds


@case("ball on plane at 1 m/s", "Hertz 5 %, bounce 2 %", quick=True)
def plain(method):
    run = strike(method, ball(), end_time=80e-6)
    return kept(run) | hertz(run, 1.0)


def slow(method, speed):
    """One node touches: a mass on a linear spring, of which the FE model's static answer is the stiffness."""
    fem, part = ball_model()
    contact = run_nodes(fem, part)
    stiffness = 1 / free_flexibility(fem, contact)
    mass = fem.total_mass
    period = math.pi * math.sqrt(mass / stiffness)
    run = strike(method, ball(), speed=speed, end_time=1.5 * period)
    impact = run.contacts[0].impacts(run.result)
    return kept(run) | {
        "one impact": (float(len(impact) != 1), 0.0),
        "peak force": error(run.force.max(), speed * math.sqrt(mass * stiffness), 0.02),
        "duration": error(impact[0].end - impact[0].start, period, 0.03),
        "speed after": error(run.velocity()[-1, 2], speed, 1e-3),
    }


def run_nodes(fem, part):
    """Return the patch's lowest node."""
    nodes = part.patch_nodes
    return int(nodes[fem.points[nodes, 2].argmin()])


@case(
    "speed 1e-6 m/s",
    "one node as a spring with the FE model's stiffness, 3 %",
    quick=True,
    warns=("ModelLimitWarning",),
)
def slowest(method):
    return slow(method, 1e-6)


@case(
    "speed 1e-9 m/s",
    "as at 1e-6 m/s: the model is linear, and dents of 1e-14 m keep digits",
    quick=True,
    warns=("ModelLimitWarning",),
)
def slowest_of_all(method):
    return slow(method, 1e-9)


@case("speed 100 m/s, patch for 1 m/s", "warns that the contact left its patch", warns=("ContactPatchWarning",))
def too_fast(method):
    run = strike(method, ball(), speed=100.0, end_time=20e-6)
    return kept(run, solve=False, energy=5e-3)


@case("speed 100 m/s", "Hertz 20 % on a patch that is large enough: the ball is no half-space then")
def fast(method):
    body = ball(h=0.08, reach=0.5)
    run = strike(method, body, speed=100.0, end_time=40e-6, step=0.1e-6)
    return kept(run) | hertz(run, 100.0, force=0.20, bounce=0.05)


# Stiffness, mass, Poisson's ratio


@case("stiffness ratio 1e6, soft ball on steel", "Hertz 5 %")
def soft_ball(method):
    steps = {"step": 25e-6} if method == "implicit" else {}
    run = strike(method, ball(material=soft(1e-6)), block(), speed=1e-3, end_time=80e-3, sample_period=25e-6, **steps)
    both = run.bodies[0].body.total_mass * run.bodies[1].body.total_mass
    both /= sum(item.body.total_mass for item in run.bodies)
    return kept(run) | hertz(run, 1e-3, material=soft(1e-6), force=0.05, bounce=0, mass=both)


@case("stiffness ratio 1e6, steel ball on soft block", "momentum, energy, complementarity")
def soft_block(method):
    steps = {"step": 25e-6} if method == "implicit" else {}
    run = strike(method, ball(), block(soft(1e-6)), speed=1e-3, end_time=30e-3, sample_period=25e-6, **steps)
    return kept(run)


@case("mass ratio 1e6, light ball", "bounces off as from a wall, 2 %")
def light_ball(method):
    light = ep.Material(E=210e9, nu=0.3, rho=7800e-6)
    run = strike(method, ball(material=light), block(), speed=1e3, end_time=80e-9)
    after = ep.hertz.impact(run.bodies[0].body.total_mass, 1e3, RADIUS, np.inf, light, ep.STEEL)
    return kept(run) | {
        "peak force": error(run.force.max(), after.peak_force, 0.15),
        "speed after": error(run.velocity()[-1, 2], 1e3, 0.02),
    }


@case("mass ratio 1e6, plane carried by a rigid body", "Hertz 5 %, bounce 1e-3, momentum of both")
def heavy_carrier(method):
    mass, mbs = ball().total_mass, exu.SystemContainer().AddSystem()
    upper = ep.CreatePartitionBody(mbs, ball(), name="upper", initialVelocity=[0, 0, -1.0])
    frame = mbs.CreateRigidBody(
        inertia=InertiaSphere(1e6 * mass, 1.0), nodeType=exu.NodeType.RotationRotationVector, returnDict=True
    )
    contact = ep.CreatePartitionContact(mbs, upper, PLANE, masterBody=frame["bodyNumber"])
    kind = exu.OutputVariableType.Velocity
    sensor = mbs.AddSensor(
        items.SensorNode(nodeNumber=frame["nodeNumber"], outputVariableType=kind, storeInternal=True)
    )
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, method=method, end_time=80e-6, **QUIET)
    run = Run(result, [upper], [contact], mass)
    momentum = upper.momentum(result)[:, 2] + 1e6 * mass * result.sensor(sensor)[:, 2]
    return {
        "not finite": (float(np.count_nonzero(~np.isfinite(momentum))), 0.0),
        "momentum": (float(abs(momentum - momentum[0]).max() / mass), 1e-6),
    } | hertz(run, 1.0, bounce=1e-3)


@case("nu 0.4999, quadratic elements", "Hertz 10 %")
def incompressible(method):
    material = ep.Material(E=210e9, nu=0.4999, rho=7800.0)
    run = strike(method, ball(material=material), end_time=80e-6)
    return kept(run) | hertz(run, 1.0, material=material, force=0.10, bounce=0.05)


@case("nu 0.4999, linear elements", "LockingError", methods=("explicit",), raises="LockingError", quick=True)
def locking(method):
    ball_model(material=ep.Material(E=210e9, nu=0.4999, rho=7800.0), order=1)


@case("nu -0.9", "Hertz 20 %: without much bulk modulus the whole ball yields too")
def auxetic(method):
    material = ep.Material(E=210e9, nu=-0.9, rho=7800.0)
    run = strike(method, ball(material=material), end_time=60e-6)
    return kept(run) | hertz(run, 1.0, material=material, force=0.20)


# Meshes

UNIT = ep.Material(E=1.0, nu=0.0, rho=1.0)


def bar_hits_wall(method, z, limit=0.03, **model):
    """Saint-Venant: 0.4 N for twice the length over the wave speed, the velocity turned around."""
    fem, part = bar_model(tuple(z), UNIT, **model)
    body = ep.reduce(fem, part, f_cut=min(0.45, fem.resolved_frequency))
    run = strike(method, body, speed=0.1, gap=0.05, end_time=26.0, step=0.02)
    force = run.force
    t = run.result.t
    middle = (t > 5.5) & (t < 15.5)
    window = np.hanning(middle.sum())
    return kept(run) | {
        "force": error(window @ force[middle] / window.sum(), 0.4, limit),
        "speed after": error(run.velocity()[-1, 2], 0.1, limit),
    }


@case("bar on a wall", "Saint-Venant 3 %; warns that a flat end rings", quick=True, warns=("ModelLimitWarning",))
def regular_bar(method):
    return bar_hits_wall(method, np.linspace(0, 10, 31))


@case("slivers of 1:1e4", "Saint-Venant 3 %; warns of the slivers", warns=("MeshQualityWarning", "ModelLimitWarning"))
def slivers(method):
    z = np.linspace(0, 10, 31)
    return bar_hits_wall(method, np.sort(np.r_[z, 4.0 + 1e-4, 8.0 + 1e-4]))


@case(
    "sliver at the contact, 1:1e3",
    "Saint-Venant 3 %; warns of the slivers",
    warns=("MeshQualityWarning", "ModelLimitWarning"),
)
def sliver_at_contact(method):
    return bar_hits_wall(method, np.sort(np.r_[np.linspace(0, 10, 31), 1e-3]))


@case("elements without volume", "MeshError", methods=("explicit",), raises="MeshError", quick=True)
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


@case("one linear hexahedron, all nodes kept", "no penetration; the nodes that meet lose their half of the energy",
      quick=True)  # fmt: skip
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


# Bases and regions


@case("no modes at all", "rigid but for its contact: energy; warns that f_cut may be in kHz", warns=("UnitsWarning",),
      quick=True)  # fmt: skip
def no_modes(method):
    body = ep.reduce(*ball_model(), f_cut=150.0)
    return kept(strike(method, body, speed=0.2, gap=1e-6, end_time=2e-4, step=0.5e-6))


@case(
    "no modes, region of the whole body",
    "the full FE model: no penetration; loses the eighth of its mass that meets",
    quick=True,
)
def whole_body(method):
    fem, _ = bar_model(tuple(np.linspace(0, 4, 5)), UNIT, across=1, kind="hexahedron")
    part = ep.Partition.ball(fem, (0, 0, 0), 100.0, contact_radius=1.5, direction=(0, 0, -1))
    body = ep.reduce(fem, part, basis="free", f_cut=0.1)
    run = strike(method, body, speed=0.1, gap=0.05, contact={"formulation": "lagrange"}, end_time=12.0, step=0.02)
    return kept(run, energy=0.13) | {
        "coordinates missing": (float(fem.n_dofs - body.n_dofs), 0.0),
        "penetration over side": (penetration(run) / 2.0, 1e-3),
        "speed after": error(run.velocity()[-1, 2], 0.1, 0.15),
    }


@case("region of the whole body, default basis", "InputError", methods=("explicit",), raises="InputError", quick=True)
def whole_body_adapted(method):
    fem, _ = bar_model(tuple(np.linspace(0, 4, 5)), UNIT, across=1, kind="hexahedron")
    ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 100.0, direction=(0, 0, -1)), f_cut=0.1)


def bar_of_modes(length, n, *, speed, gap, end, step=1e-3):
    """Speed of the centre of mass after a bar of `UNIT` and side 2 met a wall: n axial modes, a static rest."""
    mass, omega = 4.0 * length, np.r_[0.0, np.arange(1, n + 1) * math.pi / length]
    shapes = np.r_[1.0, np.full(n, math.sqrt(2))] / math.sqrt(mass)  # of the end that meets it
    rest = length / 12 - ((shapes / omega.clip(1e-300)) ** 2)[1:].sum()  # flexibility of a free bar: l / 3 E A
    q, q_t = np.zeros(n + 1), np.r_[-speed * math.sqrt(mass), np.zeros(n)]
    for _ in range(round(end / step)):
        force = max(0.0, -(gap + shapes @ q) / rest)
        q_t += step * (shapes * force - omega**2 * q)
        q += step * q_t
    return q_t[0] / math.sqrt(mass)


@case("all modes the mesh resolves", "speed after of a bar with so many axial modes 1 %; warns that a flat end rings",
      warns=("ModelLimitWarning",))  # fmt: skip
def all_modes(method):
    """Two axial modes: the bar keeps a fifth of its energy as vibration, where an exact one keeps none."""
    fem, part = bar_model(tuple(np.linspace(0, 4, 9)), UNIT)
    body = ep.reduce(fem, part, basis="residual", f_cut=fem.resolved_frequency)
    impact = {"speed": 0.1, "gap": 0.05}
    run = strike(method, body, end_time=12.0, sample_period=0.02, **impact)
    after = bar_of_modes(4.0, int(8 * body.f_cut), end=12.0, **impact)
    return kept(run, energy=5e-3) | {"speed after": error(run.velocity()[-1, 2], after, 0.01)}


@case("more modes than the mesh resolves", "FrequencyRangeError", methods=("explicit",), raises="FrequencyRangeError",
      quick=True)  # fmt: skip
def too_many_modes(method):
    ball(cut=100.0)


@case("region without a facet", "EmptyRegionError", methods=("explicit",), raises="EmptyRegionError", quick=True)
def one_node(method):
    fem, _ = ball_model()
    ep.Partition.ball(fem, (0, 0, 0), 1e-6)


@case(
    "region of one facet",
    "warns that the contact is at the edge of its patch",
    warns=("ContactPatchWarning", "ModelLimitWarning"),
)
def one_facet(method):
    fem, _ = ball_model()
    centres = fem.points[fem.facets[:, :3]].mean(axis=1)
    nearest = centres[np.linalg.norm(centres, axis=1).argmin()]
    reach = 1.001 * np.linalg.norm(fem.points - nearest, axis=1).min()
    part = ep.Partition.ball(fem, nearest, reach, direction=(0, 0, -1))
    run = strike(method, ep.reduce(fem, part, f_cut=150e3), end_time=150e-6, speed=1e-3)
    return kept(run) | {"speed after": error(run.velocity()[-1, 2], 1e-3, 2e-2)}


# Start and rest


@case("exact touch at start, at rest", "nothing moves", quick=True)
def touch_at_rest(method):
    run = strike(method, ball(), block(), speed=0.0, end_time=20e-6)
    moved = max(abs(item.coordinates(run.result)).max() for item in run.bodies)
    return {"not finite": (finite(run), 0.0), "moved": (float(moved), 0.0), "force": (float(run.force.max()), 0.0)}


@case("bodies that overlap by 1e-3 of a facet", "PenetrationError", methods=("explicit",), raises="PenetrationError",
      quick=True)  # fmt: skip
def overlap(method):
    strike(method, ball(), gap=-1e-6, end_time=1e-6)


@case("overlap within the tolerance of meshes, at 1e-6 m/s", "warns that it throws the bodies apart",
      warns=("ModelLimitWarning",), quick=True)  # fmt: skip
def slow_overlap(method):
    run = strike(method, ball(), speed=1e-6, gap=-2e-8, end_time=20e-6)
    return {"not finite": (finite(run), 0.0)}


@case("resting under gravity", "mean force is the weight 1 %, never negative")
def resting(method):
    """A block put down at zero gap sinks and rises about its rest for ever, explicit; an implicit run comes to rest."""
    fem, part = bar_model(tuple(np.linspace(0, 0.02, 5)), ep.STEEL, side=0.02)
    body = ep.reduce(fem, part, f_cut=150e3)
    damped = {"spectral_radius": 0.5, "step": 2e-6} if method == "implicit" else {}
    run = strike(method, body, speed=0.0, body={"gravity": [0, 0, -9.81]}, end_time=8e-3, sample_period=2e-6,
                 mass=1.0, **damped)  # fmt: skip
    weight = 9.81 * body.total_mass
    window = np.hanning(len(run.force))
    sunk = run.bodies[0].rigid_motion(run.bodies[0].coordinates(run.result))[:, 2]
    return {
        "not finite": (finite(run), 0.0),
        "pulling": (float(-run.force.min()), 0.0),
        "mean force": error(window @ run.force / window.sum(), weight, 0.01),
        "sunk over size": (float(abs(sunk).max() / 0.02), 1e-6),
    }


@case(
    "long contact on a stiff spring", "static force 1 %: a weight over the springs' share", warns=("ModelLimitWarning",)
)
def stiff_spring(method):
    """A ball that a spring of 1e8 N/m presses on the plane through a damper; the spring is too long by 1 um."""
    fem, _ = ball_model()
    top = fem.points[fem.nearest_node((0, 0, 2 * RADIUS))]
    k = 1e8

    def spring(mbs, bodies, contact):
        marker = bodies[0].CreateNodeMarker(mbs, top)
        ground = mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=mbs.CreateGround(), localPosition=[*top[:2], 0.021]))
        mbs.AddObject(
            items.ObjectConnectorSpringDamper(
                markerNumbers=[ground, marker], stiffness=k, damping=4e3, referenceLength=float(0.021 - top[2] + 1e-6)
            )
        )

    run = strike(method, ball(), speed=0.0, mass=1.0, end_time=4e-3, sample_period=2e-6, add=spring)
    force = run.force
    pushed = run.bodies[0].displacement(run.result, top)[-1, 2]
    return {
        "not finite": (finite(run), 0.0),
        "pulling": (float(-force.min()), 0.0),
        "spring over contact force": error(force[-200:].mean(), k * (1e-6 + pushed), 0.01),
        "rest": (float(np.ptp(force[-200:]) / force[-200:].mean()), 0.02),
        "force": (float(force[-1] <= 1.0), 0.0),
    }


@case("spring beyond the explicit limit", "stops and says so", methods=("explicit",),
      warns=("ContactPatchWarning", "ModelLimitWarning", "StoppedRunWarning"))  # fmt: skip
def too_stiff_spring(method):
    """The stability limit knows nothing of other items: the run must not look finished."""

    def spring(mbs, bodies, contact):
        marker = bodies[0].CreateNodeMarker(mbs, (0, 0, 2 * RADIUS))
        ground = mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=mbs.CreateGround(), localPosition=[0, 0, 0.03]))
        connector = items.ObjectConnectorSpringDamper(markerNumbers=[ground, marker], stiffness=1e13,
                                                      referenceLength=0.01)  # fmt: skip
        mbs.AddObject(connector)

    run = strike(method, ball(), end_time=80e-6, add=spring)
    return {
        "finished": (float(run.result.status != "unstable"), 0.0),
        "not finite": (finite(run), 0.0),
    }


# Flat contacts, many contacts


def bars(method, contact=None, basis="contact-adapted", **options):
    lower = bar_model(tuple(np.linspace(0, 10, 25)), UNIT, end=10.0, kind="hexahedron")
    upper = bar_model(tuple(np.linspace(0, 10, 19)), UNIT, across=3, kind="hexahedron")
    bodies = [ep.reduce(*model, basis=basis, f_cut=0.2) for model in (upper, lower)]
    return strike(method, *bodies, speed=0.1, gap=0.01, place=(0, 0, 10), contact=contact, end_time=26.0, step=0.02,
                  body={"initialVelocity": [0, 0, -0.1]},
                  other={"referencePosition": [0, 0, 0], "initialVelocity": [0, 0, 0.1]}, **options)  # fmt: skip


def exchanged(run, limit):
    """Saint-Venant's two bars: impulse 0.4 times 20, velocities swapped."""
    impulse = np.trapezoid(run.force, run.result.t)
    return {
        "impulse": error(impulse, 8.0, limit),
        "upper after": error(run.velocity(0)[-1, 2], 0.1, limit),
        "lower after": error(run.velocity(1)[-1, 2], -0.1, limit),
    }


@case("flat on flat, compliance", "velocities swap 2 %", quick=True, warns=("ModelLimitWarning",))
def flat(method):
    run = bars(method)
    return kept(run, energy=5e-3) | exchanged(run, 0.02)


@case("flat on flat, two passes", "velocities swap 2 %", warns=("ModelLimitWarning",))
def flat_two_passes(method):
    run = bars(method, {"passes": "two"})
    return kept(run, energy=5e-3, solve=False) | exchanged(run, 0.02)


@case("flat on flat, multipliers", "velocities swap but for what nodes carry, 10 %; no penetration")
def flat_multipliers(method):
    run = bars(method, {"formulation": "lagrange"}, basis="free")
    return kept(run, energy=0.05) | exchanged(run, 0.10) | {"penetration over side": (penetration(run) / 2, 2e-3)}


@case("flat on flat, integrated rows", "velocities swap 3 %", warns=("ModelLimitWarning",))
def flat_integrated(method):
    run = bars(method, {"rows": "integrated"})
    return kept(run, energy=5e-3) | exchanged(run, 0.03)


def cradle(method, n=11, speed=1.0):
    """Balls in a row, each on the next: n - 1 contacts at once."""
    refine = [ep.Refine((0, 0, z), 0.06 * RADIUS, 0.02 * RADIUS) for z in (0, 2 * RADIUS)]
    shape = occ.Sphere(occ.Pnt(0, 0, RADIUS), RADIUS)
    fem = ep.fe_model(shape, ep.STEEL, maxh=4e-3, refine=refine, grading=0.7)
    low, high = (
        ep.Partition.ball(fem, (0, 0, z), 0.08 * RADIUS, direction=(0, 0, d), name=name)
        for z, d, name in ((0, -1, "low"), (2 * RADIUS, 1, "high"))
    )
    body = ep.reduce(fem, low | high, f_cut=150e3)
    mbs = exu.SystemContainer().AddSystem()
    balls = []
    for i in range(n):
        where = {"referencePosition": [0, 0, 2 * RADIUS * i], "initialVelocity": [0, 0, -speed * (i == n - 1)]}
        balls.append(ep.CreatePartitionBody(mbs, body, name=f"ball {i}", **where))
    contacts = [
        ep.CreatePartitionContact(mbs, upper, lower, slavePatch="low", masterPatch="high")
        for lower, upper in itertools.pairwise(balls)
    ]
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=400e-6, step=0.8e-6, method=method, **QUIET)
    return Run(result, balls, contacts, body.total_mass * speed)


def hertz_chain(mass, n, speed, end):
    """Speeds of point masses in a row at a time, by springs of Hertz's law; the last one comes in."""
    E = ep.STEEL.plane_strain_modulus / 2
    k = 4 / 3 * E * math.sqrt(RADIUS / 2)

    def rates(t, y):
        push = k * np.maximum(-np.diff(y[:n]), 0.0) ** 1.5
        return np.r_[y[n:], (np.r_[0.0, push] - np.r_[push, 0.0]) / mass]

    start = np.r_[np.zeros(2 * n - 1), -speed]
    return solve_ivp(rates, (0, end), start, rtol=1e-8, atol=1e-12).y[n:, -1]


@case("ten contacts at once, in a row of balls", "speeds of a chain of Hertz springs 2 %, momentum, energy")
def row_of_balls(method):
    run = cradle(method)
    speeds = np.array([run.velocity(i)[-1, 2] for i in range(11)])
    expected = hertz_chain(run.bodies[0].body.total_mass, 11, 1.0, run.result.t[-1])
    return kept(run, solve=False, energy=5e-3) | {
        "speeds": (float(abs(speeds - expected).max()), 0.02),
        "contacts without force": (float(sum(c.force(run.result).max() <= 0 for c in run.contacts)), 0.0),
    }


@case("ten contacts on one body", "momentum, energy, all ten push", warns=("ModelLimitWarning",))
def ten_patches(method):
    shape = occ.Box(occ.Pnt(0, 0, 0), occ.Pnt(0.1, 0.04, 0.01))
    centres = [(0.01 + 0.02 * i, y, 0.0) for i in range(5) for y in (0.01, 0.03)]
    fem = ep.fe_model(shape, ep.STEEL, maxh=10e-3, refine=[ep.Refine(c, 1e-3, 1e-3) for c in centres])
    parts = [ep.Partition.ball(fem, c, 2e-3, name=f"p{i}") for i, c in enumerate(centres)]
    part = parts[0]
    for other in parts[1:]:
        part = part | other
    body = ep.reduce(fem, part, f_cut=40e3)
    mbs = exu.SystemContainer().AddSystem()
    plate = ep.CreatePartitionBody(mbs, body, initialVelocity=[0, 0, -0.1])
    contacts = [
        ep.CreatePartitionContact(mbs, plate, ep.RigidSphere((x, y, -0.05), 0.05), slavePatch=f"p{i}")
        for i, (x, y, _) in enumerate(centres)
    ]
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=200e-6, method=method, **QUIET)
    run = Run(result, [plate], contacts, 0.1 * body.total_mass)
    return kept(run, solve=False) | {
        "contacts without force": (float(sum(c.force(result).max() <= 0 for c in contacts)), 0.0),
        "pushed back": (float(run.velocity()[-1, 2] <= 0), 0.0),
    }


# Rotation


def spinning(method, omega, frame="floating", **options):
    """A free block that spins about a tilted axis."""
    fem = ep.fe_model(occ.Box(occ.Pnt(0, 0, 0), occ.Pnt(0.01, 0.02, 0.03)), ep.STEEL, maxh=7e-3)
    body = ep.reduce(fem, ep.Partition.ball(fem, (0.005, 0.01, 0.03), 6e-3), f_cut=80e3)
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, frame=frame, initialAngularVelocity=omega)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, method=method, **options, **QUIET)
    return body, item, result


@case("spinning at 1e4 rad/s, floating frame", "angular momentum 1e-4, energy 1e-3, three turns", quick=True)
def spin(method):
    """Strain by centrifugal forces is not in the rigid inertia, so that energy beats with it."""
    omega = 1e4 * np.array([0.6, 0.1, 0.79])
    body, item, result = spinning(method, omega, end_time=2e-3, step=0.2e-6, sample_period=2e-6)
    L, energy = item.angular_momentum(result, body.centre_of_mass), item.energy(result)
    q = item.coordinates(result)
    return {
        "not finite": (float(np.count_nonzero(~np.isfinite(q))), 0.0),
        "unfinished": (float(result.status != "finished"), 0.0),
        "angular momentum": (float(np.linalg.norm(L - L[0], axis=1).max() / np.linalg.norm(L[0])), 1e-4),
        "energy": (float(abs(energy / energy[0] - 1).max()), 1e-3),
    }


@case("spinning at 1e4 rad/s, inertial frame", "warns of rotation", warns=("ModelLimitWarning",))
def spin_inertial(method):
    _, item, result = spinning(method, [0, 0, 1e4], frame="inertial", end_time=50e-6)
    q = item.coordinates(result)
    return {"not finite": (float(np.count_nonzero(~np.isfinite(q))), 0.0)}


@case("spinning ball at 1e4 rad/s on a plane", "bounce 2 %, Hertz 15 %: it rings by centrifugal forces")
def spinning_ball(method):
    spun = {"frame": "floating", "initialAngularVelocity": [0, 0, 1e4]}
    run = strike(method, ball(axes="xyz"), body=spun, gap=1e-6, end_time=80e-6)
    checks = kept(run, solve=False, energy=5e-3) | hertz(run, 1.0, force=0.15)
    q, q_t = (f(run.result) for f in (run.bodies[0].coordinates, run.bodies[0].coordinates_t))
    L = run.bodies[0].kinematics.angular_momentum(q, q_t, np.array([0, 0, RADIUS]))[:, 2]
    return checks | {"spin": (float(abs(L / L[0] - 1).max()), 1e-4)}


@case("steps of ten radians", "warns that steps do not resolve the rotation", methods=("implicit",),
      warns=("ModelLimitWarning",), quick=True)  # fmt: skip
def spin_long_steps(method):
    _, item, result = spinning(method, [6e3, 1e3, 7.9e3], end_time=20e-3, step=1e-3)
    return {"not finite": (float(np.count_nonzero(~np.isfinite(item.coordinates(result)))), 0.0)}


# Steps


def at_limit(method, share, **options):
    return strike(method, ball(), step=lambda mbs: share * ep.stability_limit(mbs), end_time=80e-6, **options)


@case("step at 0.5 of the limit", "energy 3 %, Hertz 5 %", quick=True)
def half_limit(method):
    run = at_limit(method, 0.5)
    return kept(run, energy=0.03) | hertz(run, 1.0)


@case("step at 0.99 of the limit", "bounded: energy 20 %, bounce 10 %; momentum", quick=True)
def near_limit(method):
    run = at_limit(method, 0.99)
    return kept(run, energy=0.2, momentum=5e-3) | hertz(run, 1.0, force=0.1, bounce=0.1)


@case("step at 1.01 of the limit", "StepSizeError", methods=("explicit",), raises="StepSizeError", quick=True)
def above_limit(method):
    at_limit(method, 1.01)


@case("step at 10 times the limit", "StepSizeError", methods=("explicit",), raises="StepSizeError", quick=True)
def far_above_limit(method):
    at_limit(method, 10)


@case("step at 10 times the limit", "warns of it; pushed back; momentum; no energy made", methods=("implicit",),
      warns=("ModelLimitWarning",), quick=True)  # fmt: skip
def far_above_limit_implicit(method):
    run = at_limit(method, 10)
    made = float(max(run.energy.max() / run.energy[0] - 1, 0.0))
    checks = kept(run, energy=0.5, momentum=0.2)
    return checks | {"energy made": (made, 0.02), "pushed back": (float(run.velocity()[-1, 2] <= 0), 0.0)}


@case("10 times the limit by mbs.SolveDynamic", "collect says where it became unstable", methods=("explicit",),
      warns=("ContactPatchWarning", "ModelLimitWarning", "StoppedRunWarning"))  # fmt: skip
def around_the_check(method):
    mbs = exu.SystemContainer().AddSystem()
    upper = ep.CreatePartitionBody(mbs, ball(), initialVelocity=[0, 0, -1.0])
    contact = ep.CreatePartitionContact(mbs, upper, PLANE)
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = 400e-6, 40
    settings.solution.file.write = False
    settings.timeIntegration.verboseMode = 0
    with contextlib.suppress(Exception):  # Exudyn's report of the contact's error
        mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.VelocityVerlet)
    result = ep.collect(mbs)
    run = Run(result, [upper], [contact], 1.0)
    return {"looks finished": (float(result.status == "finished"), 0.0), "not finite": (finite(run), 0.0)}


@case(
    "1e6 steps",
    "energy 1e-3, momentum, speed after of a bar with one axial mode 1 %, its flight 1e-9",
    methods=("explicit",),
)
def million_steps(method):
    fem, part = bar_model((0.0, 1.0, 2.0), UNIT)
    run = strike(method, ep.reduce(fem, part, f_cut=0.3), speed=1e-3, gap=1e-3, end_time=1e4, step=1e-2,
                 sample_period=1.0)  # fmt: skip
    result, item = run.result, run.bodies[0]
    height, speed = item.rigid_motion(item.coordinates(result))[:, 2], run.velocity()[:, 2]
    flown = (height[-1] - height[100]) / (speed[100] * (result.t[-1] - result.t[100]))
    return kept(run, energy=1e-3, momentum=10.0) | {
        "steps missing": (float(abs(1e6 - result.steps)), 0.0),
        "flight": (float(abs(flown - 1)), 1e-9),
        "speed after": error(speed[-1], bar_of_modes(2.0, 1, speed=1e-3, gap=1e-3, end=10.0), 0.01),
    }


@case("adaptive step down to its floor", "stops and says so, or resolves it: momentum", warns=("StoppedRunWarning",))
def floor(method):
    run = strike(method, ball(), gap=1e-6, end_time=80e-6, adaptive=True, gap_tolerance=1e-16)
    return {"looks finished": (float(run.result.status == "finished"), 0.0), "not finite": (finite(run), 0.0)}


@case("adaptive step after a long flight", "touches on time 1e-3, Hertz 5 %")
def long_flight(method):
    run = strike(method, ball(), gap=0.1, end_time=0.1001, adaptive=True, spectral_radius=0.9)
    touch = run.contacts[0].impacts(run.result)[0].start
    return {
        "unfinished": (float(run.result.status != "finished"), 0.0),
        "not finite": (finite(run), 0.0),
        "touch": (abs(touch - 0.1) / 50e-6, 0.05),
    } | hertz(run, 1.0)


# Units and places


def in_units(method, length, mass, time):
    """The same impact on the same mesh, in other units; force against that in SI."""
    reference = strike(method, ball(), end_time=80e-6)
    body = ball_in_units(length, mass, time)
    run = strike(method, body, speed=length / time, end_time=80e-6 * time)
    n = min(len(run.force), len(reference.force))
    force = run.force[:n] / (mass * length / time**2)
    deviation = np.linalg.norm(force - reference.force[:n]) / np.linalg.norm(reference.force)
    return kept(run) | {"force against SI": (float(deviation), 1e-6), "samples": (float(len(reference.force) - n), 0.0)}


@case("units mm, t, s", "the force of the SI model 1e-6", quick=True)
def millimetres(method):
    return in_units(method, 1e3, 1e-3, 1.0)


@case("units km, Mt, h", "the force of the SI model 1e-6")
def kilometres(method):
    return in_units(method, 1e-3, 1e-9, 1 / 3600)


@case("units nm, fg, ns", "the force of the SI model 1e-6")
def nanometres(method):
    return in_units(method, 1e9, 1e18, 1e9)


@case("ball of 1 um", "the force of the large one, scaled, 1e-6", quick=True)
def micro(method):
    """Linear elasticity has no length: at the same speed times scale by the size, forces by its square, here 1e-8."""
    return in_units(method, 1e-4, 1e-12, 1e-4)


@case("1 km from the origin", "the force at the origin 1e-3")
def far(method):
    reference = strike(method, ball(), block(), end_time=80e-6)
    run = strike(method, ball(), block(), place=(1e3, 1e3, 1e3), end_time=80e-6)
    deviation = np.linalg.norm(run.force - reference.force) / np.linalg.norm(reference.force)
    return kept(run) | {"force": (float(deviation), 1e-3)}


@case("1e9 m from the origin", "InputError: no digits are left for the gaps", raises="InputError",
      methods=("explicit",), quick=True)  # fmt: skip
def too_far(method):
    strike(method, ball(), block(), place=(1e9, 1e9, 1e9), end_time=80e-6)


@case("an initial velocity that is not a number", "InputError", methods=("explicit",), raises="InputError", quick=True)
def not_a_number(method):
    strike(method, ball(), body={"initialVelocity": [0, 0, math.nan]}, end_time=1e-6)


# Other formulations, surfaces, frames and joints


@case("multipliers, nodes with mass", "Hertz 10 %, bounce 5 %, no penetration")
def multipliers(method):
    body = ball(h=0.03, basis="craig-bampton")
    run = strike(method, body, contact={"formulation": "lagrange"}, end_time=80e-6, sample_period=0.2e-6,
                 step=0.1e-6 if method == "implicit" else None)  # fmt: skip
    checks = kept(run, energy=0.05) | hertz(run, 1.0, force=0.1, bounce=0.05)
    return checks | {"penetration over dent": (penetration(run) / 18e-6, 1e-2)}


@case("penalty 1e4 times as stiff", "energy, momentum, bounce 5 %; the explicit step follows by itself")
def stiff_penalty(method):
    layer = {"formulation": "penalty"}
    gaps = strike(method, ball(), contact=layer, end_time=1e-6).contacts[0].law.gaps
    layer["stiffness"] = 1e4 * bed_stiffness(gaps)
    run = strike(method, ball(), contact=layer, end_time=80e-6, step=0.02e-6 if method == "implicit" else None)
    return kept(run, energy=0.02, momentum=0.02) | {"speed after": error(run.velocity()[-1, 2], 1.0, 0.05)}


@case("rigid sphere in a conforming hollow", "momentum, energy, complementarity", warns=("ModelLimitWarning",))
def rigid_sphere(method):
    run = strike(method, ball(), ep.RigidSphere((0, 0, -RADIUS / 100), RADIUS / 100), end_time=80e-6, speed=0.1)
    return kept(run)


@case("ball on a rigid cylinder 1e3 times thinner", "momentum, energy", warns=("ModelLimitWarning",))
def rigid_needle(method):
    needle = ep.RigidCylinder((0, 0, -1e-5), (1, 0, 0), 1e-5)
    return kept(strike(method, ball(), needle, end_time=80e-6, speed=0.01))


@case("hinged bar strikes a stop", "energy 2 %; the joint holds to 1e-5 of its length", warns=("ModelLimitWarning",))
def hinged(method):
    arm = occ.Box(occ.Pnt(0, -0.01, -0.01), occ.Pnt(0.2, 0.01, 0.01))
    arm.faces.Min(occ.X).name = "end"
    fem = ep.fe_model(arm, ep.STEEL, maxh=15e-3, refine=[ep.Refine((0.19, 0, -0.01), 2e-3, 1.5e-3)])
    tip = ep.Partition.ball(fem, (0.19, 0, -0.01), 4e-3)
    body = ep.reduce(fem, ep.Partition.interface(fem, "pin", nodes="end") | tip, f_cut=15e3)
    mbs = exu.SystemContainer().AddSystem()
    omega = 1.0
    centre = body.centre_of_mass
    item = ep.CreatePartitionBody(
        mbs, body, frame="floating", initialAngularVelocity=[0, omega, 0],
        initialVelocity=[0, 0, -omega * centre[0]],
    )  # fmt: skip
    pin = item.CreateInterfaceMarker(mbs, "pin")
    ground = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.CreateGround()))
    turn = Rotation.from_euler("x", -90, degrees=True).as_matrix()  # the axis of the hinge is z of its markers
    mbs.AddObject(items.ObjectJointRevoluteZ(markerNumbers=[ground, pin], rotationMarker0=turn, rotationMarker1=turn))
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidSphere((0.19, 0, -0.02 - 1e-5), 0.01), slavePatch=0)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=1e-3, step=1e-6, method=method, **QUIET)
    run = Run(result, [item], [contact], 1.0)
    end = item.displacement(result, (0, 0, 0))
    return {
        "unfinished": (float(result.status != "finished"), 0.0),
        "not finite": (finite(run), 0.0),
        "force": (float(run.force.max() <= 0), 0.0),
        "pulling": (float(-run.force.min()), 0.0),
        "energy": (float(abs(run.energy / run.energy[0] - 1).max()), 0.02),
        "hinge over length": (float(abs(end).max() / 0.2), 1e-5),
    }


@case("ball slides off its patch", "warns that the contact left its patch", warns=("ContactPatchWarning",))
def slides_off(method):
    across = {"initialVelocity": [50.0, 0, -1.0]}
    body = block()
    run = strike(method, ball(), body, body=across, contact={"passes": "given"}, end_time=60e-6)
    return {"not finite": (finite(run), 0.0), "unfinished": (float(run.result.status != "finished"), 0.0)}


def ball_on_sheet(method, thickness, width, maxh):
    """Elements as long as the sheet's bending waves up to f_cut let them be."""
    shape = occ.Box(occ.Pnt(-0.05, -width / 2, -thickness), occ.Pnt(0.05, width / 2, 0))
    fine = ep.Refine((0, 0, 0), 1.2e-3, 0.3e-3)
    fem = ep.fe_model(shape, ep.ALUMINIUM, maxh=maxh, refine=[fine], grading=0.7)
    target = ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 1.2e-3, direction=(0, 0, 1)), f_cut=20e3)
    return kept(strike(method, ball(), target, speed=0.1, end_time=200e-6))


@case("thin sheet, 1:100", "momentum, energy, complementarity")
def sheet(method):
    return ball_on_sheet(method, 1e-3, 0.1, 4e-3)


@case("thin strip, 1:1000", "momentum, energy, complementarity; warns of a contact of one row",
      warns=("ModelLimitWarning",))  # fmt: skip
def strip(method):
    return ball_on_sheet(method, 1e-4, 5e-3, 0.8e-3)


@case("thin sheet, 1:1000, coarse", "FrequencyRangeError: its elements bend with no wave", methods=("explicit",),
      raises="FrequencyRangeError")  # fmt: skip
def coarse_sheet(method):
    ball_on_sheet(method, 1e-4, 0.1, 10e-3)


@case("one basis for two formulations", "InputError", methods=("explicit",), raises="InputError", quick=True)
def wrong_formulation(method):
    strike(method, ball(), contact={"formulation": "lagrange"}, end_time=1e-6)


@case("run of less than a step", "one step, nothing lost", quick=True)
def short_run(method):
    run = strike(method, ball(), end_time=1e-12)
    return {"not finite": (finite(run), 0.0), "steps": (float(abs(run.result.steps - 1)), 0.0)} | kept(run)
