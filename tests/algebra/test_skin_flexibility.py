"""Flexibility that is found on demand: the same as a dense inverse, whatever was asked for before."""

import pickle

import numpy as np
import pytest
import scipy.sparse as sp
from oracles import each_way

from exudyn_partition.algebra.sparse import skin_flexibility
from exudyn_partition.algebra.sparse.half_solved import HalfSolved
from exudyn_partition.algebra.sparse.kept_fronts import KeptFronts
from exudyn_partition.algebra.sparse.multifrontal import Analysis, Factorisation, Ordered
from exudyn_partition.algebra.sparse.skin_flexibility import SkinFlexibility, StoredFactors, largest_value, works
from exudyn_partition.errors import InputError, MemoryLimitError

SHAPE = 9, 8, 7
RNG = np.random.default_rng(0)


def springs(*shape):
    """Stiffness of springs on a grid that is held at its ends, a little uneven."""
    total = sp.csr_matrix((1, 1))
    for n in shape:
        total = sp.kronsum(total, sp.diags([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], [-1, 0, 1]))
    return sp.csr_matrix(total + sp.diags(np.linspace(0.0, 0.1, total.shape[0])))


MATRIX = sp.csr_matrix(sp.kron(springs(*SHAPE), np.eye(3) + 1))
PLACES = np.indices(SHAPE).reshape(3, -1)[::-1].T  # of the nodes; the first direction counts last
OUTSIDE = np.flatnonzero(((PLACES == 0) | (np.array(SHAPE)[::-1] - 1 == PLACES)).any(axis=1))
DOFS = (3 * OUTSIDE[:, None] + np.arange(3)).ravel()
SHIFTS = [0.0, 2.0]  # positive definite, and between two eigenvalues
VECTORS, WEIGHTS = RNG.standard_normal((len(DOFS), 4)), np.diag([0.3, -0.1, 0.2, -0.4])


def skin(rows=None, shift=0.0):
    """Flexibility of rows, (r, k), of the outer nodes' dofs, and the same as an array."""
    matrix = sp.csr_matrix(MATRIX - shift * sp.identity(MATRIX.shape[0]))
    analysis = Analysis(lambda: matrix)
    kept = Factorisation(matrix, analysis).kept(sp.identity(MATRIX.shape[0], format="csr")[DOFS])
    factors = StoredFactors.of(matrix, analysis.fronts, DOFS, kept)
    rows = sp.identity(len(DOFS), format="csr") if rows is None else rows
    vectors = rows @ VECTORS
    dense = np.linalg.inv(matrix.toarray())[np.ix_(DOFS, DOFS)]
    return SkinFlexibility(factors, rows, vectors, WEIGHTS), rows @ dense @ rows.T + vectors @ WEIGHTS @ vectors.T


