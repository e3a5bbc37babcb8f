"""Quadratic and cubic elements: error against unknowns in a bending plate, in a contact, and of a sphere's inertia.

Reference: waves of Rayleigh and Lamb in a steel plate; Hertz' approach of a block under a rigid sphere, as a block of
finite size has it on the finest mesh; mass and inertia of a sphere.
Quantity: relative error of the frequency of a bending wave ten times as long as the plate is thick; of the approach at
the force that makes the contact radius a; the larger one of mass and inertia. Each with the unknowns of the mesh.
Limits: 1 % on the finest cubic mesh of each. Of a plate's bending, cubic elements need at most a quarter of the
unknowns of quadratic ones at an error of 0.75 %, by interpolation between the meshes.

    python -m validation.mesh.order
"""

import netgen.occ as occ
import numpy as np
import scipy.optimize
import scipy.sparse as sp
import scipy.sparse.linalg
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from exudyn_partition.algebra.complementarity import Complementarity
from exudyn_partition.algebra.sparse.multifrontal import Factorisation
from exudyn_partition.fe.model import node_dofs
from exudyn_partition.surfaces.points import contact_points
from exudyn_partition.surfaces.rows import point_matrix
from exudyn_partition.surfaces.surface import Surface
from validation.contact import scenes

THICK, WAVE = 1e-3, 10.0  # thickness of the plate [m]; length of the wave by it
PLATE = {2: (4.0, 2.0, 1.0, 0.7, 0.5), 3: (8.0, 2.0)}  # sizes of elements by the thickness
A, SPHERE, BLOCK = 1.0, 100.0, 16.0  # contact radius, radius of the sphere, sides of the block
PATCH = {2: (2.0, 1.0, 0.7, 0.5, 0.33), 3: (2.0, 1.4, 1.0, 0.7, 0.5)}  # sizes of elements by the contact radius
BALL = {2: (1.0, 0.35, 0.25), 3: (1.0, 0.35)}  # by the radius
LIMITS = {"finest": 0.01, "unknowns": 0.25}
GOAL = 0.0075  # error of the bending wave at which unknowns are compared


def lamb(k):
    """Frequency of the lowest antisymmetric wave of Rayleigh and Lamb in the plate [Hz], by its wavenumber."""
    shear = ep.STEEL.shear_wave_speed
    pressure = np.sqrt((ep.STEEL.lame + 2 * ep.STEEL.shear_modulus) / ep.STEEL.rho)

    def residual(speed):
        a, b = (k * np.sqrt(1 - (speed / c) ** 2) for c in (pressure, shear))
        left = 4 * k**2 * a * b * np.tanh(b * THICK / 2)
        return left - (k**2 + b**2) ** 2 * np.tanh(a * THICK / 2)

    speeds = np.linspace(1e-3, 0.999, 1000) * shear
    first = np.flatnonzero(np.diff(np.sign([residual(c) for c in speeds])))[0]
    return k * scipy.optimize.brentq(residual, *speeds[first : first + 2]) / (2 * np.pi)


def bending(order, size):
    """Error of the frequency of a bending wave in a strip whose ends and sides are planes of symmetry; unknowns."""
    length, width = WAVE * THICK, WAVE * THICK / 2
    shape = occ.Box(occ.Pnt(0, 0, 0), occ.Pnt(length, width, THICK))
    fem = ep.fe_model(shape, ep.STEEL, order=order, maxh=min(size * THICK, length), grading=0.9)
    free = np.ones((fem.n_nodes, 3), dtype=bool)
    for axis, far in ((0, length), (1, width)):
        free[np.isclose(fem.points[:, axis, None], [0.0, far]).any(axis=1), axis] = False
    dofs = np.flatnonzero(free.ravel())
    stiffness, mass = (matrix[dofs][:, dofs].tocsc() for matrix in (fem.stiffness, fem.mass))
    k = 2 * np.pi / (WAVE * THICK)
    exact = lamb(k)
    values, vectors = scipy.sparse.linalg.eigsh(stiffness, 16, mass, sigma=(2 * np.pi * 1.05 * exact) ** 2)
    wave = np.zeros_like(fem.points)
    wave[:, 2] = np.cos(k * fem.points[:, 0])
    share = (wave.ravel()[dofs] @ (mass @ vectors)) ** 2
    return np.sqrt(values[share.argmax()]) / (2 * np.pi * exact) - 1, len(dofs)


