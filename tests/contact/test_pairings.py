"""Pairs that are kept for the next model of the same bodies."""

import gc
import pickle
import weakref

import numpy as np
import pytest
from oracles import compliant, floating, inertial

from exudyn_partition.contact import pairings
from exudyn_partition.contact.normal_rows import NormalRows
from exudyn_partition.contact.patch_gaps import PatchGaps
from exudyn_partition.contact.rigid import RigidGaps, RigidPlane
from exudyn_partition.errors import PenetrationError


def copy_of(body):
    """The same body as another object, with nothing kept."""
    return pickle.loads(pickle.dumps(body))


def test_a_second_contact_in_the_same_places_pairs_nothing_and_is_the_same(round_body, flat_body, monkeypatch):
    slave = copy_of(round_body)
    laws = []
    for _ in range(2):
        laws.append(compliant(PatchGaps(inertial(slave), inertial(flat_body))))
        monkeypatch.setattr(pairings, "pair_surfaces", None)
    fresh, kept = (law.gaps for law in laws)
    np.testing.assert_array_equal(
        NormalRows(kept).flexibility(np.arange(9)), NormalRows(fresh).flexibility(np.arange(9))
    )
    q = np.r_[-4e-6 * slave.rigid[:, 2], np.zeros(flat_body.n_dofs)]
    np.testing.assert_array_equal(*(law.at(q).generalised for law in laws))
    assert laws[0].evaluation.lam.any()


def test_other_places_frames_and_bodies_have_their_own_pairs(round_body, flat_body, monkeypatch):
    slave, other = copy_of(round_body), copy_of(flat_body)
    pair, calls = pairings.pair_surfaces, []
    monkeypatch.setattr(
        pairings, "pair_surfaces", lambda *args, **options: calls.append(args) or pair(*args, **options)
    )
    sides = [(inertial, (0, 0, 0)), (inertial, (0, 0, 1e-5)), (inertial, (1e-4, 0, 0)), (floating, (0, 0, 0))]
    for _ in range(2):
        made = [PatchGaps(frame(slave, place), inertial(flat_body)) for frame, place in sides]
        made.append(PatchGaps(inertial(slave), inertial(other)))
    assert len(calls) == len(made)
    lifted = made[1].at(np.zeros(made[1].n)) - made[0].at(np.zeros(made[0].n))
    np.testing.assert_allclose(lifted[:5], 1e-5, rtol=1e-3)


def test_pairs_that_may_overlap_are_kept_apart_from_those_that_may_not(round_body, flat_body):
    slave = copy_of(round_body)
    assert PatchGaps(inertial(slave, (0, 0, -1e-5)), inertial(flat_body), pressed=True).placement.overlap > 0
    with pytest.raises(PenetrationError):
        PatchGaps(inertial(slave, (0, 0, -1e-5)), inertial(flat_body))


def test_pairs_elsewhere_in_space_are_the_same(round_body, flat_body, monkeypatch):
    """A row of equal bodies is paired once, and shares its arrays; places differ by round-off."""
    slave, force, laws = copy_of(round_body), [], []
    for place in np.array([[0, 0, 0], [0.1, 0.3, -0.7], [2.0, -1.1, 0.9]]):
        gaps = PatchGaps(inertial(slave, place), inertial(flat_body, place))
        monkeypatch.setattr(pairings, "pair_surfaces", None)
        law = compliant(gaps)
        law.at(np.r_[-4e-6 * slave.rigid[:, 2], np.zeros(flat_body.n_dofs)])
        force.append(law.evaluation.lam.sum())
        laws.append(law)
    np.testing.assert_allclose(force, force[0], rtol=1e-9)
    assert len({id(law.law.problem.F) for law in laws}) == len({id(law.gaps.stage.linear.H) for law in laws}) == 1
    laws[0].law.problem.solve(np.ones(len(laws[0].evaluation.lam)))
    assert laws[1].law.problem.index.size  # active rows are each contact's own


