"""Estimate of the error that the meshes of bodies make in their impact, by functions of one order more.

Functions that the next order adds on the same elements change bodies and rows (`correction`).

The impact of the scene runs with and without these corrections. Its difference is the estimate (Bank and Weiser 1985).

Rows have an error of their own. The pressure ends like a square root at the edge of the contact, where rows of spacing
s miss it by s^(1/2). The strain energy of that error is p^2 s^3 in each of 2 pi a / s places, so that it is of order
s^3. Where the contact ends in a facet changes it at random, so that two grids have independent errors. So a run with
the rows of a coarser grid of the same facets, of k times the spacing, differs by (k^6 + 1)^(1/2) times the error
(`validation/mesh/row_spacing.py`). Rows and functions of one order more are taken as independent too.

Forces on the rows take few ways in an impact. What the functions change is found for these alone. It is local, for each
function ends with its element. So what the points of the contact move in addition is taken in proportion to the forces
on them. Its work by each way of forces on each other one is exact.

It is no bound. Below two elements in a contact radius it is too small.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from ..algebra.blas_threads import one_blas_thread
from ..contact.rigid import RigidCylinder, RigidPlane, RigidSphere, RigidSurface
from ..errors import InputError, ToleranceWarning
from ..fe.model import FEModel, node_dofs
from ..fe.partition import check_one_line, number_of_patch
from ..prediction.modal_impact import Impact
from ..reduction.body import ReducedBody
from ..reduction.estimate import Estimate
from ..support.arrays import Array
from ..support.checks import validate_positive, validate_type
from ..support.warn import warn
from .correction import Change, Finer, Points, patch_axes
from .modal_pair import Pair, Side, impact_of

_ROW_RATE = 3  # power of the spacing of rows, by which their error falls
_FINER = 2  # steps of the default one
_FEWEST = 4  # rows that carry force; with fewer the contact lies within a facet
_MOMENTS = 30  # of an impact, whose forces on the rows count
_SPANNED = 1e-3  # amplitude of a way of these forces, by that of the largest one, from which on it counts


@dataclass(frozen=True)
class MeshEstimate:
    """Estimated errors that meshes make in an impact, relative L2 over its duration.

    Parameters
    ----------
    force : float
        Error of the contact force.
    velocity : float
        Error of the velocities of the bodies, in the norm of the kinetic energy, relative to their change.
    mean_velocity : float
        The same of whole bodies, as rigid ones.
    of_bodies : (float, ...)
        Error of the force by the mesh of each body alone, the slave first.
    far, local : (float, ...)
        The larger error of force and velocity, or of what else the tolerance is for, by what the mesh of each body
        changes in its modes alone, and in the static answer of its contact alone. So they tell whether to refine far
        from the contact or near to it. The error of the rows is in that of the slave's contact.
    rows : float
        The larger error of force and velocity by the spacing of the rows; it is in both.
    step : float
        Error of the force by the default step alone; it is in that of the truncation.
    carrying : int
        Number of rows that carry force at some time.
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
    carrying: int = 0
    mean_velocity: float = 0.0

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

    Warns
    -----
    ToleranceWarning
        If fewer than 4 rows of the contact carry force: then the estimate may be far too small.

    Notes
    -----
    It costs a factorisation of each body, and solutions for its shapes and few loads: `validation/mesh/effectivity.py`.
    """
    return judged(slave, master, speed=speed, duration=duration, patches=patches)[0]


def judged(
    slave: Pair,
    master: Pair | RigidSurface,
    *,
    speed: float,
    duration: float | None,
    patches: tuple[int | str | None, int | str | None],
) -> tuple[MeshEstimate, list[Finer], list[int]]:
    """Do the work of `mesh_error`; also return the bodies with what the next order adds, and which patches meet."""
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
    numbers = [number_of_patch(body.partition, key, "patches") for (_, body), key in zip(pairs, patches, strict=False)]
    for (_, body), number in zip(pairs, numbers, strict=True):
        check_one_line(body.partition, number, "patches")
    with one_blas_thread():
        finers = [Finer(*pair) for pair in pairs]
        estimate = estimate_of(*impact_of(pairs, numbers, speed, rigid), speed, duration, finers)
    if estimate.carrying < _FEWEST:
        warn(
            f"mesh: expected {_FEWEST} rows of the contact or more that carry force, got {estimate.carrying}. So the "
            f"estimated error of {estimate.force:.2g} may be far too small; refine both meshes at the contact",
            ToleranceWarning,
        )
    return estimate, finers, numbers


def estimate_of(
    sides: Sequence[Side],
    impact: Impact,
    speed: float,
    duration: float,
    finers: Sequence[Finer],
    left: float = 1.0,
    *,
    whole: bool = False,
) -> MeshEstimate:
    """Estimate the error of the meshes, for what `impact_of` returns and what the next order adds to each body.

    Bodies that will be corrected keep only a share `left` of it; that of the rows stays. With `whole`, velocities of
    whole bodies count in what tells where to refine, in place of those of every point.
    """
    f_cut, n = min(side.body.f_cut for side in sides), len(sides)
    default = impact.step(f_cut)
    loaded = impact.loaded(duration, default)
    rows = _near(sides[0].mean, loaded)
    ways = _ways(impact.forces(duration, default, _MOMENTS)[rows], sides[0].mean[rows])
    change_of = _change if left == 1 else _nodal_change
    with ThreadPoolExecutor(n) as pool:  # products of matrices let other threads run
        changes = list(pool.map(change_of, finers, sides, itertools.repeat(rows), itertools.repeat(ways)))
    every = [(True, True)] * n
    both, _ = _corrected(impact, changes, rows, every)
    step = min(default, both.step(f_cut)) / _FINER
    t, force, velocity = impact.run(duration, step)
    at, by_step, _ = impact.run(duration, default)
    by_step = np.interp(t, at, by_step[:, 0]) - force[:, 0]

    rigid = impact.omega == 0.0

    def change(kept: Sequence[tuple[bool, bool]]) -> Array:
        """Relative change of force, velocity and velocity of whole bodies by some of the corrections, (3,)."""
        better_impact, turn = _corrected(impact, changes, rows, kept)
        _, better, better_velocity = better_impact.run(duration, step)
        return left * off(better, better_velocity @ turn.T)

    def off(better: Array, better_velocity: Array) -> Array:
        relative = [np.linalg.norm(force - better) / np.linalg.norm(better)]
        for some in (slice(None), rigid):
            new = better_velocity[:, some]
            relative.append(np.linalg.norm(velocity[:, some] - new) / np.linalg.norm(new - new[0]))
        return np.array(relative)

    def of_each(far: bool, local: bool) -> list[Array]:
        return [change([(far, local) if i == j else (False, False) for j in range(n)]) for i in range(n)]

    def larger(relative: Array) -> float:
        return float(relative[[0, 2 if whole else 1]].max())

    by_surplus, by_rows, spacing = change(every), np.zeros(3), sides[0].spacing
    if spacing > 1:
        _, coarse, coarse_velocity = impact.with_means(sides[0].coarse).run(duration, step)
        by_rows = off(coarse, coarse_velocity) / math.hypot(spacing**_ROW_RATE, 1)
    local = [larger(errors) for errors in of_each(False, True)]
    together = np.hypot(by_surplus, by_rows)
    return MeshEstimate(
        force=float(together[0]),
        velocity=float(together[1]),
        mean_velocity=float(together[2]),
        of_bodies=tuple(float(errors[0]) for errors in (of_each(True, True) if n > 1 else [by_surplus])),
        far=tuple(map(larger, of_each(True, False))),
        local=(math.hypot(local[0], larger(by_rows)), *local[1:]),
        rows=larger(by_rows),
        step=float(np.linalg.norm(by_step) / np.linalg.norm(force)),
        carrying=int(np.count_nonzero(loaded)),
        speed=speed,
        duration=duration,
        truncation=sides[0].body.estimate,
    )


def _near(mean: sp.csr_matrix, loaded: Array) -> Array:
    """Numbers of rows that carry a force, and of those that share points with them, which softer bodies may reach."""
    shared = abs(mean)
    return np.flatnonzero(shared @ (shared.T @ loaded.astype(float)))


def _ways(forces: Array, mean: sp.csr_matrix) -> Array:
    """Ways, (k, p), that forces on rows, (k, m), take; forces on the points by these are orthonormal."""
    at_points = mean.T @ forces
    largest = np.linalg.norm(at_points, axis=0).max(initial=0.0)
    values, vectors = np.linalg.eigh(at_points.T @ at_points)
    kept = values > (_SPANNED * largest) ** 2
    found: Array = forces @ (vectors[:, kept] / np.sqrt(values[kept]))
    return found


def _check(name: str, pair: object, others: str = "") -> None:
    if not isinstance(pair, tuple | list) or len(pair) != 2:
        raise InputError(f"{name}: expected (FEModel, ReducedBody){others}, got {type(pair).__name__}")
    fem, body = pair
    validate_type(f"{name}[0]", fem, FEModel, "fe_model()")
    validate_type(f"{name}[1]", body, ReducedBody, "reduce() or load_body()")
    body.check_fem(fem, name)
    body.check_inside("the error of the mesh")
    if body.basis.flexibility is None or len(body.basis.nodal):
        raise InputError(
            f"{name}: expected a body with basis 'contact-adapted' or 'residual', got {body.basis.name!r}, whose "
            "contact has no residual flexibility"
        )


def _change(finer: Finer, side: Side, rows: Array, ways: Array) -> Change:
    """What the surplus changes of a body and of some rows, by some ways of forces on them."""
    n, dofs = len(side.patch.nodes), node_dofs(side.patch.nodes)
    on_body = sp.csr_matrix((np.ones(3 * n), (np.arange(3 * n), dofs)), shape=(3 * n, side.fem.n_dofs))
    mean, combined = side.mean[rows], sp.csr_matrix(ways.T)
    some = np.unique(mean.indices)
    points = Points(side.corners[some], side.local[some], side.normals[some], combined @ mean[:, some])
    change = finer.change(combined @ side.on_patch[rows] @ on_body, points)
    spread = mean @ (mean.T @ ways)
    return replace(change, gaps=spread @ change.gaps, flexibility=spread @ change.flexibility @ spread.T)


def _nodal_change(finer: Finer, side: Side, rows: Array, ways: Array) -> Change:
    """The same by that of all of the patch's nodes, which a corrected body has."""
    number = side.body.partition.patches.index(side.patch)
    change, n = finer.at_nodes(number), len(side.patch.nodes)
    by_nodes = side.on_patch[rows] @ sp.kron(sp.identity(n), patch_axes(side.patch).T, format="csr")
    return replace(change, gaps=by_nodes @ change.gaps, flexibility=by_nodes @ change.flexibility @ by_nodes.T)


def _corrected(
    impact: Impact, changes: Sequence[Change], rows: Array, kept: Sequence[tuple[bool, bool]]
) -> tuple[Impact, Array]:
    """The impact with some corrections, of each body's modes and of its static answer; its coordinates by the old."""
    n = len(impact.omega)
    turn, squares, H, F = np.eye(n), impact.omega**2, impact.H.copy(), impact.F.copy()
    start = 0
    for by, (far, local) in zip(changes, kept, strict=True):
        columns = slice(start, start + len(by.squares))
        start = columns.stop
        if far:
            turn[columns, columns], squares[columns] = by.turn, by.squares
            H[rows, columns] += by.gaps
            H[:, columns] = H[:, columns] @ by.turn
        if local:
            F[np.ix_(rows, rows)] += by.flexibility
    velocity = turn.T @ impact.velocity
    return replace(impact, omega=np.sqrt(squares), H=H, F=F, velocity=velocity), turn
