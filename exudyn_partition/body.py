"""The reduced body: reduced matrices, its contact patch and the recovery u = T q."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from . import basis as bases
from ._checks import read_only, validate_choice, validate_positive, validate_type
from ._progress import shown
from .archive import Format
from .basis import Progress, ReducedBasis
from .cache import cached
from .contact.surface import Surface
from .errors import FrequencyRangeError, InputError
from .estimate import Estimate, grow_to_tolerance, warn_if_missed
from .fem import FEModel, nearest_node, node_dofs, rigid_modes
from .floating import InertiaIntegrals
from .linalg import one_blas_thread
from .partition import Interface, Partition, Patch

Array = np.ndarray

BASES = {
    "free": bases.free,
    "craig-bampton": bases.craig_bampton,
    "residual": bases.residual,
    "contact-adapted": bases.contact_adapted,
}


@dataclass(frozen=True, eq=False)
class ReducedBody:
    """A body in reduced coordinates q: shape coordinates first, then x, y, z of each nodal column.

    Parameters
    ----------
    basis : ReducedBasis
    partition : Partition
    points : (n, 3) array
        Nodes of the FE model [m].
    facets : (nf, 3), (nf, 6) or (nf, 4) int array
        Its surface, as `FEModel.facets`: what pictures need.
    mass, stiffness : (n_dofs, n_dofs) csr matrix
        T' M T and T' K T (paper, eq. 16).
    total_mass : float
        [kg]
    centre_of_mass : (3,) array
        [m]
    f_cut : float
        Truncation frequency [Hz].
    reduce_s : float
        Time that the reduction took [s]; of one of a pair, half of the pair's.
    estimate : Estimate or None
        Estimated errors, of a body that was grown to a tolerance.
    inertia : InertiaIntegrals or None
        What a floating frame needs to know of the mass; None for a basis with nodal columns.
    """

    basis: ReducedBasis
    partition: Partition
    points: Array
    facets: Array
    mass: sp.csr_matrix
    stiffness: sp.csr_matrix
    total_mass: float
    centre_of_mass: Array
    f_cut: float
    reduce_s: float
    estimate: Estimate | None = None
    inertia: InertiaIntegrals | None = None

    def __post_init__(self) -> None:
        read_only(self.points, self.facets, self.centre_of_mass)

    @property
    def n_dofs(self) -> int:
        """Number of reduced coordinates."""
        return self.mass.shape[0]

    @property
    def n_shapes(self) -> int:
        """Number of shape coordinates, rigid ones included; they stand first."""
        return self.basis.shapes.shape[1]

    @property
    def fe_dofs(self) -> int:
        """Number of dofs of the FE model."""
        return 3 * len(self.points)

    @property
    def left_out(self) -> tuple[str, ...]:
        """What the body leaves out, in sentences."""
        said = list(self.basis.left_out)
        beside = np.setdiff1d(self.partition.nodes, self.partition.patch_nodes)
        if len(beside):
            said.append(
                f"contact rows at {len(beside)} nodes of the impact region, inside the body or beside the patch "
                "(contact_radius of the partition widens the patch)"
            )
        said.append("strain and stress rows, until `recovery` is asked for them")
        return tuple(said)

    @cached_property
    def rigid(self) -> Array:
        """(n_dofs, 6) array: coordinates of unit translations [m] and rotations [rad] about the centre of mass."""
        arms = self.points[self.basis.nodal] - self.centre_of_mass
        result = np.vstack([self.basis.rigid, rigid_modes(arms)])
        read_only(result)
        return result

    def rows(self, nodes: Array) -> sp.csr_matrix | Array:
        """T's rows of some nodes, (3k, n_dofs): dense where there are shapes only, csr with nodal columns.

        Parameters
        ----------
        nodes : (k,) int array
        """
        dofs = node_dofs(nodes)
        shapes = self.basis.shapes[dofs]
        nodal = self.basis.nodal
        if not len(nodal):
            return shapes
        column = np.full(len(self.points), -1)
        column[nodal] = np.arange(len(nodal))
        own = column[dofs // 3]
        kept = np.flatnonzero(own >= 0)
        identity = sp.csr_matrix(
            (np.ones(len(kept)), (kept, 3 * own[kept] + dofs[kept] % 3)), shape=(len(dofs), 3 * len(nodal))
        )
        return sp.hstack([sp.csr_matrix(shapes), identity], format="csr")

    def reduced_rows(self, rows: sp.csr_matrix) -> Array:
        """Rows on the coordinates, rows T, (k, n_dofs), of rows on the nodal displacements, (k, 3n).

        Parameters
        ----------
        rows : (k, 3n) csr matrix
            As `recovery` makes them; rows @ u of the recovered displacements u is the result times q.

        Raises
        ------
        InputError
            If they are of another mesh.
        """
        if rows.shape[1] != self.fe_dofs:
            raise InputError(f"rows: expected {self.fe_dofs} columns, the dofs of the FE model, got {rows.shape[1]}")
        dofs = (3 * self.basis.nodal[:, None] + np.arange(3)).ravel()
        rows = sp.csr_matrix(rows)
        return np.hstack([rows @ self.basis.shapes, rows[:, dofs].toarray()])

    def displacement(self, q: Array) -> Array:
        """Displacements of all nodes, (n, 3) [m], of coordinates q, (n_dofs,); velocities likewise.

        Raises
        ------
        InputError
            If q has another shape.
        """
        q = np.asarray(q, dtype=float)
        if q.shape != (self.n_dofs,):
            raise InputError(f"q: expected shape ({self.n_dofs},), got {q.shape}")
        u = (self.basis.shapes @ q[: self.n_shapes]).reshape(-1, 3)
        u[self.basis.nodal] += q[self.n_shapes :].reshape(-1, 3)
        return u

    def nearest_node(self, point: Array) -> int:
        """Index of the node nearest to `point`, (3,) [m], in the body's own coordinates; see `fem.nearest_node`."""
        return nearest_node(self.points, point)

    def surface(self, position: Array, patch: int = 0) -> Surface:
        """Contact patch number `patch` with the body shifted by `position`, (3,) [m]."""
        return Surface.of(self.points, self.partition.patches[patch], position)

    def flexibility(self, patch: int = 0, other: int | None = None) -> Array:
        """Residual flexibility of the rows of `patch`, (nr, nr) [m/N], or between those and the rows of `other`.

        Both are numbers of patches.

        Raises
        ------
        InputError
            If the basis has none.
        """
        if self.basis.flexibility is None:
            raise InputError(f"body: basis {self.basis.name!r} has no residual flexibility, its patch has mass instead")
        rows, columns = (bases.patch_slice(self.partition, i) for i in (patch, patch if other is None else other))
        return self.basis.flexibility[rows, columns]

    def interface_rows(self, name: str) -> Array:
        """Rows of an interface, (6, n_dofs): its mean translation [m] and rotation [rad] by the coordinates.

        Transposed, they are the generalised forces of a unit force and moment on it.

        Parameters
        ----------
        name : str

        Raises
        ------
        InputError
            If there is no such interface.
        """
        interface = self.partition.find_interface(name)
        return interface.motion @ self.rows(interface.nodes)

    @property
    def labels(self) -> tuple[str, ...]:
        """What each column of T is, n_dofs of them."""
        return self.basis.labels + tuple(f"nodal {axis} of node {node}" for node in self.basis.nodal for axis in "xyz")

    def table(self) -> str:
        """Columns of T, one a line: number, what it is."""
        return "\n".join(f"{i:5d}  {label}" for i, label in enumerate(self.labels))

    def save(self, path: str | Path) -> None:
        """Write to an npz file, all fields in full precision; `load_body` reads it.

        The file is written under another name and then renamed, so that a process that is killed leaves no half file.

        Parameters
        ----------
        path : str or Path
            Taken as it is, nothing is appended.

        Raises
        ------
        InputError
            If the folder does not exist, or `path` is one.
        """
        _FILE.save(path, self)

    def __repr__(self) -> str:
        return (
            f"ReducedBody({self.basis.name!r}, {self.n_dofs} of {self.fe_dofs} dofs, f_cut {self.f_cut:.6g} Hz, "
            f"{len(self.partition.patch_nodes)} patch nodes)"
        )


