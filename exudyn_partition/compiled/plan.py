"""What an explicit run of bodies and contacts needs, as one frozen value of arrays.

Bodies move by modes. Where pairs of contacts are frozen, and frames do not turn, gaps are linear in the coordinates.
Module `moving` has all else.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..algebra.block_complementarity import BlockComplementarity, FlatBlocks
from ..algebra.complementarity import Complementarity
from ..contact.linear_gaps import FlatRows
from ..support.arrays import Array
from .friction_plan import FrictionPlan
from .moving import MovingPlan

Core = Mapping[tuple[int, int], Array]


class Bodies(NamedTuple):
    """All bodies, by shapes that neither mass nor stiffness nor damping couples; see `StepPlan`.

    Parameters
    ----------
    mass, stiffness, damping : (nq,) arrays
        Diagonals of the matrices.
    load : (nq,) array
        Generalised forces that do not change.
    """

    mass: Array
    stiffness: Array
    damping: Array
    load: Array


class Motion(NamedTuple):
    """State of a run within a step; the loop writes to its arrays.

    Parameters
    ----------
    q, v, a : (nq,) arrays
        Coordinates, velocities and accelerations.
    q_start, v_start : (nq,) arrays
        Coordinates and velocities at the start of the step.
    force : (nq,) array
        Generalised forces of all contacts.
    """

    q: Array
    v: Array
    a: Array
    q_start: Array
    v_start: Array
    force: Array

    @classmethod
    def of(cls, n: int) -> Motion:
        """Room for n coordinates."""
        return cls(*np.zeros((6, n)))


@dataclass(frozen=True, eq=False)
class FrozenPlan:
    """Contacts by compliance: those without friction, and after them groups with friction.

    Pairs are frozen but for those of `moving`.

    Parameters
    ----------
    names : tuple of str
        Of the contacts without friction.
    rows : FlatRows
        Gaps of all rows.
    own, fields : tuples of arrays
        Flexibility of each contact's rows, (nr, nr) [m/N], and their displacements in fields that contacts on common
        bodies exchange, (nr, m).
    core : dict of (int, int) to (m, m) array
        What contacts exchange, see `BlockComplementarity`.
    friction : FrictionPlan, optional
        Contacts with friction, and those that they move.
    moving : MovingPlan, optional
        Bodies in floating frames, and contacts whose rows follow the motion. In all else these contacts have rows
        without coordinates, and no flexibility.
    """

    names: tuple[str, ...]
    rows: FlatRows
    own: tuple[Array, ...]
    fields: tuple[Array, ...]
    core: Core
    friction: FrictionPlan | None = None
    moving: MovingPlan | None = None

    @property
    def all_names(self) -> tuple[str, ...]:
        """Names of all contacts."""
        return self.names if self.friction is None else self.names + self.friction.names

    @property
    def all_starts(self) -> Array:
        """Where the rows of each of all contacts begin, and their end, (n + 1,)."""
        starts: Array = self.rows.starts
        return starts if self.friction is None else np.r_[starts, starts[-1] + self.friction.rows.starts[1:]]

    @property
    def n_rows(self) -> int:
        """Number of rows of all contacts."""
        return int(self.all_starts[-1])

    @property
    def move_each_other(self) -> bool:
        """Whether contacts move each other through their bodies."""
        friction = self.friction
        return bool(self.core) or (friction is not None and len(friction.groups) <= len(friction.names))

    def joint(self) -> BlockComplementarity:
        """Return a solver of the forces by NumPy, which knows no run yet; compiled loops take `blocks_of_run`."""
        return BlockComplementarity(len(self.names), self.core)

    @cached_property
    def problems(self) -> tuple[Complementarity, ...]:
        """Problem of each contact's own rows, by NumPy."""
        return tuple(map(Complementarity, self.own))

    @cached_property
    def _blocks(self) -> FlatBlocks:
        return self.joint().flat(self.own, self.fields)

    def blocks_of_run(self) -> FlatBlocks:
        """The problem in flat arrays, with room of its own for what changes in a run; matrices are shared."""
        blocks = self._blocks
        changing = "active", "closed", "n_closed", "factors", "responses", "G", "amplitudes", "lam", "pushed"
        own = blocks._replace(**{name: getattr(blocks, name).copy() for name in (*changing, "iterations")})
        return own if self.moving is None else self.moving.with_room(own)


@dataclass(frozen=True, eq=False)
class StepPlan:
    """Bodies, contacts and loads of an explicit run.

    Parameters
    ----------
    bodies : Bodies
    contacts : FrozenPlan
    """

    bodies: Bodies
    contacts: FrozenPlan


def joined_fields(groups: Sequence[tuple[Sequence[Array], Core]]) -> tuple[tuple[Array, ...], Core]:
    """Fields and core of all contacts, from those of groups that exchange nothing, see `FrozenPlan`."""
    size = max((W.shape[1] for fields, _ in groups for W in fields), default=0)
    joined, core = list[Array](), dict[tuple[int, int], Array]()
    for fields, of_group in groups:
        first = len(joined)
        for (j, k), block in of_group.items():
            core[first + j, first + k] = np.pad(block, (0, size - len(block)))
        joined += [np.pad(W, ((0, 0), (0, size - W.shape[1]))) for W in fields]
    return tuple(joined), core
