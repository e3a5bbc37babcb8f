"""Estimated error of a mesh beside its true one: `ep.mesh_error` in nine scenes, by order and size of elements.

Reference: reduced bodies of cubic elements on a finer mesh, so that the difference is due to the mesh. A coarser one of
these tells how far the reference is from the truth. Its curves are kept in out/.
Quantity: relative L2 difference of the contact force over the impact, as `mesh_error` estimates it and as it is.
Effectivity: the estimated one over the true one. Where the contact ends in a facet changes the error at random; so
scenes with a ball are meshed with it in two or four turns, and judged by the RMS of these.
Limits: effectivity 0.7 to 1.3 where at least one and a half elements are in a contact radius, or cubic ones one; the
references differ by less than half of the errors that are judged, so that the finer one is nearer still.

    python -m validation.mesh.effectivity [--only spheres plate ...]

With `--only` and no name, the stored runs are judged again.
"""

import argparse
import json
import math
import time
import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import exudyn as exu
import netgen.occ as occ
import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from validation.contact import scenes

STEEL, ALUMINIUM = scenes.STEEL, ep.ALUMINIUM
STOCKY = ((2, 1.0, 1.0), (2, 0.7, 1.0), (2, 0.5, 1.0), (3, 1.0, 1.0))
THIN = ((2, 0.6, 1.0), (2, 0.6, 0.5), (3, 0.9, 1.0))
PLATES = (3, 0.45, 0.4)
TURNS = (40.0, 90.0, 65.0, 115.0)  # of balls, whose poles are vertices of each mesh [degrees]
LIMITS = {"least": 0.7, "largest": 1.3, "reference": 0.5}  # the last one: by the least error that is judged
REACH = (1.7, 2.2)  # radii of the patches by that of the contact; an element is added


@dataclass(frozen=True)
class Scene:
    """Two bodies that touch at the origin, the first one above; it moves down.

    Parameters
    ----------
    bodies : ((shape, Material, size), (shape, Material, size))
        With the size of elements far from the contact [m].
    radius : float
        Of the sphere on a plane with the same contact [m].
    mass : float
        Effective one, by a guess [kg]: it gives the contact radius for the meshes.
    speed, end, f_cut : float
        [m/s], [s], [Hz]
    meshes : tuple of (order, size at the contact over its radius, factor on the sizes far from it)
    fine, finer : the same
        Of the references.
    back : bool
        Whether averaged interfaces hold the far ends.
    turns : tuple of float
        Angles by which the first body, a ball, is turned before it is meshed [degrees].
    """

    bodies: tuple
    radius: float
    mass: float
    speed: float
    end: float
    f_cut: float
    meshes: tuple = STOCKY
    fine: tuple = (3, 0.55, 0.7)
    finer: tuple = (3, 0.4, 0.6)
    back: bool = False
    turns: tuple = (0.0,)

    def turned(self, angle):
        """The scene with its first body turned around its centre."""
        (shape, *rest), second = self.bodies
        shape = shape.Rotate(occ.Axis(shape.center, occ.Dir(1, 2, 3)), angle) if angle else shape
        return replace(self, bodies=((shape, *rest), second))

    def models(self, order, size, far):
        """FE models and partitions."""
        materials = [material for _, material, _ in self.bodies]
        a = ep.hertz.impact(self.mass, self.speed, self.radius, np.inf, *materials).contact_radius
        found = []
        for (shape, material, maxh), h, reach, line in zip(
            self.bodies, (size, 1.1 * size), REACH, (-1, 1), strict=True
        ):
            fine = ep.Refine((0, 0, 0), 1.6 * a, h * a)
            fem = ep.fe_model(shape, material, order=order, maxh=far * maxh, refine=[fine], grading=0.5)
            part = ep.Partition.ball(fem, (0, 0, 0), (reach + h) * a, direction=(0, 0, line))
            if self.back:
                part |= ep.Partition.interface(fem, "back", "back", kind="averaged")
            found.append((fem, part))
        return found


