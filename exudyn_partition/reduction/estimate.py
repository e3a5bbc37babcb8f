"""A-posteriori estimate of the error of a truncation, from the impact itself, computed with two bases.

Reduced bodies are so small that computing their impact takes a fraction of a second. So the error of a truncation at f
is measured on the impact of the scene, by comparison with the same bodies truncated at a higher f_top:

    e(f) = ||F_f - F_top|| / ||F_top|| / (1 - (f / f_top)^2)

F_f is the contact force over the whole duration, with modes up to f, the static answer of all others (residual
flexibility), and the default steps of a run (`default_step`). F_top has modes up to f_top and shorter steps, so the
estimate includes the errors of truncation and time step.

Modes above f have inertia besides their static answer. Its relative size is (w / w_k)^2 for motion at w; the sum over
the cut modes falls as f^-2 (Rubin 1975). Therefore ||F_f - F_top|| is too small by the share (f / f_top)^2 of the
error, which the denominator corrects (Richardson). The error of velocities is defined in the same way. Its norm is
the kinetic energy of the difference of the two motions, integrated over the duration, relative to that of the change in
velocity since the start.

This is an estimate and no bound. It assumes that f_top is high enough for differences to become smaller and smaller
(saturation assumption; Bank and Weiser 1985). It does not include the error of the mesh; `with_mesh_error` adds that.

Theory: examples/site/theory.md, "The error of a truncation".
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from ..algebra.coulomb import Coulomb
from ..errors import InputError, ToleranceWarning
from ..fe.material import Material
from ..fe.model import FEModel, node_dofs
from ..fe.partition import Partition
from ..prediction.modal_impact import Impact
from ..prediction.pair_impact import ImpactSide, impact_between, tangents
from ..support.arrays import Array
from ..support.checks import validate_number, validate_positive, validate_text
from ..support.progress import Progress
from ..support.warn import warn
from ..surfaces.rows import pair_surfaces
from ..surfaces.surface import Surface
from .basis import residual_flexibility
from .free_body import DROP_ABOVE, AdaptedSpace
from .loads import patch_slice

_LOG = logging.getLogger(__name__)

PLANE, SPHERE = "a rigid plane", "a rigid sphere"  # what a body alone hits
PARTNER = "the rigid surface"  # the same, if it is known
RigidGaps = Callable[[Array], Array]  # points, (k, 3) [m], to gaps, (k,) [m]

AIM = 1.5  # trusted accuracy of an estimate: it must be below the tolerance by this factor
_SETTLED = 3  # the mobilities of the richer bodies converge to this multiple of the tolerance
_CROSSINGS = 30  # default duration, in crossings of a longitudinal wave through the larger body
_SHORTEST, _LONGEST = 0.01, 1e4  # durations in crossings of the smaller and of the larger body
_FIRST = 5  # f_top, by the frequency of longitudinal waves in the smaller body
_FINER = 4  # steps of F_top for one of F_f if the impact decides on both: a sixteenth of the error


@dataclass(frozen=True)
class Estimate:
    """Estimated errors of a truncation, over the duration of an impact, relative L2; see the module's derivation.

    Parameters
    ----------
    force : float
        Error of the total contact force.
    velocity : float
        Error of the bodies' velocity fields in the kinetic-energy norm, relative to their change since the start.
    f_cut : float
        Truncation frequency of the estimate [Hz].
    f_top : float
        Truncation frequency of the richer bodies in the comparison [Hz].
    speed : float
        Approach speed of the impact [m/s].
    duration : float
        [s]
    against : str
        The partner with the largest error: "a rigid plane", "a rigid sphere", "the rigid surface" or "the other body".
    tolerance : float
        Tolerance of the user.
    limit : str
        Why the estimate is above the tolerance, and what to do; empty if it is not.
    mesh_force, mesh_velocity : float or None
        The same errors by the meshes, which are not in `force` and `velocity`; None until `with_mesh_error`.
    step : float or None
        Error of the force by the default step alone, a part of `force`; None until then.
    mean_velocity : float or None
        Error of the velocities of whole bodies, in the norm of their kinetic energy as rigid ones, relative to their
        change; None where the tolerance is for `velocity`, and a number where it is for this one.
    """

    force: float
    velocity: float
    f_cut: float
    f_top: float
    speed: float
    duration: float
    against: str
    tolerance: float
    limit: str = ""
    mesh_force: float | None = None
    mesh_velocity: float | None = None
    step: float | None = None
    mean_velocity: float | None = None

    def __post_init__(self) -> None:
        added = ("mesh_force", "mesh_velocity", "step", "mean_velocity")
        known = [name for name in added if getattr(self, name) is not None]
        for name in ("force", "velocity", "tolerance", *known):
            object.__setattr__(self, name, validate_number(name, getattr(self, name)))
            if getattr(self, name) < 0:
                raise InputError(f"{name}: expected an error that is not negative, got {getattr(self, name)}")
        for name in ("f_cut", "f_top", "speed", "duration"):
            object.__setattr__(self, name, validate_positive(name, getattr(self, name)))
        for name in ("against", "limit"):
            validate_text(name, getattr(self, name))

    @property
    def error(self) -> float:
        """The larger one of force and velocity, for which the tolerance is."""
        return max(self.force, self.velocity if self.mean_velocity is None else self.mean_velocity)

    @property
    def total(self) -> float:
        """Error of meshes, truncation and step together: the larger sum, of force or of velocity.

        Raises
        ------
        InputError
            If the error of the meshes is not known.
        """
        if self.mesh_force is None or self.mesh_velocity is None:
            raise InputError("mesh_force: the error of the meshes is not known; ep.with_mesh_error estimates it")
        return max(self.force + self.mesh_force, self.velocity + self.mesh_velocity)


@dataclass(frozen=True)
class Sliding:
    """What makes the impact of a pair oblique: friction, and the tangential speed of the first body [m/s]."""

    friction: Coulomb
    speed: float


def impacts_of(
    spaces: Sequence[AdaptedSpace],
    f_top: float,
    patches: Sequence[int],
    speed: float,
    sliding: Sliding | None = None,
    rigid: RigidGaps | None = None,
) -> dict[str, Impact]:
    """Impacts of one body on something rigid, or of two on each other, with Ritz pairs up to 1.5 `f_top`.

    The keys of the result name the partners. Two bodies are moved along their line of contact until they touch; only
    their relative velocity matters. A single body hits a rigid plane. A flat patch would meet the plane everywhere at
    once, so it first hits a rigid sphere whose Hertz contact just fills the patch. The radius of that sphere is
    (16 E* a^5 / (15 m v^2))^(1/2) for a patch of radius a (eq. 30 and `hertz.impact`). If the rigid partner is known,
    `rigid` gives the gaps to it, (k,) [m], at points, (k, 3) [m].
    """
    surfaces = [
        Surface.of(space.fem.points, space.partition.patches[i], np.zeros(3))
        for space, i in zip(spaces, patches, strict=True)
    ]
    if len(spaces) == 1:
        (surface,) = surfaces
        line, n = surface.direction, len(surface.points)
        known = rigid and {PARTNER: rigid(surface.points)}
        fem, patch = spaces[0].fem, spaces[0].partition.patches[patches[0]]
        gaps = known or _gaps_to_rigid(surface, fem, patch.material or fem.material, speed)
        directed: Sequence[sp.csr_matrix] = [-sp.kron(sp.identity(n), line[None], format="csr")]
        plain: Sequence[sp.csr_matrix] = [sp.identity(n, format="csr")]
    else:
        slave, master = surfaces
        contact = pair_surfaces(slave, master, placed_by="the points of its mesh, which are taken as they are")
        sizes = len(slave.points), len(master.points)
        gaps, line = {"the other body": contact.gap}, contact.approach
        directed, plain = contact.matrices(*sizes), contact.interpolation(*sizes)
    sides = [_side(space, f_top, i, *rows) for space, i, *rows in zip(spaces, patches, directed, plain, strict=True)]
    aside = sliding.speed * tangents(line)[0] if sliding else 0.0
    model = spaces[0].model
    velocity = spaces[0].rigid.T @ (model.mass @ (model.rigid_modes[:, :3] @ (speed * line + aside)))
    friction = None if sliding is None else sliding.friction
    first = next(iter(gaps.values()))
    impact = impact_between(sides, first, line, velocity, surfaces[0].facet_size, friction)
    return {opposite: replace(impact, gap=gap - gap.min()) for opposite, gap in gaps.items()}


def _side(space: AdaptedSpace, f_top: float, number: int, directed: sp.csr_matrix, plain: sp.csr_matrix) -> ImpactSide:
    """A body with its Ritz pairs up to 1.5 `f_top`, at these rows of a patch."""
    pairs, columns = space.pairs(f_top), patch_slice(space.partition, number)
    at_nodes = space.model.expand[node_dofs(space.partition.patches[number].nodes)]
    return ImpactSide(
        directed,
        plain,
        at_nodes @ np.hstack([space.rigid, pairs.vectors]),
        np.asarray(residual_flexibility(space, pairs, space.static)[columns, columns]),
        np.r_[np.zeros(6), pairs.omega],
    )


def _gaps_to_rigid(surface: Surface, fem: FEModel, material: Material, speed: float) -> dict[str, Array]:
    """Gaps, (np,) [m], to a rigid plane; for a flat patch also those to a rigid sphere, which stand first."""
    height = surface.points @ surface.direction
    foot = surface.points - surface.points.mean(axis=0)
    across_squared = np.sum(foot**2, axis=1) - (foot @ surface.direction) ** 2
    a_squared = across_squared.max()
    stiffness = material.plane_strain_modulus
    radius = np.sqrt(16 * stiffness * a_squared**2.5 / (15 * fem.total_mass * speed**2))
    sphere = across_squared / (2 * radius)
    plane = height.max() - height
    if plane.max() > sphere.max():
        return {PLANE: plane}
    return {SPHERE: plane + sphere, PLANE: plane}


def errors(impact: Impact, f_top: float, ladder: Array, duration: float, finer: float = 1.0) -> Array:
    """Estimated errors of force, velocity and velocity of whole bodies, (len(ladder), 3), cut at `ladder` [Hz].

    With friction, the error of the force is the larger one of the normal and of the tangential force. Steps are
    default ones over `finer`, whether the impact or the truncation asks for them.
    """
    t, force, velocity = impact.run(duration, impact.step(finer * f_top, _FINER * finer))
    parts = _parts(force)
    scale = np.linalg.norm(velocity - velocity[0])
    whole = impact.omega == 0.0
    scale_of_whole = np.linalg.norm((velocity - velocity[0])[:, whole])
    result = []
    for f in ladder:
        coarse, keep = impact.truncated(DROP_ABOVE * 2 * np.pi * f)
        at, coarse_force, coarse_velocity = coarse.run(duration, coarse.step(finer * f, finer))
        there = np.stack([np.interp(t, at, component) for component in coarse_force.T], axis=1)
        off = [np.linalg.norm(x - part) / np.linalg.norm(part) for x, part in zip(_parts(there), parts, strict=True)]
        velocity_off = -velocity
        velocity_off[:, keep] += np.stack([np.interp(t, at, v) for v in coarse_velocity.T], axis=1)
        of_whole = np.linalg.norm(velocity_off[:, whole]) / scale_of_whole
        error = max(off), np.linalg.norm(velocity_off) / scale, of_whole
        result.append(np.array(error) / (1 - (f / f_top) ** 2))
    return np.array(result)


def _parts(force: Array) -> list[Array]:
    """Normal force, (m, 1), and with friction the tangential force, (m, 2), of (m, 1) or (m, 3)."""
    return [force[:, :1], force[:, 1:]] if force.shape[1] > 1 else [force]


def grow_to_tolerance(
    models: Sequence[tuple[FEModel, Partition]],
    patches: Sequence[Sequence[int]],
    *,
    tolerance: float,
    speed: float,
    duration: float | None,
    sliding: Sliding | None = None,
    rigid: RigidGaps | None = None,
    progress: Progress | None = None,
    known: Sequence[AdaptedSpace | None] = (),
    keep: bool = False,
    f_top: float | None = None,
    whole: bool = False,
    once: bool = False,
    settled: float | None = None,
    finer: float = 1.0,
) -> tuple[list[AdaptedSpace], Estimate]:
    """Grow the spaces of one body, or of two that hit each other, until the estimate is below the tolerance.

    The spaces grow to f_top, and truncations from f_top / 32 to f_top / 2 are tried. If none is good enough, f_top is
    raised. For a single body with a flat patch there are impacts on a sphere and on a plane. If the errors on the plane
    do not fall, because the force rings, the sphere decides on the truncation; the estimate tells that on the plane.

    Parameters
    ----------
    models : sequence of (FEModel, Partition)
    patches : sequence of sequence of int
        The impacts, each with the number of the patch of every body; the largest error counts.
    tolerance, speed : float
        Tolerance relative; speed [m/s].
    duration : float, optional
        [s]; default: 30 crossings of a longitudinal wave through the larger body.
    sliding : Sliding, optional
        Of a pair that hits at an angle with friction.
    rigid : callable, optional
        Gaps to the rigid partner of a body alone, if it is known; see `impacts_of`.
    known : sequence of AdaptedSpace or None, optional
        Spaces of these models from an earlier call, where there are some.
    keep : bool
        As for `AdaptedSpace`.
    f_top : float, optional
        The first one [Hz]; default: 5 times the frequency of longitudinal waves in the smaller body.
    whole : bool
        Whether the tolerance is for the velocities of whole bodies, in place of those of every point.
    once : bool
        Whether to look at one f_top alone: a first look.
    settled : float, optional
        As for `AdaptedSpace.grow`; default: by the tolerance.
    finer : float
        As for `errors`.

    Returns
    -------
    list of AdaptedSpace, Estimate
    """
    crossing = [np.ptp(fem.points, axis=0).max() / fem.material.bar_wave_speed for fem, _ in models]
    f_limit = min(fem.resolved_frequency for fem, _ in models)
    f_top = min(_FIRST / (2 * min(crossing)) if f_top is None else f_top, 2 * f_limit)
    duration = _CROSSINGS * max(crossing) if duration is None else duration
    shortest, longest = _SHORTEST * min(crossing), _LONGEST * max(crossing)
    if not shortest <= duration <= longest:
        raise InputError(
            f"duration: expected {shortest:.3g} to {longest:.3g} s, {_SHORTEST:g} to {_LONGEST:g} crossings of a "
            f"longitudinal wave, got {duration!r}"
        )
    settled = settled_for(tolerance) if settled is None else settled
    made = list(known) or [None] * len(models)
    while True:
        for i, model in enumerate(models):
            space = made[i]
            if space is None:
                space = made[i] = AdaptedSpace(*model, f_top, keep=keep)
            elif space.has_settled(f_top, settled):
                continue
            else:
                space.shift_to(f_top)
            space.grow(f_top, _share(progress, i, len(models)), settled)
            space.krylov.finish()  # its factors, before those of the next; another f_top asks for others anyway
        spaces = [space for space in made if space is not None]
        ladder = f_top * 2.0 ** (-0.5 * np.arange(10, 1, -1))
        impacts = {
            (i, opposite): impact
            for i, numbers in enumerate(patches)
            for opposite, impact in impacts_of(spaces, f_top, numbers, speed, sliding, rigid).items()
        }
        flat = np.array([opposite == PLANE and (i, SPHERE) in impacts for i, opposite in impacts])
        of_impacts = np.array([errors(impact, f_top, ladder, duration, finer) for impact in impacts.values()])
        judged = of_impacts[:, :, [0, 2 if whole else 1]]
        good = judged.max(axis=2) <= tolerance / AIM
        _LOG.info("tolerance: at f_cut = %.4g Hz the estimated error is %.3g", ladder[-1], judged[:, -1].max())
        at_end = once or f_top >= 2 * f_limit * (1 - 1e-9)
        # On a flat patch a plane may make the force ring at any f_top. Go on while its errors fall at least as the
        # first power of the frequency.
        hopeless = judged[flat].max(axis=(0, 2), initial=0.0)
        if good[:, -1].all() or at_end or (good[~flat, -1].all() and hopeless[-1] > hopeless[-3] / 2):
            break
        raised = frequency_for(f_top, judged[:, -1].max(), tolerance)
        f_top = min(np.clip(raised, 1.5 * f_top, 4.0 * f_top), 2 * f_limit)
    kept = good.all(axis=0) if good[:, -1].all() else good[~flat].all(axis=0)
    # The lowest truncation from which on all are good. If none is, the richest: a least error is by chance.
    n_good = int(np.argmin(np.r_[kept[::-1], False]))
    chosen = len(ladder) - max(1, n_good)
    worst = judged[:, chosen].max(axis=1)
    estimate = Estimate(
        force=float(of_impacts[:, chosen, 0].max()),
        velocity=float(of_impacts[:, chosen, 1].max()),
        f_cut=float(ladder[chosen]),
        f_top=float(f_top),
        speed=speed,
        duration=float(duration),
        against=list(impacts)[int(worst.argmax())][1],
        tolerance=tolerance,
        limit=_limit(bool(good[:, -1].all()), bool(kept[-1]), worst[~flat].max(), f_limit, bool(flat.any())),
        mean_velocity=float(of_impacts[:, chosen, 2].max()) if whole else None,
    )
    _LOG.info("tolerance: f_cut = %.4g Hz is kept, its estimated error is %.3g", estimate.f_cut, estimate.error)
    return spaces, estimate


def settled_for(tolerance: float) -> float:
    """Change of mobilities up to which `grow_to_tolerance` grows spaces."""
    return min(0.1, _SETTLED * tolerance)


def frequency_for(f: float, error: float, tolerance: float) -> float:
    """Truncation frequency that keeps a tolerance, by the error of another one; errors fall as f^-2."""
    return f * float(np.sqrt(error * AIM / tolerance))


def _limit(reached: bool, but_for_planes: bool, on_spheres: float, f_limit: float, flat: bool) -> str:
    """Why an estimate is above its tolerance, and what to do."""
    if reached:
        return ""
    if but_for_planes:
        return (
            "that a flat patch meets a plane everywhere at once: the force then rings about its mean at any f_cut (on "
            f"a rigid sphere the estimated error is {on_spheres:.3g}). Read means and impulses there; if the other "
            "body is known, take reduce_pair"
        )
    rings = "; a flat patch may ring on a plane at any f_cut" * flat
    return f"the mesh, which resolves motion up to {f_limit:.4g} Hz. Refine it, or accept that estimate{rings}"


def warn_if_missed(estimate: Estimate | None) -> None:
    """Warn (`ToleranceWarning`) if an estimate is above its tolerance, also for a body from the cache."""
    if estimate is not None and estimate.limit:
        warn(
            f"tolerance: {estimate.tolerance:.3g} cannot be promised; the best body has an estimated error of "
            f"{estimate.error:.3g}, to a factor of {AIM}, against {estimate.against} at f_cut = "
            f"{estimate.f_cut:.4g} Hz. What limits it is {estimate.limit}",
            ToleranceWarning,
        )


def _share(progress: Progress | None, i: int, n: int) -> Progress | None:
    """Progress of the i-th of n equal parts."""
    return None if progress is None else lambda x: progress((i + x) / (n + 1))
