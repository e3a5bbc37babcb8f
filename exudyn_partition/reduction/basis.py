"""The bases of the partition method: from an FE model to the columns of T, u = T q (paper, eq. 13, 15).

The shapes of every basis are mass-normalised, so their mass and stiffness are diagonal. Nodal columns, which only the
paper's basis has, are unit displacements of the nodes of the impact region (paper, eq. 15).

All bases treat interfaces for joints alike. Rigid ones are tied first (`tied`). The static answer to the six resultants
of each interface is in the span of the shapes; where other shapes do not contain it, attachment modes are added.

Theory: examples/site/theory.md, "The paper's partition basis".
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from ..algebra.krylov import RitzPairs, eigenmodes, improved, orthonormal_complement
from ..algebra.sparse.flexibility import selection
from ..algebra.sparse.skin_flexibility import SkinFlexibility, check_flexibility
from ..algebra.sparse.solver import factorise
from ..errors import FrequencyRangeError, InputError, UnitsWarning
from ..fe.model import MASSES, FEModel, MassKind, node_dofs
from ..fe.partition import Partition
from ..plasticity.zone_flexibility import ZoneFlexibility
from ..support.arrays import Array
from ..support.checks import check_floats, check_indices, check_tuple, read_only, validate_choice, validate_text
from ..support.progress import Progress
from ..support.warn import warn
from .free_body import DROP_ABOVE, AdaptedSpace, FreeBody, StaticAnswers, analysis_of
from .inertia_relief import static_answers
from .loads import attached_loads, patch_rows, patch_slice

BasisName = Literal["contact-adapted", "residual", "craig-bampton", "free"]

OFF = 8e-3  # estimated relative error of a frequency that is not within a per cent: the estimate is a little low
_NAMED = 5  # most frequencies in a sentence
_ABOVE = 2.0  # times f_cut: Ritz pairs below it may be of modes below f_cut
_FAR_BELOW = 0.01  # of the frequency of longitudinal waves; impacts of compact bodies last about ten of their periods
_ROUND_OFF = 10 * np.finfo(float).eps  # of the pivots of rigid modes, by the largest stiffness over mass of a dof
_RIGID = tuple(f"rigid {motion} {axis}" for motion in ("translation", "rotation") for axis in "xyz")


@dataclass(frozen=True, eq=False)
class ReducedBasis:
    """Columns of T, and the residual flexibility of what they leave out.

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
    flexibility : (r, r) array, SkinFlexibility or None
        Residual flexibility of the rows of `patch_rows`, patch after patch [m/N]. Of many rows over which contact
        wanders it is found on demand.
    left_out : tuple of str
        What the basis leaves out, in sentences.
    shape_nodes : (k,) int array, optional
        Nodes that the rows of `shapes`, then (3k, ns), are of, ascending, those of `nodal` among them. Default: all.
    zones : tuple of ZoneFlexibility
        Residual flexibility of the plastic zones, in the order of the patches that have one.
    growth : (3n, 6) array or None
        The part of the static answer to centrifugal forces that the columns of T do not contain, by products of
        angular velocities in the order of `inertia.PAIRS` [m s2]; at the nodes of `shapes`. None if it is not known.
        It is kept in single precision.
    """

    name: str
    shapes: Array
    omega: Array
    labels: tuple[str, ...]
    rigid: Array
    nodal: Array
    mass: MassKind
    flexibility: Array | SkinFlexibility | None = None
    left_out: tuple[str, ...] = field(default=())
    shape_nodes: Array | None = None
    zones: tuple[ZoneFlexibility, ...] = ()
    growth: Array | None = None

    def __post_init__(self) -> None:
        validate_text("name", self.name)
        validate_choice("mass", self.mass, MASSES)
        check_floats("shapes", self.shapes, (None, None))
        n_dofs, n_shapes = self.shapes.shape
        check_floats("omega", self.omega, (n_shapes,))
        if (self.omega < 0).any():
            raise InputError(f"omega: expected frequencies that are not negative, got {self.omega.min()}")
        check_floats("rigid", self.rigid, (n_shapes, 6))
        if self.shape_nodes is None:
            check_indices("nodal", self.nodal, (None,), n_dofs // 3)
        else:
            check_indices("shape_nodes", self.shape_nodes, (n_dofs // 3,))
            check_indices("nodal", self.nodal, (None,))
            if (np.diff(self.shape_nodes) <= 0).any() or not np.isin(self.nodal, self.shape_nodes).all():
                raise InputError("shape_nodes: expected each node once, ascending, and those of nodal among them")
            read_only(self.shape_nodes)
        check_tuple("labels", self.labels, str)
        if len(self.labels) != n_shapes:
            raise InputError(f"labels: expected one for each of {n_shapes} shapes, got {len(self.labels)}")
        check_tuple("left_out", self.left_out, str)
        read_only(self.shapes, self.omega, self.rigid, self.nodal)
        if self.flexibility is not None:
            check_flexibility("flexibility", self.flexibility, len(self.flexibility))
        if self.growth is not None:
            check_floats("growth", self.growth, (n_dofs, 6))
            # Six digits are enough of a small displacement, and files stay small.
            object.__setattr__(self, "growth", self.growth.astype(np.float32))
            read_only(self.growth)


def free(fem: FEModel, partition: Partition, f_cut: float, progress: Progress | None = None) -> ReducedBasis:
    """Build the paper's partition basis: free modes on the non-impact region, nodes in the impact region (eq. 11-15).

    Elastic modes of the whole body up to `f_cut`, and attachment modes of its interfaces, keep only their rows in
    region I (eq. 13). Every node of region II keeps its three displacements. The rigid modes, which the paper puts into
    the frame (eq. 12), are six more columns. All shapes are combined such that their mass and stiffness are diagonal;
    this changes neither the space of motions nor any result. The mass is lumped, as in the paper (section 2.1).
    """
    nodal = _impact_region(partition)
    if len(nodal) == fem.n_nodes:
        return _all_nodal(fem, nodal)
    body = FreeBody(fem, partition, mass="lumped")
    modes = _modes_to(body, f_cut, progress)
    if not len(modes.omega):
        raise _no_mode_below(fem, f_cut)
    attached, rotating = body.of_loads(body.flexibility())
    pairs = _with_attachments(body, modes, attached)
    left_out = f"elastic modes above {f_cut:.6g} Hz"
    whole = body.model.expand @ modes.vectors
    # Rayleigh's quotient with consistent mass tells what lumping has changed.
    lumping = abs(1 - np.sqrt(np.einsum("ij,ij->j", whole, fem.mass @ whole)))
    off = _inaccurate(
        "modes whose mass the lumping moves",
        modes.omega,
        lumping,
        f_cut,
        "a finer mesh, or another basis, whose mass is consistent",
    )
    if not len(nodal):
        return ReducedBasis(
            name="free",
            shapes=body.model.expand @ np.hstack([body.rigid, pairs.vectors]),
            omega=np.r_[np.zeros(6), pairs.omega],
            labels=_pair_labels(pairs, len(modes.omega)),
            rigid=_rigid_coordinates(body, len(pairs.omega)),
            nodal=nodal,
            mass="lumped",
            left_out=(f"{left_out} (f_cut raises that)", *off),
            growth=_growth(body, pairs, rotating),
        )
    region = node_dofs(nodal)
    # The part of a rigid motion in region I is a shape, because it strains the elements between the regions.
    rigid_outside, elastic_outside = np.array(fem.rigid_modes), body.model.expand @ pairs.vectors
    rigid_outside[region] = elastic_outside[region] = 0.0
    M = fem.lumped_mass_matrix
    # If region I has few nodes, there are fewer independent motions than modes, or even than rigid motions.
    moved = orthonormal_complement(rigid_outside, M, np.empty((fem.n_dofs, 0)))
    shapes = np.hstack([moved, orthonormal_complement(elastic_outside, M, moved)])
    omega_squared, combination = np.linalg.eigh(shapes.T @ (fem.stiffness @ shapes))
    shapes = shapes @ combination
    omega = np.sqrt(np.maximum(omega_squared, 0.0))
    return ReducedBasis(
        name="free",
        shapes=shapes,
        omega=omega,
        labels=_labels("region I shape", omega),
        rigid=shapes.T @ (M @ rigid_outside),
        nodal=nodal,
        mass="lumped",
        left_out=(f"{left_out}, outside the impact region (f_cut raises that)", *off),
        growth=_growth_beyond(fem, shapes, region, body.model.expand @ rotating),
    )


def _impact_region(partition: Partition) -> Array:
    """Nodes of the paper's region II, ascending: those of the partition, and of elements that may yield.

    Raises
    ------
    InputError
        If an interface has some of the latter.
    """
    zones = [patch.plastic.nodes for patch in partition.patches if patch.plastic]
    for interface in partition.interfaces:
        if np.isin(np.concatenate([*zones, partition.nodes[:0]]), interface.nodes).any():
            raise InputError(
                f"partition: a plastic zone and interface {interface.name!r} share nodes; basis 'free' keeps those of "
                "the zone as coordinates. Make plastic_radius smaller, or take 'contact-adapted' or 'residual'"
            )
    return np.unique(np.concatenate([partition.nodes, *zones]))


def _all_nodal(fem: FEModel, nodal: Array) -> ReducedBasis:
    """Build the basis of an impact region that covers the body: the full FE model with lumped mass."""
    return ReducedBasis(
        name="free",
        shapes=np.empty((fem.n_dofs, 0)),
        omega=np.empty(0),
        labels=(),
        rigid=np.empty((0, 6)),
        nodal=nodal,
        mass="lumped",
        left_out=("all modes: the impact region covers the body",),
        growth=np.zeros((fem.n_dofs, 6)),
    )


def craig_bampton(fem: FEModel, partition: Partition, f_cut: float, progress: Progress | None = None) -> ReducedBasis:
    """Build the Craig-Bampton basis: modes with the boundary held, and its static constraint modes.

    Craig and Bampton (1968). The boundary consists of the three displacements of each patch node and the six
    coordinates of each rigid interface. For averaged interfaces and distributed loads, static answers with the boundary
    held are added. The reduced matrices are diagonalised; this changes neither the space of motions nor any result. The
    patch keeps all its displacements, with their mass, and contact is by multipliers.

    Held modes below `f_cut` alone miss frequencies of the free body below it by ten per cent and more. Answers to the
    residuals of its modes are added until all of these are within a per cent, see `_with_answers`.
    """
    body = FreeBody(fem, partition)
    model, rigid = body.model, body.rigid
    boundary = np.r_[model.column[node_dofs(partition.patch_nodes)], model.interface_columns]
    if not boundary.size or len(boundary) == model.n:
        raise InputError(
            f"basis: 'craig-bampton' needs a boundary that holds the body, contact patches or rigid interfaces, and "
            f"dofs within it; got {len(boundary)} boundary dofs of {model.n}. Take basis='contact-adapted'"
        )
    interior = np.delete(np.arange(model.n), boundary)
    K, M = model.stiffness[interior][:, interior], model.mass[interior][:, interior]
    averaged = [i for i in partition.interfaces if i.kind == "averaged"]
    loads = attached_loads(fem, averaged, partition.loads) @ model.expand
    analysis = analysis_of(K, M)
    held_factors, centrifugal = factorise(K, analysis), body.centrifugal()[interior]
    answers = held_factors.solve(
        np.hstack([-model.stiffness[interior][:, boundary].toarray(), loads[:, interior].toarray().T, centrifugal])
    )
    of_rotation = np.zeros((model.n, 6))
    of_rotation[interior], answers = answers[:, -6:], answers[:, :-6]
    none = np.empty((len(interior), 0))
    held = eigenmodes(K, M, none, 2 * np.pi * f_cut, progress=progress, analysis=analysis)
    n_held, n_boundary = len(held.omega), len(boundary)
    # Only the part of these answers that the held modes do not contain is a new motion.
    attached = orthonormal_complement(answers[:, n_boundary:], M, held.vectors)
    columns = np.zeros((model.n, n_held + n_boundary + attached.shape[1]), order="F")
    columns[interior] = np.hstack([held.vectors, answers[:, :n_boundary], attached])
    columns[boundary, n_held + np.arange(n_boundary)] = 1.0
    gram = columns.T @ (model.mass @ columns)
    omega_squared, combination = scipy.linalg.eigh(columns.T @ (model.stiffness @ columns), gram)
    # The six lowest are rigid motion with round-off; the exact one is used instead.
    combination = combination[:, 6:]
    shapes = columns @ combination
    shapes -= rigid @ ((model.mass @ rigid).T @ shapes)

    def answered(forces: Array) -> Array:
        """Answers with the boundary held, (n, k); of forces that do no work on constraint modes, those of the body."""
        found = np.zeros(forces.shape)
        found[interior] = held_factors.solve(forces[interior])
        return found

    pairs = _with_answers(body, RitzPairs(shapes, np.sqrt(omega_squared[6:])), f_cut, answered)
    if not (pairs.omega < 2 * np.pi * f_cut).any():
        raise _no_mode_below(fem, f_cut)
    # Growth leaves the boundary at rest, where joints and contact see the coordinates alone.
    growth = _rest(body, pairs, of_rotation)
    growth -= rigid @ np.linalg.lstsq(rigid[boundary], growth[boundary])[0]
    # Of each shape's mass in the held modes' span.
    share_held = np.sum(((model.mass @ columns[:, :n_held]).T @ pairs.vectors) ** 2, axis=0)
    kinds = np.where(share_held > 0.5, "fixed-interface", "constraint")
    return ReducedBasis(
        name="craig-bampton",
        shapes=model.expand @ np.hstack([rigid, pairs.vectors]),
        omega=np.r_[np.zeros(6), pairs.omega],
        labels=_RIGID + _labels(kinds, pairs.omega),
        rigid=_rigid_coordinates(body, len(pairs.omega)),
        nodal=np.empty(0, dtype=np.int64),
        mass="consistent",
        left_out=(f"elastic modes above {f_cut:.6g} Hz of the body held at its boundary (f_cut raises that)",),
        growth=model.expand @ growth,
    )


def _with_answers(body: FreeBody, pairs: RitzPairs, f_cut: float, answered: Callable[[Array], Array]) -> RitzPairs:
    """Ritz pairs of the span of `pairs` and of answers to their residuals, until those below `f_cut` are accurate.

    An estimate says which are not: what the answers to all residuals change, see `krylov.improved`.

    Parameters
    ----------
    body : FreeBody
    pairs : RitzPairs
        Elastic ones.
    f_cut : float
        [Hz]
    answered : callable
        Elastic answers to forces that do no work on the pairs, (n, k) array -> (n, k) array, up to rigid motion.
    """
    K, M, omega_cut = body.model.stiffness, body.model.mass, 2 * np.pi * f_cut
    while True:
        near = pairs.omega < _ABOVE * omega_cut
        if not near.any():
            return pairs
        vectors, omega = pairs.vectors[:, near], pairs.omega[near]
        answers = answered(K @ vectors - (M @ vectors) * omega**2)
        more = orthonormal_complement(answers, M, np.hstack([body.rigid, vectors]))
        moved = K @ more
        better = improved(omega, vectors.T @ moved, more.T @ moved)
        off = (better < omega_cut) & (abs(1 - better / omega) > OFF)
        if not off.any():
            return pairs
        more = orthonormal_complement(answers[:, off], M, np.hstack([body.rigid, pairs.vectors]))
        moved = K @ more
        coupling = pairs.vectors.T @ moved
        omega_squared, combination = np.linalg.eigh(
            np.block([[np.diag(pairs.omega**2), coupling], [coupling.T, more.T @ moved]])
        )
        pairs = RitzPairs(np.hstack([pairs.vectors, more]) @ combination, np.sqrt(omega_squared))


def residual(fem: FEModel, partition: Partition, f_cut: float, progress: Progress | None = None) -> ReducedBasis:
    """Build the residual-flexibility basis: free modes up to `f_cut`, the static answer of all others at the contact.

    MacNeal (1971), Rubin (1975). The contact coordinates carry no mass; see `_with_residual_flexibility`. Without a
    mode below `f_cut`, the body is rigid motion and the static answer.
    """
    body = FreeBody(fem, partition)
    modes = _modes_to(body, f_cut, progress)
    static = body.static_answers()
    pairs = _with_attachments(body, modes, static.of_attached)
    left_out = f"the dynamics, but not the static answer, of elastic modes above {f_cut:.6g} Hz (f_cut raises that)"
    return _with_residual_flexibility("residual", body, pairs, len(modes.omega), static, (left_out,))


def contact_adapted(fem: FEModel, partition: Partition, f_cut: float, progress: Progress | None = None) -> ReducedBasis:
    """Build the contact-adapted basis: Krylov vectors of the scene's loads, and the residual flexibility of the rest.

    Loads are uniform tractions on each patch, a twist of patches with all axes, and the resultants of each interface.
    Over a large patch many cells have uniform tractions; these are mixed to few loads, see `loads.leading`.
    The basis begins with the static answers to them. Vectors of block Lanczos on (K + s M)^-1 M with s = (pi f_cut)^2,
    from the same loads, follow; then comes Rayleigh-Ritz. Without the static answers, the Krylov vectors would find the
    lowest modes last, and the residual flexibility would until then contain their large compliance.

    The basis grows until the mobility of each load below `f_cut` has converged. Modes that the loads do not excite are
    never computed. Ritz pairs far above `f_cut` are left to the residual flexibility. In a
    compact body that moves slowly, these are all pairs.
    """
    space = AdaptedSpace(fem, partition, f_cut)
    space.grow(f_cut, progress)
    return adapted_basis(space, f_cut)


def adapted_basis(space: AdaptedSpace, f_cut: float, remedy: str = "f_cut raises that") -> ReducedBasis:
    """Contact-adapted basis of the Ritz pairs below 1.5 `f_cut` of a space that was grown to `f_cut` or further.

    `remedy` tells the user how to keep more.
    """
    modes = space.pairs(f_cut)
    pairs = _with_attachments(space, modes, space.static.of_attached)
    left_out = (
        f"modes below {f_cut:.6g} Hz that loads on patches and interfaces do not excite, or hardly (basis='residual' "
        "keeps them)",
        *_inaccurate(
            "modes that loads hardly excite",
            modes.omega,
            space.excess(f_cut),
            f_cut,
            "basis='residual' has them right",
        ),
        f"the dynamics, but not the static answer, of motion above {DROP_ABOVE * f_cut:.6g} Hz, {DROP_ABOVE:g} f_cut "
        f"({remedy})",
    )
    return _with_residual_flexibility("contact-adapted", space, pairs, len(modes.omega), space.static, left_out)


def _inaccurate(what: str, omega: Array, error: Array, f_cut: float, remedy: str) -> tuple[str, ...]:
    """Say which frequencies below `f_cut` are not within a per cent, by estimates of their relative errors, (k,)."""
    off = np.flatnonzero((omega < 2 * np.pi * f_cut) & (error > OFF))
    if not len(off):
        return ()
    named = ", ".join(f"{omega[i] / (2 * np.pi):.5g} Hz by about {100 * error[i]:.1f} %" for i in off[:_NAMED])
    more = f" and {len(off) - _NAMED} more" if len(off) > _NAMED else ""
    return (f"accurate frequencies of {what}: off are {named}{more} ({remedy})",)


def _modes_to(body: FreeBody, f_cut: float, progress: Progress | None) -> RitzPairs:
    model = body.model
    lowest = least_frequency(model.stiffness, model.mass)
    if f_cut < lowest:
        raise FrequencyRangeError(
            f"f_cut: expected at least {lowest:.3g} Hz, below which round-off hides modes among the rigid ones, got "
            f"{f_cut:.6g} Hz. Take basis='contact-adapted', or a higher f_cut"
        )
    band = 2 * np.pi * f_cut
    return eigenmodes(model.stiffness, model.mass, body.rigid, band, progress=progress, analysis=body.analysis)


def least_frequency(stiffness: sp.csr_matrix, mass: sp.csr_matrix) -> float:
    """Frequency [Hz] below which round-off of a free body's matrices hides modes among the rigid ones."""
    stiffest = (stiffness.diagonal() / mass.diagonal()).max()
    return float(np.sqrt(_ROUND_OFF * stiffest) / (2 * np.pi))


