"""The free body under the loads of a scene: static answers, and the Krylov space of the contact-adapted basis.

Theory: examples/site/theory.md, "Contact-adapted".
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.sparse as sp

from ..algebra.krylov import BlockKrylov, RitzPairs, columns, mass_normalised, orthonormal_complement
from ..algebra.sparse.flexibility import FreeBodyFlexibility, selection
from ..algebra.sparse.multifrontal import Analysis
from ..algebra.sparse.ordering import least_cut
from ..algebra.sparse.skin_flexibility import SMALL, SkinFlexibility, works
from ..algebra.sparse.solver import SparseFactors, factorise
from ..errors import IndefiniteMatrixError, InputError
from ..fe.model import FEModel, MassKind, node_dofs
from ..fe.partition import Partition
from ..fe.patches import Patch
from ..plasticity.zone_flexibility import ZoneFlexibility
from ..support.arrays import Array
from ..support.machine import give_memory_back
from ..support.once import once
from ..support.progress import Progress
from .loads import attached_loads, centrifugal_accelerations, leading, patch_rows, patch_slice, resultants, unit_loads
from .tied import TiedModel, tie

_LOG = logging.getLogger(__name__)

DROP_ABOVE = 1.5  # Ritz pairs above this multiple of f_cut are left to the residual flexibility
_GROWTH = 10  # Krylov vectors between two looks at the mobility
LARGE = 20_000  # dofs, from which on memory and time of factors matter
HUGE = 100_000  # dofs, from which on factors of the static answers are rounded, which takes some percent more time
ROUGH = 1e-3  # largest relative error of Krylov vectors, in the norm of energy
# Radii, by that of a plastic zone, of edges that are eliminated last, from the outer to the inner one. Flow begins in
# the middle, and what an inner edge holds is solved for without what lies outside of it.
_EDGES = 1.25, 0.6, 0.3
SETTLED = 0.1  # largest relative change of a load's mobility over the band, by the last growth
_MIXED_GROWTH, _MIXED_SETTLED = 0.25, 0.1  # a space of mixed loads grows by this share, and settles to this of others
_MEMORY = 0.02  # decay rate of the mobility's Laplace variable, by the frequency, so that no single resonance decides
# Laplace variables at which the mobility is compared, by 2 pi f_cut: over the whole band, and over each octave below.
_BAND = _MEMORY + 1j * np.linspace(0.0, 1.0, 201)[1:, None]
_OCTAVES = (_MEMORY + 1j) * np.geomspace(1 / 64, 1.0, 300)[:, None]


@dataclass(frozen=True, eq=False)
class StaticAnswers:
    """Elastic answers of a free body to `unit_loads`, as far as they are needed.

    Parameters
    ----------
    at_patches : (r, r) array or SkinFlexibility
        Displacements at the patches' rows by unit forces there, G F_e G' [m/N].
    of_attached : (nz, 6 i + l) array
        Displacements of all coordinates by the rows of `attached_loads` [m/N].
    of_rotation : (nz, 6) array
        Displacements of all coordinates by centrifugal forces, see `FreeBody.centrifugal` [m s2].
    zones : dict of int to ZoneFlexibility
        Flexibility of the plastic zones, by the number of their patch.
    """

    at_patches: Array | SkinFlexibility
    of_attached: Array
    of_rotation: Array
    zones: dict[int, ZoneFlexibility]


def found_on_demand(partition: Partition) -> bool:
    """Whether the flexibility of the patches is found on demand: if it is large, and contact asks for few rows of it.

    Contact that does not wander asks for all rows of its patch.
    """
    patches = partition.patches
    return any(patch.wanders for patch in patches) and sum(len(p.nodes) * p.n_axes for p in patches) > SMALL


class FreeBody:
    """An FE model with tied rigid interfaces and mass-normalised rigid motion: the start of all bases.

    Parameters
    ----------
    fem : FEModel
    partition : Partition
    mass : {"consistent", "lumped"}

    Attributes
    ----------
    analysis : Analysis
        Of its stiffness, its mass and their sums.

    Raises
    ------
    InputError
        If a rigid interface holds all nodes.
    """

    def __init__(self, fem: FEModel, partition: Partition, mass: MassKind = "consistent") -> None:
        self.fem, self.partition, self.mass = fem, partition, mass
        self.model = tie(fem, partition, mass)
        if self.model.n == 6:
            raise InputError(
                "partition: a rigid interface holds all nodes, so that nothing deforms; take fewer nodes, "
                "kind='averaged', or a rigid body of Exudyn"
            )
        self.rigid = mass_normalised(self.model.rigid_modes, self.model.mass)
        zones, tied = any(patch.plastic for patch in partition.patches), len(self.model.interface_columns) > 0
        if zones or tied or self.model.n >= LARGE:
            edges = partial(_zone_edges, fem, partition, self.model)  # no method: a cycle would keep all factors
            self.analysis = analysis_of(self.model.stiffness, self.model.mass, edges)
        else:
            self.analysis = _of_mesh(fem)

    def flexibility(self, rows: sp.csr_matrix | None = None) -> FreeBodyFlexibility:
        """Its elastic flexibility; this costs a factorisation. For `rows` see there."""
        return FreeBodyFlexibility(self.model.stiffness, self.model.mass, self.rigid, self.analysis, rows)

    def static_answers(self, flexibility: FreeBodyFlexibility | None = None) -> StaticAnswers:
        """Elastic answers of the free body to the loads of its patches and interfaces."""
        flexibility = flexibility or self.flexibility()
        rows = self._patch_rows()
        zones = {number: self.zone_dofs(patch) for number, patch in enumerate(self.partition.patches) if patch.plastic}
        flexibilities = {
            number: _zone_flexibility(flexibility, dofs, rows[patch_slice(self.partition, number)])
            for number, dofs in zones.items()
        }
        waits = found_on_demand(self.partition) and flexibility.may_wait
        at_patches = flexibility.on_demand(rows) if waits else flexibility.of_rows(rows)
        return StaticAnswers(at_patches, *self.of_loads(flexibility), flexibilities)

    def of_loads(self, flexibility: FreeBodyFlexibility) -> tuple[Array, Array]:
        """Answers `of_attached` and `of_rotation` of `StaticAnswers`."""
        attached = attached_loads(self.fem, self.partition.interfaces, self.partition.loads) @ self.model.expand
        answers = flexibility(np.hstack([attached.T.toarray(), self.centrifugal()]))
        return answers[:, :-6], answers[:, -6:]

    def centrifugal(self) -> Array:
        """Centrifugal forces on the coordinates, (nz, 6) [kg m], by products of angular velocities, see `PAIRS`."""
        weights = self.fem.mass if self.mass == "consistent" else self.fem.lumped_mass_matrix
        return np.asarray(self.model.expand.T @ (weights @ centrifugal_accelerations(self.fem)))

    def _patch_rows(self) -> sp.csr_matrix:
        """(r, nz) rows: displacements of the patches' nodes by the coordinates."""
        return (patch_rows(self.fem, self.partition) @ self.model.expand).tocsr()

    def zone_dofs(self, patch: Patch) -> Array:
        """Coordinates of the nodes of a patch's plastic zone, (3 nz,) int array.

        Raises
        ------
        InputError
            If a rigid interface holds some of them.
        """
        return _zone_dofs(self.model, patch)


