"""Two spur gears, flexible both: contact that wanders over flanks, against the full FE model, and against ISO 6336.

- Static transmission error and shares of the teeth at ten places of a mesh cycle, under 300 N/mm. The reference is a
  complementarity problem on the full FE model's flexibility, with rows of the rigid gears' place.
- Stiffness of one pair of teeth by the width, against the theoretical c'_th of ISO 6336-1 (method B, basic rack of
  ISO 53). Its factor C_M = 0.8 is left out: it leads from this theory to measurements. The twist of the discs between
  bore and root circle is taken off, for the norm leaves it to the shafts: that of rings under a moment.
- An impact of the turning pinion on the wheel, both on shafts that turn freely, against full FE steps of 1 us. Waves in
  the teeth make its force wavy at 80 kHz, so that these gears are reduced to a higher frequency. Explicit steps are
  measured too: they take half the time, and do not damp these waves, which the full FE model's steps do. The gears turn
  by less than a thousandth, so that frames that do not turn will do: joints are linear there, with the same force.
  `fixed_step_s` is the time of a step there; the rest of `fixed_online_s` is the first search and set-up.
- Full FE steps are of two kinds. The implicit ones of 1 us go through this library's own factors, by two threads.
  Explicit steps, which codes for impacts take, have lumped masses and are as long as they may be (`full_explicit`); the
  time of 100 is measured, without contact. The limit is about steps alone, by these: neither side's search and factors
  count.

    python -m validation.wandering.gears
"""

import argparse
import time
import warnings
from dataclasses import replace

import numpy as np
import scipy.optimize
import scipy.sparse as sp
import scipy.sparse.linalg
from rich.console import Console

import exudyn_partition as ep
from examples.models import gear_pair as example
from examples.models import gear_pair_parts as shapes
from exudyn_partition.algebra.complementarity import Complementarity, regularised
from exudyn_partition.algebra.sparse.multifrontal import Factorisation
from exudyn_partition.reference.integrator import HHT
from exudyn_partition.surfaces.near import NearParts, near_rows
from exudyn_partition.surfaces.points import contact_points
from exudyn_partition.surfaces.surface import Surface
from validation.contact import scenes

LIMITS = {"transmission": 0.02, "shares": 0.02, "iso_stiffness": 0.1, "impact_force": 0.02, "impact_impulse": 0.02}
FASTER = 1000.0  # on-line, than full FE steps
GEARS = shapes.Gear(20, 20e-3), shapes.Gear(30, 30e-3)
FLANKS = [f"upper {tooth}" for tooth in (-1, 0, 1)], [f"upper {tooth}" for tooth in (-2, -1, 0)]
MESH = {"fine": 0.3e-3, "maxh": 4e-3, "grading": 0.35, "curvaturesafety": 1.0}
PITCH = 2 * np.pi / GEARS[0].teeth  # of the pinion's teeth [rad]
LOAD = 300e3  # force of the teeth by their width [N/m]
PLACES = np.arange(-5, 5) / 10  # turns of the pinion, by a tooth
NEAR = 40e-6  # gaps of rigid gears in touch below which rows may bear [m]
BEFORE, SPEED, END, STEP = 0.2, 0.1, 200e-6, 1e-6  # impact: turn by a tooth, speed of flanks [m/s], end, step [s]
F_IMPACT = 100e3  # [Hz]
EXPLICIT_STEPS = 100  # of the full FE models, to tell their time
RUNS = 3  # in frames that do not turn; the quickest counts, the least disturbed one


class FullGear:
    """The full FE model of a gear, whose bore is rigid and turns about its axis."""

    def __init__(self, fem, partition, gear):
        self.fem, self.patch, self.gear = fem, partition.patches[0], gear
        held = np.zeros(fem.n_nodes, dtype=bool)
        held[partition.interfaces[0].nodes] = True
        self.free = np.flatnonzero(np.repeat(~held, 3))
        self.turning = np.cross([0, 0, 1], fem.points).ravel()  # displacements of a unit turn
        self.turning_bore = np.where(np.repeat(held, 3), self.turning, 0.0)

    def surface(self, angle, place):
        """The patch in its place."""
        return Surface.of(self.fem.points @ example.rotation(angle).T, self.patch, np.array(place))

    def rows(self, rows, angle):
        """Rows on all dofs in the gear's axes, csr (m, 3n), of rows on the patch in those of space."""
        nodes, turned = self.patch.nodes, sp.kron(sp.identity(len(self.patch.nodes)), example.rotation(angle))
        dofs = (3 * nodes[:, None] + np.arange(3)).ravel()
        pick = sp.csr_matrix((np.ones(len(dofs)), (np.arange(len(dofs)), dofs)), (len(dofs), self.fem.n_dofs))
        return sp.csr_matrix(rows @ turned @ pick)

    def flexibility(self, rows):
        """Flexibility between rows, (m, m) [m/N], with the bore held."""
        if not hasattr(self, "factor"):
            self.factor = Factorisation(self.fem.stiffness[self.free][:, self.free])
        loads = rows[:, self.free].T.toarray()
        return loads.T @ self.factor.solve(loads)

    def integration(self, rows, spin):
        """Steps of the gear on its shaft, from a velocity of the shaft [rad/s]."""
        pick = sp.identity(self.fem.n_dofs, format="csc")[:, self.free]
        change = sp.csr_matrix(sp.hstack([pick, sp.csr_matrix(self.turning_bore[:, None])]))
        mass = sp.lil_matrix(change.T @ self.fem.mass @ change)
        mass[-1, -1] += example.INERTIA
        velocity = spin * np.append(self.turning[self.free], 1.0)
        stiffness = sp.csr_matrix(change.T @ self.fem.stiffness @ change)
        return HHT(sp.csr_matrix(mass), stiffness, sp.csr_matrix(rows @ change), STEP, velocity=velocity)


