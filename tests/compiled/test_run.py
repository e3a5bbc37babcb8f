"""Runs of plans that have an answer by hand: a mass on a yielding wall, and one on a spring."""

import numpy as np
import pytest
import scipy.sparse as sp
from oracles import each_way

from exudyn_partition.compiled.adjoint import OneNumber, Sums, backwards
from exudyn_partition.compiled.made_run import MadeRun, Part
from exudyn_partition.compiled.plan import Bodies, FrozenPlan, StepPlan, joined_fields
from exudyn_partition.compiled.run import EqualSteps, run
from exudyn_partition.compiled.start import Start
from exudyn_partition.contact.linear_gaps import FlatRows, LinearGaps

M, F, SPEED = 2.0, 1e-4, 3.0  # [kg], flexibility of the wall [m/N], [m/s]
OMEGA = 1 / np.sqrt(M * F)

PART = Part(np.array([0]), np.array([[F]]))  # all of the flexibility


def wall(gap=0.0, reach=np.inf, **bodies):
    """A mass that moves towards a wall, with a row that slides as it moves."""
    rows = LinearGaps(np.array([[1.0]]), np.array([gap]), np.array([[1.0]]), np.zeros(1), reach)
    flat = FlatRows.of([rows], [np.array([[1.0, 0.0, 0.0]])], [np.array([0])])
    parts = {name: np.array([bodies.get(name, 0.0)]) for name in ("stiffness", "damping", "load")}
    contacts = FrozenPlan(("wall",), flat, (np.array([[F]]),), (np.zeros((1, 0)),), {})
    return StepPlan(Bodies(np.array([bodies.get("mass", M)]), **parts), contacts)


def thrown(plan, steps, speed=SPEED):
    return run(plan, Start(np.zeros(1), np.array([-speed])), steps)


def test_a_mass_that_bounces():
    """The wall is a spring, in contact for half a period."""
    steps = EqualSteps(np.pi / OMEGA / 400, 500)
    made = thrown(wall(), steps)
    force, t = made.values[:, 0, 0], steps.step * np.arange(501)
    np.testing.assert_allclose(force[:400], SPEED * np.sqrt(M / F) * np.sin(OMEGA * t[:400]), rtol=0, atol=0.1)
    assert not force[402:].any()
    assert made.end.v[0] == pytest.approx(SPEED, rel=1e-4)
    assert made.peaks.force[0] == force.max()
    assert made.peaks.lam[0] == force.max()
    np.testing.assert_array_equal(made.values[:, 0, 2], force)  # along the normal
    stored = made.stored[:, 0]
    np.testing.assert_allclose(stored, 0.5 * F * force**2, rtol=1e-12)
    np.testing.assert_allclose(stored + 0.5 * M * made.v[:, 0] ** 2, 0.5 * M * SPEED**2, rtol=1e-4)


def test_a_damped_oscillator_under_a_load():
    """Before it reaches the wall, which is far away. Damping is half a step late, and so of first order."""
    omega, ratio, load = 5.0, 0.05, 8.0
    plan = wall(gap=100.0, stiffness=M * omega**2, damping=2 * ratio * omega * M, load=load)
    rest, damped = load / (M * omega**2), omega * np.sqrt(1 - ratio**2)
    by_cos, by_sin = -rest, (-SPEED - ratio * omega * rest) / damped
    errors = []
    for step in (1e-3, 5e-4):
        made, t = thrown(plan, EqualSteps(step, round(2 / step))), step * np.arange(round(2 / step) + 1)
        swing = by_cos * np.cos(damped * t) + by_sin * np.sin(damped * t)
        errors.append(abs(made.q[:, 0] - rest - np.exp(-ratio * omega * t) * swing).max())
    assert errors[0] < 1e-3 * SPEED / omega
    assert errors[1] == pytest.approx(0.5 * errors[0], rel=0.05)


@pytest.mark.parametrize("between", [1, 7])
def test_samples_and_bits(between):
    """The same bits, however seldom samples are, and also where a run goes on from another one."""
    step = np.pi / OMEGA / 400
    whole = thrown(wall(), EqualSteps(step, 420))
    made = thrown(wall(), EqualSteps(step, 420, between))
    for name in ("q", "v", "values", "stored"):
        np.testing.assert_array_equal(getattr(made, name), getattr(whole, name)[::between])
    np.testing.assert_array_equal(made.lam.toarray(), whole.lam.toarray()[::between])
    first = thrown(wall(), EqualSteps(step, 150))
    later = run(wall(), first.end, EqualSteps(step, 270))
    np.testing.assert_array_equal(later.q, whole.q[150:])


