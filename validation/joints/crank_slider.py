"""Crank slider: contact force and torque around the first impact against full FE blocks, and the whole turn.

Reference: both blocks as full FE models in the same mechanism, over a window from 20 us before the first impact. The
mechanism's motion as rigid bodies is prescribed; what the impact adds to it is linear: both FE models, the link's modes
and the spring-damper, joined by their pins and slides, in the configuration at the impact (the link turns by 4 mrad in
the window). Time integration is that of `exudyn_partition.reference`; halving its step shows its own error.
Quantity: peak, impulse and relative L2 error of the contact force, relative L2 error of the torque that the impact adds,
beside run times; convergence in step, truncation and link modes; the paper's scheme; Exudyn's own means: (a) floating
frame bodies with Hurty-Craig-Bampton modes and penalty contact (GeneralContact), its stiffness scanned, (b) rigid
blocks with Hertz' force. The whole turn: run time, energy balance, explicit against implicit.
Limits: peak and impulse 1 %, force 3 %, torque 2 % for the recommended setting; energy 0.5 % of the drive's work; the
integrators within 1 %; baseline (a) at least 20 times slower at no smaller force error.

    python validation/crank_slider.py [--quick]
"""

import argparse
import contextlib
import json
import math
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
import scipy.sparse as sp
from exudyn.FEM import FEMinterface
from rich.console import Console
from rich.table import Table
from scipy.spatial import cKDTree

import exudyn_partition as ep
from exudyn_partition.contact.complementarity import Complementarity
from exudyn_partition.contact.rows import pair_surfaces
from exudyn_partition.contact.surface import Surface
from exudyn_partition.fem import node_dofs
from exudyn_partition.linalg import one_blas_thread
from exudyn_partition.reference import _HHT

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "examples"))
import crank_slider as example  # noqa: E402

BEFORE, WINDOW = 20e-6, 0.4e-3  # [s]
ANGLE = example.CONTACT_ANGLE - BEFORE * example.SPEED
LIMITS = {"peak": 0.01, "impulse": 0.01, "force": 0.03, "torque": 0.02, "energy": 0.005, "integrators": 0.01}