def full_rows(full, turn, way):
    """Rows that may bear on the dofs of both gears, their gaps [m], and their nodes in the pinion's patch."""
    poses = shapes.poses(GEARS, turn, way)
    slave, master = (one.surface(*pose) for one, pose in zip(full, poses, strict=True))
    near = NearParts.of(slave, master, 2 * slave.facet_size)
    parts = (
        replace(slave, facets=slave.facets[near.slave_facets]),
        replace(master, facets=master.facets[near.master_facets]),
    )
    found, _ = near_rows(near.points(contact_points(slave, "integrated")), *parts, approach=np.array([0.0, 1.0, 0.0]))
    some = np.flatnonzero(found.gap < NEAR)
    on_patches = found.matrices(len(slave.points), len(master.points))
    rows = [one.rows(G[some], angle) for one, G, (angle, _) in zip(full, on_patches, poses, strict=True)]
    return rows, found.gap[some], found.points.row_nodes[some]


def full_static(full, turn):
    """Way of the pinion into the wheel [m], and force of each of its patch nodes [N], of the full FE model."""
    rows, gap, nodes = full_rows(full, turn, shapes.play())
    F = sum(one.flexibility(G) for one, G in zip(full, rows, strict=True))
    contact, closing = Complementarity(regularised((F + F.T) / 2)), rows[0] @ full[0].turning

    def surplus(angle):
        return -closing @ contact.solve(gap + closing * angle) - LOAD * shapes.WIDTH * GEARS[0].base

    angle = scipy.optimize.brentq(surplus, 0.0, 5e-3, xtol=1e-13)
    forces = np.zeros(len(full[0].patch.nodes))
    forces[nodes] = contact.solve(gap + closing * angle)
    return angle * GEARS[0].base, forces


def static(bodies, turn):
    """The same of the reduced gears, settled under the torque."""
    pair = example.pair(
        bodies, GEARS, example.Work(lambda t: LOAD * shapes.WIDTH * GEARS[0].base, lambda t: (0, 0)), turn
    )
    result = pair.settle()
    return pair.way(result)[-1], pair.contact.row_forces(result)[-1].toarray().ravel()


def shares(full, forces):
    """Share of the pinion's three teeth in the force."""
    tooth, _ = shapes.teeth_of(GEARS[0], full.fem.points[full.patch.nodes])
    return np.bincount(tooth + 1, forces, minlength=3) / forces.sum()


def iso_stiffness():
    """Theoretical stiffness c'_th of a pair of teeth by its width [N/m2], ISO 6336-1, without profile shift."""
    return 1e9 / (0.04723 + 0.15551 / GEARS[0].teeth + 0.25791 / GEARS[1].teeth)


def twist():
    """Way along the line of contact by the twist of both discs, between bore and root, under LOAD [m]."""
    G = ep.STEEL.E / (2 * (1 + ep.STEEL.nu))
    return sum(
        LOAD * gear.base**2 / (4 * np.pi * G) * (1 / gear.bore**2 - 1 / (gear.pitch - shapes.DEDENDUM) ** 2)
        for gear in GEARS
    )


def full_impact(full):
    """Times [s], force [N], time that the steps took, and that of their preparation [s], of the full FE model."""
    begin, n = time.perf_counter(), round(END / STEP)
    rows, gap, _ = full_rows(full, BEFORE * PITCH, shapes.play() - example.CLEARANCE)
    sides = [one.integration(G, spin) for one, G, spin in zip(full, rows, (SPEED / GEARS[0].base, 0.0), strict=True)]
    contact = Complementarity(regularised(sum(side.compliance() for side in sides)))
    prepared, force = time.perf_counter(), np.zeros(n + 2)
    for i in range(1, n + 1):  # a step's force is that of its middle
        lam = contact.solve(gap + sides[0].predict() + sides[1].predict())
        for side in sides:
            side.correct(lam)
        force[i] = lam.sum()
    return STEP * np.arange(n + 1), (force[1:] + force[:-1]) / 2, time.perf_counter() - prepared, prepared - begin


