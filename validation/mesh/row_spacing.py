"""Error of a contact's rows by their spacing: impact of a sphere on a half-space, with rows on random grids alone.

Reference: the impact by Hertz' force, integrated to 1e-10. The half-space is Boussinesq's, with even pressure on small
squares (Love 1929). Rows are hat functions on a triangular mesh of random vertices: on its triangles divided into 4 or
9, as those of quadratic and cubic facets; and on the coarser grid that `ep.mesh_error` compares with.
Quantity: relative L2 error of the force over the impact, RMS over random grids, for rows and coarser rows; their
difference over the error; correlation of both errors, from these three.
Limits: errors fall with a power of 2.5 to 3.5 of the spacing; the difference over the error is sqrt(k^6 + 1), which
independent errors make, within 30 %, where k is the ratio of spacings.

    python -m validation.mesh.row_spacing
"""

import itertools

import matplotlib.tri
import numpy as np
import scipy.integrate
import scipy.signal
import scipy.sparse as sp
from rich.console import Console
from rich.table import Table
from scipy.spatial import Delaunay

from exudyn_partition.prediction.modal_impact import Impact
from validation.contact import scenes

# Lengths by the largest contact radius; the effective modulus, the sphere's radius and its speed are 1.
WIDTH, CELLS = 1.9, 152  # half of the grid's side, and its squares
MASS, END, STEPS = 16 / 15, 3.2, 800
GRIDS = 10
CASES = ((2, 1, 0.5), (2, 1, 0.7), (2, 1, 1.0), (3, 2, 0.7), (3, 2, 1.0), (3, 2, 1.3))  # divisions, coarser ones, h / a
LIMITS = {"least_rate": 2.5, "largest_rate": 3.5, "off_independent": 0.3}

_middle = (np.arange(CELLS) + 0.5) / CELLS * 2 * WIDTH - WIDTH
PLACES = np.stack(np.meshgrid(_middle, _middle, indexing="ij"), axis=-1).reshape(-1, 2)


def influence():
    """Displacement by an even unit pressure on a square of the grid, at all offsets."""
    side = 2 * WIDTH / CELLS
    x, y = np.meshgrid(*[(np.arange(2 * CELLS - 1) - CELLS + 1) * side] * 2, indexing="ij")

    def of_corner(x, y):
        return x * np.log(y + np.hypot(x, y)) + y * np.log(x + np.hypot(x, y))

    signs = itertools.product((1, -1), repeat=2)
    return sum(i * j * of_corner(x + i * side / 2, y + j * side / 2) for i, j in signs) / np.pi


def divided(triangles, points, k):
    """Points and triangles of a mesh whose triangles are divided into k^2 each."""
    shares = np.array([(k - i - j, i, j) for i in range(k + 1) for j in range(k + 1 - i)]) / k
    number = {tuple(np.rint(k * share[1:]).astype(int)): n for n, share in enumerate(shares)}
    parts = [(number[i, j], number[i + 1, j], number[i, j + 1]) for i, j in number if i + j < k]
    parts += [(number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]) for i, j in number if i + j < k - 1]
    every = np.einsum("sc,tcx->tsx", shares, points[triangles]).reshape(-1, 2)
    _, first, index = np.unique(every.round(9), axis=0, return_index=True, return_inverse=True)
    own = index.reshape(len(triangles), -1)
    return every[first], own[:, parts].reshape(-1, 3)


def hats(points, triangles):
    """Hat functions at the middles of the grid's squares."""
    mesh = matplotlib.tri.Triangulation(*points.T, triangles)
    found = mesh.get_trifinder()(*PLACES.T)
    inside = np.flatnonzero(found >= 0)
    corners = triangles[found[inside]]
    a, b, c = (points[corners[:, i]] for i in range(3))
    local = np.linalg.solve(np.stack([b - a, c - a], axis=-1), (PLACES[inside] - a)[..., None])[..., 0]
    shares = np.column_stack([1 - local.sum(axis=1), local])
    places = (corners.ravel(), np.repeat(inside, 3))
    return sp.csr_matrix((shares.ravel(), places), shape=(len(points), len(PLACES)))


