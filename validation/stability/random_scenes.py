"""Random impacts of two bodies over bases, formulations, integrators, frames, friction, damping and plasticity.

Each seed draws one scene: a ball or block of 20 mm, thrown at a ball or block, off the centre, perhaps aslant and
turning. Combinations that the library refuses are drawn again. Meshes are coarse, of some hundred nodes: it is tried
whether runs keep the laws, not whether meshes resolve the contact.
Quantities, each from the results alone: change of energy, counting what damping, friction and plastic flow take; change
of momentum; difference of the impulse and of the velocities after the impact between explicit and implicit steps, and
of the force over time; and what the surfaces tell of the contact.

Surfaces. Rows of the contact are means around the slave's nodes, weighted by hats, or the nodes themselves for
multipliers. So single points may sink in: on facets of size h, bodies of radius R pass by h^2 / (8 R) or more, here
tens of micrometres, before a row closes. What theory states is of the rows' gaps w: w >= 0 and lambda w = 0, with
w = h + F lambda. They are found here from places of nodes, this script's own closest points on the master's curved
facets, and `row_forces`. h is that of the kept shapes. F lambda is what the contact itself yields: for the compliance
the static answer of both bodies, also to plastic strain, by which the surfaces are moved; for the penalty
lambda / (k A) of its layer, with k from the stored energy; for multipliers zero. Told by the way that the bodies would
go unhindered:
- overlap, the largest -w. Pairs are frozen while they slide by less than 2 % of a facet, and then their gaps are wrong
  by (0.02 h)^2 / (2 R) = 0.1 um, 0.2 % of the way of the slowest scenes. Normals of a patch of radius 1.8 mm turn by up
  to 0.18, and points move aside by up to a third of the approach, which is a quarter of the way: 1.5 %. Limit: 0.02.
- apart, the largest mean of w > 0 over the row forces, by the largest force: bodies that push without touching. The
  same limit, for the same reasons.
- depth, the largest -h. An elastic impact takes 2.94 times approach over speed (Hertz), and the way is that of 1.4
  times as long: 0.24. Depth goes with the root of the stiffness; a limit of 0.5 finds a quarter of it, or less.
Rows are means over those of their points that face the master's patch, or lie past its edge by less than 2 % of a
facet. Rows with less than half of their area there are left out; `seen` is the least share of forces on the others.

Limits: of each quantity for a scene, in `LIMITS`. A scene beyond one is listed with its seed, and `KNOWN` has the
reason of those that are understood.

    python -m validation.stability.random_scenes [--count N] [--only SEED ...] [--jobs N] [--out FILE]
"""

import argparse
import functools
import time
import warnings
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import exudyn as exu
import netgen.occ as occ
import numpy as np
import scipy.sparse as sp
from rich.console import Console

import exudyn_partition as ep
from exudyn_partition.errors import InputError, PartitionWarning
from exudyn_partition.exudyn_bodies.static_part import static_part
from validation.contact import scenes
from validation.tables import PAGE, write_between

COUNT = 200
RADIUS, SIDE, REACH = 10e-3, 20e-3, 1.8e-3
YIELDING = replace(ep.STEEL, yield_stress=400e6, hardening=1e9)
F_CUT = {"ball": 180e3, "block": 125e3}
SHAPES, BASES = ("ball", "block"), ("contact-adapted", "residual", "craig-bampton", "free")
FORMULATIONS, SHARES = ("compliance", "penalty", "lagrange"), (0.5, 0.25, 0.25)
PAST_EDGE = 0.02  # of a facet's size: points past the patch's edge by less are paired, as by contacts
LEAST_SHARE = 0.5  # of a row's area that faces the master, so that it is looked at
LATE = 36e-6  # mean gap of a row around the point where the bodies touch [m]
TIMES = 12  # of samples at which surfaces are looked at
LIMITS = {
    "energy": 0.01, "momentum": 1e-6, "impulse": 0.02, "velocity": 0.02, "force": 0.10,
    "overlap": 0.02, "apart": 0.02, "depth": 0.5,
}  # fmt: skip
SAID = {
    "energy": "energy, with what was taken, over that of the start",
    "momentum": "momentum, over that of the thrown body",
    "impulse": "impulse, explicit against implicit",
    "velocity": "mean velocities afterwards, explicit against implicit, over that of the start",
    "force": "force over time (L2), explicit against implicit",
    "overlap": "overlap of the surfaces at the rows, with what the contact yields, over the way unhindered",
    "apart": "gap of the surfaces where forces act, weighted by them, over the way unhindered",
    "depth": "depth of the surfaces at the rows, by the kept shapes alone, over the way unhindered",
}
KNOWN: dict[int, str] = {}  # seeds beyond a limit that are understood, with the reason