def full_explicit(full):
    """Step that is stable, less a tenth [s], and time of a step [s], of both full FE models with lumped masses.

    Contact is left out: an explicit code would need time for it too.
    """
    sides = []
    for one in full:
        stiffness, mass = one.fem.stiffness[one.free][:, one.free], np.repeat(one.fem.lumped_mass, 3)[one.free]
        scale = sp.diags(1 / np.sqrt(mass))
        largest = scipy.sparse.linalg.eigsh(scale @ stiffness @ scale, k=1, tol=1e-3, return_eigenvectors=False)[0]
        sides.append((stiffness, 1 / mass, 2 / np.sqrt(largest), np.zeros(len(mass)), 1e-3 * np.ones(len(mass))))
    step = 0.9 * min(limit for *_, limit, _, _ in sides)
    begin = time.perf_counter()
    for _ in range(EXPLICIT_STEPS):
        for stiffness, inverse, _, u, v in sides:
            u += step * v
            v -= step * inverse * (stiffness @ u)
    spent = time.perf_counter() - begin
    assert all(abs(v).max() < 1.0 for *_, v in sides)  # stable
    return float(step), spent / EXPLICIT_STEPS


def impact(bodies, step):
    """Times [s], force [N] and time that the steps took [s], of the reduced gears."""
    pair = example.pair(bodies, GEARS, example.Work(), BEFORE * PITCH, spin=SPEED / GEARS[0].base)
    result = pair.run(END, step, spectral_radius=0.8)
    return result.t, pair.contact.force(result), result.time_s


def explicit_impact(bodies, end=END, frame="floating"):
    """The same by explicit steps, as long as they may be, and their number."""
    pair = example.pair(bodies, GEARS, example.Work(), BEFORE * PITCH, spin=SPEED / GEARS[0].base, frame=frame)
    result = ep.solve_dynamic(pair.mbs, end_time=end, step=0.9 * ep.stability_limit(pair.mbs), method="explicit")
    return result.t, pair.contact.force(result), result.time_s, result.steps


def turned_bodies():
    """The gears of the impact, with meshes that have its angles at the start."""
    places = shapes.poses(GEARS, BEFORE * PITCH, shapes.play() - example.CLEARANCE)
    parts = (
        shapes.gear_part(gear, flanks=flanks, angle=angle, **MESH)
        for gear, flanks, (angle, _) in zip(GEARS, FLANKS, places, strict=True)
    )
    return [ep.reduce(*part, f_cut=F_IMPACT) for part in parts]


def differs(hit, of_full, t, t_full):
    """Difference of the force of an impact from that of the full FE model, relative L2."""
    return np.linalg.norm(np.interp(t_full, t, hit) - of_full) / np.linalg.norm(of_full)


def draw(places, ways, parts, runs):
    """Transmission error, shares, and force of the impact: reduced gears and full FE models."""
    path, (figure, panels) = scenes.figure(__file__, nrows=3, figsize=(8, 10))
    for values, style, name in zip(ways, ("o-", "kx"), ("reduced gears", "full FE models"), strict=True):
        panels[0].plot(places, 1e6 * values, style, label=name)
    panels[0].set(ylabel="transmission error [µm]", xlabel="turn of the pinion, by a tooth")
    for tooth, colour in zip(range(3), ("C0", "C1", "C2"), strict=True):
        panels[1].plot(places, parts[0][:, tooth], "o-", color=colour, label=f"tooth {tooth - 1}")
        panels[1].plot(places, parts[1][:, tooth], "kx")
    panels[1].set(ylabel="share of the force", xlabel="turn of the pinion, by a tooth")
    for (t, force, *_), style, name in zip(runs, ("-", "k--"), ("reduced gears", "full FE models"), strict=True):
        panels[2].plot(1e6 * t, force, style, lw=1, label=name)
    panels[2].set(ylabel="force of the impact [N]", xlabel="time [µs]")
    for panel in panels:
        panel.legend(fontsize=7)
    figure.savefig(path, dpi=120)
    return str(path)


