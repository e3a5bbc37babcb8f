"""Stages of a contact's rows: what each one keeps, when the next one comes, and what runs share."""

import numpy as np
import pytest
from oracles import compliant, floating, inertial, moved

import exudyn_partition as ep
from exudyn_partition.contact.normal_rows import NormalRows
from exudyn_partition.contact.patch_gaps import PatchGaps
from exudyn_partition.contact.rigid import RigidGaps, RigidPlane, RigidSphere
from exudyn_partition.contact.stages import Anchor, PresentRows


def at(slave, master, x, z=-4e-6):
    """Coordinates where the slave has moved along x and z [m]; the master's are zero."""
    return np.r_[moved(slave, [x, 0, z]), np.zeros(master.n)]


def test_a_frozen_stage_stays_until_its_pairs_slide_and_another_comes_when_they_stand_still(round_body, flat_body):
    slave, master = inertial(round_body), inertial(flat_body)
    gaps, away = PatchGaps(slave, master), at(slave, master, 0.1e-3)
    start = gaps.stage
    for depth in (-1e-6, -6e-6, 3e-6):
        gaps.at(at(slave, master, 0.0, depth))
        assert gaps.stage == start
    gaps.at(away)
    assert gaps.moving
    for _ in range(1000):
        found = gaps.at(away)
        gaps.accept(gaps.after())
    assert not gaps.moving
    assert gaps.stage != start
    again = gaps.stage
    assert found.min() < 0
    gaps.begin()
    assert gaps.stage == start != again


def test_what_follows_from_a_stage_is_found_once_and_goes_with_it(round_body, flat_body):
    slave, master = inertial(round_body), inertial(flat_body)
    gaps, found = PatchGaps(slave, master), []
    for x in (0.0, 0.0, 0.1e-3):
        gaps.at(at(slave, master, x))
        found.append(gaps.stage.once("place", lambda x=x: x))
    assert found == [0.0, 0.0, 0.1e-3]


def test_values_are_kept_as_long_as_their_anchor_and_their_rows_are_the_same(round_body, flat_body):
    rows, made = PatchGaps(inertial(round_body), inertial(flat_body)).stage.rows, iter(range(9))
    one, same, other = (Anchor(np.full(2, x), *np.empty((2, 0))) for x in (0.0, 0.0, 1e-9))

    def value(anchor, *index):
        return rows.at_anchor("value", anchor, lambda: next(made), *index)

    assert [value(one), value(same), value(other), value(one)] == [0, 0, 1, 2]
    assert [value(one, np.arange(3)), value(one, np.arange(3)), value(one, np.arange(4))] == [3, 3, 4]
    again = rows.for_run()
    assert isinstance(again, PresentRows)
    assert [again.at_anchor("value", other, lambda: 7), value(one, np.arange(4))] == [7, 4]


@pytest.mark.parametrize("friction", [None, 0.3])
def test_the_flexibility_follows_from_the_anchor_whatever_came_before(round_body, flat_body, friction):
    """It is kept while the sides move little. Where it was found is part of the state: another contact finds it too."""
    slave, master = floating(round_body), inertial(flat_body)
    law = compliant(PatchGaps(slave, master), None if friction is None else ep.Coulomb(friction))
    size, q = law.gaps.size, at(slave, master, 0.0)
    anchors = []
    for n in range(60):
        law.at(at(slave, master, 4e-3 * size * n))
        law.accept(float(n))
        anchors.append(law.state.gaps.anchor if law.remembers else law.gaps.accepted.anchor)
        fresh = law.for_run()
        fresh.begin(law.at_end(float(n)), float(n))
        q = at(slave, master, 4e-3 * size * (n + 1.3))
        expected = law.at(q).generalised
        np.testing.assert_allclose(fresh.at(q).generalised, expected, rtol=0, atol=1e-9 * abs(expected).max())
        law.begin()
    assert 5 < len({*map(id, anchors)}) < 50  # it was kept, and found again


@pytest.mark.parametrize("frame", [inertial, floating])
def test_a_second_run_is_the_first_whatever_came_before(round_body, frame):
    """Rows to a rigid surface keep their flexibility while they turn little; the next run must not begin with it."""
    law = compliant(RigidGaps(frame(round_body, (0, 0, 1e-6)), RigidSphere((0, 0, -2e-3), 2e-3)))
    ways = [moved(law.gaps.slave, [5e-6 * n, 0, -4e-6]) for n in (*range(1, 12), 1)]
    first, second = [], []
    for run in (first, second):
        own = law.for_run()
        run += [own.at(q).generalised for q in ways]
    assert abs(np.array(first)).max() > 1
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("slides", [False, True])
def test_other_flexibilities_hold_in_each_stage_and_after_a_reset(round_body, flat_body, slides):
    """Twice as soft: rows yield twice as far, frozen, followed, and at the start of the next run."""
    slave, master = inertial(round_body), inertial(flat_body)
    gaps, soft = (PatchGaps(slave, master) for _ in range(2))
    q, some = at(slave, master, 0.1e-3 if slides else 0.0), np.arange(4)
    for each in (gaps, soft):
        each.at(q)
    before, _ = (NormalRows(each).flexibility(some) for each in (gaps, soft))
    soft.exchange_flexibility([2 * side.flexibility for side in soft.sides])
    assert soft.moving == slides
    np.testing.assert_allclose(NormalRows(soft).flexibility(some), 2 * before, rtol=1e-12)
    for each in (gaps, soft):
        each.begin()
    np.testing.assert_allclose(NormalRows(soft).flexibility(some), 2 * NormalRows(gaps).flexibility(some), rtol=1e-12)
    for each in (gaps, soft):
        each.at(q)
    np.testing.assert_allclose(NormalRows(soft).flexibility(some), 2 * NormalRows(gaps).flexibility(some), rtol=1e-12)


def test_rows_on_a_fixed_plane_are_one_stage_however_far_they_slide(round_body):
    gaps = RigidGaps(inertial(round_body, (0, 0, 1e-6)), RigidPlane())
    start = gaps.stage
    there = gaps.at(moved(gaps.slave, [0.3, -0.2, -3e-6]))
    assert gaps.stage == start
    assert not gaps.moving
    np.testing.assert_allclose(there, gaps.at(np.zeros(gaps.n)) - 3e-6, atol=1e-15)