def ball(radius, *, up=True):
    return occ.Sphere(occ.Pnt(0, 0, radius if up else -radius), radius)


def rod(radius, tip, length):
    """Upright, with a round tip at the origin."""
    return occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, r=radius, h=length) * (
        occ.Sphere(occ.Pnt(0, 0, tip), tip) + occ.Cylinder(occ.Pnt(0, 0, tip), occ.Z, r=tip, h=length)
    )


def box(x, y, z):
    """Below the origin, between the ends of two ranges."""
    return occ.Box(occ.Pnt(x[0], y[0], -z), occ.Pnt(x[1], y[1], 0))


def head(length, *, up):
    """Cylinder of 10 mm radius with a round head of 12 mm; the face at its back has a name."""
    shape = rod(10e-3, 12e-3, length)
    if not up:
        shape = shape.Rotate(occ.Axis(occ.Pnt(0, 0, 0), occ.X), 180)
    (shape.faces.Max(occ.Z) if up else shape.faces.Min(occ.Z)).name = "back"
    return shape


def mass_of(shape, material=STEEL):
    return material.rho * shape.mass


def small():
    """Ball of 10 mm. Netgen meshes one shape a second time otherwise, so each scene has its own."""
    return ball(5e-3)


def slim():
    return rod(5e-3, 8e-3, 40e-3)


def spheres():
    """Two balls."""
    bodies = (small(), STEEL, 2.5e-3), (ball(5e-3, up=False), STEEL, 2.5e-3)
    return Scene(bodies, 2.5e-3, mass_of(small()) / 2, 0.3, 45e-6, 300e3, turns=TURNS)


def plate():
    """A rod with a round tip and a plate of 3 mm."""
    bodies = (slim(), STEEL, 4e-3), (box((-0.04, 0.04), (-0.04, 0.04), 3e-3), ALUMINIUM, 12e-3)
    return Scene(bodies, 8e-3, mass_of(slim()) / 3, 0.5, 100e-6, 60e3, THIN, (3, 0.6, 0.5), PLATES)


def blocks():
    """Two cylinders with round heads."""
    bodies = (head(71e-3, up=True), STEEL, 4e-3), (head(58e-3, up=False), STEEL, 4e-3)
    return Scene(bodies, 6e-3, mass_of(bodies[0][0]) / 2, 0.3, 150e-6, 100e3, fine=(3, 0.55, 1.0), finer=(3, 0.4, 0.9))


def crank_slider():
    """The same with interfaces at their backs, as the blocks of the crank slider have."""
    bodies = (head(71e-3, up=True), STEEL, 4e-3), (head(58e-3, up=False), STEEL, 4e-3)
    return Scene(
        bodies, 6e-3, mass_of(bodies[0][0]) / 2, 0.3, 150e-6, 60e3, fine=(3, 0.55, 1.0), finer=(3, 0.4, 0.9), back=True
    )


def edge():
    """A ball on a block, 1 mm from an edge."""
    bodies = (small(), STEEL, 2.5e-3), (box((-19e-3, 1e-3), (-10e-3, 10e-3), 10e-3), STEEL, 4e-3)
    return Scene(bodies, 5e-3, mass_of(small()), 0.2, 60e-6, 150e3, turns=TURNS)


def tilted():
    """A rod that leans by 20 degrees, on a plate of 10 mm, beside its centre."""
    leaning = slim().Rotate(occ.Axis(occ.Pnt(0, 0, 8e-3), occ.Y), 20)
    bodies = (leaning, STEEL, 3e-3), (box((-30e-3, 20e-3), (-25e-3, 15e-3), 10e-3), STEEL, 5e-3)
    return Scene(bodies, 8e-3, mass_of(slim()) / 2, 0.3, 100e-6, 100e3, finer=(3, 0.42, 0.65))


