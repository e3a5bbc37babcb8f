"""Motion of contacts by forces on others: through few fields, through all nodes, and by the matrices themselves."""

from types import SimpleNamespace

import numpy as np
import pytest

from exudyn_partition.contact.between import Exchange, FlexibilityBetween, RowFields
from exudyn_partition.contact.stages import Standing

NR, NP, SHARES = 6, 10, ((0.3, 0.8), (1.0, 0.5), (0.7, 0.2))


class SomeRows:
    """Rows of a contact with two sides, with one direction or three."""

    def __init__(self, rng, d, yielding):
        anchoring = SimpleNamespace(found_at=lambda anchor, make: make())
        self.d, self.gaps = d, SimpleNamespace(row_nodes=np.arange(NR), yielding=yielding, anchoring=anchoring)
        self._rows = [rng.normal(size=(d * NR, NP)) for _ in range(2)]

    def side_rows(self, side):
        return self._rows[side]

    def standing(self):
        return Standing(self, None)


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
            found = between.flexibility(j, some[j], k, some[k])
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
