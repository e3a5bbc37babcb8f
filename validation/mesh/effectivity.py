"""Estimated error of a mesh beside its true one: `ep.mesh_error` in two scenes, by order and size of elements.

Reference: reduced bodies of cubic elements on a finer mesh, so that the difference is due to the mesh.
Quantity: relative L2 difference of the contact force over the impact, as `mesh_error` estimates it and as it is.
Effectivity: the estimated one over the true one.
Limits: effectivity 0.6 to 1.6 where at least one and a half elements are in a contact radius, or cubic ones one.

    python -m validation.mesh.effectivity [--only spheres plate]
"""

import argparse
import time
import warnings

import exudyn as exu
import netgen.occ as occ
import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from validation.contact import scenes

BALL = {"radius": 5e-3, "speed": 0.3, "end": 45e-6, "f_cut": 300e3}
ROD = {"radius": 5e-3, "tip": 8e-3, "length": 40e-3, "speed": 0.5, "end": 100e-6, "f_cut": 100e3}
PLATE = (0.08, 0.08, 0.003)
# Order and size of elements over the contact radius; far from it, of the plate, over its thickness.
SPHERES = ((2, 1.0), (2, 0.7), (2, 0.5), (3, 1.4), (3, 1.0))
FINE_SPHERES = (3, 0.55)
PLATES = ((2, 0.6, 4.0), (2, 0.6, 2.0), (3, 0.9, 4.0))
FINE_PLATE = (3, 0.6, 2.0)
LIMITS = {"least": 0.6, "largest": 1.6}


def spheres(order, size):
    """Models of two balls that touch, the slave first."""
    radius = BALL["radius"]
    mass = scenes.STEEL.rho * 4 / 3 * np.pi * radius**3
    a = ep.hertz.impact(mass / 2, BALL["speed"], radius, radius, scenes.STEEL, scenes.STEEL).contact_radius
    models = []
    for up, h, reach in ((True, size, 1.7), (False, 1.1 * size, 2.2)):
        shape = occ.Sphere(occ.Pnt(0, 0, radius if up else -radius), radius)
        fine = ep.Refine((0, 0, 0), 1.6 * a, h * a)
        fem = ep.fe_model(shape, scenes.STEEL, order=order, maxh=radius / 2, refine=[fine], grading=0.5)
        line = (0, 0, -1 if up else 1)
        models.append((fem, ep.Partition.ball(fem, (0, 0, 0), (reach + h) * a, direction=line)))
    return models, BALL


def plate(order, size, far):
    """Models of a rod with a round tip and of a thin plate."""
    radius, tip, length = ROD["radius"], ROD["tip"], ROD["length"]
    rod = occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, r=radius, h=length) * (
        occ.Sphere(occ.Pnt(0, 0, tip), tip) + occ.Cylinder(occ.Pnt(0, 0, tip), occ.Z, r=tip, h=length)
    )
    mass = scenes.STEEL.rho * np.pi * radius**2 * length
    a = ep.hertz.impact(mass / 3, ROD["speed"], tip, np.inf, scenes.STEEL, ep.ALUMINIUM).contact_radius
    x, y, z = PLATE
    sheet = occ.Box(occ.Pnt(-x / 2, -y / 2, -z), occ.Pnt(x / 2, y / 2, 0))
    models = []
    for shape, material, maxh, h, reach, line in (
        (rod, scenes.STEEL, 4e-3, size, 1.7, -1), (sheet, ep.ALUMINIUM, far * z, 1.1 * size, 2.2, 1)
    ):  # fmt: skip
        fine = ep.Refine((0, 0, 0), 1.6 * a, h * a)
        fem = ep.fe_model(shape, material, order=order, maxh=maxh, refine=[fine], grading=0.4)
        models.append((fem, ep.Partition.ball(fem, (0, 0, 0), (reach + h) * a, direction=(0, 0, line))))
    return models, ROD


SCENES = {"spheres": (spheres, SPHERES, FINE_SPHERES), "plate": (plate, PLATES, FINE_PLATE)}


def reduced(make, sizes):
    """FE models with their bodies, and the impact."""
    models, impact = make(*sizes)
    f_cut = min(impact["f_cut"], *(0.99 * fem.resolved_frequency for fem, _ in models))
    return [(fem, ep.reduce(fem, partition, f_cut=f_cut)) for fem, partition in models], impact


def forces(pairs, impact):
    """Times and contact forces of a run."""
    mbs = exu.SystemContainer().AddSystem()
    (_, first), (_, second) = pairs
    striker = ep.CreatePartitionBody(mbs, first, initialVelocity=[0, 0, -impact["speed"]])
    contact = ep.CreatePartitionContact(mbs, striker, ep.CreatePartitionBody(mbs, second), passes="given")
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=impact["end"], step=impact["end"] / 500)
    return result.t, contact.force(result)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", nargs="+", choices=SCENES, default=[*SCENES])
    warnings.simplefilter("ignore", ep.errors.PartitionWarning)  # coarse meshes say so
    result, judged = {"limits": LIMITS, "scenes": {}}, []
    for name in parser.parse_args().only:
        make, every, fine = SCENES[name]
        pairs, impact = reduced(make, fine)
        t, exact = forces(pairs, impact)
        table = Table("order", "h/a", "unknowns", "true", "estimated", "effectivity", "bodies", "reduce", "estimate",
                      title=f"{name}; reference: {sum(fem.n_dofs for fem, _ in pairs)} unknowns")  # fmt: skip
        runs = result["scenes"][name] = []
        for sizes in every:
            begin = time.perf_counter()
            pairs, impact = reduced(make, sizes)
            reduce_s, begin = time.perf_counter() - begin, time.perf_counter()
            estimate = ep.mesh_error(*pairs, speed=impact["speed"], duration=impact["end"])
            estimate_s = time.perf_counter() - begin
            true = np.linalg.norm(np.interp(t, *forces(pairs, impact)) - exact) / np.linalg.norm(exact)
            run = {
                "order": sizes[0], "size": sizes[1:], "dofs": sum(fem.n_dofs for fem, _ in pairs), "true": true,
                "estimated": estimate.force, "effectivity": estimate.force / true, "reduce_s": reduce_s,
                "estimate_s": estimate_s, "of_bodies": estimate.of_bodies,
            }  # fmt: skip
            runs.append(run)
            if sizes[1] <= (0.7 if sizes[0] == 2 else 1.0):
                judged.append(run["effectivity"])
            table.add_row(
                str(sizes[0]), " ".join(f"{s:g}" for s in sizes[1:]), str(run["dofs"]), f"{true:.2%}",
                f"{estimate.force:.2%}", f"{run['effectivity']:.2f}",
                " ".join(f"{x:.2%}" for x in estimate.of_bodies), f"{reduce_s:.1f} s", f"{estimate_s:.1f} s",
            )  # fmt: skip
        Console(width=120).print(table)
    result |= {"least": min(judged), "largest": max(judged)}
    failed = ["effectivity"] * int(result["least"] < LIMITS["least"] or result["largest"] > LIMITS["largest"])
    scenes.finish(__file__, result, failed)


if __name__ == "__main__":
    main()
