"""A law that takes energy, from the contributing page alone: that of Hunt and Crossley."""

from types import SimpleNamespace

import exudyn as exu
import numpy as np
import pytest
from exudyn.utilities import InertiaCuboid
from oracles import MARBLE_RADIUS as R
from oracles import contributed, inertial
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import exudyn_partition as ep
from exudyn_partition.contact.law import Forces
from exudyn_partition.contact.patch_contact import PatchContact
from exudyn_partition.contact.patch_gaps import PatchGaps
from exudyn_partition.errors import InputError, ModelLimitWarning, StoppedRunWarning

page = contributed("class HuntCrossley(Law)")
HuntCrossleys, HuntCrossley, K, C = (page[name] for name in ("HuntCrossleys", "HuntCrossley", "K", "C"))
bounce = contributed("def bounce(")["bounce"]
SPEED, STEP, GAP, END = 0.2, 0.2e-6, 1e-7, 160e-6
pytestmark = pytest.mark.filterwarnings("ignore::exudyn_partition.errors.YieldWarning")


def made_by(law):
    """A formulation whose law is of this class."""

    class Made(HuntCrossleys):
        def law(self, rows):
            return law()

    return Made()


class Undamped(HuntCrossley):
    """The spring alone."""

    def answer(self, places):
        depth = np.maximum(-places.gap, 0.0)
        lam, stored = K * depth**1.5, 0.4 * K * np.sum(depth**2.5)
        closed = np.flatnonzero(lam)
        slope = np.diag(1.5 * K * np.sqrt(depth[closed]))
        return Forces(lam[:, None], closed, stored=stored, stiffness=lambda: slope)


def drop(body, method="explicit", frame="inertial", formulation=None, speed=-SPEED, carrier=None, end=END, **how):
    """A ball that hits a plane, which may move."""
    mbs = exu.SystemContainer().AddSystem()
    place = {"referencePosition": [0, 0, R + GAP], "initialVelocity": [0, 0, speed]}
    item = ep.CreatePartitionBody(mbs, body, frame=frame, **place)
    options = {}
    if carrier is not None:
        kind = exu.NodeType.RotationRotationVector
        motion = {"initialVelocity": [0, 0, carrier], "nodeType": kind}
        options["masterBody"] = mbs.CreateRigidBody(inertia=InertiaCuboid(1e9, [1.0] * 3), **motion)
    chosen = formulation or HuntCrossleys()
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), slavePatch="south", formulation=chosen, **options)
    mbs.Assemble()
    return ep.solve_dynamic(mbs, end_time=end, method=method, **{"step": STEP, **how}), item, contact


def rebound(contact, item, result):
    """Speed after the impact of a rigid ball with the same rows [m/s]."""
    gap = contact.mechanics.gaps.for_run().at(item.coordinates(result)[0])

    def motion(t, state):
        depth = np.maximum(-(gap + state[0]), 0.0)
        return state[1], np.maximum(K * depth**1.5 * (1 - C * state[1]), 0.0).sum() / item.body.total_mass

    found = solve_ivp(motion, (0, END), (0.0, -SPEED), rtol=1e-8, atol=1e-12, max_step=1e-6)
    return found.y[1, -1]


def test_restitution_is_that_of_a_rigid_mass(marble):
    """Of any spring with this damping: m v dv = -F(d) (1 + C v) dd, so that only v / (1 + C v) is integrated."""
    restitution, error = bounce(marble, HuntCrossleys(), R + GAP, SPEED, END, step=STEP)
    approach = C * SPEED
    taken_up = approach - np.log1p(approach)
    given_back = lambda e: -approach * e - np.log1p(-approach * e)  # noqa: E731
    assert restitution == pytest.approx(brentq(lambda e: given_back(e) - taken_up, 0.0, 1.0), rel=5e-3)
    assert abs(error).max() < 2e-4


@pytest.mark.parametrize(("method", "frame"), [("explicit", "floating"), ("implicit", "inertial")])
def test_it_takes_what_the_ball_loses(marble, method, frame):
    result, item, contact = drop(marble, method, frame)
    taken, energy = contact.dissipated_energy(result), item.energy(result)
    assert contact.force(result)[-1] == 0.0
    assert taken[-1] > 0.1 * energy[0]
    assert (np.diff(taken) >= 0).all()
    whole = energy + contact.energy(result) + taken
    assert abs(whole / whole[0] - 1).max() < 2e-4
    assert item.momentum(result)[-1, 2] / item.body.total_mass == pytest.approx(
        rebound(contact, item, result), rel=1e-2
    )
    assert not any("lost" in said for said in result.warnings)


