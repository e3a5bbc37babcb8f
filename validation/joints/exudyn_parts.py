"""Three more flexible examples of Exudyn, with their own bodies and converted to reduced bodies of ours.

Scenes, in code of our own: "pendulum" is a soft bar that spring-dampers hold at two nodes of an edge, with 12 free
modes, as in objectFFRFreducedOrderNetgen.py. "bar" hangs on one face by a generic joint, as in NGsolveCraigBampton.py.
"hinge" is a plate with bolt and bushing that turns about the bolt, as in NGsolveCMStutorial.py. Gravity grows within
50 ms, so that the steps of the examples resolve the motion.
Reference: Exudyn's ObjectFFRFreducedOrder of the same mesh, with the modes of the example.
Quantity: displacement of the tip and reaction, relative L2 over the run, and run times of the solver, each the least
of five. Each scene runs with the modulus of the example, which is so low that bodies bend by up to several per cent of
their length, and with one a hundred or a thousand times as high.
Limits: 1e-3 for tip and reaction; our runs take at most 1.1 of the time of Exudyn's. The soft bodies miss the limit,
and `holds` says so: they have no single answer, for linear elastic bodies that bend so much depend on the frame in
which they are linear, which the modes choose. `by_modes` is what our shapes, which are those of mean axes, change of
Exudyn's own body with its Hurty-Craig-Bampton modes, and `same_modes` is our error against Exudyn's body with our
shapes. The script fails if that exceeds twice the limits, or if a stiff body misses them. The reaction of the soft
pendulum may: springs act on the inertia of the undeformed body, see `left_out`.

    python -m validation.joints.exudyn_parts [--quick]
"""

import json
import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
from exudyn.FEM import FEMinterface, HCBstaticModeSelection, ObjectFFRFreducedOrderInterface
from scipy.spatial import cKDTree

import exudyn_partition as ep
from exudyn_partition.frames.floating import FloatingKinematics

LIMIT, NOISE = 1e-3, 1.1
KIND = exu.OutputVariableType
RISE = 50e-3  # [s]
SOLVERS = exu.DynamicSolverType


@dataclass(frozen=True)
class Part:
    """A body of an example, and how it is held."""

    shape: Callable
    material: ep.Material
    interfaces: tuple  # names; the joint is on the first
    modes: int
    maxh: float
    tip: tuple
    gravity: tuple
    order: int = 2
    axes: tuple = ()  # that the joint holds
    joint: tuple = (0, 0, 0)
    corners: tuple = ()  # that springs hold, with their stiffness
    step: float = 1e-3
    damping: float = 0.8  # spectral radius
    solver: object = SOLVERS.GeneralizedAlpha
    stiffer: float = 1e3


def square_bar(half):
    shape = occ.Box((0, -half, -half), (1, half, half))
    shape.faces.Min(occ.X).name = "held"
    return shape


def hinge():
    """A plate, 0.4 x 0.04 x 0.02, with a bolt at its left end and a bushing at its right, both along -y."""
    length, width, height, diameter, depth = 0.4, 0.04, 0.02, 0.03, 0.05
    plate = occ.Box((0, 0, -height / 2), (length, width, height / 2))
    head = occ.Cylinder(occ.Pnt(0, 0, 0), occ.Y, r=1.6 * height, h=width)
    bolt = occ.Cylinder(occ.Pnt(0, -depth, 0), occ.Y, r=diameter / 2, h=depth + width / 2)
    bushing = occ.Cylinder(occ.Pnt(length, -depth, 0), occ.Y, r=diameter, h=depth + width)
    shape = (plate + head + bolt + bushing) - occ.Cylinder(occ.Pnt(length, -depth, 0), occ.Y, r=diameter / 2, h=depth)
    for face in shape.faces:
        if abs(face.mass / (math.pi * diameter * depth) - 1) < 1e-3:  # the lateral surfaces of bolt and hole
            face.name = "bolt" if face.center.x < length / 2 else "bushing"
    return shape


PARTS = {
    "pendulum": Part(
        lambda: square_bar(0.025), ep.Material(E=5e6, nu=0.3, rho=1000.0), (), 12, 0.025, (1, -0.025, -0.025),
        (0, -9.81, 0), order=1, corners=(((0, -0.025, -0.025), (1e9, 1e9, 1e9)), ((0, -0.025, 0.025), (1e9, 1e9, 0))),
        step=5e-4, damping=0.5, solver=SOLVERS.TrapezoidalIndex2, stiffer=100.0,
    ),
    "bar": Part(
        lambda: square_bar(0.025), ep.Material(E=1e8, nu=0.3, rho=1000.0), ("held",), 8, 0.0125, (1, -0.025, -0.025),
        (0, -9.81, 0), order=1, axes=(1, 1, 1, 1, 1, 0), stiffer=100.0,
    ),
    "hinge": Part(
        hinge, ep.Material(E=2e8, nu=0.3, rho=7850.0), ("bolt", "bushing"), 8, 0.02, (0.43, -0.05, 0), (0, 0, -9.81),
        axes=(1, 1, 1, 1, 0, 1), joint=(0, -0.025, 0),
    ),
}  # fmt: skip


