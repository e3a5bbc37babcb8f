"""A cam and its follower, flexible both: contact that wanders around the cam, against rigid bodies and a spring.

- A slow turn of an eccentric disc: the force against that of rigid bodies, and its ripple, the part faster than a
  thirtieth of the turn. The contact's own approach is some micrometres, 1e-4 of the 50 mm that press the spring.
- A slow turn of a rigid profile with two lobes (`RigidProfile`), whose lift is known in closed form.
- A shaft that speeds up: the speed at which the follower leaves the cam.
- Friction on a coarser mesh: the tangential force by the normal force, which must be the coefficient, and opposed.

    python -m validation.wandering.cam
"""

import argparse
import time
import warnings

import exudyn as exu
import numpy as np
from rich.console import Console

import exudyn_partition as ep
from examples.models import cam_follower as example
from examples.models import cam_follower_parts as shapes
from validation.contact import scenes

LIMITS = {"force": 0.01, "ripple": 0.005, "profile_force": 0.01, "profile_ripple": 0.005, "lift_off": 0.01,
          "friction": 0.005}  # fmt: skip
SPEED, RAMP, STEP = 2 * np.pi, 0.02, 1e-4  # slow turn [rad/s], [s]
LOBES, FRICTION = 4e-3, 0.1  # lift of the profile [m]


def reduced(rim, face, axes="normal"):
    """Bodies of cam and follower, with elements of these sizes on their patches [m]."""
    parts = shapes.cam_part(rim, 4e-3, axes), shapes.follower_part(face, 10e-3, axes)
    return [ep.reduce(*part, f_cut=shapes.F_CUT) for part in parts]


