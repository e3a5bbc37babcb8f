"""Numerical stability of plastic zones: soft and hard, fast and slow, damped, adaptive, both bodies plastic, repeated.

A steel ball of 10 mm on a plate of 12 x 12 x 3 mm, with meshes as coarse as runs allow. Quantity: largest error of the
energy balance, counting plastic work and damping, iterations of a plastic step, and whether the run came to its end.
Limits: 0.01 for the balance at default steps, 0.02 for implicit ones of five times that length; plastic work never
falls; every run ends.

    python -m validation.inelastic.extremes
"""

import contextlib
import time
import warnings
from dataclasses import replace
from unittest import mock

import exudyn as exu
import netgen.occ as occ
import numpy as np
from rich.console import Console

import exudyn_partition as ep
from exudyn_partition.contact.plasticity.yielding_patches import YieldingPatches
from validation.contact import scenes

RADIUS, F_CUT, END = 5e-3, 150e3, 60e-6
ALUMINIUM = ep.Material(E=70e9, nu=0.33, rho=2700.0, yield_stress=200e6, hardening=500e6)
STEEL = ep.Material(E=210e9, nu=0.3, rho=7800.0, yield_stress=355e6, hardening=1e9)
LIMITS = {"explicit": 0.01, "implicit": 0.02}
CURVE = ((0.0, 200e6), (0.01, 260e6), (0.05, 300e6))
CASES = {
    "reference": {},
    "perfect plasticity": {"hardening": 0.0},
    "H of 1 MPa": {"hardening": 1e6},
    "curve of hardening": {"hardening": CURVE},
    "kinematic": {"hardening": 0.0, "kinematic_hardening": 5e9},
    "Y of 1 MPa": {"yield_stress": 1e6, "hardening": 0.0},
    "Y of 10 GPa": {"yield_stress": 10e9},
    "10 m/s": {"speed": 10.0},
    "1 mm/s": {"speed": 1e-3, "end": 2e-3},
    "damping ratio 0.05": {"damping": 0.05},
    "damping ratio 2": {"damping": 2.0},
    "floating": {"frame": "floating"},
    "implicit, 5 steps in one": {"method": "implicit", "step": 5.0},
    "adaptive": {"method": "implicit", "adaptive": True},
    "both bodies plastic": {"both": True},
    "friction": {"friction": 0.3},
}


def models(both=False, axes="normal", **material):
    """FE models and partitions of ball and plate."""
    ball = occ.Sphere(occ.Pnt(0, 0, RADIUS), RADIUS)
    plate = occ.Box(occ.Pnt(-6e-3, -6e-3, -3e-3), occ.Pnt(6e-3, 6e-3, 0))
    found = []
    steel = STEEL if both else replace(STEEL, hardening=None)
    for shape, own, sign, reach in ((ball, steel, -1, 0.8e-3), (plate, replace(ALUMINIUM, **material), 1, 0.9e-3)):
        fem = ep.fe_model(shape, own, maxh=4e-3, refine=[ep.Refine((0, 0, 0), 0.5e-3, 0.2e-3)], grading=0.6)
        found.append((fem, ep.Partition.ball(fem, (0, 0, 0), reach, direction=(0, 0, sign), axes=axes)))
    return found


@contextlib.contextmanager
def counted():
    """Iterations of each answer of plastic zones within the context, as a list that grows."""
    found, solve = [], YieldingPatches.solve

    def counting(*arguments):
        answer = solve(*arguments)
        found.append(answer.iterations)
        return answer

    with mock.patch.object(YieldingPatches, "solve", counting):
        yield found


def fall(bodies, *, speed=0.5, end=END, frame="inertial", damping=None, friction=None, states=None, **options):
    """Items, contact and result of the impact, and iterations of each answer of its zones."""
    mbs = exu.SystemContainer().AddSystem()
    along = 0.0 if friction is None else 0.5 * speed
    ball = ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=[along, 0, -speed], frame=frame, damping=damping)
    plate = ep.CreatePartitionBody(mbs, bodies[1], frame=frame, damping=damping, plasticStates=states)
    contact = ep.CreatePartitionContact(mbs, ball, plate, friction=friction)
    mbs.Assemble()
    with warnings.catch_warnings(), counted() as iterations:
        warnings.simplefilter("ignore")
        return (ball, plate), contact, ep.solve_dynamic(mbs, end_time=end, **options), iterations


def told(items, contact, result, iterations):
    """Balance of energy, and what plastic flow did."""
    total = sum(item.energy(result) + item.dissipated_energy(result) for item in items)
    total = total + contact.energy(result) + contact.dissipated_energy(result)
    work = contact.plastic.work(result)
    plastic_steps = max(int(np.count_nonzero(np.diff(work) > 0)), 1)
    return {
        "balance": abs(total / total[0] - 1).max(),
        "plastic_share": work[-1] / total[0],
        "falls_by": max(0.0, -np.diff(work).min()) / total[0],
        "largest_strain": contact.plastic.strain(result)[-1],
        "iterations_a_step": sum(iterations) / plastic_steps,
        "finished": result.status == "finished",
        "online_s": result.time_s,
        "steps": result.steps,
    }


def run_of(name, usual):
    """Run a case of `CASES`; `usual` are the bodies of the reference case."""
    options = dict(CASES[name])
    material = {key: options.pop(key) for key in ("yield_stress", "hardening", "kinematic_hardening") if key in options}
    both = options.pop("both", False)
    bodies, step = usual, options.pop("step", None)
    if material or both or "friction" in options:
        axes = "xyz" if "friction" in options else "normal"
        bodies = [ep.reduce(*model, f_cut=F_CUT) for model in models(both, axes, **material)]
    if step is not None:
        options["step"] = step * fall(bodies)[2].step
    return told(*fall(bodies, **options))


def repeated(bodies, times=5):
    """Impacts on the same place: plastic work of each by the first, and the worst balance."""
    work, balance, states = [], 0.0, None
    for _ in range(times):
        impact = fall(bodies, states=states)
        found, (_, contact, result, _) = told(*impact), impact
        work.append(found["plastic_share"])
        balance = max(balance, found["balance"])
        state = contact.plastic.states(result)
        states = {0: next(iter(state.values()))}
    return {"balance": balance, "plastic_shares": work, "falls": bool((np.diff(work) < 0).all())}


def main():
    begin, console, found, failed = time.perf_counter(), Console(width=150), {}, []
    usual = [ep.reduce(*model, f_cut=F_CUT) for model in models()]
    for name in CASES:
        found[name] = run_of(name, usual)
        console.print(name, {key: float(f"{value:.3g}") for key, value in found[name].items()})
        limit = LIMITS[CASES[name].get("method", "explicit")]
        one = found[name]
        if not (one["balance"] <= limit and one["finished"] and one["falls_by"] <= 1e-9):
            failed.append(name)
    found["five impacts on one place"] = repeated(usual)
    console.print(found["five impacts on one place"])
    if not found["five impacts on one place"]["falls"]:
        failed.append("five impacts on one place")
    worst = {
        kind: max(found[name]["balance"] for name, case in CASES.items() if case.get("method", "explicit") == kind)
        for kind in LIMITS
    }
    result = {"found": worst, "limits": LIMITS, "cases": found, "time_s": time.perf_counter() - begin}
    scenes.finish(__file__, result, failed)


if __name__ == "__main__":
    main()