def analysis_of(
    stiffness: sp.csr_matrix,
    mass: sp.csr_matrix,
    last: Callable[[sp.csr_matrix], Sequence[Array]] = lambda pattern: (),
) -> Analysis:
    """Of these matrices, (n, n), and their sums; for `last` see `Analysis`."""
    return Analysis(lambda: sp.csr_matrix(stiffness.astype(bool) + mass.astype(bool)), last)


@once
def _of_mesh(fem: FEModel) -> Analysis:
    """Of the matrices of a mesh, which is often reduced with other partitions, or for other frequencies."""
    return analysis_of(fem.stiffness, fem.mass)


def _zone_edges(fem: FEModel, partition: Partition, model: TiedModel, pattern: sp.csr_matrix) -> list[Array]:
    """Coordinates around the plastic zones: eliminated last, they let each be solved for without what is outside.

    `pattern` is that of the stiffness, or more. Meshes get coarser outwards, so that a wider edge has fewer nodes.
    """
    edges: list[Array] = []
    for patch in partition.patches:
        if patch.plastic is None:
            continue
        _zone_dofs(model, patch)
        away = np.linalg.norm(fem.points - fem.points[patch.nodes].mean(axis=0), axis=1)
        radius = away[patch.plastic.nodes].max()
        edges += [_edge(model, pattern, away <= share * radius) for share in _EDGES]
    return edges


def _edge(model: TiedModel, pattern: sp.csr_matrix, inside: Array) -> Array:
    """Fewest coordinates, by nodes, that part the nodes inside, (n,) bool, from the others."""
    first = model.column[::3]
    nodes = np.flatnonzero(first >= 0)
    graph = pattern[first[nodes]][:, first[nodes]]
    side = np.where(inside[nodes], -1, 1)
    side[(side > 0) & (graph @ (graph @ (side < 0)) > 0)] = 0  # the nodes next to those inside
    edge = np.flatnonzero(least_cut(graph, side, np.ones(len(nodes), dtype=np.int64)) == 0)
    dofs = model.column[node_dofs(nodes[edge])]
    found: Array = dofs[dofs >= 0]
    return found


