"""From two shapes to bodies whose total error in their impact is below a tolerance: `design_impact`.

A first look with a coarse mesh gives the force, and with it the contact radius and the frequencies. Rules
(`mesh_rules`) turn these into meshes. The bodies are reduced to a part of the tolerance, and the error of their meshes
is estimated (`mesh_error`). What makes the largest error is refined, until the sum is below the tolerance over 1.25.
"""

from __future__ import annotations

import logging
import time
import warnings
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..algebra.blas_threads import one_blas_thread
from ..contact.rigid import RigidCylinder, RigidPlane, RigidSphere, RigidSurface
from ..errors import InputError, MemoryLimitError, MeshError, PartitionError, ToleranceWarning
from ..fe.material import Material
from ..meshing.netgen_mesh import CURVATURE, shape_of
from ..meshing.ngsolve_fem import surplus_of
from ..prediction.hertz import contact_radius, effective, impact
from ..reduction.estimate import frequency_for, grow_to_tolerance
from ..reduction.free_body import AdaptedSpace
from ..reduction.memory import fits_together, watched
from ..reduction.reduction import bodies_of
from ..support.arrays import Vector
from ..support.checks import (
    validate_callable,
    validate_flag,
    validate_integer,
    validate_number,
    validate_positive,
    validate_vector,
)
from ..support.foreign import Shape
from ..support.progress import Progress, shown
from .contact_place import contact_place, sides_of
from .correction import LEFT, Finer
from .impact_design import TRUST, ImpactDesign, Look
from .impact_scene import Model, Scene
from .mesh_error import estimate_of
from .mesh_rules import (
    Sizes,
    count_of_dofs,
    curvature_for,
    energy_frequency,
    first_sizes,
    sizes_by_rule,
)
from .modal_pair import impact_of

_LOG = logging.getLogger(__name__)

_TOLERANCES = (2e-3, 0.2)
_FIRST_LOOK = 0.15  # tolerance of the reduction on the first meshes
_TRUNCATION = 0.45  # share of the tolerance that the reduction gets; its estimate is then below 0.3
_TOP = 2.2  # f_top by the f_cut that the last reduction foretells: twice that, and a tenth more to be safe
_COARSER, _COARSEST = 8, 4.0  # factor and end of the rules' tolerance while their meshes do not fit
_LOOKS = 6  # most meshes, the first look included
_COUNTS = 0.3  # parts of the error below this share of the largest one are not refined
_LEAST_BUDGET = 0.2  # of the tolerance, for the meshes
_AIM = 0.8  # of the budget, which the next mesh is to keep
_RESOLVE = 0.5  # ratio by which a mesh that resolves too little is to become better
_MOST_DOFS = 250_000
_FINER = 4  # steps of the default one, to tell the error of the step
_SETTLED = 0.2  # relative change of the contact radius after which both contacts are meshed anew
_FASTEST = 1e4  # m/s

Body = tuple[Shape | str | Path, Material]


