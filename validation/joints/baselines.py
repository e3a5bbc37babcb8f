"""The crank slider around its first impact by Exudyn's own means."""

import math
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
from exudyn.FEM import FEMinterface
from scipy.spatial import cKDTree

import exudyn_partition as ep

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples"))
import crank_slider as example


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


def hertz_run(link_body, angle, window, step):
    """Baseline (b): rigid blocks with Hertz' force, the link as it is."""
    mbs, start = exu.SystemContainer().AddSystem(), example.Start(angle)
    pins = example.add_link(mbs, link_body, start)[1]
    radius, backs, heads = example.RADIUS, [], []
    stiffness = 2 / 3 * example.STEEL.plane_strain_modulus * math.sqrt(radius / 2)
    for head, speed, length, side in zip(start.heads, (start.speed, 0.0), example.LENGTHS, (1, -1), strict=True):
        mass = example.STEEL.rho * math.pi * radius**2 * (length - radius / 3)
        node = mbs.AddNode(
            items.NodeRigidBodyRxyz(
                referenceCoordinates=[head - side * length / 2, 0, 0, 0, 0, 0], initialVelocities=[speed, 0, 0, 0, 0, 0]
            )
        )
        body = mbs.AddObject(
            items.ObjectRigidBody(
                nodeNumber=node, mass=mass, inertia=[mass * radius**2 / 2] + [mass * length**2 / 12] * 2 + [0, 0, 0]
            )
        )
        for markers, kind, x in ((backs, items.MarkerBodyRigid, -side), (heads, items.MarkerBodyPosition, side)):
            markers.append(mbs.AddMarker(kind(bodyNumber=body, localPosition=[x * length / 2, 0, 0])))
    drive = example.connect(mbs, start, pins, backs)
    contact = mbs.AddObject(
        items.CartesianSpringDamper(
            markerNumbers=heads,
            springForceUserFunction=lambda mbs, t, i, u, *rest: [-stiffness * max(-u[0], 0.0) ** 1.5, 0, 0],
        )
    )
    force = mbs.AddSensor(
        items.SensorObject(objectNumber=contact, outputVariableType=exu.OutputVariableType.Force, storeInternal=True)
    )
    mbs.Assemble()
    begin = time.perf_counter()
    mbs.SolveDynamic(settings(window, step))
    time_s = time.perf_counter() - begin
    F = mbs.GetSensorStoredData(force)
    torque = -mbs.GetSensorStoredData(drive)[:, 1]
    return {
        "t": F[:, 0],
        "force": abs(F[:, 1]),
        "torque": torque - torque[0],
        "time_s": time_s,
        "steps": len(F) - 1,
        "dofs": link_body.n_dofs + 12,
    }


def cms_link(modes):
    """The link by Exudyn's FEMinterface, fixed-interface modes between its pins; and the time of its reduction."""
    begin = time.perf_counter()
    mesh, fem, steel = ep.generate_mesh(example.link_shape(), maxh=example.LINK_SIZE), FEMinterface(), example.STEEL
    fem.ImportMeshFromNGsolve(
        mesh,
        density=steel.rho,
        youngsModulus=steel.E,
        poissonsRatio=steel.nu,
        meshOrder=2,
        boundaryNamesList=["crank pin", "slider pin"],
    )
    nodes, weights = fem.GetBoundaryNodeSetsAsLists()
    fem.ComputeHurtyCraigBamptonModes(nodes, modes, boundaryNodesWeights=weights, timerTreshold=1e9)
    return fem, time.perf_counter() - begin


def add_cms_link(mbs, fem, start):
    """In place of `crank_slider.add_link`."""
    body = mbs.CreateFFRFReducedOrderObject(
        "link",
        fem,
        referencePosition=start.centre,
        referenceRotationMatrix=start.axes,
        initialVelocity=start.velocity,
        initialAngularVelocity=start.turning,
    )
    unknown = SimpleNamespace(
        energy=lambda result: np.zeros(len(result.t)), velocity=lambda result, point: np.zeros((len(result.t), 3))
    )
    return unknown, [body["link:crank pin"], body["link:slider pin"]]


