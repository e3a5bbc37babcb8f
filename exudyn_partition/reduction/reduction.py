"""From an FE model to a reduced body: at a truncation frequency, or to a tolerance of its impact.

Theory: examples/site/theory.md, "Residual flexibility".
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypedDict

import numpy as np
import scipy.sparse as sp

from ..algebra.blas_threads import one_blas_thread
from ..algebra.coulomb import Coulomb, friction_of
from ..errors import FrequencyRangeError, InputError, MeshQualityWarning
from ..fe.model import FEModel, MassKind, node_dofs
from ..fe.partition import Partition, check_one_line, number_of_patch
from ..fe.patches import Patch
from ..plasticity.dilatation import with_free_zones
from ..support.cache import cached
from ..support.checks import validate_callable, validate_flag, validate_positive, validate_type
from ..support.plugins import added_choice
from ..support.progress import Progress, shown
from ..support.spelling import spelled
from ..support.warn import warn
from . import basis as bases
from .basis import BasisName, ReducedBasis
from .body import FILE, ReducedBody
from .estimate import Estimate, Sliding, grow_to_tolerance, warn_if_missed
from .free_body import AdaptedSpace
from .inertia import InertiaIntegrals
from .memory import watched
from .stress_states import stress_states, with_stress_loads

Models = Sequence[tuple[FEModel, Partition]]

_LOG = logging.getLogger(__name__)

_SPEED = 1.0  # m/s
_FASTEST = 1e30  # m/s: bound of the speed, so that numbers stay finite
_OVERSIZE = 2  # size of Netgen's largest elements, by maxh

BasisFunction = Callable[[FEModel, Partition, float, Progress | None], ReducedBasis]
BASES: dict[BasisName, BasisFunction] = {
    "free": bases.free,
    "craig-bampton": bases.craig_bampton,
    "residual": bases.residual,
    "contact-adapted": bases.contact_adapted,
}


@spelled
def reduce(
    fem: FEModel,
    partition: Partition | None = None,
    *,
    skin: bool = False,
    f_cut: float | None = None,
    tolerance: float | None = None,
    basis: BasisName = "contact-adapted",
    speed: float | None = None,
    duration: float | None = None,
    geometric_stiffness: bool = False,
    progress: Progress | None = None,
    cache: bool | str | Path = False,
) -> ReducedBody:
    """Reduce a free body, to a truncation frequency or to a tolerance.

    Parameters
    ----------
    fem : FEModel
    partition : Partition, optional
        Impact region, contact patches and interfaces. Needed unless `skin`.
    skin : bool
        Whether the whole skin is a contact patch, as by `Partition.skin(fem, partition)`: nobody needs to know where
        the body will touch. `CreatePartitionContact(mbs, bodies)` then needs nothing but the bodies.
    f_cut : float, optional
        Truncation frequency [Hz]: motion below it is kept. By the paper (section 5.2) it is twice the highest frequency
        of the response, see `truncation_frequency`. If all modes lie above it, the body is rigid except at its contact.
    tolerance : float, optional
        Instead of `f_cut`: the contact-adapted basis grows until the estimated errors of force and velocity are below
        the tolerance. They are those of an impact on a rigid plane, and on a rigid sphere too if the patch is flat; see
        `body.estimate` and module `estimate`. For two bodies that hit each other use `reduce_pair`.
    basis : {"contact-adapted", "residual", "craig-bampton", "free"}
        "free" is that of the paper. "craig-bampton" keeps the nodes of the patch as boundary, with their static answer.
        "residual" keeps all modes below `f_cut`, and the residual flexibility of the contact. "contact-adapted" keeps
        only the motion that contacts and interfaces excite, with the same residual flexibility. Modes below `f_cut` are
        within a per cent of their frequency, or `body.left_out` names them.
    speed, duration : float, optional
        Speed and duration of the impact for `tolerance` [m/s], [s]; see `reduce_pair`. Default of the speed: 1 m/s.
    geometric_stiffness : bool
        Whether tension and rotation stiffen the body, and compression softens it: see `ReducedBody.geometric_stiffness`
        and module `geometric_stiffness`. The basis then also has static answers to centrifugal loads, and to the
        inertia of what forces on patches move. In compact bodies these are fast, so that explicit steps are shorter.
    progress : callable, optional
        Called with the share done, 0 to 1. Default: a bar on the terminal, if it takes more than two seconds.
    cache : bool or path
        Whether to keep the body for the next time that the same FE model is reduced in the same way. True: in the
        folder that the environment variable EXUDYN_PARTITION_CACHE names, or in the user's folder for caches. A path:
        in that folder. The library never deletes these files; you may, at any time.

    Returns
    -------
    ReducedBody

    Raises
    ------
    FrequencyRangeError
        If the mesh does not resolve `f_cut`; or no elastic mode lies below it, with basis "free" or "craig-bampton".
    InputError
        If another argument is out of range, both or none of `f_cut` and `tolerance` are given, there is neither a
        partition nor a skin, or the impact region holds every node and the basis is not "free".
    MemoryLimitError
        If there is too little memory, by an estimate before the work or during it.

    Warns
    -----
    ToleranceWarning
        If the mesh is too coarse for the tolerance; the best body is returned. Or if a flat patch rings on a plane with
        any basis; the body is then one for curved partners.
    UnitsWarning
        If `f_cut` is so far below all modes that it may have been given in kHz.
    MeshQualityWarning
        If elements in a wall are so long that bending waves of `f_cut` have a frequency a quarter too high.
    CacheWarning
        If a file in the cache is damaged, or the folder cannot be written; the body is computed.
    MemoryWarning
        If the reduction needs more memory than is free, by an estimate.
    """
    partition = _partition_of(fem, partition, skin)
    _basis_function(basis)
    _validate_progress(progress)
    if validate_flag("geometric_stiffness", geometric_stiffness):
        fem.need_cells("geometric stiffness")
    if len(partition.nodes) == fem.n_nodes and basis != "free":
        raise InputError(
            f"partition: the impact region holds all {fem.n_nodes} nodes, so that nothing is left for basis {basis!r}. "
            "Take a smaller radius, or basis='free', which is then the full FE model"
        )
    if basis == "craig-bampton" and any(patch.plastic for patch in partition.patches):
        raise InputError(
            f"basis: {basis!r} knows no plastic zones, and the material has hardening. Take 'contact-adapted', "
            "'residual' or 'free', or a material without hardening"
        )
    if (f_cut is None) == (tolerance is None):
        raise InputError(
            f"f_cut, tolerance: expected one of them, got f_cut={f_cut!r} and tolerance={tolerance!r}. f_cut [Hz] "
            "truncates, tolerance=1e-2 grows the basis until its estimated error is below 1 %"
        )
    # Everything that changes the body must be in `inputs`.
    inputs: dict[str, object] = {"fem": fem, "partition": partition, "basis": basis}
    if geometric_stiffness:
        inputs["geometric_stiffness"] = True
    stressed: MassKind | None = ("lumped" if basis == "free" else "consistent") if geometric_stiffness else None
    models = [(fem, partition)]
    if f_cut is not None:
        for name, value in (("speed", speed), ("duration", duration)):
            if value is not None:
                raise InputError(
                    f"{name}: {value!r} has no effect beside f_cut; it belongs to the impact for a tolerance"
                )
        f_cut = _resolved(fem, f_cut)
        inputs |= {"f_cut": f_cut}
        with shown(progress, "reduce") as report:
            truncated = partial(_reduce, f_cut=f_cut, basis=basis, progress=report)
            body = cached(cache, inputs, FILE, lambda: _made(models, truncated, stressed)[0])
        if body.n_dofs == body.rigid.shape[1]:
            bases.warn_if_far_below(fem, f_cut)
    else:
        if basis != "contact-adapted":
            raise InputError(f"tolerance: only basis 'contact-adapted' grows to a tolerance, got {basis!r}; give f_cut")
        for number in range(len(partition.patches)):
            check_one_line(partition, number, "tolerance")
        options = _impact_options(tolerance, _SPEED if speed is None else speed, duration)
        patches = [[i] for i in range(len(partition.patches))]
        if not patches:
            raise InputError("tolerance: the partition has no contact patch whose force could be judged; give f_cut")
        inputs |= options
        with shown(progress, "reduce to a tolerance") as report:
            grown = partial(reduce_to_tolerance, patches=patches, options=options, progress=report)
            (body,) = cached(cache, inputs, FILE, lambda: _made(models, grown, stressed))
        warn_if_missed(body.estimate)
    return body


@spelled
def reduce_pair(
    slave: tuple[FEModel, Partition],
    master: tuple[FEModel, Partition],
    *,
    tolerance: float,
    speed: float,
    duration: float | None = None,
    patches: tuple[int | str | None, int | str | None] = (None, None),
    friction: float | Coulomb | None = None,
    tangential_speed: float | None = None,
    geometric_stiffness: bool = False,
    progress: Progress | None = None,
    cache: bool | str | Path = False,
) -> tuple[ReducedBody, ReducedBody]:
    """Reduce two bodies so far that the error of their impact on each other is below a tolerance.

    How fine a body must be depends on its partner: a plate yields within microseconds, a wall does not. The spaces of
    both bodies grow together, and their impact decides on one truncation for both; see module `estimate`.

    Parameters
    ----------
    slave, master : (FEModel, Partition)
        Placed where they touch, or apart along their line of contact.
    tolerance : float
        Of contact force and velocities: relative error in the L2 norm over `duration`.
    speed : float
        Approach speed along the line of contact [m/s].
    duration : float, optional
        Duration over which errors are measured [s]. Default: 30 crossings of a longitudinal wave through the larger
        body.
    patches : (int or str, int or str), optional
        Which patches meet, if a body has several.
    friction : float or Coulomb, optional
        With it the impact is oblique, and the tangential force is within the tolerance too. Patches need axes="xyz".
    tangential_speed : float, optional
        Speed of the slave across the line of contact [m/s]; only with friction, and needed there.
    geometric_stiffness, progress, cache :
        As for `reduce`.

    Returns
    -------
    (ReducedBody, ReducedBody)
        Both with the same `estimate`.

    Raises
    ------
    InputError, EmptyRegionError, PenetrationError, MemoryLimitError

    Warns
    -----
    ToleranceWarning, CacheWarning, MemoryWarning
        As `reduce`.
    """
    for name, model in (("slave", slave), ("master", master)):
        if not isinstance(model, tuple | list) or len(model) != 2:
            raise InputError(
                f"{name}: expected (FEModel, Partition), got {type(model).__name__}; call "
                "reduce_pair((fem, partition), (fem, partition), ...)"
            )
        _validate_partition(*model)
    _validate_progress(progress)
    if not isinstance(patches, tuple | list) or len(patches) != 2:
        raise InputError(f"patches: expected the slave's and the master's, two names or numbers, got {patches!r}")
    numbers = [
        number_of_patch(partition, key, "patches") for (_, partition), key in zip((slave, master), patches, strict=True)
    ]
    for (_, partition), number in zip((slave, master), numbers, strict=True):
        check_one_line(partition, number, "patches")
    options = _impact_options(tolerance, speed, duration)
    models = [slave, master]
    sliding = _sliding(friction, tangential_speed, [m[1].patches[i] for m, i in zip(models, numbers, strict=True)])
    if sliding is not None:
        options["sliding"] = sliding
    inputs = {"slave": slave, "master": master, "patches": tuple(numbers), **options}
    if validate_flag("geometric_stiffness", geometric_stiffness):
        inputs["geometric_stiffness"] = True
        for fem, _ in models:
            fem.need_cells("geometric stiffness")
    with shown(progress, "reduce a pair") as report:
        grown = partial(reduce_to_tolerance, patches=[numbers], options=options, progress=report)
        first, second = cached(
            cache, inputs, FILE, lambda: _made(models, grown, "consistent" if geometric_stiffness else None)
        )
    warn_if_missed(first.estimate)
    return first, second


def _made(
    models: Models, make: Callable[[Models], tuple[ReducedBody, ...]], stressed: MassKind | None
) -> tuple[ReducedBody, ...]:
    """Bodies that `make` reduces; with geometric stiffness for their kind of mass, if there is one."""
    if stressed is None:
        return make(models)
    begin = time.perf_counter()
    loaded = [(fem, *with_stress_loads(fem, partition, stressed)) for fem, partition in models]
    bodies = make([(fem, partition) for fem, partition, *_ in loaded])
    with one_blas_thread():
        found = [
            stress_states(fem, body, n_loads, of_patches)
            for (fem, _, n_loads, of_patches), body in zip(loaded, bodies, strict=True)
        ]
    share = (time.perf_counter() - begin) / len(bodies)
    return tuple(
        replace(body, partition=partition, stiffening=stiffening, reduce_s=share)
        for body, (_, partition), stiffening in zip(bodies, models, found, strict=True)
    )


def _validate_progress(progress: Progress | None) -> None:
    if progress is not None:
        validate_callable("progress", progress, "a function of the share done, 0 to 1")


def _partition_of(fem: FEModel, partition: Partition | None, skin: bool) -> Partition:
    """The partition that a user gave, and the skin if he asked for it."""
    if validate_flag("skin", skin):
        return Partition.skin(fem, partition)
    if partition is None:
        raise InputError(
            "partition: expected one, as of Partition.ball(), or skin=True for contact anywhere on the body, got None"
        )
    _validate_partition(fem, partition)
    return partition


def _validate_partition(fem: FEModel, partition: Partition) -> None:
    validate_type("fem", fem, FEModel, "fe_model()")
    validate_type("partition", partition, Partition, "Partition.ball()")
    partition.check_mesh(fem)


def _resolved(fem: FEModel, f_cut: float) -> float:
    f_cut = validate_positive("f_cut", f_cut, "Hz")
    if f_cut > fem.resolved_frequency:
        wall, resolved = fem.weakest_wall, fem.resolved_frequency
        wanted, advice = min(wall.element_for(f_cut), fem.max_size * fem.resolved_shear_frequency / f_cut), ""
        if wall.frequency <= resolved:
            what = f"bending waves of a wall of {wall.thickness:.3g} m in elements {wall.element:.3g} m long"
            advice = ". A bar struck on its end needs that too, for no contact is quite even: all bend it a little"
        else:
            what = f"four node spacings a shear wave in its largest element, of size {fem.max_size:.4g} m"
        raise FrequencyRangeError(
            f"f_cut: the mesh resolves {resolved:.4g} Hz ({what}), got {f_cut:.6g} Hz. Refine it to elements of "
            f"{wanted:.3g} m, with a maxh of about {wanted / _OVERSIZE:.2g}, or lower f_cut{advice}"
        )
    if f_cut > (wall := fem.weakest_wall).rough_frequency:
        warn(
            f"f_cut: bending waves of {f_cut:.6g} Hz come out a quarter too fast, or more, in a wall of "
            f"{wall.thickness:.3g} m in elements {wall.element:.3g} m long; up to {wall.rough_frequency:.3g} Hz they "
            f"are nearer, and up to {wall.accurate_frequency:.3g} Hz within 8 %. Take a smaller maxh, or lower f_cut",
            MeshQualityWarning,
        )
    return f_cut


class _Oblique(TypedDict, total=False):
    sliding: Sliding


class ImpactOptions(_Oblique):
    """The impact that a tolerance is for: relative error, speed [m/s], duration [s] or None."""

    tolerance: float
    speed: float
    duration: float | None


def _sliding(friction: float | Coulomb | None, speed: float | None, patches: Sequence[Patch]) -> Sliding | None:
    """What makes an impact oblique, or None."""
    coulomb = friction_of(friction)
    if coulomb is None:
        if speed is not None:
            raise InputError("tangential_speed: has no effect without friction; give friction, or leave it out")
        return None
    if speed is None:
        raise InputError("tangential_speed: friction needs the speed across the line of contact [m/s]")
    if any(patch.axes != "xyz" for patch in patches):
        raise InputError("friction: needs patches that yield in all directions; make them with axes='xyz'")
    speed = validate_positive("tangential_speed", speed, "m/s")
    if not 1 / _FASTEST < speed < _FASTEST:
        raise InputError(f"tangential_speed: expected {1 / _FASTEST:g} to {_FASTEST:g} m/s, got {speed!r}")
    return Sliding(coulomb, speed)


def _impact_options(tolerance: float | None, speed: float, duration: float | None) -> ImpactOptions:
    tolerance = validate_positive("tolerance", tolerance)
    if tolerance >= 1:
        raise InputError(f"tolerance: expected a relative error below 1, such as 0.01, got {tolerance!r}")
    speed = validate_positive("speed", speed, "m/s")
    if not 1 / _FASTEST < speed < _FASTEST:
        raise InputError(f"speed: expected {1 / _FASTEST:g} to {_FASTEST:g} m/s, got {speed!r}")
    return {
        "tolerance": tolerance,
        "speed": speed,
        "duration": None if duration is None else validate_positive("duration", duration, "s"),
    }


def _basis_function(basis: BasisName) -> BasisFunction:
    """Function of a basis: one of ours, or one that an installed package adds."""
    added = added_choice("basis", basis, BASES, "bases")
    function: BasisFunction = BASES[basis] if added is None else added
    validate_callable("basis", function, f"a function by the name {basis!r}")
    return function


def _reduce(models: Models, f_cut: float, basis: BasisName, progress: Progress | None) -> tuple[ReducedBody]:
    begin = time.perf_counter()
    ((fem, partition),) = models
    with watched([(fem, partition)], basis), one_blas_thread():
        fem = with_free_zones(fem, partition)
        reduced = _basis_function(basis)(fem, partition, f_cut, progress)
        return (_body(fem, partition, reduced, f_cut, begin),)


def reduce_to_tolerance(
    models: Models,
    patches: Sequence[Sequence[int]],
    options: ImpactOptions,
    progress: Progress | None = None,
) -> tuple[ReducedBody, ...]:
    """Do the work of `reduce` and `reduce_pair` for a tolerance, without warnings; see `grow_to_tolerance`."""
    begin = time.perf_counter()
    with watched(models, "contact-adapted"), one_blas_thread():
        models = [(with_free_zones(*model), model[1]) for model in models]
        return bodies_of(*grow_to_tolerance(models, patches, **options, progress=progress), begin)


def bodies_of(spaces: Sequence[AdaptedSpace], estimate: Estimate, begin: float) -> tuple[ReducedBody, ...]:
    """Bodies of what `grow_to_tolerance` returns; the work began at that time of `perf_counter` [s]."""
    f_cut = estimate.f_cut
    reduced = [bases.adapted_basis(space, f_cut, "a smaller tolerance keeps more") for space in spaces]
    bodies = [
        _body(space.fem, space.partition, r, f_cut, begin, estimate) for space, r in zip(spaces, reduced, strict=True)
    ]
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
    wall = fem.weakest_wall
    if f_cut > wall.accurate_frequency:
        said = (
            f"bending waves above {wall.accurate_frequency:.3g} Hz, in part: elements {wall.element:.3g} m long in a "
            f"wall of {wall.thickness:.3g} m make them more than 8 % too fast (a finer mesh, maxh)"
        )
        reduced = replace(reduced, left_out=(*reduced.left_out, said))
    _LOG.info("basis %r: %d shapes and %d nodes that stay", reduced.name, reduced.shapes.shape[1], len(reduced.nodal))
    # These integrals need the FE mass, so they are made here. Six products of shapes cost little compared with the
    # modes.
    shapes = reduced.shapes if len(reduced.nodal) else reduced.shapes[:, 6:]
    inertia = InertiaIntegrals.of(fem, shapes, reduced.mass, reduced.nodal)
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
        material=fem.material,
        fingerprint=fem.matrix_fingerprint,
    )


def _reduced_matrices(fem: FEModel, basis: ReducedBasis) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """T' M T and T' K T (paper, eq. 16).

    The shapes are mass-normalised. With lumped mass they have no mass in common with nodes.
    """
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