@dataclass(frozen=True)
class Scene:
    """What a seed has drawn."""

    shapes: tuple[str, str]
    basis: str
    formulation: str
    frame: str
    friction: float | None
    damping: float | None
    yields: bool
    velocity: tuple[float, float, float]
    spin: tuple[float, float, float]
    aside: tuple[float, float]

    def __str__(self) -> str:
        parts = [" on ".join(self.shapes), self.basis, self.formulation, self.frame]
        parts += [] if self.friction is None else [f"friction {self.friction:.2f}"]
        parts += [] if self.damping is None else [f"damping {self.damping:.3f}"]
        parts += ["yields"] * self.yields
        return ", ".join([*parts, f"{np.linalg.norm(self.velocity):.2f} m/s"])


def drawn(seed):
    """The scene of a seed; what is not offered together is drawn again."""
    rng = np.random.default_rng(seed)
    while True:
        basis, formulation = str(rng.choice(BASES)), str(rng.choice(FORMULATIONS, p=SHARES))
        friction = float(rng.uniform(0.05, 0.6)) if rng.random() < 0.4 else None
        yields = bool(rng.random() < 0.25)
        floats = 0.5 if formulation != "lagrange" else 0.05  # of these, implicit steps take minutes
        frame = "floating" if rng.random() < floats else "inertial"
        flexible = basis in ("contact-adapted", "residual")
        if flexible == (formulation == "lagrange") and formulation != "penalty":
            continue
        if yields and (formulation != "compliance"):
            continue
        if friction is not None and formulation == "penalty":
            continue
        damping = float(rng.uniform(0.0, 0.05)) if rng.random() < 0.3 and basis != "free" else None
        aslant = rng.uniform(-0.5, 0.5, 2) if friction is not None else np.zeros(2)
        speed = float(10 ** rng.uniform(-0.4, 0.5))
        spin = tuple(rng.uniform(-50, 50, 3).tolist()) if frame == "floating" and rng.random() < 0.5 else (0.0,) * 3
        shapes = tuple(str(one) for one in rng.choice(SHAPES, 2))
        if shapes == ("block", "block") and any(spin):
            continue
        return Scene(
            shapes, basis, formulation, frame, friction, damping, yields,
            (*(speed * aslant).tolist(), -speed), spin, tuple(rng.uniform(-4e-4, 4e-4, 2).tolist()),
        )  # fmt: skip


@functools.cache
def model(shape, up, axes, yields):
    """FE model and partition of a body above or below z = 0, which touches it at the origin."""
    sign = 1 if up else -1
    if shape == "ball":
        solid = occ.Sphere(occ.Pnt(0, 0, sign * RADIUS), RADIUS)
    else:
        low, high = sorted((0.0, sign * SIDE))
        solid = occ.Box(occ.Pnt(-SIDE / 2, -SIDE / 2, low), occ.Pnt(SIDE / 2, SIDE / 2, high))
    material = YIELDING if yields else replace(ep.STEEL, yield_stress=None)
    fem = ep.fe_model(solid, material, maxh=9e-3, refine=[ep.Refine((0, 0, 0), 0.8 * REACH, 1.1e-3)], grading=0.9)
    return fem, ep.Partition.ball(fem, (0, 0, 0), REACH, direction=(0, 0, -sign), axes=axes)


@functools.cache
def reduced(shape, up, axes, yields, basis):
    """The body, reduced, and its static answers."""
    fem, part = model(shape, up, axes, yields)
    body = ep.reduce(fem, part, basis=basis, f_cut=F_CUT[shape])
    answer = ep.recovery.StaticAnswer(fem, body) if body.basis.flexibility is not None else fem
    return body, answer


def bodies_of(scene):
    """Bodies and static answers; the lower one yields, if any does."""
    axes = "normal" if scene.friction is None else "xyz"
    yields = (False, scene.yields)
    return [
        reduced(shape, up, axes, own, scene.basis)
        for shape, up, own in zip(scene.shapes, (True, False), yields, strict=True)
    ]


