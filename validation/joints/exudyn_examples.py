"""Models of Exudyn's tutorials, with their own bodies and converted to reduced bodies of ours, idiom by idiom.

Scenes, in code of our own: "arm" is a bar of soft plastic with two bores. It hangs on a generic joint and falls under
gravity, as in CMSexampleCourse.py. "chain" is two bars on spherical joints, as in NGsolveCreateFFRFreducedOrder.py.
Reference: Exudyn's ObjectFFRFreducedOrder with Hurty-Craig-Bampton modes of the same mesh.
Idioms of the arm: markers on FE nodes with an offset or with weights, or markers of interfaces; gravity as a
LoadMassProportional on a MarkerBodyMass, or as an option; sensors of FE nodes, or of node markers; the body's keys, or
its methods.
Quantity: displacement of the tip and reaction of the joint, relative L2 over the run; run times, the least of three.
Limits: 1e-3 for tip and reaction, and 1.1 of the time of Exudyn's own body. The reaction after a sudden start misses
its limit, and `holds` says so: in the tutorial gravity acts at once, which excites vibration that steps of 1 ms do not
resolve. `half_step` is what half the step changes of Exudyn's own reaction. The script fails if ours differs by more
than that, or if another error misses its limit.
A marker of FE nodes with an offset must stop with an InputError: Exudyn turns the offset with the frame of the body,
not with the bore. Exudyn's own modes hold the bore in the frame, ours do not.

    python -m validation.joints.exudyn_examples [--quick]
"""

import json
import math
import sys
import time
from functools import partial
from pathlib import Path

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
from exudyn.FEM import FEMinterface, HCBstaticModeSelection, ObjectFFRFreducedOrderInterface

import exudyn_partition as ep

LIMIT, NOISE = 1e-3, 1.1  # of errors, and of run times by Exudyn's
REPETITIONS = 3  # for run times
PLASTIC = ep.Material(E=1e8, nu=0.3, rho=1000.0)
LENGTH, WIDTH, THICKNESS, BORE = 0.25, 0.032, 0.02, 0.010  # [m], from bore to bore; BORE is a radius
GRAVITY = [0, -9.81, 0]
F_CUT, MODES = 600.0, 16
KIND = exu.OutputVariableType
STEP, RISE = 1e-3, 50e-3  # [s], the time of a step, and that in which gravity grows if it is slow
MIDDLE = np.array([0, 0, THICKNESS / 2])  # of the left bore
TIP = (LENGTH + WIDTH / 2, -WIDTH / 2, 0)


def arm_shape():
    """Bar along x with bores about z, hung at the origin."""
    arm = occ.Box(occ.Pnt(-WIDTH / 2, -WIDTH / 2, 0), occ.Pnt(LENGTH + WIDTH / 2, WIDTH / 2, THICKNESS))
    for name, x in (("left", 0.0), ("right", LENGTH)):
        bore = occ.Cylinder(occ.Pnt(x, 0, -THICKNESS), occ.Z, r=BORE, h=3 * THICKNESS)
        bore.faces.name = name
        arm -= bore
    return arm


def models(maxh):
    """The arm: FE model and body of ours, Exudyn's FEMinterface with modes."""
    mesh = ep.generate_mesh(arm_shape(), maxh=maxh)
    fem = ep.fe_model(mesh, PLASTIC)
    ends = ep.Partition.interface(fem, "left", "left") | ep.Partition.interface(fem, "right", "right")
    body = ep.reduce(fem, ends, f_cut=F_CUT)
    own = FEMinterface()  # after ours, because it changes the mesh
    names = ["left", "right"]
    own.ImportMeshFromNGsolve(mesh, PLASTIC.rho, PLASTIC.E, PLASTIC.nu, meshOrder=2, boundaryNamesList=names)
    nodes, weights = own.GetBoundaryNodeSetsAsLists()
    mode = HCBstaticModeSelection.RBE2
    own.ComputeHurtyCraigBamptonModes(
        nodes, MODES, boundaryNodesWeights=weights, computationMode=mode, timerTreshold=1e9
    )
    return fem, body, own


def on_bore(points):
    """Nodes of the left bore: (k,) int array. The two FE models number mid-side nodes differently."""
    return np.flatnonzero(abs(np.hypot(points[:, 0], points[:, 1]) - BORE) < 1e-5)


def nearest(points, place):
    return int(np.linalg.norm(points - place, axis=1).argmin())


def sensor(mbs, kind, variable, **options):
    return mbs.AddSensor(kind(storeInternal=True, outputVariableType=variable, **options))


def node_bore(mbs, arm, points):
    """Marker of the bore's nodes with equal weights, and the offset of their mean from its axis."""
    nodes = on_bore(points)
    return mbs.AddMarker(
        items.MarkerSuperElementRigid(
            bodyNumber=arm["oFFRFreducedOrder"],
            meshNodeNumbers=nodes,
            weightingFactors=np.full(len(nodes), 1 / len(nodes)),
            offset=MIDDLE - points[nodes].mean(axis=0),
        )
    )


