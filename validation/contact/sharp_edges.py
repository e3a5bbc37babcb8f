"""A cube falls on its corner, its edge and a face that is hardly tilted; and faces between sharp edges are pressed.

The patch of the cube is its whole skin, or its lower face alone, which ends at the edge that touches. A face alone is
also tried with the default `axes`, where it is hardly tilted. On a plate, the cube is the slave, or it is the master
and its edges have rows="edges". A bar falls on a step: its end meets the floor while the step's edge meets its face.

References: the touch of a rigid cube, and its impulse (1 + e) v / (1 / m + r' I^-1 r) with r the arm of the contact
about the centre of mass, crossed with the normal, and e Newton's coefficient as the motion of the whole body gives it;
for corners, which are so soft that hardly anything vibrates, with e = 1 too. The full FE model of a cube and a plate
with a row at each node of the cube, which is another discretisation of the contact; of the bar and the step the rows
of both make one set there. Uniform pressure in a bar that is
pressed on a plane, or on a bar whose mesh does not match.

Quantity: depth of the corner or edge at the first force, by the size of a facet; impulse; energy over the run; against
the full FE model impulse and peak force; the pressure around nodes within the face, and the force on its edges.
Limits: depth 1 % of a facet; impulse against rigid 1 %; energy 1 %; full FE 3 %; pressure 1e-6 on the plane and 3 % on
the bar.

    python -m validation.contact.sharp_edges
"""

import warnings
from dataclasses import replace
from itertools import product

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
import scipy.sparse as sp
from rich.console import Console
from rich.table import Table
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.surfaces.near import pair_wandering
from validation import tables
from validation.contact import scenes

SIDE, SPEED, GAP, FORCE = 0.02, 1.0, 1e-6, 1e3
PLANES = {"corner": (1.0, 2.0, 3.0), "edge": (0.0, 1.0, 2.0), "tilted face": (0.02, 0.03, 1.0)}
RUNS = [("floating", "implicit", None), ("inertial", "explicit", None), ("floating", "explicit", 0.2)]
PATCHES = {"skin": PLANES, "face": PLANES, "face, axes as usual": ["tilted face"]}
MESHES = (10e-3, 5e-3)  # largest elements of the cube
SHARES = "impulse", "peak"  # of the full FE model
LIMITS = {
    "depth": 0.01,
    "impulse": 0.01,
    "energy": 0.01,
    "full FE": 0.03,
    "pressure, plane": 1e-6,
    "pressure, bar": 0.03,
}


def cube(maxh, normal=(0.0, 0.0, 1.0), f_cut=1e5, patch="skin"):
    """FE model, partition and reduced body of a cube about the origin, turned so that a normal becomes the z axis."""
    shape = occ.Box((-SIDE / 2,) * 3, (SIDE / 2,) * 3)
    for face in shape.faces:
        face.name = "skin"
    normal = np.array(normal) / np.linalg.norm(normal)
    turned = Rotation.align_vectors([[0.0, 0.0, 1.0]], [normal])[0]
    turn = turned.as_rotvec()
    if turn.any():
        shape = shape.Rotate(occ.Axis((0, 0, 0), occ.Dir(*turn)), np.degrees(np.linalg.norm(turn)))
    fem = ep.fe_model(shape, scenes.STEEL, maxh=maxh)
    if patch == "skin":
        part = ep.Partition.surface(fem, "skin")
    else:
        axes = "xyz" if patch == "face" else None
        part = ep.Partition.surface(fem, near=turned.apply([0.0, 0.0, -SIDE / 2]), axes=axes)
    return fem, part, ep.reduce(fem, part, f_cut=f_cut)


def lowest(points, normal):
    """Middle of the points that are lowest along a normal, (3,)."""
    heights = points @ normal
    return points[np.isclose(heights, heights.min(), rtol=0, atol=1e-9)].mean(axis=0)


