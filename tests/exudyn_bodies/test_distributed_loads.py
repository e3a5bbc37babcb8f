"""Pressures on curved faces, tractions and line loads: against Lamé, the FE mesh, and balances of forces."""

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.errors import EmptyRegionError, InputError
from exudyn_partition.reduction.loads import attached_loads

INNER, OUTER, LENGTH, PRESSURE = 0.02, 0.04, 0.025, 20e6
STEP = 1e-6


@pytest.fixture(scope="module")
def tube():
    """A thick tube about z with the inner face "bore"."""
    axis = occ.Axes((0, 0, 0), occ.Z)
    shape = occ.Cylinder(axis, OUTER, LENGTH) - occ.Cylinder(axis, INNER, LENGTH)
    for face in shape.faces:
        face.name = "bore" if abs(face.mass - 2 * np.pi * INNER * LENGTH) < 1e-9 else "else"
    return ep.fe_model(shape, ep.STEEL, maxh=0.012)


@pytest.fixture(scope="module")
def beam():
    """A square beam along x."""
    return ep.fe_model(occ.Box((0, 0, 0), (0.1, 0.01, 0.01)), ep.STEEL, maxh=0.01)


def reduced(fem, part, **options):
    return ep.reduce(fem, part, f_cut=10e3, **options)


def at_rest(body, load, magnitude):
    """Displacements of all nodes, (n, 3), of a free body under a load in balance, by the reduced coordinates."""
    pattern = body.partition.find_load(load)
    force = magnitude * (body.shape_rows(pattern.nodes).T @ pattern.forces.ravel())
    elastic = body.basis.omega > 0
    q = np.zeros(body.n_dofs)
    q[elastic] = force[elastic] / body.basis.omega[elastic] ** 2
    return body.displacement(q)


@pytest.mark.parametrize("basis", ["contact-adapted", "residual"])
def test_a_tube_under_inner_pressure_widens_as_lame_says(tube, basis):
    body = reduced(tube, ep.Partition.load(tube, "pressure", "bore"), basis=basis)
    u = at_rest(body, "pressure", PRESSURE)
    E, nu = ep.STEEL.E, ep.STEEL.nu
    x = tube.points
    r = np.hypot(x[:, 0], x[:, 1])
    share = PRESSURE * INNER**2 / (OUTER**2 - INNER**2)
    exact = share / E * ((1 - nu) * r + (1 + nu) * OUTER**2 / r)  # free ends: no axial stress
    radial = (u[:, :2] * x[:, :2]).sum(axis=1) / r
    assert np.linalg.norm(radial - exact) < 0.01 * np.linalg.norm(exact)
    shorter = u[x[:, 2] < 1e-9, 2].mean() - u[x[:, 2] > LENGTH - 1e-9, 2].mean()
    assert shorter == pytest.approx(2 * nu * share / E * LENGTH, rel=0.03)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_the_pressure_on_a_closed_surface_is_in_balance(order):
    """Whatever the mesh, for the same facets bound its volume; and the resultant in a fluid at rest is its weight."""
    ball = ep.fe_model(occ.Sphere(occ.Pnt(0.03, 0, 0), 0.01), ep.STEEL, maxh=0.02, order=order)
    (pattern,) = ep.Partition.load(ball, "water", np.arange(len(ball.facets))).loads
    arms, size = ball.points[pattern.nodes], np.linalg.norm(pattern.forces, axis=1).sum()
    assert abs(pattern.forces.sum(axis=0)).max() < 1e-12 * size
    assert abs(np.cross(arms, pattern.forces).sum(axis=0)).max() < 1e-12 * size * 0.04
    assert (arms * pattern.forces).sum() == pytest.approx(-3 * ball.cell_volume.sum(), rel=1e-9)  # Gauss


