"""Error against run time of the oblique impact of the rod on the plate with friction, at partial slip.

Reference: the full FE model of the same mesh, rows and friction, HHT in steps of 0.5 us; its own error is what steps of
1 us change. Quantity: relative L2 errors of normal and tangential force over 0.3 ms, against the time of the solver
(on-line) and with that of the reduction or of the full FE model's factorisation (off-line); all of one session.

Limits: with `reduce_pair(tolerance=, friction=, tangential_speed=)` both errors are below the tolerance of 10 % and of
1 %; no run of the full FE model is as quick on-line as a run of the library with no larger error.

    python -m validation.friction.front
"""

import runpy
from types import SimpleNamespace

import exudyn as exu
from rich.console import Console

import exudyn_partition as ep
from validation.contact import scenes

FRICTION, ALONG, END = 0.3, 0.16, 0.3e-3  # coefficient, speed along the plate [m/s], [s]
FINEST, STEPS = 0.5e-6, (1e-6, 2e-6, 4e-6, 8e-6)  # of the full FE model [s]
CUTS = (10e3, 20e3, 40e3, 80e3)  # [Hz]
TOLERANCES = (0.1, 0.01)
LIMITS = {f"tolerance {tolerance:g}": tolerance for tolerance in TOLERANCES} | {"full_fe_quicker": 0}


def run(model, bodies, *, formulation="compliance", **options):
    """History of a run of reduced bodies."""
    mbs = exu.SystemContainer().AddSystem()
    velocity = [ALONG, 0, -model.SPEED]
    items = [ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=velocity), ep.CreatePartitionBody(mbs, bodies[1])]
    contact = ep.CreatePartitionContact(mbs, *items, friction=FRICTION, formulation=formulation)
    mbs.Assemble()
    points = {"P1": (items[0], model.P1), "P2": (items[1], model.P2)}
    return ep.solve_dynamic(mbs, end_time=END, **options).history(contact, points)


def measured(history, reference, offline_s, dofs):
    """Errors and times of a run."""
    found = ep.compare(history, reference)
    return {
        "normal": found.error["force"],
        "tangential": found.error["tangential"],
        "offline_s": offline_s,
        "online_s": history.info["time_s"],
        "dofs": dofs,
    }


def worse(run):
    """Error of one force or the other, whichever is larger."""
    return max(run["normal"], run["tangential"])


def both(runs):
    """The larger errors, by run."""
    return {name: worse(run) for name, run in runs.items()}


def main():
    model = SimpleNamespace(**runpy.run_path(str(scenes.ROOT / "examples" / "models" / "rod_on_plate.py")))
    fems, partitions, _ = model.fe_models(False, axes="xyz")
    console, fe_dofs = Console(width=150), sum(fem.n_dofs for fem in fems)

    def reference(step):
        return model.full_reference(fems, partitions, END, step, along=ALONG, friction=FRICTION)

    finest, full, runs = reference(FINEST), {}, {}
    for step in STEPS:
        name = f"full FE, {1e6 * step:g} us"
        history = reference(step)
        full[name] = measured(history, finest, history.info["setup_s"], fe_dofs)
        console.print(name, full[name])

    def add(name, bodies, **options):
        offline_s, dofs = sum(body.reduce_s for body in bodies), sum(body.n_dofs for body in bodies)
        runs[name] = measured(run(model, bodies, **options), finest, offline_s, dofs)
        console.print(name, runs[name])

    models = [*zip(fems, partitions, strict=True)]
    for f_cut in CUTS:
        bodies = [ep.reduce(*one, f_cut=f_cut) for one in models]
        add(f"{1e-3 * f_cut:g} kHz", bodies)
        if f_cut == 40e3:
            for step in (0.5e-6, 2e-6):
                add(f"40 kHz, {1e6 * step:g} us", bodies, step=step)
            add("40 kHz, implicit, 1 us", bodies, method="implicit", step=1e-6)
            add("40 kHz, penalty", bodies, formulation="penalty")
    add("residual, 40 kHz", [ep.reduce(*one, f_cut=40e3, basis="residual") for one in models])
    for tolerance in TOLERANCES:
        pair = ep.reduce_pair(
            *models, tolerance=tolerance, speed=model.SPEED, duration=END, friction=FRICTION, tangential_speed=ALONG
        )
        add(f"tolerance {tolerance:g}", pair)

    errors = both(runs)
    found = {name: errors[name] for name in LIMITS if name in errors}
    found["full_fe_quicker"] = sum(
        all(run["online_s"] > one["online_s"] for name, run in runs.items() if errors[name] <= error)
        for one, error in zip(full.values(), both(full).values(), strict=True)
        if any(error >= other for other in errors.values())
    )
    labels = "run time", "larger error of normal and tangential force"
    console.print(str(scenes.front(__file__, runs, full, worse, *labels)))
    result = {
        "found": found,
        "limits": LIMITS,
        "runs": runs,
        "full_fe": full,
        "reference_s": finest.info["time_s"],
        "fe_dofs": fe_dofs,
    }
    scenes.finish(__file__, result, [f"{name} {found[name]:.3g}" for name in LIMITS if found[name] > LIMITS[name]])


if __name__ == "__main__":
    main()
