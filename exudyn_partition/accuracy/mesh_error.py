"""Estimate of the error that the meshes of two bodies make in their impact, by functions of one order more.

The functions s that the next order adds on the same elements (hierarchical surplus) lower the frequencies w_i of the
kept shapes phi_i, and add to the flexibility F at the rows of the contact:

    r_i = (w_i^2 M - K)_s phi_i,    x_i = K_ss^-1 r_i,    w_i^2 <- w_i^2 - x_i' r_i - y_i' F_e y_i,    y_i = K_2s x_i
    R = residuals of the static answers,    F <- F + R' K_ss^-1 R + Y' F_e Y,    Y = K_2s K_ss^-1 R

K_ss is well conditioned, so a dozen steps of conjugate gradients solve with it. The terms with F_e, the elastic
flexibility of the nodes, are the first ones of a series for the inverse of the Schur complement. R are residuals of
what the kept shapes do not answer: the others are in r_i.

The impact of the scene runs with and without these corrections. Its difference is the estimate (Bank and Weiser 1985).
It is no bound. Below two elements in a contact radius it is too small.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from ..algebra.factorisation import one_blas_thread
from ..algebra.krylov import FreeBodyFlexibility
from ..errors import InputError
from ..fe.model import FEModel, node_dofs
from ..fe.patches import Patch
from ..fe.shapes import FACET_NODES
from ..meshing.ngsolve_fem import surplus_of
from ..prediction.modal_impact import Impact
from ..reduction.body import ReducedBody
from ..reduction.loads import patch_slice
from ..support.arrays import Array
from ..support.checks import validate_positive, validate_type
from ..surfaces.points import ContactPoints
from ..surfaces.rows import pair_surfaces
from ..surfaces.surface import Surface

_STEPS, _SOLVED = 40, 1e-3  # of conjugate gradients; relative residual
_LEAST = 0.25  # of the square of a frequency is left at least: a mesh so coarse has no estimate worth more
_FINER = 2  # steps of the default one


@dataclass(frozen=True)
class MeshEstimate:
    """Estimated errors that meshes make in an impact, relative L2 over its duration.

    Parameters
    ----------
    force : float
        Error of the contact force.
    velocity : float
        Error of the velocities of the bodies, in the norm of the kinetic energy, relative to their change.
    of_bodies : (float, float)
        Error of the force by the mesh of each body alone.
    speed, duration : float
        Of the impact [m/s], [s].
    """

    force: float
    velocity: float
    of_bodies: tuple[float, float]
    speed: float
    duration: float

    @property
    def error(self) -> float:
        """The larger one of force and velocity."""
        return max(self.force, self.velocity)


@dataclass(frozen=True, eq=False)
class _Side:
    """A body in the impact.

    Parameters
    ----------
    fem : FEModel
    body : ReducedBody
    on_patch : (nr, 3 np) csr matrix
        Rows of the contact on the displacements of the patch's nodes.
    patch : Patch
    residual : (nr, nr) array
        Residual flexibility at the rows [m/N].
    corners, local, normals : (p, 3) int array, (p, 2) array, (p, 3) array
        Facets' corner nodes, places in the facets, and directions of the contact points.
    mean : (nr, p) csr matrix
        Weights of the points in each row.
    """

    fem: FEModel
    body: ReducedBody
    on_patch: sp.csr_matrix
    patch: Patch
    residual: Array
    corners: Array
    local: Array
    normals: Array
    mean: sp.csr_matrix

    @property
    def gaps(self) -> Array:
        """(nr, ns) array: gaps of the rows by the coordinates."""
        return np.asarray(self.on_patch @ self.body.basis.shapes[node_dofs(self.patch.nodes)])


def mesh_error(
    slave: tuple[FEModel, ReducedBody],
    master: tuple[FEModel, ReducedBody],
    *,
    speed: float,
    duration: float | None = None,
    patches: tuple[int | str | None, int | str | None] = (None, None),
) -> MeshEstimate:
    """Estimate the error of the meshes of two reduced bodies in their frictionless impact on each other.

    Parameters
    ----------
    slave, master : (FEModel, ReducedBody)
        Placed where they touch, or apart along their line of contact, as for `reduce_pair`.
    speed : float
        Approach speed along the line of contact [m/s].
    duration : float, optional
        [s]; default: that of the bodies' `estimate`, needed if they have none.
    patches : (int or str, int or str), optional
        Which patches meet, if a body has several.

    Returns
    -------
    MeshEstimate

    Raises
    ------
    InputError
        If an argument is of the wrong kind, or a body has a basis without residual flexibility or was saved without
        its inside.
    MeshError
        If the elements are no tetrahedra.
    EmptyRegionError, PenetrationError, MemoryLimitError, MissingPackageError

    Notes
    -----
    It costs about as much as the reduction of the bodies.
    """
    for name, pair in (("slave", slave), ("master", master)):
        _check(name, pair)
    if not isinstance(patches, tuple | list) or len(patches) != 2:
        raise InputError(f"patches: expected the slave's and the master's, two names or numbers, got {patches!r}")
    speed = validate_positive("speed", speed, "m/s")
    if duration is None:
        known = [body.estimate.duration for _, body in (slave, master) if body.estimate is not None]
        if not known:
            raise InputError("duration: expected one [s], because the bodies were not reduced to a tolerance")
        duration = max(known)
    duration = validate_positive("duration", duration, "s")
    numbers = [body.partition.patch(key) for (_, body), key in zip((slave, master), patches, strict=True)]
    with one_blas_thread():
        sides, impact = _impact((slave, master), numbers, speed)
        corrections = [_corrections(side) for side in sides]
        f_cut = min(body.f_cut for _, body in (slave, master))
        both = _corrected(impact, corrections, (True, True))
        step = min(impact.step(f_cut), both.step(f_cut)) / _FINER
        _, force, velocity = impact.run(duration, step)
        errors = []
        for kept in ((True, True), (True, False), (False, True)):
            _, better, better_velocity = _corrected(impact, corrections, kept).run(duration, step)
            scale = np.linalg.norm(better_velocity - better_velocity[0])
            errors.append(
                (
                    float(np.linalg.norm(force - better) / np.linalg.norm(better)),
                    float(np.linalg.norm(velocity - better_velocity) / scale),
                )
            )
    return MeshEstimate(*errors[0], (errors[1][0], errors[2][0]), speed, duration)


def _check(name: str, pair: object) -> None:
    if not isinstance(pair, tuple | list) or len(pair) != 2:
        raise InputError(f"{name}: expected (FEModel, ReducedBody), got {type(pair).__name__}")
    fem, body = pair
    validate_type(f"{name}[0]", fem, FEModel, "fe_model()")
    validate_type(f"{name}[1]", body, ReducedBody, "reduce()")
    body.partition.check_mesh(fem, name)
    body.check_inside("the error of the mesh")
    if body.basis.flexibility is None or len(body.basis.nodal):
        raise InputError(
            f"{name}: expected a body with basis 'contact-adapted' or 'residual', got {body.basis.name!r}, whose "
            "contact has no residual flexibility"
        )


def _impact(
    pairs: Sequence[tuple[FEModel, ReducedBody]], numbers: Sequence[int], speed: float
) -> tuple[list[_Side], Impact]:
    """Both sides and their impact, at the place where they touch."""
    surfaces = [
        Surface.of(fem.points, body.partition.patches[i], np.zeros(3))
        for (fem, body), i in zip(pairs, numbers, strict=True)
    ]
    contact = pair_surfaces(surfaces[0], surfaces[1], placed_by="the points of its mesh, which are taken as they are")
    sizes = [len(surface.points) for surface in surfaces]
    points: ContactPoints = contact.points
    places = (
        (points.nodes, points.weights @ FACET_NODES[points.nodes.shape[1]], contact.normals),
        (contact.master, contact.local, -contact.normals),
    )
    sides = []
    for (fem, body), i, on_patch, weight, (nodes, local, normals) in zip(
        pairs, numbers, contact.matrices(*sizes), contact.interpolation(*sizes), places, strict=True
    ):
        patch, own = body.partition.patches[i], patch_slice(body.partition, i)
        to_rows = on_patch if patch.axes == "xyz" else weight
        assert body.basis.flexibility is not None
        residual = to_rows @ body.basis.flexibility[own, own] @ to_rows.T
        corners = patch.nodes[nodes[:, :3]]
        sides.append(_Side(fem, body, on_patch, patch, residual, corners, local, normals, points.mean))
    first = pairs[0][1]
    velocity = np.zeros(sum(body.n_dofs for _, body in pairs))
    velocity[: first.n_dofs] = first.rigid @ np.r_[speed * contact.approach, np.zeros(3)]
    impact = Impact(
        gap=contact.gap - contact.gap.min(),
        H=np.hstack([side.gaps for side in sides]),
        F=sides[0].residual + sides[1].residual,
        omega=np.concatenate([body.basis.omega for _, body in pairs]),
        velocity=velocity,
        size=surfaces[0].facet_size,
    )
    return sides, impact


def _corrections(side: _Side) -> tuple[Array, Array]:
    """How much lower the squares of the frequencies are, (ns,), and how much larger the flexibility is, (nr, nr)."""
    fem, basis = side.fem, side.body.basis
    surplus = surplus_of(fem)
    elastic = basis.omega > 0
    rigid, shapes, squares = basis.shapes[:, ~elastic], basis.shapes[:, elastic], basis.omega[elastic] ** 2
    # Loads of the rows on the nodes, and on the functions of the surplus at the contact points.
    n = len(side.patch.nodes)
    on_body = sp.csr_matrix(
        (np.ones(3 * n), (np.arange(3 * n), node_dofs(side.patch.nodes))), shape=(3 * n, fem.n_dofs)
    )
    loads = (side.on_patch @ on_body).T.toarray()
    at_points = surplus.at(side.corners, side.local)
    directed = sp.vstack([sp.diags(side.normals[:, i]) @ at_points for i in range(3)], format="csr")
    order = np.arange(3 * surplus.size).reshape(3, surplus.size).T.ravel()
    by_axis = sp.hstack([directed[i * len(side.local) : (i + 1) * len(side.local)] for i in range(3)], format="csr")
    own_loads = (side.mean @ by_axis[:, order]).T.toarray()
    flexibility = FreeBodyFlexibility(fem.stiffness, fem.mass, rigid)
    kept = np.hstack([rigid, shapes])
    share = kept.T @ loads
    static = flexibility(loads) - shapes @ (share[rigid.shape[1] :] / squares[:, None])
    of_rows = own_loads - surplus.mass_coupling @ (kept @ share) - surplus.coupling @ static
    of_shapes = (surplus.mass_coupling @ shapes) * squares - surplus.coupling @ shapes
    residuals = np.hstack([of_shapes, of_rows])
    answers = _solve(surplus.stiffness, residuals)
    back = surplus.coupling.T @ answers
    more = flexibility(back)
    m = shapes.shape[1]
    lower = np.zeros(len(basis.omega))
    lower[elastic] = np.einsum("ij,ij->j", answers[:, :m], residuals[:, :m])
    lower[elastic] += np.einsum("ij,ij->j", back[:, :m], more[:, :m])
    larger = answers[:, m:].T @ residuals[:, m:] + back[:, m:].T @ more[:, m:]
    return lower, (larger + larger.T) / 2


def _corrected(impact: Impact, corrections: Sequence[tuple[Array, Array]], kept: tuple[bool, bool]) -> Impact:
    """The impact with the corrections of one or both bodies."""
    lower = np.concatenate([by * use for (by, _), use in zip(corrections, kept, strict=True)])
    squares = np.maximum(impact.omega**2 - lower, _LEAST * impact.omega**2)
    F = impact.F + sum(by * use for (_, by), use in zip(corrections, kept, strict=True))
    return replace(impact, omega=np.sqrt(squares), F=F)


def _solve(matrix: sp.csr_matrix, rhs: Array) -> Array:
    """Solve with the diagonal as preconditioner, by conjugate gradients of all columns at once, roughly."""
    inverse = 1 / matrix.diagonal()[:, None]
    x, r = np.zeros_like(rhs), rhs.copy()
    z = inverse * r
    p, rz = z.copy(), np.einsum("ij,ij->j", r, z)
    goal = _SOLVED**2 * rz
    for _ in range(_STEPS):
        q = matrix @ p
        curvature = np.einsum("ij,ij->j", p, q)
        alpha = np.divide(rz, curvature, out=np.zeros_like(rz), where=curvature > 0)
        x += alpha * p
        r -= alpha * q
        z = inverse * r
        last, rz = rz, np.einsum("ij,ij->j", r, z)
        if (rz <= goal).all():
            break
        p = z + np.divide(rz, last, out=np.zeros_like(rz), where=last > 0) * p
    return x
