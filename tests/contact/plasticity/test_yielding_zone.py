"""A plastic zone without a contact: forces on its patch grow step by step."""

from dataclasses import replace

import exudyn as exu
import numpy as np
import pytest
from oracles import box

import exudyn_partition as ep
from exudyn_partition.contact.plasticity.yielding_zone import YieldingZone, combined
from exudyn_partition.contact.plasticity.zone_motion import ZoneMotion
from exudyn_partition.contact.plasticity.zone_state import ZoneState

MATERIAL = ep.Material(E=70e9, nu=0.33, rho=2700.0, yield_stress=200e6, hardening=500e6)
STEPS = 40


@pytest.fixture(scope="module")
def motion():
    block = ep.fe_model(box(10e-3, 12e-3, 4e-3), MATERIAL, maxh=2e-3)
    body = ep.reduce(block, ep.Partition.ball(block, (0, 0, 4e-3), 2e-3, plastic_radius=3e-3), f_cut=60e3)
    item = ep.CreatePartitionBody(exu.SystemContainer().AddSystem(), body)
    return ZoneMotion.of(item.kinematics, 0)


@pytest.fixture(scope="module")
def zone(motion):
    return YieldingZone(motion)


def after(zone, state, force, settled, q=0.0):
    """State after a step with forces on the patch, and how often it ended, with all points that flow or not.

    By the plain fixed point, until the forces change by less than `settled`.
    """
    step = zone.step(state, q + np.zeros(zone.motion.kinematics.rows.shape[1]))
    if not state.goes_on:
        flowing = step.begins_to_flow(force)
        if flowing is None:
            return step.elastic(force), 0
        step = flowing
    ended = 0
    while not isinstance(step, ZoneState):
        change, push = step.first, step.push()
        flowed = step.flow(push, force)
        while np.linalg.norm(flowed.asks_for - change) > settled * step.size(flowed.asks_for):
            change = flowed.asks_for
            flowed = step.flow(step.push(change), force)
        step, ended = step.after(flowed), ended + 1
    return step, ended


def at_first_flow(motion, moved):
    """By what factor displacements of the nodes, (3 nz,) [m], make the zone flow first."""
    return MATERIAL.yield_stress / motion.zone.flow.of_strain(np.linalg.norm(motion.zone.strains(moved), axis=1).max())


def pressed(zone, settled, of_step=lambda zone: zone):
    """State after steps to twice the force at which the zone first flows, and how often each one ended."""
    motion, state, ended = zone.motion, zone.start, []
    force = -np.ones(motion.flexibility.of_patch.shape[1])
    first = at_first_flow(motion, motion.flexibility.of_patch @ force)
    for share in np.linspace(0.0, 2.0, STEPS + 1)[1:]:
        state, often = after(of_step(zone), state, share * first * force, settled)
        ended.append(often)
    return state, np.array(ended)


def test_forces_that_a_step_has_not_applied_are_applied_by_the_next(zone):
    """Each step leaves 3 %. If that were lost, it would add up over the steps that flow."""
    state, _ = pressed(zone, 0.03)
    moved = zone.motion.zone.pseudo_forces(state.plastic.strain) @ zone.motion.flexibility.of_patch
    assert np.count_nonzero(state.plastic.equivalent) > 20
    assert np.linalg.norm(state.applied.moved_patch - moved) < 0.06 * np.linalg.norm(moved)


def test_rigid_motion_feels_nothing_of_plastic_strain_though_steps_are_rough(zone):
    """The generalised forces are those of the whole plastic strain, which are balanced."""
    state, _ = pressed(zone, 0.1)
    expected = zone.motion.kinematics.rows.T @ zone.motion.zone.pseudo_forces(state.plastic.strain)
    np.testing.assert_allclose(state.generalised, expected, rtol=0, atol=1e-10 * abs(expected).max())


def test_the_next_step_knows_what_the_last_one_has_not_applied(motion, zone):
    """A body with the same dent has applied all of it at the start."""
    state, _ = pressed(zone, 0.1)
    dented = YieldingZone(replace(motion, start=state.plastic)).start
    moved = state.applied.moved_patch
    assert np.linalg.norm(dented.applied.moved_patch - moved) > 1e-3 * np.linalg.norm(moved)
    all_of_it = (state.applied.p + state.applied.left) @ motion.flexibility.of_patch
    np.testing.assert_allclose(dented.applied.moved_patch, all_of_it, rtol=0, atol=1e-9 * abs(moved).max())


def test_points_are_active_before_they_flow(zone):
    """By how stress has grown in the last step. Else each step in which others begin to flow would begin again."""
    _, ended = pressed(zone, 1e-3)
    flows = ended > 0
    assert np.count_nonzero(flows) > 15
    assert np.count_nonzero(ended > 1) < 0.2 * np.count_nonzero(flows)