def on_plane(body, plane, frame, method, friction):
    """One fall on a rigid plane along its normal, beside rigid bodies."""
    normal = np.array(PLANES[plane]) / np.linalg.norm(PLANES[plane])
    place = lowest(body.points, normal)
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, frame=frame, initialVelocity=-SPEED * normal)
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(place - GAP * normal, normal), friction=friction)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=8e-5, method=method, **({"step": 1e-7} if method == "implicit" else {}))
    force = contact.force(result)
    first = int(np.argmax(force > 0))
    impact = contact.impacts(result)[0]
    arm, mass = np.cross(place, normal), body.total_mass
    apparent = 1 / (1 / mass + arm @ arm / (mass * SIDE**2 / 6))
    energy = item.energy(result) + contact.energy(result) + contact.dissipated_energy(result)
    e = impact.speed_after / impact.speed_before
    return {
        "plane": plane, "frame": frame, "method": method, "friction": friction or 0.0,
        "depth": max(SPEED * result.t[first] - GAP, 0.0) / contact.slave_facet_size,
        "e": e, "impulse_Ns": impact.impulse,
        "impulse": None if friction else impact.impulse / (apparent * SPEED * (1 + e)) - 1,
        "impulse, e = 1": None if friction or plane == "edge" else impact.impulse / (2 * apparent * SPEED) - 1,
        "energy": abs(energy / energy[0] - 1).max(), "peak_N": force.max(), "end_us": 1e6 * impact.end,
    }  # fmt: skip


def on_plate(plane, patch):
    """The cube on an elastic plate, reduced and in full: what is compared, and the curves."""
    as_master = patch == "skin of the master"
    fem, part, body = cube(5e-3, PLANES[plane], f_cut=1.4e5, patch="skin" if as_master else patch)
    shape = occ.Box((-0.03, -0.03, -0.03), (0.03, 0.03, 0.0))
    plate = ep.fe_model(shape, scenes.STEEL, maxh=0.012, refine=[ep.Refine((0, 0, 0), radius=0.008, h=4e-3)])
    top = ep.Partition.ball(plate, (0, 0, 0), radius=0.02, axes="xyz")
    lower = ep.reduce(plate, top, f_cut=8e4)
    place = lowest(fem.points, np.array([0.0, 0.0, 1.0]))
    at = [*-place[:2], GAP - place[2]]
    mbs = exu.SystemContainer().AddSystem()
    upper = ep.CreatePartitionBody(mbs, body, referencePosition=at, initialVelocity=[0, 0, -SPEED])
    both = [upper, ep.CreatePartitionBody(mbs, lower)][:: -1 if as_master else 1]
    contacts = [ep.CreatePartitionContact(mbs, *both, passes="given")]
    if as_master:
        contacts.append(ep.CreatePartitionContact(mbs, *both, rows="edges"))
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=6e-5, sample_period=1e-7)
    full = [ep.reference.FullBody(fem, part, at, (0, 0, -SPEED)), ep.reference.FullBody(plate, top)]
    rows = pair_wandering(full[0].surface, full[1].surface, "node-to-segment")
    named = {"patch": patch, "falls on": plane, "dofs": fem.n_dofs + plate.n_dofs, "kept": body.n_dofs + lower.n_dofs}
    return beside_full(named, result, both, contacts, full, rows)


def beside_full(named, result, items, contacts, full, rows):
    """What is compared of contacts with full FE models, and the curves of both."""
    forces = [contact.force(result) for contact in contacts]
    force, energy = sum(forces), sum(item.energy(result) for item in (*items, *contacts))
    first = max(result.t[np.argmax(one > 0)] for one in forces if one.any())
    history = ep.reference.simulate(full, end_time=result.t[-1], step=1e-7, rows=rows)
    both = (result.t, force), (history.t, history.force)
    (impulse, peak), (full_impulse, full_peak) = ((np.trapezoid(f, t), f.max()) for t, f in both)
    of_edges = np.trapezoid(forces[1], result.t) if len(forces) > 1 else None
    return {
        **named, "depth": (SPEED * first - GAP) / contacts[0].slave_facet_size,
        "energy": abs(energy / energy[0] - 1).max(),
        "impulse_Ns": impulse, "of the master's edges_Ns": of_edges, "peak_N": peak,
        "impulse": impulse / full_impulse - 1, "peak": peak / full_peak - 1,
    }, both  # fmt: skip