def design_impact(
    first: Body,
    second: Body | RigidSurface,
    *,
    speed: float,
    contact: Vector,
    tolerance: float = 1e-2,
    duration: float | None = None,
    scale: float = 1.0,
    max_dofs: int = _MOST_DOFS,
    correct: bool = False,
    progress: Progress | None = None,
) -> ImpactDesign:
    """Mesh and reduce two bodies, or one, such that the total error of their impact is below a tolerance.

    The total error is that of the meshes, of the truncation and of the step, against the elastic bodies themselves. It
    is estimated and no bound: see `ImpactDesign`.

    Parameters
    ----------
    first : (shape or path, Material)
        An OCC shape or the path of a STEP file, placed as at the impact.
    second : (shape or path, Material), RigidPlane, RigidSphere or RigidCylinder
        It touches the first body, or nearly so.
    speed : float
        Approach speed along the normal of the contact [m/s].
    contact : (3,) array
        Where they touch, after scaling [m]. Both surfaces are smooth there and touch at a point.
    tolerance : float
        Of contact force and velocities: relative error in the L2 norm over `duration`; 0.002 to 0.2.
    duration : float, optional
        [s]; default: 30 crossings of a longitudinal wave through the larger body.
    scale : float
        Factor on the lengths of both shapes; Netgen reads STEP files in millimetres: give 1e-3.
    max_dofs : int
        Most dofs of both FE models together.
    correct : bool
        Give the bodies what functions of one order more change of them, as `with_mesh_error` does. Coarser meshes are
        then enough. The estimate counts half of the error that these functions show, and all of that of the rows.
    progress : callable, optional
        As for `reduce`.

    Returns
    -------
    ImpactDesign
        FE models, bodies, step, and what was chosen and why.

    Raises
    ------
    InputError
        If an argument is out of range; or a material has hardening; or the point lies on an edge; or the bodies touch
        along a line or an area.
    EmptyRegionError
        If a body is not near the point of contact, or they do not face each other there.
    MeshError, MemoryLimitError, MissingPackageError

    Warns
    -----
    ToleranceWarning
        If the tolerance is not reached within `max_dofs`, the free memory or six meshes, or a finer mesh fails; the
        best design is returned.
    """
    if progress is not None:
        validate_callable("progress", progress, "a function of the share done, 0 to 1")
    validate_flag("correct", correct)
    scene, duration = _scene(first, second, speed, contact, tolerance, duration, scale, max_dofs)
    if correct:
        scene = replace(scene, left=LEFT)
    with shown(progress, "design an impact") as report:
        design = Search(scene, duration).run(report)
    if design.limit:
        warnings.warn(
            f"tolerance: {tolerance:.3g} cannot be promised; the best design has an estimated error of "
            f"{design.error:.3g}. What limits it is {design.limit}",
            ToleranceWarning,
            stacklevel=2,
        )
    return design


def _scene(
    first: Body,
    second: Body | RigidSurface,
    speed: float,
    contact: Vector,
    tolerance: float,
    duration: float | None,
    scale: float,
    max_dofs: int,
) -> tuple[Scene, float | None]:
    """Check the arguments, and find the place of contact."""
    rigid = second if isinstance(second, (RigidPlane, RigidSphere, RigidCylinder)) else None
    named = [("first", first)] if rigid is not None else [("first", first), ("second", second)]
    also = ", or a RigidPlane, RigidSphere or RigidCylinder"
    for name, body in named:
        if not isinstance(body, tuple | list) or len(body) != 2 or not isinstance(body[1], Material):
            raise InputError(
                f"{name}: expected (shape or path of a STEP file, ep.Material){also if name == 'second' else ''}, got "
                f"{type(body).__name__}"
            )
        if body[1].plastic:
            raise InputError(
                f"{name}: its material has hardening=, and the estimates are those of elastic bodies. Design with an "
                "elastic material; then make partitions with plastic_radius, and reduce to the f_cut that was found"
            )
    speed = validate_positive("speed", speed, "m/s")
    if not 1 / _FASTEST <= speed <= _FASTEST:
        raise InputError(f"speed: expected {1 / _FASTEST:g} to {_FASTEST:g} m/s, got {speed!r}")
    low, high = _TOLERANCES
    if not low <= validate_number("tolerance", tolerance) <= high:
        raise InputError(
            f"tolerance: expected {low:g} to {high:g}, got {tolerance!r}. Below, rounding of meshes and rows decides; "
            "above, meshes are too coarse for an estimate"
        )
    point, scale = validate_vector("contact", contact), validate_positive("scale", scale)
    max_dofs = validate_integer("max_dofs", max_dofs, 1000)
    duration = None if duration is None else validate_positive("duration", duration, "s")
    shapes = tuple(shape_of(body[0], scale, name) for name, body in named)  # type: ignore[index]
    materials = tuple(body[1] for _, body in named)  # type: ignore[index]
    place = contact_place(shapes, rigid, point, lambda radius: _first_circle(shapes, materials, speed, radius))
    return Scene(shapes, materials, rigid, place, speed, tolerance, max_dofs), duration


