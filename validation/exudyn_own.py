"""Flexible bodies and contact by Exudyn's own methods, with which the validation compares."""

import time

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
import scipy.sparse as sp
from exudyn.FEM import FEMinterface, ObjectFFRFreducedOrderInterface

from exudyn_partition.fe.facets import FLAT_TRIANGLES


def settings(end_time, step):
    result = exu.SimulationSettings()
    result.timeIntegration.endTime, result.timeIntegration.numberOfSteps = end_time, round(end_time / step)
    result.timeIntegration.generalizedAlpha.spectralRadius = 0.9
    result.timeIntegration.verboseMode, result.solution.file.write = 0, False
    result.timeIntegration.newton.relativeTolerance = 1e-5
    result.timeIntegration.newton.absoluteTolerance = 1e-8
    result.solution.sensors.writePeriod = step
    result.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    return result


def cms(fem, modes, boundaries=()):
    """FEMinterface of an FE model with its modes, and the time of their computation [s].

    Without `boundaries`, lists of nodes, free modes; else Hurty-Craig-Bampton: fixed-interface modes and the static
    answers to six motions of each boundary, as a rigid one, less those of the body.
    """
    begin = time.perf_counter()
    model = FEMinterface()
    model.nodes["Position"] = np.array(fem.points)
    model.massMatrix, model.stiffnessMatrix = sp.csr_matrix(fem.mass), sp.csr_matrix(fem.stiffness)
    model.elements = [{"Name": "solid", "Tet4": fem.cells[:, :4]}]
    if boundaries:
        model.ComputeHurtyCraigBamptonModes([[*map(int, b)] for b in boundaries], modes, timerTreshold=1e9)
    else:
        model.ComputeEigenmodes(modes, excludeRigidBodyModes=6)
    return model, time.perf_counter() - begin


def add_cms(mbs, model, velocity=(0, 0, 0), position=(0, 0, 0)):
    """Add a floating frame body; returns its numbers of object and of rigid node."""
    modes = ObjectFFRFreducedOrderInterface(model, rigidBodyNodeType=exu.NodeType.RotationRotationVector)
    keys = modes.AddObjectFFRFreducedOrder(mbs, positionRef=[*position], initialVelocity=[*velocity])
    return keys["oFFRFreducedOrder"], keys["nRigidBody"]


def add_hertz(mbs, markers, axis, stiffness, gap=0.0):
    """Add Hertz' force between two markers along an axis, the second `gap` above the first when they touch.

    Returns the sensor of the force.
    """

    def push(mbs, t, i, u, *rest):
        force = np.zeros(3)
        force[axis] = -stiffness * max(gap - u[axis], 0.0) ** 1.5
        return force

    contact = mbs.AddObject(items.CartesianSpringDamper(markerNumbers=markers, springForceUserFunction=push))
    kind = exu.OutputVariableType.Force
    return mbs.AddSensor(items.SensorObject(objectNumber=contact, outputVariableType=kind, storeInternal=True))


def add_facet_contact(mbs, slave, master, radius, stiffness, low, high):
    """Add GeneralContact: spheres on nodes of one floating frame body against triangles on facets of another.

    Parameters
    ----------
    slave : (object number, (k,) nodes)
    master : (object number, (n, 3) points [m], (nf, 6) facets)
    radius, stiffness : float
        Of the spheres [m], [N/m].
    low, high : (3,)
        Corners of the box that holds both patches [m].
    """
    contact = mbs.AddGeneralContact()
    contact.computeContactForces = True
    contact.SetFrictionPairings(np.zeros((1, 1)))
    contact.SetSearchTreeCellSize([8 if a < 0.01 else 4 for a in np.subtract(high, low)])
    contact.SetSearchTreeBox([*low], [*high])
    for node in slave[1]:
        marker = mbs.AddMarker(
            items.MarkerSuperElementPosition(bodyNumber=slave[0], meshNodeNumbers=[int(node)], weightingFactors=[1.0])
        )
        contact.AddSphereWithMarker(
            marker, radius=radius, contactStiffness=stiffness, contactDamping=0.0, frictionMaterialIndex=0
        )
    body, points, facets = master
    for facet in facets:
        for triangle in FLAT_TRIANGLES[6]:
            nodes = [int(facet[k]) for k in triangle]
            marker = mbs.AddMarker(
                items.MarkerSuperElementRigid(bodyNumber=body, meshNodeNumbers=nodes, weightingFactors=[1 / 3] * 3)
            )
            contact.AddTrianglesRigidBodyBased(
                rigidBodyMarkerIndex=marker,
                contactStiffness=1e3 * stiffness,  # in series with the spheres'
                contactDamping=0.0,
                frictionMaterialIndex=0,
                pointList=list(points[nodes] - points[nodes].mean(axis=0)),
                triangleList=[[0, 1, 2]],
            )
    return contact


def sense_facet_contact(mbs, contact, node, axis):
    """Add a sensor of the contact's force on the body of a rigid node along an axis; call before Assemble."""

    def on_body(mbs, *unused):
        forces = contact.GetSystemODE2RhsContactForces()
        return [float(forces[mbs.GetNodeODE2Index(node) + axis]) if len(forces) else 0.0]

    return mbs.AddSensor(items.SensorUserFunction(sensorUserFunction=on_body, storeInternal=True))


def solve(mbs, sensor, end_time, step):
    """Run implicit steps; times, absolute values of the sensor's first component, and run time [s]."""
    begin = time.perf_counter()
    mbs.SolveDynamic(settings(end_time, step))
    time_s = time.perf_counter() - begin
    data = mbs.GetSensorStoredData(sensor)
    return data[:, 0], data[:, 1:], time_s
