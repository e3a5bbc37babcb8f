"""Warnings about bodies that lie within each other: at the start, too deep, or at places without rows."""

from __future__ import annotations

import warnings

import numpy as np

from ..contact.formulations.choices import Penalty
from ..contact.rigid import RigidGaps
from ..errors import ContactPatchWarning, InputError, ModelLimitWarning
from ..exudyn_bodies.other_bodies import surface_motion
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.partition_contact import PartitionContact
from ..exudyn_contacts.plastic_results import dent_motion
from ..fe.facets import area_vectors, facet_corners
from ..support.arrays import Array
from ..surfaces.rows import PENETRATION_TOLERANCE
from ..surfaces.surface import Surface
from .crossing_edges import looked_at, neighbours, warn_of_edges
from .result import Result, called, when

_ENERGY = 1e-2  # energy that overlap at the start may store, as a share of the bodies' largest energy
_MOVED = 0.1  # share of the stored energy: with less kinetic energy, bodies rest on each other and do not fly apart
_ROUND_OFF = 1e-7  # overlap that is round-off, as a share of a facet's size
_DEEP = 0.15  # depth to which bodies may be pressed into each other, as a share of the radius of the contact area
_DEEP_OF_SOFT, _SOFT = 0.01, 0.1  # the same for a penalty whose stiffness is below this second share of the default
_SHARP = 0.4  # rad, angle from a facet's normal to the mean one at its node: corners and edges have more
_BENEATH, _BENEATH_SHARP = 0.05, 1e-3  # depth of a node with no closed row around it, as a share of a facet's size
_BENEATH_END = 0.005  # the same at an edge of the body where the patch ends


def warn_of_penetration(contact: PartitionContact, result: Result) -> None:
    """Warn of bodies that lie within each other, which is not possible for real bodies."""
    _warn_of_overlap(contact, result)
    _warn_of_depth(contact, result)
    _warn_of_sinking(contact, result)
    warn_of_edges(contact, result)


def _warn_of_overlap(contact: PartitionContact, result: Result) -> None:
    """Warn of bodies that overlap at the start: their energy has no cause. In statics nothing moves.

    A run that goes on where another one ended, and bodies that rest on each other, may begin with a contact.
    """
    if result.method == "static" or result.kept(contact).goes_on:
        return
    first = result.at(result.t[:1])
    depth, size = contact.depth(first), contact.slave_facet_size
    if depth <= _ROUND_OFF * size or (contact.compliant and not contact.force(first)[0]):
        return
    stored = float(contact.energy(first)[0])
    largest = max(float(item.energy(result).max()) for item, _ in contact.sides)
    if contact.compliant:
        thrown = max(_kinetic_energy(item, result).max() for item, _ in contact.sides) > _MOVED * stored
        energy = (
            f"the {stored:.3g} J that it stores are {stored / max(largest, 1e-300):.2g} of the bodies' largest energy"
        )
        if not thrown or stored <= _ENERGY * largest:
            return
    elif depth > PENETRATION_TOLERANCE * size:
        energy = "multipliers close it within a step or two"
    else:
        return
    within = ", within the tolerance of meshes" if depth <= PENETRATION_TOLERANCE * size else ""
    remedy = "Move one by that much (referencePosition, or the initial coordinates)"
    if contact.mechanics.gaps.pressed:
        remedy = "Press them together first, by ep.solve_static(mbs, update_initial=True)"
    warnings.warn(
        f"{called(contact)} starts with an overlap of {depth:.3g} m{within}, but {energy}: it throws them apart. "
        f"{remedy}. If the run goes on from a state of another model in which they were pressed together, ignore this",
        ModelLimitWarning,
        stacklevel=6,
    )


def _kinetic_energy(item: PartitionBody, result: Result) -> Array:
    """Kinetic energy of a body, (n,) [J]."""
    return np.asarray(item.kinematics.kinetic_energy(item.coordinates(result), item.coordinates_t(result)))


