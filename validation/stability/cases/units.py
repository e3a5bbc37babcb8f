"""The same impact in other units, sizes and places."""

import math

import numpy as np

from validation.stability.cases.registry import case
from validation.stability.scenes import (
    ball,
    ball_in_units,
    block,
    kept,
    strike,
)


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
    """Linear elasticity has no length: at equal speed, times scale with the size, forces with its square, here 1e-8."""
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