def on_step():
    """A bar falls on a step: its end on the floor, and the step's edge on its face; see `on_plate`."""
    height, way, length = 0.01, 0.02, 0.06
    shape = occ.Box((-0.04, -0.01, -0.02), (0.03, 0.01, 0)) + occ.Box((0, -0.01, -0.02), (0.03, 0.01, height))
    step = ep.fe_model(shape, scenes.STEEL, maxh=6e-3)
    nodes = step.points[step.facets]
    x, y, _ = nodes.mean(axis=1).T
    part = ep.Partition.surface(step, (nodes[..., 2] > -1e-9).all(axis=1) & (abs(y) < 0.0099) & (x < 0.0299))
    turn = Rotation.from_euler("y", -np.arctan2(height, way))
    shape = occ.Box((-length / 2, -0.005, 0), (length / 2, 0.005, 0.008))
    shape = shape.Rotate(occ.Axis((0, 0, 0), occ.Y), np.degrees(turn.as_euler("yxz")[0]))
    bar = ep.fe_model(shape, scenes.STEEL, maxh=5e-3)
    face = ep.Partition.surface(bar, near=(0, 0, 0), axes="xyz")
    at = np.array([-way, 0, GAP]) - turn.apply([-length / 2, 0, 0])
    upper, lower = ep.reduce(bar, face, f_cut=1.2e5), ep.reduce(step, part, f_cut=1.0e5)
    mbs = exu.SystemContainer().AddSystem()
    both = [ep.CreatePartitionBody(mbs, upper, referencePosition=at, initialVelocity=[0, 0, -SPEED])]
    both.append(ep.CreatePartitionBody(mbs, lower))
    contacts = [ep.CreatePartitionContact(mbs, *both, passes="given", rows=kind) for kind in ("integrated", "edges")]
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=6e-5, sample_period=1e-7)
    full = [ep.reference.FullBody(bar, face, at, (0, 0, -SPEED)), ep.reference.FullBody(step, part)]
    rows = pair_wandering(full[0].surface, full[1].surface, "node-to-segment")
    rows = one_set(rows, pair_wandering(full[1].surface, full[0].surface, "edges"))
    named = {"patch": "both", "falls on": "step", "dofs": bar.n_dofs + step.n_dofs, "kept": upper.n_dofs + lower.n_dofs}
    return beside_full(named, result, both, contacts, full, rows)


def one_set(nodes, edges):
    """Rows of the slave's nodes, and those of nodes at the master's edges, whose gaps are taken the other way round."""
    some, others, more = nodes.points, edges.points, edges.master.shape[1] - 1
    points = replace(
        some,
        nodes=np.vstack([np.repeat(some.nodes, more + 1, axis=1), edges.master]),
        weights=np.vstack([np.pad(some.weights, ((0, 0), (0, more))), edges.weights]),
        mean=sp.block_diag([some.mean, others.mean], format="csr"),
        row_nodes=np.r_[some.row_nodes, edges.master[:, 0]],
        area=np.r_[some.area, others.area],
    )
    return replace(
        nodes,
        points=points,
        facet=np.r_[nodes.facet, 0 * edges.facet],
        local=np.vstack([nodes.local, edges.local]),
        master=np.vstack([nodes.master, others.nodes]),
        weights=np.vstack([nodes.weights, others.weights]),
        normals=np.vstack([nodes.normals, -edges.normals]),
        gap=np.r_[nodes.gap, edges.gap],
        leaves_at=np.r_[nodes.leaves_at, edges.leaves_at],
    )


