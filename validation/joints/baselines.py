"""The crank slider around its first impact by Exudyn's own methods."""

import math
import time
from types import SimpleNamespace

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
from exudyn.FEM import FEMinterface

import exudyn_partition as ep
from examples.models import crank_slider as example
from examples.models.crank_slider_parts import LENGTHS, LINK_SIZE, RADIUS, STEEL, Start, link_shape
from validation import exudyn_own


def hertz_run(link_body, angle, window, step):
    """Baseline (b): rigid blocks with Hertz' force, the link as it is."""
    mbs, start = exu.SystemContainer().AddSystem(), Start(angle)
    pins = example.add_link(mbs, link_body, start)[1]
    radius, backs, heads = RADIUS, [], []
    stiffness = 2 / 3 * STEEL.plane_strain_modulus * math.sqrt(radius / 2)
    for head, speed, length, side in zip(start.heads, (start.speed, 0.0), LENGTHS, (1, -1), strict=True):
        mass = STEEL.rho * math.pi * radius**2 * (length - radius / 3)
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
    sensor = exudyn_own.add_hertz(mbs, heads, 0, stiffness)
    return histories(mbs, sensor, 0, drive, link_body.n_dofs + 12, window, step)


def histories(mbs, sensor, column, drive, dofs, window, step):
    """Run the model; force, and torque minus its value at the start."""
    mbs.Assemble()
    t, force, time_s = exudyn_own.solve(mbs, sensor, window, step)
    torque = -mbs.GetSensorStoredData(drive)[:, 1]
    return {
        "t": t,
        "force": abs(force[:, column]),
        "torque": torque - torque[0],
        "time_s": time_s,
        "steps": len(t) - 1,
        "dofs": dofs,
    }


def cms_link(modes):
    """The link by Exudyn's FEMinterface, fixed-interface modes between its pins; and the time of its reduction."""
    begin = time.perf_counter()
    mesh, fem, steel = ep.generate_mesh(link_shape(), maxh=LINK_SIZE), FEMinterface(), STEEL
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
    """Replaces `crank_slider.add_link`."""
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


def cms_blocks(parts, modes):
    """Modes of the blocks by Exudyn, with their backs as boundaries, and the time of their computation."""
    found = [exudyn_own.cms(fem, modes, [part.find_interface("back").nodes]) for fem, part in parts]
    return [model for model, _ in found], sum(time_s for _, time_s in found)


def cms_mechanism(link_body, parts, models, angle, apart=0.0):
    """The mechanism with floating frame bodies of Exudyn for blocks: model, start, bodies, drive, number of dofs.

    `parts` are FE model and partition of the blocks, `models` their modes; block 4 stands back by `apart` [m].
    """
    mbs, start = exu.SystemContainer().AddSystem(), Start(angle)
    start.heads = start.heads[0], start.heads[1] + apart
    pins = example.add_link(mbs, link_body, start)[1]
    bodies = [
        exudyn_own.add_cms(mbs, model, velocity=[speed, 0, 0], position=[head, 0, 0])
        for model, head, speed in zip(models, start.heads, (start.speed, 0.0), strict=True)
    ]
    backs = [part.find_interface("back") for _, part in parts]
    markers = [
        mbs.AddMarker(
            items.MarkerSuperElementRigid(
                bodyNumber=body, meshNodeNumbers=[*map(int, back.nodes)], weightingFactors=[*back.weights]
            )
        )
        for (body, _), back in zip(bodies, backs, strict=True)
    ]
    drive = example.connect(mbs, start, pins, markers)
    dofs = link_body.n_dofs + 12 + sum(model.modeBasis["matrix"].shape[1] for model in models)
    return mbs, start, bodies, drive, dofs


def cms_run(link_body, parts, models, angle, window, step, stiffness, radius=0.5e-3):
    """Baseline (a): spheres on the nodes of block 4 against triangles of block 3."""
    mbs, start, bodies, drive, dofs = cms_mechanism(link_body, parts, models, angle, apart=radius)
    (fem, part_3), (_, part_4) = parts
    contact = exudyn_own.add_facet_contact(
        mbs,
        (bodies[1][0], part_4.patch_nodes),
        (bodies[0][0], fem.points, part_3.patches[0].facets),
        radius,
        stiffness,
        (start.heads[1] - 3e-3, -2e-3, -2e-3),
        (start.heads[1] + 33e-3, 2e-3, 2e-3),
    )
    sensor = exudyn_own.sense_facet_contact(mbs, contact, bodies[1][1], 0)
    return histories(mbs, sensor, 0, drive, dofs, window, step)


def cms_hertz_run(link_body, parts, models, angle, window, step):
    """Baseline (c): Hertz' force between the heads' foremost nodes."""
    mbs, _, bodies, drive, dofs = cms_mechanism(link_body, parts, models, angle)
    tips = [part.patch_nodes[abs(fem.points[part.patch_nodes]).sum(axis=1).argmin()] for fem, part in parts]
    markers = [
        mbs.AddMarker(
            items.MarkerSuperElementPosition(bodyNumber=body, meshNodeNumbers=[int(tip)], weightingFactors=[1.0])
        )
        for (body, _), tip in zip(bodies, tips, strict=True)
    ]
    stiffness = 2 / 3 * STEEL.plane_strain_modulus * math.sqrt(RADIUS / 2)
    gap = sum(side * fem.points[tip, 0] for side, (fem, _), tip in zip((-1, 1), parts, tips, strict=True))
    sensor = exudyn_own.add_hertz(mbs, markers, 0, stiffness, gap)
    return histories(mbs, sensor, 0, drive, dofs, window, step)
