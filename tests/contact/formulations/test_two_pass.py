"""Two passes are the mean of both."""

import numpy as np
import pytest
from oracles import closed, floating, inertial, moved, relative

from exudyn_partition.contact.formulations.compliance import ComplianceContact
from exudyn_partition.contact.formulations.penalty import PenaltyContact, bed_stiffness
from exudyn_partition.contact.formulations.two_pass import TwoPass
from exudyn_partition.contact.patch_gaps import PatchGaps


@pytest.mark.parametrize("law_of", [ComplianceContact, lambda gaps: PenaltyContact(gaps, bed_stiffness(gaps))])
def test_two_passes_are_the_mean_of_both(round_body, flat_body, law_of):
    there, back = (law_of(PatchGaps(*sides)) for sides in (
        (inertial(round_body), inertial(flat_body)), (inertial(flat_body), inertial(round_body))
    ))  # fmt: skip
    both = TwoPass(there, back)
    q = closed(round_body, flat_body)
    force, tangent = both.force(q), both.tangent()
    assert both.lam.sum() == pytest.approx((there.lam.sum() + back.lam.sum()) / 2, rel=1e-12)
    np.testing.assert_allclose(both.resultant()[2], both.lam.sum(), rtol=1e-3)
    d = 1e-12 * np.random.default_rng(0).standard_normal(len(q))
    assert relative(both.force(q + d) - both.force(q - d), -2 * tangent @ d) < 1e-4
    work = both.potential(q + d) - both.potential(q - d)
    assert work == pytest.approx(-2 * force @ d, rel=1e-3)
    assert both.node_areas.sum() == pytest.approx((there.node_areas.sum() + back.node_areas.sum()) / 2, rel=1e-12)


@pytest.mark.parametrize("kind", ["integrated", "node-to-segment"])
@pytest.mark.parametrize("depth", [4e-6, 8e-5])
def test_no_side_is_preferred(round_body, flat_body, kind, depth):
    """With slave and master exchanged, all is the same, or the opposite; deep down the ball's edge is reached."""
    sides = inertial(round_body), inertial(flat_body)
    one, other = (
        TwoPass(*(ComplianceContact(PatchGaps(*pair, kind)) for pair in pairs))
        for pairs in ((sides, sides[::-1]), (sides[::-1], sides))
    )
    n, tilt = round_body.n_dofs, np.array([0, 0, -depth, 1e-5, 2e-5, 0])
    q = np.r_[moved(sides[0], tilt[:3], tilt[3:]), np.zeros(flat_body.n_dofs)]
    there, back = one.force(q), other.force(np.r_[q[n:], q[:n]])
    scale = one.lam.sum()
    np.testing.assert_allclose(np.r_[back[-n:], back[:-n]], there, rtol=0, atol=1e-9 * abs(there).max())
    np.testing.assert_allclose(one.resultant(), -other.resultant(), rtol=0, atol=1e-9 * scale)
    point = np.array([1e-3, 2e-3, 0.0])
    moment = one.moment(point)
    np.testing.assert_allclose(moment, -other.moment(point), rtol=0, atol=1e-12 * scale)
    on_nodes, places = one.nodal_forces()[0], one.gaps.places_now()[0]
    np.testing.assert_allclose(moment, np.cross(places - point, on_nodes).sum(axis=0), rtol=0, atol=1e-6 * scale)
    assert one.least_gap == other.least_gap
    for law in (one, other):
        assert (law.edge_reached() is not None) == (depth > 1e-5)


@pytest.mark.parametrize("kind", ["integrated", "node-to-segment"])
def test_pressures_of_both_passes_carry_the_force(round_body, flat_body, kind):
    """The nodes of the second slave are numbered after all of the first."""
    sides = floating(round_body), floating(flat_body)
    both = TwoPass(*(ComplianceContact(PatchGaps(*pair, kind)) for pair in (sides, sides[::-1])))
    both.force(np.r_[moved(sides[0], [0, 0, -4e-6]), np.zeros(flat_body.n_dofs)])
    assert len(both.passes[0].row_nodes) < len(both.passes[0].node_areas)
    on_nodes = np.zeros(len(both.node_areas))
    on_nodes[both.row_nodes] = both.lam
    pressures = both.node_pressures @ on_nodes
    assert pressures.max() > 0
    areas = np.concatenate([law.gaps.area for law in both.passes])
    whole = both.node_areas[both.row_nodes]
    assert (areas / 2 <= whole * (1 + 1e-9)).all()  # rows that lie partly beside the other patch have less
    assert np.isclose(areas / 2, whole, rtol=1e-9, atol=0).mean() > 0.5
    if kind == "integrated":
        assert both.node_areas @ pressures == pytest.approx(both.lam.sum(), rel=1e-9)
