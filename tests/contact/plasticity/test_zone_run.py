"""A plastic zone in a run, without a contact: forces on its patch grow step by step."""

from dataclasses import replace

import exudyn as exu
import numpy as np
import pytest
from oracles import box

import exudyn_partition as ep
from exudyn_partition.contact.plasticity.zone_run import ZoneMotion, ZoneRun

MATERIAL = ep.Material(E=70e9, nu=0.33, rho=2700.0, yield_stress=200e6, hardening=500e6)
STEPS = 40


@pytest.fixture(scope="module")
def motion():
    block = ep.fe_model(box(10e-3, 12e-3, 4e-3), MATERIAL, maxh=2e-3)
    body = ep.reduce(block, ep.Partition.ball(block, (0, 0, 4e-3), 2e-3, plastic_radius=3e-3), f_cut=60e3)
    item = ep.CreatePartitionBody(exu.SystemContainer().AddSystem(), body)
    return ZoneMotion.of(item.kinematics, 0)


def step(run, force, settled, q=0.0):
    """One step with forces on the patch, by the plain fixed point, until the forces change by less than `settled`.

    Returns how often it ends, with all points that flow or not.
    """
    ended = 0
    run.back()
    run.move(q + np.zeros(run.motion.kinematics.rows.shape[1]))
    if run.goes_on or (not run.stays_elastic(force) and run.look()):
        while True:
            ended += 1
            change = run.guess
            run.push()
            found = run.answer(force)
            while np.linalg.norm(found - change) > settled * run.size(found):
                change = found
                run.push(change)
                found = run.answer(force)
            if run.finish():
                break
    run.accept(run.after())
    return ended


def at_first_flow(motion, moved):
    """By what factor displacements of the nodes, (3 nz,) [m], make the zone flow first."""
    return MATERIAL.yield_stress / motion.zone.flow.of_strain(np.linalg.norm(motion.zone.strains(moved), axis=1).max())


def pressed(run, settled):
    """How often each step ends, to twice the force at which the zone first flows."""
    motion = run.motion
    force = -np.ones(motion.flexibility.of_patch.shape[1])
    first = at_first_flow(motion, motion.flexibility.of_patch @ force)
    return [step(run, share * first * force, settled) for share in np.linspace(0.0, 2.0, STEPS + 1)[1:]]


def test_forces_that_a_step_has_not_applied_are_applied_by_the_next(motion):
    """Each step leaves 3 %. If that were lost, it would add up over the steps that flow."""
    run = ZoneRun(motion)
    pressed(run, 0.03)
    p = motion.zone.pseudo_forces(run.state.plastic.strain)
    moved = p @ motion.flexibility.of_patch
    assert np.count_nonzero(run.state.plastic.equivalent) > 20
    assert np.linalg.norm(run.moved_patch - moved) < 0.06 * np.linalg.norm(moved)


def test_rigid_motion_feels_nothing_of_plastic_strain_though_steps_are_rough(motion):
    """The generalised forces are those of the whole plastic strain, which are balanced."""
    run = ZoneRun(motion)
    pressed(run, 0.1)
    p = motion.zone.pseudo_forces(run.state.plastic.strain)
    np.testing.assert_allclose(
        run.generalised, motion.kinematics.rows.T @ p, rtol=0, atol=1e-10 * abs(motion.kinematics.rows.T @ p).max()
    )


def test_a_run_that_goes_on_knows_what_the_last_step_has_not_applied(motion):
    last, run = ZoneRun(motion), ZoneRun(motion)
    pressed(last, 0.1)
    run.begin(last.state)
    moved = last.moved_patch
    np.testing.assert_allclose(run.moved_patch, moved, rtol=0, atol=1e-9 * abs(moved).max())
    np.testing.assert_allclose(run.generalised, last.generalised, rtol=0, atol=1e-9 * abs(last.generalised).max())
    np.testing.assert_allclose(run.stored(), last.stored(), rtol=1e-9)
    dented = ZoneRun(replace(motion, start=last.state.plastic))  # another body with this dent: all of it is applied
    assert np.linalg.norm(dented.moved_patch - moved) > 1e-3 * np.linalg.norm(moved)