def weighted_bore(mbs, arm, points):
    """Marker of the bore's nodes with weights whose mean of the nodes is on the axis: no offset is left."""
    nodes = on_bore(points)
    equal = np.full(len(nodes), 1 / len(nodes))
    linear = np.vstack([np.ones(len(nodes)), points[nodes].T])
    change = np.linalg.lstsq(linear, np.r_[1, MIDDLE] - linear @ equal, rcond=None)[0]
    return mbs.AddMarker(
        items.MarkerSuperElementRigid(
            bodyNumber=arm["oFFRFreducedOrder"], meshNodeNumbers=nodes, weightingFactors=equal + change
        )
    )


def interface_bore(mbs, arm, points):
    return arm["arm:left"]


def node_tip(mbs, arm, points):
    number = arm["oFFRFreducedOrder"]
    place = {"bodyNumber": number, "meshNodeNumber": nearest(points, TIP)}
    return sensor(mbs, items.SensorSuperElement, KIND.Displacement, **place)


def marker_tip(mbs, arm, points):
    return sensor(mbs, items.SensorMarker, KIND.Displacement, markerNumber=arm.CreateNodeMarker(mbs, TIP))


def mass_load(mbs, arm, **options):
    mass = mbs.AddMarker(items.MarkerBodyMass(bodyNumber=arm["oFFRFreducedOrder"]))
    mbs.AddLoad(items.LoadMassProportional(markerNumber=mass, loadVector=GRAVITY, **options))


def slow_load(mbs, arm):
    def gravity(mbs, t, load):
        return [(1 - math.cos(math.pi * min(t / RISE, 1))) / 2 * g for g in load]

    mass_load(mbs, arm, loadVectorUserFunction=gravity)


LOADS = {"sudden": mass_load, "slow": slow_load}
IDIOMS = {
    "line for line": {},
    "weights": {"bore": weighted_bore},
    "interface's marker": {"bore": interface_bore},
    "gravity=": {"bore": interface_bore, "gravity": None},
    "node marker": {"bore": interface_bore, "tip": marker_tip},
    "all of ours": {"bore": interface_bore, "gravity": None, "tip": marker_tip},
}


def run(mbs, sensors, end_time, step=STEP):
    """Samples of sensors every STEP by plain Exudyn, and its run time."""
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = end_time, round(end_time / step)
    settings.timeIntegration.generalizedAlpha.spectralRadius = 0.8
    settings.timeIntegration.verboseMode, settings.solution.file.write = 0, False
    settings.solution.sensors.writePeriod = STEP
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    begin = time.perf_counter()
    mbs.SolveDynamic(settings)
    return [mbs.GetSensorStoredData(number)[:, 1:] for number in sensors], time.perf_counter() - begin


def fall(add, points, end_time, *, bore=node_bore, tip=node_tip, gravity=mass_load, step=STEP):
    """Hang the arm and let it fall: displacement of the tip and reaction of the joint, and the run time."""
    mbs = exu.SystemContainer().AddSystem()
    arm = add(mbs)
    if gravity is not None:
        gravity(mbs, arm)
    ground = mbs.AddObject(items.ObjectGround())
    held = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground, localPosition=MIDDLE))
    hinge = [1, 1, 1, 1, 1, 0]
    joint = mbs.AddObject(items.GenericJoint(markerNumbers=[held, bore(mbs, arm, points)], constrainedAxes=hinge))
    force = sensor(mbs, items.SensorObject, KIND.ForceLocal, objectNumber=joint)
    return run(mbs, [tip(mbs, arm, points), force], end_time, step)


def chain(add, end_time, *, gravity, step=STEP):
    """Two arms on ball joints, each added with its name and place.

    Returns displacement of the second's end, reaction of the first joint, and run time.
    """
    mbs = exu.SystemContainer().AddSystem()
    arms = [add(mbs, name, [i * LENGTH, 0, 0]) for i, name in enumerate(("first", "second"))]
    for arm in arms:
        gravity(mbs, arm["FFRFReducedOrderObjectDict"])
    ground = mbs.CreateGround(referencePosition=MIDDLE)
    joint = mbs.CreateSphericalJoint(itemNumbers=[arms[0]["first:left"], ground], show=False)
    mbs.CreateSphericalJoint(itemNumbers=[arms[0]["first:right"], arms[1]["second:left"]], show=False)
    end = sensor(mbs, items.SensorMarker, KIND.Displacement, markerNumber=arms[1]["second:right"])
    force = sensor(mbs, items.SensorObject, KIND.Force, objectNumber=joint)
    return run(mbs, [end, force], end_time, step)


