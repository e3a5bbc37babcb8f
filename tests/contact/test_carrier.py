"""What carries a rigid surface; `test_rigid` compares the rows that follow from it with differences."""

import numpy as np
import pytest
from oracles import floating

from exudyn_partition.contact.carrier import Carrier
from exudyn_partition.contact.rigid import RigidGaps, RigidPlane
from exudyn_partition.errors import InputError


def test_a_carrier_tells_where_its_body_is_now():
    now = {"place": np.zeros(3)}
    carrier = Carrier(lambda: (now["place"], np.eye(3)))
    assert carrier.pose.tolist() == [0.0] * 3 + [1, 0, 0, 0, 1, 0, 0, 0, 1]
    now["place"] = np.array([1.0, 2.0, 3.0])
    assert carrier.pose[:3].tolist() == [1, 2, 3]
    assert carrier.motion.tolist() == [0.0] * 6  # at rest, if nothing else is said


def test_nothing_carries_a_surface_that_is_fixed(round_body):
    gaps = RigidGaps(floating(round_body), RigidPlane())
    assert not len(gaps.carrier.pose)
    assert not len(gaps.carrier.motion)
    with pytest.raises(InputError, match="nothing carries"):
        gaps.carrier.rows(gaps.stage, gaps.present.places[0])
