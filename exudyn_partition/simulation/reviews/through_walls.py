"""Bodies that come out of the back of a thin wall, where nothing holds them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from ...contact.rigid import RigidPlane
from ...errors import ContactPatchWarning
from ...exudyn_bodies.other_bodies import surface_motion
from ...exudyn_bodies.partition_body import PartitionBody
from ...fe.facets import area_vectors, facet_corners
from ...support.arrays import Array
from ...support.once import once
from ...surfaces.facing import EDGE_TOLERANCE
from ...surfaces.surface import Surface, closest_points
from ...surfaces.witnesses import witnesses_of
from ..result import called
from .reviewed_run import Finding, ReviewedContact, ReviewedRun, surface_of

_LOOKS = 0.5  # cosine from which on a face looks the way of a node's normal, and below whose negative it meets the node
_OTHERS = 2.0  # times the way of a step: by more depth than that, the deepest row is another one
_THICK = 10  # facets: half the thickness of the thickest wall that is found
_NEIGHBOURS = 4  # facets among which the other face of a wall is sought
_DEEP = 0.25  # of the thickness of a wall: rows that were less deep have left its patch at the edge


def through_walls(run: ReviewedRun) -> Iterator[Finding]:
    """Bodies that came out of the back of a wall.

    Rows are those of the face through which a body has come; behind the wall there are none. A step that is longer than
    the wall is thick may have none within it either. Here a step is the way from a sample to the next one.
    """
    for history in run.contacts:
        contact = history.contact
        if contact.slave != contact.master and contact.rows != "edges" and not isinstance(contact.master, RigidPlane):
            walls = (1, 0) if isinstance(contact.master, PartitionBody) else (1,)
            yield from itertools.islice(itertools.chain(*(_passed(run, history, wall) for wall in walls)), 1)


def _passed(run: ReviewedRun, history: ReviewedContact, wall: int) -> Iterator[Finding]:
    """Whether a body came out of the back of one of a contact's sides; the second may be a rigid surface."""
    contact, t = history.contact, run.result.t
    surfaces = [surface_of(item.body, number) for item, number in contact.sides]
    rigid = None if isinstance(contact.master, PartitionBody) else contact.master
    thick = thickness(surfaces[wall]) if rigid is None else 0.0  # what sinks through a rigid wall is stopped in the run
    poses = surface_motion(contact.carrier, run.result.others, t)
    if len(t) < 2 or math.isinf(thick) or poses is None:
        return

    def places(side: int, nodes: Array, samples: Array | slice) -> Array:
        """Places of nodes of a side's patch at some samples, (m, k, 3) [m], where a rigid surface is at rest."""
        item, surface = contact.sides[side][0], surfaces[side]
        x = item.kinematics.at(surface.nodes[nodes]).place(run.body(item).q[samples])
        return x if contact.carrier is None else (x - poses[0][samples, None]) @ poses[1][samples]

    three = [places(side, witnesses_of(surface), slice(None)) for side, surface in enumerate(surfaces)]
    ways, comer = _ways(three), 1 - wall
    for k in _suspected(history.pressed, ways, thick, _may_meet(surfaces, three, ways)):
        both = np.array([k, k + 1])
        x = places(comer, np.arange(len(surfaces[comer].points)), both)
        if rigid is not None:
            projections = [rigid.project(each) for each in x]
        else:
            of_wall = places(wall, np.arange(len(surfaces[wall].points)), both)
            projections = [_nearest(surfaces[wall], *each) for each in zip(x, of_wall, strict=True)]
        normals = [_normals(surfaces[comer], each) for each in x]
        (before, meets), (after, looks) = (
            (gap, np.einsum("kd,kd->k", normal, outward))
            for (gap, normal), outward in zip(projections, normals, strict=True)
        )
        closed, still = history.force[both] != 0 if comer else history.rows.matrix(both).toarray() != 0
        jumped = (meets < -_LOOKS) & (before >= 0) & (after >= 0) & (before + after <= ways[k])
        passed = (looks > _LOOKS) & ~still & (closed | jumped)
        if passed.any():
            node, names = int(passed.argmax()), (*contact.side_names, "the rigid surface")
            remedy = (
                f"The step of {t[k + 1] - t[k]:.4g} s, in which it moved by {ways[k]:.3g} m, was too long"
                if jumped[node]
                else "Give the wall's patch the face alone that is met, whose rows hold at any depth; or check speeds, "
                "forces and the material"
            )
            yield Finding(
                f"{called(contact)}: between t = {t[k]:.6g} and {t[k + 1]:.6g} s {names[comer]} came out of the back "
                f"of a thin wall of {names[wall]} at {x[1, node]} m, where nothing holds it. {remedy}",
                ContactPatchWarning,
            )
            return


