"""What a rigid code must be told of a tilted bar: restitution over tilt and speed, computed, and used in a rigid model.

Steel bars with round ends fall on a rigid plane. Nothing is lost in them, yet they do not rebound as they came: they
vibrate, and touch several times. `restitution_map` computes this for three lengths. The law of one of them goes into a
rigid model in Exudyn, which then bounces as the flexible bar does. Dashed curves of the figure are beam theory, by
`validation/experiments/tilted_bar.py`.
"""

import argparse
import functools
import json
import time
from pathlib import Path

import exudyn as exu
import exudyn.itemInterface as items
import matplotlib.pyplot as plt
import netgen.occ as occ
import numpy as np

import exudyn_partition as ep

R, F_CUT, STEEL = 6.35e-3, 45e3, ep.Material(E=210e9, nu=0.3, rho=7800.0)
LENGTHS, SPEED, TESTED = (0.1, 0.2, 0.3), 0.5, (57.0, 0.35)  # [m], [m/s]; a point between those of the map


def mesh(length, tilt, h):
    """FE model of a bar that stands at a tilt [degrees] with its lower tip at the origin, elements of h there [m]."""
    cos, sin = np.cos(np.radians(tilt)), np.sin(np.radians(tilt))
    ends = [occ.Pnt(0, 0, R), occ.Pnt(length * cos, 0, R + length * sin)]
    shape = occ.Cylinder(ends[0], occ.Dir(cos, 0, sin), R, length) + occ.Sphere(ends[0], R) + occ.Sphere(ends[1], R)
    for maxh in R * 0.9 ** np.arange(5):  # Netgen leaves an element without volume at times
        try:
            return ep.fe_model(shape, STEEL, maxh=maxh, refine=[ep.Refine((0, 0, 0), radius=0.33e-3, h=h)])
        except ep.errors.MeshError as error:
            print(f"{length:g} m, {tilt:g} degrees, maxh {maxh:.3g} m: {error}")
    raise SystemExit("no mesh can be used")


def pair(h, length, tilt):
    """The reduced bar and the plane; element sizes and cut are those of `ep.design_impact` for 2 %."""
    fem = mesh(length, tilt, h)
    return ep.reduce(
        fem, ep.Partition.ball(fem, (0, 0, 0), 0.45e-3, direction=(0, 0, -1)), f_cut=F_CUT
    ), ep.RigidPlane()


def rigid_bounce(fem, tilt, speed, law):
    """Velocity and spin of a rigid bar in Exudyn that meets the plane by the law: [x, z, about -y]."""
    mass, (beside, _, above), moment = fem.total_mass, fem.centre_of_mass, fem.inertia_tensor[1, 1]
    mbs = exu.SystemContainer().AddSystem()
    start = {"referenceCoordinates": [beside, above + 1e-4, 0], "initialVelocities": [0, -speed, 0]}
    node = mbs.AddNode(items.NodeRigidBody2D(**start))
    mbs.AddObject(items.ObjectRigidBody2D(mass=mass, inertia=moment, nodeNumber=node))
    mbs.Assemble()

    def touch(mbs, t):
        q, v = mbs.systemData.GetODE2Coordinates(), mbs.systemData.GetODE2Coordinates_t()
        closing = beside * v[2] - v[1]  # speed of the tip, which lies beside the centre of mass
        if q[1] + 1e-4 - beside * q[2] <= 0 < closing:
            impulse = (1 + law(place=tilt, speed=closing)["restitution"]) * closing / (1 / mass + beside**2 / moment)
            v += np.array([0, impulse / mass, -impulse * beside / moment])
            mbs.systemData.SetODE2Coordinates_t(v)
        return True

    mbs.SetPreStepUserFunction(touch)
    settings = exu.SimulationSettings()
    settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = 1e-3, 1000
    settings.solution.file.write = False
    mbs.SolveDynamic(settings)
    return mbs.systemData.GetODE2Coordinates_t()


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one length, three tilts")
    parser.add_argument("--workers", type=int, default=2, metavar="N", help="processes")
    parser.add_argument("--out", type=Path, default=Path("out/restitution_map"), metavar="DIR")
    options = parser.parse_args(argv)
    options.out.mkdir(parents=True, exist_ok=True)
    h, tilts = (0.2e-3, [50, 57.5, 65]) if options.quick else (0.13e-3, np.arange(10, 86, 5))
    begin, maps = time.perf_counter(), {}
    for length in LENGTHS[:1] if options.quick else LENGTHS:
        kept = options.out / f"{'quick' if options.quick else 'map'}_{1e3 * length:.0f}mm.jsonl"
        bodies = functools.partial(pair, h, length)
        speeds = (0.3, 0.4, SPEED)
        maps[length] = ep.restitution_map(bodies, speed=speeds, place=tilts, file=kept, workers=options.workers)
    wall, (tilt, speed) = time.perf_counter() - begin, TESTED
    law, flexible = maps[LENGTHS[0]].law(), ep.restitution_map(pair(h, LENGTHS[0], tilt), speed=speed)
    spins = [rigid_bounce(mesh(LENGTHS[0], tilt, h), tilt, speed, law)[2], flexible["spin"].item()]
    theory = json.loads((Path(__file__).parent / "restitution_map_theory.json").read_text())
    figure, panels = plt.subplots(1, len(maps), layout="constrained", figsize=(11, 4), sharey=True, squeeze=False)
    for axes, (length, found) in zip(panels[0], maps.items(), strict=True):
        axes.plot(theory["tilt"], theory[f"{1e3 * length:.0f} mm"], "--", lw=1.2, label="beam theory")
        e, contacts = found["restitution"][:, -1].ravel(), found["contacts"][:, -1].ravel()
        axes.plot(found.place, e, "C0o", ms=10, mfc="white", label="computed; how many contacts")
        for x, y, count in zip(found.place, e, contacts, strict=True):
            axes.annotate(f"{count:.0f}", (x, y), ha="center", va="center", fontsize=7)
        axes.axhline(1, color="k", ls=":", lw=1, label="rigid")
        axes.set(xlabel="tilt from the plane [degrees]", ylim=(0, 1.05), title=f"bar of {1e3 * length:g} mm")
    panels[0, 0].legend(loc="lower left", fontsize=8)
    figure.supylabel("coefficient of restitution")
    figure.savefig(picture := (options.out / "restitution_map.png").resolve(), dpi=150)
    told, impacts = ("restitution", "contacts", "peak_force", "balance"), []
    for length, found in maps.items():
        impacts.append({"length_m": length, "speed_m_s": SPEED, "tilt": found.place.tolist()})
        impacts[-1] |= {name: found[name][:, -1].ravel().tolist() for name in told}
    new = sum(found.info["new"] for found in maps.values())
    result = {"impacts": impacts, "law_error": law.error, "spin_rigid_rad_s": spins[0], "spin_flexible_rad_s": spins[1]}
    result |= {"new": new, "time": {"wall_s": wall}, "versions": ep.versions()}
    (options.out / "result.json").write_text(json.dumps(result, indent=2, default=float))
    off = spins[0] / spins[1] - 1
    print(f"{new} impacts in {wall:.0f} s; the spin of the rigid bar is {off:+.2%} off the flexible", picture, sep="\n")
    return result


if __name__ == "__main__":
    main()
