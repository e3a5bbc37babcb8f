"""Several contacts on one body: through its residual flexibility, a force on one patch moves the others."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, cast

import numpy as np

from ...algebra.block_complementarity import BlockComplementarity
from ...algebra.complementarity import Complementarity, regularised
from ...algebra.products import dense
from ...errors import ComplementarityError
from ...support.arrays import Array, consecutive
from ...support.attributes import copied
from .. import loops
from ..between import Between, Exchange, FlexibilityBetween, Link, RowFields, Shares, shared_flexibility
from ..followed import BULGE, WIDER
from ..frozen import FrozenContacts
from ..patch_contact import PatchContact
from ..viscosity import lasting
from .compliance import NormalCompliance

if TYPE_CHECKING:
    from typing import Self

    from .formulation import Links

_PASSES = 100
_HARDLY = 1e-4  # of the forces on a contact that moves: smaller ones on others are left out of the stiffness


class Coupled:
    """Compliance contacts that share bodies, solved together: what all kinds of them have.

    A patch moves the others of its body by few smooth fields. Only their amplitudes are exchanged.

    Parameters
    ----------
    contacts : list of PatchContact
        Contacts with formulation 'compliance'.
    links : Links
        For each two sides that move each other, a call of it returns the numbers of a contact and its side, of the
        other contact and its side, and the body's flexibility between the patches, (d np, d np) [m/N].
    """

    _by_fields = True  # whether few fields are all that contacts exchange

    _moved_before: list[list[Array] | None]  # of each contact's sides by others in the last step, if they are viscous

    def __init__(self, contacts: Sequence[PatchContact], links: Links) -> None:
        self.contacts, self._links = [*contacts], links
        self._answered_state: Array | None = None
        # Found when somebody asks: flexibilities between sides in full, and what they do to the rows of the contacts.
        self._links_in_full: Sequence[Link] | None = None
        self._between_rows: Between | None = None

    @cached_property
    def _exchange(self) -> Exchange:
        return Exchange.of(self._links())

    @property
    def _all_links(self) -> Sequence[Link]:
        """Flexibilities between sides in full, where few fields are not enough."""
        if self._links_in_full is None:
            self._links_in_full = self._links()
        return self._links_in_full

    @property
    def _between(self) -> Between:
        """Motion of the rows by forces on other contacts; for flexibilities in full, links are found when needed."""
        if self._between_rows is None:
            rows = [contact.rows for contact in self.contacts]
            by_fields = self._by_fields
            self._between_rows = (
                RowFields(rows, self._exchange) if by_fields else FlexibilityBetween(rows, self._all_links)
            )
        return self._between_rows

    def _prepare(self) -> None:
        """Compute the data that all runs share."""
        if self._by_fields:
            self._exchange  # noqa: B018 - the property keeps its value

    def _begin(self) -> None:
        """Begin a run with the present contacts."""
        self._remembering = [contact for contact in self.contacts if contact.remembers]
        self._since: list[float] = []
        self._carried = [contact for contact in self.contacts if contact.gaps.carried]
        self._pressed = [contact for contact in self.contacts if contact.gaps.placement.overlap]
        self._viscous = any(contact.viscous for contact in self._remembering)
        self._between_rows = None  # that of other contacts

    def for_run(self, contacts: Sequence[PatchContact]) -> Self:
        """Return the same object for the contacts of a run; the flexibility between patches is shared."""
        self._prepare()
        result = copied(self)
        result.contacts, result._answered_state = [*contacts], None
        result._begin()
        return result

    @property
    def divides(self) -> bool:
        """Whether some of the contacts may be solved without the others, see `some`."""
        return not self._by_fields

    def some(self, places: Sequence[int]) -> Self:
        """Return the same object for some of its contacts in the same run, by their numbers. The others are open."""
        result = copied(self)
        result.contacts, result._links = [self.contacts[j] for j in places], self._links.some(places)
        result._answered_state = result._links_in_full = None
        result._begin()
        return result

    def forces(self, coordinates: Sequence[Array]) -> list[Array]:
        """Generalised forces of each contact, (n,), at its coordinates, (n,)."""
        return self.forces_at(np.concatenate(coordinates), lambda: coordinates)

    def forces_at(self, state: Array, coordinates: Callable[[], Sequence[Array]]) -> list[Array]:
        """Generalised forces of each contact, (n,), in a state of the model.

        Every contact needs its forces in the same state, but they are computed once. Where a body carries a rigid
        surface, its place is part of the state.

        Parameters
        ----------
        state : (m,) array
            Values that determine the coordinates of all contacts.
        coordinates : callable
            Returns the coordinates of each contact, (n,). It is called only when the state has changed.
        """
        if len(self.contacts) == 1:
            self.contacts[0].at(coordinates()[0])
            return [self.contacts[0].generalised()]
        self._since = since = [contact.since for contact in self._remembering]
        more = [contact.gaps.carrier.pose for contact in self._carried]
        more += [np.atleast_1d(contact.opening) for contact in self._pressed]
        if self._viscous:
            more += [np.array(contact.gaps.yielding_shares) for contact in self.contacts]
        whole_state = np.concatenate([state, since, *more]) if since or more else state
        begun = any([contact.evaluation.begun for contact in self.contacts])  # a list is quicker than a generator
        if begun or self._answered_state is None or not _equal(whole_state, self._answered_state):
            self._find_at(coordinates())
            if self._viscous:
                self._creep()
            self._answered_state, self._forces = (
                whole_state.copy(),
                [contact.generalised() for contact in self.contacts],
            )
        return self._forces

    def _find_at(self, coordinates: Sequence[Array]) -> None:
        """Find the forces of all contacts at their coordinates, with all rows that may close."""
        lacking = True
        while lacking:
            self._find([contact.gap_at(q) for contact, q in zip(self.contacts, coordinates, strict=True)])
            lacking = any([contact.lacks_rows(shared=True) for contact in self.contacts])

    def _lasting(self, last: Sequence[Array]) -> list[Array]:
        """Displacements of the rows that last from forces on other contacts, (nr, d) each [m]; empty without any.

        See `viscosity.Yielding.lasting`. `last`, (nr, 3) each [N], are forces at the end of the last accepted step.
        """
        self._moved_before = [None] * len(self.contacts)
        if not any(contact.state.creep.elastic for contact in self.contacts):
            return []
        before = [contact.carried_before(f) for contact, f in zip(self.contacts, last, strict=True)]
        by_elastic = more = self._between.across(before)
        if any(contact.rows.d > 1 for contact in self.contacts):
            exceed = [
                [f[:, : elastic.shape[1]] - elastic for elastic in sides] for sides, f in zip(before, last, strict=True)
            ]
            more = self._between.across(exceed)
        self._moved_before = [*by_elastic]
        both = zip(self.contacts, by_elastic, more, strict=True)
        return [lasting(contact.gaps.yielding_shares, elastic, since) for contact, elastic, since in both]

    @property
    def _fields(self) -> RowFields:
        """What contacts exchange, if few fields are all."""
        assert isinstance(self._between, RowFields)
        return self._between

    def patch_fields(self, j: int, side: int) -> Array:
        """Fields of a side's patch of contact j that contacts exchange, (d np, m), see `between.Exchange`."""
        of_sides, flexibility = dict(self._exchange.fields.get(j, ())), self.contacts[j].gaps.sides[side].flexibility
        none = np.zeros((0 if flexibility is None else len(flexibility), 0))
        return of_sides.get(side, none)

    def _creep(self) -> None:
        """Tell answers how the elastic forces on other contacts move their rows."""
        moved = self._between.across([contact.evaluation.carried() for contact in self.contacts])
        for contact, now, before in zip(self.contacts, moved, self._moved_before, strict=True):
            contact.evaluation = contact.evaluation.pushed_by(now, before)

    def _find(self, gaps: list[Array]) -> None:
        """Find the forces of all contacts at gaps of their rows, (nr,) [m] each, which become their `evaluation`."""
        raise NotImplementedError

    def stiffness(self, rows: Mapping[int, Array]) -> dict[tuple[int, int], Array]:
        """See `formulation.Together`."""
        if not rows:
            return {}
        closed, result = consecutive([contact.rows.d * contact.evaluation.index.size for contact in self.contacts]), {}
        respond = self._linearised(closed)
        for k, of_k in rows.items():
            forces = respond(k, of_k)
            sizes = {j: abs(forces[closed[j]]).max(initial=0.0) for j in rows}
            for j in [j for j, size in sizes.items() if size >= _HARDLY * sizes[k]]:
                result[j, k] = rows[j].T @ forces[closed[j]]
        return result

    def closed_stiffness(self, places: Sequence[int]) -> dict[tuple[int, int], Array]:
        """See `formulation.Together`.

        By the formula of Woodbury: F of each contact's rows, and few fields W with amplitudes S between contacts, give
        (F + W S W')^-1 = F^-1 - F^-1 W (1 + S W' F^-1 W)^-1 S W' F^-1.
        """
        if not self._by_fields:
            alone = {j: self.contacts[j].closed_stiffness() for j in places}
            return {(j, j): K for j, K in alone.items() if K is not None}
        fields = RowFields([contact.rows for contact in self.contacts], self._exchange)
        ways, of_fields, result = dict[int, Array](), dict[int, Array](), dict[tuple[int, int], Array]()
        for j in places:
            rows, W = self.contacts[j].rows, fields.fields(j)
            everything = np.arange(len(rows.gaps.row_nodes))
            H = dense(rows.jacobian(everything))
            solved = np.linalg.solve(regularised(rows.flexibility(everything)), np.hstack([H, W]))
            result[j, j] = H.T @ solved[:, : H.shape[1]]
            ways[j], of_fields[j] = W.T @ solved[:, : H.shape[1]], W.T @ solved[:, H.shape[1] :]
        of_contact = dict(zip(places, consecutive([len(ways[j]) for j in places]), strict=True))
        n = sum(map(len, ways.values()))
        S, inner = np.zeros((n, n)), np.zeros((n, n))
        for (j, k), core in self._exchange.core.items():
            if j in of_contact and k in of_contact:
                S[of_contact[j], of_contact[k]] = core
        for j, flexible in of_fields.items():
            inner[of_contact[j], of_contact[j]] = flexible
        forces = np.linalg.solve(np.eye(n) + S @ inner, S)
        for j, k in itertools.product(places, places):
            result[j, k] = result.get((j, k), 0.0) - ways[j].T @ forces[of_contact[j], of_contact[k]] @ ways[k]
        return result

    def _linearised(self, closed: Sequence[slice]) -> Callable[[int, Array], Array]:
        """Return what finds minus the change of the forces on all closed rows if those of one contact move.

        Parameters
        ----------
        closed : sequence of slice
            Where the directions of each contact's closed rows are.

        Returns
        -------
        callable
            Its arguments are the number of the contact, and m ways of its rows, (d na, m) [m]; forces are (n, m) [N].
        """
        raise NotImplementedError

    def frozen(self, dofs: Sequence[Array], last: FrozenContacts | None) -> FrozenContacts | None:
        """All contacts for compiled loops, starting from the present forces; None if pairs move, or without such loops.

        Parameters
        ----------
        dofs : sequence of (n,) int arrays
            Numbers of each contact's coordinates in the model.
        last : FrozenContacts or None
            Last return value. It is used again if it has the same pairs.
        """
        return None

    def answer_as(self, frozen: FrozenContacts, coordinates: Sequence[Array]) -> bool:
        """Let the contacts answer as `frozen` did, whose last evaluation was at these coordinates of each.

        Return False if pairs have changed since then, because gaps were evaluated elsewhere. Then contacts find the
        state themselves.
        """
        raise NotImplementedError


