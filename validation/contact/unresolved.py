"""Contacts that are smaller than the facets around them: formulation "hertz" against refined patches and series.

Scenes: a ball on a rigid plane, two balls, a soft ball on a steel one at a low speed, a ball on a free thin plate, a
ball in a rigid bore (an elliptic contact), a ball that falls into a groove and touches two rigid faces at once, and the
rounded corner of a block on a rigid plane (a torus, with two curvatures that depend on the place), and a block with
two bumps that stand near each other. In the groove and with the bumps, one patch has both points, which the library
finds; rows have a patch for each. And the ball on a plane with cubic elements.
The elements at the contact are one, two and four contact radii long, on the plane also down to where they resolve the
contact. It is at a node, at the middle of an edge and at the middle of a facet. Beside it, formulation "compliance" on
the same meshes.
References: of balls on planes and balls, the series solution of whole elastic spheres (elastic_sphere.py); of plate,
bore, groove, corner and bumps, "compliance" on patches with three and a half elements in the contact radius.
Quantities: peak of the force, impulse, duration between 5 % of the peak, the change of energy, and processor times.

Two balls also hit each other at an angle, with friction. Reference: Maw, Barber and Fawcett with the flexibility of a
whole sphere (mindlin_ball.py), and rows on refined patches. With these, a ball also hits a rigid plane: there normal
forces cause slip, too, which Maw, Barber and Fawcett leave out. And it hits a bore, along its axis and across it (an
elliptic contact), with nu = 0.45, for in elliptic contacts the law leaves that slip out as well.
Quantity: tangential impulse. And a ball with a coarse skin rolls over its elements by its weight: the normal force
should be the weight.
A body of revolution, a ball that goes on as a torus and a cylinder, tumbles on a plane at up to 2000 rad/s, so that its
point of contact passes over the seam, or stays on one face, with friction and without. So it does on a free elastic
ball, both with their whole skins. Quantity: change of energy.
Limits: peak, impulse and duration 1 %, on the plate 1.5 %, energy 1e-3 of its start; tangential impulse 3 %; force of
the rolling ball 2 %, at rest 0.5 %.

    python -m validation.contact.unresolved [--quick] [--out FILE]
"""

import argparse
import itertools
import json
import time
import warnings
from functools import cache
from pathlib import Path

import exudyn as exu
import netgen.occ as occ
import numpy as np
from rich.console import Console
from rich.table import Table

import exudyn_partition as ep
from exudyn_partition.contact.true_surface import Torus
from exudyn_partition.fe.shapes import shape_functions
from validation.contact import scenes
from validation.contact.elastic_sphere import ElasticSphere
from validation.contact.mindlin_ball import oblique_impact
from validation.tables import PAGE, write_between

RADIUS, SPEED, SMALL, F_CUT = 10e-3, 0.5, 5e-3, 200e3
THICK, WIDTH = 3e-3, 40e-3  # of the plate [m]
BORE = 15e-3
CORNER = (8e-3, 4e-3)  # radii of the block's upright edge and of the fillet around its top: a torus [m]
BLOCK, BUMP, BETWEEN = (24e-3, 16e-3, 8e-3), 4e-3, 6e-3  # block with bumps, their radius and distance [m]
SOFT = ep.Material(E=3e9, nu=0.4, rho=1200.0)
SCENES = ["plane", "two balls", "unlike balls", "plate", "bore", "groove", "corner", "bumps", "cubic"]
PARTS = [*SCENES, "friction", "seams"]
SIZES = (1.0, 2.0, 4.0)  # of elements, by the radius of contact
FINE = 1 / 3.5
RESOLVED = (FINE, 0.5)  # of a ball on a plane: the law needs no switch to rows where facets resolve the contact
PLACES = ("node", "edge", "facet")
LIMITS = {
    "plane": 0.01, "two balls": 0.01, "unlike balls": 0.01, "plate": 0.015, "bore": 0.01, "groove": 0.01,
    "corner": 0.01, "bumps": 0.01, "cubic": 0.01, "energy": 1e-3, "oblique": 0.03, "rolling": 0.02, "rest": 0.005,
}  # fmt: skip
FRICTION, SLIDING = 0.3, (0.1, 0.3, 0.6, 1.5)  # m/s
SLOW = 0.1  # m/s, at which the ball sticks, and swings back
ALIKE = ep.Material(E=210e9, nu=0.45, rho=7850.0)  # its normal forces hardly slide on a rigid surface
MARGIN = 2e-7  # gap at the start [m]