def _warn_of_depth(contact: PartitionContact, result: Result) -> None:
    """Warn of a depth not small beside the contact: the penalty is too soft, or linear elasticity is not valid."""
    if not contact.compliant:
        return
    pressed = -result.sensor_of(contact, contact["sForce"])[:, 5]
    deepest = int(pressed.argmax())
    now = result.at(result.t[deepest : deepest + 1])
    radius = float(contact.radius(now)[0])
    if not pressed[deepest] > _DEEP_OF_SOFT * radius > 0:
        return
    formulation, said = getattr(contact.formulation, "half", contact.formulation), ""
    if isinstance(formulation, Penalty) and formulation.stiffness is not None:
        usual = formulation.usual_stiffness(contact.mechanics.gaps)
        if formulation.stiffness < _SOFT * usual:
            said = f"the penalty stiffness of {formulation.stiffness:.4g} N/m3 is too soft, the default is {usual:.3g}"
    if said or pressed[deepest] > _DEEP * radius:
        depth = contact.depth(now)
        said = said or "linear elasticity has no answer for that: check speeds, forces, units and the material"
        warnings.warn(
            f"{called(contact)}: the bodies penetrate each other by {depth:.3g} m at t = {now.t[0]:.6g} s, "
            f"{depth / radius:.2g} of the radius of the contact area, {radius:.3g} m; {said}",
            ModelLimitWarning,
            stacklevel=6,
        )


def _warn_of_sinking(contact: PartitionContact, result: Result) -> None:
    """Warn of a corner or edge that sinks into a rigid surface before a mean gap around it closes."""
    gaps = contact.mechanics.gaps
    if not isinstance(gaps, RigidGaps) or gaps.points.nodal:
        return
    try:
        dents = dent_motion(contact, result)
    except InputError:
        return
    side, chosen = gaps.whole, looked_at(contact, result)
    if not len(chosen):
        return
    now = result.at(result.t[chosen])
    motion = surface_motion(contact.carrier, result.others, now.t)
    if motion is None:
        return
    carried, axes = motion
    (item, number), q = contact.sides[0], contact.slave.coordinates(now)
    places = side.kinematics.place(q)
    for i, sample in enumerate(chosen):
        if (dent := dents(int(sample))) is not None:
            places[i] += dent[0] @ side.kinematics.frame(q[i])[1].T
    on_surface = (places - carried[:, None]) @ axes
    depth = -gaps.surface.project(on_surface.reshape(-1, 3))[0].reshape(places.shape[:2])
    held = contact.row_forces(now).toarray() > 0
    # Beside a contact the coordinates alone also place the surface too deep. The contact's flexibility lifts it.
    lifted = np.where(held, depth, 0.0).max(axis=1, initial=0.0)
    sunk = (depth - lifted[:, None] > _allowed_depth(side.surface)) & ~held
    if sunk.any():
        sunk &= (neighbours(side.surface) @ held.T == 0).T
    if not sunk.any():
        return
    i = int(sunk.any(axis=1).argmax())
    worst = int(np.where(sunk[i], depth[i], -np.inf).argmax())
    patch = item.body.partition.patches[number]
    warnings.warn(
        f"{called(contact)} at {when(result, now.t[i])}: {depth[i, worst]:.3g} m of {called(item)} are below "
        f"the rigid surface at {places[i, worst]} m, with no closed row around: a corner, an edge or a tip of patch "
        f"{repr(patch.name) if patch.name else number} that is smaller than its facets. Integrated rows are means "
        "around nodes, which close there too late, so that it sinks in without a force. Sharp edges of patches of "
        "Partition.surface have rows of their own, but not those at which a curved face ends, and none with a "
        "penalty: choose the faces on both sides. Or take rows='node-to-segment', finer facets there, or a rounded "
        "edge",
        ContactPatchWarning,
        stacklevel=6,
    )


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