def errors(t, force, rigid, end):
    """Largest error of a force by that of rigid bodies, and its ripple: what is faster than end / 30 [s]."""
    late = t > 2 * RAMP
    error = (force / rigid - 1)[late]
    n = int(end / 30 / STEP)
    slow = np.convolve(error, np.ones(n) / n, "valid")
    return abs(error).max(), np.sqrt(np.mean((error[n // 2 : n // 2 + len(slow)] - slow) ** 2))


def profile():
    """Rigid cam whose lift over a flat follower is LOBES (1 + cos 2 angle) / 2: its support function is the lift."""

    def curve(angle):
        h = shapes.RADIUS + LOBES * (1 - np.cos(2 * angle)) / 2
        slope = LOBES * np.sin(2 * angle)
        return np.column_stack([h * np.cos(angle) - slope * np.sin(angle), h * np.sin(angle) + slope * np.cos(angle)])

    return ep.RigidProfile(curve)


def profile_turn(follower_body, turns):
    """Times, force and force of rigid bodies of the rigid profile."""
    mbs, drive = exu.SystemContainer().AddSystem(), shapes.Drive(SPEED, RAMP)
    follower, shaft = example.add_follower(mbs, follower_body, shapes.RADIUS), example.add_shaft(mbs, drive)
    contact = ep.CreatePartitionContact(mbs, follower, profile(), masterBody=shaft)
    mbs.Assemble()
    run = example.run(example.Mechanism(mbs, None, follower, contact, drive), turns / (SPEED / 2 / np.pi), STEP)
    turn, velocity, acceleration = drive.turn(run.t)
    angle = 2 * (drive.start + turn)
    lift = LOBES * (1 + np.cos(angle)) / 2
    rate = -LOBES * np.sin(angle)  # by the angle of the shaft
    inertia = rate * acceleration - 2 * LOBES * np.cos(angle) * velocity**2
    rigid = example.STIFFNESS * (example.PRELOAD + lift) + example.DAMPING * rate * velocity
    return run, contact.force(run), rigid + follower_body.total_mass * inertia


def lift_off(bodies):
    """Speed at which contact first opens while the shaft speeds up, by that at which rigid bodies part; histories."""
    fastest, turns = 1.2 * example.lift_off_speed(bodies[1].total_mass), 4.0
    ramp = 4 * np.pi * turns / fastest
    model = example.mechanism(*bodies, fastest, ramp)
    run = example.run(model, 0.85 * ramp, 2e-5)
    force, rigid, speed = model.contact.force(run), model.rigid_force(run.t), model.drive.turn(run.t)[1]
    opens = [speed[np.flatnonzero((history <= 0) & (run.t > 1e-3))[0]] for history in (force, rigid)]
    return opens[0] / opens[1] - 1, (run.t, force, rigid)


def sliding(turns):
    """Tangential force by normal force of a slow turn with friction."""
    model = example.mechanism(*reduced(2e-3, 2.5e-3, "xyz"), SPEED, RAMP, friction=FRICTION)
    run = example.run(model, turns / (SPEED / 2 / np.pi), STEP)
    late = run.t > 2 * RAMP
    normal, tangential = model.contact.force(run)[late], model.contact.friction.tangential_force(run)[late]
    return tangential[:, 0] / normal


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--turns", type=float, default=1.0, help="of the slow cams; other numbers than 1 store nothing")
    options = parser.parse_args()
    warnings.simplefilter("ignore", ep.errors.PartitionWarning)  # it yields, and its rows are few: both are meant
    begin, console, end = time.perf_counter(), Console(width=150), 2 * np.pi / SPEED
    bodies = reduced(1e-3, 1.5e-3)
    reduce_s = time.perf_counter() - begin
    model = example.mechanism(*bodies, SPEED, RAMP)
    run = example.run(model, options.turns * end, STEP)
    turn = run.t, model.contact.force(run), model.rigid_force(run.t)
    found = dict(zip(("force", "ripple"), errors(*turn, end), strict=True))
    console.print(found, f"{1e3 * run.time_s / run.steps:.2f} ms a step")
    profile_run, *histories = profile_turn(bodies[1], options.turns)
    lobes = profile_run.t, *histories
    found |= dict(zip(("profile_force", "profile_ripple"), errors(*lobes, end), strict=True))
    console.print(found, f"{1e3 * profile_run.time_s / profile_run.steps:.2f} ms a step")
    found["lift_off"], fast = lift_off(bodies)
    console.print(found)
    ratio = sliding(0.1 * options.turns)
    found["friction"] = abs(abs(ratio) / FRICTION - 1).max()
    console.print(found)
    path, axes = scenes.figure(__file__, nrows=3, figsize=(8, 9))
    names = "slow turn of the disc", "slow turn of the profile", "speeding up"
    for panel, (t, force, rigid), name in zip(np.ravel(axes[1]), (turn, lobes, fast), names, strict=True):
        panel.plot(t, force, lw=0.8, label="flexible")
        panel.plot(t, rigid, "k--", lw=0.8, label="rigid bodies")
        panel.set(
            title=name, xlabel="time [s]", ylabel="force [N]", ylim=(1.1 * min(rigid.min(), 0), 1.3 * rigid.max())
        )
        panel.legend(fontsize=7)
    axes[0].savefig(path, dpi=120)
    console.print(str(path))
    result = {
        "found": found, "limits": LIMITS, "patch_nodes": [len(body.partition.patch_nodes) for body in bodies],
        "fe_dofs": [body.fe_dofs for body in bodies], "dofs": [body.n_dofs for body in bodies],
        "steps": run.steps, "ms_a_step": 1e3 * run.time_s / run.steps,
        "profile_ms_a_step": 1e3 * profile_run.time_s / profile_run.steps, "reduce_s": reduce_s,
        "sign_of_friction": float(np.sign(np.median(ratio))), "time_s": time.perf_counter() - begin,
    }  # fmt: skip
    if options.turns == 1.0:
        scenes.finish(__file__, result, [f"{key} {found[key]:.3g}" for key in LIMITS if abs(found[key]) > LIMITS[key]])


if __name__ == "__main__":
    main()