def mass_of(radius):
    """Mass of a steel ball [kg]."""
    return scenes.STEEL.rho * 4 / 3 * np.pi * radius**3


def unlike_mass():
    """Effective mass of a soft ball and one of steel [kg]."""
    steel = mass_of(RADIUS)
    return ep.hertz.effective(steel, steel * SOFT.rho / scenes.STEEL.rho)


def contact_radius(scene):
    """Largest contact radius of a scene by Hertz [m]."""
    if scene == "plate":
        return ep.hertz.impact(mass_of(SMALL), SPEED, SMALL, np.inf, scenes.STEEL, ep.ALUMINIUM).contact_radius
    if scene == "unlike balls":
        return ep.hertz.impact(unlike_mass(), SLOW, RADIUS, RADIUS, SOFT, scenes.STEEL).contact_radius
    if scene == "bumps":
        mass = scenes.STEEL.rho * np.prod(BLOCK)
        return ep.hertz.impact(mass / 2, SPEED, BUMP, np.inf, scenes.STEEL).contact_radius
    if scene == "corner":
        return ep.hertz.impact(0.02, SPEED, 6e-3, np.inf, scenes.STEEL).contact_radius
    two = scene == "two balls"
    masses = mass_of(RADIUS) / (2 if two else 1)  # in a groove each contact is a little smaller, as the speed is
    others = (RADIUS, scenes.STEEL) if two else (-BORE if scene == "bore" else np.inf, None)
    return ep.hertz.impact(masses, SPEED, RADIUS, others[0], scenes.STEEL, others[1]).contact_radius


@cache
def ball(radius, h, fine, material=scenes.STEEL, order=2):
    """Ball about the origin with elements of size h at its south pole, reduced."""
    fem = ep.fe_model(sphere(radius), material, order=order, **mesh((0, 0, -radius), h, fine, 0.25 * radius))
    part = ep.Partition.ball(fem, (0, 0, -radius), patch(h, fine), axes="xyz", direction=(0, 0, -1))
    return ep.reduce(fem, part, f_cut=60e3 if material == SOFT else F_CUT)


def sphere(radius):
    """Ball about the origin; its poles are no poles of the shape, where facets would be the same on all sides."""
    return occ.Sphere(occ.Pnt(0, 0, 0), radius).Rotate(occ.Axis(occ.Pnt(0, 0, 0), occ.Dir(1, 0.3, 0.1)), 50)


@cache
def groove_ball(h, fine, one):
    """Ball about the origin with elements of size h where it touches each face of a groove; a patch there, or `one`."""
    first, second = (tuple(RADIUS * n) for n in GROOVE)
    options = mesh(first, h, fine, 0.25 * RADIUS)
    options["refine"] += mesh(second, h, fine, 0.25 * RADIUS)["refine"]
    fem = ep.fe_model(sphere(RADIUS), scenes.STEEL, **options)
    if one:
        part = ep.Partition.surface(fem, near=(0, 0, -RADIUS), axes="xyz")
    else:
        part = patch_of_each(fem, (first, second), GROOVE, h, fine)
    return ep.reduce(fem, part, f_cut=F_CUT)


def patch_of_each(fem, places, normals, h, fine):
    """A patch around each of two places."""
    first, second = (
        ep.Partition.ball(fem, place, patch(h, fine), axes="xyz", direction=tuple(n))
        for place, n in zip(places, normals, strict=True)
    )
    return first | second


def mesh(place, h, fine, maxh):
    """Options of a mesh with elements of size h around a place."""
    return {"maxh": maxh, "refine": [ep.Refine(place, patch(h, fine) + 1.5 * h, h)], "grading": 0.4}


def patch(h, fine):
    """Radius of a patch: of a contact that elements resolve, or of the kernel of one that they do not."""
    return 6.5 * h if fine else 5.2 * h


