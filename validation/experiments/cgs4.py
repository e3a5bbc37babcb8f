"""A block is pushed up a slope by a horizontal force: NAFEMS' sliding wedge CGS-4.

A weight G stands on a slope of tan(a) = 0.1 with friction mu. It slides when F / G = (tan a + mu) / (1 - mu tan a). A
joint pushes the side of the elastic block horizontally, by a way that grows in load steps of `ep.solve_static`; its
reaction is F. In the axes of the slope, the weight and the push lean.

Quantity: F / G after sliding, for mu of 0, 0.1, 0.2 and 0.3.
Limit: 0.1 %. FrontISTR, a finite element code, is within 0.06 %.

    python -m validation.experiments.cgs4 [--quick] [--out JSON]
"""

import time

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np

import exudyn_partition as ep
from validation.experiments import common

DATA = common.data("cgs4")
SLOPE = np.arctan(DATA["setup"]["tan_slope"])
SIZE, WEIGHT = np.array([40e-3, 40e-3, 10e-3]), 1e4  # of the block [m], [N]
WAY, STEPS = 4e-6, 20  # of the push [m]
LIMITS = {"ratio": 1e-3}


def reduced_block():
    """Block on z = 0, with its top and its side x < 0 as interfaces; and the time of the reduction [s]."""
    begin, half = time.perf_counter(), SIZE / 2
    shape = occ.Box(occ.Pnt(-half[0], -half[1], 0), occ.Pnt(half[0], half[1], SIZE[2]))
    shape.faces.Max(occ.Z).name, shape.faces.Min(occ.X).name = "top", "side"
    fem = ep.fe_model(shape, ep.STEEL, maxh=10e-3)
    foot = ep.Partition.surface(fem, plane=((0, 0, 0), (0, 0, -1)), axes="xyz")
    inner = np.flatnonzero((fem.points[:, 2] > SIZE[2] - 1e-9) & (abs(fem.points[:, :2]).max(axis=1) < 0.9 * half[0]))
    top = ep.Partition.interface(fem, "top", inner, kind="averaged", position=(0, 0, SIZE[2]))
    low = np.flatnonzero((fem.points[:, 0] < -half[0] + 1e-9) & (fem.points[:, 2] > 1e-9))
    side = ep.Partition.interface(fem, "side", low, kind="averaged", position=(-half[0], 0, SIZE[2] / 2))
    return ep.reduce(fem, foot | top | side, f_cut=50e3), time.perf_counter() - begin


def push(body, friction):
    """Horizontal force over weight, by load step."""
    mbs = exu.SystemContainer().AddSystem()
    block = ep.CreatePartitionBody(mbs, body, frame="floating")
    ground = mbs.CreateGround()
    weight = WEIGHT * np.array([-np.sin(SLOPE), 0, -np.cos(SLOPE)])
    top = block.CreateInterfaceMarker(mbs, "top")
    mbs.AddLoad(items.LoadForceVector(markerNumber=top, loadVector=list(weight)))
    lean = np.array([[np.cos(SLOPE), 0, np.sin(SLOPE)], [0, 1, 0], [-np.sin(SLOPE), 0, np.cos(SLOPE)]])
    place = exu.HT(rotation=lean, translation=np.array([-SIZE[0] / 2, 0, SIZE[2] / 2]))
    fixed = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground, localHT=place))
    joint = mbs.AddObject(
        items.GenericJoint(
            markerNumbers=[fixed, block.CreateInterfaceMarker(mbs, "side")], constrainedAxes=[1, 1, 0, 0, 0, 1],
            offsetUserFunction=lambda mbs, t, *unused: [WAY * t, 0, 0, 0, 0, 0],
        )
    )  # fmt: skip
    sensor = mbs.AddSensor(
        items.SensorObject(objectNumber=joint, outputVariableType=exu.OutputVariableType.ForceLocal, storeInternal=True)
    )
    ep.CreatePartitionContact(mbs, block, ep.RigidPlane(), friction=friction or None)
    mbs.Assemble()
    result = ep.solve_static(mbs, load_steps=STEPS, load_factor=False)
    return abs(mbs.GetSensorStoredData(sensor)[:, 1]) / WEIGHT, result.time_s


def draw(path, rows):
    import matplotlib.pyplot as plt

    figure, ax = plt.subplots(figsize=(6, 4), layout="constrained")
    for row in rows:
        (line,) = ax.plot(np.linspace(0, 1e6 * WAY, len(row["steps"])), row["steps"], label=f"mu = {row['friction']:g}")
        ax.axhline(row["theory"], color=line.get_color(), ls="--", lw=0.8)
    ax.set(
        xlabel="way of the push [µm]",
        ylabel="horizontal force over weight",
        title="dashed: rigid bodies",
        ylim=(0, 0.45),
    )
    ax.legend(loc="lower right")
    figure.savefig(path, dpi=110)


def main():
    given = common.options(__doc__, "one coefficient of friction")
    body, offline = reduced_block()
    rows = []
    for row in DATA["rows"][-1:] if given.quick else DATA["rows"]:
        mu, slope = row["friction"], np.tan(SLOPE)
        theory = (slope + mu) / (1 - mu * slope)
        steps, online = push(body, mu)
        rows.append({"friction": mu, "theory": theory, "computed": steps[-1], "error": steps[-1] / theory - 1,
                     "offline_s": offline, "online_s": online, "steps": steps.tolist()})  # fmt: skip
    common.show("sliding wedge", [{k: v for k, v in row.items() if k != "steps"} for row in rows])
    found = {"ratio": max(abs(row["error"]) for row in rows)}
    stored = [{k: v for k, v in row.items() if k != "steps"} for row in rows]
    common.finish(__file__, {"rows": stored}, found, LIMITS, given, lambda path: draw(path, rows))


if __name__ == "__main__":
    main()