def _zone_dofs(model: TiedModel, patch: Patch) -> Array:
    """Coordinates of the nodes of a patch's plastic zone, (3 nz,) int array; see `FreeBody.zone_dofs`."""
    assert patch.plastic is not None
    dofs = model.column[node_dofs(patch.plastic.nodes)]
    if (dofs < 0).any():
        raise InputError(
            f"partition: a rigid interface holds nodes of the plastic zone of patch {patch.name!r}. Make "
            "plastic_radius smaller, or the interface kind='averaged'"
        )
    return dofs


class AdaptedSpace(FreeBody):
    """The Krylov space of a body's contact and interface loads, and their static answers.

    Parameters
    ----------
    fem : FEModel
    partition : Partition
    f_shift : float
        The shift is (pi f_shift)^2: the space grows fastest about half of f_shift [Hz]. Loads on patches over which
        contact wanders are as fine as waves at f_shift need.
    keep : bool
        Whether the factors of the static answers stay, for who needs more of these.

    Attributes
    ----------
    elastic : FreeBodyFlexibility or None
        What is kept.

    Raises
    ------
    InputError
        If there is neither a contact patch nor an interface.
    """

    def __init__(self, fem: FEModel, partition: Partition, f_shift: float, *, keep: bool = False) -> None:
        if not partition.patches and not partition.interfaces and not partition.loads:
            raise InputError(
                "partition: expected a contact patch, an interface or a load, got none: nothing moves the body"
            )
        super().__init__(fem, partition)
        self._combined = resultants(fem, partition, f_shift)
        self.loads = ((unit_loads(fem, partition) @ self.model.expand).T @ self._combined).tocsc()
        self._leading: Array = (self.loads @ leading(partition, self._combined)).toarray()
        self.elastic: FreeBodyFlexibility | None = None
        zones = any(patch.plastic for patch in partition.patches)
        if self.model.n >= HUGE and not keep and not zones and not found_on_demand(partition):
            give_memory_back()  # what meshing has left
            with contextlib.suppress(IndefiniteMatrixError):
                self._answer(self.flexibility(self._patch_rows()))  # its factors go before others are made
                give_memory_back()  # what fronts of all sizes have left between them: as much as factors
                self._begin(f_shift, self._factors(_shift(f_shift)))
                return
        flexibility = self.flexibility()
        self._lead = flexibility(self._leading)
        factors = self._factors(_shift(f_shift))
        with ThreadPoolExecutor(1) as second_core:
            static = second_core.submit(self.static_answers, flexibility)
            self._begin(f_shift, factors)
            self.static = static.result()
        self.elastic = flexibility if keep else None

    def _answer(self, flexibility: FreeBodyFlexibility) -> None:
        """Find the static answers."""
        self._lead, self.static = flexibility(self._leading), self.static_answers(flexibility)

    def shift_to(self, f_shift: float) -> None:
        """Begin the Krylov space anew, about half of `f_shift` [Hz]."""
        del self.krylov  # frees its factors before others are made
        self._begin(f_shift, self._factors(_shift(f_shift)))

    def _begin(self, f_shift: float, factors: SparseFactors) -> None:
        """Begin the Krylov space with these factors."""
        self._settled: tuple[float, float] | None = None
        lead = orthonormal_complement(self._lead, self.model.mass, self.rigid)
        start = _shift(f_shift), self.rigid, self._leading, lead
        self.krylov = BlockKrylov(factors.solve, self.model.mass, *start)
        self.krylov.grow(2 * _GROWTH)

    def _factors(self, shift: float) -> SparseFactors:
        """Factors of K + s M for the Krylov space; of large bodies in single precision, where that is accurate.

        Rayleigh-Ritz is exact in any space, and static answers have factors of their own. So vectors need few digits.
        """
        model = self.model

        def matrix() -> sp.csr_matrix:
            return model.stiffness + shift * model.mass

        if model.n >= LARGE:
            with contextlib.suppress(IndefiniteMatrixError):
                factors, load = factorise(matrix, analysis=self.analysis, single=True), self._leading[:, 0]
                answer = factors.solve(load)
                left = load - model.stiffness @ answer - shift * (model.mass @ answer)
                if left @ factors.solve(left) <= ROUGH**2 * (load @ answer):  # by energies
                    return factors
                del factors
        return factorise(matrix, analysis=self.analysis)

    def grow(self, f_cut: float, progress: Progress | None = None, settled: float = SETTLED) -> None:
        """Grow until the mobility of every load up to `f_cut` changes by no more than `settled`.

        Two norms are used: the relative L2 change over the band, and the rms of the relative change over all octaves.
        The first depends mostly on the upper end of the band. The second keeps low frequencies accurate, whose waves
        last longest.
        """
        krylov, omega_cut = self.krylov, 2 * np.pi * f_cut
        s = omega_cut * np.vstack([_BAND, _OCTAVES])
        rest = s * self._work() + np.sum((self.loads.T @ self.rigid) ** 2, axis=1) / s
        step, enough, share = max(_GROWTH, self._leading.shape[1]), settled, 0.0
        if self._leading.shape[1] < self.loads.shape[1]:  # few vectors at a time, for many modes, change little
            enough, share = _MIXED_SETTLED * settled, _MIXED_GROWTH
        mobility = np.zeros(rest.shape, dtype=complex)
        while True:
            omega, combination = krylov.rayleigh_ritz(self.model.stiffness)
            keep = omega < DROP_ABOVE * omega_cut
            participation = ((self.loads.T @ krylov.vectors) @ combination[:, keep]).T ** 2
            # The modes' answer without their static answer, at Laplace variables s.
            previous, mobility = mobility, s * ((1 / (omega[keep] ** 2 + s**2) - 1 / omega[keep] ** 2) @ participation)
            changes, whole = abs(mobility - previous), abs(mobility + rest)
            band, octaves = slice(len(_BAND)), slice(len(_BAND), None)
            change = np.maximum(
                np.linalg.norm(changes[band], axis=0) / np.linalg.norm(whole[band], axis=0),
                np.sqrt(np.mean((changes[octaves] / whole[octaves]) ** 2, axis=0)),
            )
            if progress:
                progress(min(1.0, enough / change.max()) if change.any() else 1.0)
            size = krylov.size
            _LOG.debug("Krylov space: %d vectors, the mobility changed by %.3g", size, change.max())
            if change.max() <= enough or (  # or there is no more to find
                not krylov.grow(size + max(step, int(share * size))) and krylov.size == size
            ):
                self._settled = f_cut, settled
                return

    def _work(self) -> Array:
        """Work of each load on its own static answer, (p,)."""
        n, combined = len(self.static.at_patches), self._combined
        of_patches = works(self.static.at_patches, combined[:n])
        attached = attached_loads(self.fem, self.partition.interfaces, self.partition.loads) @ self.model.expand
        of_attached = attached.multiply(self.static.of_attached.T).sum(axis=1)  # each is a load by itself
        work: Array = of_patches + combined[n:].T @ np.asarray(of_attached).ravel()
        return work

    def has_settled(self, f_cut: float, settled: float) -> bool:
        """Whether the space has grown up to `f_cut`, with a change of mobilities of at most `settled`."""
        return self._settled is not None and self._settled[0] >= f_cut and self._settled[1] <= settled

    def pairs(self, f_cut: float) -> RitzPairs:
        """Ritz pairs below 1.5 times `f_cut`."""
        omega, combination = self.krylov.rayleigh_ritz(self.model.stiffness)
        keep = omega < DROP_ABOVE * 2 * np.pi * f_cut
        return RitzPairs(self.krylov.vectors @ combination[:, keep], omega[keep])

    def excess(self, f_cut: float) -> Array:
        """Estimates of the relative errors of the frequencies of `pairs(f_cut)`, (k,): what the next block changes."""
        omega, better = self.krylov.rayleigh_ritz(self.model.stiffness)[0], self.krylov.grown(self.model.stiffness)
        keep = omega < DROP_ABOVE * 2 * np.pi * f_cut
        found: Array = abs(1 - better[keep] / omega[keep])
        return found