def slow(mbs, t, load):
    return [(1 - math.cos(math.pi * min(t / RISE, 1))) / 2 * g for g in load]


def nearest(points, place):
    return int(np.linalg.norm(points - place, axis=1).argmin())


def models(part):
    """FE model and body of ours, Exudyn's FEMinterface with modes, and functions that add them to a model."""
    mesh = ep.generate_mesh(part.shape(), maxh=part.maxh)
    fem = ep.fe_model(mesh, part.material, order=part.order)
    own = exudyns(part, mesh)
    names, points = part.interfaces, own.GetNodePositionsAsArray()
    if not names:
        own.ComputeEigenmodes(part.modes + 1, excludeRigidBodyModes=6, useSparseSolver=True)
        f_cut = own.GetEigenFrequenciesHz()[-2:].mean()
        own.ComputeEigenmodes(part.modes, excludeRigidBodyModes=6, useSparseSolver=True)
        nothing = ep.Partition(np.empty(0, int), (), (), fem.n_nodes, fem.fingerprint)
        body = ep.reduce(fem, nothing, basis="residual", f_cut=f_cut)
        return fem, body, points, lambda mbs: free(mbs, own, points)
    nodes, weights = own.GetBoundaryNodeSetsAsLists()
    mode = HCBstaticModeSelection.RBE2
    own.ComputeHurtyCraigBamptonModes(
        nodes, part.modes, boundaryNodesWeights=weights, computationMode=mode, timerTreshold=1e9
    )
    ends = ep.Partition.interface(fem, names[0], names[0], position=part.joint)
    for name in names[1:]:
        ends |= ep.Partition.interface(fem, name, name)
    body = ep.reduce(fem, ends, f_cut=1.3 * own.GetEigenFrequenciesHz()[-1])
    means = [np.asarray(w) @ points[np.array(n)] for n, w in zip(nodes, weights, strict=True)]
    offsets = np.array([ends.find_interface(name).position for name in names]) - means

    def add(mbs):
        return mbs.CreateFFRFReducedOrderObject("part", own, superElementRigidMarkersOffsets=offsets)

    return fem, body, points, add


def exudyns(part, mesh):
    """Exudyn's FE model."""
    own = FEMinterface()
    m, names = part.material, list(part.interfaces)
    own.ImportMeshFromNGsolve(mesh, m.rho, m.E, m.nu, meshOrder=part.order, boundaryNamesList=names)
    return own


def free(mbs, own, points, part=None):
    """Add Exudyn's body with the modes that it has; for a part with a joint also the marker of its first interface."""
    keys = ObjectFFRFreducedOrderInterface(own).AddObjectFFRFreducedOrder(mbs, positionRef=[0, 0, 0])
    found = {"FFRFReducedOrderObjectDict": keys}
    if part is not None:
        nodes, weights = (of_all[0] for of_all in own.GetBoundaryNodeSetsAsLists())
        found[f"part:{part.interfaces[0]}"] = mbs.AddMarker(
            items.MarkerSuperElementRigid(
                bodyNumber=keys["oFFRFreducedOrder"], meshNodeNumbers=nodes, weightingFactors=weights,
                offset=np.array(part.joint) - np.asarray(weights) @ points[np.array(nodes)],
            )
        )  # fmt: skip
    return found


def with_our_modes(part, body, end_time):
    """Tip and reaction of Exudyn's own body with the shapes of ours, which are those of mean axes."""
    own = exudyns(part, ep.generate_mesh(part.shape(), maxh=part.maxh))
    points = own.GetNodePositionsAsArray()
    same = cKDTree(body.points).query(points)[1]
    shapes = FloatingKinematics(body, np.zeros(3), np.zeros(3), same).rows
    own.modeBasis = {"matrix": shapes, "type": "NormalModes"}
    return run(part, lambda mbs: free(mbs, own, points, part), points, end_time)[:2]


def ours(body):
    return lambda mbs: ep.CreatePartitionBody(mbs, body, name="part", frame="floating", superElement=True)