def least(simulate):
    """Samples of the first of some equal runs, and the least run time."""
    runs = [simulate() for _ in range(REPETITIONS)]
    return runs[0][0], min(time_s for _, time_s in runs)


def compared(row, original, ours, start):
    """A row with errors, limits and run times. `original` and `ours` run a model, the former with steps of any size."""
    (tip, force), row["exudyn_time_s"] = least(original)
    (_, resolved), _ = original(step=STEP / 2)
    (x, f), row["time_s"] = least(ours)
    row["error"], row["half_step"] = {"tip": error(x, tip), "reaction": error(f, force)}, error(resolved, force)
    row["limits"] = dict.fromkeys(row["error"], LIMIT)
    row["unresolved"] = {"reaction": row["half_step"]} if start == "sudden" else {}
    return row


def error(x, reference):
    return float(np.linalg.norm(x - reference) / np.linalg.norm(reference))


def arm_rows(fem, body, own, end_time):
    """Every idiom of the arm, with sudden and with slow gravity."""
    points, modes = own.GetNodePositionsAsArray(), ObjectFFRFreducedOrderInterface(own)

    def original(mbs):
        return modes.AddObjectFFRFreducedOrder(mbs, positionRef=[0, 0, 0])

    def ours(mbs, **options):
        return ep.CreatePartitionBody(mbs, body, name="arm", frame="floating", superElement=True, **options)

    rows = []
    for start, load in LOADS.items():
        for name, options in IDIOMS.items():
            if "gravity" in options and start == "slow":
                continue  # the option is a constant
            given = {"gravity": GRAVITY} if "gravity" in options else {}
            add = partial(ours, **given)
            row = {"scene": f"arm, {start} gravity", "idiom": name}
            simulate = partial(fall, add, fem.points, end_time, **{"gravity": load} | options)
            try:
                rows.append(compared(row, partial(fall, original, points, end_time, gravity=load), simulate, start))
            except Exception as error_of_exudyn:  # it wraps ours
                if not isinstance(error_of_exudyn.__cause__, ep.errors.InputError):
                    raise
                rows.append(row | {"stopped": str(error_of_exudyn.__cause__)})
    return rows


def chain_rows(body, own, end_time):
    """Two arms, added by the method that Exudyn's tutorial calls, with sudden and with slow gravity.

    Offsets put the markers of Exudyn's own arms on the axes of the bores, where ours are: else joints begin open.
    """
    points = own.GetNodePositionsAsArray()
    means = [np.asarray(w) @ points[np.array(n)] for n, w in zip(*own.GetBoundaryNodeSetsAsLists(), strict=True)]
    offsets = np.array([MIDDLE, np.add(MIDDLE, [LENGTH, 0, 0])]) - means

    def original(mbs, name, place):
        return mbs.CreateFFRFReducedOrderObject(
            name, own, referencePosition=place, superElementRigidMarkersOffsets=offsets
        )

    def ours(mbs, name, place):
        return ep.CreatePartitionBody(
            mbs, body, name=name, frame="floating", superElement=True, referencePosition=place
        )

    return [
        compared(
            {"scene": f"chain, {start} gravity", "idiom": "keys"},
            *(partial(chain, add, end_time, gravity=load) for add in (original, ours)),
            start,
        )
        for start, load in LOADS.items()
    ]


def agrees(row, **more):
    """Whether errors are within their limits, or within what `more` allows; with an offset, whether it was refused."""
    if "stopped" in row or row["idiom"] == "line for line":
        return row["idiom"] == "line for line" and "offset" in row.get("stopped", "")
    return all(row["error"][name] < max(limit, more.get(name, 0.0)) for name, limit in row["limits"].items())


def main(argv=None):
    """Run the script; returns whether errors are within their limits, but for what steps do not resolve."""
    quick = "--quick" in (sys.argv[1:] if argv is None else argv)
    fem, body, own = models(16e-3 if quick else 10e-3)
    end_time = 0.1 if quick else 0.5
    rows = [*arm_rows(fem, body, own, end_time), *chain_rows(body, own, end_time)]
    for row in rows:
        row["holds"] = agrees(row) and ("stopped" in row or row["time_s"] < NOISE * row["exudyn_time_s"])
        print(row)
    counts = {"fe_dofs": fem.n_dofs, "dofs": body.n_dofs, "exudyn_dofs": 6 + own.modeBasis["matrix"].shape[1]}
    result = {"rows": rows, "limit": LIMIT, **counts, "end_time_s": end_time, "versions": ep.versions()}
    if not quick:
        Path(__file__).with_suffix(".json").write_text(json.dumps(result, indent=1) + "\n")
    return all(agrees(row, **row.get("unresolved", {})) for row in rows)


if __name__ == "__main__":
    sys.exit(not main())
