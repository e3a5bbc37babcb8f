"""Bodies that lie within each other: at the start, too deep, or at places without rows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...contact.formulations.choices import Penalty
from ...contact.rigid import RigidGaps
from ...errors import ContactPatchWarning, InputError
from ...exudyn_bodies.other_bodies import surface_motion
from ...exudyn_contacts.plastic_results import dent_motion
from ...fe.facets import area_vectors, facet_corners
from ...support.arrays import Array
from ...support.once import once
from ...surfaces.facing import PENETRATION_TOLERANCE
from ...surfaces.surface import Surface
from ..result import called, when
from .crossing_edges import looked_at, neighbours
from .reviewed_run import Finding, ReviewedBody, ReviewedContact, ReviewedRun, surface_of

ENERGY = 1e-2  # energy that overlap at the start may store, as a share of the bodies' largest energy
_MOVED = 0.1  # share of the stored energy: with less kinetic energy, bodies rest on each other and do not fly apart
ROUND_OFF = 1e-7  # overlap that is round-off, as a share of a facet's size
DEEP = 0.15  # depth to which bodies may be pressed into each other, as a share of the radius of the contact area
_DEEP_OF_SOFT, _SOFT = 0.01, 0.1  # the same for a penalty whose stiffness is below this second share of the default
_SHARP = 0.4  # rad, angle from a facet's normal to the mean one at its node: corners and edges have more
_BENEATH, _BENEATH_SHARP = 0.05, 1e-3  # depth of a node with no closed row around it, as a share of a facet's size
_BENEATH_END = 0.005  # the same at an edge of the body where the patch ends


def overlap(run: ReviewedRun) -> Iterator[Finding]:
    """Bodies that overlap at the start: their energy has no cause. In statics nothing moves.

    A run that goes on where another one ended, and bodies that rest on each other, may begin with a contact.
    """
    for history in run.contacts if run.result.method != "static" else ():
        contact = history.contact
        if history.kept.goes_on or (contact.compliant and not history.force[0]):
            continue
        first = run.result.at(run.result.t[:1])
        depth, size = contact.depth(first), contact.slave_facet_size
        if depth <= ROUND_OFF * size:
            continue
        stored = float(contact.energy(first)[0])
        bodies = [run.body(item) for item, _ in contact.sides]
        largest = max(float(body.energy.max()) for body in bodies)
        if contact.compliant:
            thrown = max(body.kinetic_energy.max() for body in bodies) > _MOVED * stored
            share = stored / max(largest, 1e-300)
            energy = f"the {stored:.3g} J that it stores are {share:.2g} of the bodies' largest energy"
            if not thrown or stored <= ENERGY * largest:
                continue
        elif depth > PENETRATION_TOLERANCE * size:
            energy = "multipliers close it within a step or two"
        else:
            continue
        within = ", within the tolerance of meshes" if depth <= PENETRATION_TOLERANCE * size else ""
        remedy = "Move one by that much (referencePosition, or the initial coordinates)"
        if contact.mechanics.gaps.placement.pressed:
            remedy = "Press them together first, by ep.solve_static(mbs, update_initial=True)"
        yield Finding(
            f"{called(contact)} starts with an overlap of {depth:.3g} m{within}, but {energy}: it throws them apart. "
            f"{remedy}. If the run goes on from a state of another model in which they were pressed together, ignore "
            "this"
        )


def depth(run: ReviewedRun) -> Iterator[Finding]:
    """Depths that are not small beside the contact: the penalty is too soft, or linear elasticity is not valid."""
    for history in run.contacts:
        contact, pressed = history.contact, history.pressed
        deepest = int(pressed.argmax())
        if not contact.compliant or pressed[deepest] <= 0:
            continue
        radius = history.radius_at(deepest)
        if not pressed[deepest] > _DEEP_OF_SOFT * radius > 0:
            continue
        formulation, said = getattr(contact.formulation, "half", contact.formulation), ""
        if isinstance(formulation, Penalty) and formulation.stiffness is not None:
            usual, given = formulation.usual_stiffness(contact.mechanics.gaps), formulation.stiffness
            if given < _SOFT * usual:
                said = f"the penalty stiffness of {given:.4g} N/m3 is too soft, the default is {usual:.3g}"
        if said or pressed[deepest] > DEEP * radius:
            now = run.result.at(run.result.t[deepest : deepest + 1])
            largest = contact.depth(now)
            said = said or "linear elasticity has no answer for that: check speeds, forces, units and the material"
            yield Finding(
                f"{called(contact)}: the bodies penetrate each other by {largest:.3g} m at t = {now.t[0]:.6g} s, "
                f"{largest / radius:.2g} of the radius of the contact area, {radius:.3g} m; {said}"
            )


def sinking(run: ReviewedRun) -> Iterator[Finding]:
    """Corners and edges that sink into a rigid surface before a mean gap around them closes."""
    for history in run.contacts:
        gaps = history.contact.mechanics.gaps
        if isinstance(gaps, RigidGaps) and not gaps.all_points.nodal:
            yield from _sunk(run, history, gaps)


def _sunk(run: ReviewedRun, history: ReviewedContact, gaps: RigidGaps) -> Iterator[Finding]:
    """Finding on nodes of a patch that have sunk into a rigid surface between rows."""
    contact, result, (item, number) = history.contact, run.result, history.contact.sides[0]
    surface = surface_of(item.body, number)
    allowed, body = _allowed_depth(surface), run.body(item)
    deepest = _largest_depths(history, gaps, body)
    if (deepest <= allowed).all():
        return
    try:
        dents = dent_motion(contact, result)
    except InputError:
        return
    side, chosen = gaps.whole, looked_at(run, history)
    if not len(chosen):
        return
    t = result.t[chosen]
    motion = surface_motion(contact.carrier, result.others, t)
    if motion is None:
        return
    near = np.flatnonzero(deepest > 0.0)
    (carried, axes), q = motion, body.q[chosen]
    places = side.kinematics.place(q)
    for i, sample in enumerate(chosen) if contact.plastic else ():
        if (dent := dents(int(sample))) is not None:
            places[i] += dent[0] @ side.kinematics.frame(q[i])[1].T
    on_surface = places if contact.carrier is None else (places - carried[:, None]) @ axes
    depth = np.full(places.shape[:2], -np.inf)
    depth[:, near] = -gaps.surface.project(on_surface[:, near].reshape(-1, 3))[0].reshape(len(q), len(near))
    if (depth <= allowed).all():
        return
    closed = history.rows.matrix(chosen).toarray() != 0
    # Beside a contact the coordinates alone also place the surface too deep. The contact's flexibility lifts it.
    lifted = np.where(closed, depth, 0.0).max(axis=1, initial=0.0)
    sunk = (depth - lifted[:, None] > allowed) & ~closed
    if sunk.any():
        sunk &= (neighbours(surface) @ closed.T == 0).T
    if not sunk.any():
        return
    i = int(sunk.any(axis=1).argmax())
    worst = int(np.where(sunk[i], depth[i], -np.inf).argmax())
    patch = item.body.partition.patches[number]
    yield Finding(
        f"{called(contact)} at {when(result, t[i])}: {depth[i, worst]:.3g} m of {called(item)} are below "
        f"the rigid surface at {places[i, worst]} m, with no closed row around: a corner, an edge or a tip of patch "
        f"{repr(patch.name) if patch.name else number} that is smaller than its facets. Integrated rows are means "
        "around nodes, which close there too late, so that it sinks in without a force. Sharp edges of patches of "
        "Partition.surface have rows of their own, but not those at which a curved face ends, and none with a "
        "penalty: choose the faces on both sides. Or take rows='node-to-segment', finer facets there, or a rounded "
        "edge",
        ContactPatchWarning,
    )


def _largest_depths(history: ReviewedContact, gaps: RigidGaps, body: ReviewedBody) -> Array:
    """Depths in a rigid surface that nodes cannot have exceeded, (np,) [m]: those at the start, and the body's way.

    They are not known if the surface moves, or if dents move the nodes.
    """
    if history.contact.carrier is not None or history.contact.plastic:
        return np.full(len(gaps.whole.surface.points), np.inf)
    return np.asarray(body.way - gaps.surface.project(gaps.whole.kinematics.place(body.q[0]))[0])


@once
def _allowed_depth(surface: Surface) -> Array:
    """Depth up to which each node may sink before a mean around it closes, (np,) [m]; less at corners and edges."""
    points, facets = surface.points, surface.facets
    corners = points[facet_corners(facets)]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    normals = area_vectors(points, facets)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    mean, size, cosine = np.zeros(points.shape), np.full(len(points), np.inf), np.ones(len(points))
    for nodes in facets.T:
        np.add.at(mean, nodes, normals)
        np.minimum.at(size, nodes, longest)
    mean /= np.maximum(np.linalg.norm(mean, axis=1), 1e-300)[:, None]
    for nodes in facets.T:
        np.minimum.at(cosine, nodes, np.einsum("fd,fd->f", normals, mean[nodes]))
    share = np.where(cosine < np.cos(_SHARP), _BENEATH_SHARP, _BENEATH)
    ends = facet_corners(facets)[surface.neighbours[0] < 0]  # the first corner of each edge without a neighbour
    ends = np.setdiff1d(ends, surface.rim)  # beyond the others the body ends with an edge
    share[ends] = np.minimum(share[ends], _BENEATH_END)
    return np.asarray(size * share)