def _ways(three: Sequence[Array]) -> Array:
    """Bound on the motion of a slave relative to its master in each step, (n - 1,) [m].

    `three`, (n, 3, 3) [m] each, are places of three nodes of the slave's patch that are far from each other, and of the
    master's, unless that is a rigid surface at rest.
    """
    steps = [np.diff(x, axis=0) for x in three]
    mean = steps[1].mean(axis=1, keepdims=True) if len(steps) == 2 else 0.0
    ways: Array = sum(np.linalg.norm(step - mean, axis=2).max(axis=1) for step in steps)
    return ways


def _may_meet(surfaces: Sequence[Surface], three: Sequence[Array], ways: Array) -> Array:
    """Steps in which balls around both patches meet, (n - 1,) bool; all, if the master is a rigid surface."""
    if len(surfaces) == 1:
        return np.ones(len(ways), dtype=bool)
    apart = np.linalg.norm(three[0].mean(axis=1) - three[1].mean(axis=1), axis=1)[:-1]
    radii = 0.0
    for surface in surfaces:
        centre = surface.points[witnesses_of(surface)].mean(axis=0)
        radii += float(np.linalg.norm(surface.points - centre, axis=1).max())
    return np.asarray(apart <= radii + ways)


def _suspected(pressed: Array, ways: Array, thick: float, may_meet: Array) -> Array:
    """Steps in which a slave may have come out of the back of a wall, (k,) int.

    Parameters
    ----------
    pressed : (n,) array
        Depth of the deepest row at each sample [m]; -inf where there are no rows.
    ways : (n - 1,) array
        See `_ways` [m].
    thick : float
        Thickness of the wall [m]; zero if it is not known.
    may_meet : (n - 1,) bool array
    """
    before, after = pressed[:-1], pressed[1:]
    lost = (before > _DEEP * thick) & (after < before - _OTHERS * ways)
    gaps = -(before + after)
    jumped = (before <= 0) & (after <= 0) & ((ways > gaps) | np.isinf(gaps))
    return np.flatnonzero(may_meet & np.where(ways > 0.5 * thick, jumped | lost, lost))


@once
def thickness(surface: Surface) -> float:
    """Least thickness of the walls both of whose faces a patch has [m]; infinite if it has none."""
    middles = surface.points[facet_corners(surface.facets)].mean(axis=1)
    normals = area_vectors(surface.points, surface.facets)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    # Near facets that look away from each other are neighbours in this space, for walls up to twice as thick as `far`.
    far = _THICK * surface.facet_size
    tree = cKDTree(np.hstack([middles, far * normals]))
    _, others = tree.query(np.hstack([middles, -far * normals]), k=min(_NEIGHBOURS, len(middles)))
    others = others.reshape(len(middles), -1)
    behind = np.einsum("fkd,fd->fk", middles[:, None] - middles[others], normals)
    looks_away = np.einsum("fkd,fd->fk", normals[others], normals) < -_LOOKS
    return float(behind[looks_away & (behind > 0)].min(initial=math.inf))


def _nearest(surface: Surface, x: Array, places: Array) -> tuple[Array, Array]:
    """Gaps of points x, (k, 3) [m], to the patch with nodes at `places`, (np, 3) [m], and normals there, (k, 3).

    Normals are zero for points beside the patch.
    """
    closest = closest_points(x, places[surface.facets])
    beside = closest.offset > EDGE_TOLERANCE * surface.facet_size
    return closest.gap, np.where(beside[:, None], 0.0, closest.normal)


def _normals(surface: Surface, places: Array) -> Array:
    """Outward unit normals at a patch's nodes, (np, 3), with the nodes at `places`, (np, 3) [m]."""
    nodes = np.arange(len(places))[:, None]
    return replace(surface, points=places).normals_at(nodes, np.ones(nodes.shape))
