"""Fronts that are cut out of factors: they solve for some rows as the whole matrix does."""

import pickle

import numpy as np
import pytest
import scipy.sparse as sp
from oracles import each_way

from exudyn_partition.algebra.sparse.fronts import find_fronts
from exudyn_partition.algebra.sparse.kept_fronts import KeptFronts
from exudyn_partition.algebra.sparse.multifrontal import Analysis, Factorisation
from exudyn_partition.errors import InputError

SHAPE = 7, 8, 9


def springs(*shape):
    """Stiffness of springs on a grid that is held at its ends, a little uneven."""
    total = sp.csr_matrix((1, 1))
    for n in shape:
        total = sp.kronsum(total, sp.diags([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], [-1, 0, 1]))
    return sp.csr_matrix(total + sp.diags(np.linspace(0.0, 0.1, total.shape[0])))


MATRIX = sp.csr_matrix(sp.kron(springs(*SHAPE), np.eye(3) + 1))
NODES = np.indices(SHAPE).reshape(3, -1)[::-1]  # of the grid, whose first direction counts last
AWAY = np.linalg.norm(NODES, axis=0)


def dofs(nodes):
    return (3 * np.flatnonzero(nodes)[:, None] + np.arange(3)).ravel()


def rows_of(chosen, n=MATRIX.shape[0]):
    return sp.identity(n, format="csr")[chosen]


ZONE = dofs(AWAY < 4)
EDGE = dofs((AWAY < 4) & (abs(springs(*SHAPE)) @ (AWAY >= 4) > 0))


@pytest.mark.parametrize("last", [(), (EDGE,)], ids=["any order", "edge last"])
@pytest.mark.parametrize("shift", [0.0, 2.0])
def test_they_solve_as_a_dense_inverse(shift, last):
    matrix = sp.csr_matrix(MATRIX - shift * sp.identity(MATRIX.shape[0]))
    inverse = np.linalg.inv(matrix.toarray())
    rng = np.random.default_rng(0)
    rhs, some = rng.standard_normal((len(ZONE), 130)), rng.permutation(len(ZONE))[:20]
    exact, alone = inverse[np.ix_(ZONE, ZONE)] @ rhs, inverse[np.ix_(ZONE, ZONE[some])] @ rhs[some]

    def answers():
        factors = Factorisation(matrix, Analysis(lambda: matrix, lambda pattern: last))
        kept = factors.kept(rows_of(ZONE))
        reached, rows = kept.reached(some), kept.rows[some]
        x = kept.solve(rhs[some], rows, reached)
        return kept @ rhs, kept @ rhs[:, 0], x[rows], kept.complete(x, reached)

    for found in each_way(answers):
        for one, known in zip(found, (exact, exact[:, 0], alone[some], alone), strict=True):
            np.testing.assert_allclose(one, known, rtol=0, atol=1e-11 * abs(exact).max())


def test_single_precision():
    kept = Factorisation(MATRIX).kept(rows_of(ZONE))
    rhs = np.random.default_rng(0).standard_normal(len(ZONE))
    found = kept.single() @ rhs
    assert found.dtype == np.float32
    assert np.linalg.norm(found - kept @ rhs) < 1e-5 * np.linalg.norm(found)


def test_few_are_kept_if_the_edge_comes_last():
    """Of a part with a sixth of the nodes; in any order they need large separators of the whole."""
    kept = [
        Factorisation(MATRIX, Analysis(lambda: MATRIX, lambda pattern, last=last: last)).kept(rows_of(ZONE))
        for last in ((), (EDGE,))
    ]
    assert len(kept[1].store) < 0.8 * len(kept[0].store)
    assert len(kept[1].signs) == len(ZONE)  # nothing outside


def test_zeros_of_a_wide_front_are_not_kept():
    """A full matrix has one front, of whose inverse factor nearly half is zero."""
    rng, n = np.random.default_rng(1), 400
    root = rng.standard_normal((n, n))
    matrix, rhs, some = sp.csr_matrix(root @ root.T + n * np.eye(n)), rng.standard_normal(n), np.arange(0, n, 3)
    kept = Factorisation(matrix).kept(rows_of(some, n))
    assert len(kept.store) < 0.7 * n**2
    exact = np.linalg.inv(matrix.toarray())[np.ix_(some, some)] @ rhs[some]
    np.testing.assert_allclose(kept @ rhs[some], exact, rtol=0, atol=1e-12 * abs(exact).max())


def test_groups_come_last_and_share_no_front():
    groups = EDGE, np.setdiff1d(dofs(AWAY < 2.5), EDGE)
    for fronts in each_way(lambda: find_fronts(MATRIX, groups)):
        group = np.zeros(MATRIX.shape[0])
        for number, rows in enumerate(groups, 1):
            group[rows] = number
        group = group[fronts.order]
        assert (np.diff(group) >= 0).all()
        for start, end in zip(fronts.starts[:-1], fronts.starts[1:], strict=True):
            assert group[start] == group[end - 1]


def test_a_dense_inverse_is_one_front():
    inverse = np.linalg.inv(MATRIX[ZONE][:, ZONE].toarray())
    kept, rhs = KeptFronts.of_inverse(inverse), np.random.default_rng(0).standard_normal(len(ZONE))
    np.testing.assert_allclose(kept @ rhs, inverse @ rhs, rtol=1e-9)
    np.testing.assert_allclose(kept.reached(np.array([3])), [0])


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("starts", lambda a: a[::-1].copy()),
        ("ends", lambda a: a[:-1]),
        ("changes", lambda a: a + 10**6),
        ("rows", lambda a: a - 10**6),
        ("store", lambda a: a[:-1]),
        ("store", lambda a: a * np.nan),
    ],
)
def test_arrays_that_do_not_fit_are_refused(name, change):
    """Compiled loops trust them; those of a file may be damaged."""
    kept = Factorisation(MATRIX).kept(rows_of(ZONE))
    fields = {key: getattr(kept, key) for key in ("store", "starts", "ends", "changes", "signs", "rows")}
    with pytest.raises(InputError, match=f"{name}: expected"):
        KeptFronts(**{**fields, name: change(fields[name])})


def test_what_comes_from_another_process_is_as_what_was_sent():
    """Loops would be compiled again for arrays that can be written to."""
    sent = Factorisation(MATRIX).kept(rows_of(ZONE))
    come = pickle.loads(pickle.dumps(sent))
    for field in ("store", "starts", "ends", "changes", "signs", "rows"):
        assert not getattr(come, field).flags.writeable
    np.testing.assert_array_equal(come @ np.ones(len(ZONE)), sent @ np.ones(len(ZONE)))
