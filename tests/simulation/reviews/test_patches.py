"""Contacts whose surfaces touch while no row closes."""

import warnings

import pytest

import exudyn_partition as ep
from exudyn_partition.errors import ModelLimitWarning


@pytest.mark.parametrize("sinks", [False, True])
def test_a_slow_tip_that_sinks_without_a_force_is_told(mbs, round_body, sinks):
    """It comes to lie within the plane by less than the mean gap of its lowest row."""
    lowest = round_body.points[:, 2].min()
    ball = ep.CreatePartitionBody(
        mbs, round_body, referencePosition=[0, 0, 1e-9 - lowest], initialVelocity=[0, 0, -1e-4 if sinks else 1e-4]
    )
    contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane())
    mbs.Assemble()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ModelLimitWarning)
        result = ep.solve_dynamic(mbs, end_time=2e-3, step=1e-5, method="implicit")
    assert not contact.force(result).any()
    told = [str(one.message) for one in caught if "never closed" in str(one.message)]
    assert len(told) == sinks
    if sinks:
        assert f"surfaces lie {contact.depth(result):.3g} m within each other" in told[0]
        assert contact.depth(result) == pytest.approx(2e-7 - 1e-9, rel=1e-2)
