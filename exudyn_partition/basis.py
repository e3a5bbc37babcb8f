"""The bases of the partition method: from an FE model and its partition to the columns of T, u = T q.

Every basis here is mass-normalised in its shapes, so that mass and stiffness of the shapes are diagonal; nodal columns,
which only the paper's basis has, are unit displacements of the impact region's nodes (paper, eq. 15).
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from ._checks import read_only
from .errors import FrequencyRangeError
from .fem import FEModel
from .linalg import BlockKrylov, Factorisation, FreeBodyFlexibility, RitzPairs, eigenmodes, mass_normalised
from .partition import Partition

Array = np.ndarray
Progress = Callable[[float], None]

_DROP_ABOVE = 1.5  # Ritz pairs above this multiple of f_cut are left to the residual flexibility
_GROWTH = 10  # Krylov vectors between two looks at the mobility
_SETTLED = 0.05  # relative change of the mobility over the band by the last growth
_MEMORY = 0.02  # of 2 pi f_cut: decay rate at which the mobility is taken, so that no lone resonance decides
_BAND_SAMPLES = 200


@dataclass(frozen=True, eq=False)
class ReducedBasis:
    """Columns of T, and what the basis knows about the rest.

    Parameters
    ----------
    name : str
    shapes : (3n, ns) array
        Mass-normalised shapes [kg^-1/2], rigid ones first; zero at the nodes of `nodal`.
    omega : (ns,) array
        Circular frequencies of the shapes, zero for rigid ones [rad/s].
    labels : tuple of str
        One for each shape.
    rigid : (ns, 6) array
        Shape coordinates of unit translations and rotations about the centre of mass.
    nodal : (k,) int array
        Nodes that keep their three displacements.
    mass : str
        "consistent" or "lumped".
    flexibility : (np, np) array or None
        Residual flexibility of the contact patch's nodes along its direction [m/N].
    left_out : tuple of str
        What the basis leaves out, in sentences.
    """

    name: str
    shapes: Array
    omega: Array
    labels: tuple[str, ...]
    rigid: Array
    nodal: Array
    mass: str
    flexibility: Array | None = None
    left_out: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        read_only(self.shapes, self.omega, self.rigid, self.nodal)


def free(fem: FEModel, partition: Partition, f_cut: float, progress: Progress | None = None) -> ReducedBasis:
    """Build the paper's partition basis: free modes on the non-impact region, nodes in the impact region (eq. 11-17).

    Elastic modes of the whole body up to `f_cut` keep their rows in region I only (eq. 13), every node of region II
    keeps its three displacements. The rigid modes, which the paper puts into the frame (eq. 12), are six more columns.
    They and the modes are rotated within their span until mass and stiffness of the modal part are diagonal, which
    changes neither the space of motions nor any result. The mass is lumped, as in the paper (section 2.1).
    """
    M = fem.lumped_mass_matrix
    if len(partition.nodes) == fem.n_nodes:
        return _all_nodal(fem, partition)
    rigid = mass_normalised(fem.rigid_modes, M)
    modes = _modes_to(fem, M, rigid, f_cut, progress)
    shapes = np.hstack([rigid, modes.vectors])
    shapes.reshape(fem.n_nodes, 3, -1)[partition.nodes] = 0.0
    omega_squared, combination = scipy.linalg.eigh(shapes.T @ (fem.stiffness @ shapes), shapes.T @ (M @ shapes))
    # Region I's part of a rigid motion is a shape of its own, for it strains the elements between the regions.
    outside = np.delete(np.arange(fem.n_nodes), partition.nodes)
    rigid_outside = np.zeros((fem.n_nodes, 3, 6))
    rigid_outside[outside] = fem.rigid_modes.reshape(-1, 3, 6)[outside]
    shapes = shapes @ combination
    omega = np.sqrt(np.maximum(omega_squared, 0.0))
    return ReducedBasis(
        name="free",
        shapes=shapes,
        omega=omega,
        labels=tuple(f"region I shape {w / (2 * np.pi):.1f} Hz" for w in omega),
        rigid=shapes.T @ (M @ rigid_outside.reshape(-1, 6)),
        nodal=partition.nodes,
        mass="lumped",
        left_out=(f"elastic modes above {f_cut:.6g} Hz, outside the impact region",),
    )


def _all_nodal(fem: FEModel, partition: Partition) -> ReducedBasis:
    """Build the basis of an impact region that covers the body: the full FE model with lumped mass."""
    return ReducedBasis(
        name="free",
        shapes=np.empty((fem.n_dofs, 0)),
        omega=np.empty(0),
        labels=(),
        rigid=np.empty((0, 6)),
        nodal=partition.nodes,
        mass="lumped",
        left_out=("all modes: the impact region covers the body",),
    )


def residual(fem: FEModel, partition: Partition, f_cut: float, progress: Progress | None = None) -> ReducedBasis:
    """Build the residual-flexibility basis: free modes up to `f_cut`, the static answer of all others at the contact.

    MacNeal (1971), Rubin (1975). The contact coordinates carry no mass; see `_with_residual_flexibility`.
    """
    rigid = mass_normalised(fem.rigid_modes, fem.mass)
    modes = _modes_to(fem, fem.mass, rigid, f_cut, progress)
    static = _static_answers(fem, partition, rigid)
    left_out = f"the dynamics, but not the static answer, of elastic modes above {f_cut:.6g} Hz"
    return _with_residual_flexibility("residual", fem, partition, rigid, modes, static, (left_out,))


def contact_adapted(fem: FEModel, partition: Partition, f_cut: float, progress: Progress | None = None) -> ReducedBasis:
    """Build the contact-adapted basis: Krylov vectors of the contact's load, and the residual flexibility of the rest.

    Lanczos on (K + s M)^-1 M with s = (pi f_cut)^2, started from the answer to a uniform pressure on the patch, then
    Rayleigh-Ritz. It grows until the patch's mobility below `f_cut` has settled; what that load cannot excite is never
    computed (method.md, section 2). Ritz pairs far above `f_cut` are left to the residual flexibility.
    """
    rigid = mass_normalised(fem.rigid_modes, fem.mass)
    omega_cut = 2 * np.pi * f_cut
    shift = (omega_cut / 2) ** 2
    load = pressure(fem, partition)
    with ThreadPoolExecutor(1) as pool:
        # SuperLU lets other threads run: the static answers take the second core while the Krylov vectors grow.
        static_answers = pool.submit(_static_answers, fem, partition, rigid)
        solve = Factorisation(fem.stiffness + shift * fem.mass).solve
        krylov = BlockKrylov(solve, fem.mass, shift, rigid, load[:, None])
        krylov.grow(2 * _GROWTH)
        static = static_answers.result()
    band = omega_cut * (_MEMORY + 1j * np.linspace(0.0, 1.0, _BAND_SAMPLES + 1)[1:])
    rest = load @ (static @ (patch_rows(fem, partition) @ load)) - np.sum((load @ rigid) ** 2) / band**2
    mobility, growing = np.zeros(_BAND_SAMPLES, dtype=complex), True
    while growing:
        omega, combination = krylov.rayleigh_ritz(fem.stiffness)
        keep = omega < _DROP_ABOVE * omega_cut
        participation = (load @ krylov.vectors) @ combination[:, keep]
        previous, mobility = mobility, band * _dynamic_receptance(omega[keep], participation, band)
        change = float(np.linalg.norm(mobility - previous) / np.linalg.norm(mobility + band * rest))
        growing = change > _SETTLED and krylov.grow(krylov.size + _GROWTH)
        if progress:
            progress(min(1.0, _SETTLED / change) if change else 1.0)
    if not (omega < omega_cut).any():
        raise _no_mode_below(fem, f_cut)
    pairs = RitzPairs(krylov.vectors @ combination[:, keep], omega[keep])
    left_out = (
        f"modes below {f_cut:.6g} Hz that a load on the contact patch does not excite",
        f"the dynamics, but not the static answer, of motion above {_DROP_ABOVE * f_cut:.6g} Hz",
    )
    return _with_residual_flexibility("contact-adapted", fem, partition, rigid, pairs, static, left_out)


def _dynamic_receptance(omega: Array, participation: Array, s: Array) -> Array:
    """Receptance of a load at Laplace variables s beyond its static answer, (len(s),) [m/N]."""
    return (1 / (omega**2 + s[:, None] ** 2) - 1 / omega**2) @ participation**2


def pressure(fem: FEModel, partition: Partition) -> Array:
    """(3n,) load of a unit resultant, a uniform pressure on the contact patch along its direction."""
    facets = partition.facets
    a, b, c = (fem.points[facets[:, i]] for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    # A quadratic triangle passes a uniform pressure to its mid-side nodes alone.
    loaded = facets[:, -3:]
    share = np.bincount(loaded.ravel(), np.repeat(area, 3), minlength=fem.n_nodes)
    return np.outer(share / share.sum(), partition.direction).ravel()


def _modes_to(fem: FEModel, M: sp.csr_matrix, rigid: Array, f_cut: float, progress: Progress | None) -> RitzPairs:
    modes = eigenmodes(fem.stiffness, M, rigid, 2 * np.pi * f_cut, progress=progress)
    if not len(modes.omega):
        raise _no_mode_below(fem, f_cut)
    return modes


def _no_mode_below(fem: FEModel, f_cut: float) -> FrequencyRangeError:
    size = np.ptp(fem.points, axis=0).max()
    return FrequencyRangeError(
        f"f_cut: no elastic mode lies below {f_cut:.6g} Hz. The body is {size:.4g} m long, longitudinal waves cross it "
        f"{fem.material.bar_wave_speed / (2 * size):.4g} times a second there and back; take f_cut well above that"
    )


def patch_rows(fem: FEModel, partition: Partition) -> sp.csr_matrix:
    """(np, 3n) rows G: displacement of each patch node along the patch's direction."""
    nodes = partition.patch_nodes
    columns = (3 * nodes[:, None] + np.arange(3)).ravel()
    rows = np.repeat(np.arange(len(nodes)), 3)
    return sp.csr_matrix((np.tile(partition.direction, len(nodes)), (rows, columns)), shape=(len(nodes), fem.n_dofs))


