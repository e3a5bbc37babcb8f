"""Starts in touch and pressed, rest under gravity, stiff springs."""

import exudyn.itemInterface as items
import numpy as np

import exudyn_partition as ep
from validation.stability.cases.registry import case
from validation.stability.scenes import (
    RADIUS,
    ball,
    ball_model,
    bar_model,
    block,
    error,
    finite,
    strike,
)


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
    """A block is put down at zero gap. Explicit: it vibrates about its rest for ever. Implicit: it comes to rest."""
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


@case("spring beyond the explicit limit", "takes shorter steps", methods=("explicit",),
      warns=("ModelLimitWarning",), quick=True)  # fmt: skip
def too_stiff_spring(method):
    """The stability limit of the ball and its contact alone would let the run become unstable."""

    def spring(mbs, bodies, contact):
        marker = bodies[0].CreateNodeMarker(mbs, (0, 0, 2 * RADIUS))
        ground = mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=mbs.CreateGround(), localPosition=[0, 0, 0.03]))
        connector = items.ObjectConnectorSpringDamper(markerNumbers=[ground, marker], stiffness=1e13,
                                                      referenceLength=0.01)  # fmt: skip
        mbs.AddObject(connector)

    run = strike(method, ball(), end_time=80e-6, add=spring)
    return {
        "not finished": (float(run.result.status != "finished"), 0.0),
        "not finite": (finite(run), 0.0),
    }
