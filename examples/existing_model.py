"""An existing Exudyn model with a reduced body, and one line of it changed.

An arm with two bores swings on a hinge, driven by a torque and pulled by gravity, with a weight on its other end: the
set-up of Exudyn's tutorials on flexible bodies. Once the arm is Exudyn's own body, Hurty-Craig-Bampton modes of
`exudyn.FEM`, once a partition body of the same mesh; all else of the model is the same function.
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
from exudyn.FEM import FEMinterface
from exudyn.utilities import RigidBodyInertia

import exudyn_partition as ep

LENGTH, WIDTH, THICKNESS, BORE = 0.4, 0.04, 0.01, 0.012  # [m], from bore to bore; BORE is a radius
WEIGHT, SIDE = 0.5, 0.03  # cube on the arm's end [kg], [m]
TORQUE, PULSE = 30.0, 0.05  # drive [N m] and how long it acts [s]
GRAVITY = [0, -9.81, 0]
MODES, F_CUT = 8, 10e3  # fixed-interface modes of Exudyn's body; truncation of ours [Hz]
STEP = 1e-4  # [s]


def arm_mesh(maxh):
    """Mesh of the arm along x, hinged at the origin; the bores are the boundaries pin and tip."""
    arm = occ.Box(occ.Pnt(-WIDTH, -WIDTH / 2, 0), occ.Pnt(LENGTH + WIDTH, WIDTH / 2, THICKNESS))
    for name, x in (("pin", 0.0), ("tip", LENGTH)):
        bore = occ.Cylinder(occ.Pnt(x, 0, -THICKNESS), occ.Z, r=BORE, h=3 * THICKNESS)
        bore.faces.name = name
        arm -= bore
    return ep.generate_mesh(arm, maxh=maxh)


def cms_modes(mesh):
    """Exudyn's reduction; returns its FEMinterface."""
    fem, steel = FEMinterface(), ep.STEEL
    fem.ImportMeshFromNGsolve(mesh, steel.rho, steel.E, steel.nu, meshOrder=2, boundaryNamesList=["pin", "tip"])
    nodes, weights = fem.GetBoundaryNodeSetsAsLists()
    fem.ComputeHurtyCraigBamptonModes(nodes, MODES, boundaryNodesWeights=weights, timerTreshold=1e9)
    return fem


def partition_body(mesh):
    """The same with this library."""
    fem = ep.fe_model(mesh, ep.STEEL)
    interfaces = ep.Partition.interface(fem, "pin", "pin") | ep.Partition.interface(fem, "tip", "tip")
    return ep.reduce(fem, interfaces, f_cut=F_CUT), fem.n_dofs


def drive(mbs, t, load):
    """Torque on the pin at t [s]."""
    return [0, 0, TORQUE * np.sin(np.pi * t / PULSE) ** 2 if t < PULSE else 0.0]


def swing(add_arm, end_time):
    """The existing model; `add_arm(mbs)` is the line that changes. Histories of time, tip and deflection, run time."""
    mbs = exu.SystemContainer().AddSystem()
    arm = add_arm(mbs)
    ground = mbs.CreateGround(referencePosition=[0, 0, THICKNESS / 2])
    inertia = RigidBodyInertia(WEIGHT, WEIGHT * SIDE**2 / 6 * np.eye(3))
    weight = mbs.CreateRigidBody(inertia=inertia, referencePosition=[LENGTH, 0, THICKNESS / 2], gravity=GRAVITY)
    pin, tip = arm["arm:pin"], arm["arm:tip"]
    hinge = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground))
    mbs.AddObject(items.ObjectJointRevoluteZ(markerNumbers=[hinge, pin]))
    held = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=weight))
    mbs.AddObject(items.GenericJoint(markerNumbers=[tip, held]))
    mbs.AddLoad(items.LoadTorqueVector(markerNumber=pin, loadVector=[0, 0, 0], loadVectorUserFunction=drive))
    place, axes = (
        mbs.AddSensor(items.SensorMarker(markerNumber=marker, outputVariableType=kind, storeInternal=True))
        for marker, kind in ((tip, exu.OutputVariableType.Position), (pin, exu.OutputVariableType.RotationMatrix))
    )
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = end_time, round(end_time / STEP)
    settings.timeIntegration.generalizedAlpha.spectralRadius = 0.8
    settings.timeIntegration.verboseMode, settings.solution.file.write = 0, False
    settings.solution.sensors.writePeriod = 10 * STEP
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    begin = time.perf_counter()
    mbs.SolveDynamic(settings)
    online_s = time.perf_counter() - begin
    x, A = (mbs.GetSensorStoredData(sensor)[:, 1:] for sensor in (place, axes))
    deflection = np.einsum("tba,tb->ta", A.reshape(-1, 3, 3), x)[:, 1]  # of the tip, in the axes of the hinge
    return mbs.GetSensorStoredData(place)[:, 0], x - x[0], deflection, online_s


def draw(t, runs):
    """Figure of the tip's displacement, and of its deflection in the axes of the hinge."""
    figure, (above, below) = plt.subplots(2, sharex=True, layout="constrained")
    for (label, (tip, deflection)), style in zip(runs.items(), ("-", "--"), strict=True):
        above.plot(1e3 * t, 1e3 * tip[:, :2], style, label=[f"{axis}, {label}" for axis in "xy"])
        below.plot(1e3 * t, 1e3 * deflection, style, label=label)
    above.set(ylabel="displacement of the tip [mm]")
    below.set(ylabel="its deflection [mm]", xlabel="time [ms]")
    for panel in (above, below):
        panel.legend()
    return figure


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="coarser mesh, a tenth of a second")
    parser.add_argument("--out", type=Path, default=Path("out/existing_model"), metavar="DIR")
    options = parser.parse_args(argv)
    maxh, end_time = (10e-3, 0.1) if options.quick else (5e-3, 0.5)

    mesh = arm_mesh(maxh)
    body, fe_dofs = partition_body(mesh)  # first, for FEMinterface changes the mesh
    begin = time.perf_counter()
    fem = cms_modes(mesh)
    cms_reduce_s = time.perf_counter() - begin
    t, *cms, cms_s = swing(lambda mbs: mbs.CreateFFRFReducedOrderObject("arm", fem, gravity=GRAVITY), end_time)
    ours = {"name": "arm", "gravity": GRAVITY, "frame": "floating", "superElement": True}
    t, *own, online_s = swing(lambda mbs: ep.CreatePartitionBody(mbs, body, **ours), end_time)

    errors = [float(np.linalg.norm(x - y) / np.linalg.norm(y)) for x, y in zip(own, cms, strict=True)]
    numbers = {
        "dofs": body.n_dofs,
        "cms_dofs": 6 + fem.modeBasis["matrix"].shape[1],
        "fe_dofs": fe_dofs,
        "time": {"reduce_s": body.reduce_s, "online_s": online_s, "cms_reduce_s": cms_reduce_s, "cms_online_s": cms_s},
        "error": dict(zip(("tip_displacement", "deflection"), errors, strict=True)),
        "largest_deflection_m": float(abs(own[1]).max()),
    }
    result = {**numbers, "left_out": list(body.left_out), "versions": ep.versions()}
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "result.json").write_text(json.dumps(result, indent=2))
    picture = options.out / "existing_model.png"
    draw(t, {"Exudyn's body": cms, "partition body": own}).savefig(picture, dpi=150)
    print(json.dumps(numbers, indent=2))
    print(picture.resolve())
    return result


if __name__ == "__main__":
    main()
