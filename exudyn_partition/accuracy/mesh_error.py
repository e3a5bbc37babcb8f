"""Estimate of the error that the meshes of bodies make in their impact, by functions of one order more.

The functions s that the next order adds on the same elements (hierarchical surplus) have the residuals

    r_i = (w_i^2 M - K)_s phi_i of the kept shapes,    R = g_s - M_s2 P g - K_s2 u of the rows g of the contact,

where u is the static answer that the kept shapes do not contain, and P g the part of the load that they do. With
r = [r_1 ... R], x = K_ss^-1 r, y = (K - w^2 M)_2s x, and the flexibility F_r of all that the kept shapes leave out,

    E = x' r + y' F_r y

are the changes, of opposite sign for the stiffness diag(w^2) of the shapes, of their gaps at the rows, and of the
flexibility F there: the first two terms of a series for the inverse of a Schur complement. K_ss is well conditioned, so
a few steps of conjugate gradients solve with it.

The impact of the scene runs with and without these corrections. Its difference is the estimate (Bank and Weiser 1985).

Rows have an error of their own. The pressure ends like a square root at the edge of the contact, where rows of spacing
s miss it by s^(1/2). The strain energy of that error is p^2 s^3 in each of 2 pi a / s places, so that it is of order
s^3. So a run with the rows of a coarser grid of the same facets, of k times the spacing, differs by k^3 - 1 times the
error. Rows and functions of one order more are taken as independent.

It is no bound. Below two elements in a contact radius it is too small.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from ..algebra.factorisation import one_blas_thread
from ..algebra.krylov import FreeBodyFlexibility
from ..contact.rigid import RigidCylinder, RigidPlane, RigidSphere, RigidSurface
from ..errors import InputError
from ..fe.model import FEModel, node_dofs
from ..fe.partition import check_one_line
from ..meshing.ngsolve_fem import surplus_of
from ..meshing.surplus import Surplus
from ..plasticity.dilatation import with_free_zones
from ..prediction.modal_impact import Impact
from ..reduction.body import ReducedBody
from ..reduction.estimate import Estimate
from ..support.arrays import Array
from ..support.checks import validate_positive, validate_type
from .modal_pair import Pair, Side, impact_of

_STEPS, _SOLVED = 40, 0.03  # of conjugate gradients; relative residual, whose square is the error of x' r
_LEAST = 0.25  # least square of a frequency that is left, by the lowest one: coarser meshes have no useful estimate
_ROW_RATE = 3  # power of the spacing of rows, by which their error falls
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
    of_bodies : (float, ...)
        Error of the force by the mesh of each body alone, the slave first.
    far, local : (float, ...)
        The larger error of force and velocity, by what the mesh of each body changes in its modes alone, and in the
        static answer of its contact alone. So they tell whether to refine far from the contact or near to it. The
        error of the rows is in that of the slave's contact.
    rows : float
        The larger error of force and velocity by the spacing of the rows; it is in both.
    step : float
        Error of the force by the default step alone; it is in that of the truncation.
    speed, duration : float
        Of the impact [m/s], [s].
    truncation : Estimate or None
        Estimated errors of truncation and step of these bodies; None if they were not reduced to a tolerance.
    """

    force: float
    velocity: float
    of_bodies: tuple[float, ...]
    far: tuple[float, ...]
    local: tuple[float, ...]
    speed: float
    duration: float
    truncation: Estimate | None = None
    rows: float = 0.0
    step: float = 0.0

    @property
    def error(self) -> float:
        """The larger one of force and velocity."""
        return max(self.force, self.velocity)

    @property
    def total(self) -> float:
        """Error of meshes, truncation and step together: the larger sum, of force or of velocity.

        Raises
        ------
        InputError
            If the error of the truncation is not known.
        """
        if self.truncation is None:
            raise InputError(
                "truncation: not known, because the bodies were not reduced to a tolerance; reduce them so"
            )
        return self.added_to(self.truncation).total

    def added_to(self, truncation: Estimate) -> Estimate:
        """Return the estimate of a truncation with that of the meshes beside it."""
        return replace(truncation, mesh_force=self.force, mesh_velocity=self.velocity, step=self.step)

    @property
    def limit(self) -> str:
        """What keeps the total error above the tolerance of the reduction, and where to refine; empty if nothing does.

        Only for bodies that were reduced to a tolerance.
        """
        if self.truncation is None or self.total <= self.truncation.tolerance:
            return ""
        if self.truncation.error > self.error:
            return "the truncation; reduce to a smaller tolerance"
        parts = {("far from", i): x for i, x in enumerate(self.far)} | {("at", i): x for i, x in enumerate(self.local)}
        (where, i), largest = max(parts.items(), key=lambda item: item[1])
        body = "the body" if len(self.far) == 1 else ("the slave", "the master")[i]
        return f"the mesh of {body}, {where} the contact, with an error of {largest:.2g}; refine it there"