def run(part, add, points, end_time, halves=1):
    """Displacement of the tip, reaction, and run time of the solver [s]."""
    mbs = exu.SystemContainer().AddSystem()
    keys = add(mbs)
    number, ground = keys["FFRFReducedOrderObjectDict"]["oFFRFreducedOrder"], mbs.CreateGround()
    mass = mbs.AddMarker(items.MarkerBodyMass(bodyNumber=number))
    mbs.AddLoad(items.LoadMassProportional(markerNumber=mass, loadVector=part.gravity, loadVectorUserFunction=slow))
    holders = []
    for place, stiffness in part.corners:
        own = items.MarkerSuperElementPosition(
            bodyNumber=number, meshNodeNumbers=[nearest(points, place)], weightingFactors=[1.0]
        )
        markers = [mbs.AddMarker(own), mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=ground, localPosition=place))]
        spring = items.CartesianSpringDamper(markerNumbers=markers, stiffness=stiffness, damping=[1e7] * 3)
        holders.append((mbs.AddObject(spring), KIND.Force))
    if part.axes:
        held = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground, localPosition=part.joint))
        markers = [held, keys[f"part:{part.interfaces[0]}"]]
        joint = mbs.AddObject(items.GenericJoint(markerNumbers=markers, constrainedAxes=part.axes))
        holders.append((joint, KIND.ForceLocal))
    forces = [
        mbs.AddSensor(items.SensorObject(objectNumber=holder, outputVariableType=kind, storeInternal=True))
        for holder, kind in holders
    ]
    tip = items.SensorSuperElement(
        bodyNumber=number, meshNodeNumber=nearest(points, part.tip), outputVariableType=KIND.Displacement,
        storeInternal=True,
    )  # fmt: skip
    tip = mbs.AddSensor(tip)
    mbs.Assemble()
    settings = exu.SimulationSettings()
    integration = settings.timeIntegration
    integration.endTime, integration.numberOfSteps = end_time, halves * round(end_time / part.step)
    integration.verboseMode, settings.solution.file.write = 0, False
    integration.generalizedAlpha.spectralRadius = part.damping
    integration.newton.useModifiedNewton = True
    settings.solution.sensors.writePeriod = part.step
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    begin = time.perf_counter()
    mbs.SolveDynamic(settings, solverType=part.solver)
    time_s = time.perf_counter() - begin
    x, *f = (mbs.GetSensorStoredData(sensor)[:, 1:] for sensor in (tip, *forces))
    return x, sum(f), time_s


def error(x, reference):
    return float(np.linalg.norm(x - reference) / np.linalg.norm(reference))


def row_of(name, part, end_time, soft):
    """One scene: errors against Exudyn's own body, what half the step and other modes change of it, and run times."""
    fem, body, points, add = models(part)
    x, f, _ = run(part, add, points, end_time)
    x_half, f_half, _ = run(part, add, points, end_time, halves=2)
    y, g, _ = run(part, ours(body), fem.points, end_time)
    ways = {"time_s": (ours(body), fem.points), "exudyn_time_s": (add, points)}
    times = {name: [] for name in ways}
    for _ in range(5):
        for way, model in ways.items():
            times[way].append(run(part, *model, end_time)[2])
    row = {"scene": f"{name}, {'soft' if soft else 'stiff'}", "modulus": part.material.E, "fe_dofs": fem.n_dofs}
    row |= {"dofs": body.n_dofs, "error": {"tip": error(y, x), "reaction": error(g, f)}}
    row["half_step"] = {"tip": error(x_half, x), "reaction": error(f_half, f)}
    row["limits"] = {"tip": LIMIT, "reaction": LIMIT}
    row["by_modes"], row["same_modes"] = {}, {}
    if soft and part.interfaces:
        same = with_our_modes(part, body, end_time)
        for name, first, second in (("by_modes", same, (x, f)), ("same_modes", (y, g), same)):
            row[name] = {key: error(*pair) for key, *pair in zip(("tip", "reaction"), first, second, strict=True)}
    row["told"] = ["reaction"] if soft and not part.interfaces else []  # by `left_out`
    row |= {way: min(taken) for way, taken in times.items()}
    row["holds"] = quick_enough(row) and all(row["error"][key] < limit for key, limit in row["limits"].items())
    return row


def quick_enough(row):
    """Whether our run takes no longer than that of Exudyn's own body."""
    return row["time_s"] < NOISE * row["exudyn_time_s"]


def explained(row):
    """Whether errors beyond their limits are not there with the same modes, or are what `left_out` tells."""
    return all(
        key in row["told"] or row["error"][key] < limit or row["same_modes"].get(key, np.inf) < 2 * limit
        for key, limit in row["limits"].items()
    )


def main(argv=None):
    """Run the script; returns whether all limits hold, but for what the modes change of soft bodies."""
    quick = "--quick" in (sys.argv[1:] if argv is None else argv)
    end_time, rows = 0.2 if quick else 0.5, []
    for name, part in PARTS.items():
        for factor in (1.0, part.stiffer):
            scaled = replace(part, material=replace(part.material, E=factor * part.material.E))
            rows.append(row_of(name, scaled, end_time, factor == 1.0))
            print(rows[-1], flush=True)
    result = {"rows": rows, "limit": LIMIT, "end_time_s": end_time, "versions": ep.versions()}
    if not quick:
        Path(__file__).with_suffix(".json").write_text(json.dumps(result, indent=1) + "\n")
    return all(explained(row) and quick_enough(row) for row in rows)


if __name__ == "__main__":
    sys.exit(not main())