def main():
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    warnings.simplefilter("ignore", ep.errors.PartitionWarning)  # steel would begin to yield; coarse body
    begin, console = time.perf_counter(), Console(width=150)
    parts = [shapes.gear_part(gear, flanks=flanks, **MESH) for gear, flanks in zip(GEARS, FLANKS, strict=True)]
    meshed = time.perf_counter()
    bodies = [ep.reduce(*part, f_cut=shapes.F_CUT) for part in parts]
    reduced = time.perf_counter()
    full = [FullGear(*part, gear) for part, gear in zip(parts, GEARS, strict=True)]
    answers, times = [], np.zeros(2)
    for place in PLACES:
        clock = [time.perf_counter()]
        for solve, of in ((static, bodies), (full_static, full)):
            answers.append(solve(of, place * PITCH))
            clock.append(time.perf_counter())
        times += np.diff(clock)
        console.print(place, *(f"{1e6 * way:.3f} um {shares(full[0], force).round(3)}" for way, force in answers[-2:]))
    ways = np.array([[way for way, _ in answers[i::2]] for i in (0, 1)])
    loads = np.array([[shares(full[0], force) for _, force in answers[i::2]] for i in (0, 1)])
    force = np.array([force.sum() for _, force in answers[::2]])
    alone = loads[0].max(axis=1) > 1 - 1e-6  # one pair bears all
    stiffness = LOAD / (ways[0][alone] - twist()).min()
    clock = time.perf_counter()
    quick = [ep.reduce(*part, f_cut=F_IMPACT) for part in parts]
    reduce_quick = time.perf_counter() - clock
    impact(quick, 10 * STEP)  # what is compiled or loaded at first does not count
    explicit_impact(quick)
    runs = impact(quick, STEP), full_impact(full)
    (t, hit, online), (t_full, hit_full, stepping, factors) = runs
    explicit_t, explicit_hit, explicit_online, _ = explicit_impact(quick)
    turned = turned_bodies()
    short, whole = (
        min((explicit_impact(turned, end, "inertial") for _ in range(RUNS)), key=lambda run: run[2])
        for end in (END / 20, END)
    )
    (*_, begun, first_steps), (fixed_t, fixed_hit, fixed_online, fixed_steps) = short, whole
    fixed_step = (fixed_online - begun) / (fixed_steps - first_steps)
    full_step, of_full_step = full_explicit(full)
    by_steps = float(END / full_step * of_full_step / (fixed_steps * fixed_step))
    found = {
        "transmission": abs(ways[0] / ways[1] - 1).max(),
        "shares": abs(loads[0] - loads[1]).max(),
        "iso_stiffness": stiffness / iso_stiffness() - 1,
        "impact_force": differs(hit, hit_full, t, t_full),
        "impact_impulse": np.trapezoid(hit, t) / np.trapezoid(hit_full, t_full) - 1,
    }
    console.print(found, draw(PLACES, ways, loads, runs))
    result = {
        "found": found, "limits": LIMITS, "faster": stepping / online, "faster_asked": FASTER,
        "explicit_faster": stepping / explicit_online,
        "explicit_impact_force": differs(explicit_hit, hit_full, explicit_t, t_full),
        "fixed_faster": stepping / fixed_online,
        "fixed_impact_force": differs(fixed_hit, hit_full, fixed_t, t_full),
        "fixed_impact_impulse": np.trapezoid(fixed_hit, fixed_t) / np.trapezoid(hit_full, t_full) - 1,
        "fixed_online_s": fixed_online, "fixed_steps": fixed_steps,
        "fixed_step_s": fixed_step, "fixed_faster_by_steps": stepping / (fixed_steps * fixed_step),
        "faster_than_explicit": by_steps, "full_explicit_step": full_step, "full_explicit_step_s": of_full_step,
        "force_by_torque": abs(force / (LOAD * shapes.WIDTH) - 1).max(),
        "stiffness_N_mm_um": 1e-9 * stiffness, "with_twist_N_mm_um": 1e-9 * LOAD / ways[0][alone].min(),
        "iso_N_mm_um": 1e-9 * iso_stiffness(), "places_of_one_pair": int(alone.sum()),
        "transmission_um": (1e6 * ways).tolist(), "peak_N": [hit.max(), hit_full.max()],
        "patch_nodes": [len(part.patch_nodes) for _, part in parts], "fe_dofs": [body.fe_dofs for body in bodies],
        "dofs": [body.n_dofs for body in bodies], "mesh_s": meshed - begin, "reduce_s": reduced - meshed,
        "static_s": times[0] / len(PLACES), "full_static_s": times[1] / len(PLACES),
        "impact_dofs": [body.n_dofs for body in quick], "impact_reduce_s": reduce_quick,
        "impact_online_s": online, "impact_full_s": stepping, "impact_full_factors_s": factors,
        "time_s": time.perf_counter() - begin,
    }  # fmt: skip
    beyond = [f"{key} {found[key]:.3g}" for key in LIMITS if abs(found[key]) > LIMITS[key]]
    scenes.finish(__file__, result, beyond + ["faster"] * bool(by_steps < FASTER))


if __name__ == "__main__":
    main()