def _no_mode_below(fem: FEModel, f_cut: float) -> FrequencyRangeError:
    return FrequencyRangeError(
        f"f_cut: no elastic mode lies below {f_cut:.6g} Hz, {_waves(fem)}; take f_cut well above that, or "
        "basis='contact-adapted' or 'residual', which take such a body as rigid but for its contact"
    )


def warn_if_far_below(fem: FEModel, f_cut: float) -> None:
    """Warn (`UnitsWarning`) of a truncation frequency far below all modes of a body."""
    if f_cut < _FAR_BELOW * _wave_frequency(fem):
        warn(
            f"f_cut: no elastic mode lies anywhere near {f_cut:.6g} Hz, {_waves(fem)}. The body is rigid but for its "
            "contact; if that is not meant, give f_cut in Hz, not in kHz",
            UnitsWarning,
        )


def _wave_frequency(fem: FEModel) -> float:
    return float(fem.material.bar_wave_speed / (2 * np.ptp(fem.points, axis=0).max()))


def _waves(fem: FEModel) -> str:
    size = np.ptp(fem.points, axis=0).max()
    return (
        f"for the body is {size:.4g} m long and longitudinal waves cross it {_wave_frequency(fem):.4g} times a second "
        "there and back"
    )


def _with_attachments(body: FreeBody, pairs: RitzPairs, static: Array) -> RitzPairs:
    """Ritz pairs of the span of `pairs` and of `static`, (nz, 6 i + l), the static answers to `attached_loads`.

    The part of these answers that the pairs do not contain becomes attachment modes, with their mass. Their frequencies
    are far above the others.
    """
    if not static.shape[1]:
        return pairs
    model = body.model
    more = orthonormal_complement(static, model.mass, np.hstack([body.rigid, pairs.vectors]))
    vectors = np.hstack([pairs.vectors, more])
    omega_squared, combination = np.linalg.eigh(vectors.T @ (model.stiffness @ vectors))
    return RitzPairs(vectors @ combination, np.sqrt(omega_squared))