def normals():
    """Rows along a direction at each node."""
    n = len(DOFS)
    return sp.csr_matrix((RNG.standard_normal(n), np.arange(n), np.arange(0, n + 1, 3)), shape=(n // 3, n))


def assert_same(found, exact, dense):
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-12 * abs(dense).max())


@pytest.mark.parametrize("rows", [None, normals()], ids=["all directions", "normals"])
@pytest.mark.parametrize("shift", SHIFTS)
def test_it_is_an_array_that_was_not_made(rows, shift):
    n = len(DOFS) if rows is None else rows.shape[0]
    some, others = RNG.permutation(n)[:140], RNG.permutation(n)[:25]
    forces, loads = RNG.standard_normal((n, 3)), sp.random(n, 30, 0.05, random_state=0, format="csc")

    def answers():
        F, dense = skin(rows, shift)
        assert (len(F), F.shape) == (n, dense.shape)
        part, exact = F[20:200, 5:90], dense[20:200, 5:90]
        few = np.arange(0, 80, 7)
        found = [
            (F.between(some), dense[np.ix_(some, some)]),
            (F[np.ix_(some, others)], dense[np.ix_(some, others)]),
            (F.between(np.array([3, 1, 3])), dense[np.ix_([3, 1, 3], [3, 1, 3])]),
            (F @ forces, dense @ forces),
            (forces.T @ F, forces.T @ dense),
            (forces[:, 0] @ F @ forces[:, 1], forces[:, 0] @ dense @ forces[:, 1]),
            (works(F, loads), works(dense, loads)),
            (part[np.ix_(few, few)], exact[np.ix_(few, few)]),
            (part @ forces[:85], exact @ forces[:85]),
            (forces[:180].T @ part, forces[:180].T @ exact),
            (part.T @ forces[:180], exact.T @ forces[:180]),
            (np.asarray(part[10:, :50]), exact[10:, :50]),
            (np.asarray(F), dense),
        ]
        assert largest_value(part) == pytest.approx(largest_value(exact), rel=1e-5)
        return [values for values, _ in found], [values for _, values in found], dense

    for found, exact, dense in each_way(answers):
        for values, known in zip(found, exact, strict=True):
            assert_same(values, known, dense)


@pytest.mark.parametrize("most", [0, 100_000, 400_000, 10**9])
def test_memory_is_bounded(most):
    """What is kept takes no more than that, and changes no answer: also when nothing has room."""
    F, dense = skin()
    columns = HalfSolved(F.factors.kept, F.rows, F.vectors, F.weights, most)
    answered = 0
    for size in (3, 60, 30, 3, 90, 200, 12, 60):
        some = RNG.permutation(len(F))[:size]
        found = columns.between(some, some)
        assert columns.nbytes <= most
        if found is not None:
            answered += 1
            assert_same(found, dense[np.ix_(some, some)], dense)
    assert answered == {0: 0, 10**9: 8}.get(most, answered)
    assert answered > 0 or most == 0


def test_too_many_columns_are_solved_block_by_block(monkeypatch):
    monkeypatch.setattr(skin_flexibility, "KEPT_BYTES", 1000)
    F, dense = skin()
    some, others = RNG.permutation(len(F))[:230], np.arange(100)
    assert_same(F.between(some), dense[np.ix_(some, some)], dense)
    assert_same(F[np.ix_(some, others)], dense[np.ix_(some, others)], dense)
    assert F.columns.nbytes < 1000


def test_what_is_half_done_when_memory_runs_out_is_forgotten(monkeypatch):
    F, dense = skin()
    some, others = np.arange(30), np.arange(20, 60)
    assert_same(F.between(some), dense[np.ix_(some, some)], dense)

    def full(*_):
        raise MemoryError

    with monkeypatch.context() as patch:
        patch.setattr(KeptFronts, "push", full)
        with pytest.raises(MemoryError):
            F.between(others)
    assert_same(F.between(others), dense[np.ix_(others, others)], dense)


def test_symmetric_to_the_last_bit():
    """Laws of contact ask for a symmetric matrix."""
    F, _ = skin()
    for size in (10, 50, 130):
        found = F.between(np.sort(RNG.permutation(len(F))[:size]))
        assert (found == found.T).all()


@pytest.mark.parametrize("shift", SHIFTS)
def test_factors_are_found_again(shift):
    """From what a file holds, to the last bit."""
    F, _ = skin(shift=shift)
    again = pickle.loads(pickle.dumps(F))
    for name in ("store", "starts", "ends", "changes", "signs", "rows"):
        assert (getattr(again.factors.kept, name) == getattr(F.factors.kept, name)).all()
    some = np.arange(0, len(F), 5)
    assert (again.between(some) == F.between(some)).all()


def test_an_ordered_matrix_is_the_matrix():
    analysis = Analysis(lambda: MATRIX)
    assert abs(Ordered.of(MATRIX, analysis.fronts).whole() - MATRIX).max() == 0.0


def test_more_fields():
    F, dense = skin()
    vectors, weights = RNG.standard_normal((len(F), 2)), np.array([-0.5, 0.2])
    some = np.arange(40)
    exact = dense + (vectors * weights) @ vectors.T
    assert_same(F.plus(vectors, weights).between(some), exact[np.ix_(some, some)], dense)


def test_large_arrays_are_refused(monkeypatch):
    monkeypatch.setattr(skin_flexibility, "MOST_ROWS", 100)
    F, dense = skin()
    assert_same(np.asarray(F[:100, 7:100]), dense[:100, 7:100], dense)
    with pytest.raises(MemoryLimitError, match="needs a smaller patch"):
        np.asarray(F)


def test_wrong_parts():
    F, _ = skin()
    with pytest.raises(InputError, match="two slices, or numbers"):
        F[np.arange(3), :]
    with pytest.raises(InputError, match="neighbouring rows"):
        F[::2, ::2]
    fields = {name: getattr(F.factors, name) for name in ("upper", "order", "starts", "ends", "changes", "dofs")}
    for wrong in ({"order": F.factors.order[::2]}, {"order": 0 * F.factors.order}, {"starts": F.factors.starts + 1}):
        with pytest.raises(InputError):
            StoredFactors(**{**fields, **wrong})
    with pytest.raises(InputError, match="rows: expected"):
        SkinFlexibility(F.factors, F.rows[:, 1:], F.vectors, F.weights)