def _zone_flexibility(flexibility: FreeBodyFlexibility, dofs: Array, rows: sp.csr_matrix) -> ZoneFlexibility:
    """Flexibility of the dofs of a plastic zone, (k,), by forces there and on the rows of its patch, (r, n)."""
    of_zone_dofs, of_zone = flexibility.kept(dofs), selection(dofs, rows.shape[1])
    outside = np.ones(rows.shape[1])
    outside[dofs] = 0.0
    within = (abs(rows) @ outside) == 0
    of_patch = np.empty((len(dofs), rows.shape[0]), order="F")  # a run multiplies by some columns
    of_patch[:, within] = of_zone_dofs @ (of_zone @ rows[within].T).toarray()
    of_patch[:, ~within] = _displacements(flexibility, of_zone, rows[~within])
    return ZoneFlexibility(of_zone_dofs, of_patch)


def _displacements(flexibility: FreeBodyFlexibility, rows: sp.csr_matrix, loads: sp.csr_matrix) -> Array:
    """Elastic displacements of some rows, (r, n), by many loads, (k, n): (r, k) [m/N]."""
    most = columns(loads.shape[1])
    blocks = (slice(first, first + most) for first in range(0, loads.shape[0], most))
    return np.hstack([np.empty((rows.shape[0], 0)), *(rows @ flexibility(loads[some].T.toarray()) for some in blocks)])


def _shift(f_shift: float) -> float:
    """Shift s of K + s M [rad2/s2] about which a space grows, by `AdaptedSpace.f_shift` [Hz]."""
    return (np.pi * f_shift) ** 2