@pytest.mark.parametrize(("kind", "within"), [(float, 1e-9), (np.float32, 1e-6)])
def test_what_a_zone_keeps_changes_no_answer(zone, kind, within):
    """One object in all steps, or another one in each of them."""
    kept, _ = pressed(zone.in_precision(kind), 1e-4)
    lost, _ = pressed(zone, 1e-4, lambda zone: zone.in_precision(kind))
    for found, expected in (
        (lost.plastic.strain, kept.plastic.strain),
        (lost.applied.moved_patch, kept.applied.moved_patch),
        (lost.generalised, kept.generalised),
        (lost.work, kept.work),
        (lost.stored, kept.stored),
    ):
        np.testing.assert_allclose(found, expected, rtol=0, atol=within * np.max(np.abs(expected)))


@pytest.mark.parametrize("in_between", ["as it was", "more force", "other points"])
def test_an_evaluation_depends_on_its_arguments_alone(zone, in_between):
    """Whatever was evaluated before, and whichever points were active there."""
    state, _ = pressed(zone, 1e-4)
    force = -np.ones(len(state.by_patch))
    expected, _ = after(zone, state, state.by_patch * 1.01, 1e-6)
    if in_between == "more force":
        assert after(zone, state, state.by_patch * 1.5, 1e-6)[1] > 0
    elif in_between == "other points":
        assert (
            after(
                zone,
                zone.start,
                3.0 * at_first_flow(zone.motion, zone.motion.flexibility.of_patch @ force) * force,
                1e-6,
            )[1]
            > 0
        )
    found, _ = after(zone, state, state.by_patch * 1.01, 1e-6)
    np.testing.assert_allclose(found.plastic.strain, expected.plastic.strain, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.stored, expected.stored, rtol=1e-10)


@pytest.mark.parametrize("kind", [float, np.float32])
def test_a_combination_of_guesses_does_what_the_same_guess_does(zone, kind):
    """But without a product: the first guess is the change of the last step, whose displacements are known."""
    ends, zone = [], zone.in_precision(kind)
    state, _ = pressed(zone, 1e-4)
    force = -np.ones(len(state.by_patch))
    step = zone.step(state, np.zeros(zone.motion.kinematics.rows.shape[1]))
    first = step.push()
    change = step.flow(first, force).asks_for
    assert np.linalg.norm(change - step.first) > 0.1 * np.linalg.norm(step.first) > 0
    other = 0.3 * step.first + 0.7 * change
    mixed = combined([first, step.push(change)], np.array([0.3, 0.7]))
    np.testing.assert_allclose(mixed.change, other)
    for push in (mixed, step.push(other)):
        flowed = step.flow(push, 1.01 * force)
        end = step.after(flowed)
        ends.append((flowed.asks_for, end.applied.moved_patch, end.generalised, [end.stored], end.change.change))
    for one, same in zip(*ends, strict=True):
        np.testing.assert_allclose(one, same, rtol=0, atol=(1e-9 if kind is float else 1e-5) * np.abs(same).max())


@pytest.mark.parametrize("share_of_body", [0.0, 0.8])
def test_work_done_on_the_zone_is_stored_or_taken_by_flow(motion, zone, share_of_body):
    """By forces on the patch and by the body's own motion, loaded, unloaded and pulled, beyond flow both ways."""
    rows, state = motion.kinematics.rows, zone.start
    force, shape = -np.ones(motion.flexibility.of_patch.shape[1]), np.zeros(rows.shape[1])
    shape[-1] = share_of_body
    force = force * at_first_flow(motion, motion.flexibility.of_patch @ force)
    if share_of_body:
        shape *= at_first_flow(motion, np.asarray(rows @ shape))
    done = before = 0.0
    for share in np.r_[np.linspace(0, 2, 13), np.linspace(2, -2, 17)[1:], np.linspace(-2, 0, 5)[1:]]:
        last = state
        state, _ = after(zone, state, share * force, 1e-11, share * shape)
        done += (share + before) / 2 * force @ (state.applied.moved_patch - last.applied.moved_patch)
        done -= (state.generalised + last.generalised) / 2 @ ((share - before) * shape)
        before = share
        assert state.stored + state.work == pytest.approx(done, rel=1e-6, abs=1e-8 * abs(done))
    assert state.work > 0
    p = motion.zone.pseudo_forces(state.plastic.strain)
    assert state.stored == pytest.approx(motion.zone.own_energy(state.plastic) - p @ (motion.flexibility.own @ p) / 2)
    assert 0 < state.stored < 0.2 * state.work


def test_the_bound_on_stress_is_that_of_first_flow_for_a_force_on_one_row(motion, zone):
    """From a state below flow: with more force strains must be computed, with less not."""
    rows, q = motion.flexibility.of_patch.shape[1], np.zeros(motion.kinematics.rows.shape[1])
    zone, state, force = zone.in_precision(float), zone.start, np.eye(rows)[rows // 2]
    force *= at_first_flow(motion, motion.flexibility.of_patch @ force)
    assert not zone.stays_elastic(state, q, 0.6 * force)
    assert zone.flows(state, q, 0.6 * force) is None
    assert zone.stays_elastic(state, q, 0.99 * force)
    assert not zone.stays_elastic(state, q, 1.01 * force)
    assert not zone.stays_elastic(state, q, -1.01 * force)
