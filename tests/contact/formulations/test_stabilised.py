"""Multipliers in implicit runs: against explicit ones, no chatter, joints, rest, redundant rows."""

import re
from types import SimpleNamespace

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
import pytest
import scipy.sparse as sp
from oracles import TOP, box, hexahedra, multipliers, relative, write

import exudyn_partition as ep
from exudyn_partition.algebra.friction import SLIP, STICK
from exudyn_partition.contact.carrier import Carrier
from exudyn_partition.contact.formulations.implicit_multipliers import StepImpulses
from exudyn_partition.contact.gaps import GapState
from exudyn_partition.contact.patch_gaps import PatchGaps
from exudyn_partition.contact.side import Side
from exudyn_partition.contact.step_mean import TRAPEZOIDAL
from exudyn_partition.errors import ModelLimitWarning
from exudyn_partition.exudyn_contacts.model_run import runs_of
from exudyn_partition.frames.inertial import InertialKinematics

END = 40e-6


@pytest.fixture(scope="module", params=["free", "craig-bampton"])
def basis(request):
    return request.param


@pytest.fixture(scope="module")
def nodal(basis, pair_of):
    """Ball and block whose patches have mass."""
    return pair_of(basis)


def strike(nodal, assemble=True, frame="inertial"):
    """The ball about to hit the block at 1 m/s."""
    mbs = exu.SystemContainer().AddSystem()
    striker = ep.CreatePartitionBody(mbs, nodal[0], referencePosition=TOP, initialVelocity=[0, 0, -1.0], frame=frame)
    target = ep.CreatePartitionBody(mbs, nodal[1], frame=frame)
    contact = ep.CreatePartitionContact(mbs, striker, target, formulation="lagrange", name="tip")
    if assemble:
        mbs.Assemble()
    return mbs, striker, target, contact


def implicit(mbs, end_time=END, step=0.2e-6, **options):
    return ep.solve_dynamic(mbs, end_time=end_time, step=step, method="implicit", **options)


def roughness(force, window=5):
    """Largest ratio of a force to its mean over some samples, both of the middle half of the contact."""
    smooth = np.convolve(force, np.ones(window) / window, "same")
    closed = np.flatnonzero(force)
    quarter = (closed[-1] - closed[0]) // 4
    middle = slice(closed[0] + quarter, closed[-1] - quarter)
    return (force[middle] / smooth[middle]).max()


def test_against_explicit_multipliers_at_twenty_and_forty_times_the_step(pair_of):
    """Force, impulse and peak; energy falls by little, of second order in the step; momentum is exact."""
    mbs, striker, target, contact = strike(pair_of("craig-bampton", fine=True))
    explicit = ep.solve_dynamic(mbs, end_time=END, sample_period=0.4e-6)
    expected, impulse = contact.force(explicit), striker.momentum(explicit)[-1, 2] - striker.momentum(explicit)[0, 2]
    losses = []
    for step in (0.4e-6, 0.2e-6):
        result = implicit(mbs, step=step)
        force = contact.force(result)
        assert result.status == "finished"
        assert relative(np.interp(explicit.t, result.t, force), expected) < 0.02
        assert force.max() == pytest.approx(expected.max(), rel=5e-3)
        assert roughness(force) < 1.02
        change = [item.momentum(result)[-1] - item.momentum(result)[0] for item in (striker, target)]
        assert change[0][2] == pytest.approx(impulse, rel=2e-3)
        np.testing.assert_allclose(change[1], -change[0], atol=1e-9 * impulse)
        assert result.history(contact).impulse == pytest.approx(change[0][2], rel=1e-3)
        energy = (striker.energy(result) + target.energy(result)) / striker.energy(result)[0] - 1
        assert energy.max() < 5e-4
        losses.append(-energy[-1])
    assert 0 < losses[1] < 0.5 * losses[0] < 2e-3
    assert not contact.gap(result)[contact.closed_rows(result) > 0].any()


def test_floating_frames_as_inertial_ones(pair_of):
    """Pairs of floating bodies are followed; nothing turns, so that the forces are the same."""
    nodal = pair_of("craig-bampton")
    forces = []
    for frame in ("inertial", "floating"):
        mbs, striker, target, contact = strike(nodal, frame=frame)
        result = implicit(mbs, end_time=0.3 * END, step=0.4e-6)
        forces.append(contact.force(result))
        momentum = striker.momentum(result) + target.momentum(result)
        np.testing.assert_allclose(momentum, momentum[:1] + 0 * momentum, atol=1e-9 * abs(momentum).max())
    assert forces[0].max() > 100
    assert relative(*forces) < 1e-3