def run(scene, method, end=None):
    """Items, contact and result of the impact."""
    mbs = exu.SystemContainer().AddSystem()
    (upper, _), (lower, _) = bodies_of(scene)
    turning = {"initialAngularVelocity": scene.spin} if any(scene.spin) else {}
    common = {"frame": scene.frame, "damping": scene.damping}
    place = (*scene.aside, 0.0) if scene.shapes == ("block", "block") else (0.0, 0.0, 0.0)
    items = [
        ep.CreatePartitionBody(
            mbs, upper, name="upper", initialVelocity=scene.velocity, referencePosition=place, **common, **turning
        ),
        ep.CreatePartitionBody(mbs, lower, name="lower", **common),
    ]
    contact = ep.CreatePartitionContact(mbs, *items, formulation=scene.formulation, friction=scene.friction)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=end or duration(scene), method=method)
    return items, contact, result


def impact(scene):
    """1.4 times what Hertz says of a ball on a plane, or a travel of waves for blocks [s]."""
    hertz = ep.hertz.impact(0.5 * 0.033, -scene.velocity[2], RADIUS, np.inf, ep.STEEL, ep.STEEL).duration
    return 60e-6 if scene.shapes == ("block", "block") else 1.4 * hertz


def duration(scene):
    """The same, and before it the way until rows close around curved surfaces [s]."""
    return impact(scene) + (0.0 if scene.shapes == ("block", "block") else LATE / -scene.velocity[2])


def surface(item, answer, contact, result, own):
    """Places of the patch's nodes in space, (n, np, 3) [m], its nodes, and its facets by them, (nf, 6).

    `own` tells whether the static answer to forces and plastic strain is in the places.
    """
    (patch,) = [item.body.partition.patches[i] for other, i in contact.sides if other is item]
    places = item.kinematics.at(patch.nodes).place(item.coordinates(result))
    if own and item.body.basis.flexibility is not None:
        dofs = (3 * patch.nodes[:, None] + np.arange(3)).ravel()
        rows = sp.csr_matrix((np.ones(len(dofs)), (np.arange(len(dofs)), dofs)), shape=(len(dofs), item.body.fe_dofs))
        static = static_part(item, result, rows, answer).reshape(*places.shape)
        places = places + np.einsum("tab,tnb->tna", item.kinematics.frame(item.coordinates(result))[1], static)
    return places, np.searchsorted(patch.nodes, patch.facets)


def shapes(local):
    """Shape functions, (k, 6), of a quadratic triangle, and their derivatives by its coordinates, (2, k, 6)."""
    r, s = local.T
    t, zero = 1 - r - s, np.zeros(len(local))
    by_r = [1 - 4 * t, 4 * r - 1, zero, 4 * (t - r), 4 * s, -4 * s]
    by_s = [1 - 4 * t, zero, 4 * s - 1, -4 * r, 4 * r, 4 * (t - s)]
    values = [t * (2 * t - 1), r * (2 * r - 1), s * (2 * s - 1), 4 * t * r, 4 * r * s, 4 * s * t]
    return np.stack(values, axis=1), np.stack([np.stack(by_r, axis=1), np.stack(by_s, axis=1)])


def hat_rule():
    """Points of a quadratic facet, (12, 2), their weights, and hats of its nodes there, (12, 6).

    Three points of each of the four triangles between the nodes; hats are linear in these triangles.
    """
    inner = np.full((3, 3), 1 / 6) + np.eye(3) / 2
    nodes = np.array([[0, 0], [1, 0], [0, 1], [0.5, 0], [0.5, 0.5], [0, 0.5]])
    parts = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])
    return (inner @ nodes[parts]).reshape(-1, 2), np.full(12, 1 / 24), (inner @ np.eye(6)[parts]).reshape(-1, 6)


def row_points(places, facets, integrated):
    """Contact points: shares of the nodes in them, (p, np); and shares of the points in each node's row, with areas.

    `places`, (np, 3), are those before the contact.
    """
    n, used = len(places), np.unique(facets)
    if not integrated:
        return np.eye(n)[used], np.eye(n)[:, used], np.zeros(n)
    local, weight, hats = hat_rule()
    value, slope = shapes(local)
    points, rows = np.zeros((len(facets) * 12, n)), np.zeros((n, len(facets) * 12))
    for i, facet in enumerate(facets):
        area = weight * np.linalg.norm(np.cross(*(slope @ places[facet])), axis=1)
        points[12 * i : 12 * i + 12, facet] = value
        rows[facet, 12 * i : 12 * i + 12] = (area[:, None] * hats).T
    areas = rows.sum(axis=1)
    return points, rows / np.where(areas > 0, areas, 1.0)[:, None], areas