def _static_answers(fem: FEModel, partition: Partition, rigid: Array) -> Array:
    """Elastic answers of the free body to unit loads on the patch nodes, (3n, np) [m/N]."""
    flexibility = FreeBodyFlexibility(fem.stiffness, fem.mass, rigid)
    return flexibility(patch_rows(fem, partition).T.toarray())


def _with_residual_flexibility(
    name: str,
    fem: FEModel,
    partition: Partition,
    rigid: Array,
    pairs: RitzPairs,
    static: Array,
    left_out: tuple[str, ...],
) -> ReducedBasis:
    """Basis of rigid motion and `pairs`, with the flexibility F = G F_e G' - sum_k (G phi_k)(G phi_k)' / w_k^2."""
    G = patch_rows(fem, partition)
    at_patch = G @ pairs.vectors
    F = G @ static - (at_patch / pairs.omega**2) @ at_patch.T
    return ReducedBasis(
        name=name,
        shapes=np.hstack([rigid, pairs.vectors]),
        omega=np.r_[np.zeros(6), pairs.omega],
        labels=("rigid",) * 6 + tuple(f"elastic {w / (2 * np.pi):.1f} Hz" for w in pairs.omega),
        rigid=np.vstack([rigid.T @ (fem.mass @ fem.rigid_modes), np.zeros((len(pairs.omega), 6))]),
        nodal=np.empty(0, dtype=np.int64),
        mass="consistent",
        flexibility=(F + F.T) / 2,
        left_out=left_out,
    )
