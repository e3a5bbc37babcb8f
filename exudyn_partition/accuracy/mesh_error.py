"""Estimate of the error that the meshes of two bodies make in their impact, by functions of one order more.

The functions s that the next order adds on the same elements (hierarchical surplus) have the residuals

    r_i = (w_i^2 M - K)_s phi_i of the kept shapes,    R = g_s - M_s2 P g - K_s2 u of the rows g of the contact,

where u is the static answer that the kept shapes do not contain, and P g the part of the load that they do. With
r = [r_1 ... R], x = K_ss^-1 r, y = (K - w^2 M)_2s x, and the flexibility F_r of all that the kept shapes leave out,

    E = x' r + y' F_r y

are the changes, of opposite sign for the stiffness diag(w^2) of the shapes, of their gaps at the rows, and of the
flexibility F there: the first two terms of a series for the inverse of a Schur complement. K_ss is well conditioned, so
a few steps of conjugate gradients solve with it.

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
from ..meshing.surplus import Surplus
from ..prediction.modal_impact import Impact
from ..reduction.body import ReducedBody
from ..reduction.loads import patch_slice
from ..support.arrays import Array
from ..support.checks import validate_positive, validate_type
from ..surfaces.points import ContactPoints
from ..surfaces.rows import pair_surfaces
from ..surfaces.surface import Surface

_STEPS, _SOLVED = 40, 1e-3  # of conjugate gradients; relative residual
_LEAST = 0.25  # least square of a frequency that is left, by the lowest one: coarser meshes have no useful estimate
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
    It costs a factorisation of each body, and solutions for its rows and shapes: `validation/mesh/effectivity.py`.
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
        corrections = [_correction(side) for side in sides]
        f_cut = min(body.f_cut for _, body in (slave, master))
        both, _ = _corrected(impact, corrections, (True, True))
        step = min(impact.step(f_cut), both.step(f_cut)) / _FINER
        _, force, velocity = impact.run(duration, step)
        errors = []
        for kept in ((True, True), (True, False), (False, True)):
            better_impact, turn = _corrected(impact, corrections, kept)
            _, better, better_velocity = better_impact.run(duration, step)
            better_velocity = better_velocity @ turn.T
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


@dataclass(frozen=True, eq=False)
class _Correction:
    """What the surplus changes of one body.

    Parameters
    ----------
    turn : (ns, ns) array
        New shapes by the old ones, orthogonal.
    squares : (ns,) array
        Squares of the new shapes' frequencies [rad2/s2].
    gaps : (nr, ns) array
        What the old shapes have in addition at the rows.
    flexibility : (nr, nr) array
        Added to that of the rows [m/N].
    """

    turn: Array
    squares: Array
    gaps: Array
    flexibility: Array


def _correction(side: _Side) -> _Correction:
    """What the surplus changes of a body; see the module."""
    fem, basis = side.fem, side.body.basis
    surplus = surplus_of(fem)
    elastic = np.flatnonzero(basis.omega > 0)
    rigid, shapes, squares = basis.shapes[:, basis.omega == 0], basis.shapes[:, elastic], basis.omega[elastic] ** 2
    loads, on_surplus = _loads(side, surplus)
    flexibility = FreeBodyFlexibility(fem.stiffness, fem.mass, rigid)

    def residual(loads: Array) -> Array:
        """Static answers without those of the kept shapes."""
        answer: Array = flexibility(loads) - shapes @ ((shapes.T @ loads) / squares[:, None])
        return answer

    kept = np.hstack([rigid, shapes])
    of_rows = on_surplus - surplus.mass_coupling @ (kept @ (kept.T @ loads)) - surplus.coupling @ residual(loads)
    of_shapes = (surplus.mass_coupling @ shapes) * squares - surplus.coupling @ shapes
    residuals = np.hstack([of_shapes, of_rows])
    answers = _solve(surplus.stiffness, residuals)
    m = len(squares)
    back = surplus.coupling.T @ answers
    back[:, :m] -= (surplus.mass_coupling.T @ answers[:, :m]) * squares
    E = answers.T @ residuals + back.T @ residual(back)
    E = (E + E.T) / 2
    values, vectors = np.linalg.eigh(np.diag(squares) - E[:m, :m])
    turn, gaps = np.eye(len(basis.omega)), np.zeros((loads.shape[1], len(basis.omega)))
    turn[np.ix_(elastic, elastic)], gaps[:, elastic] = vectors, E[m:, :m]
    new = basis.omega**2
    new[elastic] = np.maximum(values, _LEAST * squares.min(initial=0.0))
    return _Correction(turn, new, gaps, E[m:, m:])


def _loads(side: _Side, surplus: Surplus) -> tuple[Array, Array]:
    """Forces of the rows on the nodes, (3n, nr), and on the functions of the surplus, (3 s, nr)."""
    n, dofs = len(side.patch.nodes), node_dofs(side.patch.nodes)
    on_body = sp.csr_matrix((np.ones(3 * n), (np.arange(3 * n), dofs)), shape=(3 * n, side.fem.n_dofs))
    at_points = surplus.at(side.corners, side.local)
    by_axis = sp.hstack([sp.diags(side.normals[:, axis]) @ at_points for axis in range(3)], format="csr")
    interleaved = np.arange(3 * surplus.size).reshape(3, surplus.size).T.ravel()
    on_surplus = side.mean @ by_axis[:, interleaved]
    return (side.on_patch @ on_body).T.toarray(), on_surplus.T.toarray()


def _corrected(impact: Impact, corrections: Sequence[_Correction], kept: Sequence[bool]) -> tuple[Impact, Array]:
    """The impact with the corrections of one or both bodies, and its coordinates by the old ones."""
    n = len(impact.omega)
    turn, squares, H, F = np.eye(n), impact.omega**2, impact.H.copy(), impact.F.copy()
    start = 0
    for by, use in zip(corrections, kept, strict=True):
        own = slice(start, start + len(by.squares))
        start = own.stop
        if use:
            turn[own, own], squares[own] = by.turn, by.squares
            H[:, own] = (H[:, own] + by.gaps) @ by.turn
            F += by.flexibility
    velocity = turn.T @ impact.velocity
    return replace(impact, omega=np.sqrt(squares), H=H, F=F, velocity=velocity), turn


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
