"""Bodies that turn: a free bar, a disc on a shaft, a ring, and a press fit grow by centrifugal forces.

References: rho w^2 h^3 / (3 E) at the end of a bar that turns about its middle, h from its end, and the strain
rho w^2 h^2 / (2 E) in its middle; the plane-stress annulus, u = C1 r + C2 / r - (1 - nu^2) rho w^2 r^3 / (8 E), held at
its bore or free; Lame's pressure on a rigid shaft, less what the growth of the bore takes.
Quantity: the largest relative error over bases and truncation frequencies; the share of the six static answers in the
time of a reduction; size of a body's file, and time of a run with contact, by those without the growth.
Limits: 1 % each; a fifth of the reduction; 1.5 times the file; 1.2 times the run.

    python -m validation.joints.growth
"""

import dataclasses
import json
import math
import tempfile
import time
import warnings
from pathlib import Path

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np

import exudyn_partition as ep
from exudyn_partition.reduction.free_body import FreeBody
from validation.contact import scenes

LIMITS = {
    "bar": 0.01,
    "strain": 0.01,
    "rim": 0.01,
    "gap": 0.01,
    "bore": 0.01,
    "press_fit": 0.01,
    "share_of_reduction": 0.2,
    "file": 1.5,
    "run": 1.2,
}
BASES = ("contact-adapted", "residual", "craig-bampton", "free")
STEEL = ep.Material(E=210e9, nu=0.3, rho=7800.0)
BORE, RIM, THICK, CLEARANCE = 0.02, 0.1, 0.01, 1e-4  # of the disc [m]
SEAT, OUTER, WIDTH, OVERLAP = 0.02, 0.04, 0.02, 10e-6  # of the press fit [m]
TURNS = 3  # runs with and without growth, of which the least times count


def bar():
    """Errors of growth and strain of a free bar, by basis and truncation frequency."""
    half, width, omega = 0.1, 0.01, 3000.0
    material = ep.Material(E=70e9, nu=0.0, rho=2700.0)
    shape = occ.Box(occ.Pnt(-half, -width / 2, -width / 2), occ.Pnt(half, width / 2, width / 2))
    fem = ep.fe_model(shape, material, maxh=0.01)
    part = ep.Partition.ball(fem, (half, 0, 0), width)
    gauge = ep.StrainGauge((0, 0, 0), (1, 0, 0), 0.01)
    rows, errors = ep.recovery.gauge_rows(fem, [gauge]), {}
    growth, strain = half**3 / 3, (half**2 - gauge.length**2 / 12) / 2  # times rho w^2 / E
    for basis in BASES:
        for f_cut in (15e3, 30e3) if basis in ("craig-bampton", "free") else (2e3, 15e3, 30e3):
            body = ep.reduce(fem, part, f_cut=f_cut, basis=basis)
            mbs = exu.SystemContainer().AddSystem()
            turning = {"frame": "floating", "initialAngularVelocity": [0, 0, omega]}
            item = ep.CreatePartitionBody(mbs, body, name="bar", damping=ep.Rayleigh(1e4, 0.0), **turning)
            mbs.Assemble()
            result = ep.solve_dynamic(mbs, end_time=2e-3, method="implicit", step=2e-5, spectral_radius=0.5)
            ends = [item.displacement(result, (x, 0, 0))[-1] + (x, 0, 0) for x in (-half, half)]
            grown = np.linalg.norm(ends[1] - ends[0]) / 2 - half
            # A bar that has grown turns more slowly than at first; turns about its own axis do not count.
            load = material.rho * np.sum(item.coordinates_t(result)[-1, 4:6] ** 2) / material.E
            found = grown / (load * growth), item.recover(result, rows)[-1, 0] / (load * strain)
            errors[f"{basis} {f_cut:g} Hz"] = tuple(float(share) - 1 for share in found)
    return errors