_FILE = Format(
    name="reduced body",
    version=4,
    units="SI (m, kg, s, N, rad), or the consistent units that the FE model was made in",
    classes=(ReducedBody, ReducedBasis, InertiaIntegrals, Partition, Patch, Interface, Estimate),
)


def load_body(path: str | Path) -> ReducedBody:
    """Read a body that `ReducedBody.save` wrote.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    ReducedBody
        Equal to the saved one in every bit.

    Raises
    ------
    InputError
        If the file is missing, damaged, of another kind, or of another version of the format.
    """
    return _FILE.load(path)


def reduce(
    fem: FEModel,
    partition: Partition,
    *,
    f_cut: float | None = None,
    tolerance: float | None = None,
    basis: str = "contact-adapted",
    speed: float = 1.0,
    duration: float | None = None,
    progress: Progress | None = None,
    cache: bool | str | Path = False,
) -> ReducedBody:
    """Reduce a free body, to a truncation frequency or to a tolerance.

    Parameters
    ----------
    fem : FEModel
    partition : Partition
        Impact region, contact patches and interfaces.
    f_cut : float, optional
        Truncation frequency [Hz]: motion below it is kept. The paper's principle: twice the highest frequency of the
        response (section 5.2), `truncation_frequency`.
    tolerance : float, optional
        Instead of `f_cut`: the contact-adapted basis grows until the estimated errors of force and velocity are below
        it when the body hits a rigid plane, or a rigid sphere if the patch is flat; see `body.estimate` and module
        `estimate`. For two bodies that hit each other `reduce_pair` knows better.
    basis : {"contact-adapted", "residual", "craig-bampton", "free"}
        "free" is the paper's, "craig-bampton" keeps the patch's nodes as boundary with their static answer, "residual"
        all modes below `f_cut` with the residual flexibility of the contact, "contact-adapted" only what contacts and
        interfaces excite, with the same residual flexibility.
    speed, duration : float
        Of that impact [m/s], [s], with `tolerance`; see `reduce_pair`.
    progress : callable, optional
        Called with the share done, 0 to 1. Default: a bar on the terminal, if it takes more than two seconds.
    cache : bool or path
        Whether to keep the body for the next run that reduces the same FE model in the same way, `reduce_s` included.
        True: in the folder that the environment variable EXUDYN_PARTITION_CACHE names, or in the user's folder for
        caches; a path: in that folder. Nothing there is ever deleted; it may be, at any time.

    Returns
    -------
    ReducedBody

    Raises
    ------
    FrequencyRangeError
        If the mesh does not resolve `f_cut`, or no elastic mode lies below it.
    InputError
        If another argument is out of range, both or none of `f_cut` and `tolerance` are given, or the impact region
        holds every node and the basis is not "free".

    Warns
    -----
    ToleranceWarning
        If the mesh does not let the basis reach the tolerance; the best body is returned.
    CacheWarning
        If a kept file is damaged, or the folder cannot be written; the body is computed.
    """
    _validate_partition(fem, partition)
    validate_choice("basis", basis, BASES)
    if len(partition.nodes) == fem.n_nodes and basis != "free":
        raise InputError(
            f"partition: the impact region holds all {fem.n_nodes} nodes, so that nothing is left for basis {basis!r}. "
            "Take a smaller radius, or basis='free', which is the full FE model then"
        )
    if (f_cut is None) == (tolerance is None):
        raise InputError(
            f"f_cut, tolerance: expected one of them, got f_cut={f_cut!r} and tolerance={tolerance!r}. f_cut [Hz] "
            "truncates, tolerance=1e-2 grows the basis until its estimated error is below 1 %"
        )
    # Whatever changes the body belongs into `inputs`.
    inputs: dict[str, Any] = {"fem": fem, "partition": partition, "basis": basis}
    if f_cut is not None:
        f_cut = _resolved(fem, f_cut)
        inputs |= {"f_cut": f_cut}
        with shown(progress, "reduce") as report:
            body = cached(cache, inputs, _FILE, lambda: _reduce(fem, partition, f_cut, basis, report))
    else:
        if basis != "contact-adapted":
            raise InputError(f"tolerance: only basis 'contact-adapted' grows to a tolerance, got {basis!r}; give f_cut")
        options = _impact_options(tolerance, speed, duration)
        models, patches = [(fem, partition)], [[i] for i in range(len(partition.patches))]
        if not patches:
            raise InputError("tolerance: the partition has no contact patch whose force could be judged; give f_cut")
        inputs |= options
        with shown(progress, "reduce to a tolerance") as report:
            (body,) = cached(cache, inputs, _FILE, lambda: _reduce_to_tolerance(models, patches, options, report))
        warn_if_missed(body.estimate)
    return body


