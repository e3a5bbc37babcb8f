"""Error against run time of an elastoplastic impact: the ball on the plate of `impact.py`, at 10 times first yield.

Reference: the full FE model of the same mesh, rows and zone, HHT in steps of the reduced model's default. Quantity:
relative L2 error of the force, and relative error of the plastic work, against the time of the solver (on-line) and
with that of the reduction or of the full FE model's factorisation (off-line). All times are of the processor, in one
session, because they depend less on what else the machine does.
Varied: truncation, basis, step, solver, radius of the plastic zone, tolerance; without plastic flow for comparison; and
the step of the full FE model.

Limits: with `reduce_pair(tolerance=)` both errors are below the tolerance of 10 % and of 1 %; no run of the full FE
model is as quick on-line as a run of the library with no larger error.

    python -m validation.inelastic.front
"""

import time
import warnings
from dataclasses import replace

from rich.console import Console

import exudyn_partition as ep
from validation.contact import scenes
from validation.inelastic import impact

RATIO, END = 10.0, 90e-6  # speed by that at first yield; [s], with the rebound
CUTS = (60e3, 120e3, 250e3)  # [Hz]; the coarse part of the mesh resolves no more
ZONES = (1.0, 1.4)  # radius of the plastic zone by that of the contact, beside `impact.ZONE`
STEPS = (2, 4, 8, 16)  # of the full FE model, by that of its reference
TOLERANCES = (0.1, 0.01)
LIMITS = {f"tolerance {tolerance:g}": tolerance for tolerance in TOLERANCES} | {"full_fe_quicker": 0}


def timed(work):
    """What a function returns, and its time of the processor [s]."""
    begin = time.process_time()
    result = work()
    return result, time.process_time() - begin


def errors(history, work, reference):
    """Errors of force and plastic work."""
    return {
        "force": ep.compare(history, reference).error["force"],
        "work": abs(work / sum(reference.info["plastic_work_J"]) - 1),
    }


def worse(run):
    """The larger of both errors; an elastic run is judged by its force alone."""
    return max(run["force"], run["work"]) if run["work"] < 1 else run["force"]


def full_fe(models, contact, speed, step, end=END):
    """History of the full FE model."""
    full = [ep.reference.FullBody(*model, velocity=(0, 0, v)) for model, v in zip(models, (-speed, 0), strict=True)]
    if contact.slave.name != "ball":
        full = full[::-1]
    return ep.reference.simulate(full, end_time=end, step=step)


def main():
    begin, console, runs, full = time.perf_counter(), Console(width=150), {}, {}
    models, speed, _ = impact.scene(RATIO)
    made = {f_cut: timed(lambda f=f_cut: [ep.reduce(*model, f_cut=f) for model in models]) for f_cut in CUTS}
    bodies, offline_s = made[impact.F_CUT]
    of_ball_s = timed(lambda: ep.reduce(*models[0], f_cut=impact.F_CUT))[1]
    _, contact, run = impact.reduced_run(bodies, speed, END)
    step = run.step
    reference, reference_s = timed(lambda: full_fe(models, contact, speed, step))

    def add(name, bodies, offline_s, **options):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ep.errors.YieldWarning)  # elastic bodies, and zones that are too small
            (_, contact, run), online_s = timed(lambda: impact.reduced_run(bodies, speed, END, **options))
        found = errors(run.history(contact), contact.plastic.work(run)[-1], reference)
        dofs = sum(body.n_dofs for body in bodies)
        runs[name] = {**found, "offline_s": offline_s, "online_s": online_s, "dofs": dofs, "steps": run.steps}
        console.print(name, runs[name])

    for f_cut, (some, seconds) in made.items():
        add(f"{1e-3 * f_cut:g} kHz", some, seconds)
    for factor in (0.5, 2.0):
        add(f"250 kHz, {factor:g} of the step", bodies, offline_s, step=factor * step)
    add("250 kHz, elastic", [replace(body, basis=replace(body.basis, zones=())) for body in bodies], offline_s)
    for zone in ZONES:
        plate = impact.scene(RATIO, zone=zone)[0][1]  # on the same mesh
        smaller, seconds = timed(lambda model=plate: ep.reduce(*model, f_cut=impact.F_CUT))
        add(f"250 kHz, zone of {zone:g} radii", [bodies[0], smaller], of_ball_s + seconds)
    add("residual, 250 kHz", *timed(lambda: [ep.reduce(*m, f_cut=impact.F_CUT, basis="residual") for m in models]))
    for tolerance in TOLERANCES:
        add(
            f"tolerance {tolerance:g}",
            *timed(lambda t=tolerance: ep.reduce_pair(*models, tolerance=t, speed=speed, duration=END)),
        )
    setup_s = timed(lambda: full_fe(models, contact, speed, step, end=step))[1]  # and one step
    for factor in STEPS:
        name = f"full FE, {factor} times the step"
        history, seconds = timed(lambda n=factor: full_fe(models, contact, speed, n * step))
        found = errors(history, sum(history.info["plastic_work_J"]), reference)
        full[name] = {**found, "offline_s": setup_s, "online_s": seconds - setup_s, "steps": history.info["steps"]}
        console.print(name, full[name])

    found = {name: worse(runs[name]) for name in LIMITS if name in runs}
    found["full_fe_quicker"] = sum(
        all(run["online_s"] > one["online_s"] for run in runs.values() if worse(run) <= worse(one))
        for one in full.values()
        if any(worse(run) <= worse(one) for run in runs.values())
    )
    labels = "time of the processor", "larger error of force and plastic work"
    console.print(str(scenes.front(__file__, runs, full, worse, *labels)))
    result = {
        "found": found,
        "limits": LIMITS,
        "runs": runs,
        "full_fe": full,
        "reference_s": reference_s,
        "fe_dofs": sum(fem.n_dofs for fem, _ in models),
        "zone_nodes": len(models[1][1].patches[0].plastic.nodes),
        "time_s": time.perf_counter() - begin,
    }
    scenes.finish(__file__, result, [f"{name} {found[name]:.3g}" for name in LIMITS if found[name] > LIMITS[name]])


if __name__ == "__main__":
    main()
