"""Damping: decay of modes, rigid motion that is free of it, energy, stability of explicit steps, wrong input."""

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest

import exudyn_partition as ep
from exudyn_partition.errors import InputError
from exudyn_partition.frames.damping import damping_of
from exudyn_partition.frames.floating import FloatingKinematics
from exudyn_partition.frames.inertial import InertialKinematics

RATIO = 0.02
FRAMES = ("inertial", "floating")


@pytest.fixture(scope="module")
def bar():
    """A steel bar of 200 x 10 x 12 mm in elastic modes, and in the paper's basis with kept nodes."""
    shape = occ.Box((0, 0, 0), (0.2, 0.01, 0.012))
    fem = ep.fe_model(shape, ep.STEEL, maxh=12e-3)
    end = ep.Partition.ball(fem, (0.2, 0.005, 0.006), 3e-3)
    return ep.reduce(fem, end, basis="residual", f_cut=20e3), ep.reduce(fem, end, basis="free", f_cut=10e3)


def kinematics_of(body, frame):
    if frame == "inertial":
        return InertialKinematics(body, np.zeros(3))
    return FloatingKinematics(body, np.zeros(3), np.zeros(3))


def vibrating(body, frame, damping, shape=None):
    """Model of a body whose elastic modes, or the one with a number, move at the start."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, frame=frame, damping=damping, initialVelocity=[1.0, 0, 0])
    node = mbs.GetNode(item["nModal"])
    velocities = np.array(node["initialCoordinates_t"])
    velocities[slice(-len(body.basis.omega[6:]), None) if shape is None else shape - len(body.basis.omega[6:])] = 0.01
    mbs.SetNodeParameter(item["nModal"], "initialCoordinates_t", list(velocities))
    mbs.Assemble()
    return mbs, item


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_a_mode_decays_by_its_ratio(bar, frame, method):
    body, _ = bar
    omega = body.basis.omega[6]
    mbs, item = vibrating(body, frame, RATIO, shape=0)
    step = 2 * np.pi / omega / 600
    result = ep.solve_dynamic(mbs, end_time=6000 * step, step=step, method=method)
    q_t = item.coordinates_t(result)[:, 6]
    damped = omega * np.sqrt(1 - RATIO**2)
    decay = np.exp(-RATIO * omega * result.t)
    expected = 0.01 * decay * (np.cos(damped * result.t) - RATIO * omega / damped * np.sin(damped * result.t))
    assert abs(q_t - expected).max() < 0.01 * 0.01
    assert np.allclose(item.momentum(result), item.momentum(result)[0], rtol=1e-9)


@pytest.mark.parametrize(
    "damping", [RATIO, np.full(5, RATIO), lambda f: 1e-5 * f, ep.Rayleigh(50.0, 1e-7)], ids=["one", "each", "of f", "D"]
)
@pytest.mark.parametrize("frame", FRAMES)
def test_energy_and_what_damping_took_are_constant(bar, frame, damping):
    body, _ = bar
    if isinstance(damping, np.ndarray):
        damping = np.full(body.n_dofs - 6, RATIO)
    mbs, item = vibrating(body, frame, damping)
    result = ep.solve_dynamic(mbs, end_time=300e-6, step=0.2e-6)
    lost = item.energy(result)[0] - item.energy(result)[-1]
    vibration = item.energy(result)[0] - item.body.total_mass / 2
    assert lost > 0.05 * vibration
    assert item.dissipated_energy(result)[-1] == pytest.approx(lost, rel=5e-3)


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_kept_nodes_take_rayleigh_damping(bar, frame, method):
    _, body = bar
    mbs, item = vibrating(body, frame, ep.Rayleigh(3e3, 2e-7))
    result = ep.solve_dynamic(mbs, end_time=15e-6, step=0.01e-6, method=method)
    lost = item.energy(result)[0] - item.energy(result)[-1]
    assert item.dissipated_energy(result)[-1] == pytest.approx(lost, rel=0.01)
    assert lost > 0.05 * (item.energy(result)[0] - item.body.total_mass / 2)
    assert np.allclose(item.momentum(result), item.momentum(result)[0], rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("keeps_nodes", [False, True])
def test_rigid_motion_is_not_damped(bar, frame, keeps_nodes):
    body = bar[keeps_nodes]
    kinematics = kinematics_of(body, frame)
    damping = damping_of(kinematics, ep.Rayleigh(1e3, 1e-6))
    rigid = body.rigid.T if frame == "inertial" else np.eye(body.n_dofs)[:6]
    any_motion = np.random.default_rng(0).normal(size=(3, body.n_dofs))
    assert abs(damping.force(rigid)).max() < 1e-6 * abs(damping.force(any_motion)).max()
    assert (np.sum(any_motion * damping.force(any_motion), axis=1) > 0).all()
    # The same for a history and one sample at a time, and what the matrix gives where no rigid motion takes part.
    assert np.allclose(damping.force(any_motion), [damping.force(q_t) for q_t in any_motion])
    if frame == "inertial":
        any_motion = kinematics.deformed(any_motion)
    assert np.allclose(damping.force(any_motion), (damping.matrix() @ any_motion.T).T, atol=1e-6)


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize(("alpha", "beta"), [(4e4, 0.0), (4e4, 1e-9)])
def test_the_largest_rate_of_kept_nodes_is_that_of_their_fastest_motion(bar, frame, alpha, beta):
    kinematics = kinematics_of(bar[1], frame)
    root = np.sqrt(kinematics.mass)
    damping = damping_of(kinematics, ep.Rayleigh(alpha, beta))
    fastest = np.sqrt(
        np.linalg.eigvalsh(bar[1].stiffness.toarray() / np.outer(*2 * [np.sqrt(bar[1].mass.diagonal())]))[-1]
    )
    rates = np.linalg.eigvalsh(damping.matrix().toarray() / np.outer(root, root))
    assert damping.largest_rate(fastest) == pytest.approx(rates[-1], rel=1e-6)


@pytest.mark.filterwarnings("ignore:damping. a ratio of 2, above 1")
@pytest.mark.parametrize("ratio", [0.0, 0.1, 2.0])
def test_explicit_steps_are_stable_up_to_the_limit_and_not_beyond(bar, ratio):
    body, _ = bar
    limit = ep.stability_limit(vibrating(body, "inertial", ratio)[0])
    largest = []
    for share in (0.995, 1.01):
        mbs, _ = vibrating(body, "inertial", ratio)
        settings = exu.SimulationSettings()
        settings.timeIntegration.numberOfSteps, settings.timeIntegration.endTime = 3000, 3000 * share * limit
        settings.timeIntegration.verboseMode, settings.solution.file.write = 0, False
        mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.VelocityVerlet)
        largest.append(abs(np.array(mbs.systemData.GetODE2Coordinates_t())[6:]).max())
    assert largest[0] < 0.05
    assert not largest[1] < 10


@pytest.mark.parametrize(
    ("damping", "said"),
    [(-0.01, "zero or above"), (float("nan"), "ratio"), ("much", "ratio"), ([0.01, 0.02], "shape"),
     (lambda f: f[:1], "shape"), (lambda f: -f, "zero or above"),
     (lambda f: {}["much"], "frequencies.*raises KeyError: 'much'"), (lambda f: f * np.nan, "finite")],
)  # fmt: skip
@pytest.mark.parametrize("frame", FRAMES)
def test_wrong_damping_is_refused(bar, frame, damping, said):
    with pytest.raises(InputError, match=rf"damping: .*{said}"):
        damping_of(kinematics_of(bar[0], frame), damping)


@pytest.mark.parametrize("factor", [-1.0, float("inf"), None])
def test_wrong_factors_are_refused(factor):
    with pytest.raises(InputError, match="beta: expected a finite number, zero or above"):
        ep.Rayleigh(0.0, factor)


def test_kept_nodes_have_no_ratio(bar):
    with pytest.raises(InputError, match=r"keeps nodes.*ep\.Rayleigh"):
        damping_of(kinematics_of(bar[1], "inertial"), 0.01)


def test_a_body_without_damping_says_so(bar):
    item = vibrating(bar[0], "inertial", None)[1]
    assert any("damping" in sentence for sentence in item.left_out)
    assert not any("damping" in sentence for sentence in vibrating(bar[0], "inertial", 0.01)[1].left_out)