def test_points_are_active_before_they_flow(motion):
    """By how stress has grown in the last step. Else each step in which others begin to flow would begin again."""
    run = ZoneRun(motion)
    ended = np.array(pressed(run, 1e-3))
    flows = ended > 0
    assert np.count_nonzero(flows) > 15
    assert np.count_nonzero(ended > 1) < 0.2 * np.count_nonzero(flows)


@pytest.mark.parametrize("kind", [float, np.float32])
def test_a_combination_of_guesses_does_what_the_same_guess_does(motion, kind):
    """But without a product: the first guess is the change of the last step, whose displacements are known."""
    ends, force = [], -np.ones(motion.flexibility.of_patch.shape[1])
    for combined in (True, False):
        run = ZoneRun(motion).for_run(kind)
        pressed(run, 1e-4)
        run.back()
        run.move(np.zeros(motion.kinematics.rows.shape[1]))
        first = run.guess
        run.push()
        other = run.answer(force)
        run.push(other if combined else 0.3 * first + 0.7 * other)
        if combined:
            np.testing.assert_allclose(run.combine(np.array([0.3, 0.7])), 0.3 * first + 0.7 * other)
        found, at_patch = run.answer(1.01 * force), run.moved_patch
        assert np.linalg.norm(other - first) > 0.1 * np.linalg.norm(first) > 0
        assert run.finish()
        run.accept(run.after())
        ends.append((found, at_patch, run.generalised, [run.stored()], run.guess))
    for one, same in zip(*ends, strict=True):
        np.testing.assert_allclose(one, same, rtol=0, atol=(1e-9 if kind is float else 1e-5) * np.abs(same).max())


@pytest.mark.parametrize("share_of_body", [0.0, 0.8])
def test_work_done_on_the_zone_is_stored_or_taken_by_flow(motion, share_of_body):
    """By forces on the patch and by the body's own motion, loaded, unloaded and pulled, beyond flow both ways."""
    run, rows = ZoneRun(motion), motion.kinematics.rows
    force, shape = -np.ones(motion.flexibility.of_patch.shape[1]), np.zeros(rows.shape[1])
    shape[-1] = share_of_body
    force = force * at_first_flow(motion, motion.flexibility.of_patch @ force)
    if share_of_body:
        shape *= at_first_flow(motion, np.asarray(rows @ shape))
    done = before = 0.0
    last = run.moved_patch, run.generalised
    for share in np.r_[np.linspace(0, 2, 13), np.linspace(2, -2, 17)[1:], np.linspace(-2, 0, 5)[1:]]:
        step(run, share * force, 1e-11, share * shape)
        done += (share + before) / 2 * force @ (run.moved_patch - last[0])
        done -= (run.generalised + last[1]) / 2 @ ((share - before) * shape)
        before, last = share, (run.moved_patch, run.generalised)
        assert run.stored() + run.work == pytest.approx(done, rel=1e-6, abs=1e-8 * abs(done))
    assert run.work > 0
    p = motion.zone.pseudo_forces(run.state.plastic.strain)
    assert run.stored() == pytest.approx(
        motion.zone.own_energy(run.state.plastic) - p @ (motion.flexibility.own @ p) / 2
    )
    assert 0 < run.stored() < 0.2 * run.work


def test_the_bound_on_stress_is_that_of_first_flow_for_a_force_on_one_row(motion):
    """From a state below flow: with more force a look is needed, with less it is not."""
    run, rows = ZoneRun(motion), motion.flexibility.of_patch.shape[1]
    force = np.eye(rows)[rows // 2]
    force *= at_first_flow(motion, motion.flexibility.of_patch @ force)
    run.move(np.zeros(motion.kinematics.rows.shape[1]))
    assert not run.stays_elastic(0.6 * force)
    assert not run.look()
    assert run.stays_elastic(0.99 * force)
    assert not run.stays_elastic(1.01 * force)
    assert not run.stays_elastic(-1.01 * force)