def reduce_pair(
    slave: tuple[FEModel, Partition],
    master: tuple[FEModel, Partition],
    *,
    tolerance: float,
    speed: float,
    duration: float | None = None,
    patches: tuple[int | str | None, int | str | None] = (None, None),
    progress: Progress | None = None,
    cache: bool | str | Path = False,
) -> tuple[ReducedBody, ReducedBody]:
    """Reduce two bodies so far that the error of their impact on each other is below a tolerance.

    How fine a body has to be depends on what it hits: a plate yields within microseconds where a wall would not. Both
    bodies' spaces grow together, and their impact decides on a truncation common to both; see module `estimate`.

    Parameters
    ----------
    slave, master : (FEModel, Partition)
        Placed where they touch, or apart along their line of contact.
    tolerance : float
        Of contact force and velocities, relative L2 over `duration`.
    speed : float
        Approach speed along the line of contact [m/s].
    duration : float, optional
        How long the impact is followed [s]. Default: 30 crossings of a longitudinal wave through the larger body.
    patches : (int or str, int or str), optional
        Which patches meet, if a body has several.
    progress, cache :
        As for `reduce`.

    Returns
    -------
    (ReducedBody, ReducedBody)
        Both with the same `estimate`.

    Raises
    ------
    InputError, EmptyRegionError, PenetrationError

    Warns
    -----
    ToleranceWarning, CacheWarning
        As `reduce`.
    """
    for fem, partition in (slave, master):
        _validate_partition(fem, partition)
    numbers = [partition.patch(key) for (_, partition), key in zip((slave, master), patches, strict=True)]
    options = _impact_options(tolerance, speed, duration)
    models = [slave, master]
    inputs = {"slave": slave, "master": master, "patches": tuple(numbers), **options}
    with shown(progress, "reduce a pair") as report:
        pair = cached(cache, inputs, _FILE, lambda: _reduce_to_tolerance(models, [numbers], options, report))
    warn_if_missed(pair[0].estimate)
    return pair


