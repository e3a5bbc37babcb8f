"""The loops of sparse solvers: compiled if numba is there, else by NumPy, BLAS and LAPACK.

This is the only module of `sparse` that knows which. `kernels`, `front_kernels` and `gradient_kernels` have the
compiled loops. Factors of a front are stored by columns; compiled loops take them transposed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.linalg import blas, lapack

from ...support.arrays import Array, as_read_only
from ...support.compiled import kernels


class Factor(NamedTuple):
    """What a front leaves: with C = inverse^-1, its rows of the matrix are [C; below] diag(signs) [C; below]'.

    Parameters
    ----------
    rows : slice
        What it eliminates, in order of elimination.
    changes : (m,) int array
        Rows beyond them.
    inverse : (k, k) array
    signs : (k,) array or None
        None if all are 1.
    below : (m, k) array
    """

    rows: slice
    changes: Array
    inverse: Array
    signs: Array | None
    below: Array


class Factors(NamedTuple):
    """Factors of all fronts, front by front and in flat arrays.

    Parameters
    ----------
    fronts : list of Factor
        Children before their parents.
    store : array
        `inverse` and `below` of each front, with their columns one behind the other.
    begins, starts, ends : (nf + 1,) int arrays
        Where a front begins in `store`, in the order of elimination, and in `changes`.
    changes : int array
        Rows that the fronts change beyond those that they eliminate.
    signs : (n,) array
        Of all rows.
    """

    fronts: list[Factor]
    store: Array
    begins: Array
    starts: Array
    ends: Array
    changes: Array
    signs: Array


def share_cores() -> bool:
    """Whether two threads are quicker than one: compiled loops let each other run, those of NumPy wait."""
    return kernels("algebra.sparse") is not None


def push(x: Array, factors: Factors, some: Array) -> None:
    """Eliminate right-hand sides, (n,) or (n, p) in order of elimination, in place, by some fronts, ascending.

    They must lie by rows, also in `pull`.
    """
    if compiled := kernels("algebra.sparse"):
        compiled.push(_columns(x), *factors[1:6], some)
        return
    for front in some.tolist():
        rows, changes, inverse, _, below = factors.fronts[front]
        x[rows] = inverse @ x[rows]
        x[changes] -= below @ x[rows]


def pull(x: Array, factors: Factors, some: Array) -> None:
    """Solve for right-hand sides, (n,) or (n, p), that are eliminated, in place, by some fronts, ascending."""
    if compiled := kernels("algebra.sparse"):
        compiled.pull(_columns(x), *factors[1:6], some, factors.signs)
        return
    for front in some[::-1].tolist():
        rows, changes, inverse, signs, below = factors.fronts[front]
        own = x[rows] if signs is None else (signs * x[rows].T).T
        x[rows] = inverse.T @ (own - below.T @ x[changes])


def _columns(x: Array) -> Array:
    """The same right-hand sides as columns, (n, p); not a copy. BLAS gets their address alone, so they lie by rows."""
    if not x.flags.c_contiguous:
        raise ValueError("x: expected right-hand sides that lie by rows")
    return x[:, None] if x.ndim == 1 else x


def put(matrix: sp.csr_matrix, rows: slice, place: Array, own: Array, below: Array) -> bool:
    """Write some rows of a matrix to a front, as columns; whether all entries have a place.

    Parameters
    ----------
    matrix : (n, n) csr matrix
        Its upper triangle.
    rows : slice
        k rows.
    place : (n,) int array
        Of each row in the front, -1 if it is not there.
    own, below : (k, k), (m, k) arrays
    """
    starts, k = matrix.indptr[rows.start : rows.stop + 1], len(own)
    if compiled := kernels("algebra.sparse"):
        return bool(compiled.put(starts, matrix.indices, as_read_only(matrix.data), place, own.T, below.T))
    entries, column = slice(starts[0], starts[-1]), np.repeat(np.arange(k), np.diff(starts))
    row, values = place[matrix.indices[entries]], matrix.data[entries]
    inside = row < k
    own[row[inside], column[inside]] = values[inside]
    below[row[~inside] - k, column[~inside]] = values[~inside]
    return bool(row.min(initial=0) >= 0)


def add(change: Array, place: Array, own: Array, below: Array, update: Array) -> None:
    """Add what a child leaves, `packed`, to its places in the front, (c,) int array; only lower triangles count."""
    if compiled := kernels("algebra.sparse"):
        compiled.add(change, place, own.T, below.T, update.T)
        return
    (unpack,) = lapack.get_lapack_funcs(("tpttr",), (change,))
    # Transposed, the entries of a row lie one behind the other.
    change, own, below, update = unpack(len(place), change, uplo="L")[0].T, own.T, below.T, update.T
    inside = int(np.searchsorted(place, len(own)))
    mine, others = place[:inside], place[inside:] - len(own)
    _add_at(own, mine, mine, change[:inside, :inside])
    _add_at(below, mine, others, change[:inside, inside:])
    _add_at(update, others, others, change[inside:, inside:])


def packed(update: Array) -> Array:
    """Lower triangle of an array, (m, m), column by column, in half of the memory, until a parent takes it up.

    Returns
    -------
    (m (m + 1) / 2,) array
    """
    if compiled := kernels("algebra.sparse"):
        return np.asarray(compiled.packed(update.T))
    (pack,) = lapack.get_lapack_funcs(("trttp",), (update,))
    return np.asarray(pack(update, uplo="L")[0])


def _add_at(target: Array, rows: Array, columns: Array, values: Array) -> None:
    """Do `target[np.ix_(rows, columns)] += values` for a contiguous array, which is quicker by flat indices."""
    flat, entries = target.reshape(-1), (rows[:, None] * target.shape[1] + columns).ravel()
    flat.put(entries, flat.take(entries) + values.ravel())


def eliminate(own: Array, below: Array, update: Array) -> bool:
    """Factorise a front in place by Cholesky: `own` becomes the inverse of its factor.

    Return whether it is positive definite. If not, nothing has changed.

    Parameters
    ----------
    own, below, update : (k, k), (m, k), (m, m) arrays
    """
    if compiled := kernels("algebra.sparse"):
        return bool(compiled.eliminate(own.T, below.T, update.T))
    potrf, trtri = lapack.get_lapack_funcs(("potrf", "trtri"), (own,))
    trsm, syrk = blas.get_blas_funcs(("trsm", "syrk"), (own,))
    factor, indefinite = potrf(own, lower=1)
    if indefinite:
        return False
    if len(below):
        trsm(1.0, factor, below, side=1, lower=1, trans_a=1, overwrite_b=1)
        syrk(-1.0, below, beta=1.0, c=update, lower=1, overwrite_c=1)
    own[:] = trtri(factor, lower=1, overwrite_c=1)[0]
    return True


def eliminate_nodes(
    starts: Array,
    neighbours: Array,
    sizes: Array,
    group: Array,
    small: int,
    zeros_of_small: float,
    zeros_of_large: float,
) -> tuple[Array, Array, Array, Array, Array]:
    """Eliminate nodes one by one, and put those together that may share a front; see `fronts._roots`.

    Parameters
    ----------
    starts : (n + 1,) int array
        Where the later neighbours of each node begin in `neighbours`.
    neighbours : int array
        Ascending for each node.
    sizes : (n,) int array
        Rows of each node.
    group : (n,) int array
        Nodes of one front are of one group.
    small, zeros_of_small, zeros_of_large :
        Fronts that eliminate at most so many rows may hold such a share of zeros; larger ones.

    Returns
    -------
    taken_by : (n,) int array
        The node in whose front each node is eliminated, its own number if that is its own; follow it to its end.
    n_rows, n_below : (n,) int arrays
        Rows that each front eliminates, and that it changes.
    ends : (n + 1,) int array
        Where the nodes begin in `below` that each front changes.
    below : int array
        The first of each front is the least.
    """
    if compiled := kernels("algebra.sparse", "front_kernels"):
        limits = small, zeros_of_small, zeros_of_large
        found: tuple[Array, Array, Array, Array, Array] = compiled.eliminate_nodes(
            starts, neighbours, sizes, group, *limits
        )
        return found
    taken_by, n_rows, n_below, zeros = np.arange(len(sizes)), sizes.tolist(), [0] * len(sizes), [0] * len(sizes)
    children: list[list[int]] = [[] for _ in sizes]
    below: list[Array] = []
    for node, beyond in enumerate(np.split(neighbours, starts[1:-1])):
        own = children[node]
        if own:
            beyond = np.concatenate([beyond, *(below[child][1:] for child in own)])
            beyond.sort()
            beyond = beyond[np.concatenate([[True], beyond[1:] != beyond[:-1]])[: len(beyond)]]
        below.append(beyond)
        n_below[node] = int(sizes[beyond].sum())
        own.sort(key=lambda child: n_rows[child] * (n_rows[node] + n_below[node] - n_below[child]))
        for child in own:
            rows = n_rows[child] + n_rows[node]
            lacking = zeros[node] + zeros[child] + n_rows[child] * (n_rows[node] + n_below[node] - n_below[child])
            entries = rows * (rows + 1) // 2 + rows * n_below[node]
            most = (zeros_of_small if rows <= small else zeros_of_large) * entries
            if group[child] == group[node] and lacking <= most:
                taken_by[child], n_rows[node], zeros[node] = node, rows, lacking
        if len(beyond):
            children[beyond[0]].append(node)
    ends = np.cumsum([0, *map(len, below)])
    return taken_by, np.array(n_rows), np.array(n_below), ends, np.concatenate(below)


def conjugate_gradients(matrix: sp.csr_matrix, inverse: Array, r: Array, solved: float, steps: int) -> Array:
    """Solve for all right-hand sides r, (3 n, k), at once; r becomes what is left.

    Parameters
    ----------
    matrix : (3 n, 3 n) csr matrix
        Of single precision, as all arrays here.
    inverse : (3 n,) array
        Of its diagonal.
    solved : float
        Residual of each column at the end, by that at the start, in the norm of `inverse`.
    steps : int
        At most.
    """
    if compiled := kernels("algebra.sparse", "gradient_kernels"):
        blocks = matrix.tobsr((3, 3))
        found: Array = compiled.solve(blocks.indptr, blocks.indices, blocks.data, inverse, r, solved, steps)
        return found
    inverse = inverse[:, None]
    x, z = np.zeros_like(r), inverse * r
    p, rz = z.copy(), np.einsum("ij,ij->j", r, z)
    goal = solved**2 * rz
    for _ in range(steps):
        q = matrix @ p
        curvature = np.einsum("ij,ij->j", p, q)
        alpha = np.divide(rz, curvature, out=np.zeros_like(rz), where=curvature > 0)
        x += alpha * p
        r -= alpha * q
        z = inverse * r
        last, rz = rz, np.einsum("ij,ij->j", r, z)
        if (rz <= goal).all():
            break
        p *= np.divide(rz, last, out=np.zeros_like(rz), where=last > 0)
        p += z
    return x