@cache
def plate(h, fine):
    """Free aluminium plate with its upper face at z = 0."""
    shape = occ.Box(occ.Pnt(-WIDTH / 2, -WIDTH / 2, -THICK), occ.Pnt(WIDTH / 2, WIDTH / 2, 0))
    h = min(h, 0.4 * THICK)  # two elements through the thickness
    fem = ep.fe_model(shape, ep.ALUMINIUM, **mesh((0, 0, 0), h, fine, 0.1 * WIDTH))
    return ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), patch(h, fine), axes="xyz"), f_cut=F_CUT)


GROOVE = np.array([[1.0, 0.0, -1.0], [-1.0, 0.0, -1.0]]) / 2**0.5  # from the ball to both faces


def groove_impact(body, formulation, one):
    """A ball that falls into a groove and touches both faces at once, with one patch, or one for each face."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, initialVelocity=[0, 0, -SPEED])
    contacts = [
        ep.CreatePartitionContact(
            mbs,
            item,
            ep.RigidPlane((RADIUS + MARGIN) * n, -n),
            formulation=formulation,
            slavePatch=0 if one else number,
        )
        for number, n in enumerate(GROOVE)
    ]
    mbs.Assemble()
    return solved(mbs, [item], contacts, 80e-6)


@cache
def bumps(h, fine, one):
    """Block of steel with two bumps, and a patch of both and what is between, or one on each."""
    block = occ.Box(occ.Pnt(-BLOCK[0] / 2, -BLOCK[1] / 2, 0), occ.Pnt(BLOCK[0] / 2, BLOCK[1] / 2, BLOCK[2]))
    places = [(side * BETWEEN / 2, 0, BLOCK[2] + 1e-3) for side in (-1, 1)]
    options = {"maxh": 2e-3, "refine": [], "grading": 0.4}
    for x, y, z in places:
        block += sphere(BUMP).Move(occ.Vec(x, y, z - BUMP))
        options["refine"] += mesh((x, y, z), h, fine, 0)["refine"]
    fem = ep.fe_model(block, scenes.STEEL, **options)
    if one:
        part = ep.Partition.ball(fem, (0, 0, places[0][2]), BETWEEN / 2 + 2.7e-3, axes="xyz", direction=(0, 0, 1))
    else:
        part = patch_of_each(fem, places, [(0, 0, 1)] * 2, h, fine)
    return ep.reduce(fem, part, f_cut=F_CUT)


def bumps_impact(body, formulation, one):
    """A block that hits a rigid plane with two bumps."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, initialVelocity=[0, 0, SPEED])
    plane = ep.RigidPlane((0, 0, BLOCK[2] + 1e-3 + MARGIN), (0, 0, -1))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the plane faces between the bumps
        if one:
            contacts = ep.CreatePartitionContact(mbs, [item, plane], formulation=formulation)
        else:
            contacts = [
                ep.CreatePartitionContact(mbs, item, plane, slavePatch=n, formulation=formulation) for n in (0, 1)
            ]
    mbs.Assemble()
    return solved(mbs, [item], contacts, 70e-6)


CORNER_NORMAL = np.full(3, 3**-0.5)
CORNER_PLACE = np.array([12e-3, 12e-3, 6e-3]) + CORNER[1] * CORNER_NORMAL + 4e-3 * np.array([0.5**0.5, 0.5**0.5, 0.0])


@cache
def corner(h, fine):
    """Block of steel whose corner is rounded."""
    block = occ.Box(occ.Pnt(0, 0, 0), occ.Pnt(20e-3, 20e-3, 10e-3))
    block = block.MakeFillet([e for e in block.edges if min(e.center.x, e.center.y) > 0.019], CORNER[0])
    block = block.MakeFillet([e for e in block.edges if e.center.z > 0.0099], CORNER[1])
    fem = ep.fe_model(block, scenes.STEEL, **mesh(tuple(CORNER_PLACE), h, fine, 3e-3))
    near = {"axes": "xyz", "direction": CORNER_NORMAL}
    return ep.reduce(fem, ep.Partition.ball(fem, CORNER_PLACE, patch(h, fine), **near), f_cut=F_CUT)


