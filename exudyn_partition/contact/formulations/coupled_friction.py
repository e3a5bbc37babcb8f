"""Contacts with friction on common bodies: the forces on the rows of all of them, found as one problem.

Theory: examples/site/theory.md, "Friction".
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, cast

import numpy as np

from ...algebra.block_friction import BlockFlexibility, BlockFriction
from ...algebra.complementarity import Complementarity
from ...algebra.products import smallest
from ...errors import ComplementarityError
from ...support.arrays import Array, consecutive
from ..between import Shares, shared_flexibility
from ..law import Forces, Places
from ..patch_contact import PatchContact
from .compliance import ClosingRows, FrictionalCompliance
from .coupled import Coupled

Core = dict[tuple[int, int], Array]  # see `between.Exchange`
_PASSES = 100
_ONE_PLACE = 0.9  # correlation of directions of two contacts, above which they count as the same
_SOFTER = 1e-3  # of their own flexibility: what such directions get in addition
_SMALL = 1e-3  # of a contact's own flexibility: smaller fields of others are left out of factors


class CoupledFriction(Coupled):
    """Contacts without yield, of which some have friction.

    All rows that can close are one problem, see `BlockFriction`. Its flexibility is that of each contact's rows, and
    between contacts that of the bodies' patches.
    """

    def _begin(self) -> None:
        super()._begin()
        for contact in self.contacts:
            contact.told = True
        self._parts = [_Part(contact) for contact in self.contacts]
        self._problem: BlockFriction | None = None  # of the rows that can close
        self._versions: list[int] = []  # how often the rows between contacts were found for the problem
        self._pushing: dict[int, Any] = {}  # what the last forces on each contact push others with

    def whole_flexibility(self, shares: Shares | None = None) -> tuple[Array, list[Array], Core]:
        """Flexibility of all rows of all contacts, (3 n, 3 n) [m/N], not regularised, and what they exchange.

        The latter are fields of the rows of each contact, (3 nr, m), and `Exchange.core`. Rows of contacts without
        friction have tangents too, which nothing moves. Those that follow the motion have no flexibility and no fields
        here. `shares` as in `CoupledContacts`.
        """
        rows = [contact.rows for contact in self.contacts]
        core = self._fields.core if shares is None else self._exchange.yielding(shares)
        numbers = [len(one.gaps.all_points.row_nodes) if one.gaps.moving else len(one.gaps.row_nodes) for one in rows]
        every, n_fields = [np.arange(n) for n in numbers], max(map(len, core.values()), default=0)
        parts, fields = consecutive([3 * len(index) for index in every]), list[Array]()
        F = np.zeros((parts[-1].stop,) * 2)
        for j, (part, columns, contact, index) in enumerate(zip(self._parts, parts, rows, every, strict=True)):
            if contact.gaps.moving:
                fields.append(np.zeros((3 * len(index), n_fields)))
                continue
            of_rows = contact.flexibility(index) if shares is None else shared_flexibility(contact, shares[j])
            F[columns, columns] = part.in_three(of_rows)
            fields.append(part.spread(self._fields.fields(j)))
        for (j, k), S in core.items():
            F[parts[j], parts[k]] = fields[j] @ S @ fields[k].T
        return F, fields, dict(core)

    def _linearised(self, closed: Sequence[slice]) -> Callable[[int, Array], Array]:
        """See `Coupled`; unsymmetric where rows slip."""
        assert self._problem is not None
        problem, parts = self._problem, self._parts
        problem.linearise()
        rows = consecutive([3 * contact.evaluation.index.size for contact in self.contacts])

        def respond(k: int, way: Array) -> Array:
            ways = np.zeros((rows[-1].stop, way.shape[1]))
            ways[rows[k]] = parts[k].spread(way)
            forces = problem.response(ways)
            return np.concatenate(
                [part.gathered(forces[directions]) for part, directions in zip(parts, rows, strict=True)]
            )

        return respond

    def _find(self, gaps: list[Array]) -> None:
        """See `Coupled`."""
        if not math.isfinite(sum(gap.sum() for gap in gaps)):
            raise ComplementarityError("the gaps are not finite: the run has become unstable")
        if self._stay_open(gaps):
            for part, gap in zip(self._parts, gaps, strict=True):
                part.closing.forget()
                part.contact.answer(gap)
            return
        for part, gap in zip(self._parts, gaps, strict=True):
            part.places = part.contact.places(gap)
        last = [part.last() for part in self._parts]
        for part, lasts in zip(self._parts, self._lasting(last), strict=False):
            part.places.gap, part.places.way = part.places.gap + lasts[:, 0], part.places.way + lasts[:, 1:]
        placed, gaps = gaps, [part.places.gap for part in self._parts]
        pushed, more, self._iterations = self._pushed(gaps), False, 0
        for _ in range(_PASSES):
            for part, gap, before in zip(self._parts, pushed, last, strict=True):
                part.closing.choose(gap, before, more=more)
            near = [part.closing.index for part in self._parts]
            h = self._set_up(near, last)
            in_problem = consecutive(list(map(len, near)))
            for part, chosen, rows, gap in zip(self._parts, in_problem, near, gaps, strict=True):
                if len(rows):
                    h[chosen, 0] += gap[rows]
                    h[chosen, 1:] += part.way()[rows]
            forces = self._solve(h)
            pushed, more = self._pushed(gaps), True
            each_pushed = zip(self._parts, pushed, in_problem, strict=True)
            if not any([part.closing.shuts(gap, forces[numbers], smallest(gap)) for part, gap, numbers in each_pushed]):
                break
        else:
            raise ComplementarityError(
                f"the rows that close in {len(gaps)} contacts on common bodies did not settle in {_PASSES} passes"
            )
        assert self._problem is not None
        moved, state = self._problem.moved_by(forces), self._problem.state
        ends = np.cumsum(list(map(len, near)))[:-1]
        answers = zip(*(np.split(values, ends) for values in (forces, moved, h, state)), strict=True)
        for part, gap, least, (lam, w, start, states) in zip(self._parts, placed, pushed, answers, strict=True):
            part.set_answer(gap, least.min(initial=np.inf), lam, w, start, states, self._iterations)

    def _stay_open(self, gaps: list[Array]) -> bool:
        """Whether no row is closed at gaps, (nr,) [m] each, and none was in the last step."""
        if self._viscous or self._pushing or any(contact.state.memory.closed for contact in self.contacts):
            return False
        return all(smallest(gap) >= 0.0 for gap in gaps)

    def _pushed(self, gaps: list[Array]) -> list[Array]:
        """Gaps of each contact, (nr,) [m], with the displacements that the last forces on the others cause."""
        if not self._pushing:
            return gaps
        return [gap + self._between.closing(j, self._pushing) if len(gap) else gap for j, gap in enumerate(gaps)]

    def _set_up(self, near: Sequence[Array], last: Sequence[Array]) -> Array:
        """Set up the problem of some rows of each contact; return how far the last step's forces hold tangents back.

        Parameters
        ----------
        near : sequence of (k,) int arrays
        last : sequence of (nr, 3) arrays
            Forces at the end of the last accepted step [N].

        Returns
        -------
        (n, 3) array
            Of all these rows [m].
        """
        forces = np.concatenate([f[rows] for f, rows in zip(last, near, strict=True)])
        flexibilities, versions = [part.flexibility() for part in self._parts], self._between.versions()
        if self._problem is None or self._versions != versions or any(is_new for _, is_new in flexibilities):
            self._versions = [*versions]
            F = self._flexibility(near, [F for F, _ in flexibilities])
            if self._problem is None:
                self._problem = BlockFriction(F)
            self._problem.replace_blocks(F, np.concatenate([part.closing.states for part in self._parts]), forces)
        since = max(self._since)
        before = [part.closing.exchange(since, f) for part, f in zip(self._parts, last, strict=True)]
        earlier = [f for f in before if f is not None]
        if earlier:  # a new step: guess that forces change as they did
            self._problem.extrapolate(np.concatenate(earlier))
        held_back = -self._problem.moved_by(forces)
        held_back[:, 0] = 0.0
        return held_back

    def _flexibility(self, near: Sequence[Array], alone: Sequence[Array]) -> BlockFlexibility:
        """Flexibility of some rows, (k,) of each contact; `alone` is that of each contact alone."""
        core, fields, between = self._fields.core, [], {}
        for j, (part, rows) in enumerate(zip(self._parts, near, strict=True)):
            fields.append(part.spread(self._fields.fields(j)[part.contact.rows.directions(rows)]))
        reach = [np.zeros(W.shape[1]) for W in fields]
        for (j, k), S in core.items():
            used, pushing = np.flatnonzero(S.any(axis=1)), np.flatnonzero(S.any(axis=0))
            amplitudes = S[np.ix_(used, pushing)] @ fields[k][:, pushing].T
            between[j, k] = fields[j][:, used] @ amplitudes
            reach[j][used] += np.einsum("ij,ij->i", amplitudes, amplitudes)
        kept = [
            np.flatnonzero(np.sqrt(r * np.einsum("ij,ij->j", W, W)) > _SMALL * np.linalg.norm(F))
            for W, r, F in zip(fields, reach, alone, strict=True)
        ]
        parts = consecutive(list(map(len, kept)))
        few = np.zeros((parts[-1].stop,) * 2)
        for (j, k), S in core.items():
            few[parts[j], parts[k]] = S[np.ix_(kept[j], kept[k])]
        return BlockFlexibility(alone, between, [W[:, k] for W, k in zip(fields, kept, strict=True)], few)

    def _solve(self, h: Array) -> Array:
        """Forces on the rows of the problem, (n, 3) [N]; keep what they push others with."""
        assert self._problem is not None
        mu = np.concatenate([part.places.mu[part.closing.index] for part in self._parts])
        iterations_before = self._problem.iterations
        lam = self._problem.solve(h, mu)
        self._iterations += self._problem.iterations - iterations_before
        places = consecutive([len(part.closing.index) for part in self._parts])
        self._pushing = {}
        for k, (part, in_problem) in enumerate(zip(self._parts, places, strict=True)):
            if lam[in_problem].any():
                rows, forces = part.contact.rows, lam[in_problem, : part.contact.rows.d].ravel()
                self._pushing[k] = self._between.pushing(k, rows.directions(part.closing.index), forces)
        return lam


class SharedFriction(CoupledFriction):
    """Contacts without yield, of which some have friction and some share a patch.

    Rows of one patch move each other through its full flexibility, as in `coupled.SharedPatches`. So the problem has
    one block, with all rows that can close.
    """

    _by_fields = False

    def _flexibility(self, near: Sequence[Array], alone: Sequence[Array]) -> BlockFlexibility:
        """See `CoupledFriction`; here as one full block, for contacts share patches."""
        places, both = consecutive([len(F) for F in alone]), zip(self._parts, near, strict=True)
        F, some = np.zeros((places[-1].stop,) * 2), [part.contact.rows.directions(rows) for part, rows in both]
        for part, block in zip(places, alone, strict=True):
            F[part, part] = block
        for j, k in self._between.pairs:
            between = self._between.flexibility(j, some[j], k, some[k])
            F[places[j], places[k]] = self._parts[j].spread(self._parts[k].spread(between.T).T)
        _soften_redundant(F, [(places[j], places[k]) for j, k in self._between.pairs])
        return BlockFlexibility([F], {}, [np.zeros((len(F), 0))], np.zeros((0, 0)))


def _soften_redundant(F: Array, blocks: Sequence[tuple[slice, slice]]) -> None:
    """Soften directions of two contacts that are one place of a body, as of an edge that two planes press.

    Such rows have more directions than their node can move, and cones of friction leave many answers. Those of
    softer rows are single, and hardly differ.

    Parameters
    ----------
    F : (n, n) array
        Flexibility of all rows [m/N]. Its diagonal is changed.
    blocks : sequence of (slice, slice)
        Directions of two contacts that move each other.
    """
    size, soft = np.sqrt(F.diagonal()), np.zeros(len(F), dtype=bool)
    for first, second in blocks:
        soft[first] |= (abs(F[first, second]) > _ONE_PLACE * np.outer(size[first], size[second])).any(axis=1)
    F.flat[:: len(F) + 1] *= 1.0 + _SOFTER * soft


class _Part:
    """A contact among those that are one problem.

    Each of its rows has three directions there. Nothing moves a frictionless row along tangents.

    Parameters
    ----------
    contact : PatchContact

    Attributes
    ----------
    places : Places
        Its present rows, without the displacements that other contacts cause.
    """

    places: Places

    def __init__(self, contact: PatchContact) -> None:
        self.contact, self.closing = contact, ClosingRows(contact.rows)
        self._checked = False  # whether its flexibility is positive definite

    def spread(self, A: Array) -> Array:
        """A with three rows for each of the contact's, (3 k, m), from d rows, (d k, m)."""
        d = self.contact.rows.d
        if d == 3:
            return A
        result = np.zeros((3 * len(A), A.shape[1]))
        result[::3] = A
        return result

    def gathered(self, A: Array) -> Array:
        """A with d rows for each of the contact's, (d k, m), from three, (3 k, m)."""
        return A if self.contact.rows.d == 3 else A[::3]

    def way(self) -> Array:
        """How far rows have slid since the last accepted step, (nr, 2) [m]."""
        return self.places.way if self.contact.rows.d == 3 else np.zeros((len(self.places.gap), 2))

    def last(self) -> Array:
        """Forces on rows at the end of the last accepted step, (nr, 3) [N]."""
        last = self.places.last
        if self.contact.rows.d == 1:
            last[:, :1] = self.contact.state.memory.forces[self.contact.gaps.row_nodes]
        return last

    def flexibility(self) -> tuple[Array, bool]:
        """Flexibility of the rows that can close, (3 k, 3 k) [m/N], and whether it is another than last time."""
        F, is_new = self.closing.flexibility()
        if len(F) and not self._checked:
            Complementarity(F)  # which checks it
            self._checked = True
        return self.in_three(F), is_new

    def in_three(self, F: Array) -> Array:
        """Flexibility with three directions for each row, (3 k, 3 k), from that with d, (d k, d k) [m/N]."""
        if self.contact.rows.d == 3:
            return F
        wide = np.diag(np.full(3 * len(F), F.diagonal().mean() if len(F) else 1.0))
        wide[::3, ::3] = F
        return wide

    @property
    def _law(self) -> FrictionalCompliance:
        return cast("FrictionalCompliance", self.contact.law)

    def set_answer(
        self, gap: Array, least: float, lam: Array, moved: Array, h: Array, state: Array, iterations: int
    ) -> None:
        """Let the contact have its forces, which were found together with those of the others, as its `evaluation`.

        Parameters
        ----------
        gap : (nr,) array
            Gaps [m].
        least : float
            Least of them with the displacements that other contacts cause [m].
        lam, moved, h, state, iterations
            See `FrictionalCompliance.forces_on_all`.
        """
        contact, closing = self.contact, self.closing
        closing.remember(state)
        if not state.any():
            contact.opened(gap, least)
        elif contact.friction is not None:
            contact.answered(
                self._law.forces_on_all(closing, lam, moved, h, state, iterations), gap, least, self.places
            )
        else:
            forces = np.zeros((len(gap), 1))
            forces[closing.index] = lam[:, :1]
            contact.answered(Forces(forces, closing.index[np.flatnonzero(state)]), gap, least)
