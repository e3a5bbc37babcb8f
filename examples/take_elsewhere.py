"""Bring FE matrices from elsewhere, and take the reduced body elsewhere: the same impact by Exudyn and by SciPy alone.

Mass and stiffness come from files of Matrix Market, as another FE program may write them, with the nodes and the
surface; elements are not needed. Exudyn lets the reduced ball fall on a rigid plane. The exported matrices then do the
same without Exudyn and without this library: its gaps are a problem of non-negative least squares in each step.
"""

import argparse
import json
from pathlib import Path

import exudyn as exu
import matplotlib.pyplot as plt
import netgen.occ as occ
import numpy as np
import scipy.io
import scipy.linalg
import scipy.optimize

import exudyn_partition as ep

R, SPEED, GAP, STEP, STEPS = 0.01, 1.0, 1e-7, 0.25e-6, 240  # [m], [m/s], [m], [s]


def other_program(folder, fine):
    """Write what stands for another program's files: matrices, nodes and the surface of a ball."""
    ball = occ.Sphere((0, 0, R), R)
    fem = ep.fe_model(ball, ep.STEEL, maxh=4e-3, refine=[ep.Refine((0, 0, 0), 0.6e-3, fine)])
    scipy.io.mmwrite(folder / "K.mtx", fem.stiffness, precision=17)
    scipy.io.mmwrite(folder / "M.mtx", fem.mass, precision=17)
    return fem.points, fem.facets


def by_exudyn(body):
    """Contact force at each step, and the run."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, initialVelocity=[0, 0, -SPEED])
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane((0, 0, -GAP)), rows="node-to-segment")
    mbs.Assemble()
    run = ep.solve_dynamic(mbs, end_time=STEPS * STEP, step=STEP)
    return contact.force(run), run


def by_scipy(folder):
    """The same by the exported matrices alone: central differences, and gaps h + F lam >= 0 with lam >= 0."""
    names = ("mass", "stiffness", "rigid", "contact_pole_rows", "contact_pole_points", "contact_pole_flexibility")
    M, K, rigid, G, points, F = (scipy.io.mmread(folder / f"{name}.mtx") for name in names)
    M, K, L = M.diagonal(), K.tocsr(), scipy.linalg.cholesky(F, lower=True)
    q, v = np.zeros(len(M)), rigid @ [0, 0, -SPEED, 0, 0, 0]

    def forces(q):
        h = points[:, 2] + GAP - G @ q  # directions are outward, downwards here
        return scipy.optimize.nnls(L.T, -scipy.linalg.solve_triangular(L, h, lower=True))[0]

    lam = forces(q)
    total = [lam.sum()]
    for _ in range(STEPS):
        v = v + STEP / 2 * (-K @ q - G.T @ lam) / M
        q = q + STEP * v
        lam = forces(q)
        v = v + STEP / 2 * (-K @ q - G.T @ lam) / M
        total.append(lam.sum())
    return np.array(total)


def main(argv=None):
    """Run the example; returns what it writes to result.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a coarser mesh")
    parser.add_argument("--out", type=Path, default=Path("out/take_elsewhere"), metavar="DIR")
    options = parser.parse_args(argv)
    options.out.mkdir(parents=True, exist_ok=True)
    points, facets = other_program(options.out, 0.25e-3 if options.quick else 0.13e-3)

    # 1. In: matrices of files, checked against the surface and the material; then all goes as with own elements.
    mass, stiffness = ep.read_matrices(options.out / "K.mtx", options.out / "M.mtx").on(np.arange(len(points)))
    fem = ep.FEModel.from_matrices(mass, stiffness, points, facets, material=ep.STEEL)
    patch = ep.Partition.ball(fem, (0, 0, 0), 1.2e-3, direction=(0, 0, -1), name="pole")
    body = ep.reduce(fem, patch, f_cut=60e3)
    force, run = by_exudyn(body)

    # 2. Out: a folder of Matrix Market files, with a legend of their units and meaning.
    folder = body.matrices().save(options.out / "ball")
    elsewhere = by_scipy(folder)

    result = {
        "dofs": body.n_dofs, "fe_dofs": fem.n_dofs, "steps": run.steps, "peak_force_N": float(force.max()),
        "files": sorted(path.name for path in folder.iterdir()),
        "error": {"force": float(abs(elsewhere - force).max() / force.max())}, "versions": ep.versions(),
    }  # fmt: skip
    (options.out / "result.json").write_text(json.dumps(result, indent=2))
    figure, axes = plt.subplots(layout="constrained")
    axes.plot(1e6 * run.t, force, label="Exudyn")
    axes.plot(1e6 * run.t, elsewhere, "k--", label="SciPy, from the exported matrices")
    axes.set(xlabel="time [µs]", ylabel="contact force [N]")
    axes.legend()
    picture = options.out / "take_elsewhere.png"
    figure.savefig(picture, dpi=150)
    axes = ep.plot.bodies(run, bodies=[(run.bodies[0], fem)], colour="deformation", direction=(1, -1.6, 0.2))
    axes.figure.savefig(options.out / "bodies.png", dpi=150)
    print(f"{force.max():.1f} N by both codes; they differ by {result['error']['force']:.1e} of it")
    print(picture.resolve())
    return result


if __name__ == "__main__":
    main()