def force(rows, t, kernel):
    """Force of the impact at some times, with rows on one grid."""
    area = np.asarray(rows.sum(axis=1)).ravel()
    rows = sp.diags(1 / area[area > 0]) @ rows[area > 0]
    gap = rows @ ((PLACES**2).sum(axis=1) / 2)
    near = gap < 1.2  # the sphere comes to 1
    gap, rows = gap[near], rows[near].toarray()
    square, own = (2 * WIDTH / CELLS) ** 2, slice(CELLS - 1, 2 * CELLS - 1)
    shape = CELLS, CELLS
    moved = [scipy.signal.fftconvolve(row.reshape(shape) / square, kernel)[own, own].ravel() for row in rows]
    F = np.array(moved) @ rows.T
    impact = Impact(
        gap=gap,
        H=np.full((len(gap), 1), MASS**-0.5),
        F=(F + F.T) / 2,
        omega=np.zeros(1),
        velocity=np.array([-(MASS**0.5)]),
        size=1.0,
    )
    at, found, _ = impact.run(END, END / STEPS)
    return np.interp(t, at, found[:, 0])


def exact(t):
    """Force by Hertz."""
    run = scipy.integrate.solve_ivp(
        lambda _, y: [y[1], -4 / 3 * max(y[0], 0.0) ** 1.5 / MASS], (0, END), [0, 1], rtol=1e-10, atol=1e-12, t_eval=t
    )
    return 4 / 3 * np.maximum(run.y[0], 0) ** 1.5


def vertices(h, rng):
    """Vertices of a mesh of equal triangles, moved at random, shifted and turned."""
    i, j = (x.ravel() for x in np.mgrid[-12:13, -8:9])
    points = h * np.column_stack([i + j / 2, np.sqrt(0.75) * j])
    points += h * (rng.uniform(-0.5, 0.5, 2) + 0.13 * rng.normal(size=points.shape))
    angle = rng.uniform(0, np.pi)
    points = points @ [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return points[np.hypot(*points.T) < 1.8 + h]


def main():
    rng, kernel, t = np.random.default_rng(0), influence(), np.linspace(0, END, STEPS + 1)
    hertz = exact(t)
    table = Table("division", "h / a", "spacing / a", "error", "of coarser rows", "power", "difference / error",
                  "independent", "correlation", title=f"{GRIDS} grids each")  # fmt: skip
    cases, failed = [], []
    for fine, coarse, h in CASES:
        runs = []
        for _ in range(GRIDS):
            points = vertices(h, rng)
            triangles = Delaunay(points).simplices
            found = [force(hats(*divided(triangles, points, k)), t, kernel) for k in (fine, coarse)]
            pairs = (found[0], hertz), (found[1], hertz), found
            runs.append([np.linalg.norm(a - b) / np.linalg.norm(hertz) for a, b in pairs])
        error, of_coarse, difference = np.sqrt(np.mean(np.square(runs), axis=0))
        k = fine / coarse
        case = {
            "division": fine, "coarser": coarse, "h_over_a": h, "spacing_over_a": h / fine, "error": error,
            "of_coarser": of_coarse, "difference": difference, "rate": np.log(of_coarse / error) / np.log(k),
            "ratio": difference / error, "independent": np.hypot(k**3, 1),
            "correlation": (error**2 + of_coarse**2 - difference**2) / (2 * error * of_coarse),
            "ratios": sorted(run[2] / run[0] for run in runs),
        }  # fmt: skip
        cases.append(case)
        table.add_row(
            str(fine), f"{h:g}", f"{h / fine:.2f}", f"{error:.2%}", f"{of_coarse:.2%}", f"{case['rate']:.2f}",
            f"{case['ratio']:.2f}", f"{case['independent']:.2f}", f"{case['correlation']:.2f}",
        )  # fmt: skip
    Console(width=120).print(table)
    rates, off = [case["rate"] for case in cases], [abs(case["ratio"] / case["independent"] - 1) for case in cases]
    result = {
        "limits": LIMITS, "cases": cases, "least_rate": min(rates), "largest_rate": max(rates),
        "off_independent": max(off),
    }  # fmt: skip
    failed = [f"rate {rate:.2f}" for rate in rates if not LIMITS["least_rate"] <= rate <= LIMITS["largest_rate"]]
    failed += [f"difference off by {x:.2f}" for x in off if x > LIMITS["off_independent"]]
    scenes.finish(__file__, result, failed)


if __name__ == "__main__":
    main()