def residual_flexibility(body: FreeBody, pairs: RitzPairs, static: StaticAnswers) -> Array | SkinFlexibility:
    """F = G F_e G' - sum_k (G phi_k)(G phi_k)' / w_k^2 of all rows of `patch_rows` (Rubin 1975)."""
    G = patch_rows(body.fem, body.partition) @ body.model.expand
    at_patch = G @ pairs.vectors
    if isinstance(static.at_patches, SkinFlexibility):
        return static.at_patches.plus(at_patch, -(pairs.omega**-2.0))
    F = static.at_patches - (at_patch / pairs.omega**2) @ at_patch.T
    flexibility: Array = (F + F.T) / 2
    return flexibility


def _with_residual_flexibility(
    name: str, body: FreeBody, pairs: RitzPairs, n_elastic: int, static: StaticAnswers, left_out: tuple[str, ...]
) -> ReducedBasis:
    """Basis of rigid motion and `pairs`, with the residual flexibility of all other motion at the contact."""
    if not len(pairs.omega):
        left_out = ("all vibration: the body is rigid but for the static answer of its contact", *left_out)
    if any(patch.axes == "normal" for patch in body.partition.patches):
        left_out += ("tangential contact rows: contact is frictionless (axes='xyz' of the partition keeps them)",)
    G = patch_rows(body.fem, body.partition) @ body.model.expand
    at_patches, zones = G @ pairs.vectors, []
    for number, flexibility in static.zones.items():
        at_zone = pairs.vectors[body.zone_dofs(body.partition.patches[number])]
        zones.append(flexibility.without(at_zone, at_patches[patch_slice(body.partition, number)], pairs.omega))
    return ReducedBasis(
        name=name,
        shapes=body.model.expand @ np.hstack([body.rigid, pairs.vectors]),
        omega=np.r_[np.zeros(6), pairs.omega],
        labels=_pair_labels(pairs, n_elastic),
        rigid=_rigid_coordinates(body, len(pairs.omega)),
        nodal=np.empty(0, dtype=np.int64),
        mass="consistent",
        flexibility=residual_flexibility(body, pairs, static),
        left_out=left_out,
        zones=tuple(zones),
        growth=_growth(body, pairs, static.of_rotation),
    )


