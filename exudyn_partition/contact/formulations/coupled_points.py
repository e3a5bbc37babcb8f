"""Contacts at points of common bodies, by Hertz's law: each point moves the others through its body.

Theory: examples/site/theory.md, "A contact that the mesh does not resolve".
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, cast

import numpy as np
import scipy.linalg

from ...algebra.products import smallest
from ...errors import ComplementarityError
from ...support.arrays import Array
from ..gaps import Gaps
from ..spot_gaps import SpotGaps
from .coupled_zones import CoupledZones
from .point_step import PointLaw, Touch

_PASSES = 100
_UNSETTLED = 1e-5  # relative change of the forces in the last pass above which they are rejected


class CoupledPoints(CoupledZones):
    """Contacts at points that share bodies, patches too.

    Each in turn takes a step towards its force for the displacements that the others cause. It needs few passes: far
    from a point, its force moves the body less than at the point itself.
    """

    _by_fields = False

    def _begin(self) -> None:
        super()._begin()
        for contact in self.contacts:
            contact.told = self._frictional  # gaps depend on no earlier forces
        self._blocks: dict[tuple[int, int], tuple[tuple[int, int], Array]] = {}
        self._known_sharing: set[tuple[int, int]] | None = None

    def _linearised(self, closed: Sequence[slice]) -> Callable[[int, Array], Array]:
        """See `Coupled`."""
        D = scipy.linalg.block_diag(*(contact.evaluation.row_stiffness() for contact in self.contacts))
        F = np.zeros(D.shape)
        for j, k in self._between.pairs:
            both = self.contacts[j].evaluation.index.size and self.contacts[k].evaluation.index.size
            if both and (j, k) not in self._sharing:
                F[closed[j], closed[k]] = self._flexibility(j, k)
        K = np.linalg.solve(np.eye(len(D)) + D @ F, D)
        return lambda k, way: K[:, closed[k]] @ way

    def _find(self, gaps: list[Array]) -> None:
        """See `Coupled`."""
        if all(smallest(gap) >= 0.0 for gap in gaps) and not any(map(self._touched, range(len(gaps)))):
            for contact, gap in zip(self.contacts, gaps, strict=True):
                contact.answer(gap)
            return
        self._versions = [*self._between.versions()]
        steps = [
            cast(PointLaw, contact.law).step(contact.places(gap))
            for contact, gap in zip(self.contacts, gaps, strict=True)
        ]
        last = [self._last_of(j)[0] if self._touched(j) else None for j in range(len(gaps))]
        from_last = [self._moved_by(j, last) for j in range(len(gaps))]
        touches: list[Touch] = [step.begin() for step in steps]
        for _ in range(_PASSES):
            before = [touch.on_row for touch in touches]
            for j, step in enumerate(steps):
                moved = self._moved_by(j, [touch.on_row for touch in touches])
                moved[1:] -= from_last[j][1:]  # ways count from the last accepted step, gaps do not
                touches[j] = step.better(touches[j], moved)
            if all(touch.settled for touch in touches):
                break
        else:
            self._check_settled(before, [touch.on_row for touch in touches])
        self._set_answers(gaps, steps, touches, from_last)

    def _touched(self, j: int) -> bool:
        """Whether contact j was closed at the end of the last accepted step."""
        return self.contacts[j].state.memory.closed

    def _moved_by(self, j: int, forces: Sequence[Array | None]) -> Array:
        """Displacement of the row of contact j, (d,) [m], by forces on the rows of the others, (d,) each [N]."""
        moved = np.zeros(self.contacts[j].rows.d)
        for k in self._neighbours.get(j, ()):
            of_k = forces[k]
            if of_k is not None and of_k[0] and (j, k) not in self._sharing:
                moved += self._flexibility(j, k) @ of_k[: self.contacts[k].rows.d]
        return moved

    def _flexibility(self, j: int, k: int) -> Array:
        """Motion of the row of contact j by unit forces on that of contact k, (d, d) [m/N]; it is kept."""
        versions = self._versions[j], self._versions[k]
        kept = self._blocks.get((j, k))
        if kept is None or kept[0] != versions:
            rows = (np.arange(self.contacts[place].rows.d) for place in (j, k))
            kept = self._blocks[j, k] = versions, self._between.flexibility(j, next(rows), k, next(rows))
        return kept[1]

    @property
    def _sharing(self) -> set[tuple[int, int]]:
        """Contacts that are one on faces which go on as each other: each has its share of the flexibility itself."""
        if self._known_sharing is None:
            linked = {tuple(link[:4]) for link in self._all_links}
            self._known_sharing = {
                (j, k)
                for j, _, k, _ in linked
                if all((j, side, k, side) in linked for side in range(len(self.contacts[j].gaps.sides)))
                and _goes_on(self.contacts[j].gaps, self.contacts[k].gaps)
            }
        return self._known_sharing

    def _check_settled(self, before: list[Array], now: list[Array]) -> None:
        change, size = sum(abs(new - old).sum() for new, old in zip(now, before, strict=True)), sum(map(_size, now))
        if not change <= _UNSETTLED * size:
            raise ComplementarityError(
                f"the forces of {len(now)} points of contact on common bodies did not settle in {_PASSES} passes; the "
                f"last changed them by {change / size:.2g}. Points that are close to each other move each other too "
                "much: take formulation='compliance' there, with facets that resolve the contact"
            )

    def _set_answers(self, gaps: list[Array], steps: list[Any], touches: list[Touch], from_last: list[Array]) -> None:
        """Let contacts have these forces as their `evaluation`; each stores half of what they do on ways by others."""
        on_rows = [touch.on_row for touch in touches]
        for j, (contact, gap, step) in enumerate(zip(self.contacts, gaps, steps, strict=True)):
            pushed, forces = self._moved_by(j, on_rows), step.forces(touches[j])
            if forces.closed.size:
                forces = forces._replace(stored=forces.stored + 0.5 * float(np.dot(on_rows[j], pushed)))
            least = float(gap[0] + pushed[0])
            pushed[1:] -= from_last[j][1:]
            places = None if contact.friction is None else contact.places(gap, pushed[None])
            contact.answered(forces, gap, least, places)


def _goes_on(gaps: Gaps, others: Gaps) -> bool:
    """Whether two contacts of the same patches share one."""
    assert isinstance(gaps, SpotGaps)
    assert isinstance(others, SpotGaps)
    return gaps.goes_on_as(others)


def _size(forces: Array) -> float:
    return float(abs(forces).sum())
