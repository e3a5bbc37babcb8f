"""Compiled loops of small dense problems; the modules beside this one do the same by NumPy and LAPACK."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numba.experimental import structref

from ..support.arrays import Array
from ..support.compiled import compiled, inlined, inner
from ..support.struct_kernels import StructType, define_struct
from .block_complementarity import FlatBlocks
from .product_kernels import matrix_at

if TYPE_CHECKING:
    from .block_complementarity import FlatCore


@structref.register
class BlocksType(StructType):
    """Type of `BlocksObject` in compiled loops."""


class BlocksObject(structref.StructRefProxy):
    """`FlatBlocks` as one object: code that hands on each array takes long to compile."""


define_struct(BlocksObject, BlocksType, FlatBlocks._fields)


@inlined
def blocks_object(blocks: FlatBlocks) -> Any:
    """Make one; it has the same arrays."""
    return BlocksObject(*blocks)  # type: ignore[no-untyped-call]


@inner
def on_active(
    F: Array, factor: Array, index: Array, h: Array, rounding: float, scale: float
) -> tuple[Array, Array, int]:
    """Forces on the active rows, which rows violate their condition, and how many: see `Complementarity.check`.

    Parameters
    ----------
    F : (n, n) array
        Symmetric.
    factor : (na, na) array
        Transpose of the lower factor of Cholesky of the active part.
    index : (na,) int array
        Active rows.
    h : (n,) array
    rounding, scale : float
        By rounding times scale an inactive row may be violated. A scale of zero is the largest entry of h.
    """
    n, na = len(h), len(index)
    x = np.empty(na)
    for i in range(na):
        x[i] = -h[index[i]]
    for i in range(na):
        x[i] /= factor[i, i]
        for j in range(i + 1, na):
            x[j] -= factor[i, j] * x[i]
    for i in range(na - 1, -1, -1):
        total = x[i]
        for j in range(i + 1, na):
            total -= factor[i, j] * x[j]
        x[i] = total / factor[i, i]
    if scale == 0.0:
        for i in range(n):
            scale = max(scale, abs(h[i]))
    lam, wrong, w = np.empty(n), np.empty(n, np.bool_), np.empty(n)
    for i in range(n):
        lam[i], w[i] = 0.0, h[i]
    for i in range(na):
        push, row = x[i], index[i]
        for k in range(n):
            w[k] += push * F[row, k]
    count = 0
    for row in range(n):
        wrong[row] = w[row] < -rounding * scale
        count += wrong[row]
    for i in range(na):
        row = index[i]
        lam[row] = x[i]
        count += (x[i] < 0.0) - wrong[row]
        wrong[row] = x[i] < 0.0
    return lam, wrong, count


@compiled
def check_active(
    F: Array, factor: Array, index: Array, h: Array, rounding: float, scale: float
) -> tuple[Array, Array, int]:
    """See `on_active`."""
    return on_active(F, factor, index, h, rounding, scale)


@compiled
def solve_active(
    F: Array, factor: Array, index: Array, h: Array, rounding: float, steps: int, most: int
) -> tuple[Array, Array, Array, int, int]:
    """Change the active rows, see `on_active`, until none violates its condition.

    They are changed `steps` times at most, and only as long as they are no more than `most`.

    Returns
    -------
    Forces, the active rows' factor, their numbers, how often they were changed, and how many rows violate their
    condition; -1 if the active part of F is not positive definite with the rows that should be active next.
    """
    lam, wrong, count = on_active(F, factor, index, h, rounding, 0.0)
    for step in range(steps):
        if count == 0:
            return lam, factor, index, step, 0
        active = wrong
        for i in range(len(index)):
            active[index[i]] = not active[index[i]]
        n = 0
        for i in range(len(active)):
            n += active[i]
        if n > most:
            return lam, factor, index, step, count
        chosen, n = np.empty(n, np.int64), 0
        for i in range(len(active)):
            if active[i]:
                chosen[n] = i
                n += 1
        upper = np.empty((n, n))
        for i in range(n):
            for k in range(i, n):
                upper[i, k] = F[chosen[i], chosen[k]]
        for i in range(n):
            if not upper[i, i] > 0.0:
                return lam, factor, index, step, -1
            root = math.sqrt(upper[i, i])
            for k in range(i, n):
                upper[i, k] /= root
            for k in range(i + 1, n):
                share = upper[i, k]
                for p in range(k, n):
                    upper[k, p] -= share * upper[i, p]
        factor, index = upper, chosen
        lam, wrong, count = on_active(F, factor, index, h, rounding, 0.0)
    return lam, factor, index, steps, count


@inner
def settle(core: FlatCore, a: Array, G: Array, pressed: Array, c: Array, settled: float, steps: int) -> bool:
    """Iterate c = S (a - G c), see `BlockComplementarity`; each block takes the newest amplitudes of the others.

    Parameters
    ----------
    core : FlatCore
        S.
    a : (n, m) array
    G : (k, m, m) array
        Of the blocks that have forces.
    pressed : (k,) int array
        Numbers of these blocks.
    c : (n, m) array
        A guess; becomes the last iterate.
    settled : float
        Relative change at which c is settled.
    steps : int
        Most passes over all blocks.

    Returns
    -------
    Whether c has settled.
    """
    n, m = c.shape
    forces, place, now = np.empty((n, m)), np.empty(n, np.int64), np.empty(m)
    for j in range(n):
        place[j] = -1
    for i in range(len(pressed)):
        place[pressed[i]] = i
    for j in range(n):
        push(forces, a, G, place[j], c, j)
    for _ in range(steps):
        change = size = 0.0
        for j in range(n):
            for r in range(m):
                now[r] = 0.0
            for b in range(core.starts[j], core.starts[j + 1]):
                top, end, left, width = core.spans[b]
                block = matrix_at(core.numbers, core.places[b], end - top, width)
                pushing = forces[core.sources[b], left : left + width]
                for r in range(end - top):
                    total = 0.0
                    for p in range(width):
                        total += block[r, p] * pushing[p]
                    now[top + r] += total
            for r in range(m):
                change, size = max(change, abs(now[r] - c[j, r])), max(size, abs(now[r]))
                c[j, r] = now[r]
            push(forces, a, G, place[j], c, j)
        if change <= settled * size:
            return True
    return False


@compiled
def iterate(core: FlatCore, a: Array, G: Array, pressed: Array, c: Array, settled: float, steps: int) -> bool:
    """See `settle`."""
    return settle(core, a, G, pressed, c, settled, steps)


@inner
def push(forces: Array, a: Array, G: Array, place: int, c: Array, j: int) -> None:
    """Set forces of block j, (m,), to a - G c; a block with place -1 has none of G."""
    for i in range(a.shape[1]):
        forces[j, i] = a[j, i]
    if place >= 0:
        own, amplitudes = G[place], c[j]
        for i in range(len(amplitudes)):
            total = 0.0
            for k in range(len(amplitudes)):
                total += own[i, k] * amplitudes[k]
            forces[j, i] -= total


@inner
def settle_blocks(blocks: FlatBlocks, h: Array, rounding: float, settled: float, steps: int, patience: int) -> bool:
    """See `FlatBlocks.solve`.

    Parameters
    ----------
    blocks : FlatBlocks
    h : (nr,) array
    rounding, settled : float
        See `check_active` and `settle`.
    steps : int
        Most steps of `settle`.
    patience : int
        Most steps of the active rows without progress.
    """
    n, m = blocks.amplitudes.shape
    every, scale, total, some = np.empty(n, np.int64), 0.0, 0.0, False
    enters = np.empty(n, np.bool_)
    for j in range(n):
        every[j] = j
        if blocks.n_closed[j] < 0 and not factorise_block(blocks, j):
            return False
        least, largest = np.inf, 0.0
        for i in range(blocks.starts[j], blocks.starts[j + 1]):
            least, largest, total = min(least, h[i]), max(largest, abs(h[i])), total + h[i]
        enters[j] = least < 0.0 or blocks.n_closed[j] > 0
        if enters[j]:
            some, scale = True, max(scale, largest)
    if not math.isfinite(total):
        return False
    if not some:
        for j in range(n):
            for k in range(m):
                blocks.amplitudes[j, k] = 0.0
        for i in range(len(h)):
            blocks.lam[i], blocks.pushed[i] = 0.0, h[i]
        return True
    fewest, left = len(h) + 1, patience
    while left:
        a = np.zeros((n, m))
        for j in range(n):
            if blocks.n_closed[j] < 0 and not factorise_block(blocks, j):
                return False
            start = blocks.starts[j]
            for i in range(start, start + blocks.n_closed[j]):
                gap = h[start + blocks.closed[i]]
                for k in range(m):
                    a[j, k] += gap * blocks.responses[i, k]
        c = blocks.amplitudes
        if not settle(blocks.core, a, blocks.G, every, c, settled, steps):
            return False
        wrong = 0
        for j in range(n):
            wrong += check_block(blocks, j, h, rounding, scale)
            blocks.iterations[j] += enters[j]
        if wrong == 0:
            return True
        left = patience if wrong < fewest else left - 1
        fewest = min(fewest, wrong)
    return False


@compiled
def solve_blocks(blocks: FlatBlocks, h: Array, rounding: float, settled: float, steps: int, patience: int) -> bool:
    """See `settle_blocks`."""
    return settle_blocks(blocks_object(blocks), h, rounding, settled, steps, patience)


@inner
def check_block(blocks: FlatBlocks, j: int, h: Array, rounding: float, scale: float) -> int:
    """Forces on the active rows of a block; rows that violate their condition change sides. Return how many do."""
    start, end = blocks.starts[j], blocks.starts[j + 1]
    n, c, pushed = end - start, blocks.amplitudes[j], blocks.pushed[start:end]
    fields = matrix_at(blocks.numbers, blocks.fields[j], len(c), n)
    for i in range(n):
        pushed[i] = h[start + i]
    for k in range(len(c)):
        amplitude = c[k]
        if amplitude != 0.0:
            for i in range(n):
                pushed[i] += amplitude * fields[k, i]
    na, count = blocks.n_closed[j], 0
    if na == 0:
        for i in range(n):
            blocks.lam[start + i] = 0.0
            if pushed[i] < -rounding * scale:
                blocks.active[start + i], blocks.n_closed[j] = True, -1
                count += 1
        return count
    F = matrix_at(blocks.numbers, blocks.own[j], n, n)
    factor = matrix_at(blocks.factors, blocks.places[j], na, na)
    index = blocks.closed[start : start + na]
    lam, wrong, count = on_active(F, factor, index, pushed, rounding, scale)
    for i in range(n):
        blocks.lam[start + i] = lam[i]
    if count:
        for i in range(n):
            if wrong[i]:
                blocks.active[start + i] = not blocks.active[start + i]
        blocks.n_closed[j] = -1
    return count


@inner
def factorise_block(blocks: FlatBlocks, j: int) -> bool:
    """Set up what belongs to the active rows of a block; whether their F is positive definite."""
    start, end = blocks.starts[j], blocks.starts[j + 1]
    n, m, na = end - start, blocks.amplitudes.shape[1], 0
    index = blocks.closed[start:end]
    for i in range(n):
        if blocks.active[start + i]:
            index[na] = i
            na += 1
    blocks.n_closed[j] = na
    F = matrix_at(blocks.numbers, blocks.own[j], n, n)
    fields = matrix_at(blocks.numbers, blocks.fields[j], m, n)
    U = matrix_at(blocks.factors, blocks.places[j], na, na)
    x, G = blocks.responses[start : start + na], blocks.G[j]
    for i in range(na):
        for k in range(i, na):
            U[i, k] = F[index[i], index[k]]
        for p in range(m):
            x[i, p] = -fields[p, index[i]]
    for i in range(na):
        if not U[i, i] > 0.0:
            return False
        root = math.sqrt(U[i, i])
        for k in range(i, na):
            U[i, k] /= root
        for p in range(m):
            x[i, p] /= root
        for k in range(i + 1, na):
            share = U[i, k]
            for p in range(k, na):
                U[k, p] -= share * U[i, p]
            for p in range(m):
                x[k, p] -= share * x[i, p]
    for i in range(na - 1, -1, -1):
        for k in range(i + 1, na):
            share = U[i, k]
            for p in range(m):
                x[i, p] -= share * x[k, p]
        for p in range(m):
            x[i, p] /= U[i, i]
    for k in range(m):
        for p in range(m):
            G[k, p] = 0.0
    for i in range(na):
        for k in range(m):
            share = fields[k, index[i]]
            for p in range(m):
                G[k, p] -= share * x[i, p]
    return True