@pytest.fixture(scope="module")
def bars(tmp_path_factory):
    """Two bars of hexahedra, 2 x 2 x 10, the second one upwards from the first."""
    material = ep.Material(E=1.0, nu=0.0, rho=1.0)
    points, cells = hexahedra(3, 3, 18)
    points = points / [0.01, 0.02, 0.03] * [2, 2, 10]
    fem = ep.fe_model(write(tmp_path_factory.mktemp("bars") / "bar.vtu", points, cells), material)
    ends = [ep.Partition.ball(fem, (0, 0, z), 2.0) for z in (10.0, 0.0)]
    return [ep.reduce(fem, end, basis="free", f_cut=0.2) for end in ends]


@pytest.mark.parametrize(("method", "step"), [
    ("implicit", 0.05), ("implicit", 0.1), ("implicit", 0.2), ("explicit", 0.05),
])  # fmt: skip
def test_two_bars_flat_on_flat(mbs, bars, method, step):
    """Saint-Venant: 0.4 for 20 units of time, velocities swap but for what coarse nodes carry when they meet."""
    lower = ep.CreatePartitionBody(mbs, bars[0], initialVelocity=[0, 0, 0.1])
    upper = ep.CreatePartitionBody(mbs, bars[1], referencePosition=[0, 0, 10], initialVelocity=[0, 0, -0.1])
    contact = ep.CreatePartitionContact(mbs, lower, upper, formulation="lagrange")
    mbs.Assemble()
    lost, ringing = "have lost .* nodes with mass lose when multipliers stop", "the force rings near or above f_cut"
    with pytest.warns(ModelLimitWarning, match=f"{lost}|{ringing}") as said:
        result = ep.solve_dynamic(mbs, end_time=26.0, step=step, method=method)
    rings = method == "implicit"  # explicit forces jump between steps, and tell nothing of it
    told = [sum(bool(re.search(what, str(w.message))) for w in said) for what in (lost, ringing)]
    assert told == [1, int(rings)]
    assert (contact.ringing(result) is not None) == rings
    force = contact.force(result)
    assert force[(result.t > 2) & (result.t < 17)].mean() == pytest.approx(0.4, rel=0.01)
    assert roughness(force, window=round(1 / step) | 1) < 1.1
    assert contact.impacts(result)[-1].end == pytest.approx(20, rel=0.05)
    for item, v in ((lower, -0.1), (upper, 0.1)):
        assert item.momentum(result)[-1, 2] / item.body.total_mass == pytest.approx(v, rel=0.06)
    energy = (lower.energy(result) + upper.energy(result)) / 0.4 - 1
    assert -0.06 < energy[-1] < 0
    assert energy.max() < 0.02


def test_a_joint_in_the_model(nodal, basis):
    """A mass hangs on the block's lower face by three constraints: momentum of all three is constant."""
    mbs, striker, target, contact = strike(nodal, assemble=False)
    body = target.body
    row = body.rows(np.array([body.nearest_node((0, 0, 0))]))
    row = row if isinstance(row, np.ndarray) else row.toarray()
    assert not row[:, body.n_shapes :].any()
    node = mbs.AddNode(items.NodePoint())
    mbs.AddObject(items.MassPoint(mass=0.02, nodeNumber=node))
    markers = [mbs.AddMarker(items.MarkerNodeCoordinates(nodeNumber=n)) for n in (node, target["nModal"])]
    joint = items.ObjectConnectorCoordinateVector(
        markerNumbers=markers, scalingMarker0=np.eye(3), scalingMarker1=row[:, : body.n_shapes]
    )
    mbs.AddObject(joint)
    mass = mbs.AddSensor(
        items.SensorNode(nodeNumber=node, outputVariableType=exu.OutputVariableType.Velocity, storeInternal=True)
    )
    mbs.Assemble()
    forces = []
    for step in (0.4e-6, 0.2e-6):
        result = implicit(mbs, end_time=20e-6, step=step)
        forces.append(contact.force(result))
        momentum = striker.momentum(result) + target.momentum(result) + 0.02 * result.sensor(mass)
        np.testing.assert_allclose(momentum - momentum[0], 0, atol=1e-9 * abs(momentum[0, 2]))
        velocity = target.velocity(result, (0, 0, 0))
        np.testing.assert_allclose(result.sensor(mass), velocity, atol=1e-6 * abs(velocity).max())
        energy = striker.energy(result) + target.energy(result) + 0.01 * (result.sensor(mass) ** 2).sum(axis=1)
        assert energy[-1] == pytest.approx(energy[0], rel=5e-3)
    assert relative(forces[1][::2], forces[0]) < 0.02
    assert abs(result.sensor(mass)[-1, 2]) > 0.02


