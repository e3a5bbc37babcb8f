"""From 1e-9 to 100 m/s."""

import functools
import math

from validation.stability.cases.registry import case
from validation.stability.scenes import (
    ball,
    ball_model,
    error,
    free_flexibility,
    hertz,
    kept,
    strike,
)


@case("ball on plane at 1 m/s", "Hertz 5 %, bounce 2 %", quick=True)
def plain(method):
    run = strike(method, ball(), end_time=80e-6)
    return kept(run) | hertz(run, 1.0)


@functools.cache
def node_stiffness():
    """Stiffness of the ball at its lowest node, by the FE model's static answer [N/m]."""
    fem, part = ball_model()
    return 1 / free_flexibility(fem, lowest_node(fem, part))


def slow(method, speed):
    """One node touches: a mass on a linear spring."""
    stiffness, mass = node_stiffness(), ball_model()[0].total_mass
    period = math.pi * math.sqrt(mass / stiffness)
    run = strike(method, ball(), speed=speed, end_time=1.5 * period)
    impact = run.contacts[0].impacts(run.result)
    return kept(run) | {
        "one impact": (float(len(impact) != 1), 0.0),
        "peak force": error(run.force.max(), speed * math.sqrt(mass * stiffness), 0.02),
        "duration": error(impact[0].end - impact[0].start, period, 0.03),
        "speed after": error(run.velocity()[-1, 2], speed, 1e-3),
    }


def lowest_node(fem, part):
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


@case("speed 100 m/s, patch for 1 m/s", "warns that the contact left its patch, and of dents beyond linear elasticity",
      warns=("ContactPatchWarning", "ModelLimitWarning"))  # fmt: skip
def too_fast(method):
    run = strike(method, ball(), speed=100.0, end_time=20e-6)
    return kept(run, solve=False, energy=5e-3)


@case("speed 100 m/s", "Hertz 20 % on a patch that is large enough: the ball is no half-space then, which warns",
      warns=("ModelLimitWarning",))  # fmt: skip
def fast(method):
    body = ball(h=0.08, reach=0.5)
    run = strike(method, body, speed=100.0, end_time=40e-6, step=0.1e-6)
    return kept(run) | hertz(run, 100.0, force=0.20, bounce=0.05)
