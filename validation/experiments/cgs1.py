"""A cylinder is pressed on a block: NAFEMS' CGS-1, line contact, against line Hertz.

A slice of 2 mm carries the plane problem. Its faces are free, and Poisson's ratio is 0 with E / (1 - nu^2) in the place
of E. The stresses of plane strain under given loads do not depend on the elastic constants, and displacements of the
surfaces depend on E / (1 - nu^2) alone, so that pressure and half width are those of plane strain. A joint guides the
axis of the cylinder, another one holds the foot of the block. Two more keep the slices from
buckling out of their plane.

Quantity: half width, twice the standard deviation of the place by pressure; largest pressure, from the rows in the
inner half of the contact.
Limits: 2 % of both.

    python -m validation.experiments.cgs1 [--quick] [--out JSON]
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

DATA = common.data("cgs1")
SETUP = DATA["setup"]
RADIUS, SIZE, NU = SETUP["cylinder_radius_m"], SETUP["block_m"], SETUP["nu"]
FORCE, SLICE = SETUP["force_N_m"], 2e-3  # [N/m], [m]
LIMITS = {"half_width": 0.02, "pressure": 0.02}


def material(E):
    """The material whose slice with free faces has the contact of plane strain."""
    return ep.Material(E=E / (1 - NU**2), nu=0.0, rho=7800.0)


def reduced(shape, E, half_width, h, center, name, held):
    """Body with a patch around the line of contact and an averaged interface on the nodes that `held` chooses."""
    places = [(x * half_width, y, 0) for x in (-1, -0.5, 0, 0.5, 1) for y in (-SLICE / 2, SLICE / 2)]
    fine = [ep.Refine(place, 0.45 * half_width, h) for place in places]
    fem = ep.fe_model(shape, material(E), maxh=15e-3, refine=fine, grading=0.4)
    part = ep.Partition.ball(fem, (0, 0, 0), 1.25 * half_width, direction=(0, 0, -1 if center[2] > 0 else 1))
    grip = ep.Partition.interface(fem, name, np.flatnonzero(held(fem.points)), kind="averaged", position=center)
    away = np.linalg.norm(fem.points, axis=1)
    near = np.flatnonzero((away > 2 * half_width) & (away < 5 * half_width))
    guide = ep.Partition.interface(fem, "guide", near, kind="averaged", position=(0, 0, 0))
    return ep.reduce(fem, part | grip | guide, f_cut=1e3)


def pressed(half_width, h):
    """Half width [m], largest pressure [Pa], rows and coordinates, and times."""
    begin = time.perf_counter()
    half = occ.Cylinder(occ.Pnt(0, -SLICE / 2, RADIUS), occ.Y, RADIUS, SLICE)
    block = occ.Box(occ.Pnt(-SIZE / 2, -SLICE / 2, -SIZE), occ.Pnt(SIZE / 2, SLICE / 2, 0))
    upper = reduced(half, SETUP["cylinder_E_Pa"], half_width, h, (0, 0, RADIUS), "axis",
                    lambda x: np.hypot(x[:, 0], x[:, 2] - RADIUS) < 0.3 * RADIUS)  # fmt: skip
    lower = reduced(block, SETUP["block_E_Pa"], half_width, h, (0, 0, -SIZE), "foot",
                    lambda x: x[:, 2] < 1e-9 - SIZE)  # fmt: skip
    offline = time.perf_counter() - begin
    mbs = exu.SystemContainer().AddSystem()
    ground = mbs.CreateGround()
    cylinder = ep.CreatePartitionBody(mbs, upper, name="cylinder", frame="inertial")
    foot = ep.CreatePartitionBody(mbs, lower, name="block", frame="inertial")
    axis = cylinder.CreateInterfaceMarker(mbs, "axis")
    for marker, place, axes in ((axis, (0, 0, RADIUS), [1, 1, 0, 1, 1, 1]),
                                (foot.CreateInterfaceMarker(mbs, "foot"), (0, 0, -SIZE), [1] * 6),
                                (cylinder.CreateInterfaceMarker(mbs, "guide"), (0, 0, 0), [0, 1, 0, 1, 0, 0]),
                                (foot.CreateInterfaceMarker(mbs, "guide"), (0, 0, 0), [0, 1, 0, 1, 0, 0])):  # fmt: skip
        fixed = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground, localPosition=list(place)))
        mbs.AddObject(items.GenericJoint(markerNumbers=[fixed, marker], constrainedAxes=axes))
    mbs.AddLoad(items.LoadForceVector(markerNumber=axis, loadVector=[0, 0, -FORCE * SLICE]))
    contact = ep.CreatePartitionContact(mbs, cylinder, foot)
    mbs.Assemble()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ep.errors.PartitionWarning)  # steel would yield, and strain is large
        result = ep.solve_static(mbs, load_steps=4)
    item, patch = contact.sides[0]
    x = item.body.points[item.body.partition.patches[patch].nodes][:, 0]
    rows = contact.row_forces(result)[-1].toarray().ravel()
    a = 2 * math.sqrt(rows @ x**2 / rows.sum() - (rows @ x / rows.sum()) ** 2)
    pressure = contact.pressure(result)[-1].toarray().ravel()
    inner = (pressure > 0) & (abs(x) < 0.5 * a)
    areas = rows[inner] / pressure[inner]
    p0 = float((pressure[inner] / np.sqrt(1 - (x[inner] / a) ** 2)) @ areas / areas.sum())
    row = {
        "half_width_m": a, "pressure_Pa": p0, "force_N_m": float(rows.sum() / SLICE), "rows": contact.n_rows,
        "dofs": upper.n_dofs + lower.n_dofs, "offline_s": offline, "online_s": result.time_s,
    }  # fmt: skip
    return row, (x, pressure)


def hertz():
    """Half width [m] and largest pressure [Pa] of the line contact."""
    yields = sum((1 - NU**2) / SETUP[name] for name in ("cylinder_E_Pa", "block_E_Pa"))
    half_width = math.sqrt(4 * FORCE * RADIUS * yields / math.pi)
    return half_width, 2 * FORCE / (math.pi * half_width)


def draw(path, curve):
    import matplotlib.pyplot as plt

    (x, pressure), (a, p0) = curve, hertz()
    figure, ax = plt.subplots(figsize=(6.5, 4), layout="constrained")
    along = np.linspace(-a, a, 200)
    ax.plot(1e3 * along, 1e-6 * p0 * np.sqrt(1 - (along / a) ** 2), "k-", lw=1, label="line Hertz")
    ax.plot(1e3 * x[pressure > 0], 1e-6 * pressure[pressure > 0], "C3o", ms=3, label="this library, around nodes")
    ax.set(xlabel="place across the line [mm]", ylabel="pressure [MPa]")
    ax.legend()
    figure.savefig(path, dpi=110)


def main():
    given = common.options(__doc__, "coarser elements")
    half_width, pressure = hertz()
    row, curve = pressed(half_width, (0.3 if given.quick else 0.2) * half_width)
    row |= {
        "half_width_error": row["half_width_m"] / half_width - 1,
        "pressure_error": row["pressure_Pa"] / pressure - 1,
    }
    common.show("cylinder on a block", [row])
    found = {"half_width": abs(row["half_width_error"]), "pressure": abs(row["pressure_error"])}
    common.finish(__file__, {"rows": [row]}, found, LIMITS, given, lambda path: draw(path, curve))


if __name__ == "__main__":
    main()