def mesh_error(
    slave: Pair,
    master: Pair | RigidSurface,
    *,
    speed: float,
    duration: float | None = None,
    patches: tuple[int | str | None, int | str | None] = (None, None),
) -> MeshEstimate:
    """Estimate the error of the meshes of reduced bodies in a frictionless impact, of two or on a rigid surface.

    Parameters
    ----------
    slave : (FEModel, ReducedBody)
    master : (FEModel, ReducedBody), RigidPlane, RigidSphere or RigidCylinder
        Placed where they touch, or apart along their line of contact, as for `reduce_pair`.
    speed : float
        Approach speed along the line of contact [m/s].
    duration : float, optional
        [s]; default: that of the bodies' `estimate`, needed if they have none.
    patches : (int or str, int or str), optional
        Which patches meet, if a body has several; a rigid surface has none.

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
    _check("slave", slave)
    pairs, rigid = [slave], None
    if isinstance(master, (RigidPlane, RigidSphere, RigidCylinder)):
        rigid = master
    else:
        _check("master", master, ", or a RigidPlane, RigidSphere or RigidCylinder")
        pairs.append(master)  # type: ignore[arg-type]
    if not isinstance(patches, tuple | list) or len(patches) != 2:
        raise InputError(f"patches: expected the slave's and the master's, two names or numbers, got {patches!r}")
    if rigid is not None and patches[1] is not None:
        raise InputError(f"patches: a {type(rigid).__name__} has none, expected None for it, got {patches[1]!r}")
    speed = validate_positive("speed", speed, "m/s")
    if duration is None:
        known = [body.estimate.duration for _, body in pairs if body.estimate is not None]
        if not known:
            raise InputError("duration: expected one [s], because the bodies were not reduced to a tolerance")
        duration = max(known)
    duration = validate_positive("duration", duration, "s")
    numbers = [body.partition.patch(key) for (_, body), key in zip(pairs, patches, strict=False)]
    for (_, body), number in zip(pairs, numbers, strict=True):
        check_one_line(body.partition, number, "patches")
    with one_blas_thread():
        return estimate_of(*impact_of(pairs, numbers, speed, rigid), speed, duration)


def estimate_of(
    sides: Sequence[Side],
    impact: Impact,
    speed: float,
    duration: float,
    known: Sequence[FreeBodyFlexibility | None] = (None, None),
) -> MeshEstimate:
    """Do the work of `mesh_error`, for what `impact_of` returns, with the flexibility of each body if it is known."""
    f_cut, n = min(side.body.f_cut for side in sides), len(sides)
    rows = _near(sides[0].mean, impact.loaded(duration, impact.step(f_cut)))
    corrections = [_correction(side, rows, elastic) for side, elastic in zip(sides, known, strict=False)]
    whole = [(True, True)] * n
    both, _ = _corrected(impact, corrections, whole)
    step = min(impact.step(f_cut), both.step(f_cut)) / _FINER
    t, force, velocity = impact.run(duration, step)
    at, by_step, _ = impact.run(duration, impact.step(f_cut))
    by_step = np.interp(t, at, by_step[:, 0]) - force[:, 0]

    def change(kept: Sequence[tuple[bool, bool]]) -> tuple[float, float]:
        """Relative change of force and velocity by some of the corrections."""
        better_impact, turn = _corrected(impact, corrections, kept)
        _, better, better_velocity = better_impact.run(duration, step)
        return off(better, better_velocity @ turn.T)

    def off(better: Array, better_velocity: Array) -> tuple[float, float]:
        scale = np.linalg.norm(better_velocity - better_velocity[0])
        return (
            float(np.linalg.norm(force - better) / np.linalg.norm(better)),
            float(np.linalg.norm(velocity - better_velocity) / scale),
        )

    def of_each(far: bool, local: bool) -> list[tuple[float, float]]:
        return [change([(far, local) if i == j else (False, False) for j in range(n)]) for i in range(n)]

    by_surplus, by_rows, finer = change(whole), [0.0, 0.0], sides[0].spacing ** _ROW_RATE - 1
    if finer:
        _, coarse, coarse_velocity = impact.with_means(sides[0].coarse).run(duration, step)
        by_rows = [x / finer for x in off(coarse, coarse_velocity)]
    local = [max(one) for one in of_each(False, True)]
    return MeshEstimate(
        force=math.hypot(by_surplus[0], by_rows[0]),
        velocity=math.hypot(by_surplus[1], by_rows[1]),
        of_bodies=tuple(force for force, _ in of_each(True, True)) if n > 1 else by_surplus[:1],
        far=tuple(map(max, of_each(True, False))),
        local=(math.hypot(local[0], max(by_rows)), *local[1:]),
        rows=max(by_rows),
        step=float(np.linalg.norm(by_step) / np.linalg.norm(force)),
        speed=speed,
        duration=duration,
        truncation=sides[0].body.estimate,
    )


def _near(mean: sp.csr_matrix, loaded: Array) -> Array:
    """Numbers of rows that carry a force, and of those that share points with them, which softer bodies may reach."""
    shared = abs(mean)
    return np.flatnonzero(shared @ (shared.T @ loaded.astype(float)))


def _check(name: str, pair: object, others: str = "") -> None:
    if not isinstance(pair, tuple | list) or len(pair) != 2:
        raise InputError(f"{name}: expected (FEModel, ReducedBody){others}, got {type(pair).__name__}")
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


@dataclass(frozen=True, eq=False)
class _Correction:
    """What the surplus changes of one body.

    Parameters
    ----------
    turn : (ns, ns) array
        New shapes by the old ones, orthogonal.
    squares : (ns,) array
        Squares of the new shapes' frequencies [rad2/s2].
    rows : (k,) int array
        Rows of the contact that may carry a force; the others stay as they are.
    gaps : (k, ns) array
        What the old shapes have in addition at these rows.
    flexibility : (k, k) array
        Added to that of these rows [m/N].
    """

    turn: Array
    squares: Array
    rows: Array
    gaps: Array
    flexibility: Array


def _correction(side: Side, rows: Array, elastic: FreeBodyFlexibility | None) -> _Correction:
    """What the surplus changes of a body and of some rows; see the module."""
    fem, basis = side.fem, side.body.basis
    surplus = surplus_of(fem)
    moving = np.flatnonzero(basis.omega > 0)
    rigid, shapes, squares = basis.shapes[:, basis.omega == 0], basis.shapes[:, moving], basis.omega[moving] ** 2
    loads, on_surplus = _loads(side, surplus, rows)
    flexibility = elastic or FreeBodyFlexibility(with_free_zones(fem, side.body.partition).stiffness, fem.mass, rigid)

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
    turn[np.ix_(moving, moving)], gaps[:, moving] = vectors, E[m:, :m]
    new = basis.omega**2
    new[moving] = np.maximum(values, _LEAST * squares.min(initial=0.0))
    return _Correction(turn, new, rows, gaps, E[m:, m:])


def _loads(side: Side, surplus: Surplus, rows: Array) -> tuple[Array, Array]:
    """Forces of k rows on the nodes, (3n, k), and on the functions of the surplus, (3 s, k)."""
    n, dofs = len(side.patch.nodes), node_dofs(side.patch.nodes)
    on_body = sp.csr_matrix((np.ones(3 * n), (np.arange(3 * n), dofs)), shape=(3 * n, side.fem.n_dofs))
    at_points = surplus.at(side.corners, side.local)
    by_axis = sp.hstack([sp.diags(side.normals[:, axis]) @ at_points for axis in range(3)], format="csr")
    interleaved = np.arange(3 * surplus.size).reshape(3, surplus.size).T.ravel()
    on_surplus = side.mean[rows] @ by_axis[:, interleaved]
    return (side.on_patch[rows] @ on_body).T.toarray(), on_surplus.T.toarray()


def _corrected(
    impact: Impact, corrections: Sequence[_Correction], kept: Sequence[tuple[bool, bool]]
) -> tuple[Impact, Array]:
    """The impact with some corrections, of each body's modes and of its static answer; its coordinates by the old."""
    n = len(impact.omega)
    turn, squares, H, F = np.eye(n), impact.omega**2, impact.H.copy(), impact.F.copy()
    start = 0
    for by, (far, local) in zip(corrections, kept, strict=True):
        own = slice(start, start + len(by.squares))
        start = own.stop
        if far:
            turn[own, own], squares[own] = by.turn, by.squares
            H[by.rows, own] += by.gaps
            H[:, own] = H[:, own] @ by.turn
        if local:
            F[np.ix_(by.rows, by.rows)] += by.flexibility
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
