"""Patches that a contact leaves or never meets, and forces aside from the line of contact."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from scipy.spatial import KDTree

from ...errors import ContactPatchWarning, UnitsWarning
from ...exudyn_bodies.partition_body import PartitionBody
from ...support.arrays import Array
from ..result import called, when
from .reviewed_run import Finding, ReviewedContact, ReviewedRun, size_of, surface_of

ASIDE = np.radians(30)  # angle from a patch's line of contact, or from the normals of its nodes
_SHARE_ASIDE = 0.1  # of the force that may be beyond this angle from the normals
_FAR, _NEARER = 20.0, 0.01  # distance over the bodies' size that may be a wrong unit; share of it travelled
_SUNK = 0.1  # of the way in which a row closes after its surfaces have met
_LISTED = 5  # largest number of contacts that a finding lists


def patch_edges(run: ReviewedRun) -> Iterator[Finding]:
    """Contact at the edge of the slave's patch or, if it is not there, of the master's."""
    for history in run.contacts:
        contact, result = history.contact, run.result
        if (reached := history.kept.edge) is None:
            continue
        time, place = reached
        item, number = contact.sides[0]
        patch, now = item.body.partition.patches[number], result.at([min(time, result.t[-1])])  # a cut one ends before
        distance = item.kinematics.at(patch.nodes).place(item.coordinates(now))[0] - place
        nearest = patch.nodes[int(np.linalg.norm(distance, axis=1).argmin())]
        if len(contact.sides) > 1 and nearest not in patch.rim:
            item, number = contact.sides[1]
            patch = item.body.partition.patches[number]
        partitions = "both partitions" if len(contact.sides) > 1 else "the partition"
        remedy = "Give it more faces" if patch.wanders else f"Enlarge the contact radius of {partitions}"
        yield Finding(
            f"{called(contact)} reached the edge of its patch {repr(patch.name) if patch.name else number} of "
            f"{called(item)} at {when(result, time)}, {place} m; the force is too small from then on. {remedy}",
            ContactPatchWarning,
        )


def directions(run: ReviewedRun) -> Iterator[Finding]:
    """Forces aside from the line of contact: a patch with one axis yields along this line only."""
    for history in run.contacts:
        contact, top = history.contact, int(history.force.argmax())
        force = history.force_on_slave[top]
        if history.force[top] <= 0.0 or not contact.mechanics.law.residual:  # it only pulls, or nothing yields so
            continue
        wanders = [item.body.partition.patches[number].wanders for item, number in contact.sides]
        along_normals = [yields_along_normals(*side) for side in contact.sides]
        if (some := np.flatnonzero(np.logical_and(wanders, along_normals))).size:
            yield from _off_normals(run, history, some, top)
        for (item, number), name, sign in zip(contact.sides, contact.side_names, (-1, 1), strict=False):
            patch = item.body.partition.patches[number]
            aside = off_line(item, number, run.body(item).q[top], sign * force)
            if aside > ASIDE:
                yield Finding(
                    f"{called(contact)} at {when(run.result, run.result.t[top])}: the force on {name} is "
                    f"{np.degrees(aside):.0f} degrees off the line of contact of its patch, {patch.direction} in the "
                    "body's axes. The patch yields along that line only, so that the contact is too soft and the force "
                    'too small. Give the partition axes="xyz", or the direction of this force, or take '
                    "Partition.surface"
                )


def yields_along_normals(item: PartitionBody, number: int) -> bool:
    """Whether the patch of this number yields along its normals only."""
    return item.body.basis.flexibility is not None and item.body.partition.patches[number].axes == "normal"


def off_line(item: PartitionBody, number: int, q: Array, force: Array) -> float:
    """Angle of a force on a body, (3,), from the one line along which its patch yields at coordinates q, (n,) [rad].

    Zero without a resultant, and for a patch that yields along several lines.
    """
    patch = item.body.partition.patches[number]
    if not yields_along_normals(item, number) or patch.wanders:
        return 0.0
    along = float(force @ (item.kinematics.frame(q)[1] @ patch.direction))
    return math.atan2(math.sqrt(max(float(force @ force) - along**2, 0.0)), along)


def _off_normals(run: ReviewedRun, history: ReviewedContact, sides: Array, top: int) -> Iterator[Finding]:
    """Forces on sides aside from the normals of their nodes, at the sample `top`; at sharp edges these are means."""
    contact, result = history.contact, run.result
    now = result.at(result.t[[top]])
    on_nodes = contact.nodal_forces(now)
    for side in sides:
        (item, number), forces = contact.sides[side], on_nodes[side][0]
        axes = item.kinematics.frame(item.coordinates(now)[0])[1]
        normals = item.body.partition.patches[number].node_normals @ axes.T
        sizes = np.linalg.norm(forces, axis=1)
        # An even pressure pulls at corners of some quadratic facets.
        aside = sizes[abs(np.einsum("kd,kd->k", forces, normals)) < np.cos(ASIDE) * sizes].sum() / sizes.sum()
        if aside > _SHARE_ASIDE:
            edges = surface_of(item.body, number)
            chosen = 'Leave axes= out of Partition.surface, which takes "xyz" for a patch with sharp edges'
            if not np.setdiff1d(edges.sharp, edges.ends).size:
                chosen = 'Give its partition axes="xyz"'
            yield Finding(
                f"{called(contact)} at {when(result, result.t[top])}: {aside:.0%} of the force on "
                f"{contact.side_names[side]} is more than 30 degrees off the normals of its nodes, as at edges between "
                "faces. The patch yields along these normals only, so that forces and pressures there are wrong. "
                f"{chosen}"
            )


def missed(run: ReviewedRun) -> Iterator[Finding]:
    """Contacts that never closed, with bodies far away or turned away, or with surfaces that touch all the same."""
    for history in run.contacts:
        contact, gaps = history.contact, history.contact.mechanics.gaps
        if history.force.any():
            continue
        far = None if gaps.carried else _far(run, history)
        if far is not None:
            yield far
        elif (sunk := _sunk(run, history)) is not None:
            yield sunk
        elif not gaps.placement.faced:  # bodies that turn may do so later
            patch = gaps.slave.surface
            yield Finding(
                f"{called(contact)} never closed, and at the start the slave's patch, at {patch.points.mean(axis=0)} m "
                f"with outward normal {patch.direction}, did not face what it is to meet. Check referencePosition, "
                "referenceRotation and the partitions, or run longer",
                ContactPatchWarning,
            )


def _sunk(run: ReviewedRun, history: ReviewedContact) -> Finding | None:
    """Surfaces that lie within each other where their rows come nearest, although none closes; None if they do not.

    Rows are means around nodes: those of a narrow tip close when it has sunk by a part of its facets' depth. Beside
    rows of edges, faces have rows of their own.
    """
    contact, nearest = history.contact, int(history.pressed.argmax())
    if contact.rows == "edges" or history.pressed[nearest] < -contact.slave_facet_size:
        return None
    t = run.result.t[nearest]
    depth, still_open = contact.depth(run.result.at([t])), -float(history.pressed[nearest])
    if still_open <= 0.0 or depth <= _SUNK * (depth + still_open):  # the run ended where rows begin to close, or open
        return None
    return Finding(
        f"{called(contact)} never closed, though its surfaces lie {depth:.3g} m within each other at "
        f"{when(run.result, t)}: its rows, at nodes or means around these, are still open by "
        f"{still_open:.3g} m there, so that it has no force. Take smaller facets at this tip, from "
        f"{contact.slave_facet_size:.3g} m, or formulation='hertz', which needs none"
    )


def _far(run: ReviewedRun, history: ReviewedContact) -> Finding | None:
    """Surface that is far away, compared with the size of the bodies, and stays there; None if there is none."""
    contact = history.contact
    places = [
        item.kinematics.at(item.body.partition.patches[number].nodes).place(run.body(item).q[[0, -1]])
        for item, number in contact.sides
    ]
    size = max(size_of(item.body) for item, _ in contact.sides)
    if isinstance(contact.master, PartitionBody):
        away = [float(KDTree(theirs).query(nodes)[0].min()) for nodes, theirs in zip(*places, strict=True)]
    else:
        away = [float(contact.master.project(nodes)[0].min()) for nodes in places[0]]
    if away[-1] < _FAR * size or away[-1] < (1 - _NEARER) * away[0]:
        return None
    return Finding(
        f"{called(contact)} never closed: its slave's patch was {away[0]:.4g} m away from what it is to meet, "
        f"{away[0] / size:.3g} times the size of the bodies, and came {max(away[0] - away[-1], 0.0):.3g} m nearer. Is "
        "a place or a radius in millimetres? Give it in metres, as the bodies are, or leave this contact out",
        UnitsWarning,
    )


def open_statics(run: ReviewedRun) -> Iterator[Finding]:
    """Equilibrium without contact: mostly a spring or load has the wrong sign."""
    result, contacts = run.result, run.contacts
    if result.method == "static" and result.status == "finished" and contacts:
        if not any(history.force.any() for history in contacts):
            gaps = ", ".join(
                f"{called(history.contact)} by {history.contact.gap(result)[-1]:.3g} m"
                for history in contacts[:_LISTED]
            )
            yield Finding(
                f"no contact closed in any load step; open are {gaps}. If they should press, check signs of loads "
                "and of springs' offsets, and where bodies are placed",
                ContactPatchWarning,
            )
