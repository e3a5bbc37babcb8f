"""Contacts with friction of an explicit run, as one frozen value of arrays, and what changes in a run.

Each group of contacts is one problem of friction, see `algebra.friction`: contacts that move each other, of which some
have friction. Rows of contacts without friction have tangents too there, which nothing moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..algebra.complementarity import REGULARISATION
from ..algebra.coulomb import Coulomb
from ..algebra.flat_friction import FlatFriction
from ..algebra.friction import OPEN, SLIP, STICK
from ..contact.formulations.compliance import CHOOSING, SHUT
from ..contact.linear_gaps import FlatRows
from ..support.arrays import Array
from .rubbing import Rubbing

N_FRICTION = 7  # values of each contact, as its sensor `sFriction` reads them
_PASSES = 100  # in which rows that close in contacts on common bodies must settle
CHOICES = (*CHOOSING, REGULARISATION, _PASSES, SHUT)

Choosing = tuple[float, float, int, int, float, float, int, float]


class FrictionMemory(NamedTuple):
    """What rows remember at the end of a step, see `contact.memory.RowMemory`.

    Parameters
    ----------
    forces : (nr, 3) array
        Along normal and tangents [N].
    before : (nr, 3) array
        The same one step earlier, by which forces are guessed [N].
    slipped : (nr,) bool array
    speed, path : (nr,) arrays
        Speed of slip, and its path so far [m/s, m].
    dissipated : (nc,) array
        Energy that friction has taken so far in each contact [J].
    tractions : (nr, 3) array
        Of rows that follow the motion: tangential forces in the body's axes [N]. Those of `forces` follow from them.
    """

    forces: Array
    before: Array
    slipped: Array
    speed: Array
    path: Array
    dissipated: Array
    tractions: Array

    @classmethod
    def none(cls, nr: int, nc: int) -> FrictionMemory:
        """At the start of a run."""
        forces, slipped, speed = np.zeros((nr, 3)), np.zeros(nr, dtype=bool), np.zeros(nr)
        return cls(forces, forces.copy(), slipped, speed, speed.copy(), np.zeros(nc), forces.copy())

    def copy(self) -> FrictionMemory:
        """The same in arrays of its own."""
        return FrictionMemory(*(part.copy() for part in self))


class FlatFrictionRows(NamedTuple):
    """Rows of all contacts in flat arrays, as compiled loops take them.

    Parameters
    ----------
    rows : FlatRows
        Their gaps.
    ways : (nc,) int array
        Where the derivative of each contact's tangential places by its coordinates begins in `numbers`, transposed:
        (n, 2 nr).
    numbers : array
    tangents : (nr, 2, 3) array
        In space.
    groups : (ng + 1,) int array
        First contact of each group.
    flexible, F_starts : array, (ng,) int array
        Flexibility of all rows of each group, (3 k, 3 k) [m/N], and where it begins.
    frictional : (nc,) bool array
        Which contacts have friction.
    """

    rows: FlatRows
    ways: Array
    numbers: Array
    tangents: Array
    groups: Array
    flexible: Array
    F_starts: Array
    frictional: Array

    def blocks(self) -> list[Array]:
        """Flexibility of each group, (3 k, 3 k) [m/N], as views."""
        sizes = [3 * int(n) for n in np.diff(self.rows.starts[self.groups])]
        both = zip(self.F_starts.tolist(), sizes, strict=True)
        return [self.flexible[start:][: n * n].reshape(n, n) for start, n in both]


class FrictionState(NamedTuple):
    """What changes in a run.

    Parameters
    ----------
    memory : FrictionMemory
        At the start of the present step.
    coulomb : (nc, 3) array
        Static and kinetic coefficients, and decay [m/s]; zero if the coefficient falls at once.
    gap, pushed : (nr,) arrays
        Gaps, and gaps with the displacements that other contacts cause [m].
    way : (nr, 2) array
        How far rows have slid in the step [m].
    lam : (nr, 3) array
        Forces [N].
    status : (nr,) int8 array
    slips : (nr, 2) array
        How far rows have slipped in the step [m].
    energy : (nr,) array
        That each row stores [J].
    mu : (nr,) array
    near : (nr,) bool array
        Rows that can close.
    chosen : (nr,) int array
        For each group from its first row on: numbers of the chosen rows in the group.
    owner, fresh : (1,) int array, (ng,) bool array
        Group whose problem compiled loops have at hand, and which problems must be set up.
    h, mu_near, moved : (k, 3), (k,), (3 k,) arrays
        Of these rows.
    taken : (nc,) array
        Energy that friction takes in the step [J].
    values, friction, stored : (nc, 6), (nc, 7), (nc,) arrays
        As the sensors `sForce` and `sFriction` have them, and stored energy [J].
    iterations : (nc,) int array
    pool : FlatFriction
        Problems of all groups, see `FlatFriction.pool`.
    """

    memory: FrictionMemory
    coulomb: Array
    gap: Array
    pushed: Array
    way: Array
    lam: Array
    status: Array
    slips: Array
    energy: Array
    mu: Array
    near: Array
    chosen: Array
    owner: Array
    fresh: Array
    h: Array
    mu_near: Array
    moved: Array
    taken: Array
    values: Array
    friction: Array
    stored: Array
    iterations: Array
    pool: FlatFriction

    def begin(self, plan: FrictionPlan, memory: FrictionMemory | None) -> None:
        """Begin a run of a plan from a memory; None is that of a new run.

        Coefficients and memory become those of this run, and all guesses are forgotten.
        """
        self.coulomb[:] = [
            (0.0,) * 3 if law is None else (law.static, law.kinetic, law.decay or 0.0) for law in plan.laws
        ]
        for kept, given in zip(self.memory, memory or [np.zeros(())] * len(self.memory), strict=True):
            kept[...] = given
        self._answer_as_memory()
        self.near[:], self.iterations[:] = False, 0
        self.forget()

    def forget(self) -> None:
        """Let all problems be set up anew."""
        self.pool.counts[:], self.fresh[:], self.owner[:] = 0, True, -1

    def go_back(self, memory: FrictionMemory | None) -> None:
        """Go back to an earlier memory of the same run."""
        assert memory is not None
        for kept, given in zip(self.memory, memory, strict=True):
            kept[:] = given
        self._answer_as_memory()

    def _answer_as_memory(self) -> None:
        self.lam[:] = self.memory.forces
        self.status[:] = np.where(self.lam[:, 0] > 0.0, np.where(self.memory.slipped, SLIP, STICK), OPEN)


@dataclass(frozen=True, eq=False)
class FrictionPlan:
    """Contacts with friction and frozen pairs, group after group.

    Parameters
    ----------
    names : tuple of str
    rows : FlatRows
        Gaps of all rows.
    ways : tuple of (2 nr, n) arrays
        Derivative of each contact's tangential places by its coordinates.
    tangents : (nr, 2, 3) array
        In space.
    groups : (ng + 1,) int array
        First contact of each group.
    flexibilities : tuple of (3 k, 3 k) arrays
        Of all rows of each group [m/N].
    laws : tuple of Coulomb or None
    rubbing : Rubbing, optional
        Contacts whose rows follow the motion. In all else these have rows without coordinates, and no flexibility.
    """

    names: tuple[str, ...]
    rows: FlatRows
    ways: tuple[Array, ...]
    tangents: Array
    groups: Array
    flexibilities: tuple[Array, ...]
    laws: tuple[Coulomb | None, ...]
    rubbing: Rubbing | None = None

    @property
    def n_rows(self) -> int:
        """Number of all rows."""
        return int(self.rows.starts[-1])

    def rows_of(self, group: int) -> slice:
        """Rows of a group."""
        return slice(*(int(self.rows.starts[contact]) for contact in self.groups[group : group + 2]))

    def contacts_of(self, group: int) -> range:
        """Contacts of a group."""
        return range(*self.groups[group : group + 2])

    def with_coefficients(self, changed: Sequence[float | None]) -> FrictionPlan:
        """The same contacts with other coefficients, which do not fall; None changes nothing."""
        if all(mu is None for mu in changed):
            return self
        laws = [law if mu is None else Coulomb(mu) for law, mu in zip(self.laws, changed, strict=True)]
        return replace(self, laws=tuple(laws))

    def softened(self, flexibilities: Sequence[Array], rubbing: Rubbing | None) -> FrictionPlan:
        """The same contacts with other flexibilities of each group, and of rows that follow the motion."""
        return replace(self, flexibilities=tuple(flexibilities), rubbing=rubbing)

    def flat(self) -> FlatFrictionRows:
        """The same in flat arrays, but coefficients; what moving rows write to is that of one run."""
        ways, flexibilities = [np.ascontiguousarray(T.T).ravel() for T in self.ways], self.flexibilities
        begins = [np.cumsum([0, *(part.size for part in parts)])[:-1] for parts in (ways, flexibilities)]
        F = np.concatenate([np.empty(0), *(block.ravel() for block in flexibilities)])
        numbers = np.concatenate([np.empty(0), *ways])
        frictional = np.array([law is not None for law in self.laws])
        rows, tangents = self.rows, self.tangents
        if self.rubbing is not None:
            rows, tangents = rows.with_room(self.rubbing.contact), tangents.copy()
        return FlatFrictionRows(rows, begins[0], numbers, tangents, self.groups, F, begins[1], frictional)

    def state(self, values: Array, stored: Array) -> FrictionState:
        """Room for what changes; values of `sForce`, (nc, 6), and energies, (nc,), are written to given arrays."""
        nr, nc = self.n_rows, len(self.names)
        sizes = [int(last - first) for first, last in pairwise(self.rows.starts[self.groups])]
        k = max(sizes)
        return FrictionState(
            memory=FrictionMemory.none(nr, nc), coulomb=np.zeros((nc, 3)), gap=np.zeros(nr), pushed=np.zeros(nr),
            way=np.zeros((nr, 2)), lam=np.zeros((nr, 3)), status=np.zeros(nr, dtype=np.int8), slips=np.zeros((nr, 2)),
            energy=np.zeros(nr), mu=np.zeros(nr), near=np.zeros(nr, dtype=bool), chosen=np.zeros(nr, dtype=np.int64),
            owner=np.full(1, -1), fresh=np.ones(len(sizes), dtype=bool), h=np.zeros((k, 3)), mu_near=np.zeros(k),
            moved=np.zeros(3 * k), taken=np.zeros(nc), values=values, friction=np.zeros((nc, N_FRICTION)),
            stored=stored, iterations=np.zeros(nc, dtype=np.int64), pool=FlatFriction.pool(sizes),
        )  # fmt: skip