class CoupledContacts(Coupled):
    """Contacts without friction and yield.

    Their forces minimise one potential, 1/2 lambda' F lambda + lambda' h over lambda >= 0, with F of all rows; see
    `BlockComplementarity`. A contact enters if it is closed, or if the others close it.
    """

    def __init__(self, contacts: Sequence[PatchContact], links: Links) -> None:
        super().__init__(contacts, links)
        if len(contacts) == 1:
            self._compile()

    def _compile(self) -> None:
        """Evaluate a contact alone at the start, so that loops are compiled before a run begins."""
        n = self.contacts[0].gaps.n
        alone = self.for_run(self.contacts).frozen([np.arange(n)], None)
        if alone is not None:
            alone.at(np.zeros(n))

    def _begin(self) -> None:
        super()._begin()
        self._joint = BlockComplementarity(len(self.contacts), self._exchange.core)
        self._some: dict[int, tuple[int, Array, Array]] = {}

    def frozen(self, dofs: Sequence[Array], last: FrozenContacts | None) -> FrozenContacts | None:
        """See `Coupled`."""
        gaps = [contact.gaps for contact in self.contacts]
        moving, pressed = any([rows.moving for rows in gaps]), any([contact.opening for contact in self._pressed])
        if moving or pressed or not loops.at_once():
            return None
        if last is None or not last.has_pairs_of(gaps):
            blocks, fields, _ = self.blocks()
            last = FrozenContacts(gaps, dofs, self._joint.flat(blocks, fields))
        last.guess(np.concatenate([contact.evaluation.lam > 0.0 for contact in self.contacts]))
        return last

    def blocks(self, shares: Shares | None = None) -> tuple[list[Array], list[Array], Mapping[tuple[int, int], Array]]:
        """Problem of the forces while pairs are frozen, see `BlockComplementarity`; zero for contacts whose rows move.

        Parameters
        ----------
        shares : Shares, optional
            How much of the flexibility of each side's body counts. Default: all.

        Returns
        -------
        Flexibility of each contact's rows, (nr, nr) [m/N]; displacements of these rows in the fields that contacts
        exchange, (nr, m); and what amplitudes of fields one contact causes in another, (m, m) [m/N].
        """
        n_fields = max(map(len, self._exchange.core.values()), default=0)
        within_contacts, fields = list[Array](), list[Array]()
        for j, (law, contact) in enumerate(zip(self._laws, self.contacts, strict=True)):
            if contact.gaps.moving:
                n_rows = len(contact.gaps.all_points.row_nodes)
                within_contacts.append(np.zeros((n_rows, n_rows)))
                fields.append(np.zeros((n_rows, n_fields)))
            else:
                law.renew_problem()
                within_contacts.append(
                    law.problem.F if shares is None else regularised(shared_flexibility(contact.rows, shares[j]))
                )
                fields.append(self._fields.fields(j))
        return within_contacts, fields, self._exchange.core if shares is None else self._exchange.yielding(shares)

    @property
    def _laws(self) -> list[NormalCompliance]:
        """Laws of the contacts."""
        return cast("list[NormalCompliance]", [contact.law for contact in self.contacts])

    def answer_as(self, frozen: FrozenContacts, coordinates: Sequence[Array]) -> bool:
        """See `Coupled`."""
        self._answered_state = None
        if not frozen.has_pairs_of([contact.gaps for contact in self.contacts]):
            self.forces(coordinates)
            return False
        bounds = [*itertools.pairwise(frozen.starts.tolist())]
        lam, moved = ([part[a:b].copy() for a, b in bounds] for part in (frozen.lam, frozen.pushed))
        for j, (law, iterations) in enumerate(zip(self._laws, frozen.pop_iterations(), strict=True)):
            near = law.near(moved[j], moved[j].min()) if lam[j].any() else None
            self._set_answer(j, self.contacts[j].gaps.at(coordinates[j]), moved[j], near, lam[j], int(iterations))
        return True

    def _set_answer(self, j: int, gap: Array, moved: Array, near: Array | None, lam: Array, iterations: int) -> None:
        """Let a contact have forces on the rows `near`, (k,) [N], that were found together with those of the others.

        Its gaps are `gap`, (nr,) [m]. `moved` are the gaps with the displacements that the other contacts cause.
        """
        contact, least = self.contacts[j], moved.min(initial=np.inf)
        if near is None:
            contact.iterations += iterations
            contact.opened(gap, least)
        else:
            contact.answered(self._laws[j].forces_on_all(moved, near, lam, iterations), gap, least)

    def _linearised(self, closed: Sequence[slice]) -> Callable[[int, Array], Array]:
        """See `Coupled`."""
        inverse = np.linalg.inv(self._flexibility(closed))
        return lambda k, way: inverse[:, closed[k]] @ way

    def _flexibility(self, closed: Sequence[slice]) -> Array:
        """Flexibility of the closed rows of all contacts, (n, n) [m/N]."""
        index = {j: contact.evaluation.index for j, contact in enumerate(self.contacts)}
        F = flexibility_between(self._between, dict(enumerate(closed)), index)
        for law, contact, rows in zip(self._laws, self.contacts, closed, strict=True):
            F[rows, rows] = law.active_flexibility() if contact.evaluation.index.size else 0.0
        return F

    def _find(self, gaps: list[Array]) -> None:
        """See `Coupled`. A contact enters if it presses, or if the others press it."""
        pushed, near, lam = [*gaps], dict[int, Array](), dict[int, Array]()
        for law in self._laws:
            law.problem.iterations = 0
        shares, missing = [BULGE] * len(gaps), set[int]()
        for _ in range(_PASSES):
            entering = [j for j, h in enumerate(pushed) if j in missing or _presses(h, near.get(j))]
            if not entering:
                break
            for j in entering:
                shares[j] *= WIDER if j in missing else 1.0
                near[j] = self._laws[j].near(pushed[j], pushed[j].min(), shares[j])
            lam = self._solve(near, gaps)
            pushed = [self._pushed_gap(j, gap) for j, gap in enumerate(gaps)]
            missing = {
                j
                for j, rows in near.items()
                if self._laws[j].misses(pushed[j], rows, lam[j], pushed[j].min(), shares[j])
            }
        else:
            raise ComplementarityError(
                f"the rows that close in {len(gaps)} contacts on common bodies did not settle in {_PASSES} passes"
            )
        for j, (gap, moved) in enumerate(zip(gaps, pushed, strict=True)):
            self._set_answer(j, gap, moved, near.get(j), lam.get(j, np.empty(0)), self._laws[j].problem.iterations)

    def _solve(self, near: dict[int, Array], gaps: list[Array]) -> dict[int, Array]:
        """Forces on the near rows of each contact, (k,) [N]."""
        laws = self._laws
        return self._joint.solve(
            {j: laws[j].problem for j in near},
            {j: _rows_of(gaps[j], rows) for j, rows in near.items()},
            {j: self._fields_of(j, rows) for j, rows in near.items()},
        )

    def _fields_of(self, j: int, rows: Array) -> Array:
        """Displacements of some rows in the fields, (na, m); the same array for the same rows."""
        fields, last, version = self._fields.fields(j), self._some.get(j), self._between.versions()[j]
        if last is None or last[0] != version or not _equal(last[1], rows):
            last = self._some[j] = version, rows, _rows_of(fields, rows)
        return last[2]

    def _pushed_gap(self, j: int, gap: Array) -> Array:
        """Gaps of the j-th contact, (nr,) [m], with the displacements that the other contacts cause."""
        pushed, c = self._joint.pushed.get(j), self._joint.amplitudes[j]
        if pushed is not None and len(pushed) == len(gap):
            return pushed
        return np.asarray(gap + self._fields.fields(j) @ c) if c.any() else gap