class Structure(_HHT):
    """A linear structure under contact and joint forces: HHT with its matrices, starting at rest."""

    def __init__(self, mass, stiffness, rows, step, alpha=0.1):
        fem = SimpleNamespace(mass=mass, stiffness=stiffness, n_dofs=mass.shape[0], n_nodes=mass.shape[0] // 3)
        super().__init__(SimpleNamespace(fem=fem, mass="consistent", velocity=np.zeros(3)), rows, step, alpha)
        self.u, self.v, self.a = (np.zeros(mass.shape[0]) for _ in range(3))


def interface_rows(fem, partition, name):
    """(6, 3n) csr rows of an interface on the nodal displacements."""
    interface = partition.find_interface(name)
    dofs = node_dofs(interface.nodes)
    where = np.repeat(np.arange(6), len(dofs)), np.tile(dofs, 6)
    return sp.csr_matrix((interface.motion.ravel(), where), shape=(6, fem.n_dofs))


@one_blas_thread()
def full_blocks(parts, link_body, angle, step, rows_kind, slave_is_3, alpha=0.1):
    """Histories of contact force and of the torque that the impact adds, with full FE blocks."""
    begin = time.perf_counter()
    (fem3, part3), (fem4, part4) = parts
    x, rate = example.slider(angle)
    pin = -example.CRANK * np.array([math.cos(angle), math.sin(angle), 0])
    arm = np.array([x, 0, 0]) - pin
    A = np.array([[arm[0], -arm[1], 0], [arm[1], arm[0], 0], [0, 0, example.LINK]]) / example.LINK
    ends = [np.kron(np.eye(2), A) @ link_body.interface_rows(name) for name in ("crank pin", "slider pin")]
    back3, back4 = interface_rows(fem3, part3, "back"), interface_rows(fem4, part4, "back")

    # Joints, all of the motion that the impact adds.
    n_link = link_body.n_dofs
    nothing = sp.csr_matrix((5, fem3.n_dofs))
    joints_a = sp.vstack(
        [
            sp.hstack([nothing, ends[0][:5]]),  # the crank's pin goes as it is driven
            sp.hstack([back3[:2], -ends[1][:2]]),  # the slider's pin
            sp.hstack([back3[1:], sp.csr_matrix((5, n_link))]),  # the slide
        ],
        format="csr",
    )
    joints_b = back4[1:]
    spring = back4[:1]

    heads = x + example.LENGTHS[0], example.slider(example.CONTACT_ANGLE)[0] + example.LENGTHS[0]
    surfaces = [
        Surface.of(fem.points, part.patches[0], np.array([head, 0, 0]))
        for (fem, part), head in zip(parts, heads, strict=True)
    ]
    order = (0, 1) if slave_is_3 else (1, 0)
    contact = pair_surfaces(*(surfaces[i] for i in order), rows_kind)
    G = contact.matrices(*(len(surfaces[i].points) for i in order))
    G = [G[order.index(i)] for i in (0, 1)]
    wide = []
    for (fem, part), g in zip(parts, G, strict=True):
        dofs = node_dofs(part.patches[0].nodes)
        pick = sp.csr_matrix((np.ones(len(dofs)), (np.arange(len(dofs)), dofs)), shape=(len(dofs), fem.n_dofs))
        wide.append(sp.csr_matrix(g @ pick))
    along = np.asarray(G[0] @ np.tile([1.0, 0, 0], G[0].shape[1] // 3)).ravel()  # gaps by the slider's motion
    nc = len(contact)

    mass_a = sp.block_diag([fem3.mass, link_body.mass], format="csr")
    stiffness_a = sp.block_diag([fem3.stiffness, link_body.stiffness], format="csr")
    rows_a = sp.vstack([sp.hstack([wide[0], sp.csr_matrix((nc, n_link))]), joints_a], format="csr")
    rows_b = sp.vstack([wide[1], joints_b, spring], format="csr")
    stiffness_b = sp.csr_matrix(fem4.stiffness + example.STIFFNESS * spring.T @ spring)
    a = Structure(mass_a, stiffness_a, rows_a, step, alpha)
    b = Structure(fem4.mass, stiffness_b, rows_b, step, alpha)

    # Compliances of contact rows (c), joints (j) and the damper's row (the last of b).
    Fa, Fb = a.compliance(), b.compliance()
    ja, jb = np.arange(nc, nc + joints_a.shape[0]), np.arange(nc, nc + 5)
    F = Fa[:nc, :nc] + Fb[:nc, :nc]
    for full, j in ((Fa, ja), (Fb, jb)):
        F -= full[:nc][:, j] @ np.linalg.solve(full[np.ix_(j, j)], full[j][:, :nc])
    problem = Complementarity((F + F.T) / 2)
    steps = round(WINDOW / step)
    t = step * np.arange(steps + 1)
    force, torque = np.zeros(steps + 1), np.zeros(steps + 1)
    setup_s, begin = time.perf_counter() - begin, time.perf_counter()
    damper = 0.0
    for n in range(1, steps + 1):
        moved = example.slider(angle + example.SPEED * t[n])[0] - x
        ga, gb = a.predict(), b.predict()
        gb = gb + Fb[:, -1] * damper
        joint = [-np.linalg.solve(full[np.ix_(j, j)], g[j]) for full, j, g in ((Fa, ja, ga), (Fb, jb, gb))]
        gap = contact.gap + along * moved + ga[:nc] + gb[:nc] + Fa[:nc][:, ja] @ joint[0] + Fb[:nc][:, jb] @ joint[1]
        lam = problem.solve(gap)
        joint[0] -= np.linalg.solve(Fa[np.ix_(ja, ja)], Fa[ja][:, :nc] @ lam)
        joint[1] -= np.linalg.solve(Fb[np.ix_(jb, jb)], Fb[jb][:, :nc] @ lam)
        a.correct(np.r_[lam, joint[0]])
        b.correct(np.r_[lam, joint[1], damper])
        damper = -example.DAMPING * float((spring @ b.v)[0])
        force[n] = lam.sum()
        torque[n] = pin[0] * joint[0][1] - pin[1] * joint[0][0]  # what the drive gives the link by the pin
    mean = lambda x: np.r_[(x[:-1] + x[1:]) / 2, x[-1]]  # noqa: E731 multipliers are of the step that ends at t
    return {
        "t": t,
        "force": mean(force),
        "torque": mean(torque),
        "setup_s": setup_s,
        "time_s": time.perf_counter() - begin,
        "dofs": fem3.n_dofs + fem4.n_dofs + n_link,
        "contact_nodes": nc,
    }


# Runs of the mechanism in Exudyn.


def partition_run(bodies, step, scheme="contact-adapted", method="implicit", angle=ANGLE, end_time=WINDOW):
    """Histories of a run; the torque is what the impact adds, the run without it subtracted."""
    found = []
    for contact_angle in (example.CONTACT_ANGLE, math.pi):  # the second never touches in the window
        with mock(example, "CONTACT_ANGLE", contact_angle):
            model = example.mechanism(bodies[0], bodies[1:], scheme, angle)
        if method == "explicit":
            result = ep.solve_dynamic(model.mbs, end_time=end_time, step=step)
        else:
            result = example.run(model, end_time, step, free_step=step)
        found.append(model.histories(result))
    t = found[0]["t"]
    return {
        "t": t,
        "force": found[0]["force"],
        "torque": found[0]["torque"] - np.interp(t, found[1]["t"], found[1]["torque"]),
        "time_s": result.time_s,
        "steps": result.steps,
        "dofs": sum(body.n_dofs for body in bodies),
    }


@contextlib.contextmanager
def mock(module, name, value):
    """Set a module's constant for a while."""
    before = getattr(module, name)
    setattr(module, name, value)
    try:
        yield
    finally:
        setattr(module, name, before)


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


def hertz_run(link_body, step):
    """Baseline (b): rigid blocks with Hertz' force, the link as it is."""
    mbs, start = exu.SystemContainer().AddSystem(), example.Start(ANGLE)
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
    mbs.SolveDynamic(settings(WINDOW, step))
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


def cms_blocks(shapes, h, region, maxh, modes):
    """The blocks by Exudyn's FEMinterface, with our mesh and patch beside them, and the time of their reduction."""
    blocks, begin = [], time.perf_counter()
    for shape, side in zip(shapes, (1, -1), strict=True):
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


def cms_run(link_body, blocks, step, stiffness, radius=0.5e-3):
    """Baseline (a): floating frame bodies of Exudyn, spheres on the nodes of block 4 against triangles of block 3."""
    mbs, start = exu.SystemContainer().AddSystem(), example.Start(ANGLE)
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
    mbs.SolveDynamic(settings(WINDOW, step))
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