def cms_blocks(h, region, maxh, modes):
    """The blocks by Exudyn's FEMinterface, with our mesh and patch beside them, and the time of their reduction."""
    blocks, begin = [], time.perf_counter()
    for number, side in ((3, 1), (4, -1)):
        shape = example.block_shape(number)
        mesh = ep.generate_mesh(shape, maxh=maxh, refine=[ep.Refine((0, 0, 0), region, h)], grading=0.5)
        own, fem, steel = ep.fe_model(mesh, example.STEEL), FEMinterface(), example.STEEL
        fem.ImportMeshFromNGsolve(
            mesh,
            density=steel.rho,
            youngsModulus=steel.E,
            poissonsRatio=steel.nu,
            meshOrder=2,
            boundaryNamesList=["back"],
        )
        nodes, weights = fem.GetBoundaryNodeSetsAsLists()
        fem.ComputeHurtyCraigBamptonModes(nodes, modes, boundaryNodesWeights=weights, timerTreshold=1e9)
        patch = ep.Partition.ball(own, (0, 0, 0), region, direction=(side, 0, 0)).patches[0]
        place = cKDTree(fem.GetNodePositionsAsArray()).query(own.points)[1]
        blocks.append((fem, patch, place))
    return blocks, time.perf_counter() - begin


def cms_run(link_body, blocks, angle, window, step, stiffness, radius=0.5e-3):
    """Baseline (a): floating frame bodies of Exudyn, spheres on the nodes of block 4 against triangles of block 3."""
    mbs, start = exu.SystemContainer().AddSystem(), example.Start(angle)
    start.heads = start.heads[0], start.heads[1] + radius
    pins = example.add_link(mbs, link_body, start)[1]
    bodies = [
        mbs.CreateFFRFReducedOrderObject(
            f"block {i}", fem, referencePosition=[head, 0, 0], initialVelocity=[speed, 0, 0]
        )
        for i, ((fem, *_), head, speed) in enumerate(zip(blocks, start.heads, (start.speed, 0.0), strict=True))
    ]
    drive = example.connect(mbs, start, pins, [body[f"block {i}:back"] for i, body in enumerate(bodies)])
    contact = mbs.AddGeneralContact()
    contact.computeContactForces = True
    contact.SetFrictionPairings(np.zeros((1, 1)))
    contact.SetSearchTreeCellSize([4, 8, 8])
    contact.SetSearchTreeBox([start.heads[1] - 3e-3, -2e-3, -2e-3], [start.heads[1] + 33e-3, 2e-3, 2e-3])
    objects = [body["FFRFReducedOrderObjectDict"] for body in bodies]
    _, patch, place = blocks[1]
    for node in patch.nodes:
        marker = mbs.AddMarker(
            items.MarkerSuperElementPosition(
                bodyNumber=objects[1]["oFFRFreducedOrder"], meshNodeNumbers=[int(place[node])], weightingFactors=[1.0]
            )
        )
        contact.AddSphereWithMarker(
            marker, radius=radius, contactStiffness=stiffness, contactDamping=0.0, frictionMaterialIndex=0
        )
    fem, patch, place = blocks[0]
    points = fem.GetNodePositionsAsArray()
    for facet in patch.facets:
        for triangle in ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)):
            nodes = [int(place[facet[k]]) for k in triangle]
            marker = mbs.AddMarker(
                items.MarkerSuperElementRigid(
                    bodyNumber=objects[0]["oFFRFreducedOrder"], meshNodeNumbers=nodes, weightingFactors=[1 / 3] * 3
                )
            )
            contact.AddTrianglesRigidBodyBased(
                rigidBodyMarkerIndex=marker,
                contactStiffness=1e3 * stiffness,  # in series with the spheres'
                contactDamping=0.0,
                frictionMaterialIndex=0,
                pointList=list(points[nodes] - points[nodes].mean(axis=0)),
                triangleList=[[0, 1, 2]],
            )
    place = []

    def on_block_4(mbs, *unused):
        forces = contact.GetSystemODE2RhsContactForces()
        return [float(forces[place[0]]) if len(forces) else 0.0]

    force = mbs.AddSensor(items.SensorUserFunction(sensorUserFunction=on_block_4, storeInternal=True))
    mbs.Assemble()
    place.append(mbs.GetNodeODE2Index(objects[1]["nRigidBody"]))
    begin = time.perf_counter()
    mbs.SolveDynamic(settings(window, step))
    time_s = time.perf_counter() - begin
    F, torque = mbs.GetSensorStoredData(force), -mbs.GetSensorStoredData(drive)[:, 1]
    modes = sum(fem.modeBasis["matrix"].shape[1] for fem, *_ in blocks)
    return {
        "t": F[:, 0],
        "force": F[:, 1],
        "torque": torque - torque[0],
        "time_s": time_s,
        "steps": len(F) - 1,
        "dofs": link_body.n_dofs + 12 + modes,
    }