class SharedPatches(CoupledContacts):
    """Frictionless contacts, some of which share a patch, solved as one problem.

    Rows of one patch move each other through its full flexibility, not through a few fields. So the flexibility between
    all rows that can close is set up. It is kept while these rows stay the same and move little.
    """

    _by_fields = False

    def frozen(self, dofs: Sequence[Array], last: FrozenContacts | None) -> FrozenContacts | None:
        """See `CoupledContacts.frozen`; there are no compiled loops for full flexibilities."""
        return None

    def _begin(self) -> None:
        Coupled._begin(self)
        self._whole: Complementarity | None = None
        self._versions: list[int] = []  # of the rows in the problem, see `FlexibilityBetween.versions`
        self._flexibilities: dict[int, Array] = {}  # their flexibility, by contact
        self._pushing: dict[int, dict[int, tuple[Array, Array]]] = {}

    def _solve(self, near: dict[int, Array], gaps: list[Array]) -> dict[int, Array]:
        """See `CoupledContacts._solve`."""
        near = {j: near[j] for j in sorted(near)}  # contacts enter in any order
        flexibilities, versions = {j: self._laws[j].problem.F for j in near}, self._between.versions()
        places = dict(zip(near, consecutive(list(map(len, near.values()))), strict=True))
        if (
            versions != self._versions
            or flexibilities.keys() != self._flexibilities.keys()
            or any(flexibilities[j] is not F for j, F in self._flexibilities.items())
        ):
            self._versions, self._flexibilities = [*versions], flexibilities
            F = flexibility_between(self._between, places, near)
            for j, part in places.items():
                F[part, part] = flexibilities[j]
            if self._whole is None:
                self._whole = Complementarity(F)
            else:
                self._whole.replace(F, np.concatenate([self._laws[j].problem.active for j in near]))
        assert self._whole is not None
        lam = self._whole.solve(np.concatenate([_rows_of(gaps[j], rows) for j, rows in near.items()]))
        by_contact = {j: lam[part] for j, part in places.items()}
        self._pushing = {
            j: self._between.pushing(j, near[j], forces) for j, forces in by_contact.items() if forces.any()
        }
        return by_contact

    def _pushed_gap(self, j: int, gap: Array) -> Array:
        """See `CoupledContacts._pushed_gap`."""
        return gap + self._between.closing(j, self._pushing) if len(gap) else gap