def place_of(body, near, kind):
    """Node, middle of an edge or middle of a facet that is nearest to a point, (3,) [m], on the body's patch."""
    facets, points = body.partition.patches[0].facets, body.points
    local = {"node": [0, 0], "edge": [0.5, 0.5], "facet": [1 / 3, 1 / 3]}[kind]
    x = shape_functions(np.array([local]), facets.shape[1])[0, 0] @ points[facets]
    return x[np.linalg.norm(x - near, axis=1).argmin()]


def impact(scene, size, kind, formulation):
    """History of an impact: times, force, energy, and processor time of the run."""
    fine, h = size < 1, size * contact_radius(scene)
    if scene in ("groove", "bumps"):
        one = formulation == "hertz"
        body, meet = (groove_ball, groove_impact) if scene == "groove" else (bumps, bumps_impact)
        return meet(body(h, fine, one), formulation, one)
    if scene == "corner":
        return corner_impact(corner(h, fine), formulation)
    mbs = exu.SystemContainer().AddSystem()
    radius = SMALL if scene == "plate" else RADIUS
    unlike = scene == "unlike balls"
    body = ball(radius, h, fine, SOFT if unlike else scenes.STEEL, 3 if scene == "cubic" else 2)
    x = place_of(body, np.array([0, 0, -radius]), kind)
    n = x / np.linalg.norm(x)  # direction of motion
    first = ep.CreatePartitionBody(mbs, body, initialVelocity=list((SLOW if unlike else SPEED) * n))
    bodies = [first]
    if scene in ("plane", "cubic"):
        partner = ep.RigidPlane(point=(radius + MARGIN) * n, normal=-n)
    elif scene == "bore":
        axis = np.cross(n, [0.3, 1.0, 0.1])
        partner = ep.RigidCylinder((radius + MARGIN - BORE) * n, axis, BORE, hollow=True)
    elif scene in ("two balls", "unlike balls"):
        second = ball(radius, h, fine)
        across = np.cross(n, [1.0, 0, 0]) / np.linalg.norm(np.cross(n, [1.0, 0, 0]))
        flip = 2 * np.outer(across, across) - np.eye(3)  # a half turn, so that both balls meet with the same place
        partner = ep.CreatePartitionBody(
            mbs, second, frame="floating", referencePosition=list((2 * radius + MARGIN) * n),
            referenceRotationMatrix=flip.tolist(),
        )  # fmt: skip
        bodies.append(partner)
    else:
        other = plate(h, fine)
        y = place_of(other, np.zeros(3), kind)
        up = np.array([0, 0, 1.0])
        turn = _turn(n, -up)
        mbs = exu.SystemContainer().AddSystem()
        first = ep.CreatePartitionBody(
            mbs, body, frame="floating", referencePosition=list(y + (radius + MARGIN) * up),
            referenceRotationMatrix=turn.tolist(), initialVelocity=list(-SPEED * up),
        )  # fmt: skip
        partner = ep.CreatePartitionBody(mbs, other)
        bodies = [first, partner]
    contact = ep.CreatePartitionContact(mbs, first, partner, formulation=formulation)
    mbs.Assemble()
    return solved(mbs, bodies, [contact], {"plate": 60e-6, "unlike balls": 240e-6}.get(scene, 75e-6))


def solved(mbs, bodies, contacts, end):
    """Times, force, relative change of energy, and processor time of a run."""
    begin = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = ep.solve_dynamic(mbs, end_time=end, step=end / 1500)
    taken = time.process_time() - begin
    energy = sum(item.energy(result) for item in [*bodies, *contacts])
    return result.t, sum(contact.force(result) for contact in contacts), float(np.ptp(energy) / energy[0]), taken


def corner_impact(body, formulation):
    """The same of a rounded corner that comes along its normal there, at one place, wherever facets are."""
    mbs, n = exu.SystemContainer().AddSystem(), CORNER_NORMAL
    item = ep.CreatePartitionBody(mbs, body, frame="floating", initialVelocity=list(SPEED * n))
    contact = ep.CreatePartitionContact(
        mbs, item, ep.RigidPlane(CORNER_PLACE + MARGIN * n, -n), formulation=formulation
    )
    mbs.Assemble()
    return solved(mbs, [item], [contact], 90e-6)