def approach(order, size):
    """Approach of a rigid sphere to a block that is held below, over Hertz' for a half-space, and the unknowns."""
    material = ep.Material(E=1.0, nu=0.3, rho=1.0)
    shape = occ.Box(occ.Pnt(-BLOCK / 2, -BLOCK / 2, -BLOCK), occ.Pnt(BLOCK / 2, BLOCK / 2, 0))
    shape.faces.Min(occ.Z).name = "bottom"
    fine = ep.Refine((0.13 * size, 0.21 * size, 0), 1.5 * A, size * A)
    fem = ep.fe_model(shape, material, order=order, maxh=6 * A, refine=[fine], grading=0.4)
    patch = ep.Partition.ball(fem, (0, 0, 0), (1.3 + size) * A).patches[0]
    surface = Surface.of(fem.points, patch, np.zeros(3))
    points = contact_points(surface, "integrated")
    x, y, z = points.at(surface.points).T
    gap = points.mean @ ((x**2 + y**2) / (2 * SPHERE) - z)
    free = np.setdiff1d(np.arange(fem.n_nodes), fem.facets[fem.boundaries["bottom"]])
    n = len(surface.points)
    up = sp.csr_matrix((np.ones(n), (np.arange(n), 3 * surface.nodes + 2)), shape=(n, fem.n_dofs))
    rows = (points.mean @ point_matrix(points.nodes, points.weights, n) @ up)[:, node_dofs(free)]
    factors = Factorisation(fem.stiffness[node_dofs(free)][:, node_dofs(free)])
    problem = Complementarity(rows @ factors.solve(rows.T.toarray()))
    force = 4 / 3 * material.plane_strain_modulus * A**3 / SPHERE
    found = scipy.optimize.brentq(
        lambda d: problem.solve(gap - d).sum() / force - 1, 0.5 * A**2 / SPHERE, 2 * A**2 / SPHERE, rtol=1e-8
    )
    return found / (A**2 / SPHERE) - 1, 3 * len(free)


def inertia(order, size):
    """Larger one of the errors of mass and inertia of a sphere, and the unknowns."""
    radius = 0.01
    shape = occ.Sphere(occ.Pnt(0, 0, 0), radius)
    fem = ep.fe_model(shape, ep.STEEL, order=order, maxh=size * radius)
    mass = ep.STEEL.rho * 4 / 3 * np.pi * radius**3
    exact = np.r_[np.full(3, mass), np.full(3, 0.4 * mass * radius**2)]
    return abs(np.diag(fem.rigid_modes.T @ (fem.mass @ fem.rigid_modes)) / exact - 1).max(), fem.n_dofs


def main():
    result = {"limits": LIMITS}
    for name, measure, sizes in (("bending", bending, PLATE), ("approach", approach, PATCH), ("sphere", inertia, BALL)):
        result[name] = [
            {"order": order, "size": size, **dict(zip(("error", "dofs"), measure(order, size), strict=True))}
            for order, every in sizes.items()
            for size in every
        ]
    # A block is no half-space: errors are those against the finest mesh of cubic elements.
    block = result["approach"][-1]["error"]
    result["block_over_half_space"] = block
    result["approach"] = [run | {"error": (1 + run["error"]) / (1 + block) - 1} for run in result["approach"][:-1]]
    failed = []
    for name in ("bending", "approach", "sphere"):
        table = Table("order", "h", "unknowns", "error", title=name)
        for run in result[name]:
            table.add_row(str(run["order"]), f"{run['size']:g}", str(run["dofs"]), f"{run['error']:+.3%}")
        Console(width=100).print(table)
        failed += [name] * int(abs(result[name][-1]["error"]) > LIMITS["finest"])
    needed = []
    for order in (2, 3):
        runs = sorted((run["error"], run["dofs"]) for run in result["bending"] if run["order"] == order)
        needed.append(np.exp(np.interp(np.log(GOAL), *np.log(np.transpose(runs)))))
    result["unknowns"] = needed[1] / needed[0]
    print(f"unknowns of cubic elements over those of quadratic ones at {GOAL:.2%} of bending: {result['unknowns']:.2f}")
    failed += ["unknowns"] * int(result["unknowns"] > LIMITS["unknowns"])
    scenes.finish(__file__, result, failed)


if __name__ == "__main__":
    main()
