"""The penalty layer yields as much as the residual flexibility."""

import numpy as np
import pytest
import scipy.linalg
from oracles import closed, compliant, inertial, moved, relative

import exudyn_partition as ep
from exudyn_partition.algebra.friction import STICK
from exudyn_partition.contact.formulations.choices import Penalty
from exudyn_partition.contact.formulations.penalty import bed_stiffness
from exudyn_partition.contact.normal_rows import NormalRows
from exudyn_partition.contact.patch_contact import PatchContact
from exudyn_partition.contact.patch_gaps import PatchGaps
from exudyn_partition.contact.rigid import RigidGaps, RigidPlane


def test_penalty_layer_yields_as_the_residual_flexibility_does(round_body, flat_body):
    """Under uniform pressure alike; a small contact gets no help from what lies around it, and is softer by a few."""
    sides = inertial(round_body), inertial(flat_body)
    compliance, gaps = compliant(PatchGaps(*sides)), PatchGaps(*sides)
    layer = PatchContact(gaps, Penalty(bed_stiffness(gaps)))
    q = closed(round_body, flat_body)
    for law in (compliance, layer):
        law.at(q)
    A = gaps.area
    pressed = A @ NormalRows(gaps).flexibility(np.arange(len(A))) @ A  # by a unit pressure
    assert layer.law.layer * pressed == pytest.approx(A.sum(), rel=1e-12)
    assert 0.25 < layer.evaluation.lam.sum() / compliance.evaluation.lam.sum() < 0.5


def test_a_row_on_nodes_with_mass_adds_a_tenth_to_the_highest_squared_frequency_at_most(pair_of):
    body = pair_of("craig-bampton")[0]
    law = PatchContact(RigidGaps(inertial(body), RigidPlane(), "node-to-segment"), Penalty())
    scale = 1 / np.sqrt(body.mass.diagonal())
    highest = scipy.linalg.eigvalsh(scale[:, None] * body.stiffness.toarray() * scale)[-1]
    rows = scale * law.gaps.jacobian(np.arange(len(law.gaps.area)))
    added = law.law.layer * law.gaps.area * np.sum(rows**2, axis=1)
    assert added.max() == pytest.approx(0.1 * highest, rel=1e-3)


def test_the_layer_is_softer_along_the_tangents_by_the_ratio_of_mindlin(round_body):
    """2 (1 - nu) / (2 - nu), as long as rows stick; by it the work of a shift is stored, and returned."""
    law = PatchContact(RigidGaps(inertial(round_body), RigidPlane()), Penalty(), ep.Coulomb(2.0))
    side, depth, shift = law.gaps.slave, 4e-6, 1e-9
    for start in (0.0, 1.0):
        law.at(moved(side, [0, 0, -depth]))
        law.accept(start)
    before, stored = law.evaluation.traction.sum(axis=0)[0], law.evaluation.stored
    law.at(moved(side, [shift, 0, -depth]))
    along = law.law.layer * law.gaps.area[law.evaluation.index].sum() * 2 * (1 - 0.3) / (2 - 0.3)
    assert law.evaluation.traction.sum(axis=0)[0] - before == pytest.approx(-along * shift, rel=1e-2)
    assert law.evaluation.stored - stored == pytest.approx(0.5 * along * shift**2, rel=2e-2)


def test_a_layer_is_stiffest_where_all_rows_are_closed_and_stuck(round_body):
    """Limits of explicit steps are found by that stiffness; here it is found by forces on the way there and back."""
    law = PatchContact(RigidGaps(inertial(round_body), RigidPlane()), Penalty(), ep.Coulomb(2.0))
    depth = 1.5 * law.gaps.at(np.zeros(law.gaps.n)).max()  # closes the last row
    pressed, rng, stiffness = moved(law.gaps.slave, [0, 0, -depth]), np.random.default_rng(0), law.closed_stiffness()
    for start in (0.0, 1.0):
        law.at(pressed)
        law.accept(start)
    assert (law.evaluation.status == STICK).all()
    for way in 1e-12 * rng.standard_normal((5, len(pressed))):
        there, back = law.at(pressed + way).generalised.copy(), law.at(pressed - way).generalised
        assert relative(back - there, 2 * stiffness @ way) < 1e-6
