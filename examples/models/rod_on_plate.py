"""The paper's impact as a model: FE models and partitions of rod and plate, their run in Exudyn, and its references.

Lengths and thickness are reconstructed, because the paper's Table 1 is missing in our copy. Speed, duration, tip
radius, names of the materials and the measured points are the paper's.

What to learn here: how large a patch has to be, and that the reduced bodies and the full FE reference are made of the
same FE models and partitions.
"""

import math
import time
from pathlib import Path

import exudyn as exu
import netgen.occ as occ

import exudyn_partition as ep

RADIUS, LENGTH = 0.010, 0.800  # rod [m], tip included
SIDE, THICKNESS = 0.250, 0.005  # plate [m]
SPEED = 0.596  # [m/s]
PEAK_FORCE = 800.0  # [N], the paper's estimate from Hertz
P1, P2 = (0, 0, LENGTH), (0, 0, -THICKNESS)  # back end of the rod; plate's face opposite to the impact
NEAR_CONTACT = {"tip": (0, (0, 0, RADIUS)), "plate": (1, (0.02, 0, -THICKNESS))}  # body and point; for oblique impacts
WITH_MASS = ("free", "craig-bampton")  # the patch has mass in these bases: multipliers, steps of nanoseconds
PAPER = {"free": "node-to-segment"}  # the paper's basis comes with the paper's rows
STORED = Path(__file__).parents[1] / "rod_on_plate_reference.npz"


def fe_models(quick, maxh=None, axes="normal"):
    """FE models of rod and plate with their partitions, and the times of meshing and assembly; maxh [m] far away."""
    centre = occ.Pnt(0, 0, RADIUS)
    rod = occ.Cylinder(centre, occ.Z, r=RADIUS, h=LENGTH - RADIUS) + occ.Sphere(centre, RADIUS)
    plate = occ.Box(occ.Pnt(-SIDE / 2, -SIDE / 2, -THICKNESS), occ.Pnt(SIDE / 2, SIDE / 2, 0))
    coarse, h_rod, h_plate = (12e-3, 0.35e-3, 0.45e-3) if quick else (6e-3, 0.20e-3, 0.25e-3)
    maxh = maxh or coarse
    begin = time.perf_counter()
    meshes = [
        ep.generate_mesh(rod, maxh=maxh, refine=[ep.Refine((0, 0, 0), 0.6e-3, h_rod)], grading=0.35),
        ep.generate_mesh(plate, maxh=maxh, refine=[ep.Refine((0, 0, 0), 0.6e-3, h_plate)], grading=0.4),
    ]
    mesh_s, begin = time.perf_counter() - begin, time.perf_counter()
    fems = [ep.fe_model(mesh, material) for mesh, material in zip(meshes, (ep.STEEL, ep.ALUMINIUM), strict=True)]
    times = {"mesh_s": mesh_s, "fem_s": time.perf_counter() - begin}
    # The patch of the tip is larger than the contact circle, that of the plate is even larger. So all nodes of the
    # tip's patch, except those at its rim, face the plate's patch.
    reach = 1.7 * ep.hertz.contact_radius(PEAK_FORCE, RADIUS, math.inf, ep.STEEL, ep.ALUMINIUM)
    region = 1.5e-3 if quick else 1e-3
    partitions = [
        ep.Partition.ball(fems[0], center=(0, 0, 0), radius=region, contact_radius=reach, axes=axes),
        ep.Partition.ball(fems[1], center=(0, 0, 0), radius=region, axes=axes),
    ]
    return fems, partitions, times


def partition_run(fems, partitions, basis, f_cut, method, end_time):
    """Reduce both bodies and let them collide in Exudyn; returns bodies, contact, result and the time of reduction."""
    reduced = []
    for name, fem, partition in zip(("rod", "plate"), fems, partitions, strict=True):
        with ep.progress(f"reduce {name}, {basis}") as report:
            reduced.append(ep.reduce(fem, partition, basis=basis, f_cut=f_cut, progress=report))
    mbs = exu.SystemContainer().AddSystem()
    rod = ep.CreatePartitionBody(mbs, reduced[0], name="rod", initialVelocity=[0, 0, -SPEED])
    plate = ep.CreatePartitionBody(mbs, reduced[1], name="plate")
    formulation = "lagrange" if basis in WITH_MASS else "compliance"
    rows = PAPER.get(basis, "integrated")
    contact = ep.CreatePartitionContact(mbs, rod, plate, formulation=formulation, rows=rows, name="tip on plate")
    mbs.Assemble()
    with ep.progress(f"Exudyn, {method}") as report:
        sample_period = 0.5e-6 if basis in WITH_MASS else None
        result = ep.solve_dynamic(mbs, end_time=end_time, method=method, sample_period=sample_period, progress=report)
    return rod, plate, contact, result, sum(body.reduce_s for body in reduced)


def oblique_run(bodies, along, friction, end_time):
    """Reduced rod and plate, with patches of axes="xyz": the rod also moves along the plate, at `along` [m/s]."""
    mbs = exu.SystemContainer().AddSystem()
    rod = ep.CreatePartitionBody(mbs, bodies[0], name="rod", initialVelocity=[along, 0, -SPEED])
    plate = ep.CreatePartitionBody(mbs, bodies[1], name="plate")
    contact = ep.CreatePartitionContact(mbs, rod, plate, friction=friction, name="tip on plate")
    mbs.Assemble()
    return (rod, plate), contact, ep.solve_dynamic(mbs, end_time=end_time)


def full_reference(fems, partitions, end_time, step=1e-6, *, points=None, along=0.0, friction=None):
    """The full FE model under integrated contact rows; with `along` the rod also moves along the plate [m/s]."""
    bodies = [
        ep.reference.FullBody(fems[0], partitions[0], velocity=(along, 0, -SPEED)),
        ep.reference.FullBody(fems[1], partitions[1]),
    ]
    points = points or {"P1": (0, P1), "P2": (1, P2)}
    with ep.progress("full FE reference") as report:
        history = ep.reference.simulate(
            bodies, end_time=end_time, step=step, points=points, friction=friction, progress=report
        )
    history.info["versions"] = ep.versions()
    return history


def stored_reference(fems):
    """The stored full FE history."""
    reference = ep.History.load(STORED)
    dofs = sum(fem.n_dofs for fem in fems)
    if reference.info["dofs"] != dofs:
        mesher = reference.info["versions"]["ngsolve"]
        print(f"{STORED.name} has another mesh: {reference.info['dofs']} dofs by NGSolve {mesher}, not {dofs}.")
        print("The errors include the difference of the meshes; run with --reference for a reference of your own.")
    return reference
