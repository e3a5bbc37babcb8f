<<<<<<< HEAD
"""Flexibility between contacts on common bodies: what unit forces do, and what all forces together do."""
=======
"""Motion of contacts by forces on others: through few fields, through all nodes, and by the matrices themselves."""
>>>>>>> h-B

from types import SimpleNamespace

import numpy as np
import pytest

<<<<<<< HEAD
from exudyn_partition.contact.between import FlexibilityBetween
from exudyn_partition.contact.side import Standing


class Rows:
    """Three rows on the coordinates of each side's patch, of bodies that yield a share of their flexibility."""

    d = 1

    def __init__(self, random, shares):
        self.on_sides = [random.standard_normal((3, n)) for n in (4, 5)]
        self.gaps = SimpleNamespace(yielding=shares)

    def side_rows(self, side):
        return self.on_sides[side]
=======
from exudyn_partition.contact.between import Exchange, FlexibilityBetween, RowFields
from exudyn_partition.contact.side import Standing

NR, NP, SHARES = 6, 10, ((0.3, 0.8), (1.0, 0.5), (0.7, 0.2))


class SomeRows:
    """Rows of a contact with two sides, with one direction or three."""

    def __init__(self, rng, d, yielding):
        self.d, self.gaps = d, SimpleNamespace(row_nodes=np.arange(NR), yielding=yielding)
        self._rows = [rng.normal(size=(d * NR, NP)) for _ in range(2)]

    def side_rows(self, side):
        return self._rows[side]
>>>>>>> h-B

    def standing(self):
        return Standing(self, np.zeros(1))


<<<<<<< HEAD
@pytest.mark.parametrize("shares", [None, (0.3, 0.8)])
def test_motion_by_forces_is_the_sum_of_unit_forces_by_the_share_that_yields(shares):
    """By either side, of which the second contact pushes both; and `across` knows no share."""
    random = np.random.default_rng(0)
    rows = [Rows(random, shares), Rows(random, None)]
    blocks = [random.standard_normal((n, 5)) for n in (4, 5)]
    between = FlexibilityBetween(rows, [(0, side, 1, 1, block) for side, block in enumerate(blocks)])
    forces, some = np.array([2.0, -3.0]), np.array([0, 2])
    whole = [rows[0].on_sides[side] @ block @ (forces @ rows[1].on_sides[1][some]) for side, block in enumerate(blocks)]
    expected = sum(share * one for share, one in zip(shares or (1.0, 1.0), whole, strict=True))
    np.testing.assert_allclose(between.of(0, np.arange(3), 1, some) @ forces, expected, rtol=1e-12)
    np.testing.assert_allclose(between.moved(0, 1, some, forces), expected, rtol=1e-12)
    spread = np.zeros((3, 1))
    spread[some, 0] = forces
    none = np.zeros((3, 1))
    across = between.across([[none, none], [none, spread]])
    for side in range(2):
        np.testing.assert_allclose(across[0][side][:, 0], whole[side], rtol=1e-12)
=======
@pytest.fixture(params=[None, SHARES], ids=["at once", "shares"])
def chain(request):
    """Rows of three contacts, of which the first two have a body in common, and the last two; its links."""
    rng = np.random.default_rng(3)
    rows = [SomeRows(rng, d, request.param and request.param[j]) for j, d in enumerate((1, 3, 1))]
    links = []
    for j, side, k, other in ((0, 1, 1, 0), (1, 1, 2, 0)):
        between = rng.normal(size=(NP, 2)) @ rng.normal(size=(2, NP))
        links += [(j, side, k, other, between), (k, other, j, side, between.T)]
    return rows, links


def brute(rows, links, *, whole=False):
    """Motion of all rows of each contact by unit forces on those of another."""
    found = {}
    for j, side, k, other, between in links:
        share = 1.0 if whole or rows[j].gaps.yielding is None else rows[j].gaps.yielding[side]
        found[j, k] = share * rows[j].side_rows(side) @ between @ rows[k].side_rows(other).T
    return found


def test_few_fields_and_all_nodes_move_rows_alike(chain):
    rows, links = chain
    F, rng = brute(rows, links), np.random.default_rng(4)
    forces = [rng.normal(size=each.d * NR) for each in rows]
    for between in (RowFields(rows, Exchange.of(links)), FlexibilityBetween(rows, links)):
        assert set(between.pairs) == F.keys() == {(0, 1), (1, 0), (1, 2), (2, 1)}
        some = [np.arange(0, each.d * NR, 2) for each in rows]
        for (j, k), block in F.items():
            found = between.of(j, some[j], k, some[k])
            np.testing.assert_allclose(found, block[np.ix_(some[j], some[k])], atol=1e-9 * abs(block).max())
        pushing = {k: between.pushing(k, some[k], forces[k][some[k]]) for k in range(3)}
        for j in range(3):
            expected = sum(F[j, k][:, some[k]] @ forces[k][some[k]] for k in range(3) if (j, k) in F)
            atol = 1e-9 * abs(expected).max()
            np.testing.assert_allclose(between.moved(j, pushing), expected, atol=atol)
            np.testing.assert_allclose(between.closing(j, pushing), expected[:: rows[j].d], atol=atol)
        assert not between.moved(0, {2: pushing[2]}).any()  # no body in common


def test_motion_of_each_side_is_that_of_what_its_neighbours_carry(chain):
    """Whatever share of it yields within a step."""
    rows, links = chain
    F, rng = brute(rows, links, whole=True), np.random.default_rng(5)
    carried = [[rng.normal(size=(NR, each.d)) for _ in range(2)] for each in rows]
    for between in (RowFields(rows, Exchange.of(links)), FlexibilityBetween(rows, links)):
        moved = between.across(carried)
        for j, side, k, other, _ in links:
            expected = (F[j, k] @ carried[k][other].ravel()).reshape(NR, rows[j].d)
            np.testing.assert_allclose(moved[j][side], expected, atol=1e-9 * abs(expected).max())
        assert not moved[0][0].any()
        assert not moved[2][1].any()
>>>>>>> h-B