def flexibility_between(between: Between, places: Mapping[int, slice], directions: Mapping[int, Array]) -> Array:
    """Flexibility between rows of contacts, (n, n) [m/N], with zero diagonal blocks.

    Parameters
    ----------
    between : Between
    places : dict of int to slice
        Where the directions of each contact's rows are, one contact after the other.
    directions : dict of int to int array
        Their numbers among those of the contact.
    """
    F = np.zeros((max((part.stop for part in places.values()), default=0),) * 2)
    for j, k in between.pairs:
        if j in places and k in places:
            F[places[j], places[k]] = between.flexibility(j, directions[j], k, directions[k])
    return F


def _equal(a: Array, b: Array) -> bool:
    """Whether two vectors are the same; np.array_equal takes several times as long for short ones."""
    return len(a) == len(b) and bool((a == b).all())


def _rows_of(values: Array, rows: Array) -> Array:
    """Some rows of values, (na, ...), by their numbers; the same object if these are all."""
    return values if len(rows) == len(values) else values[rows]


def _presses(h: Array, near: Array | None) -> bool:
    """Whether rows that are not `near` have negative gaps, or gaps that are not finite."""
    if near is not None:
        if len(near) == len(h):
            return False
        h = np.delete(h, near)
    return not h.min(initial=np.inf) >= 0.0
