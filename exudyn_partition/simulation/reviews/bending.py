"""Bodies that would yield away from their contacts, as links that bend: by the strain of their surfaces.

The kept shapes are right there, and the surface bears no load. So its strain tells the whole stress, and bending and
torsion are largest on it. Beneath contacts, the Hertz-equivalent pressure decides instead.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial import KDTree

from ...errors import YieldWarning
from ...exudyn_bodies.user_functions import RIGID
from ...fe.facets import by_shape, flat_triangles
from ...fe.material import Material
from ...fe.shapes import QUADS, shape_functions
from ...reduction.body import ReducedBody
from ...support.arrays import Array
from ...support.once import once
from ..result import called, when
from .reviewed_run import Finding, ReviewedRun, evenly

_FACETS, _SAMPLES = 4000, 32  # largest number of facets, and of samples, that are looked at
_BOUNDED = 4 * _SAMPLES  # coordinates up to which a bound costs little more than the stress in these samples
_AROUND = 1.0  # width around a patch where its contact decides, by the patch's size
_MASS = 0.05  # share by which mass may differ from volume times density: bodies of several materials differ by more
_FLAT = 1e-3  # height of a facet by its first edge below which its strain is round-off


def bending(run: ReviewedRun) -> Iterator[Finding]:
    """Bodies whose surface would yield away from contacts and interfaces."""
    for history in run.bodies:
        item, body, material = history.item, history.item.body, history.item.body.material
        if material is None or material.yield_stress is None or body.n_dofs == RIGID:
            continue
        facets = free_facets(body)
        if not len(facets):
            continue
        bound = stress_bounds(body, history.deformed)
        if bound.max() <= material.yield_stress:
            continue
        energy = history.strain_energy
        some = np.union1d(np.argsort(energy)[-_SAMPLES:], evenly(len(energy), _SAMPLES))
        some = some[bound[some] > material.yield_stress]
        if not len(some):
            continue
        stress, places = surface_stress(body, facets, history.deformed[some], material)
        if stress.max() <= material.yield_stress:
            continue
        top, place = np.unravel_index(stress.argmax(), stress.shape)
        yield Finding(
            f"{called(item)} at {when(run.result, run.result.t[some[top]])}: the von Mises stress of its surface "
            f"reaches {stress.max():.4g} Pa at {places[place]} m of its mesh, away from its contacts, "
            f"{stress.max() / material.yield_stress:.3g} times the yield stress of {material.yield_stress:.4g} Pa. "
            "Bodies yield in plastic zones beneath their patches alone, so that this one springs back. Lower the load, "
            "or take a stronger shape or material",
            YieldWarning,
        )


def stress_bounds(body: ReducedBody, deformed: Array) -> Array:
    """Bounds of the von Mises stress of the free facets, (m,) [Pa], at coordinates of the deformation, (m, n_dofs).

    Infinite for a body of many coordinates, as one with all its nodes: their bound would need a matrix of gigabytes.
    """
    if body.n_dofs > _BOUNDED:
        return np.full(len(deformed), np.inf)
    return np.asarray(abs(deformed) @ largest_stresses(body))


@once
def largest_stresses(body: ReducedBody) -> Array:
    """Largest von Mises stress of the free facets by a unit of each coordinate, (n_dofs,) [Pa].

    The von Mises stress is a norm. So that of several coordinates is at most the sum of theirs.
    """
    material = body.material
    assert material is not None
    return np.asarray(surface_stress(body, free_facets(body), np.eye(body.n_dofs), material)[0].max(axis=1))


def surface_stress(body: ReducedBody, facets: Array, deformed: Array, material: Material) -> tuple[Array, Array]:
    """Von Mises stress of a free surface, (m, k) [Pa], in the middles of facets, and these, (k, 3) [m].

    Parameters
    ----------
    body : ReducedBody
    facets : (k, n) int array
        Facets of the body.
    deformed : (m, n_dofs) array
        Coordinates of the deformation.
    material : Material
    """
    von_mises, middles = np.empty((len(deformed), len(facets))), np.empty((len(facets), 3))
    modulus = material.E / (1 - material.nu**2)
    for rows, columns in by_shape(facets):
        corners = facets[rows][:, columns]
        middle = np.full((1, 2), 1 / 2 if len(columns) in QUADS else 1 / 3)
        value, by_r, by_s = shape_functions(middle, len(columns))[0]
        nodes, at = np.unique(corners, return_inverse=True)
        moved = np.asarray(body.rows(nodes) @ deformed.T).T.reshape(len(deformed), len(nodes), 3)
        moved, points = moved[:, at.reshape(corners.shape)], body.points[corners]
        along, aside = by_r @ points, by_s @ points  # tangents
        length = np.linalg.norm(along, axis=1)
        x, normal = along / length[:, None], np.cross(along, aside)
        y = np.cross(normal / np.linalg.norm(normal, axis=1)[:, None], x)
        by_x = (by_r @ moved) / length[:, None]
        by_y = (by_s @ moved - np.sum(aside * x, axis=1)[:, None] * by_x) / np.sum(aside * y, axis=1)[:, None]
        xx, yy, xy = np.sum(by_x * x, axis=2), np.sum(by_y * y, axis=2), np.sum(by_x * y + by_y * x, axis=2)
        sx, sy = modulus * (xx + material.nu * yy), modulus * (yy + material.nu * xx)
        von_mises[:, rows] = np.sqrt(sx**2 + sy**2 - sx * sy + 3 * (material.shear_modulus * xy) ** 2)
        middles[rows] = value @ points
    return von_mises, middles


@once
def free_facets(body: ReducedBody) -> Array:
    """Some facets, (k, n) int, whose strain tells the stress; none if the body has more than one material."""
    material = body.material
    assert material is not None
    if any(patch.material for patch in body.partition.patches) or not _of_one_material(body, material):
        return body.facets[:0]
    facets = body.facets[far_from_loads(body)]
    return facets[:: len(facets) // _FACETS + 1]


def _of_one_material(body: ReducedBody, material: Material) -> bool:
    """Whether the body's mass is that of its volume in this material."""
    a, b, c = np.moveaxis(body.points[flat_triangles(body.facets)[0]] - body.centre_of_mass, 1, 0)
    volume = abs(np.einsum("kd,kd->", a, np.cross(b, c))) / 6
    return bool(abs(material.rho * volume / body.total_mass - 1) < _MASS)


def far_from_loads(body: ReducedBody) -> Array:
    """Which facets lie away from patches, plastic zones and interfaces, (nf,) bool: their strain is not local."""
    points, near = body.points, np.zeros(len(body.points), dtype=bool)
    for patch in body.partition.patches:
        size = np.ptp(points[patch.nodes], axis=0).max()
        near |= KDTree(points[patch.nodes]).query(points)[0] < _AROUND * size
        if patch.plastic is not None:
            near[patch.plastic.nodes] = True
    for interface in body.partition.interfaces:
        near[interface.nodes] = True
    a, b, c = np.moveaxis(points[body.facets[:, :3]], 1, 0)
    flat = np.linalg.norm(np.cross(b - a, c - a), axis=1) < _FLAT * np.linalg.norm(b - a, axis=1) ** 2
    return np.asarray(~near[body.facets].any(axis=1) & ~flat)