def _turn(a, b):
    """Rotation matrix that turns unit vector a into b."""
    axis, c = np.cross(a, b), a @ b
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + K + K @ K / (1 + c)


def measures(t, force):
    """Peak [N], impulse [N s] and duration between 5 % of the peak [s]."""
    peak = force.max()
    on = np.flatnonzero(force > 0.05 * peak)
    if not len(on):
        return {"peak": 0.0, "impulse": 0.0, "duration": 0.0}
    i, j = on[0], on[-1]
    start = np.interp(0.05 * peak, force[i - 1 : i + 1], t[i - 1 : i + 1])
    stop = np.interp(-0.05 * peak, -force[j : j + 2], t[j : j + 2])
    return {"peak": float(peak), "impulse": float(np.trapezoid(force, t)), "duration": float(stop - start)}


@cache
def reference(scene):
    """Peak, impulse and duration between 5 % of the peak of the true impact."""
    if scene in ("plate", "bore", "corner", "groove", "bumps"):
        return measures(*impact(scene, FINE, "node", "compliance")[:2])
    if scene == "unlike balls":
        return unlike_reference()
    two = scene == "two balls"
    sphere = ElasticSphere(RADIUS, scenes.STEEL)
    speed, mass = (SPEED / 2 if two else SPEED), mass_of(RADIUS)
    t = np.linspace(0, 75e-6, 20_001)
    way, rate, force = 0.0, speed, []
    for dt in np.diff(t, prepend=0.0):  # each of two equal balls meets a plane
        rate -= 0.5 * dt * float(sphere.force(way)) / mass
        way += dt * rate
        force.append(float(sphere.force(way)))
        rate -= 0.5 * dt * force[-1] / mass
    return measures(t, np.array(force))


def unlike_reference():
    """Measures of the impact of a soft ball on one of steel: Hertz's law, and what each sphere yields besides."""
    force = (
        np.linspace(0, 1, 4001) ** 2
        * ep.hertz.impact(unlike_mass(), 1.5 * SLOW, RADIUS, RADIUS, SOFT, scenes.STEEL).peak_force
    )
    modulus = 1 / sum(1 / material.plane_strain_modulus for material in (SOFT, scenes.STEEL))
    approach = (9 * force**2 / (16 * modulus**2 * 0.5 * RADIUS)) ** (1 / 3)
    for material in (SOFT, scenes.STEEL):  # on a rigid plane it yields as much beyond Hertz's law
        sphere = ElasticSphere(RADIUS, material)
        ways = np.linspace(0, 1, 4001) ** 2 * 3e-3 * RADIUS
        hertz = (3 * force / (4 * material.plane_strain_modulus * RADIUS**0.5)) ** (2 / 3)
        approach += np.interp(force, sphere.force(ways), ways) - hertz
    t = np.linspace(0, 240e-6, 20_001)
    way, rate, now, found = 0.0, SLOW, 0.0, []
    for dt in np.diff(t, prepend=0.0):
        rate -= 0.5 * dt * now / unlike_mass()
        way += dt * rate
        now = float(np.interp(way, approach, force))
        found.append(now)
        rate -= 0.5 * dt * now / unlike_mass()
    return measures(t, np.array(found))


def errors(found, true):
    """Relative errors of measures."""
    return {what: found[what] / true[what] - 1 for what in true}


