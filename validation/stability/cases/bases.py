"""Impact regions of one facet and of the whole body; no modes, and all modes that the mesh resolves."""

import math

import numpy as np

import exudyn_partition as ep
from validation.stability.cases.registry import case
from validation.stability.scenes import (
    UNIT,
    ball,
    ball_model,
    bar_model,
    error,
    kept,
    penetration,
    strike,
)


@case("no modes at all", "rigid but for its contact: energy; warns that f_cut may be in kHz", warns=("UnitsWarning",),
      quick=True)  # fmt: skip
def no_modes(method):
    body = ep.reduce(*ball_model(), f_cut=150.0)
    return kept(strike(method, body, speed=0.2, gap=1e-6, end_time=2e-4, step=0.5e-6))


@case(
    "no modes, region of the whole body",
    "the full FE model: no penetration; loses the eighth of its mass that meets, which warns",
    quick=True,
    warns=("ModelLimitWarning",),
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
    ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 20.0, direction=(0, 0, -1)), f_cut=0.1)


def bar_of_modes(length, n, *, speed, gap, end, step=1e-3):
    """Speed of the centre of mass after a bar of `UNIT` and side 2 met a wall: n axial modes, the others static."""
    mass, omega = 4.0 * length, np.r_[0.0, np.arange(1, n + 1) * math.pi / length]
    shapes = np.r_[1.0, np.full(n, math.sqrt(2))] / math.sqrt(mass)  # of the end that meets it
    rest = length / 12 - ((shapes / omega.clip(1e-300))[1:] ** 2).sum()  # flexibility of a free bar: l / 3 E A
    q, q_t = np.zeros(n + 1), np.r_[-speed * math.sqrt(mass), np.zeros(n)]
    for _ in range(round(end / step)):
        force = max(0.0, -(gap + shapes @ q) / rest)
        q_t += step * (shapes * force - omega**2 * q)
        q += step * q_t
    return q_t[0] / math.sqrt(mass)


@case("all modes the mesh resolves", "speed after of a bar with so many axial modes 1 %; warns that a flat end rings",
      warns=("ModelLimitWarning",))  # fmt: skip
def all_modes(method):
    """Two axial modes: the bar keeps a fifth of its energy as vibration, while an exact bar keeps none."""
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
