"""Natural modes at a preload: springs and flexibility by hand, differences of forces, joints, and what is refused."""

import warnings

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
import pytest
import scipy.linalg
from oracles import add_loads, add_springs

import exudyn_partition as ep
from exudyn_partition.errors import ModelLimitWarning, RunError

FORCE = 50.0


def pressed(mbs, round_body, friction=0.5):
    """A ball that springs hold, with loads that press it on a plane and aside: some rows will slip and others stick."""
    item = ep.CreatePartitionBody(mbs, round_body, name="ball")
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), name="floor", friction=friction)
    K = add_springs(mbs, item, np.diag([1e5, 1e7, 1e5, 1e3, 1e3, 1e3]))
    for axis, force in ((2, 10 * FORCE), (0, 4 * friction * FORCE)):
        load = np.asarray(item.body.mass @ item.body.rigid)[:, axis] * -force / item.body.total_mass
        add_loads(mbs, item, load)
    mbs.Assemble()
    return item, contact, K


@pytest.fixture
def held(mbs, round_body, request):
    """The ball after a preload, and its result."""
    item, contact, K = pressed(mbs, round_body, getattr(request, "param", 0.5))
    result = ep.solve_static(mbs, load_steps=2, update_initial=True)
    assert 0 < contact.friction.stuck_rows(result)[-1] < np.count_nonzero(contact.friction.states(result)[-1])
    return item, contact, K, result


def frequencies(K, item):
    squares = scipy.linalg.eigh((K + K.T) / 2, item.body.mass.toarray(), eigvals_only=True)
    return np.sign(squares) * np.sqrt(abs(squares)) / (2 * np.pi)


@pytest.mark.parametrize("held", [0.5, 0.02], indirect=True)
def test_closed_rows_stick(mbs, held):
    """Stiffness by hand: springs and modes, and the inverse of the flexibility of all closed rows."""
    item, contact, K, result = held
    rows = contact.mechanics.for_run("static").rows
    rows.gaps.at(item.coordinates(result)[-1])
    closed = np.flatnonzero(np.isin(rows.gaps.row_nodes, np.flatnonzero(contact.friction.states(result)[-1])))
    H, F = rows.jacobian(closed), rows.flexibility(closed)
    H = H.toarray() if hasattr(H, "toarray") else H
    right = frequencies(item.body.stiffness.toarray() + K + H.T @ np.linalg.solve(F, H), item)
    found, modes = ep.natural_modes(mbs)
    np.testing.assert_allclose(found, right, rtol=1e-5)
    np.testing.assert_allclose(modes.T @ item.body.mass @ modes, np.eye(len(found)), atol=1e-8)
    assert (ep.natural_modes(mbs, slipping=True)[0] / right).min() < 0.99


def test_exudyn_reads_half_of_what_slips_and_says_so(mbs, held):
    """The symmetric part of the whole stiffness has the modes of `slipping`; one triangle has not."""
    with pytest.warns(ModelLimitWarning, match="contact 'floor': rows slip, so that the stiffness is not symmetric"):
        [M, K, _] = mbs.ComputeLinearizedSystem()
    squares = scipy.linalg.eigh((K + K.T) / 2, M, eigvals_only=True)
    found, _ = ep.natural_modes(mbs, slipping=True)
    np.testing.assert_allclose(found, np.sqrt(squares) / (2 * np.pi), rtol=1e-6)
    ep.natural_modes(mbs)
    np.testing.assert_allclose(ep.natural_modes(mbs, slipping=True)[0], found, rtol=1e-6)


def test_exudyn_says_so_after_its_own_solver_too(mbs, round_body):
    """The stiffness within a run warns of nothing; the one after it does, until another run begins."""
    pressed(mbs, round_body)
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.staticSolver.numberOfLoadSteps = settings.timeIntegration.numberOfSteps = 2
    settings.timeIntegration.endTime = 1e-6
    for _ in range(2):
        with warnings.catch_warnings():
            warnings.simplefilter("error", ModelLimitWarning)
            mbs.SolveDynamic(settings)
            mbs.SolveStatic(settings, updateInitialValues=True)
        with pytest.warns(ModelLimitWarning, match="contact 'floor': rows slip"):
            mbs.ComputeODE2Eigenvalues()