def oblique(scene, size, sliding, across=False):
    """Tangential impulse of an impact at an angle, at the middle of a facet, change of energy, and what friction took.

    By rows on a refined patch if `size` is below one; the ball slides along the bore, or `across` it.
    """
    fine, material = size < 1, ALIKE if scene == "bore" else scenes.STEEL
    body = ball(RADIUS, size * contact_radius("plane"), fine, material)
    x = place_of(body, np.array([0, 0, -RADIUS]), "facet")
    n = x / np.linalg.norm(x)
    along = np.cross(n, [0.3, 1, 0.2])
    along /= np.linalg.norm(along)
    mbs = exu.SystemContainer().AddSystem()
    velocity = SPEED * n + sliding * along
    items = [ep.CreatePartitionBody(mbs, body, initialVelocity=list(velocity))]
    if scene == "two balls":
        flip = 2 * np.outer(along, along) - np.eye(3)
        items.append(ep.CreatePartitionBody(
            mbs, body, frame="floating", referencePosition=list((2 * RADIUS + MARGIN) * n),
            referenceRotationMatrix=flip.tolist(), initialVelocity=list(-velocity),
        ))  # fmt: skip
    elif scene == "bore":
        axis = np.cross(n, along) if across else along
        items.append(ep.RigidCylinder((RADIUS + MARGIN - BORE) * n, axis, BORE, hollow=True))
    else:
        items.append(ep.RigidPlane(point=(RADIUS + MARGIN) * n, normal=-n))
    formulation = "compliance" if fine else "hertz"
    contact = ep.CreatePartitionContact(mbs, *items, formulation=formulation, friction=FRICTION)
    mbs.Assemble()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = ep.solve_dynamic(mbs, end_time=80e-6, step=80e-6 / 1600)
    impulse = np.trapezoid(contact.friction.tangential_force(result) @ along, result.t)
    taken = contact.dissipated_energy(result)
    energy = contact.energy(result) + taken
    energy += sum(item.energy(result) for item in items if isinstance(item, ep.PartitionBody))
    return float(impulse), float(np.ptp(energy) / energy[0]), float(taken[-1])


def rolling(speed):
    """Largest difference of the normal force from the weight, by the weight, of a ball that rolls on its skin."""
    gravity = 9.81
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), RADIUS), scenes.STEEL, maxh=0.3 * RADIUS)
    body = ep.reduce(fem, ep.Partition.surface(fem, near=(0, 0, -RADIUS), axes="xyz"), f_cut=100e3)
    weight = body.total_mass * gravity
    depth = (9 * weight**2 / (16 * scenes.STEEL.plane_strain_modulus**2 * RADIUS)) ** (1 / 3)

    def forces(depth, end):
        mbs = exu.SystemContainer().AddSystem()
        item = ep.CreatePartitionBody(
            mbs, body, frame="floating", gravity=[0, 0, -gravity], referencePosition=[0, 0, RADIUS - depth],
            initialVelocity=[speed, 0, 0], initialAngularVelocity=[0, speed / RADIUS, 0],
        )  # fmt: skip
        contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), formulation="hertz", friction=FRICTION)
        mbs.Assemble()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return contact.force(ep.solve_dynamic(mbs, end_time=end, step=1e-5, method="implicit"))

    for _ in range(2):  # what sticks as the ball is laid down makes the contact stiffer than Hertz's
        depth *= (weight / forces(depth, 2e-5)[0]) ** (2 / 3)
    return float(abs(forces(depth, 10e-3) / weight - 1).max())


def with_friction(sizes, failed, quick):
    """Oblique impacts, and a ball that rolls."""
    rows = []

    def judge(scene, size, sliding, expected, across=False):
        impulse, energy, _ = oblique(scene, size, sliding, across)
        name = f"{scene}{', across' * across}, oblique, {sliding:g} m/s, {size:g} a"
        off = impulse / expected - 1
        rows.append({"scene": scene, "across": across, "sliding": sliding, "size": size, "impulse": off,
                     "energy": energy})  # fmt: skip
        failed.extend([f"{name}: tangential impulse {off:.2%}"] * (abs(off) > LIMITS["oblique"]))
        failed.extend([f"{name}: energy {energy:.1e}"] * (energy > LIMITS["energy"]))

    for sliding in SLIDING:
        true = oblique_impact(RADIUS, scenes.STEEL, SPEED, sliding, FRICTION, 75e-6)
        for size in sizes:
            judge("two balls", size, sliding, -float(np.trapezoid(true[2], true[0])))
    edge = {}
    if not quick:
        for scene, across in (("two balls", False), ("bore", False), ("bore", True)):
            refined = oblique(scene, FINE, SLOW, across)[0]
            for size in sizes:
                judge(scene, size, SLOW, refined, across)
        for sliding in SLIDING:  # between a ball and a rigid plane
            edge[f"{sliding:g} m/s"] = oblique("plane", 2.0, sliding)[0] / oblique("plane", FINE, sliding)[0] - 1
        failed += [f"plane, {how}: against rows {off:.2%}" for how, off in edge.items() if abs(off) > LIMITS["oblique"]]
    forces = {"rolling": rolling(0.5), "rest": rolling(0.0)}
    failed += [f"{what}: force {off:.2%}" for what, off in forces.items() if off > LIMITS[what]]
    return {"oblique": rows, "rigid_plane_against_rows": edge, **forces}