def test_sides_with_a_flexibility_of_their_own_neither_take_nor_change_what_is_kept(round_body, flat_body):
    """Implicit multipliers give sides that of their steps: twice as soft, rows yield twice as far, in its run alone."""
    slave, some = copy_of(round_body), np.arange(9)
    gaps, other = (PatchGaps(inertial(slave), inertial(flat_body)) for _ in range(2))
    kept, F = NormalRows(other).flexibility(some).copy(), NormalRows(other).problem().F.copy()
    gaps.exchange_flexibility([2 * side.flexibility for side in gaps.sides])
    np.testing.assert_allclose(NormalRows(gaps).flexibility(some), 2 * kept, rtol=1e-12)
    np.testing.assert_allclose(NormalRows(gaps).problem().F, 2 * F, rtol=1e-12)
    later = PatchGaps(inertial(slave), inertial(flat_body))
    np.testing.assert_array_equal(NormalRows(later).flexibility(some), kept)
    np.testing.assert_array_equal(NormalRows(later).problem().F, F)


def test_kept_pairs_are_few_and_keep_no_body(round_body, flat_body):
    slave, master = copy_of(round_body), copy_of(flat_body)
    for i in range(10):
        PatchGaps(inertial(slave, (0, 0, 1e-6 * i)), inertial(master))
        PatchGaps(floating(slave, rotation=(0, 0, 0.1 * i)), inertial(master))
    assert len(pairings.KEPT[slave]) == 16
    gone = [weakref.ref(body) for body in (slave, master)]
    del slave, master
    gc.collect()
    assert [ref() for ref in gone] == [None, None]


def test_contacts_on_planes_share_what_follows_from_their_rows(round_body):
    """Wherever body and plane are; on another plane rows are others, the same as those of a body that knows none."""
    slave, places = copy_of(round_body), np.array([[0, 0, 0], [0.1, 0.3, -0.7]])
    one, other = (compliant(RigidGaps(inertial(slave, place), RigidPlane(place))) for place in places)
    assert one.law.problem.F is other.law.problem.F
    assert one.gaps.stage.linear.H is other.gaps.stage.linear.H
    assert one.closed_stiffness() is other.closed_stiffness()
    tilted = RigidPlane((0, 0, -1e-4), (0.1, 0, 1))
    late, fresh = (compliant(RigidGaps(inertial(body), tilted)) for body in (slave, copy_of(round_body)))
    assert abs(late.gaps.stage.linear.H - one.gaps.stage.linear.H).max() > 1e-3
    np.testing.assert_array_equal(late.gaps.stage.linear.H, fresh.gaps.stage.linear.H)
    np.testing.assert_array_equal(late.law.problem.F, fresh.law.problem.F)
    np.testing.assert_array_equal(late.closed_stiffness(), fresh.closed_stiffness())
    late.gaps.exchange_flexibility([2 * side.flexibility for side in late.gaps.sides])
    np.testing.assert_allclose(NormalRows(late.gaps).problem().F, 2 * fresh.law.problem.F, rtol=1e-12)
    np.testing.assert_array_equal(NormalRows(RigidGaps(inertial(slave), tilted)).problem().F, fresh.law.problem.F)
    gone = weakref.ref(slave)
    del slave, one, other, late
    gc.collect()
    assert gone() is None


@pytest.mark.parametrize("frame", [inertial, floating])
def test_a_contact_does_not_depend_on_where_its_body_was_placed_before(round_body, frame):
    """To the last bit: plastic flow makes a millionth of what rounding changes."""
    body, plane = copy_of(round_body), RigidPlane((0, 0, -1.0), (0, 0, 1))
    anew = RigidGaps(frame(copy_of(round_body), (0, 0, 1e-4)), plane)
    RigidGaps(frame(body, (0.123, 0.456, 0.1)), plane)
    again = RigidGaps(frame(body, (0, 0, 1e-4)), plane)
    np.testing.assert_array_equal(again.area, anew.area)
    np.testing.assert_array_equal(again.placement.approach, anew.placement.approach)
    np.testing.assert_array_equal(again.at(np.zeros(again.n)), anew.at(np.zeros(anew.n)))
