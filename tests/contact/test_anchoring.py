"""Where the flexibility of rows is found: the anchor stays while they move little, and the rest may be lost."""

import numpy as np
import pytest
from oracles import floating, inertial, moved

from exudyn_partition.contact.anchoring import Anchoring
from exudyn_partition.contact.patch_gaps import PatchGaps
from exudyn_partition.contact.rigid import RigidGaps, RigidSphere

SAME = 0.02


@pytest.fixture(params=["a patch", "a sphere"])
def sliding(request, round_body, flat_body):
    """Gaps of rows that move, and coordinates where the slave has slid by a share of a facet."""
    slave = floating(round_body)
    if request.param == "a sphere":
        gaps = RigidGaps(slave, RigidSphere((0, 0, -2e-3), 2e-3))
    else:
        gaps = PatchGaps(slave, inertial(flat_body))
    still = np.zeros(gaps.n - slave.n)
    return gaps, lambda share: np.r_[moved(slave, [share * gaps.size, 0, -4e-6]), still]


def test_the_anchor_stays_while_rows_move_little(sliding):
    gaps, at = sliding
    found = []
    for share in (0.1, 0.1 + SAME / 8, 0.1 + SAME / 4, 0.3):
        gaps.at(at(share))
        found.append(gaps.anchoring.anchor(SAME))
    assert found[0] == found[1] == found[2] != found[3] == gaps.present.anchor
    np.testing.assert_array_equal(found[0].q, at(0.1))


def test_what_is_found_at_an_anchor_belongs_to_its_place_and_the_rows_come_back(sliding):
    """A value that is found later is the one that was found there, also if all that was kept is lost."""
    gaps, at = sliding
    gaps.at(at(0.1))
    anchor = gaps.anchoring.anchor(SAME)
    stance, normals = gaps.stance(), gaps.stage.normals.copy()
    gaps.at(at(0.1 + SAME / 4))
    here, elsewhere = gaps.present, gaps.stage.normals.copy()
    for _ in range(2):
        then = gaps.anchoring.found_at(anchor, lambda: gaps.stage.normals.copy())
        np.testing.assert_allclose(then, normals, rtol=0, atol=1e-12)
        np.testing.assert_allclose(gaps.anchoring.stance(anchor), stance, rtol=0, atol=1e-12)
        assert gaps.present == here
        np.testing.assert_array_equal(gaps.stage.normals, elsewhere)
        gaps.anchoring = Anchoring(gaps)
    assert abs(gaps.stance() - stance).max() > 1e-3