def test_newton_converges_as_without_damping(marble):
    """With a new Jacobian in each iteration; otherwise it matters at which rates the last one was found."""
    settings = exu.SimulationSettings()
    settings.timeIntegration.newton.useModifiedNewton = settings.solution.file.write = False
    options = {"method": "implicit", "step": 1e-6, "settings": settings}
    damped, *_ = drop(marble, **options)
    undamped, *_ = drop(marble, formulation=made_by(Undamped), **options)
    assert damped.work.newton_iterations <= 1.05 * undamped.work.newton_iterations


@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_rates_are_those_to_a_plane_that_moves(marble, method):
    """The ball falls on a plane at rest, or a heavy plane hits the ball at rest."""
    fixed, _, contact = drop(marble, method)
    moving, _, hit = drop(marble, method, speed=0.0, carrier=SPEED)
    force = contact.force(fixed)
    np.testing.assert_allclose(hit.force(moving), force, rtol=0, atol=1e-5 * force.max())
    taken = contact.dissipated_energy(fixed)
    np.testing.assert_allclose(hit.dissipated_energy(moving), taken, rtol=0, atol=1e-5 * taken[-1])


def test_results_from_a_file_have_what_it_took(marble, tmp_path):
    result, _, contact = drop(marble, end=60e-6)
    result.save(tmp_path / "run.npz")
    stored = ep.Result.load(tmp_path / "run.npz")
    (again,) = stored.contacts
    for name in ("energy", "dissipated_energy"):
        np.testing.assert_array_equal(getattr(again, name)(stored), getattr(contact, name)(result))
    nodal = contact.nodal_forces(result)[0].sum(axis=1)
    np.testing.assert_allclose(nodal[:, 2], contact.force(result), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("friction", [None, ep.Coulomb(0.3)])
def test_rates_are_those_of_gaps_and_ways(round_body, flat_body, friction):
    sides, asked = (inertial(round_body), inertial(flat_body)), []

    class Asking(HuntCrossley):
        def answer(self, places):
            asked.append((places.gap, places.way, places.rates))
            return Forces(
                np.zeros((len(places.gap), 1 + places.way.shape[1])), np.empty(0, int), slips=np.zeros_like(places.way)
            )

    contact, rng = PatchContact(PatchGaps(*sides), made_by(Asking), friction), np.random.default_rng(0)
    body = sides[0].kinematics.body
    start = np.r_[body.rigid[:, :3] @ [0, 0, -3e-6], np.zeros(sides[1].n)]
    q_t = np.r_[body.rigid[:, :3] @ [0.1, -0.2, 0.3], np.zeros(sides[1].n)] + 1e-3 * rng.standard_normal(len(start))
    dt = 1e-8
    for sign in (-1, 1):
        contact.at(start + sign * dt * q_t, SimpleNamespace(q_t=q_t))
    (gap, way, rates), (gap_after, way_after, _) = asked
    by_differences = np.column_stack([gap_after - gap, way_after - way]) / (2 * dt)
    np.testing.assert_allclose(rates, by_differences, rtol=0, atol=1e-4 * abs(rates).max())


def pressed(round_body, flat_body, formulation):
    """A contact, coordinates at which it is closed, and velocities with which it closes further."""
    sides = inertial(round_body), inertial(flat_body)
    at_rest, rigid = np.zeros(sides[1].n), sides[0].kinematics.body.rigid[:, 2]
    contact = PatchContact(PatchGaps(*sides), formulation)
    return contact, np.r_[-3e-6 * rigid, at_rest], np.r_[-0.3 * rigid, at_rest]


def test_stiffness_and_damping_are_slopes_of_the_force(round_body, flat_body):
    (contact, q, q_t), rng = pressed(round_body, flat_body, HuntCrossleys()), np.random.default_rng(0)
    force = lambda q, q_t: contact.at(q, SimpleNamespace(q_t=q_t)).generalised  # noqa: E731
    answer = contact.at(q, SimpleNamespace(q_t=q_t))
    H = answer.row_jacobian()
    tangent, damping = answer.tangent(), H.T @ answer.damping() @ H
    way = rng.standard_normal(len(q))
    way *= 1e-10 / abs(H @ way).max()
    slope = (force(q + way, q_t) - force(q - way, q_t)) / 2
    np.testing.assert_allclose(-tangent @ way, slope, rtol=0, atol=1e-3 * abs(slope).max())
    slope = (force(q, q_t + 1e6 * way) - force(q, q_t - 1e6 * way)) / 2
    np.testing.assert_allclose(-damping @ (1e6 * way), slope, rtol=0, atol=1e-6 * abs(slope).max())


def test_a_repeated_step_takes_energy_once(round_body, flat_body):
    """Power belongs to the states at both ends of a step; what was evaluated within the step leaves nothing behind."""
    contact, q, q_t = pressed(round_body, flat_body, HuntCrossleys())
    push = lambda share: contact.at(share * q, SimpleNamespace(q_t=share * q_t))  # noqa: E731
    power = []
    contact.accept(0.0)
    for end, share in ((1e-6, 1.0), (3e-6, 0.5)):
        for tried in (1.2, share):
            push(tried)
            contact.begin()
        power.append(push(share).forces.power)
        taken = contact.evaluation.law_work(end)
        contact.accept(end)
    right = 0.5e-6 * power[0] + 1e-6 * (power[0] + power[1])
    assert taken == contact.state.dissipated == pytest.approx(right, rel=1e-12)
    again = contact.for_run()
    again.begin(contact.state, 3e-6)
    assert again.evaluation.law_work(9.0) == contact.state.dissipated
    assert again.state.without_energies().dissipated == 0.0


def test_rates_are_zero_in_statics(round_body, flat_body):
    """Whatever the initial velocities of the bodies are."""
    contact, q, q_t = pressed(round_body, flat_body, HuntCrossleys())
    static = contact.for_run("static")
    force = static.at(q, SimpleNamespace(q_t=q_t)).generalised
    np.testing.assert_array_equal(force, static.at(q, SimpleNamespace(q_t=0 * q_t)).generalised)
    assert abs(force).max() < 0.9 * abs(contact.at(q, SimpleNamespace(q_t=q_t)).generalised).max()


def test_an_elastic_law_has_no_rates(round_body, flat_body):
    class Wrong(HuntCrossley):
        elastic = True

    contact, q, _ = pressed(round_body, flat_body, made_by(Wrong))
    with pytest.raises(InputError, match="law Wrong: it asks for rates, which only laws with elastic = False have"):
        contact.at(q)


def test_an_elastic_law_takes_no_energy(round_body, flat_body):
    class Wrong(Undamped):
        elastic = True

        def answer(self, places):
            return Forces(*super().answer(places)[:4], power=1.0)

    contact, q, _ = pressed(round_body, flat_body, made_by(Wrong))
    with pytest.raises(InputError, match="law Wrong: it takes energy, which only laws with elastic = False do"):
        contact.at(q)


def test_a_stiffness_of_all_rows_is_named(round_body, flat_body):
    class Wrong(HuntCrossley):
        def answer(self, places):
            n = len(places.gap)
            return Forces(*super().answer(places)[:6], stiffness=lambda: np.eye(n))

    contact, q, q_t = pressed(round_body, flat_body, made_by(Wrong))
    answer = contact.at(q, SimpleNamespace(q_t=q_t))
    n, rows = len(answer.index), len(contact.gaps.row_nodes)
    assert 0 < n < rows
    said = rf"law Wrong: expected a stiffness of shape \({n}, {n}\), of the closed rows alone, got \({rows}, {rows}\)"
    with pytest.raises(InputError, match=said):
        answer.tangent()


def test_a_loss_that_the_law_does_not_tell_names_the_law(marble):
    class Silent(HuntCrossley):
        def answer(self, places):
            whole = super().answer(places)
            return Forces(whole.on_rows, whole.closed, stored=whole.stored)

    said = "or of the law Silent: check that its stored energy and its power belong to its forces"
    with pytest.warns(ModelLimitWarning, match=said):
        drop(marble, formulation=made_by(Silent))


def test_an_error_in_a_law_is_told_with_its_line(marble):
    class Wrong(HuntCrossley):
        def answer(self, places):
            return places.nothing

    line = Wrong.answer.__code__.co_firstlineno + 1
    with pytest.warns(StoppedRunWarning, match=rf"no attribute 'nothing'.* \(test_own_damped.py, line {line}\)"):
        result, *_ = drop(marble, formulation=made_by(Wrong))
    assert result.status == "unstable"
