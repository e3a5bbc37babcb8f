"""The search of `design_impact`: meshes, one after the other, until the estimated error is small enough."""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from ..algebra.blas_threads import one_blas_thread
from ..errors import InputError, InvertedElementsError, MemoryLimitError, PartitionError
from ..meshing.ngsolve_fem import surplus_of
from ..meshing.surplus import Surplus
from ..prediction.hertz import contact_radius
from ..reduction.estimate import AIM, Estimate, frequency_for, grow_to_tolerance, settled_for
from ..reduction.free_body import SETTLED, AdaptedSpace
from ..reduction.memory import fits_together, watched
from ..reduction.reduction import bodies_of
from ..support.foreign import NGSolveMesh
from ..support.machine import beside_other_work
from ..support.progress import Progress
from .contact_place import sides_of
from .correction import Finer
from .impact_design import TRUST, ImpactDesign, Look
from .impact_scene import Model, Scene, first_circle
from .mesh_error import estimate_of
from .mesh_rules import MISSED, Sizes, count_of_dofs, curvature_for, energy_frequency, first_sizes, sizes_by_rule
from .modal_pair import impact_of

_LOG = logging.getLogger(__name__)

# Shares of the tolerance that the reduction gets, over 1.5: at most, and by the first look. That one has more f_cut to
# choose from, and a higher f_cut costs less than smaller elements.
_TRUNCATION, _LESS = 0.45, 0.27
_TOP = 2.2  # f_top by the f_cut that the last reduction foretells: twice that, and a tenth more to be safe
_COARSER, _COARSEST = 8, 4.0  # factor and end of the rules' tolerance while their meshes do not fit
_LOOKS = 6  # most meshes, the first look included
_COUNTS = 0.3  # parts of the error below this share of the largest one are not refined
_MOST_TRUNCATION = 0.4  # of the tolerance, which truncation and step take from it, for the next meshes
_LEAST_BUDGET = 0.2  # of the tolerance, for the meshes
_AIM = 0.8  # of the budget, which the next mesh is to keep
_STEPS = 2.0  # for a default one: they cost less than the smaller elements, and the modes, that they spare
_FINER = 4  # steps for one of the design's, to tell the error of the step
_SETTLED = 0.2  # relative change of the contact radius after which both contacts are meshed anew

_MANY, _PAYS = 30_000, 0.6  # dofs of cubic elements from which on quadratic ones are tried; share that they may have
# The same of elements at the contact that are larger by a factor: Netgen's meshes follow sizes by leaps.
_SOME, _LARGER, _LEAP = 15_000, 1.1, 0.75
_ROUNDINGS, _MISSES = 2, 1.25  # tries after a mesh that misses more volume than its share by that factor
_MESHINGS, _SMALLER = 4, 0.87  # tries after a mesh that cannot be used, and elements of each by those before


