"""Linear complementarity of many blocks of rows, each of which moves a few others a little."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache
from hashlib import blake2b
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from ..errors import ComplementarityError
from ..support.arrays import Array
from . import loops
from .complementarity import PATIENCE, ROUNDING, Complementarity

_SETTLED = 1e-13  # change of what blocks push, relative
_LOST = 1e-10  # of the norm of blocks: what shared fields may leave out
_STEPS = 50  # of the iteration; then the equations are solved at once
LIMITS = ROUNDING, _SETTLED, _STEPS, PATIENCE  # as compiled loops take them


class FlatCore(NamedTuple):
    """S of a `BlockComplementarity` in flat arrays, as compiled loops take it.

    Parameters
    ----------
    starts : (n + 1,) int array
        Which of the blocks are those of each row of blocks.
    sources : (k,) int array
        Column of each block.
    spans : (k, 4) int array
        First row and end of the rows that are not zero, first column and number of columns.
    numbers : array
        What lies within these; equal blocks are there once.
    places : (k,) int array
        Where each block begins in `numbers`.
    """

    starts: Array
    sources: Array
    spans: Array
    numbers: Array
    places: Array

    @classmethod
    def of(cls, n: int, core: Mapping[tuple[int, int], Array]) -> FlatCore:
        """Flatten S of n blocks."""
        if not core:
            return _without_blocks(n)
        pairs, spans, parts = sorted(core), [], []
        for pair in pairs:
            block = core[pair]
            (top, end), (left, right) = _span(block.any(1)), _span(block.any(0))
            spans.append((top, end, left, right - left))
            parts.append(block[top:end, left:right])
        starts = np.searchsorted([j for j, _ in pairs], np.arange(n + 1))
        sources = np.array([k for _, k in pairs], dtype=np.int64)
        return cls(starts, sources, np.reshape(spans, (-1, 4)).astype(np.int64), *pooled(parts))


def _span(there: Any) -> tuple[int, int]:
    """First place that is marked, and the end of all that are."""
    marked = np.flatnonzero(there)
    return (int(marked[0]), int(marked[-1]) + 1) if len(marked) else (0, 0)


class FlatBlocks(NamedTuple):
    """All blocks of a problem in flat arrays, as compiled loops take them; see `BlockComplementarity`.

    Parameters
    ----------
    starts : (n + 1,) int array
        Where the rows of each block begin in `active`, `closed`, `lam`, `pushed` and `responses`.
    numbers : (k,) array
        Matrices of all blocks; equal ones are there once.
    own, fields : (n,) int arrays
        Where the diagonal block of F and where the transpose of W of each block begin in `numbers`.
    core : FlatCore
        S.
    active : (nr,) bool array
    closed : (nr,) int array
        Numbers of each block's active rows in the block, from where its rows begin.
    n_closed : (n,) int array
        How many these are; -1 if `closed` and the factors are not those of `active`.
    factors : array
        Transposes of the lower factors of Cholesky of the active rows, from `places`, (n,), each.
    places : (n,) int array
    responses : (nr, m) array
        -D^-1 W of the active rows.
    G : (n, m, m) array
        W' D^-1 W.
    amplitudes : (n, m) array
        c.
    lam, pushed : (nr,) arrays
        The answer, and h + W c.
    iterations : (n,) int array
        How often each block was looked at while rows of it closed.
    """

    starts: Array
    numbers: Array
    own: Array
    fields: Array
    core: FlatCore
    active: Array
    closed: Array
    n_closed: Array
    factors: Array
    places: Array
    responses: Array
    G: Array
    amplitudes: Array
    lam: Array
    pushed: Array
    iterations: Array

    def solve(self, h: Array) -> bool:
        """Find lambda for h, (nr,).

        Return False if amplitudes or active rows do not settle soon, or loops are not compiled; then another method has
        to find them.
        """
        settled = loops.solve_blocks(self, h, *LIMITS)
        if not settled:
            self.forget()
        return settled

    def forget(self) -> None:
        """Begin the next solution without a guess."""
        self.active[:], self.n_closed[:], self.amplitudes[:] = False, -1, 0.0


class BlockComplementarity:
    """lambda >= 0, w = F lambda + h >= 0, lambda'w = 0, with F of blocks of rows that move each other by few fields.

    The diagonal blocks of F are any, the others are W_j S_jk W_k': the forces on block k act through a few numbers
    W_k' lambda_k, and move block j by a few fields, the columns of W_j. So the equations of an active set are those of
    the single blocks and a small system for the amplitudes of the fields::

        c = S (a - G c),    a_k = -W_k' D_k^-1 h_k,    G_k = W_k' D_k^-1 W_k,

    with D_k the active part of a diagonal block. It is iterated, for blocks move each other less than themselves.
    Active sets change as in `Complementarity`, in all blocks at once. Factors, D_k^-1 W_k and G_k are kept as long as
    the active rows of a block stay the same, so that the work grows with the number of blocks.

    Parameters
    ----------
    n : int
        Number of blocks.
    core : dict of (int, int) to (m, m) array
        S_jk, by the numbers of two blocks; m fields for each block.

    Attributes
    ----------
    amplitudes : (n, m) array
        c of the last answer, of all blocks.
    pushed : dict of int to (k,) array
        h + W c of the blocks of the last answer.
    """

    def __init__(self, n: int, core: Mapping[tuple[int, int], Array]) -> None:
        self._of_pairs, m = core, max(map(len, core.values()), default=0)
        self._flat_core = FlatCore.of(n, core)
        self.amplitudes = np.zeros((n, m))
        self.pushed: dict[int, Array] = {}

    @cached_property
    def _core(self) -> sp.csr_matrix:
        """S as a matrix, (n m, n m). Compiled steps do not ask for it."""
        (n, m), pairs = self.amplitudes.shape, sorted(self._of_pairs)
        if not pairs:
            return sp.csr_matrix((n * m, n * m))
        blocks, columns = np.array([self._of_pairs[pair] for pair in pairs]), np.array([k for _, k in pairs])
        starts = np.searchsorted([j for j, _ in pairs], np.arange(n + 1))
        core = sp.bsr_matrix((blocks, columns, starts), shape=(n * m, n * m)).tocsr()
        core.eliminate_zeros()
        return core

    def solve(
        self, problems: Mapping[int, Complementarity], h: Mapping[int, Array], fields: Mapping[int, Array]
    ) -> dict[int, Array]:
        """Return the forces lambda of some blocks, (k,) each; no forces act on the others.

        Parameters
        ----------
        problems : dict of int to Complementarity
            The diagonal blocks, with guesses of their active rows; afterwards, with their active rows.
        h : dict of int to (k,) array
        fields : dict of int to (k, m) array
            W.

        Raises
        ------
        ComplementarityError
            If h is not finite, or the active rows do not settle.
        """
        scale = max(abs(gap).max() for gap in h.values())
        if not np.isfinite(scale):
            raise ComplementarityError("the gaps are not finite: the run has become unstable")
        rows, self.pushed = sum(len(gap) for gap in h.values()), {}
        fewest, patience = rows + 1, PATIENCE
        for _ in range(50 + 20 * rows):
            self._find_amplitudes(problems, h, fields)
            lam, wrong, count = {}, {}, 0
            for key, problem in problems.items():
                problem.iterations += 1
                self.pushed[key] = pushed = h[key] + fields[key] @ self.amplitudes[key]
                lam[key], wrong[key], more = problem.check(pushed, scale)
                count += more
            if not count:
                return lam
            if count < fewest:
                fewest, patience = count, PATIENCE
            elif patience:
                patience -= 1
            else:
                return self._whole(problems, h, fields)
            for key, some in wrong.items():
                if some.any():
                    problems[key].set_active(problems[key].active ^ some)
        raise ComplementarityError(f"no active set of {rows} contact rows settled; the rows are nearly redundant")

    def _whole(
        self, problems: Mapping[int, Complementarity], h: Mapping[int, Array], fields: Mapping[int, Array]
    ) -> dict[int, Array]:
        """Return the forces, found by one matrix of all rows."""
        m = self.amplitudes.shape[1]
        some = (m * np.array([*problems])[:, None] + np.arange(m)).ravel()
        across = scipy.linalg.block_diag(*(fields[key] for key in problems))
        within = scipy.linalg.block_diag(*(problem.F for problem in problems.values()))
        whole = Complementarity(within + across @ (self._core[some][:, some] @ across.T))
        forces = whole.solve(np.concatenate([h[key] for key in problems]))
        ends = np.cumsum([len(h[key]) for key in problems])[:-1]
        lam = dict(zip(problems, np.split(forces, ends), strict=True))
        for key, active in zip(problems, np.split(whole.active, ends), strict=True):
            problems[key].set_active(active)
        self._find_amplitudes(problems, h, fields)
        self.pushed = {key: h[key] + fields[key] @ self.amplitudes[key] for key in problems}
        return lam

    def flat(self, own: Sequence[Array], fields: Sequence[Array]) -> FlatBlocks:
        """Return the problem for compiled loops, without active rows.

        Parameters
        ----------
        own : sequence of (k, k) arrays
            Diagonal blocks of F.
        fields : sequence of (k, m) arrays
            W.
        """
        sizes = [len(F) for F in own]
        starts, places = (
            np.array([*itertools.accumulate(each, initial=0)], dtype=np.int64)
            for each in (sizes, [size**2 for size in sizes])
        )
        (numbers, at), (n, m), nr = (
            pooled([*(F.T for F in own), *(W.T for W in fields)]),
            self.amplitudes.shape,
            int(starts[-1]),
        )
        return FlatBlocks(
            starts, numbers, at[:n], at[n:], self._flat_core,
            active=np.zeros(nr, dtype=bool), closed=np.zeros(nr, dtype=np.int64), n_closed=np.zeros(n, dtype=np.int64),
            factors=np.empty(places[-1]), places=places, responses=np.zeros((nr, m)), G=np.zeros((n, m, m)),
            amplitudes=np.zeros((n, m)), lam=np.zeros(nr), pushed=np.zeros(nr), iterations=np.zeros(n, dtype=np.int64),
        )  # fmt: skip

    def _find_amplitudes(
        self, problems: Mapping[int, Complementarity], h: Mapping[int, Array], fields: Mapping[int, Array]
    ) -> None:
        """Solve c = S (a - G c) for the active rows."""
        pressed = [key for key, problem in problems.items() if problem.index.size]
        n, m = self.amplitudes.shape
        a, G = np.zeros((n, m)), np.zeros((len(pressed), m, m))
        for i, key in enumerate(pressed):
            response, G[i] = problems[key].response(fields[key])
            a[key] = h[key][problems[key].index] @ response
        c = self._iterated(a, G, np.array(pressed, dtype=np.int64))
        if c is None:
            some = (m * np.array(pressed)[:, None] + np.arange(m)).ravel()
            within = self._core[some][:, some]
            system = np.eye(len(some)) + within @ sp.block_diag([*G], format="csr")
            of_system = np.linalg.solve(system, within @ a[pressed].ravel()).reshape(-1, m)
            forces = a.copy()
            forces[pressed] -= (G @ of_system[:, :, None])[:, :, 0]
            c = (self._core @ forces.ravel()).reshape(n, m)
        self.amplitudes = c

    def _iterated(self, a: Array, G: Array, pressed: Array) -> Array | None:
        """Return c = S (a - G c) by iteration from the last amplitudes; None if it does not settle."""
        return loops.iterate(self._flat_core, self._core, a, G, pressed, self.amplitudes, _SETTLED, _STEPS)


@lru_cache(maxsize=16)
def _without_blocks(n: int) -> FlatCore:
    """S of n blocks that do not move each other; nobody writes to it."""
    none = np.zeros(n + 1, dtype=np.int64)
    return FlatCore(none, none[:0], np.zeros((0, 4), dtype=np.int64), *pooled([]))


def pooled(arrays: Sequence[Array]) -> tuple[Array, Array]:
    """All numbers of some arrays, (k,), equal arrays once, and where each array begins, (n,)."""
    if len({array.size for array in arrays}) == len(arrays):  # only arrays of one size may be equal
        parts = [np.ascontiguousarray(array, dtype=float).ravel() for array in arrays]
        ends = [*itertools.accumulate(map(len, parts), initial=0)]
        return np.concatenate([*parts, np.empty(0)]), np.array(ends[:-1], dtype=np.int64)
    known, size, starts, parts = dict[object, int](), 0, [], []
    sizes = Counter(array.size for array in arrays)
    for array in arrays:
        view = array.__array_interface__["data"][0], array.shape, array.strides
        if view not in known:
            flat = np.ascontiguousarray(array, dtype=float).ravel()
            content = blake2b(flat, digest_size=16).digest() if sizes[array.size] > 1 else view
            if content not in known:
                known[content], size = size, size + len(flat)
                parts.append(flat)
            known[view] = known[content]
        starts.append(known[view])
    return np.concatenate([*parts, np.empty(0)]), np.array(starts, dtype=np.int64)


def shared_fields(blocks: Sequence[Array]) -> Array:
    """Orthonormal columns that hold all fields by which some blocks of a flexibility move, (n, m).

    Parameters
    ----------
    blocks : sequence of (n, k) arrays

    References
    ----------
    N. Halko, P.G. Martinsson, J.A. Tropp, Finding structure with randomness, SIAM Review 53 (2011) 217, section 4.
    """
    together = np.hstack(blocks)
    (n, k), size = together.shape, np.linalg.norm(together)
    columns, random = 16, np.random.default_rng(0)
    while True:
        sample = together @ random.normal(size=(k, columns))
        fields = scipy.linalg.qr(sample, mode="economic")[0]
        amplitudes = fields.T @ together
        if columns >= n or np.linalg.norm(together - fields @ amplitudes) <= _LOST * size:
            axes, sizes, _ = scipy.linalg.svd(amplitudes, full_matrices=False)
            left = np.sqrt(np.cumsum(sizes[::-1] ** 2))[::-1]  # what this field and those after it hold
            return np.asarray(fields @ axes[:, left > _LOST * size])
        columns *= 2