def cylinders():
    """Two cylinders that cross at a right angle."""
    radius, length = 5e-3, 30e-3
    upper = occ.Cylinder(occ.Pnt(-length / 2, 0, radius), occ.X, r=radius, h=length)
    lower = occ.Cylinder(occ.Pnt(0, -length / 2, -radius), occ.Y, r=radius, h=length)
    bodies = (upper, STEEL, 2e-3), (lower, STEEL, 2e-3)
    return Scene(bodies, radius, mass_of(upper) / 2, 0.3, 80e-6, 100e3, fine=(3, 0.55, 1.0), finer=(3, 0.4, 0.85))


def thin():
    """A ball on a plate of 2 mm."""
    bodies = (small(), STEEL, 2.5e-3), (box((-0.03, 0.03), (-0.03, 0.03), 2e-3), ALUMINIUM, 8e-3)
    return Scene(bodies, 5e-3, mass_of(small()), 0.2, 80e-6, 75e3, THIN, (3, 0.6, 0.5), PLATES, turns=TURNS[:2])


def hollow():
    """A ball on a tube with a wall of 2 mm."""
    radius, wall, length = 10e-3, 2e-3, 30e-3
    outer, inner = (
        occ.Cylinder(occ.Pnt(-length / 2, 0, -radius), occ.X, r=r, h=length) for r in (radius, radius - wall)
    )
    bodies = (small(), STEEL, 2.5e-3), (outer - inner, STEEL, 5e-3)
    return Scene(bodies, 4e-3, mass_of(small()), 0.2, 80e-6, 100e3, THIN, (3, 0.6, 0.6), (3, 0.45, 0.5), turns=TURNS)


SCENES = {make.__name__: make for make in (spheres, plate, blocks, crank_slider, edge, tilted, cylinders, thin, hollow)}


def reduced(scene, sizes):
    """FE models with their bodies."""
    models = scene.models(*sizes)
    f_cut = min(scene.f_cut, *(0.99 * fem.resolved_frequency for fem, _ in models))
    return [(fem, ep.reduce(fem, partition, f_cut=f_cut)) for fem, partition in models]


def forces(scene, bodies, step=None):
    """Times and contact forces of a run; its step is the default one, or less."""
    mbs = exu.SystemContainer().AddSystem()
    striker = ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=[0, 0, -scene.speed])
    contact = ep.CreatePartitionContact(mbs, striker, ep.CreatePartitionBody(mbs, bodies[1]), passes="given")
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=scene.end, **({} if step is None else {"step": step}))
    return result.t, contact.force(result)


def off(t, force, at, exact):
    """Relative L2 difference of a force from another one."""
    return float(np.linalg.norm(np.interp(at, t, force) - exact) / np.linalg.norm(exact))


def reference(name):
    """Times and forces of a scene with its finer mesh, and what is known of them; from out/ if they are there."""
    scene = SCENES[name]()
    path = scenes.ROOT / "out" / f"mesh_effectivity_{name}.npz"
    key = json.dumps([scene.fine, scene.finer, scene.speed, scene.end, scene.f_cut, scene.mass, scene.radius])
    if not path.is_file() or str(np.load(path)["key"]) != key:
        runs, begin = [], time.process_time()
        for sizes in (scene.fine, scene.finer):
            pairs = reduced(scene, sizes)
            runs.append((*forces(scene, [body for _, body in pairs], scene.end / 500), pairs))
        (t, force, _), (at, exact, pairs) = runs
        path.parent.mkdir(exist_ok=True)
        np.savez(path, key=key, curves=np.array([at, exact]), dofs=sum(fem.n_dofs for fem, _ in pairs),
                 differ=off(t, force, at, exact), cpu_s=time.process_time() - begin)  # fmt: skip
    kept = np.load(path)
    about = {"reference_dofs": int(kept["dofs"]), "references_differ": float(kept["differ"]),
             "references_cpu_s": float(kept["cpu_s"])}  # fmt: skip
    return kept["curves"], about