def annulus(omega, inner, outer, held):
    """Growth of bore and rim of an annulus, held at its bore or free."""
    E, nu = STEEL.E, STEEL.nu
    k = (1 - nu**2) * STEEL.rho * omega**2 / (8 * E)
    at_bore = [inner, 1 / inner] if held else [1 + nu, -(1 - nu) / inner**2]
    right = [k * inner**3 if held else (3 + nu) * k * inner**2, (3 + nu) * k * outer**2]
    first, second = np.linalg.solve([at_bore, [1 + nu, -(1 - nu) / outer**2]], right)
    return [first * r + second / r - k * r**3 for r in (inner, outer)]


def ring(inner, outer, thick, maxh, refine=()):
    axis = occ.Axes((0, 0, -thick / 2), occ.Z)
    shape = occ.Cylinder(axis, outer, thick) - occ.Cylinder(axis, inner, thick)
    for face in shape.faces:
        flat = abs(abs(face.center.z) - thick / 2) < 1e-7
        face.name = "side" if flat else ("bore" if face.mass < 2.1 * math.pi * inner * thick else "rim")
    return ep.fe_model(shape, STEEL, maxh=maxh, refine=list(refine))


def disc(body, held, steps=300):
    """Growth of bore and rim, and of the patch by its gap; time of the run [s]."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(
        mbs, body, name="disc", frame="floating", initialAngularVelocity=[0, 0, 1500.0], damping=0.2
    )
    if held:
        ground = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.CreateGround()))
        joint = [ground, item.CreateInterfaceMarker(mbs, "shaft")]
        mbs.AddObject(items.GenericJoint(markerNumbers=joint, constrainedAxes=[1, 1, 1, 1, 1, 0]))
    housing = ep.RigidCylinder((0, 0, 0), (0, 0, 1), RIM + CLEARANCE, hollow=True)
    sees = body.basis.flexibility is not None  # contact by compliance needs it
    contact = ep.CreatePartitionContact(mbs, item, housing) if sees else None
    mbs.Assemble()
    begin = time.process_time()
    result = ep.solve_dynamic(mbs, end_time=steps * 1e-5, method="implicit", step=1e-5, spectral_radius=0.5)
    spent, grown = time.process_time() - begin, []
    for radius in (BORE, RIM):
        places = [(radius * math.cos(a), radius * math.sin(a), 0.0) for a in (1.0, 2.5, 4.0, 5.5)]
        moved = [np.linalg.norm((np.array(p) + item.displacement(result, p)[-1])[:2]) for p in places]
        grown.append(float(np.mean(moved)) - radius)
    return *grown, CLEARANCE - contact.gap(result)[-1] if contact else None, spent


def discs():
    """Errors of a held disc's rim and of its gap, and of a free one's bore and rim; what growth costs."""
    fem = ring(BORE, RIM, THICK, 12e-3, [ep.Refine((RIM, 0, 0), 4e-3, 2e-3)])
    patch = ep.Partition.ball(fem, (RIM, 0, 0), 3e-3, direction=(1, 0, 0), name="tip")
    shaft = ep.Partition.interface(fem, "shaft", "bore", position=(0, 0, 0))
    held, gaps, free, cost = {}, {}, {}, {}
    for basis, cuts in (("contact-adapted", (5e3, 15e3)), ("residual", (15e3,)), ("craig-bampton", (15e3,))):
        for f_cut in cuts:
            body = ep.reduce(fem, patch | shaft, f_cut=f_cut, basis=basis)
            _, rim, gap, _ = disc(body, True)
            exact = annulus(1500.0, BORE, RIM, True)[1]
            held[f"{basis} {f_cut:g} Hz"] = (rim / exact - 1,)
            if gap is not None:
                gaps[f"{basis} {f_cut:g} Hz"] = (gap / exact - 1,)
            if f_cut == 5e3:
                cost = costs(fem, patch | shaft, body)
    for basis, f_cut in (("contact-adapted", 5e3), ("residual", 15e3)):
        bore, rim, _, _ = disc(ep.reduce(fem, patch, f_cut=f_cut, basis=basis), False)
        exact = annulus(1500.0, BORE, RIM, False)
        free[f"{basis} {f_cut:g} Hz"] = bore / exact[0] - 1, rim / exact[1] - 1
    return held, gaps, free, cost


def costs(fem, part, body):
    """Share of the six answers in the reduction; file, and time of a run, by those of the body without growth."""
    without = dataclasses.replace(body, basis=dataclasses.replace(body.basis, growth=None))
    start = FreeBody(fem, part)
    flexibility, loads = start.flexibility(), start.centrifugal()
    begin = time.perf_counter()
    flexibility(loads)
    share = (time.perf_counter() - begin) / body.reduce_s
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / name for name in ("with", "without")]
        for path, own in zip(paths, (body, without), strict=True):
            own.save(path)
        size = paths[0].stat().st_size / paths[1].stat().st_size
    spent = [[disc(own, True)[-1] for own in (body, without)] for _ in range(TURNS)]
    run = np.divide(*np.min(spent, axis=0))
    return {"share_of_reduction": share, "file": size, "run": float(run), "reduce_s": body.reduce_s}


def press_fit(f_cut=40e3, omega=1800.0):
    """Error of the pressure that a hub on a rigid shaft has left at a speed, by the loss."""
    fem = ring(SEAT, OUTER, WIDTH, 8e-3)
    seat = ep.Partition.surface(fem, cylinder=((0, 0, 0), (0, 0, 1), SEAT), axes="xyz")
    rim = np.flatnonzero(abs(np.hypot(*fem.points[:, :2].T) - OUTER) < 1e-5)
    part = seat | ep.Partition.interface(fem, "rim", rim, kind="averaged", position=(0, 0, 0))
    mbs = exu.SystemContainer().AddSystem()
    body = ep.reduce(fem, part, f_cut=f_cut)
    item = ep.CreatePartitionBody(mbs, body, name="hub", frame="floating", damping=0.3)
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidCylinder((0, 0, 0), (0, 0, 1), SEAT), interference=OVERLAP)
    mbs.Assemble()
    at_rest = contact.force(ep.solve_static(mbs, load_steps=2, update_initial=True))[-1]
    velocities = mbs.systemData.GetODE2Coordinates_t(exu.ConfigurationType.Initial)
    velocities[5] = omega
    mbs.systemData.SetODE2Coordinates_t(velocities, exu.ConfigurationType.Initial)
    result = ep.solve_dynamic(mbs, end_time=4e-4, method="implicit", step=4e-6, spectral_radius=0.5)
    left = contact.force(result)[-20:].mean() / at_rest
    return left, 1 - annulus(omega, SEAT, OUTER, False)[0] / OVERLAP


def main():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        bars, (held, gaps, free, cost), (left, expected) = bar(), discs(), press_fit()

    def worst(errors, which):
        return float(max(abs(error[which]) for error in errors.values()))

    found = {
        "bar": worst(bars, 0),
        "strain": worst(bars, 1),
        "rim": max(worst(held, 0), worst(free, 1)),
        "gap": worst(gaps, 0),
        "bore": worst(free, 0),
        "press_fit": float(abs(left / expected - 1)),
        **{name: cost[name] for name in ("share_of_reduction", "file", "run")},
    }
    print(
        json.dumps(found, indent=1),
        bars,
        held,
        gaps,
        free,
        f"pressure left {left:.4f} of {expected:.4f}",
        cost,
        sep="\n",
    )
    failed = [key for key, limit in LIMITS.items() if not found[key] <= limit]
    cases = {"bar": bars, "held_disc": held, "gap": gaps, "free_disc": free, "pressure_left": [left, expected]}
    scenes.finish(__file__, {"found": found, "limits": LIMITS, "cases": cases, "reduce_s": cost["reduce_s"]}, failed)


if __name__ == "__main__":
    main()
