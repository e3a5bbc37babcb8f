"""The penalty layer yields as much as the residual flexibility."""

import numpy as np
import pytest
from oracles import closed, inertial

from exudyn_partition.contact.formulations.compliance import ComplianceContact
from exudyn_partition.contact.formulations.penalty import PenaltyContact, bed_stiffness
from exudyn_partition.contact.patch_gaps import PatchGaps


def test_penalty_layer_yields_as_the_residual_flexibility_does(round_body, flat_body):
    """Under uniform pressure alike; a small contact gets no help from what lies around it, and is softer by a few."""
    sides = inertial(round_body), inertial(flat_body)
    compliance, gaps = ComplianceContact(PatchGaps(*sides)), PatchGaps(*sides)
    layer = PenaltyContact(gaps, bed_stiffness(gaps))
    q = closed(round_body, flat_body)
    for law in (compliance, layer):
        law.force(q)
    A = gaps.area
    pressed = A @ gaps.flexibility(np.arange(len(A))) @ A  # by a unit pressure
    assert layer.stiffness * pressed == pytest.approx(A.sum(), rel=1e-12)
    assert 0.25 < layer.lam.sum() / compliance.lam.sum() < 0.5