def estimated(scene, sizes, exact):
    """One mesh: its error as it is and as it is estimated, and times."""
    begin = time.process_time()
    pairs = reduced(scene, sizes)
    reduce_s, begin = time.process_time() - begin, time.process_time()
    estimate = ep.mesh_error(*pairs, speed=scene.speed, duration=scene.end)
    estimate_s = time.process_time() - begin
    true = off(*forces(scene, [body for _, body in pairs], scene.end / 500), *exact)
    return {
        "dofs": sum(fem.n_dofs for fem, _ in pairs), "true": true, "estimated": estimate.force,
        "effectivity": estimate.force / true, "reduce_cpu_s": reduce_s, "estimate_cpu_s": estimate_s,
        "of_bodies": estimate.of_bodies, "far": estimate.far, "local": estimate.local, "rows": estimate.rows,
    }  # fmt: skip


def measured(name):
    """Runs of a scene, printed as a table."""
    exact, about = reference(name)
    scene, runs = SCENES[name](), []
    table = Table("order", "h/a", "unknowns", "true", "estimated", "effectivity", "of its turns", "reduce", "estimate",
                  title=f"{name}; reference: {about['reference_dofs']} unknowns, {about['references_differ']:.2%} from "
                        f"a coarser one, {about['references_cpu_s']:.0f} s")  # fmt: skip
    for sizes in scene.meshes:
        turns = [estimated(scene.turned(angle), sizes, exact) for angle in scene.turns]
        true, found = (math.sqrt(np.mean([turn[key] ** 2 for turn in turns])) for key in ("true", "estimated"))
        run = {
            "order": sizes[0], "size": sizes[1:], "true": true, "estimated": found, "effectivity": found / true,
            "judged": sizes[1] <= (0.7 if sizes[0] == 2 else 1.0), "turns": turns,
        }  # fmt: skip
        runs.append(run)
        table.add_row(
            str(sizes[0]), " ".join(f"{s:g}" for s in sizes[1:]), str(turns[0]["dofs"]), f"{true:.2%}", f"{found:.2%}",
            f"{run['effectivity']:.2f}", " ".join(f"{turn['effectivity']:.2f}" for turn in turns),
            f"{turns[0]['reduce_cpu_s']:.1f} s", f"{turns[0]['estimate_cpu_s']:.1f} s",
        )  # fmt: skip
    Console(width=130).print(table)
    return {**about, "runs": runs}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", nargs="*", choices=SCENES, default=[*SCENES])
    only = parser.parse_args().only
    warnings.simplefilter("ignore", ep.errors.PartitionWarning)  # coarse meshes say so
    path = Path(__file__).with_suffix(".json")
    found = json.loads(path.read_text())["scenes"] if path.is_file() and len(only) < len(SCENES) else {}
    found |= {name: measured(name) for name in only}
    found = {name: found[name] for name in SCENES if name in found}
    judged = {
        f"{name} {run['order']}, {run['size']}": (run, one["references_differ"])
        for name, one in found.items()
        for run in one["runs"]
        if run["judged"]
    }
    effectivities = {name: run["effectivity"] for name, (run, _) in judged.items()}
    by_reference = {name: differ / run["true"] for name, (run, differ) in judged.items()}
    alone = [turn["effectivity"] for run, _ in judged.values() for turn in run["turns"]]
    result = {
        "limits": LIMITS, "scenes": found, "least": min(effectivities.values()),
        "largest": max(effectivities.values()), "reference": max(by_reference.values()), "judged": len(judged),
        "alone": [min(alone), max(alone)],
    }  # fmt: skip
    failed = [name for name, x in effectivities.items() if not LIMITS["least"] <= x <= LIMITS["largest"]]
    failed += [f"reference of {name}" for name, x in by_reference.items() if x > LIMITS["reference"]]
    scenes.finish(__file__, result, failed)


if __name__ == "__main__":
    main()