def test_masses_on_a_joint(mbs):
    """A mass on a spring, another on a stiffer one; a joint makes both move as one."""
    ground = mbs.CreateGround()
    masses = [mbs.CreateMassPoint(referencePosition=[0, 0, z], mass=m) for z, m in ((0, 2.0), (1, 3.0))]
    for mass, k in zip(masses, (1e4, 5e4), strict=True):
        mbs.CreateCartesianSpringDamper(itemNumbers=[ground, mass], stiffness=[k] * 3, localPosition0=[0, 0, 0])
    one, other = (
        mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=mbs.GetObject(mass)["nodeNumber"], coordinate=0))
        for mass in masses
    )
    mbs.AddObject(items.CoordinateConstraint(markerNumbers=[one, other]))
    mbs.Assemble()
    found, modes = ep.natural_modes(mbs)
    assert "staticSolver" not in mbs.sys  # no run was made
    right = np.sort(np.sqrt([1e4 / 2, 1e4 / 2, 5e4 / 3, 5e4 / 3, 6e4 / 5])) / (2 * np.pi)
    np.testing.assert_allclose(found, right, rtol=1e-9)
    np.testing.assert_allclose(modes[0], modes[3], atol=1e-12)
    np.testing.assert_allclose(modes.T @ np.diag([2.0] * 3 + [3.0] * 3) @ modes, np.eye(5), atol=1e-12)


def test_an_unstable_motion_has_a_negative_frequency(mbs):
    """A mass on springs, one of which pushes it away."""
    mass = mbs.CreateMassPoint(physicsMass=2.0)
    mbs.CreateCartesianSpringDamper(itemNumbers=[mbs.CreateGround(), mass], stiffness=[1e4, -3e4, 2e4])
    mbs.Assemble()
    found, modes = ep.natural_modes(mbs)
    np.testing.assert_allclose(found, [-np.sqrt(3e4 / 2) / (2 * np.pi), *np.sqrt([1e4 / 2, 2e4 / 2]) / (2 * np.pi)])
    np.testing.assert_allclose(abs(modes), np.eye(3)[:, [1, 0, 2]] / np.sqrt(2.0), atol=1e-12)


def test_what_has_no_modes_is_refused(mbs, bodies, pair_of):
    with pytest.raises(RunError, match="not assembled"):
        ep.natural_modes(mbs)
    item = ep.CreatePartitionBody(mbs, pair_of("craig-bampton")[0])
    ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), formulation="lagrange", name="floor")
    mbs.Assemble()
    with pytest.raises(RunError, match="contact 'floor': multipliers have no stiffness"):
        ep.natural_modes(mbs)
    other = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(other, bodies[0])
    ep.CreatePartitionContact(other, item, ep.RigidPlane())
    other.Assemble()
    with pytest.raises(RunError, match="slipping: which rows slip is known only after solve_static"):
        ep.natural_modes(other, slipping=True)


def test_rows_slip_only_in_the_state_that_statics_have_found(mbs, held):
    data, initial = mbs.systemData, exu.ConfigurationType.Initial
    ep.natural_modes(mbs, slipping=True)
    data.SetODE2Coordinates(0.5 * np.array(data.GetODE2Coordinates(initial)), initial)
    with pytest.raises(RunError, match="slipping: which rows slip is known only after solve_static"):
        ep.natural_modes(mbs, slipping=True)


def test_coordinates_of_first_order_are_refused(mbs):
    mbs.CreateMassPoint(physicsMass=1.0)
    node = mbs.AddNode(
        items.NodeGenericODE1(referenceCoordinates=[0], initialCoordinates=[0], numberOfODE1Coordinates=1)
    )
    mbs.AddObject(items.ObjectGenericODE1(nodeNumbers=[node], systemMatrix=[[-1.0]]))
    mbs.Assemble()
    with pytest.raises(RunError, match="first order have no natural modes"):
        ep.natural_modes(mbs)