def point_gaps(points, places, facets):
    """Distance of points, (k, 3), from a surface of quadratic facets, along its outward normal [m].

    The closest point of each facet is found by the method of Gauss and Newton. It is nan for points that project on no
    facet, nor past the edge by less than `PAST_EDGE`. Where several face a point, the closest one counts.
    """
    found, beside = np.full((2, len(points)), np.nan)
    for facet in facets:
        local = np.full((len(points), 2), 1 / 3)
        for _ in range(20):
            value, slope = shapes(local)
            miss = points - value @ places[facet]
            tangents = np.swapaxes(slope @ places[facet], 0, 1)  # (k, 2, 3)
            metric = tangents @ np.swapaxes(tangents, 1, 2)
            step = np.linalg.solve(metric, tangents @ miss[..., None])[..., 0]
            local = np.clip(local + step, -1.0, 2.0)
        value, slope = shapes(local)
        normal = np.cross(*(slope @ places[facet]))
        gap = np.einsum("ka,ka->k", points - value @ places[facet], normal) / np.linalg.norm(normal, axis=1)
        past = np.maximum(-local.min(axis=1), local.sum(axis=1) - 1)
        for at, most in ((found, 1e-6), (beside, PAST_EDGE)):
            better = (past < most) & (abs(step).max(axis=1) < 1e-6) & ~(abs(at) <= abs(gap))
            at[better] = gap[better]
    return np.where(np.isnan(found), beside, found)


def row_gaps(scene, items, contact, result, own):
    """Gaps of the rows by the surfaces, (n, np) [m], nan where too little faces the master, and their areas [m2]."""
    sides = {}
    for item, (_, answer) in zip(items, bodies_of(scene), strict=True):
        sides[item is contact.slave] = surface(item, answer, contact, result, own)
    (slave, facets), (master, of_master) = sides[True], sides[False]
    points, rows, areas = row_points(slave[0], facets, scene.formulation != "lagrange")
    at = np.array([point_gaps(points @ p, m, of_master) for p, m in zip(slave, master, strict=True)])
    share = np.isfinite(at) @ rows.T
    means = np.nan_to_num(at) @ rows.T / np.maximum(share, 1e-300)
    return np.where(share > LEAST_SHARE, means, np.nan), areas * share


def laws(gaps, kept, forces):
    """Overlap, distance and depth [m], see the module, and the share of the forces whose rows are known.

    All are (n, np): the gaps with what the contact yields, those of the kept shapes, and the forces on the rows.
    """
    known = np.isfinite(gaps)
    gaps, kept = np.where(known, gaps, 0.0), np.where(known, kept, 0.0)
    apart = (forces * np.maximum(gaps, 0.0)).sum(axis=1).max() / forces.sum(axis=1).max()
    overlap, depth = (max(float(-of.min()), 0.0) for of in (gaps, kept))
    return overlap, float(apart), depth, float((forces * known).sum() / forces.sum())


def surface_laws(scene, items, contact, result):
    """What the surfaces tell of the contact, see `laws`, by the way that the bodies would go unhindered."""
    force = contact.force(result)
    if not force.any():
        return 0.0, 0.0, 0.0, 1.0
    chosen = np.unique(np.r_[np.linspace(0, len(result.t) - 1, TIMES).astype(int), int(force.argmax())])
    part = result.at(result.t[chosen])
    forces = contact.row_forces(part).toarray()
    kept, areas = row_gaps(scene, items, contact, part, own=False)
    gaps = kept
    if scene.formulation == "compliance":
        gaps, _ = row_gaps(scene, items, contact, part, own=True)
    elif scene.formulation != "lagrange":
        # The layer stores sum forces^2 / (2 k A): its k follows from the energy, which the balance checks.
        soft = np.divide(forces, areas, out=np.zeros_like(forces), where=areas > 0)
        gaps = kept + soft * 2 * contact.energy(part).sum() / (forces * soft).sum()
    way = -scene.velocity[2] * impact(scene)
    *lengths, seen = laws(gaps, kept, forces)
    return *(length / way for length in lengths), seen