@pytest.mark.parametrize(("basis", "damping"), [("free", 2e5), ("craig-bampton", 0.0)], indirect=["basis"])
def test_rest_on_a_plane(mbs, basis, damping):
    """A bar put down under its weight rings, gains next to nothing, and with damping comes to rest at its weight."""
    fem = ep.fe_model(box(0.010, 0.008, 0.030), ep.STEEL, maxh=5e-3)
    bar = ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 8e-3), basis=basis, f_cut=150e3)
    item = ep.CreatePartitionBody(mbs, bar)
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), formulation="lagrange")
    g = 1e4
    weight = g * bar.total_mass
    mbs.AddObject(
        items.ObjectGenericODE2(
            nodeNumbers=item.nodes,
            dampingMatrix=exu.MatrixContainer(sp.csr_matrix(damping * bar.mass)),
            forceVector=-g * (bar.mass @ bar.rigid[:, 2]),
            visualization=items.VObjectGenericODE2(show=False),
        )
    )
    mbs.Assemble()
    result = implicit(mbs, end_time=240e-6, step=0.4e-6)
    force, height = contact.force(result), item.rigid_motion(item.coordinates(result))[:, 2]
    elastic = item.energy(result)
    assert (elastic + weight * height).max() < 0.01 * elastic.max()
    assert force.mean() == pytest.approx(weight, rel=0.03)
    assert force.max() < 2.2 * weight
    assert contact.closed_rows(result)[10:].min() > 3
    if damping:
        np.testing.assert_allclose(force[-50:], weight, rtol=1e-3)
        assert abs(item.momentum(result)[-50:, 2]).max() < 1e-3 * abs(item.momentum(result)[:, 2]).max()
        law = runs_of(mbs).at_work(contact).mechanics
        gaps = law.gaps.at(item.coordinates(result)[-1])
        assert abs(gaps[law.evaluation.index]).max() < 1e-4 * abs(height[-1])


def test_plain_solve_dynamic_and_both_solvers_in_turn(nodal):
    mbs, *_, contact = strike(nodal)
    first = contact.force(implicit(mbs, end_time=4e-6, step=0.1e-6))
    explicit = contact.force(ep.solve_dynamic(mbs, end_time=4e-6, sample_period=0.1e-6))
    assert explicit[-1] == pytest.approx(first[-1], rel=0.05)
    settings = exu.SimulationSettings()
    settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = 4e-6, 40
    settings.timeIntegration.generalizedAlpha.spectralRadius = 0.9
    settings.timeIntegration.verboseMode, settings.solution.file.write = 0, False
    settings.solution.sensors.writePeriod = 0.1e-6
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.GeneralizedAlpha)
    np.testing.assert_allclose(contact.force(ep.collect(mbs)), first, rtol=1e-9)


@pytest.fixture
def gaps(nodal):
    """Gaps of ball and block."""
    sides = [Side.of(InertialKinematics(body, np.array(p))) for body, p in zip(nodal, (TOP, (0, 0, 0)), strict=True)]
    return PatchGaps(*sides, "node-to-segment")


def motion(q, q_t, step):
    """Motion at the end of a step of the trapezoidal rule."""
    return SimpleNamespace(q=q, q_t=q_t, step=step, weights=TRAPEZOIDAL)