def test_a_ball_under_pressure_shrinks_by_its_bulk_modulus():
    ball = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), 0.01), ep.STEEL, maxh=0.02)
    body = reduced(ball, ep.Partition.load(ball, "water", np.arange(len(ball.facets))))
    u = at_rest(body, "water", 1e6)
    strain = -1e6 * (1 - 2 * ep.STEEL.nu) / ep.STEEL.E
    np.testing.assert_allclose(u, strain * ball.points, atol=1e-3 * abs(strain) * 0.01)  # integrals on curved elements


@pytest.mark.parametrize("basis", ["contact-adapted", "residual", "craig-bampton", "free"])
def test_the_static_answer_to_a_line_load_is_that_of_the_mesh(beam, basis):
    """On a clamped beam, whose foot the paper's basis and Craig-Bampton hold too."""
    on_edge = np.flatnonzero((beam.points[:, 1] < 1e-9) & (beam.points[:, 2] > 0.01 - 1e-9))
    foot = np.flatnonzero(beam.points[:, 0] < 1e-9)
    part = ep.Partition.load(beam, "edge", line=on_edge, direction=(0, 0, -2)) | ep.Partition.interface(
        beam, "foot", foot
    )
    (pattern,) = part.loads
    np.testing.assert_allclose(pattern.forces.sum(axis=0), [0, 0, -0.1], atol=1e-12)
    body = reduced(beam, part, basis=basis)
    rows = body.interface_rows("foot")
    K, T = body.stiffness.toarray(), body.shape_rows(pattern.nodes)
    system = np.block([[K, rows.T], [rows, np.zeros((6, 6))]])
    q = np.linalg.solve(system, np.r_[T.T @ pattern.forces.ravel(), np.zeros(6)])[: body.n_dofs]
    free = np.repeat(~np.isin(np.arange(beam.n_nodes), foot), 3)
    u = np.zeros(beam.n_dofs)
    all_forces = attached_loads(beam, (), part.loads).toarray()[0] * np.linalg.norm(pattern.forces, axis=1).sum()
    u[free] = spsolve(beam.stiffness[free][:, free].tocsc(), all_forces[free])
    np.testing.assert_allclose(body.displacement(q).ravel(), u, atol=1e-6 * abs(u).max())


def test_a_line_load_is_spread_evenly_over_edges_of_all_orders():
    for order in (1, 2, 3):
        fem = ep.fe_model(occ.Cylinder(occ.Axes((0, 0, 0), occ.Z), 0.01, 0.01), ep.STEEL, maxh=0.02, order=order)
        rim = np.flatnonzero((np.hypot(*fem.points.T[:2]) > 0.00999) & (fem.points[:, 2] > 0.01 - 1e-9))
        (pattern,) = ep.Partition.load(fem, "rim", line=rim, direction=(1, 0, 0)).loads
        total = pattern.forces[:, 0].sum()
        assert total == pytest.approx(2 * np.pi * 0.01, rel={1: 0.06, 2: 1e-3, 3: 1e-4}[order])
        np.testing.assert_allclose(
            pattern.forces[:, 0] @ fem.points[pattern.nodes], [0, 0, 0.01 * total], atol=1e-3 * total
        )


@pytest.mark.parametrize("frame", ["inertial", "floating"])
@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_a_traction_moves_a_body_and_does_work(mbs, beam, frame, method):
    """A free beam under a traction in its long direction: F = m a, and its energy is the work of the load."""
    part = ep.Partition.load(beam, "push", ((-1, -1, -1), (1e-9, 1, 1)), direction=(1, 0, 0))
    item = ep.CreatePartitionBody(mbs, reduced(beam, part), frame=frame)
    ep.CreateDistributedLoad(mbs, item, "push", 2e6, loadUserFunction=lambda mbs, t, size: size * t / 1e-4)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=1e-4, method=method, step=STEP)
    momentum = item.momentum(result)[:, 0]
    np.testing.assert_allclose(momentum, 200.0 * result.t**2 / 2e-4, atol=0.01 * momentum[-1])
    velocity = item.velocity(result, (0, 0.005, 0.005))[:, 0]
    work = np.trapezoid(200.0 * result.t / 1e-4 * velocity, result.t)
    assert item.energy(result)[-1] == pytest.approx(work, rel=0.03)