DOME = (10e-3, 3e-3, np.radians(30))  # radii of the ball and of the tube of a torus, and where one goes on as the other
ANVIL = 15e-3  # radius of the elastic ball that it hits [m]
SPINS, TURNS = (200.0, 2000.0), (15.0, 25.0, 30.0, 45.0)  # rad/s, and degrees at which it begins to tumble


def dome():
    """Steel body of revolution about z: a ball about the origin, which goes on as a torus; its skin is a patch."""
    ball, tube, seam = DOME
    plane = occ.WorkPlane(occ.Axes((0, 0, 0), -occ.Y, occ.X)).MoveTo(0, -ball).Direction(1, 0)
    edge = plane.Arc(ball, np.degrees(seam)).Arc(tube, 90 - np.degrees(seam)).Line(4e-3).Rotate(90)
    profile = edge.Line((ball - tube) * np.sin(seam) + tube).Close().Face()
    fem = ep.fe_model(profile.Revolve(occ.Axis((0, 0, 0), occ.Z), 360), scenes.STEEL, maxh=1.5e-3)
    return ep.reduce(fem, skin=True, f_cut=30e3)


def anvil():
    """Steel ball that the dome hits; its whole skin is a patch."""
    fem = ep.fe_model(sphere(ANVIL), scenes.STEEL, maxh=2.5e-3)
    return ep.reduce(fem, skin=True, f_cut=30e3)


def tumble(body, other, turn, spin, friction):
    """Change of energy of the dome and what it hits, by its start, and the share of the torus in the impulse.

    `other` is a free ball, or None for a rigid plane.
    """
    ball, tube, seam = DOME
    middle = np.array([-np.sin(seam), 0.0, -np.cos(seam)]) * (ball - tube) * (turn > seam)  # of the sphere that touches
    c, s = np.cos(turn), np.sin(turn)
    axes = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    lowest = axes @ middle - [0, 0, ball if turn <= seam else tube]
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(
        mbs, body, frame="floating", referencePosition=[0, 0, MARGIN - lowest[2]], referenceRotationMatrix=axes,
        initialVelocity=[0, 0, -SPEED], initialAngularVelocity=[0, -spin, 0],
    )  # fmt: skip
    items, partner = [item], ep.RigidPlane()
    if other is not None:
        partner = ep.CreatePartitionBody(mbs, other, frame="floating", referencePosition=[lowest[0], 0, -ANVIL])
        items.append(partner)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        contacts = ep.CreatePartitionContact(mbs, [item, partner], formulation="hertz", friction=friction)
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=60e-6 if spin < 1000 else 24e-6, step=1e-7)
    energy = sum(one.energy(result) for one in items)
    energy += sum(one.energy(result) + one.dissipated_energy(result) for one in contacts)
    impulses = [float(np.trapezoid(contact.force(result), result.t)) for contact in contacts]
    of_torus = [isinstance(contact.mechanics.gaps.faces[0].surface.shape, Torus) for contact in contacts]
    return float(np.ptp(energy) / energy[0]), sum(np.array(impulses)[of_torus]) / sum(impulses)


def over_seams(failed):
    """Change of energy of a body whose point of contact passes from face to face, on a rigid plane and on a ball."""
    body, rows = dome(), []
    for on, other in (("plane", None), ("ball", anvil())):
        for friction, spin, turn in itertools.product((None, FRICTION), SPINS, TURNS):
            energy, torus = tumble(body, other, np.radians(turn), spin, friction)
            rows.append(
                {"on": on, "friction": friction, "spin": spin, "turn": turn, "energy": energy, "of_torus": torus}
            )
            if energy > LIMITS["energy"]:
                failed.append(f"seams on {on}, {spin:g} rad/s at {turn:g} degrees: energy {energy:.1e}")
    return rows