class Search:
    """Meshes, one after the other, until one is good enough."""

    def __init__(self, scene: Scene, duration: float | None) -> None:
        self.scene, self.duration = scene, duration
        self.looks: list[Look] = []
        self.best: ImpactDesign | None = None
        self.models: dict[int, tuple[Sizes, float, Model]] = {}  # of each body
        self.spaces: dict[int, AdaptedSpace] = {}
        self.share = _TRUNCATION * scene.tolerance

    def run(self, progress: Progress | None) -> ImpactDesign:
        """Look, refine, and look again."""
        scene, place = self.scene, self.scene.place
        sides = [sides_of(shape) for shape in scene.shapes]
        circle = first_circle(scene.shapes, scene.materials, scene.speed, place.radius)
        sizes = [first_sizes(side, place.semi_axes(circle)) for side in sides]
        first = self.look_at(sizes, circle, estimated=False)
        fems = [self.models[i][2][0] for i in range(len(sizes))]
        circle, axes, limit = first.circle, place.semi_axes(first.circle), ""

        def by_rule(tolerance: float) -> list[Sizes]:
            rules = [
                sizes_by_rule(fem, side, first.frequency, axes, tolerance, slave=i == 0, corrected=scene.left < 1)
                for i, (fem, side) in enumerate(zip(fems, sides, strict=True))
            ]
            return [
                replace(rule, curvature=curvature_for(side.curvature, missed, tolerance))
                for rule, side, missed in zip(rules, first.sizes, first.missed, strict=True)
            ]

        allowed = scene.tolerance
        sizes = by_rule(allowed)
        while not limit:
            if progress:
                progress(len(self.looks) / _LOOKS)
            try:
                look = self.look_at(sizes, circle)
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

    def look_at(self, sizes: Sequence[Sizes], circle: float, estimated: bool = True) -> Look:
        """Mesh, reduce, and estimate; what did not change since the last look is taken over.

        The second core meshes and assembles the second body, and what the next order adds, while the first is reduced.
        """
        scene, rigid, times, n = self.scene, self.scene.rigid, {"mesh": 0.0, "assemble": 0.0}, len(sizes)
        anew = [i for i, wanted in enumerate(sizes) if i not in self.models or self.models[i][:2] != (wanted, circle)]
        for i in anew[:1]:
            times = self.make_model(i, sizes[i], circle)
        begin = time.perf_counter()
        with ThreadPoolExecutor(1) as second_core, one_blas_thread():
            others = [second_core.submit(self.make_model, i, sizes[i], circle, one_thread=True) for i in anew[1:]]
            surpluses = [second_core.submit(self.surplus, i) for i in range(n)] if estimated else []
            if others:
                self.spaces[anew[0]] = self.grown_space(self.models[anew[0]][2], estimated)
            for future in others:
                future.result()
            sizes, models = [self.models[i][0] for i in range(n)], [self.models[i][2] for i in range(n)]
            with watched(models, "contact-adapted"):
                truncation = self.truncate(models, estimated)
                spaces = [self.spaces[i] for i in range(n)]
                bodies = bodies_of(spaces, truncation, begin)
        times["reduce"], begin = time.perf_counter() - begin, time.perf_counter()
        self.duration = duration = truncation.duration
        with one_blas_thread():
            pairs = [(fem, body) for (fem, _), body in zip(models, bodies, strict=True)]
            sides, impact_now = impact_of(pairs, [0] * len(pairs), scene.speed, rigid)
            mesh = None
            if estimated:
                finers = [
                    Finer(*pair, space.elastic, surplus.result())
                    for pair, space, surplus in zip(pairs, spaces, surpluses, strict=True)
                ]
                mesh = estimate_of(sides, impact_now, scene.speed, duration, finers, scene.left, whole=True)
                if scene.left < 1:
                    bodies = tuple(finer.corrected(0) for finer in finers)
            step = impact_now.step(_STEPS * truncation.f_cut, _STEPS)
            t, force, _ = impact_now.run(duration, step / _FINER)
            at, coarse, _ = impact_now.run(duration, step)
        times["estimate"] = time.perf_counter() - begin
        force, peak, place = force[:, 0], float(force.max()), scene.place
        step_error = float(np.linalg.norm(np.interp(t, at, coarse[:, 0]) - force) / np.linalg.norm(force))
        if estimated and (known := self.known) is not None:  # with the step of the first look
            longer = max(0.0, step_error - self.looks[0].step_error)
            truncation = replace(known, force=known.force + longer)
            bodies = tuple(replace(body, estimate=truncation) for body in bodies)
        if not peak > 0:
            raise InputError(
                f"duration: the bodies do not press on each other within {duration:.3g} s; take a longer one"
            )
        look = Look(
            sizes=tuple(sizes),
            dofs=tuple(fem.n_dofs for fem, _ in models),
            missed=tuple(scene.missed(i, fem) for i, (fem, _) in enumerate(models)),
            circle=contact_radius(peak, place.radius, np.inf, *scene.materials),
            peak=peak,
            frequency=energy_frequency(t, force),
            truncation=truncation,
            mesh=mesh,
            step=step,
            step_error=step_error,
            seconds=times,
        )
        self.looks.append(look)
        _LOG.info("design: %s dofs, estimated error %.3g", " + ".join(map(str, look.dofs)), look.error)
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

    def make_model(
        self, i: int, sizes: Sizes, circle: float, *, one_thread: bool = False, again: int = _MESHINGS
    ) -> dict[str, float]:
        """Mesh a body and assemble its FE model; return the times [s].

        Curved sides, or Netgen by chance, make inverted elements at times: then others are tried, up to `again` times.
        """
        begin, scene = time.perf_counter(), self.scene
        self.spaces.pop(i, None)
        with beside_other_work() if one_thread else contextlib.nullcontext():
            sizes, mesh = self.mesh_of(i, sizes, circle)
            meshed = time.perf_counter()
            dofs = count_of_dofs(mesh, sizes.order) + sum(
                model[0].n_dofs for j, (_, _, model) in self.models.items() if j != i
            )
            if dofs > scene.max_dofs:
                raise MemoryLimitError(
                    f"max_dofs: {scene.max_dofs}, and the meshes that are needed next have {dofs} dofs. Allow more, "
                    "or a larger tolerance"
                )
            try:
                self.models[i] = sizes, circle, scene.model(i, mesh, sizes, circle)
            except InvertedElementsError:  # curved sides turned elements inside out, or an element within is flat
                if not again:
                    raise
                smaller = replace(sizes, far=_SMALLER * sizes.far, curvature=sizes.curvature / _SMALLER)
                return self.make_model(i, smaller, circle, one_thread=one_thread, again=again - 1)
        return {"mesh": meshed - begin, "assemble": time.perf_counter() - meshed}

    def mesh_of(self, i: int, sizes: Sizes, circle: float) -> tuple[Sizes, NGSolveMesh]:
        """Mesh a body; again with more elements on curved sides where these miss too much volume.

        A mesh costs little beside what is made of it. The first look may be coarse.
        """
        mesh = self.scene.mesh(i, sizes, circle)
        for _ in range(_ROUNDINGS if self.looks else 0):
            rounder = self.rounder(sizes, self.scene.missed(i, mesh))
            if rounder == sizes:
                break
            sizes, mesh = rounder, self.scene.mesh(i, rounder, circle)
        return self.with_fewer_dofs(i, sizes, mesh, circle)

    def with_fewer_dofs(self, i: int, sizes: Sizes, mesh: NGSolveMesh, circle: float) -> tuple[Sizes, NGSolveMesh]:
        """Elements of nearly the same error in place of those by rule, where these have many more dofs.

        Round sides of a long body ask for as many elements of either order: quadratic ones have fewer dofs. Others are
        tried once, on large meshes alone, for a mesh takes its time too.
        """
        dofs = count_of_dofs(mesh, sizes.order)
        if len(self.looks) != 1 or dofs < _SOME:
            return sizes, mesh
        others = [(replace(sizes, near=_LARGER * sizes.near), _LEAP)]
        if dofs >= _MANY and sizes.order == 3 and (quadratic := sizes.quadratic()) is not None:
            others.insert(0, (quadratic, _PAYS))
        for coarser, share in others:
            instead = self.scene.mesh(i, coarser, circle)
            if count_of_dofs(instead, coarser.order) < share * dofs:
                return coarser, instead
        return sizes, mesh

    @property
    def known(self) -> Estimate | None:
        """What truncates all later meshes: the first one's choice, if it kept its share of the tolerance.

        The dynamics of bodies up to f_cut depend little on the mesh, so that later ones need no richer bodies for it.
        """
        if not self.looks:
            return None
        first = self.looks[0].truncation
        resolved = min(fem.resolved_frequency for _, _, (fem, _) in self.models.values())
        return None if first.error > self.share / AIM or resolved < first.f_cut else replace(first, limit="")

    def truncate(self, models: Sequence[Model], estimated: bool) -> Estimate:
        """Grow the spaces of both bodies, and choose a truncation."""
        if estimated and (known := self.known) is not None:
            for i, model in enumerate(models):
                if i not in self.spaces:
                    self.spaces[i] = self.grown_space(model, estimated)
            return known
        if estimated:
            return self.truncate_within(models, self.share, keep=fits_together(models))
        first = self.truncate_within(models, _LESS * self.scene.tolerance, once=True)
        # Where no f_cut is so good, the richest would stand, which later meshes may not even resolve.
        return self.truncate_within(models, self.share, once=True) if first.limit else first

    def truncate_within(
        self, models: Sequence[Model], share: float, *, keep: bool = False, once: bool = False
    ) -> Estimate:
        """Grow the spaces of both bodies, and choose a truncation within a share of the tolerance."""
        rigid = self.scene.rigid
        spaces, truncation = grow_to_tolerance(
            models,
            [[0] * len(models)],
            tolerance=share,
            speed=self.scene.speed,
            duration=self.duration,
            rigid=None if rigid is None else lambda points: rigid.project(points)[0],
            known=[self.spaces.get(i) for i in range(len(models))],
            keep=keep,
            f_top=self.first_top,
            whole=True,
            once=once,
            settled=SETTLED,
            finer=_STEPS,
        )
        self.spaces = dict(enumerate(spaces))
        return truncation

    def grown_space(self, model: Model, estimated: bool) -> AdaptedSpace:
        """The space of a body, up to what is needed.

        Up to f_top, twice f_cut or more, it settles as that of a body of a given f_top does: with ten times less change
        of mobilities, estimates are the same to a hundredth of the tolerance.
        """
        known = self.known if estimated else None
        f_top, settled = min(self.first_top, 2 * model[0].resolved_frequency), SETTLED
        if known is not None:
            f_top, settled = known.f_cut, settled_for(self.share)
        with watched([model], "contact-adapted"):
            space = AdaptedSpace(*model, f_top, keep=estimated and fits_together([model]))
            space.grow(f_top, settled=settled)
            space.krylov.finish()
        return space

    def surplus(self, i: int) -> Surplus:
        """What the next order adds to the FE model of a body."""
        with beside_other_work():
            return surplus_of(self.models[i][2][0])

    @property
    def first_top(self) -> float:
        """Frequency up to which the bodies are to be known, by the last reduction [Hz]."""
        if not self.looks:
            return self.scene.least_top
        last = self.looks[-1].truncation
        # A coarse mesh makes truncation look worse than it is: the next one is first tried with the same.
        return last.f_top if len(self.looks) == 1 else _TOP * frequency_for(last.f_cut, last.error, self.share)

    def refined(self, look: Look) -> list[Sizes]:
        """Smaller elements where the estimate is largest."""
        assert look.mesh is not None
        parts = {("far", i): x for i, x in enumerate(look.mesh.far)}
        parts |= {("near", i): x for i, x in enumerate(look.mesh.local)}
        taken = min(look.truncation.error, _MOST_TRUNCATION * self.scene.tolerance)
        budget = max(self.scene.tolerance / TRUST - taken - max(look.missed), _LEAST_BUDGET * self.scene.tolerance)
        worst = max(parts.values())
        active = {key: x for key, x in parts.items() if x >= _COUNTS * worst}
        ratios = {}
        if worst > _COUNTS * budget or not look.truncation.limit:  # else the same meshes would be tried again
            shared = _AIM * budget * sum(parts.values()) / look.mesh.error  # parts make less together than their sum
            ratios = {key: min(shared / len(active) / x, 1.0) for key, x in active.items()}
        if look.truncation.limit:  # no basis on these meshes is good enough
            weakest = min(self.models, key=lambda i: self.models[i][2][0].resolved_frequency)
            # Its errors fall with the square of the frequency, as those far from the contact with that of the size.
            needed = frequency_for(1.0, look.truncation.error, self.share)
            ratios["far", weakest] = min(needed**-2, ratios.get(("far", weakest), 1.0))
        return [
            self.rounder(sizes, missed).finer(ratios.get(("far", i)), ratios.get(("near", i)))
            for i, (sizes, missed) in enumerate(zip(look.sizes, look.missed, strict=True))
        ]

    def rounder(self, sizes: Sizes, missed: float) -> Sizes:
        """Sizes with more elements on curved sides, where a mesh misses too much volume."""
        needed = curvature_for(sizes.curvature, missed, self.scene.tolerance)
        return replace(sizes, curvature=needed) if missed > _MISSES * MISSED * self.scene.tolerance else sizes
