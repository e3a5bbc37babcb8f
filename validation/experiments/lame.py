"""A hub is pressed on a shaft, and pulled off: Lame's pressure, hoop stress, and the force of friction.

Bodies are drawn with the same radius. The contact has `interference=`, which `ep.solve_static` closes in its load
steps. With friction, a second static run pulls the hub by a joint, and begins pressed. No setting is chosen by the
result: meshes have about 250 rows in the seat.

Quantity: mean pressure without friction, on a rigid and on an elastic shaft; hoop stress in the hub; force of the joint
when the hub slides, over mu p A.
Limits: pressure 1 %; hoop stress, mean over the ring in the middle, 2 %; pull-off force 2 %; a preloaded run keeps the
force to 1e-4; 10 s of processor time for each static run. Friction adds 1 % to the pressure, because it holds the ends
of shaft and bore together, and the pull takes 1 to 2 % by Poisson's ratio; theory has neither.

    python -m validation.experiments.lame [--quick] [--out JSON]
"""

import math
import time
import warnings

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np

import exudyn_partition as ep
from validation.experiments import common

DATA = common.data("lame")
SETUP = DATA["setup"]
INNER, OUTER, LENGTH = SETUP["bore_radius_m"], SETUP["hub_radius_m"], SETUP["length_m"]
OVERLAP, FRICTION = SETUP["interference_m"], SETUP["friction"]
STEEL = ep.Material(E=SETUP["E_Pa"], nu=SETUP["nu"], rho=SETUP["rho_kg_m3"])
AREA = 2 * math.pi * INNER * LENGTH
MAXH, F_CUT, WAY, LIES = 7e-3, 50e3, 25e-6, (0, 0, LENGTH / 2)
LIMITS = {"pressure": 0.01, "hoop": 0.02, "pull": 0.02, "preload": 1e-4, "seconds": 10.0}


def cylinder(radius):
    return occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, radius, LENGTH)


def reduced(shape, axes, name, held, place):
    """FE model and body with the seat as patch and an averaged interface on the nodes that `held` chooses."""
    fem = ep.fe_model(shape, STEEL, maxh=MAXH)
    seat = ep.Partition.surface(fem, cylinder=((0, 0, 0), (0, 0, 1), INNER), axes=axes)
    grip = ep.Partition.interface(fem, name, np.flatnonzero(held(fem.points)), kind="averaged", position=place)
    return fem, ep.reduce(fem, seat | grip, f_cut=F_CUT)


def bodies(axes):
    """Hub and shaft, each with its FE model."""
    rim = reduced(cylinder(OUTER) - cylinder(INNER), axes, "rim", lambda x: np.hypot(*x.T[:2]) > OUTER - 1e-5, LIES)
    end = reduced(
        cylinder(INNER), axes, "end", lambda x: (x[:, 2] < 1e-9) & (np.hypot(*x.T[:2]) < 0.5 * INNER), (0, 0, 0)
    )
    return rim, end


def fit(hub, shaft, friction=None):
    """Model of the fit: model, hub, contact, sensor of the joint that holds the hub along the axis, and its way."""
    mbs, way = exu.SystemContainer().AddSystem(), {"z": 0.0}
    outer = ep.CreatePartitionBody(mbs, hub, name="hub", frame="floating")
    ground = mbs.CreateGround()
    inner = ep.RigidCylinder((0, 0, 0), (0, 0, 1), INNER)
    if shaft is not None:
        inner = ep.CreatePartitionBody(mbs, shaft, name="shaft", frame="floating")
        fixed = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground))
        mbs.AddObject(items.GenericJoint(markerNumbers=[fixed, inner.CreateInterfaceMarker(mbs, "end")]))
    grip = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground, localPosition=list(LIES)))
    joint = mbs.AddObject(
        items.GenericJoint(
            markerNumbers=[grip, outer.CreateInterfaceMarker(mbs, "rim")], constrainedAxes=[0, 0, 1, 0, 0, 0],
            offsetUserFunction=lambda mbs, t, *unused: [0, 0, way["z"] * t, 0, 0, 0],
        )
    )  # fmt: skip
    kind = exu.OutputVariableType.ForceLocal
    sensor = mbs.AddSensor(items.SensorObject(objectNumber=joint, outputVariableType=kind, storeInternal=True))
    contact = ep.CreatePartitionContact(mbs, outer, inner, interference=OVERLAP, friction=friction)
    mbs.Assemble()
    return mbs, outer, contact, sensor, way


def timed(solve, **options):
    """Result and processor time [s]."""
    begin = time.process_time()
    result = solve(**options)
    return result, time.process_time() - begin


