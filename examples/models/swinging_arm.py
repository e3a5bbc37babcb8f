"""An Exudyn model as it was before: an arm with two bores on a hinge, a torque, gravity, a weight on its other end.

It is the set-up of Exudyn's tutorials on flexible bodies, and does not use exudyn_partition. `add_arm` adds the arm:
any body for which it returns a dict with the rigid-body markers "arm:pin" and "arm:tip".
"""

import time

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
from exudyn.FEM import FEMinterface
from exudyn.utilities import RigidBodyInertia

LENGTH, WIDTH, THICKNESS, BORE = 0.4, 0.04, 0.01, 0.012  # [m], from bore to bore; BORE is a radius
WEIGHT, SIDE = 0.5, 0.03  # cube on the arm's end [kg], [m]
TORQUE, PULSE = 30.0, 0.05  # drive [N m] and how long it acts [s]
GRAVITY = [0, -9.81, 0]
MODES = 8  # fixed-interface modes of Exudyn's body
STEP = 1e-4  # [s]


def arm_shape():
    """Shape of the arm along x, hinged at the origin; the bores are the faces pin and tip."""
    arm = occ.Box(occ.Pnt(-WIDTH, -WIDTH / 2, 0), occ.Pnt(LENGTH + WIDTH, WIDTH / 2, THICKNESS))
    for name, x in (("pin", 0.0), ("tip", LENGTH)):
        bore = occ.Cylinder(occ.Pnt(x, 0, -THICKNESS), occ.Z, r=BORE, h=3 * THICKNESS)
        bore.faces.name = name
        arm -= bore
    return arm


def cms_modes(mesh, material):
    """Exudyn's reduction of an NGSolve mesh; returns its FEMinterface, and adds to the mesh."""
    fem, constants = FEMinterface(), (material.rho, material.E, material.nu)
    fem.ImportMeshFromNGsolve(mesh, *constants, meshOrder=2, boundaryNamesList=["pin", "tip"])
    nodes, weights = fem.GetBoundaryNodeSetsAsLists()
    fem.ComputeHurtyCraigBamptonModes(nodes, MODES, boundaryNodesWeights=weights, timerTreshold=1e9)
    return fem


def drive(mbs, t, load):
    """Torque on the pin at t [s]."""
    return [0, 0, TORQUE * np.sin(np.pi * t / PULSE) ** 2 if t < PULSE else 0.0]


def swing(add_arm, end_time):
    """Let the arm swing; histories of time, displacement of the tip and its deflection, and the run time."""
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