def checked(seed):
    """The row of a seed."""
    scene, begin = drawn(seed), time.perf_counter()
    row = {"seed": seed, "scene": str(scene), "found": {}, "warnings": [], "stopped": []}
    runs, velocities = {}, {}
    for method in ("explicit", "implicit"):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                items, contact, result = run(scene, method)
            except InputError as error:
                row["refused"] = str(error)[:200]
                return row
        row["warnings"] += [w.category.__name__ for w in caught if issubclass(w.category, PartitionWarning)]
        if result.status != "finished":
            row["stopped"].append(f"{method}: {result.message[:200]}")
            continue
        runs[method] = items, contact, result
        energy = sum(item.energy(result) + item.dissipated_energy(result) for item in items)
        energy = energy + contact.energy(result) + contact.dissipated_energy(result)
        momentum = sum(item.momentum(result) for item in items)
        thrown = np.linalg.norm(items[0].momentum(result)[0])
        velocities[method] = [item.momentum(result)[-1] / thrown for item in items]
        found = {
            "energy": abs(energy / energy[0] - 1).max(),
            "momentum": abs(momentum - momentum[0]).max() / thrown,
        }
        *told, seen = surface_laws(scene, items, contact, result)
        found |= dict(zip(("overlap", "apart", "depth"), told, strict=True))
        row["seen"] = min(seen, row.get("seen", 1.0))
        row["found"] |= {name: max(value, row["found"].get(name, 0.0)) for name, value in found.items()}
    if len(runs) == 2:
        (_, one, first), (_, other, second) = runs["explicit"], runs["implicit"]
        a, b = one.force(first), np.interp(first.t, second.t, other.force(second))
        impulse = np.trapezoid(a, first.t)
        row["touched"] = bool(impulse)
        row["found"]["impulse"] = abs(np.trapezoid(b, first.t) / impulse - 1) if impulse else 0.0
        row["found"]["force"] = float(np.linalg.norm(b - a) / np.linalg.norm(a)) if impulse else 0.0
        row["found"]["velocity"] = float(np.max(np.abs(np.subtract(velocities["explicit"], velocities["implicit"]))))
    row["beyond"] = [name for name, limit in LIMITS.items() if not row["found"].get(name, 0.0) <= limit]
    row["warnings"], row["time_s"] = sorted(set(row["warnings"])), time.perf_counter() - begin
    return row


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=COUNT, help="seeds, from 0 on")
    parser.add_argument("--only", type=int, nargs="+", help="these seeds; nothing is stored")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--out", type=Path, help="file of the results, instead of the JSON beside the script")
    options = parser.parse_args()
    console, begin = Console(width=170), time.perf_counter()
    seeds = options.only or range(options.count)
    rows = ep.study(checked, {"seed": seeds}, workers=options.jobs, stop=True).values
    for row in rows:
        told = {name: float(f"{value:.2g}") for name, value in row["found"].items()} | {"seen": row.get("seen")}
        if options.only or row.get("beyond") or row["stopped"] or row.get("refused"):
            console.print(row["seed"], row["scene"], told, row.get("beyond"), row["stopped"], row.get("refused", ""),
                          row["warnings"], markup=False)  # fmt: skip
    if options.only:
        return
    result = summary(rows, time.perf_counter() - begin)
    console.print(result["found"], Counter(name for row in rows for name in row.get("beyond", ())))
    if options.out is None:
        write_between(PAGE, "stability/random_scenes.py", table(result))
    scenes.finish(__file__, result, result["unexplained"], options.out)


def summary(rows, time_s):
    """What is stored: counts, worst and median of each quantity, and the scenes beyond limits."""
    ran = [row for row in rows if not row.get("refused") and not row["stopped"]]
    values = {name: np.array([row["found"][name] for row in ran if name in row["found"]]) for name in LIMITS}
    beyond = [row for row in rows if row.get("beyond") or row["stopped"] or row.get("refused")]
    return {
        "scenes": len(rows),
        "limits": {"unexplained": 0},
        "found": {"unexplained": sum(row["seed"] not in KNOWN for row in beyond)},
        "quantities": {
            name: {
                "limit": LIMITS[name], "median": float(np.median(of)), "ninety": float(np.quantile(of, 0.9)),
                "worst": float(of.max()), "beyond": int((of > LIMITS[name]).sum()),
            }
            for name, of in values.items()
        },
        "touched": sum(row.get("touched", False) for row in rows),
        "seen": {"median": float(np.median([row["seen"] for row in ran])), "least": min(row["seen"] for row in ran)},
        "stopped": sum(bool(row["stopped"]) for row in rows),
        "drawn": dict(Counter(part for row in rows for part in row["scene"].split(", ")[:4])),
        "beyond": [row | {"why": KNOWN.get(row["seed"], "")} for row in beyond],
        "unexplained": [f"seed {row['seed']}: {row['scene']}" for row in beyond if row["seed"] not in KNOWN],
        "time_s": time_s,
    }  # fmt: skip


def table(result):
    """The table of the page."""
    lines = ["| quantity | limit | median | nine of ten | worst | beyond |", "| --- | --- | --- | --- | --- | --- |"]
    for name, of in result["quantities"].items():
        numbers = " | ".join(f"{of[key]:.2g}" for key in ("limit", "median", "ninety", "worst"))
        lines.append(f"| {SAID[name]} | {numbers} | {of['beyond']} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