def bar(sign, maxh, all_around):
    """A bar above or below the plane z = 0; its patch is its end, and perhaps the sides beside it."""
    shape = occ.Box((-SIDE / 2, -SIDE / 2, min(0, 2 * sign * SIDE)), (SIDE / 2, SIDE / 2, max(0, 2 * sign * SIDE)))
    fem = ep.fe_model(shape, scenes.STEEL, maxh=maxh)
    near = abs(fem.points[fem.facets, 2]).max(axis=1) < (1.6 * SIDE if all_around else 1e-9)
    head = np.flatnonzero(np.isclose(fem.points[:, 2], sign * 2 * SIDE))
    part = ep.Partition.surface(fem, near) | ep.Partition.interface(fem, "head", head, kind="averaged")
    return ep.reduce(fem, part, f_cut=4e4)


def pressed(master, all_around, own=True):
    """A bar pressed on a plane or a bar: its pressure within the face, and the force on its edges.

    `all_around` and `own` say whether the patches of master and slave go around the edges.
    """
    mbs = exu.SystemContainer().AddSystem()
    upper = ep.CreatePartitionBody(mbs, bar(1, 8e-3, own))
    other = ep.RigidPlane() if master == "plane" else ep.CreatePartitionBody(mbs, bar(-1, 6.5e-3, all_around))
    contact = ep.CreatePartitionContact(mbs, upper, other, passes="given")
    held = [(upper, 1, [1, 1, 0, 1, 1, 1])] + ([(other, -1, [1] * 6)] if master == "bar" else [])
    for item, sign, axes in held:
        fixed = mbs.AddMarker(
            items.MarkerBodyRigid(bodyNumber=mbs.AddObject(items.ObjectGround()), localPosition=[0, 0, 2 * sign * SIDE])
        )
        head = item.CreateInterfaceMarker(mbs, "head")
        guide = items.GenericJoint(markerNumbers=[fixed, head])
        guide.constrainedAxes = axes
        mbs.AddObject(guide)
        if sign > 0:
            mbs.AddLoad(items.LoadForceVector(markerNumber=head, loadVector=[0, 0, -FORCE]))
    mbs.Assemble()
    result = ep.solve_static(mbs, load_steps=2)
    surface = contact.mechanics.gaps.slave.surface
    inner = np.isclose(surface.points[:, 2], 0, atol=1e-6) & (abs(surface.points[:, :2]).max(axis=1) < 0.49 * SIDE)
    pressure = contact.pressure(result).toarray()[-1, inner] / (FORCE / SIDE**2)
    return {
        "master": master, "edges of the slave": own, "edges of the master": all_around,
        "pressure": abs(pressure - 1).max(),
        "area": contact.area(result)[-1] / SIDE**2 - 1,
        "on edges": contact.row_forces(result).toarray()[-1, surface.sharp].sum() / FORCE,
    }  # fmt: skip


def worst(found):
    """Largest errors by what is limited."""
    planes, plates, bars = found["planes"], found["plates"], found["bars"]
    impulses = [abs(r[key]) for r in planes for key in ("impulse", "impulse, e = 1") if r[key] is not None]
    return {
        "depth": max(r["depth"] for r in planes + plates),
        "impulse": max(impulses),
        "energy": max(r["energy"] for r in planes + plates),
        "full FE": max(abs(r[key]) for r in plates for key in SHARES),
        **{f"pressure, {m}": max(r["pressure"] for r in bars if r["master"] == m) for m in ("plane", "bar")},
    }