class Search:
    """Meshes, one after the other, until one is good enough."""

    def __init__(self, scene: Scene, duration: float | None) -> None:
        self.scene, self.duration = scene, duration
        self.looks: list[Look] = []
        self.best: ImpactDesign | None = None
        self.models: list[tuple[Sizes, float, Model]] = []
        self.spaces: list[AdaptedSpace] = []

    def run(self, progress: Progress | None) -> ImpactDesign:
        """Look, refine, and look again."""
        scene, place = self.scene, self.scene.place
        sides = [sides_of(shape) for shape in scene.shapes]
        circle = _first_circle(scene.shapes, scene.materials, scene.speed, place.radius)
        sizes = [first_sizes(own, place.semi_axes(circle)[1]) for own in sides]
        first = self.look_at(sizes, circle, _FIRST_LOOK, estimated=False)
        fems = [fem for _, _, (fem, _) in self.models]
        circle, near, limit = first.circle, place.semi_axes(first.circle)[1], ""

        def by_rule(tolerance: float) -> list[Sizes]:
            rules = [
                sizes_by_rule(fem, own, first.frequency, near, tolerance, slave=i == 0, corrected=scene.left < 1)
                for i, (fem, own) in enumerate(zip(fems, sides, strict=True))
            ]
            return [
                replace(rule, curvature=curvature_for(own.curvature, missed, tolerance))
                for rule, own, missed in zip(rules, first.sizes, first.missed, strict=True)
            ]

        allowed = scene.tolerance
        sizes = by_rule(allowed)
        while not limit:
            if progress:
                progress(len(self.looks) / _LOOKS)
            try:
                look = self.look_at(sizes, circle, _TRUNCATION * scene.tolerance)
            except PartitionError as error:
                if self.best is not None:
                    limit = str(error)
                    break
                if not isinstance(error, MemoryLimitError) or allowed >= _COARSEST:
                    raise
                allowed *= _COARSER  # the best meshes that fit
                sizes = by_rule(allowed)
                continue
            if look.error <= scene.tolerance / TRUST:
                break
            if len(self.looks) == _LOOKS:
                limit = f"the number of meshes that are tried, {_LOOKS}; accept that estimate, or mesh by hand"
            sizes = self.refined(look)
            if abs(look.circle / circle - 1) > _SETTLED:
                circle = look.circle
        assert self.best is not None
        return replace(self.best, looks=tuple(self.looks), limit=limit)

    def look_at(self, sizes: Sequence[Sizes], circle: float, tolerance: float, estimated: bool = True) -> Look:
        """Mesh, reduce, and estimate; what did not change since the last look is taken over."""
        scene, times = self.scene, {}
        begin = time.perf_counter()
        old = {i: made[:2] for i, made in enumerate(self.models)}
        meshes = {i: scene.mesh(i, own, circle) for i, own in enumerate(sizes) if old.get(i) != (own, circle)}
        times["mesh"], begin = time.perf_counter() - begin, time.perf_counter()
        dofs = [
            count_of_dofs(meshes[i], own.order) if i in meshes else self.models[i][2][0].n_dofs
            for i, own in enumerate(sizes)
        ]
        if sum(dofs) > scene.max_dofs:
            raise MemoryLimitError(
                f"max_dofs: {scene.max_dofs}, and the meshes that are needed next have {sum(dofs)} dofs. Allow more, "
                "or a larger tolerance"
            )
        try:
            made = [
                (own, circle, scene.model(i, meshes[i], own, circle)) if i in meshes else self.models[i]
                for i, own in enumerate(sizes)
            ]
        except MeshError:  # curved sides turned elements inside out
            curved = [replace(own, curvature=CURVATURE) for own in sizes]
            if curved == list(sizes):
                raise
            return self.look_at(curved, circle, tolerance, estimated)
        self.models = made
        models = [model for _, _, model in made]
        times["assemble"], begin = time.perf_counter() - begin, time.perf_counter()
        rigid = scene.rigid
        fems = [fem for fem, _ in models] if estimated else []
        with ThreadPoolExecutor(1) as second_core, watched(models, "contact-adapted"), one_blas_thread():
            surpluses = [second_core.submit(surplus_of, fem, one_thread=True) for fem in fems]
            self.spaces, truncation = grow_to_tolerance(
                models,
                [[0] * len(models)],
                tolerance=tolerance,
                speed=scene.speed,
                duration=self.duration,
                rigid=None if rigid is None else lambda points: rigid.project(points)[0],
                known=[None if i in meshes else self.spaces[i] for i in range(len(models))],
                keep=estimated and fits_together(models),
                f_top=self.first_top(tolerance),
            )
            bodies = bodies_of(self.spaces, truncation, begin)
        times["reduce"], begin = time.perf_counter() - begin, time.perf_counter()
        self.duration = duration = truncation.duration
        with one_blas_thread():
            pairs = [(fem, body) for (fem, _), body in zip(models, bodies, strict=True)]
            sides, impact_now = impact_of(pairs, [0] * len(pairs), scene.speed, rigid)
            mesh = None
            if estimated:
                finers = [
                    Finer(*pair, space.elastic, surplus.result())
                    for pair, space, surplus in zip(pairs, self.spaces, surpluses, strict=True)
                ]
                mesh = estimate_of(sides, impact_now, scene.speed, duration, finers, scene.left)
                if scene.left < 1:
                    bodies = tuple(finer.corrected(0) for finer in finers)
            step = impact_now.step(truncation.f_cut)
            t, force, _ = impact_now.run(duration, step / _FINER)
            at, coarse, _ = impact_now.run(duration, step)
        times["estimate"] = time.perf_counter() - begin
        force, peak, place = force[:, 0], float(force.max()), scene.place
        if not peak > 0:
            raise InputError(
                f"duration: the bodies do not press on each other within {duration:.3g} s; take a longer one"
            )
        look = Look(
            sizes=tuple(sizes),
            dofs=tuple(dofs),
            missed=tuple(scene.missed(i, fem) for i, (fem, _) in enumerate(models)),
            circle=contact_radius(peak, place.radius, np.inf, *scene.materials),
            peak=peak,
            frequency=energy_frequency(t, force),
            truncation=truncation,
            mesh=mesh,
            step=step,
            step_error=float(np.linalg.norm(np.interp(t, at, coarse[:, 0]) - force) / np.linalg.norm(force)),
            seconds=times,
        )
        self.looks.append(look)
        _LOG.info("design: %s dofs, estimated error %.3g", " + ".join(map(str, dofs)), look.error)
        if estimated and (self.best is None or look.error < self.best.error):
            self.best = ImpactDesign(
                fems=tuple(fem for fem, _ in models),
                partitions=tuple(partition for _, partition in models),
                bodies=bodies,
                look=look,
                looks=(),
                tolerance=scene.tolerance,
                speed=scene.speed,
                duration=duration,
                place=place,
            )
        return look

    def first_top(self, tolerance: float) -> float:
        """Frequency up to which the bodies are to be known, by the last reduction [Hz]; zero if there is none."""
        if not self.looks:
            return 0.0
        last = self.looks[-1].truncation
        if last.tolerance <= tolerance:
            return last.f_top
        return _TOP * frequency_for(last.f_cut, last.error, tolerance)

    def refined(self, look: Look) -> list[Sizes]:
        """Smaller elements where the estimate is largest."""
        assert look.mesh is not None
        parts = {("far", i): x for i, x in enumerate(look.mesh.far)}
        parts |= {("near", i): x for i, x in enumerate(look.mesh.local)}
        budget = max(self.scene.tolerance / TRUST - look.truncation.error, _LEAST_BUDGET * self.scene.tolerance)
        worst = max(parts.values())
        active = {key: x for key, x in parts.items() if x >= _COUNTS * worst}
        ratios = {}
        if worst > _COUNTS * budget or not look.truncation.limit:  # else the same meshes would be tried again
            shared = _AIM * budget * sum(parts.values()) / look.mesh.error  # parts make less together than their sum
            ratios = {key: min(shared / len(active) / x, 1.0) for key, x in active.items()}
        if look.truncation.limit:  # no basis on these meshes is good enough
            weakest = int(np.argmin([model[0].resolved_frequency for _, _, model in self.models]))
            ratios["far", weakest] = min(_RESOLVE, ratios.get(("far", weakest), 1.0))
        return [
            own.finer(ratios.get(("far", i)), ratios.get(("near", i)), self.models[i][2][0].weakest_wall)
            for i, own in enumerate(look.sizes)
        ]


def _first_circle(shapes: Sequence[Shape], materials: Sequence[Material], speed: float, radius: float) -> float:
    """Contact radius by Hertz, for compact bodies that do not turn [m]: an upper estimate."""
    masses = [material.rho * abs(shape.mass) for shape, material in zip(shapes, materials, strict=True)]
    mass = effective(*masses) if len(masses) == 2 else masses[0]
    return impact(mass, speed, radius, np.inf, *materials).contact_radius