def pressed(fem, hub, shaft):
    """Pressure, hoop stress over Lame's, the time of the statics, and how far a preloaded run keeps the force."""
    mbs, outer, contact, *_ = fit(hub, shaft)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*nothing holds it against some motion")  # it turns freely
        result, seconds = timed(ep.solve_static, mbs=mbs, load_steps=4, update_initial=True)
    force = contact.force(result)[-1]
    angles, radius = np.linspace(0, 2 * math.pi, 24, endpoint=False), 0.5 * (INNER + OUTER)
    c, s = np.cos(angles), np.sin(angles)
    places = np.column_stack([radius * c, radius * s, np.full(len(angles), LENGTH / 2)])
    xx, yy, _, _, _, xy = outer.stress(result, places, fem)[-1].T
    hoop = float((xx * s**2 + yy * c**2 - 2 * xy * s * c).mean())
    run = ep.solve_dynamic(mbs, end_time=50e-6, method="implicit", step=1e-6)
    return {
        "rows": contact.n_rows, "dofs": hub.n_dofs + (0 if shaft is None else shaft.n_dofs),
        "pressure_Pa": force / AREA, "hoop_Pa": hoop, "hoop_at_m": radius, "static_s": seconds,
        "preload": float(abs(contact.force(run) / force - 1).max()),
    }  # fmt: skip


def pulled(hub, shaft):
    """Pressure with friction, force of the joint by its way, and the times of both static runs."""
    mbs, _, contact, sensor, way = fit(hub, shaft, FRICTION)
    first, press_s = timed(ep.solve_static, mbs=mbs, load_steps=4, update_initial=True)
    way["z"] = WAY
    second, pull_s = timed(ep.solve_static, mbs=mbs, load_steps=10, load_factor=False)
    data = mbs.GetSensorStoredData(sensor)[-len(second.t) :]
    return contact.force(first)[-1] / AREA, (data[1:, 0] * WAY, data[1:, 3]), (press_s, pull_s)


def draw(path, rows, curves):
    import matplotlib.pyplot as plt

    figure, ax = plt.subplots(figsize=(6.5, 4), layout="constrained")
    for color, row in enumerate(rows):
        way, pull = curves[row["shaft"]]
        ax.plot(1e6 * way, 1e-3 * pull, f"C{color}o-", label=f"{row['shaft']} shaft")
        ax.axhline(1e-3 * row["pull_theory_N"], color=f"C{color}", ls="--", lw=0.8)
    ax.set(xlabel="way of the hub [µm]", ylabel="pull [kN]", title="dashed: coefficient times Lame's pressure")
    ax.legend()
    figure.savefig(path, dpi=110)


def main():
    given = common.options(__doc__, "the rigid shaft alone")
    begin = time.perf_counter()
    (fem, hub), (_, shaft) = bodies("normal")
    offline = time.perf_counter() - begin
    (_, rough_hub), (_, rough_shaft) = bodies("xyz")
    rows, curves = [], {}
    for theory in DATA["rows"][:1] if given.quick else DATA["rows"]:
        rigid = theory["shaft"] == "rigid"
        found = pressed(fem, hub, None if rigid else shaft)
        rough, curves[theory["shaft"]], seconds = pulled(rough_hub, None if rigid else rough_shaft)
        pull, p = float(curves[theory["shaft"]][1][-1]), theory["pressure_Pa"]
        lame = p * INNER**2 / (OUTER**2 - INNER**2) * (1 + (OUTER / found["hoop_at_m"]) ** 2)
        rows.append({
            "shaft": theory["shaft"], "rows": found["rows"], "dofs": found["dofs"],
            "pressure_error": found["pressure_Pa"] / p - 1, "hoop_error": found["hoop_Pa"] / lame - 1,
            "pressure_error_with_friction": rough / p - 1,
            "pull_N": pull, "pull_theory_N": theory["pull_N"], "pull_error": pull / theory["pull_N"] - 1,
            "preload": found["preload"], "offline_s": offline, "online_s": found["static_s"],
            "press_s": seconds[0], "pull_s": seconds[1],
        })  # fmt: skip
    common.show("press fit", rows)
    found = {
        "pressure": max(abs(row["pressure_error"]) for row in rows),
        "hoop": max(abs(row["hoop_error"]) for row in rows),
        "pull": max(abs(row["pull_error"]) for row in rows),
        "preload": max(row["preload"] for row in rows),
        "seconds": max(max(row["online_s"], row["press_s"], row["pull_s"]) for row in rows),
    }
    common.finish(__file__, {"rows": rows}, found, LIMITS, given, lambda path: draw(path, rows, curves))


if __name__ == "__main__":
    main()
