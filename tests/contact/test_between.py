"""Flexibility between contacts on common bodies: what unit forces do, and what all forces together do."""

from types import SimpleNamespace

import numpy as np
import pytest

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

    def standing(self):
        return Standing(self, np.zeros(1))


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