def test_a_pressure_turns_with_the_body_and_a_dead_load_does_not(mbs, beam):
    """A beam that spins by a quarter turn: the follower's impulse turns with it."""
    body = reduced(beam, ep.Partition.load(beam, "push", ((-1, -1, -1), (1e-9, 1, 1)), direction=(1, 0, 0)))
    spin, end = np.pi / 2 / 1e-2, 1e-2
    items = []
    for fixed in (True, False):
        item = ep.CreatePartitionBody(mbs, body, frame="floating", initialAngularVelocity=[0, 0, spin])
        ep.CreateDistributedLoad(mbs, item, "push", 1e2, bodyFixed=fixed)
        items.append(item)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=end, step=5 * STEP)
    follower, dead = (item.momentum(result)[-1] for item in items)
    impulse = 1e2 * 1e-4 * end
    np.testing.assert_allclose(dead, [impulse, 0, 0], atol=1e-4 * impulse)
    np.testing.assert_allclose(follower, np.array([1, 1, 0]) * impulse * 2 / np.pi, atol=5e-3 * impulse)


def test_a_body_that_is_placed_turned_keeps_its_directions(mbs, beam):
    turn = Rotation.from_rotvec([0, 0, np.pi / 2]).as_matrix()
    body = reduced(beam, ep.Partition.load(beam, "push", ((-1, -1, -1), (1e-9, 1, 1)), direction=(1, 0, 0)))
    item = ep.CreatePartitionBody(mbs, body, frame="floating", referenceRotationMatrix=turn)
    ep.CreateDistributedLoad(mbs, item, "push", 1e2)
    mbs.Assemble()
    momentum = item.momentum(ep.solve_dynamic(mbs, end_time=1e-4, step=STEP))[-1]
    np.testing.assert_allclose(momentum, [0, 1e2 * 1e-4 * 1e-4, 0], atol=1e-10)


def test_loads_are_kept_in_files(beam, tmp_path):
    body = reduced(beam, ep.Partition.load(beam, "push", ((-1, -1, -1), (1e-9, 1, 1))))
    body.save(tmp_path / "body.npz")
    kept = ep.load_body(tmp_path / "body.npz").partition.find_load("push")
    np.testing.assert_array_equal(kept.forces, body.partition.find_load("push").forces)


def test_what_is_refused(mbs, beam):
    load = ep.Partition.load
    for arguments, message in (
        ({}, "expected one of them, got none"),
        ({"faces": [0], "line": [0]}, "expected one of them, got both"),
        ({"line": [0, 1]}, "a line load needs one"),
        ({"line": [10**6], "direction": (1, 0, 0)}, "expected numbers of nodes"),
        ({"line": [0.5], "direction": (1, 0, 0)}, "expected numbers of nodes"),
        ({"faces": [0], "direction": (0, 0, 0)}, "a vector that has a length"),
    ):
        with pytest.raises(InputError, match=message):
            load(beam, "x", **arguments)
    with pytest.raises(EmptyRegionError, match="no edge of the surface's mesh"):
        load(beam, "x", line=[0], direction=(1, 0, 0))
    one = load(beam, "x", [0])
    with pytest.raises(InputError, match="expected each name once, got 'x', 'x'"):
        one | one
    body = reduced(beam, one)
    with pytest.raises(InputError, match="expected one of 'x', got 'y'"):
        ep.CreateDistributedLoad(mbs, ep.CreatePartitionBody(mbs, body), "y", 1.0)
    with pytest.raises(InputError, match="belongs to another model"):
        ep.CreateDistributedLoad(mbs, ep.CreatePartitionBody(exu.SystemContainer().AddSystem(), body), "x", 1.0)
    with pytest.raises(InputError, match="expected what CreatePartitionBody returns, got ReducedBody"):
        ep.CreateDistributedLoad(mbs, body, "x", 1.0)
