"""A block that a rigid plane presses slowly until all of it yields, against the stress-strain curve of its material.

A cube of steel stands on its mean face, which a joint pushes against a rigid plane without friction. The whole cube is
a plastic zone, so that stress and strain are the same everywhere. This is a run with explicit steps, contact, basis and
zone; the full FE model would share an error of the plastic flow, and these formulas do not.
Reference: the uniaxial curve. Stress s and plastic strain p follow from the strain e = s / E + p, with s = Y + H p, for
isotropic and kinematic hardening alike, or s by a table. Sideways, plastic strain is p / 2 in both directions. Plastic
work is the integral of s over p.
Quantity: relative errors of force, of mean plastic strain, equivalent and sideways, and of plastic work, at the end of
the way, where the joint is at rest. And the same for blocks whose yield stress, hardening or elastic modulus is off by
a per cent.
Limits: 0.1 % in each; every change of a per cent is beyond that limit at least twice.

    python -m validation.inelastic.pressed_block
"""

import time
from dataclasses import replace

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
from rich.console import Console
from scipy.optimize import brentq

import exudyn_partition as ep
from validation.contact import scenes

WIDTH, STRAIN, TIME, STEPS = 10e-3, 8e-3, 200e-6, 1500
STEEL = ep.Material(E=200e9, nu=0.3, rho=7800.0, yield_stress=300e6, hardening=50e9)
CURVE = ((0.0, 300e6), (0.002, 400e6), (0.01, 480e6))
CASES = {
    "isotropic": STEEL,
    "kinematic": replace(STEEL, hardening=0.0, kinematic_hardening=50e9),
    "both": replace(STEEL, hardening=20e9, kinematic_hardening=30e9),
    "curve": replace(STEEL, hardening=CURVE),
    "perfect": replace(STEEL, hardening=0.0),
}
CHANGES = {"yield_stress": 1.01 * 300e6, "hardening": 1.01 * 50e9, "E": 1.01 * 200e9}
LIMITS = {"force": 1e-3, "strain": 1e-3, "sideways": 1e-3, "work": 1e-3, "noticed": 2.0}


def exact(material):
    """Force [N], plastic strain, equivalent and sideways, and plastic work [J] at the end of the way."""
    if isinstance(material.hardening, tuple):
        table, stresses = np.array(material.hardening).T
    else:
        table = np.array([0.0, 1.0])
        stresses = material.yield_stress + (material.hardening + material.kinematic_hardening) * table
    plastic = brentq(lambda p: np.interp(p, table, stresses) / material.E + p - STRAIN, 0.0, STRAIN)
    stress = float(np.interp(plastic, table, stresses))
    path = np.union1d(table[table < plastic], [0.0, plastic])
    work = np.trapezoid(np.interp(path, table, stresses), path)
    return {"force": stress * WIDTH**2, "strain": plastic, "sideways": plastic / 2, "work": work * WIDTH**3}


def pressed(material):
    """The same of a run."""
    shape = occ.Box((0, 0, 0), (WIDTH, WIDTH, WIDTH))
    shape.faces.Min(occ.Z).name = "bottom"
    fem, middle = ep.fe_model(shape, material, maxh=0.5 * WIDTH), 0.5 * WIDTH
    top = ep.Partition.ball(fem, (middle, middle, WIDTH), 0.8 * WIDTH, direction=(0, 0, 1), plastic_radius=2 * WIDTH)
    body = ep.reduce(fem, top | ep.Partition.interface(fem, "bottom", "bottom", kind="averaged"), f_cut=150e3)
    mbs = exu.SystemContainer().AddSystem()
    block = ep.CreatePartitionBody(mbs, body)
    ground = mbs.CreateGround(referencePosition=[middle, middle, 0])
    markers = [mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground)), block.CreateInterfaceMarker(mbs, "bottom")]

    def way(mbs, t, *unused):
        return [0, 0, 0.5 * STRAIN * WIDTH * (1 - np.cos(np.pi * min(t / TIME, 1.0))), 0, 0, 0]

    mbs.AddObject(items.GenericJoint(markerNumbers=markers, constrainedAxes=[1] * 6, offsetUserFunction=way))
    contact = ep.CreatePartitionContact(mbs, block, ep.RigidPlane((0, 0, WIDTH), (0, 0, -1)))
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=TIME, step=TIME / STEPS)
    (state,), ((_, zone),) = contact.plastic.states(result).values(), contact.plastic.zones
    share = zone.zone.weight / zone.zone.weight.sum()
    return {
        "force": contact.force(result)[-1],
        "strain": share @ state.equivalent,
        "sideways": (share @ state.strain)[:2].mean(),
        "work": contact.plastic.work(result)[-1],
    }


def main():
    begin, console = time.perf_counter(), Console(width=150)
    runs = {name: pressed(material) for name, material in CASES.items()}
    errors = {
        name: {key: abs(runs[name][key] / value - 1) for key, value in exact(material).items()}
        for name, material in CASES.items()
    }
    expected, noticed = exact(STEEL), {}
    for name, value in CHANGES.items():
        changed = pressed(replace(STEEL, **{name: value}))
        off = {key: abs(changed[key] / expected[key] - 1) for key in expected}
        noticed[name] = max(off[key] / LIMITS[key] for key in expected)
    console.print(errors, noticed)
    found = {key: max(error[key] for error in errors.values()) for key in expected}
    found["noticed"] = min(noticed.values())
    failed = [f"{key} {found[key]:.3g}, limit {LIMITS[key]:g}" for key in expected if not found[key] <= LIMITS[key]]
    if not found["noticed"] >= LIMITS["noticed"]:
        failed.append(f"a change of a per cent is noticed by {found['noticed']:.2g} of the limits only")
    result = {
        "found": found, "limits": LIMITS, "errors": errors, "noticed_by_limits": noticed, "runs": runs,
        "time_s": time.perf_counter() - begin,
    }  # fmt: skip
    scenes.finish(__file__, result, failed)


if __name__ == "__main__":
    main()