def test_what_stops_a_run():
    sliding = thrown(wall(reach=0.01), EqualSteps(1e-4, 100))
    assert sliding.stopped.kind == "slides"
    assert "pairs of contact 'wall' begin to slide" in sliding.stopped.text
    assert sliding.made == len(sliding.q) - 1
    assert abs(sliding.end.q[0]) <= 0.01
    np.testing.assert_array_equal(sliding.end.q, sliding.q[-1])
    unstable = thrown(wall(gap=1.0, stiffness=M * 1e6), EqualSteps(3e-3, 10_000))  # omega h = 3
    assert unstable.stopped.kind == "unstable"
    assert 100 < unstable.made < 10_000
    assert np.isfinite(unstable.q).all()


def test_steps_by_numpy_are_the_same():
    compiled, plain = each_way(lambda: thrown(wall(load=-5.0), EqualSteps(np.pi / OMEGA / 100, 130)))
    for name in ("q", "v", "values"):
        np.testing.assert_allclose(getattr(plain, name), getattr(compiled, name), rtol=0, atol=1e-11 * SPEED / F)
    np.testing.assert_allclose(plain.peaks.force, compiled.peaks.force, rtol=1e-12)


def test_accelerations_of_all_samples():
    plan, steps = wall(load=7.0, stiffness=50.0, damping=30.0), EqualSteps(np.pi / OMEGA / 200, 250)
    made = thrown(plan, steps)
    found = made.a
    np.testing.assert_allclose(np.diff(made.v, axis=0), 0.5 * steps.step * (found[1:] + found[:-1]), rtol=0, atol=1e-12)
    np.testing.assert_allclose(found[-1], made.end.a, rtol=1e-12)


def test_derivatives_of_the_velocity_afterwards():
    """It is that before, whatever mass and wall are: the discrete steps keep to it nearly."""
    steps = EqualSteps(np.pi / OMEGA / 2000, 2100)
    plan = wall()
    made = thrown(plan, steps)
    weights = OneNumber(0 * made.lam, np.zeros_like(made.q), np.ones(1))
    found = backwards(MadeRun(plan, steps, made), weights, [PART])
    assert found.v.item() == pytest.approx(-1.0, abs=1e-3)
    assert abs(found.bodies.mass.item()) * M < 1e-2 * SPEED
    assert abs(found.flexibility.item()) < 1e-2 * SPEED


def test_derivatives_of_the_largest_force():
    """It is v sqrt(m / f)."""
    steps = EqualSteps(np.pi / OMEGA / 2000, 1100)
    plan = wall()
    made = thrown(plan, steps)
    lam = 0 * made.lam
    lam[int(made.values[:, 0, 0].argmax()), 0] = 1.0
    found = backwards(MadeRun(plan, steps, made), OneNumber(lam.tocsr(), np.zeros_like(made.q), np.zeros(1)), [PART])
    peak = SPEED * np.sqrt(M / F)
    assert -SPEED * found.v.item() == pytest.approx(peak, rel=1e-5)
    assert M * found.bodies.mass.item() == pytest.approx(0.5 * peak, rel=2e-3)
    assert found.flexibility.item() == pytest.approx(-0.5 * peak, rel=2e-3)


def test_fields_of_groups_that_exchange_nothing():
    one = [np.ones((3, 2)), np.ones((4, 2))], {(0, 1): np.full((2, 2), 5.0)}
    fields, core = joined_fields([([np.zeros((2, 0))], {}), one])
    assert [W.shape for W in fields] == [(2, 2), (3, 2), (4, 2)]
    assert [*core] == [(1, 2)]
    np.testing.assert_array_equal(core[1, 2], np.full((2, 2), 5.0))


def test_compiled_and_plain_adjoints_agree():
    """Of several sums at once, with closed and open rows."""
    plan, steps = wall(load=7.0, stiffness=50.0, damping=30.0), EqualSteps(np.pi / OMEGA / 200, 250)
    made = thrown(plan, steps)
    samples = np.random.default_rng(0).normal(size=(251, 3))
    weights = Sums(sp.csr_matrix(made.lam.shape), samples, np.full((251, 1), 0.3), np.ones((251, 1)))

    def found():
        of_sums = backwards(MadeRun(plan, steps, made), weights, [PART])
        return [of_sums.q, of_sums.v, *of_sums.bodies, of_sums.flexibility.T]

    for compiled, plain in zip(*each_way(found), strict=True):
        assert compiled.shape == (3, 1)
        np.testing.assert_allclose(compiled, plain, rtol=1e-11, atol=1e-12 * abs(plain).max())