def page_table(result):
    """Table of the site: largest errors over all elements and places, and mean processor times of a run."""
    lines = [
        "| scene | formulation | peak | impulse | duration | time of a run |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for scene, found in result["scenes"].items():
        for formulation in ("hertz", "compliance"):
            rows = [row for row in found["rows"] if row["formulation"] == formulation]
            worst = [max((row[what] for row in rows), key=abs) for what in found["reference"]]
            mean = np.mean([row["time_s"] for row in rows])
            shown = " | ".join(f"{100 * off:+.2f} %" for off in worst)
            lines.append(f'| {scene} | `"{formulation}"` | {shown} | {mean:.2f} s |')
    return "\n".join(lines) + "\n"


def at(scene, sizes, places):
    """Sizes of elements by the radius of contact, and places in the mesh, of the runs of a scene."""
    if scene in ("corner", "bumps"):  # with longer elements than two radii, patches leave the round face, or overlap
        return [(size, "any") for size in sizes if size <= 2.0]
    if scene == "groove":
        return [(size, "any") for size in sizes]
    if scene in ("unlike balls", "cubic"):
        return [(size, "facet") for size in sizes]
    more = RESOLVED if scene == "plane" and len(places) > 1 else ()
    return [(size, place) for size in (*more, *sizes) for place in places]


def run(names, sizes, places, out):
    """Run scenes, print tables, and write the result; what else was stored stays if all sizes and places were run."""
    console, result, failed = Console(width=120), {"scenes": {}, "limits": LIMITS}, []
    whole, stored = len(places) == len(PLACES) and out is None, Path(__file__).with_suffix(".json")
    some = whole and len(names) < len(PARTS) and stored.exists()
    if some:
        result = {**json.loads(stored.read_text()), "limits": LIMITS}
        failed = [said for said in result.pop("beyond_limits") if said.split(",")[0] not in names]
    for scene in [name for name in names if name in SCENES]:
        true, table = reference(scene), Table(title=f"{scene}: {contact_radius(scene) * 1e3:.3f} mm contact radius")
        for column in ("elements", "place", "formulation", "peak", "impulse", "duration", "energy", "s"):
            table.add_column(column)
        rows = []
        for size, place in at(scene, sizes, places):
            for formulation in ("hertz", "compliance"):
                t, force, energy, taken = impact(scene, size, place, formulation)
                off = errors(measures(t, force), true)
                rows.append({"size": size, "place": place, "formulation": formulation, **off, "energy": energy,
                             "time_s": taken})  # fmt: skip
                shown = [f"{100 * off[what]:+.2f} %" for what in true]
                table.add_row(f"{size:.3g} a", place, formulation, *shown, f"{energy:.1e}", f"{taken:.2f}")
                if formulation == "hertz":
                    name = f"{scene}, {size:.3g} a, {place}"
                    failed += [f"{name}: {what} {off[what]:.2%}" for what in true if abs(off[what]) > LIMITS[scene]]
                    failed += [f"{name}: energy {energy:.1e}"] * (energy > LIMITS["energy"])
        console.print(table)
        result["scenes"][scene] = {"reference": true, "rows": rows}
    if "friction" in names:
        result["friction"] = with_friction(sizes, failed, len(places) == 1)
        console.print(result["friction"])
    if "seams" in names:
        result["seams"] = over_seams(failed)
        console.print(result["seams"])
    if whole and not failed:
        write_between(PAGE, "contact/unresolved.py", page_table(result))
    scenes.finish(__file__, result, failed, out)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="*", choices=PARTS, help="others keep what is stored")
    parser.add_argument("--quick", action="store_true", help="planes and balls, middle of a facet")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    sizes, places = ((2.0,), ("facet",)) if options.quick else (SIZES, PLACES)
    run(options.only or ([*SCENES[:2], "friction"] if options.quick else PARTS), sizes, places, options.out)


if __name__ == "__main__":
    main()