def draw(curves):
    path, (figure, axes) = scenes.figure(__file__, ncols=len(curves), figsize=(4 * len(curves), 3.6))
    for ax, (plane, found) in zip(axes, curves.items(), strict=True):
        for color, (patch, ((t, force), (full_t, full_force))) in enumerate(found.items()):
            ax.plot(1e6 * full_t, 1e-3 * full_force, f"C{color}-", lw=4, alpha=0.3, label=f"{patch}: full FE")
            ax.plot(1e6 * t, 1e-3 * force, f"C{color}-", lw=1, label=f"{patch}: this library")
        ax.set(
            title="bar on a step" if plane == "step" else f"cube on its {plane}",
            xlabel="time [µs]",
            ylabel="force [kN]",
        )
    axes[1].legend()
    figure.savefig(path, dpi=110)


def write_table(found):
    """Write the page's table."""
    lines = [
        "| cube of 20 mm on | elements | depth at the first force, by a facet | e | impulse against rigid | energy |",
        "|---|---|---|---|---|---|",
    ]
    runs = [r for r in found["planes"] if (r["frame"], r["method"], r["friction"]) == (*RUNS[0][:2], 0.0)]
    for r in runs:
        if r["patch"] == "skin":
            depth = f"{r['depth']:.0e}" if r["depth"] > 1e-9 else "0"
            lines.append(
                f"| its {r['plane']} | {1e3 * r['maxh']:g} mm | {depth} | {r['e']:.3f} | {r['impulse']:.1e} | "
                f"{r['energy']:.1e} |"
            )
    alone = [max(abs(r[key]) for r in runs if r["patch"] != "skin") for key in ("depth", "impulse", "energy")]
    plates = ", ".join(
        " and ".join(f"{max(abs(r[key]) for r in found['plates'] if r['falls on'] == plane):.2%}" for key in SHARES)
        + f" ({said})"
        for plane, said in (("corner", "corner on a plate"), ("edge", "edge on a plate"), ("step", "bar on a step"))
    )
    depth, impulse, energy = alone
    lines.append(
        f"\nWith the lower face alone as patch, these are at most {depth:.0e}, {impulse:.1e} and {energy:.0e}.\n"
        f"Beside full FE models with a row at each node, impulse and peak force are off by {plates}."
    )
    tables.write_between(
        scenes.ROOT / "examples" / "site" / "sharp-edges.md", "contact/sharp_edges.py", "\n".join(lines) + "\n"
    )


def main():
    warnings.simplefilter("ignore", ep.errors.YieldWarning)  # the reference is elastic
    warnings.filterwarnings("ignore", ".*only a sharp corner or edge touches")
    planes = []
    for maxh, (patch, some) in product(MESHES, PATCHES.items()):
        _, _, body = cube(maxh, patch=patch)
        for plane, run in product(some, RUNS):
            if run[2] is None or body.partition.patches[0].axes == "xyz":
                planes.append({"patch": patch, "maxh": maxh, **on_plane(body, plane, *run)})
    plates, curves = [], {"corner": {}, "edge": {}, "step": {}}
    for plane, patch in product(("corner", "edge"), ("skin", "face", "skin of the master")):
        found, curves[plane][patch] = on_plate(plane, patch)
        plates.append(found)
    found, curves["step"]["both"] = on_step()
    plates.append(found)
    bars = [pressed("plane", False), pressed("bar", False), pressed("bar", True)]
    bars += [pressed("plane", False, own=False), pressed("bar", False, own=False)]
    found = {"planes": planes, "plates": plates, "bars": bars}
    for name, rows in found.items():
        table = Table(*rows[0], title=name)
        for row in rows:
            table.add_row(*(f"{value:.4g}" if isinstance(value, float) else str(value) for value in row.values()))
        Console(width=170).print(table)
    draw(curves)
    errors = worst(found)
    failed = [f"{name}: {value:.2e}" for name, value in errors.items() if not value <= LIMITS[name]]
    if not failed:
        write_table(found)
    scenes.finish(__file__, {"limits": LIMITS, "found": errors, **found}, failed)


if __name__ == "__main__":
    main()
