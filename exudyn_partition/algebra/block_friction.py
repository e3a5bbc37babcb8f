"""Contact with friction in several blocks of rows, which move each other: the rows of contacts on common bodies.

`FrictionProblem` solves the equations of all rows at once. Only the Jacobian knows of blocks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from ..support.arrays import Array, consecutive
from . import loops
from .closed_rows import ClosedRows, Factors, Slip, directions
from .friction import FrictionProblem

_DENSE = 200  # directions up to which one dense factor is cheaper than those of blocks


@dataclass(frozen=True, eq=False)
class BlockFlexibility:
    """Flexibility of blocks of rows, some of which move each other, mostly by few fields.

    Parameters
    ----------
    own : sequence of (3 k, 3 k) arrays
        Flexibility of the rows of each block [m/N], symmetric positive definite.
    between : dict of (int, int) to (3 k, 3 l) array
        Flexibility between the rows of two blocks [m/N], both ways.
    fields : sequence of (3 k, m) arrays
        Fields by which other blocks move each block most.
    core : (M, M) array
        Amplitudes of the fields of all blocks due to forces on them: `between` is nearly fields_j core_jk fields_k'.
        Its diagonal blocks are zero.
    """

    own: Sequence[Array]
    between: Mapping[tuple[int, int], Array]
    fields: Sequence[Array]
    core: Array

    @cached_property
    def starts(self) -> Array:
        """Where the rows of each block begin, and the number of all rows, (n + 1,)."""
        return np.cumsum([0, *(len(F) // 3 for F in self.own)])

    @cached_property
    def parts(self) -> list[slice]:
        """Directions of each block."""
        return consecutive([len(F) for F in self.own])

    def moved_by(self, lam: Array) -> Array:
        """How far forces on the rows, (3 nr,) [N], move them, (3 nr,) [m]."""
        result = np.concatenate([F @ lam[part] for F, part in zip(self.own, self.parts, strict=True)])
        for (j, k), F in self.between.items():
            result[self.parts[j]] += F @ lam[self.parts[k]]
        return result

    def diagonal(self) -> Array:
        """(3 nr,) array."""
        return np.concatenate([F.diagonal() for F in self.own])

    @cached_property
    def whole(self) -> Array:
        """The flexibility as one matrix, (3 nr, 3 nr) [m/N]."""
        result = np.zeros((3 * self.starts[-1],) * 2)
        for part, F in zip(self.parts, self.own, strict=True):
            result[part, part] = F
        for (j, k), F in self.between.items():
            result[self.parts[j], self.parts[k]] = F
        return result


class BlockFriction(FrictionProblem):
    """`FrictionProblem` of blocks of rows that move each other.

    The residual is exact. The factors of Newton's method are those of each block alone, coupled by few fields
    (Woodbury), and Broyden's formula corrects them. Only blocks in which other rows slip are factorised again, unless
    the residual decreases slowly. Few rows have one dense factor.
    """

    def __init__(self, blocks: BlockFlexibility) -> None:
        self.iterations = self.factorisations = self.sweeps = 0
        nr = int(blocks.starts[-1])
        self.replace_blocks(blocks, np.zeros(nr, dtype=np.int8), np.zeros((nr, 3)))

    def replace_blocks(self, blocks: BlockFlexibility, state: Array, lam: Array) -> None:
        """Go on with other rows, see `FrictionProblem.replace`."""
        self.blocks = blocks
        self._scale(blocks.diagonal())
        self._restart(state, lam)

    @property
    def F(self) -> Array:  # type: ignore[override]
        """Flexibility of all rows as one matrix, (3 nr, 3 nr) [m/N]."""
        return self.blocks.whole

    @property
    def _dense(self) -> bool:
        """See `FrictionProblem`."""
        return bool(3 * self.blocks.starts[-1] <= _DENSE)

    def _equations(self, index: Array) -> ClosedRows:
        """See `FrictionProblem`."""
        return super()._equations(index) if self._dense else ClosedBlocks(self.blocks, self._inverse, index)

    def moved_by(self, lam: Array) -> Array:
        """See `FrictionProblem`."""
        return self.blocks.moved_by(lam.ravel()).reshape(-1, 3)


class _Block:
    """Closed rows of one block.

    Parameters
    ----------
    F : (3 k, 3 k) array
        Flexibility of its rows [m/N].
    fields : (3 k, m) array
        Fields by which others move them.
    inverse : (3 na,) array
        Scales of the closed rows to forces [N/m].
    closed, open : (na,), (k - na,) int arrays
        Rows of the block.
    """

    def __init__(self, F: Array, fields: Array, inverse: Array, closed: Array, open: Array) -> None:
        self.places, self.gaps = directions(closed), 3 * open
        columns = F[:, self.places]
        self.onto_open = columns[self.gaps]
        self._scale = inverse[:, None]
        self.F = self.scaled(columns)
        self.fields = fields[self.places]
        self.pushed = self._scale * self.fields
        self._slips: Array | None = None

    def scaled(self, F: Array) -> Array:
        """The closed ones among some rows of a flexibility, (3 k, m) [m/N], scaled to forces, (3 na, m)."""
        return np.asarray(self._scale * F[self.places])

    def has_factors_for(self, slips: Array) -> bool:
        """Whether its factors are those for these rows that slip, (na,) bool."""
        return self._slips is not None and np.array_equal(slips, self._slips)

    def factorise(self, slips: Array, slip: Slip) -> None:
        """Factorise the Jacobian for these rows that slip, (na,) bool."""
        self._slips, self.factors = slips, Factors(self.F.copy(), slip)
        pushed = self.pushed.copy()
        slip.project(pushed)
        self.answer = self.factors.solve(pushed)  # of forces to the fields
        self.response = self.fields.T @ self.answer


class ClosedBlocks(ClosedRows):
    """The equations of the closed rows of blocks, see `ClosedRows` and `BlockFriction`.

    With the Jacobians J of the blocks alone, scaled fields U, and the core S of the fields W, the Jacobian is nearly
    J + U S W'. Its inverse is J^-1 - J^-1 U (1 + S G)^-1 S W' J^-1 with G = W' J^-1 U.

    Parameters
    ----------
    F : BlockFlexibility
    inverse, index
        See `ClosedRows`.
    """

    def __init__(self, F: BlockFlexibility, inverse: Array, index: Array) -> None:
        self._set_rows(inverse, index)
        self._rows, self._open_rows = _split(index, F.starts), _split(self.open, F.starts)
        self._parts = [slice(3 * rows.start, 3 * rows.stop) for rows in self._rows]
        self._blocks = [
            _Block(own, fields, self._inverse[part], index[rows] - start, self.open[others] - start)
            for own, fields, part, rows, others, start in zip(
                F.own, F.fields, self._parts, self._rows, self._open_rows, F.starts[:-1], strict=True
            )
        ]
        self._between, self._onto_others = dict[tuple[int, int], Array](), dict[tuple[int, int], Array]()
        for (j, k), between in F.between.items():
            columns = between[:, self._blocks[k].places]
            self._between[j, k] = self._blocks[j].scaled(columns)
            self._onto_others[j, k] = columns[self._blocks[j].gaps]
        self._amplitudes = consecutive([block.fields.shape[1] for block in self._blocks])
        self._core, self._G = F.core, np.zeros(F.core.shape)

    def moved_open(self, lam: Array) -> Array:
        """See `ClosedRows`."""
        if not len(self.open):
            return np.empty(0)
        moved = [block.onto_open @ lam[part] for block, part in zip(self._blocks, self._parts, strict=True)]
        for (j, k), F in self._onto_others.items():
            moved[j] += F @ lam[self._parts[k]]
        return np.concatenate(moved)

    def _pushed(self, lam: Array) -> Array:
        """See `ClosedRows`."""
        pushed = [block.F @ lam[part] for block, part in zip(self._blocks, self._parts, strict=True)]
        for (j, k), F in self._between.items():
            pushed[j] += F @ lam[self._parts[k]]
        return np.concatenate(pushed)

    def _make_factors(self, wholly: bool) -> None:
        """See `ClosedRows`."""
        slips = [self._factorised[rows] for rows in self._rows]
        others = [not block.has_factors_for(own) for block, own in zip(self._blocks, slips, strict=True)]
        for j, block in enumerate(self._blocks):
            if others[j] or wholly or not any(others):
                block.factorise(slips[j], self._slip(self._rows[j]))
                self._G[self._amplitudes[j], self._amplitudes[j]] = block.response
        self._coupling = np.linalg.inv(np.eye(len(self._core)) + self._core @ self._G) @ self._core

    def _solve(self, rhs: Array) -> Array:
        """Solve for right-hand sides, (3 na,) or (3 na, m)."""
        solved = [block.factors.solve(rhs[part]) for block, part in zip(self._blocks, self._parts, strict=True)]
        forces = [block.fields.T @ x for block, x in zip(self._blocks, solved, strict=True)]
        pushing = self._coupling @ np.concatenate(forces)
        for block, x, amplitudes in zip(self._blocks, solved, self._amplitudes, strict=True):
            x -= block.answer @ pushing[amplitudes]
        return np.concatenate(solved)

    def step(self) -> tuple[Array, float]:
        """See `ClosedRows`."""
        self.steps += 1
        return loops.corrected_step(self._solve(-self._value), self._moves, self._squares, self.steps - 1)

    def response(self, way: Array) -> Array:
        """See `ClosedRows`. What the fields leave out is corrected once."""
        rhs = self._inverse[:, None] * way
        self._project(rhs)
        first = self._solve(rhs)
        forces = [block.fields.T @ first[part] for block, part in zip(self._blocks, self._parts, strict=True)]
        pushing = self._core @ np.concatenate(forces)
        left_out = -np.concatenate([
            block.pushed @ pushing[part] for block, part in zip(self._blocks, self._amplitudes, strict=True)
        ])  # fmt: skip
        for (j, k), F in self._between.items():
            left_out[self._parts[j]] += F @ first[self._parts[k]]
        self._project(left_out)
        return first - self._solve(left_out)

    def _project(self, rhs: Array) -> None:
        for block, part in zip(self._blocks, self._parts, strict=True):
            block.factors.slip.project(rhs[part])


def _split(index: Array, starts: Array) -> list[slice]:
    """Places of each block's numbers among `index`, (n,), in ascending order."""
    places = np.searchsorted(index, starts).tolist()
    return [slice(a, b) for a, b in pairwise(places)]