@pytest.mark.parametrize("friction", [None, 0.3])
def test_the_second_iteration_of_newtons_method_is_the_last(gaps, nodal, friction):
    """Wherever the first one starts, the forces are those of all rows and coordinates of the step at once."""
    law = multipliers(gaps, friction and ep.Coulomb(friction))
    impulses = StepImpulses(law)
    step, n = 2e-7, gaps.n
    M, K = (sp.block_diag([getattr(body, name) for body in nodal], format="csc") for name in ("mass", "stiffness"))
    factors = sp.linalg.splu(sp.csc_matrix(TRAPEZOIDAL.by_q_tt(step) * M + K))
    rigid = np.concatenate([nodal[0].rigid[:, 2], np.zeros(nodal[1].n_dofs)])
    start, start_t = (
        -8e-6 * rigid,
        -2.0 * rigid + 0.5 * np.concatenate([nodal[0].rigid[:, 0], np.zeros(len(nodal[1].rigid))]),
    )

    def state(force):
        way = factors.solve(force)
        return start + way, start_t + TRAPEZOIDAL.by_q_t(step) * way

    answer = impulses.at(impulses.begin(), motion(*state(np.random.default_rng(0).standard_normal(n)), step))
    forces = [answer.force]
    for _ in range(3):
        answer = impulses.at(answer, motion(*state(forces[-1]), step))
        forces.append(answer.force)
    index, on_rows = answer.forces.closed, answer.forces.on_rows
    assert index.size > 3
    assert relative(forces[1], forces[2]) < 1e-7
    q, q_t = state(forces[-1])
    gap = gaps.at(gaps.sides.moved(q, 0.5 * step * q_t))
    assert abs(gap[index]).max() < 1e-9 * 1e-6
    assert gap.min() > -1e-15
    assert on_rows[:, 0].min() >= 0
    if friction is not None:
        rates = law.rows.rates(q_t)[:, 1:]
        assert abs(rates[answer.forces.state == STICK]).max(initial=0.0) < 1e-9
        slips = answer.forces.state == SLIP
        along, normal = on_rows[slips, 1:], on_rows[slips, 0]
        np.testing.assert_allclose(np.linalg.norm(along, axis=1), friction * normal, rtol=1e-6)
        np.testing.assert_allclose(
            (along * rates[slips]).sum(axis=1), -friction * normal * np.linalg.norm(rates[slips], axis=1)
        )


@pytest.mark.parametrize("share", [0.1, 3.0])
def test_rows_that_move_otherwise_than_free_bodies_are_learned(nodal, gaps, share):
    """A joint or another contact stiffens a body, a carrier yields: the iteration still ends."""
    law, step = multipliers(gaps), 2e-7
    impulses = StepImpulses(law)
    M, K = (sp.block_diag([getattr(body, name) for body in nodal], format="csc") for name in ("mass", "stiffness"))
    factors = sp.linalg.splu(sp.csc_matrix(TRAPEZOIDAL.by_q_tt(step) * M + K))
    rigid = np.concatenate([nodal[0].rigid[:, 2], np.zeros(nodal[1].n_dofs)])
    answer, sums = impulses.begin(), []
    for _ in range(15):
        way = share * factors.solve(answer.force)
        at_end = motion(-8e-6 * rigid + way, -2.0 * rigid + TRAPEZOIDAL.by_q_t(step) * way, step)
        answer = impulses.at(answer, at_end)
        sums.append(answer.forces.on_rows[:, 0].sum())
    assert sums[-1] > 0
    assert abs(sums[-1] - sums[-2]) < 1e-8 * sums[-1]


class FlatSides(tuple):
    """One side whose places are linear in its coordinates."""

    def moved(self, q, way):
        return q + way

    def way(self, q, end):
        return end - q

    def rigid_part(self, q_t):
        return q_t


class FlatRows(SimpleNamespace):
    """Gaps of a plate of two coordinates, heave and tilt, on forty rows: all but two are redundant."""

    carried, carrier = False, Carrier()

    def begin(self, state=None):
        self.accepted = self.after()

    def after(self):
        return GapState(np.zeros(2), np.empty(0))

    def return_to(self, present):
        """The rows are never elsewhere."""

    def accept(self, state):
        self.accepted = state

    def exchange_flexibility(self, flexibility):
        """Its own is that of `mass` and `step`."""

    def at(self, q):
        return self.H @ q

    def jacobian(self, index):
        return self.H[index]

    def flexibility(self, index):
        met = np.linalg.inv(4 / self.step**2 * np.diag(self.mass))
        return self.H[index] @ met @ self.H[index].T


