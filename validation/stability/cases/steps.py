"""Steps at the stability limit and far beyond, a million of them, adaptive ones."""

import contextlib

import exudyn as exu

import exudyn_partition as ep
from validation.stability.cases.bases import bar_of_modes
from validation.stability.cases.registry import case
from validation.stability.scenes import (
    PLANE,
    UNIT,
    Run,
    ball,
    bar_model,
    error,
    finite,
    hertz,
    kept,
    strike,
)


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
      warns=("ContactPatchWarning", "ModelLimitWarning", "StoppedRunWarning"), quick=True)  # fmt: skip
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
    "energy 1e-3, momentum, speed after of a bar with one axial mode 1 %, its flight 1e-9; warns that it vibrates on",
    methods=("explicit",),
    warns=("ModelLimitWarning",),
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


@case("adaptive step down to its floor", "stops and says so, or resolves it: momentum", warns=("StoppedRunWarning",),
      quick=True)  # fmt: skip
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