def _growth(body: FreeBody, pairs: RitzPairs, answers: Array) -> Array:
    """The part, (3n, 6), of static answers to centrifugal forces, (nz, 6), that rigid motion and pairs do not contain.

    It is orthogonal to them by the stiffness, as the residual flexibility is. So it moves no interface, and forces on
    kept coordinates do no work on it.
    """
    rest, rigid = _rest(body, pairs, answers), body.rigid
    return np.asarray(body.model.expand @ (rest - rigid @ (rigid.T @ (body.model.mass @ rest))))


def _rest(body: FreeBody, pairs: RitzPairs, answers: Array) -> Array:
    """Static answers without what the pairs contain by the stiffness, (nz, k); rigid motion is arbitrary."""
    rest: Array = answers - pairs.vectors @ (
        (pairs.vectors.T @ (body.model.stiffness @ answers)) / pairs.omega[:, None] ** 2
    )
    return rest


def _growth_beyond(fem: FEModel, shapes: Array, region: Array, answers: Array) -> Array:
    """The same of answers at all nodes, (3n, 6), for shapes, (3n, ns), and dofs that stay, (k,)."""
    K = fem.stiffness
    columns = sp.hstack([sp.csr_matrix(shapes), selection(region, fem.n_dofs).T], format="csr")
    M = columns.T @ fem.lumped_mass_matrix @ columns
    outside = np.array(fem.rigid_modes)
    outside[region] = 0.0
    rigid = np.vstack([shapes.T @ (fem.lumped_mass_matrix @ outside), fem.rigid_modes[region]])
    kept: Array = columns @ static_answers(columns.T @ K @ columns, M, rigid, columns.T @ (K @ answers))
    return answers - kept


def _rigid_coordinates(body: FreeBody, n_elastic: int) -> Array:
    return np.vstack([body.rigid.T @ (body.model.mass @ body.model.rigid_modes), np.zeros((n_elastic, 6))])


def _pair_labels(pairs: RitzPairs, n_elastic: int) -> tuple[str, ...]:
    """Labels of rigid motion and of pairs of `_with_attachments`; the first pairs are the elastic modes."""
    return _RIGID + _labels(np.where(np.arange(len(pairs.omega)) < n_elastic, "elastic", "attachment"), pairs.omega)


def _labels(kinds: str | Array, omega: Array) -> tuple[str, ...]:
    kinds = np.broadcast_to(kinds, omega.shape)
    return tuple(f"{kind} {w / (2 * np.pi):.1f} Hz" for kind, w in zip(kinds, omega, strict=True))