def _validate_partition(fem: FEModel, partition: Partition) -> None:
    validate_type("fem", fem, FEModel, "fe_model()")
    validate_type("partition", partition, Partition, "Partition.ball()")
    if partition.n_nodes != fem.n_nodes:
        raise InputError(
            f"partition: it was made for another mesh, with {partition.n_nodes} nodes; this one has {fem.n_nodes}"
        )


def _resolved(fem: FEModel, f_cut: float) -> float:
    f_cut = validate_positive("f_cut", f_cut, "Hz")
    if f_cut > fem.resolved_frequency:
        raise FrequencyRangeError(
            f"f_cut: the mesh resolves {fem.resolved_frequency:.4g} Hz (four node spacings a shear wave in its largest "
            f"element, of size {fem.max_size:.4g} m), got {f_cut:.6g} Hz. Refine it to elements of "
            f"{fem.max_size * fem.resolved_frequency / f_cut:.3g} m or lower f_cut"
        )
    return f_cut


def _impact_options(tolerance: float | None, speed: float, duration: float | None) -> dict[str, float | None]:
    tolerance = validate_positive("tolerance", tolerance)
    if tolerance >= 1:
        raise InputError(f"tolerance: expected a relative error below 1, such as 0.01, got {tolerance!r}")
    return {
        "tolerance": tolerance,
        "speed": validate_positive("speed", speed, "m/s"),
        "duration": None if duration is None else validate_positive("duration", duration, "s"),
    }


def _reduce(fem: FEModel, partition: Partition, f_cut: float, basis: str, progress: Progress | None) -> ReducedBody:
    begin = time.perf_counter()
    with one_blas_thread():
        reduced = BASES[basis](fem, partition, f_cut, progress)
        return _body(fem, partition, reduced, f_cut, begin)


def _reduce_to_tolerance(
    models: list[tuple[FEModel, Partition]],
    patches: list[list[int]],
    options: dict[str, Any],
    progress: Progress | None,
) -> tuple[ReducedBody, ...]:
    begin = time.perf_counter()
    with one_blas_thread():
        spaces, estimate = grow_to_tolerance(models, patches, **options, progress=progress)
        reduced = [bases.adapted_basis(space, estimate.f_cut) for space in spaces]
        bodies = [_body(*model, r, estimate.f_cut, begin, estimate) for model, r in zip(models, reduced, strict=True)]
    share = (time.perf_counter() - begin) / len(bodies)
    return tuple(replace(body, reduce_s=share) for body in bodies)


def _body(
    fem: FEModel,
    partition: Partition,
    reduced: ReducedBasis,
    f_cut: float,
    begin: float,
    estimate: Estimate | None = None,
) -> ReducedBody:
    mass, stiffness = _reduced_matrices(fem, reduced)
    # The FE mass is at hand here, not where a frame is chosen; six products of shapes cost little beside the modes.
    inertia = None if len(reduced.nodal) else InertiaIntegrals.of(fem, reduced.shapes[:, 6:])
    return ReducedBody(
        basis=reduced,
        partition=partition,
        points=fem.points,
        facets=fem.facets,
        mass=mass,
        stiffness=stiffness,
        total_mass=fem.total_mass,
        centre_of_mass=fem.centre_of_mass,
        f_cut=f_cut,
        reduce_s=time.perf_counter() - begin,
        estimate=estimate,
        inertia=inertia,
    )


def _reduced_matrices(fem: FEModel, basis: ReducedBasis) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """T' M T and T' K T; the shapes are mass-normalised and, with lumped mass, apart from the nodal columns."""
    mass = sp.identity(basis.shapes.shape[1], format="csr")
    stiffness = sp.diags(basis.omega**2, format="csr")
    if not len(basis.nodal):
        return mass, stiffness
    dofs = node_dofs(basis.nodal)
    columns = fem.stiffness[:, dofs]
    coupling = sp.csr_matrix(columns.T @ basis.shapes)
    mass = sp.block_diag([mass, sp.diags(np.repeat(fem.lumped_mass[basis.nodal], 3))], format="csr")
    stiffness = sp.bmat([[stiffness, coupling.T], [coupling, columns[dofs]]], format="csr")
    return mass, stiffness