def flat_rows():
    x = np.linspace(-1, 1, 40)
    surface = SimpleNamespace(points=np.zeros((40, 3)))
    body = SimpleNamespace(
        mass=sp.diags([2.0, 0.5], format="csr"), stiffness=sp.csr_matrix((2, 2)), rows=lambda nodes: np.zeros((120, 2))
    )
    kinematics = SimpleNamespace(body=body, nodes=np.arange(40))
    side, H = Side(surface, kinematics), np.column_stack([np.ones(40), x])
    stage = SimpleNamespace(
        rows=None, normal=np.tile([0.0, 0.0, 1.0], (40, 1)), acted=lambda lam, q: (lam @ H, np.zeros(3)),
        resultant=lambda lam: np.array([0.0, 0.0, lam.sum()]),
    )  # fmt: skip
    return FlatRows(
        H=H, stage=stage, present=SimpleNamespace(stage=stage, q=None), n=2,
        row_nodes=np.arange(40), slave=side, sides=FlatSides((side,)),
        moving=False, mass=np.array([2.0, 0.5]), step=1e-3, size=1.0,
    )  # fmt: skip


def flat_multipliers():
    law = multipliers(flat_rows())
    law.rows.flexibility = law.gaps.flexibility
    return law


def test_redundant_rows_have_a_unique_total_force():
    """As test_contact's of explicit steps: 0.3 m/s towards the ground, which the plate of 2 kg touches."""
    law = flat_multipliers()
    impulses = StepImpulses(law)
    answer = impulses.at(impulses.begin(), motion(np.zeros(2), np.array([-0.3, 0.0]), 1e-3))
    total = answer.forces.on_rows[:, 0].sum()
    # With p, v = -0.3 + s p / m and g = s^2 p / 2 m; then g + s v / 2 = 0. The trapezoidal rule halves a first force.
    assert total == pytest.approx(0.15 * 2.0 / 1e-3, rel=1e-8)
    assert answer.force[0] == pytest.approx(2 * total, rel=1e-8)


def test_steady_forces_bend_nothing():
    """A plate that stands still after it was pressed keeps the force that it had."""
    law = flat_multipliers()
    impulses, sums = StepImpulses(law), []
    answer = impulses.begin()
    for height in (-1e-6, 0.0, 0.0):
        answer = impulses.at(impulses.accept(answer), motion(np.array([height, 0.0]), np.zeros(2), 1e-3))
        sums.append(answer.forces.on_rows[:, 0].sum())
    assert sums[0] > 0
    np.testing.assert_allclose(sums, sums[0], rtol=1e-9)


def test_a_sliding_tip(nodal):
    """Pairs follow: the explicit run's force, and constant momentum."""
    forces = []
    for method, step in (("explicit", None), ("implicit", 5e-8)):
        mbs = exu.SystemContainer().AddSystem()
        tip = ep.CreatePartitionBody(mbs, nodal[0], referencePosition=TOP, initialVelocity=[300.0, 0, -1.0])
        target = ep.CreatePartitionBody(mbs, nodal[1])
        contact = ep.CreatePartitionContact(mbs, tip, target, formulation="lagrange")
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=1.5e-6, step=step, method=method, sample_period=5e-8)
        assert runs_of(mbs).at_work(contact).mechanics.gaps.moving
        momentum = tip.momentum(result) + target.momentum(result)
        np.testing.assert_allclose(momentum - momentum[0], 0, atol=1e-9 * abs(momentum[0]).max())
        forces.append(np.interp(np.linspace(0, 1.5e-6, 16), result.t, contact.force(result)))
    assert relative(*forces) < 0.1


def test_each_step_has_its_own_flexibility(pair_of):
    """Adaptive steps used to keep the flexibility of the first step, as long as pairs were frozen."""
    nodal = pair_of("craig-bampton", fine=True)
    sides = [Side.of(InertialKinematics(body, np.array(at))) for body, at in zip(nodal, (TOP, (0, 0, 0)), strict=True)]
    laws = [multipliers(PatchGaps(*sides)) for _ in range(2)]
    impulses, other = map(StepImpulses, laws)
    q = np.concatenate([-1e-6 * nodal[0].rigid[:, 2], np.zeros(nodal[1].n_dofs)])
    answer = impulses.at(impulses.begin(), motion(q, np.zeros_like(q), 0.2e-6))
    everything = np.arange(len(laws[0].rows.gaps.row_nodes))
    first = laws[0].rows.flexibility(everything).copy()
    impulses.at(answer, motion(q, np.zeros_like(q), 0.4e-6))
    other.at(other.begin(), motion(q, np.zeros_like(q), 0.4e-6))
    now, expected = (law.rows.flexibility(everything) for law in laws)
    np.testing.assert_allclose(now, expected, rtol=1e-12)
    assert relative(first, expected) > 0.3
