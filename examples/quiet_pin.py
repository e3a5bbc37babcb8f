"""Exudyn's GeneticOptimization finds the weight on a hammer with which its pin feels the blow least.

A rigid hammer gives its pin no impulse at all if it hits at its centre of percussion. A weight on its end moves this
point to its nose. A flexible one also bends, and its pin feels that. The hammer is reduced once; each run puts another
weight on it. ComputeSensitivities then tells how the forces depend on weight and speed at the optimum.
"""

import argparse
import json
import time
from pathlib import Path

import exudyn as exu
import exudyn.itemInterface as items
import matplotlib.pyplot as plt
import netgen.occ as occ
import numpy as np
from exudyn.processing import ComputeSensitivities, GeneticOptimization

import exudyn_partition as ep

LENGTH, SPEED, GAP = 0.12, 4.0, 0.05e-3  # of the hammer [m], when it hits [rad/s], flight before [m]
WEIGHTS = (0.01, 0.6)  # that are tried [kg]
NOSE = np.array([0.095, -0.02, 0.0])  # where it hits [m]


def hammer(quick):
    """FE model and body: a bar with a round nose, on a pin at the origin, with a face for weights on its end."""
    bar = occ.Box((-0.015, -0.015, -0.015), (LENGTH, 0.015, 0.015)) + occ.Sphere((NOSE[0], 0, 0), 0.02)
    bar -= occ.Cylinder(occ.Pnt(0, 0, -0.015), occ.Z, r=0.004, h=0.03)
    bar.faces.Max(occ.X).name = "end"
    fem = ep.fe_model(bar, ep.STEEL, maxh=10e-3, refine=[ep.Refine(NOSE, 0.8e-3, 0.4e-3 if quick else 0.25e-3)])
    part = ep.Partition.ball(fem, NOSE, 1.2e-3, name="nose") | ep.Partition.interface(fem, "end", nodes="end")
    part |= ep.Partition.interface(fem, "pin", cylinder=((0, 0, 0), (0, 0, 1), 0.004))
    return fem, ep.reduce(fem, part, f_cut=30e3)


def blow(body, weight, speed=SPEED):
    """One blow with a weight [kg] at a speed [rad/s]; returns run, contact and force on the pin, (n, 3) [N]."""
    mbs = exu.SystemContainer().AddSystem()
    turning = np.array([0.0, 0.0, -speed])
    start = {"initialAngularVelocity": turning, "initialVelocity": np.cross(turning, body.centre_of_mass)}
    bar = ep.CreatePartitionBody(mbs, body, name="hammer", frame="floating", damping=0.02, **start)
    ground = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.CreateGround()))
    pin = bar.CreateInterfaceMarker(mbs, "pin")
    joint = mbs.AddObject(items.ObjectJointRevoluteZ(markerNumbers=[ground, pin]))
    at_end = {"referencePosition": [LENGTH, 0, 0], "initialVelocity": np.cross(turning, [LENGTH, 0, 0])}
    point = mbs.CreateMassPoint(mass=weight, **at_end)
    held = [mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=point)), bar.CreateInterfaceMarker(mbs, "end")]
    mbs.AddObject(items.SphericalJoint(markerNumbers=held))
    kind = exu.OutputVariableType.ForceLocal
    sensor = mbs.AddSensor(items.SensorObject(objectNumber=joint, outputVariableType=kind, storeInternal=True))
    anvil = ep.RigidPlane(point=NOSE - [0, GAP, 0], normal=(0, 1, 0))
    contact = ep.CreatePartitionContact(mbs, bar, anvil, name="nose")
    mbs.Assemble()
    run = ep.solve_dynamic(mbs, end_time=0.6e-3, method="implicit", step=2e-6, spectral_radius=0.6)
    return run, contact, run.sensor(sensor)


def rigid_weight(fem):
    """Weight [kg] that moves the centre of percussion of the rigid hammer to its nose."""
    d, L = fem.centre_of_mass[0], LENGTH
    inertia = fem.inertia_tensor[2, 2] + fem.total_mass * d**2
    return (fem.total_mass * d * NOSE[0] - inertia) / (L**2 - L * NOSE[0])


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a coarser mesh, and fewer weights")
    parser.add_argument("--out", type=Path, default=Path("out/quiet_pin"), metavar="DIR")
    options = parser.parse_args(argv)
    fem, body = hammer(options.quick)

    def forces(parameters):
        """What Exudyn's functions call: largest forces on pin and nose [N]."""
        _, contact, pin = (run := blow(body, parameters["weight"], parameters.get("speed", SPEED)))
        return [float(np.linalg.norm(pin, axis=1).max()), float(contact.force(run[0]).max())]

    begin = time.perf_counter()
    population, generations = (5, 2) if options.quick else (12, 5)
    how = {"populationSize": population, "numberOfGenerations": generations, "elitistRatio": 0.2, "distanceFactor": 0}
    how |= {"randomizerInitialization": 0, "showProgress": False}
    best, least, tried, values = GeneticOptimization(lambda one: forces(one)[0], {"weight": WEIGHTS}, **how)
    seconds = time.perf_counter() - begin
    around = {"weight": (best["weight"], 0.05, 1), "speed": (SPEED, 0.05, 1)}
    _, reference, _, sensitivity = ComputeSensitivities(forces, around, scaledByReference=True, showProgress=False)
    by, rigid = np.array(sensitivity) / np.array(reference)[:, None], rigid_weight(fem)
    runs = {weight: blow(body, weight) for weight in (WEIGHTS[0], best["weight"], rigid)}
    impulses = {f"{weight:.3f} kg": float(np.trapezoid(pin[:, 1], run.t)) for weight, (run, _, pin) in runs.items()}
    result = {
        "dofs": body.n_dofs,
        "fe_dofs": fem.n_dofs,
        "time": {"reduce_s": body.reduce_s, "s_a_blow": seconds / len(values)},
        "blows": len(values),
        "weight_kg": best["weight"],
        "rigid_weight_kg": rigid,
        "force_on_pin_N": {"most": max(values), "best": least},
        "impulse_on_pin_Ns": impulses,
        "relative_sensitivity": {"pin": by[0].tolist(), "nose": by[1].tolist()},  # by weight and by speed
        "versions": ep.versions(),
    }
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "result.json").write_text(json.dumps(result, indent=2))
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
    left.plot(tried["weight"], values, "C0o", label="weights that were tried")
    left.axvline(rigid, color="k", linestyle="--", label="centre of percussion at the nose, rigid")
    left.set(xlabel="weight on the end [kg]", ylabel="largest force on the pin [N]")
    for weight, (run, _, pin) in runs.items():
        right.plot(1e3 * run.t, np.linalg.norm(pin, axis=1), label=f"{weight:.3f} kg")
    right.set(xlabel="time [ms]", ylabel="force on the pin [N]")
    left.legend()
    right.legend()
    figure.savefig(picture := options.out / "quiet_pin.png", dpi=150)
    print(json.dumps({key: result[key] for key in list(result)[:-1]}, indent=1), picture.resolve(), sep="\n")
    return result


if __name__ == "__main__":
    main()
