"""Two passes are the mean of both."""

import numpy as np
import pytest
from oracles import closed, inertial, relative

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
