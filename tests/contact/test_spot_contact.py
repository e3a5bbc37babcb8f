"""Contact at a point that facets do not resolve: against Hertz, Mindlin and Maw, and by its own balances."""

import math
from dataclasses import replace

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
from oracles import add_springs
from scipy.optimize import brentq
from scipy.special import ellipk

import exudyn_partition as ep
from exudyn_partition.contact.formulations.hertz import HertzCurve
from exudyn_partition.contact.formulations.hertz_friction import Springs
from exudyn_partition.contact.true_surface import Middle, fitted, nearest_places
from exudyn_partition.errors import ContactPatchWarning, InputError, PartitionWarning, PenetrationError
from exudyn_partition.prediction.point_contact import PointContact
from exudyn_partition.surfaces.smooth_kernel import kernel_around
from validation.contact.elastic_sphere import ElasticSphere

pytestmark = pytest.mark.filterwarnings("ignore::exudyn_partition.errors.YieldWarning")
R, SPEED, MU = 10e-3, 0.5, 0.3


@pytest.fixture(scope="module")
def coarse():
    """A steel ball about the origin whose facets are three and a half contact radii long at the south pole."""
    shape = occ.Sphere(occ.Pnt(0, 0, 0), R).Rotate(occ.Axis(occ.Pnt(0, 0, 0), occ.Dir(1, 0.3, 0.1)), 50)
    fem = ep.fe_model(shape, ep.STEEL, maxh=3.5e-3, refine=[ep.Refine((0, 0, -R), 5e-3, 1e-3)], grading=0.6)
    part = ep.Partition.ball(fem, (0, 0, -R), 4.5e-3, axes="xyz", direction=(0, 0, -1))
    return ep.reduce(fem, part, f_cut=150e3)


def drop(body, line=(0.05, 0.03, -1), sliding=0.0, frame="inertial", carried=False, friction=None, **options):
    """Body, contact and result of the ball hitting a plane along a line of its body, (3,)."""
    n = np.array(line) / np.linalg.norm(line)
    along = np.cross(n, [0.3, 1, 0.2])
    mbs = exu.SystemContainer().AddSystem()
    velocity = SPEED * n + sliding * along / np.linalg.norm(along)
    ball = ep.CreatePartitionBody(mbs, body, frame=frame, initialVelocity=list(velocity))
    place = {"masterBody": mbs.CreateGround()} if carried else {}
    plane = ep.RigidPlane((R + 1e-7) * n, -n)
    contact = ep.CreatePartitionContact(mbs, ball, plane, formulation="hertz", friction=friction, **place)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=72e-6, step=0.2e-6, **options)
    return ball, contact, result


def energy_of(bodies, contact, result):
    return sum(body.energy(result) for body in bodies) + contact.energy(result) + contact.dissipated_energy(result)


@pytest.fixture(scope="module")
def dropped(coarse):
    return drop(coarse)


# Static laws.


def test_a_circular_contact_is_hertz_s():
    contact = PointContact((1 / R, 1 / R), 1e11)
    np.testing.assert_allclose(contact.semi_axes(50.0), (0.75 * 50.0 * R / 1e11) ** (1 / 3), rtol=1e-12)
    assert contact.yielding == pytest.approx((9 / (16 * 1e22 * R)) ** (1 / 3), rel=1e-12)
    assert contact.force(contact.semi_axes(50.0)[0]) == pytest.approx(50.0, rel=1e-12)


def test_an_elliptic_contact_fits_both_curvatures():
    """Displacements beneath Hertz's pressure on the ellipse follow both curvatures (Johnson, eq. 4.26)."""
    from scipy.special import ellipe, ellipk

    contact = PointContact((20.0, 90.0), 1e11)
    a, b = contact.semi_axes(100.0)
    square, pressure = 1 - (b / a) ** 2, 150.0 / (np.pi * a * b)
    E, K, unit = ellipe(square), ellipk(square), pressure * b / (1e11 * square * a**2)
    assert 2 * unit * (K - E) == pytest.approx(20.0, rel=1e-9)
    assert 2 * unit * ((a / b) ** 2 * E - K) == pytest.approx(90.0, rel=1e-9)
    assert contact.yielding * 100 ** (2 / 3) == pytest.approx(pressure / 1e11 * b * K, rel=1e-9)
    for smaller, semi_axis in (((19.999, 90.0), a), ((20.0, 89.999), b)):  # pressure works on the change of the gap
        change = (contact.yielding - PointContact(smaller, 1e11).yielding) * 100 ** (2 / 3)
        assert change / 1e-3 == pytest.approx(semi_axis**2 / 6, rel=1e-4)
    nearly = PointContact((50.0, 50.01), 1e11)
    assert nearly.yielding == pytest.approx(PointContact((50.005, 50.005), 1e11).yielding, rel=1e-6)


@pytest.mark.parametrize("series", [-3e-9, -2e-10, 0.0, 2e-9])
def test_the_force_is_the_derivative_of_the_stored_energy(series):
    """Also beyond the largest contact, where bodies that are stiffer than rigid ones would have no answer."""
    curve = HertzCurve(series, PointContact((100.0, 100.0), 1.15e11))
    for approach in np.geomspace(1e-3, 3.0, 9) * curve.approach(curve.largest):
        force, way = curve.force(approach), 1e-5 * approach
        sides = [curve.force(approach + side * way) for side in (-1, 1)]
        assert (curve.stored(sides[1]) - curve.stored(sides[0])) / (2 * way) == pytest.approx(force, rel=1e-6)
        assert (sides[1] - sides[0]) / (2 * way) == pytest.approx(curve.stiffness(force), rel=1e-4)
        if force < curve.largest:
            assert curve.approach(force) == pytest.approx(approach, rel=1e-10)


# Friction at a point.


def stretched(springs, ways, force):
    """Sums of the springs, (n, 2) [N], along ways, (n,) or (n, 2) [m], under a constant normal force [N]."""
    lengths, bounds = springs.lengths(springs.reach(force)), MU * springs.normal(springs.reach(force))
    covered = lengths > 0
    x, sums, last = np.zeros((len(lengths), 2)), [], np.zeros(2)
    for way in np.column_stack([ways, 0 * ways]) if ways.ndim == 1 else ways:
        held = springs.forces_up_to(x + way - last, lengths, bounds)
        x[covered], last = held.forces[covered] / (lengths[covered, None] * springs.shear), way
        sums.append(held.total)
    return np.array(sums)


def test_springs_are_cattaneo_s_and_mindlin_s():
    """Q = mu P (1 - (1 - way / slope)^(3/2)), slope = 3 mu P / (16 a G*), where 1 / G* is the sum of (2 - nu) / G."""
    modulus, shear, P = 1.15e11, 4 * 81e9 / 1.7, 900.0
    springs = Springs(R, modulus, (shear, shear))
    a = springs.reach(P)
    assert springs.normal(a).sum() == pytest.approx(P, rel=1e-12)
    assert springs.lengths(a).sum() * shear == pytest.approx(8 * (81e9 / 1.7) * a, rel=1e-12)
    slope = 3 * MU * P / (16 * (81e9 / 1.7) * a)
    ways = np.linspace(0, 0.9, 60)[1:] * slope
    sums = stretched(springs, ways, P)[:, 0]
    np.testing.assert_allclose(sums, MU * P * (1 - (1 - ways / slope) ** 1.5), atol=0.01 * MU * P)
    sums = stretched(springs, np.linspace(0, 1.2, 60) * slope, P)
    assert sums[-1, 0] == pytest.approx(MU * P, rel=1e-12)


@pytest.mark.parametrize("friction", [0.6, 0.8, 1.05])  # by Dundurs' constant
def test_pressure_between_unlike_bodies_slides_as_spence_says(friction):
    """Nothing slips inside of the radius c with (1 / 2 c) ln((1 + c) / (1 - c)) = mu / beta K(1 - c^2)."""
    radius = brentq(lambda c: math.atanh(c) / c - friction * ellipk(1 - c**2), 0.01, 1 - 1e-9)
    beta = 0.25
    springs = Springs(R, 1.15e11, (1e11, 1e11), beta)
    a = springs.ends[-2]
    force = (a / springs.reach(1.0)) ** 3
    x, before, reach = np.zeros((len(springs.lengths(a)), 2)), springs.lengths(0.0), 0.0
    for share in np.linspace(0, 1, 800)[1:]:
        now = springs.reach(force * share**3)
        lengths = springs.lengths(now)
        x *= np.divide(np.minimum(lengths, before), lengths, out=np.zeros_like(lengths), where=lengths > 0)[:, None]
        bounds = friction * beta * springs.normal(now)
        held = springs.forces_up_to(x + springs.driven(reach, now, force * share**3).change, lengths, bounds)
        x, before, reach = springs.elongations(held.forces, lengths), lengths, now
    np.testing.assert_allclose(held.total, 0.0, atol=1e-12 * force)
    slips = np.linalg.norm(held.forces, axis=1) > (1 - 1e-9) * bounds
    rings = slips.reshape(-1, springs.spokes).any(axis=1)[:-1]  # all but the last one, which does not touch
    stuck = springs.ends[1:-1][~rings].max() / a
    assert stuck == pytest.approx(radius, abs=0.15)  # as wide as the rings are


def test_what_pressure_slides_has_no_jumps_while_it_falls():
    """The slope of the slide has a logarithm at the edge of contact, which passes over springs."""
    springs, peak = Springs(R, 1.15e11, (1e11, 1e11), 0.25), 900.0
    forces = np.linspace(0.3, 1.0, 400) * peak
    found = [springs.driven(springs.reach(peak), springs.reach(P), P) for P in forces]
    slopes = np.array([driven.by_force for driven in found])
    assert abs(np.diff(slopes, axis=0)).max() < 0.03 * abs(slopes).max()
    changes = np.array([driven.change for driven in found])
    by_means = (slopes[1:] + slopes[:-1]) / 2 * np.diff(forces)[:, None, None]
    np.testing.assert_allclose(np.diff(changes, axis=0), by_means, rtol=0, atol=0.02 * abs(by_means).max())


MAW = {0.5: 0.048, 1.0: -0.060, 2.0: -0.837, 3.0: -1.380, 4.0: -1.437, 4.5: -1.218, 6.0: 0.235}  # psi1: psi2, nu = 0.3


def rebound(sphere, modulus, shear, mass, sliding):
    """Speed [m/s] at which a rigid ball on springs slides after it came with a speed of `sliding`."""
    springs = Springs(sphere, modulus, (shear, shear))
    dt = 2.943 * (15 * mass * SPEED**2 / (16 * modulus * math.sqrt(sphere))) ** 0.4 / SPEED / 400
    d, v, slide, P, T = 0.0, SPEED, sliding, 0.0, 0.0
    x, before = np.zeros((len(springs.ends) - 1, 2)), springs.lengths(0.0)
    while True:
        v, slide = v - 0.5 * dt * P / mass, slide - 1.75 * dt * T / mass
        d += dt * v
        if d <= 0:
            return slide
        P = 4 / 3 * modulus * math.sqrt(sphere) * d**1.5
        reach = springs.reach(P)
        lengths, bounds = springs.lengths(reach), MU * springs.normal(reach)
        closed = lengths > 0
        x[closed] *= (np.minimum(lengths, before)[closed] / lengths[closed])[:, None]
        held = springs.forces_up_to(x + np.array([dt * slide, 0.0]), lengths, bounds)
        x[closed], before, T = held.forces[closed] / (lengths[closed] * shear)[:, None], lengths, held.total[0]
        v, slide = v - 0.5 * dt * P / mass, slide - 1.75 * dt * T / mass


@pytest.mark.parametrize("psi1", MAW)
def test_rebound_of_a_rigid_ball_on_springs_is_maw_s(psi1):
    """Maw, Barber and Fawcett, 1976, with kappa = 2 (1 - nu) / (2 - nu) and psi = kappa v_T / (mu v_N)."""
    nu, G = 0.3, 81e9
    kappa = 2 * (1 - nu) / (2 - nu)
    slide = rebound(R, 2 * G / (1 - nu), 4 * G / (2 - nu), 0.0329, psi1 * MU * SPEED / kappa)
    assert slide * kappa / (MU * SPEED) == pytest.approx(MAW[psi1], abs=0.02)


def motion_under(traction, at, axes, nu, G):
    """Tangential motion along x, (2,) [m], of a point of a half-space under a traction along x on an ellipse."""
    angle = (np.arange(400) + 0.5) * np.pi / 200
    way = np.column_stack([np.cos(angle), np.sin(angle)])
    x, w = np.polynomial.legendre.leggauss(60)
    psi = np.pi / 4 * (x + 1)
    u, start = way / axes, np.array(at) / axes
    first, half = (u * u).sum(axis=1), u @ start
    end = (np.sqrt(half**2 + first * (1 - start @ start)) - half) / first
    r = end[:, None] * np.sin(psi)
    place = start + u[:, None] * r[..., None]
    inner = (traction(np.maximum(1 - (place**2).sum(axis=2), 1e-15)) * end[:, None] * np.cos(psi)) @ (w * np.pi / 4)
    along = np.column_stack([1 - nu + nu * way[:, 0] ** 2, nu * way[:, 0] * way[:, 1]])
    return along.T @ inner * (np.pi / 200) / (2 * np.pi * G)


def test_tangential_stiffness_of_an_ellipse_is_that_of_half_spaces():
    """A traction (1 - x^2/a^2 - y^2/b^2)^(-1/2) moves all of the ellipse alike, by Cerruti's solution."""
    contact, material = PointContact((20.0, 90.0), 1e11), ep.Material(E=1e11 * (1 - 0.3**2), nu=0.3, rho=1e3)
    axes, G = np.array(contact.semi_axes(100.0)), material.shear_modulus
    total = 2 * np.pi * np.prod(axes)
    springs = Springs(contact.sphere, contact.modulus, contact.shear_moduli([material]))
    length = springs.lengths(springs.reach(100.0)).sum()
    for order in (1, -1):
        for place in ([0.0, 0.0], [0.4, 0.3], [-0.2, 0.5]):
            at = np.array(place)[::order] * axes[::order]
            moved = motion_under(lambda left: left**-0.5, at, axes[::order], 0.3, G)
            assert total / moved[0] == pytest.approx(length * springs.shear[::order][0], rel=2e-3)
            assert moved[1] == pytest.approx(0.0, abs=2e-3 * moved[0])


def test_springs_of_an_ellipse_slip_against_their_force():
    """Coulomb: a spring that slips has its largest force, and what it loses is along that."""
    springs, P = Springs(R, 1.15e11, (1.1e11, 0.8e11)), 900.0
    lengths, bounds = springs.lengths(springs.reach(P)), MU * springs.normal(springs.reach(P))
    stretch, step = np.array([4e-6, 2e-6]), 1e-12
    elongations = np.tile(stretch, (len(lengths), 1))
    held = springs.forces_up_to(elongations, lengths, bounds)
    closed = lengths > 0
    size = np.linalg.norm(held.forces, axis=1)
    lost = elongations[closed] - held.forces[closed] / (lengths[closed, None] * springs.shear)
    slips = np.linalg.norm(lost, axis=1) > 1e-9 * stretch[0]
    assert 3 < np.count_nonzero(slips) < np.count_nonzero(closed)
    np.testing.assert_allclose(size[closed][slips], bounds[closed][slips], rtol=1e-9)
    assert (size <= bounds * (1 + 1e-9)).all()
    across = lost[:, 0] * held.forces[closed, 1] - lost[:, 1] * held.forces[closed, 0]
    np.testing.assert_allclose(across, 0, atol=1e-9 * stretch[0] * bounds.max())
    assert (np.einsum("nk,nk->n", lost, held.forces[closed]) >= -1e-15 * bounds.max() * stretch[0]).all()
    for k in range(2):
        more, less = (
            springs.forces_up_to(elongations + side * step * np.eye(2)[k], lengths, bounds) for side in (1, -1)
        )
        slope = (more.total - less.total) / (2 * step)
        np.testing.assert_allclose(slope, held.stiffness[k], atol=1e-3 * held.stiffness.max())


# Surfaces and kernels.


def patch_of(shape, near, maxh=3e-3):
    fem = ep.fe_model(shape, ep.STEEL, maxh=maxh)
    patch = ep.Partition.surface(fem, near=near, axes="xyz").patches[0]
    return fem.points, patch.facets


def test_true_surfaces_are_found_and_others_refused():
    ball, pin = occ.Sphere(occ.Pnt(1e-3, 2e-3, 0), R), occ.Cylinder(occ.Pnt(15e-3, 15e-3, 0), occ.Z, 8e-3, 0.01)
    sphere = fitted(*patch_of(ball, (0, 0, -R)), "slave")
    assert sphere.ball[1] == pytest.approx(R, rel=1e-9)
    np.testing.assert_allclose(sphere.ball[0], [1e-3, 2e-3, 0], atol=1e-9)
    drilled = occ.Box(occ.Pnt(0, 0, 0), occ.Pnt(0.03, 0.03, 0.01)) - pin
    bore = fitted(*patch_of(drilled, (0.023, 0.015, 5e-3)), "slave")
    assert bore.curvatures == pytest.approx((-1 / 8e-3, 0.0), rel=1e-6)
    flat = fitted(*patch_of(drilled, (4e-3, 4e-3, 0.01)), "slave")
    assert flat.curvatures == (0.0, 0.0)
    np.testing.assert_allclose(flat.shape.normal, [0, 0, 1], atol=1e-12)
    points, facets = patch_of(ball, (0, 0, -R))
    with pytest.raises(InputError, match="slave: formulation 'hertz' needs the true surface"):
        fitted(points * [1.0, 1.0, 0.9], facets, "slave")


@pytest.fixture(scope="module")
def rounded():
    """A steel block whose corner is rounded, a torus with a ring and a tube of 4 mm, and a normal in its middle."""
    block = occ.Box(occ.Pnt(0, 0, 0), occ.Pnt(20e-3, 20e-3, 10e-3))
    block = block.MakeFillet([edge for edge in block.edges if min(edge.center.x, edge.center.y) > 0.019], 8e-3)
    block = block.MakeFillet([edge for edge in block.edges if edge.center.z > 0.0099], 4e-3)
    n, middle = np.full(3, 3**-0.5), np.array([12e-3, 12e-3, 6e-3])
    place = middle + 4e-3 * n + 4e-3 * np.array([0.5**0.5, 0.5**0.5, 0.0])
    fem = ep.fe_model(block, ep.STEEL, maxh=3e-3, refine=[ep.Refine(place, 2e-3, 0.5e-3)], grading=0.5)
    partition = ep.Partition.ball(fem, place, 2e-3, axes="xyz", direction=n)
    return ep.reduce(fem, partition, f_cut=100e3), middle, place, n


def test_the_torus_of_a_rounded_corner_is_found(rounded):
    body, middle, place, n = rounded
    surface = fitted(body.points, body.partition.patches[0].facets, "slave")
    np.testing.assert_allclose(surface.shape.centre, middle, atol=1e-9)
    np.testing.assert_allclose(abs(surface.shape.axis), [0, 0, 1], atol=1e-8)
    assert (surface.shape.ring, surface.shape.tube) == pytest.approx((4e-3, 4e-3), rel=1e-6)
    bending, step = surface.bending(n), 1e-7
    for along in np.linalg.svd(n[None])[2][1:]:  # curvature is the change of the normal
        sides = [surface.shape.project((place + side * step * along)[None])[1][0] for side in (1, -1)]
        np.testing.assert_allclose((sides[0] - sides[1]) / (2 * step), bending @ along, atol=1e-3 * abs(bending).max())
    np.testing.assert_allclose(bending @ n, 0, atol=1e-9)
    weights = np.eye(3)  # of the sum of both curvatures
    for along in np.linalg.svd(n[None])[2][1:]:
        sides = [surface.shape.project((place + side * step * along)[None])[1][0] for side in (1, -1)]
        sums = [np.trace(surface.bending(side)) for side in sides]
        assert (sums[0] - sums[1]) / (2 * step) == pytest.approx(surface.bent(weights, n) @ along, abs=10.0)


def test_a_rounded_corner_hits_a_plane_by_hertz_s_law_of_both_curvatures(rounded):
    """The force of a rigid body with its inertia; the block is stiffer than half-spaces by a few per cent."""
    body, _, place, n = rounded
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, frame="floating", initialVelocity=list(SPEED * n))
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(place + 1e-7 * n, -n), formulation="hertz")
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=80e-6, step=0.1e-6)
    cosine = math.sqrt(2 / 3)
    point = PointContact((1 / 4e-3, cosine / (4e-3 + 4e-3 * cosine)), ep.STEEL.plane_strain_modulus)
    motion = np.r_[n, np.cross(place - body.centre_of_mass, n)]
    inertia = body.rigid.T @ (body.mass @ body.rigid)
    mass = 1 / (motion @ np.linalg.solve(inertia, motion))
    approach = (1.25 * mass * SPEED**2 * point.yielding**1.5) ** 0.4
    force = contact.force(result)
    assert force.max() == pytest.approx((approach / point.yielding) ** 1.5, rel=0.04)
    assert np.trapezoid(force, result.t) == pytest.approx(2 * mass * SPEED, rel=0.04)
    assert np.ptp(energy_of([item], contact, result)) < 1e-4 * item.energy(result)[0]
    assert contact.radius(result).max() == pytest.approx(point.mean_axis(force.max()), rel=0.01)


def test_a_rounded_corner_on_a_ball_has_the_curvatures_of_both(rounded):
    body, _, place, n = rounded
    mbs, radius = exu.SystemContainer().AddSystem(), 7e-3
    item, ball = ep.CreatePartitionBody(mbs, body), ep.RigidSphere(place + (radius + 1e-7) * n, radius)
    gaps = ep.CreatePartitionContact(mbs, item, ball, formulation="hertz", friction=MU).mechanics.gaps
    cosine = math.sqrt(2 / 3)
    expected = 1 / radius + np.array([cosine / (4e-3 + 4e-3 * cosine), 1 / 4e-3])
    np.testing.assert_allclose(gaps.contact.curvatures, expected, rtol=1e-4)
    assert gaps.placement.clearance == pytest.approx(1e-7, rel=1e-3)
    np.testing.assert_allclose(abs(gaps.long_axis), [0.5**0.5, 0.5**0.5, 0.0], atol=1e-3)  # around the ring


def on_cylinder(rounded, turned, radius=5e-3, friction=None, frame="inertial"):
    """Model, body, and contact of the rounded corner that comes to a cylinder, turned from the ring's direction."""
    body, _, place, n = rounded
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, frame=frame, initialVelocity=list(SPEED * n))
    around = np.array([-(0.5**0.5), 0.5**0.5, 0.0])
    axis = math.cos(turned) * around + math.sin(turned) * np.cross(n, around)
    cylinder = ep.RigidCylinder(place + (radius + 1e-7) * n, axis, radius)
    contact = ep.CreatePartitionContact(mbs, item, cylinder, formulation="hertz", friction=friction)
    mbs.Assemble()
    return mbs, item, contact


@pytest.mark.parametrize("turned", [0.0, 0.6, math.pi / 2])
def test_a_rounded_corner_on_a_cylinder_has_the_curvatures_of_both(rounded, turned):
    """Those of the sum of two tensors: A + B is the sum of all, and A - B depends on the angle (Johnson, eq. 4.5)."""
    gaps = on_cylinder(rounded, turned, friction=MU)[2].mechanics.gaps
    cosine = math.sqrt(2 / 3)
    along, across, other = cosine / (4e-3 + 4e-3 * cosine), 1 / 4e-3, 1 / 5e-3
    apart = across - along
    size = math.sqrt(apart**2 + other**2 + 2 * apart * other * math.cos(2 * turned))
    middle = along + across + other
    np.testing.assert_allclose(sorted(gaps.contact.curvatures), [(middle - size) / 2, (middle + size) / 2], rtol=1e-4)
    assert gaps.placement.clearance == pytest.approx(1e-7, rel=2e-3)
    along_ring = gaps.long_axis @ [-(0.5**0.5), 0.5**0.5, 0.0]
    angle = 0.5 * math.atan2(other * math.sin(2 * turned), apart + other * math.cos(2 * turned))
    assert abs(along_ring) == pytest.approx(math.cos(angle), abs=2e-3)


def test_a_rounded_corner_hits_a_cylinder_by_hertz_s_law_of_both_curvatures(rounded):
    """The force of a rigid body with its inertia, which turns; the block is stiffer than half-spaces."""
    body, _, place, n = rounded
    mbs, item, contact = on_cylinder(rounded, 0.6, frame="floating")
    result = ep.solve_dynamic(mbs, end_time=70e-6, step=0.2e-6)
    point = contact.mechanics.gaps.contact
    motion = np.r_[n, np.cross(place - body.centre_of_mass, n)]
    inertia = body.rigid.T @ (body.mass @ body.rigid)
    mass = 1 / (motion @ np.linalg.solve(inertia, motion))
    approach = (1.25 * mass * SPEED**2 * point.yielding**1.5) ** 0.4
    force = contact.force(result)
    assert force.max() == pytest.approx((approach / point.yielding) ** 1.5, rel=0.04)
    assert np.trapezoid(force, result.t) == pytest.approx(2 * mass * SPEED, rel=0.04)
    assert np.ptp(energy_of([item], contact, result)) < 1e-4 * item.energy(result)[0]


# Cylinders that cross.


@pytest.fixture(scope="module")
def barrel():
    """A steel cylinder along x, its lowest line at z = -R, with coarse facets."""
    shape = occ.Cylinder(occ.Pnt(-15e-3, 0, 0), occ.X, R, 30e-3)
    fem = ep.fe_model(shape, ep.STEEL, maxh=5e-3, refine=[ep.Refine((0, 0, -R), 5.5e-3, 2e-3)], grading=0.6)
    return ep.reduce(fem, ep.Partition.ball(fem, (0, 0, -R), 5e-3, axes="xyz", direction=(0, 0, -1)), f_cut=100e3)


def crossed(barrel, degrees, speed, radius=R, frame="inertial", sliding=0.0, friction=None):
    """Model, body and contact of the cylinder that falls on a rigid one which is turned by an angle."""
    mbs, angle = exu.SystemContainer().AddSystem(), math.radians(degrees)
    item = ep.CreatePartitionBody(mbs, barrel, frame=frame, initialVelocity=[0.6 * sliding, 0.8 * sliding, -speed])
    other = ep.RigidCylinder((0, 0, -R - radius - 1e-7), (math.cos(angle), math.sin(angle), 0), radius)
    contact = ep.CreatePartitionContact(mbs, item, other, formulation="hertz", friction=friction)
    mbs.Assemble()
    return mbs, item, contact


@pytest.mark.parametrize(("degrees", "radius"), [(90, R), (40, 2 * R), (10, R)])
def test_cylinders_that_cross_hit_each_other_by_hertz_s_law_of_their_ellipse(barrel, degrees, radius):
    """Slowly, so that the body is a half-space for its contact; it is stiffer by the order of the contact over R."""
    speed = 0.02
    mbs, item, contact = crossed(barrel, degrees, speed, radius)
    first, second, twice = 1 / R, 1 / radius, math.radians(2 * degrees)
    apart = math.sqrt(first**2 + second**2 + 2 * first * second * math.cos(twice))  # Johnson, eq. 4.5
    point = PointContact(
        ((first + second - apart) / 2, (first + second + apart) / 2), ep.STEEL.plane_strain_modulus
    )  # fmt: skip
    np.testing.assert_allclose(contact.mechanics.gaps.contact.curvatures, point.curvatures, rtol=1e-6)
    approach = (1.25 * barrel.total_mass * speed**2 * point.yielding**1.5) ** 0.4
    time = 2.9432 * approach / speed
    result = ep.solve_dynamic(mbs, end_time=1.1 * time, step=time / 300)
    force = contact.force(result)
    assert force.max() == pytest.approx((approach / point.yielding) ** 1.5, rel=0.01)
    assert np.trapezoid(force, result.t) == pytest.approx(2 * barrel.total_mass * speed, rel=2e-3)
    energy = energy_of([item], contact, result)
    assert np.ptp(energy) < 1e-4 * energy[0]


def test_cylinders_that_cross_at_right_angles_slip_as_a_ball_on_a_plane(barrel):
    """Their ellipse is a circle, whose axes turned with round-off; the tangential force is mu times the normal one."""
    mbs, item, contact = crossed(barrel, 90, 0.1, frame="floating", sliding=4.0, friction=MU)
    result = ep.solve_dynamic(mbs, end_time=130e-6, step=0.4e-6)
    normal = np.trapezoid(contact.force(result), result.t)
    impulse = np.trapezoid(contact.friction.tangential_force(result), result.t, axis=0)
    np.testing.assert_allclose(impulse, -MU * normal * np.array([0.6, 0.8, 0.0]), atol=0.01 * MU * normal)
    energy = energy_of([item], contact, result)
    assert np.ptp(energy) < 1e-4 * energy[0]


def test_parallel_cylinders_touch_along_a_line_and_are_refused(barrel):
    with pytest.raises(InputError, match="touch along a line, as parallel cylinders"):
        crossed(barrel, 1.0, 0.1)


def test_tubes_are_nearest_where_no_other_places_are_nearer():
    """Circles and lines in any direction, against all their places."""
    rng, angle = np.random.default_rng(3), np.linspace(0, 2 * np.pi, 2001)
    for ring in (0.0, 0.0, 0.7, 0.7):
        axes = [axis / np.linalg.norm(axis) for axis in rng.normal(size=(2, 3))]
        circle, other = Middle(np.zeros(3), axes[0], 0.4, 0.3), Middle(2.5 * axes[1][[2, 0, 1]], axes[1], ring, 0.2)
        x, y = nearest_places(circle, other)
        places = []
        for middle in (circle, other):
            across = np.linalg.svd(middle.axis[None])[2][1:]
            round_ = middle.ring * np.column_stack([np.cos(angle), np.sin(angle)]) @ across
            places.append(middle.centre + (round_ if middle.ring else np.outer(np.linspace(-4, 4, 2001), middle.axis)))
        found = np.linalg.norm(places[0][:, None, :] - places[1][None, ::10], axis=2).min()
        assert np.linalg.norm(x - y) == pytest.approx(found, rel=1e-3)
        assert np.linalg.norm(x - y) <= found


def test_a_kernel_is_whole_centred_and_follows_small_ways(coarse):
    points, facets = coarse.points, coarse.partition.patches[0].facets
    n = np.array([0.06, -0.03, -1.0]) / np.linalg.norm([0.06, -0.03, -1.0])
    kernel = kernel_around(points, facets, R * n, n, 2e-3)
    assert kernel.weights.sum() == pytest.approx(1.0, abs=1e-12)
    assert kernel.coverage == pytest.approx(1.0, abs=0.01)
    across, places = np.linalg.svd(n[None])[2][1:], points[kernel.nodes]
    for way in (np.zeros(2), np.array([1.5e-4, -0.7e-4])):
        there = R * n + way @ across
        there *= R / np.linalg.norm(there)
        off = kernel.around(places, there, there / R) @ places - there
        assert abs(np.cross(off, there / R)).max() < 1e-9  # a force along the normal has no lever
        assert off @ there / R == pytest.approx(-(2e-3**2) / (5 * R), rel=0.15)  # sagitta of the mean place
    slopes = kernel.slopes.T @ (points[kernel.nodes] @ [3.0, -1.0, 0.5])
    np.testing.assert_allclose(across @ slopes, across @ [3.0, -1.0, 0.5], rtol=0.02)
    assert kernel_around(points, facets, -R * n, -n, 2e-3).coverage == 0.0


# Impacts.


def test_the_impact_of_a_coarse_ball_is_hertz_s(coarse, dropped):
    """A whole sphere is 1.4 % stiffer than Hertz's half-spaces here (`validation/contact/unresolved.py`)."""
    ball, contact, result = dropped
    hertz = ep.hertz.impact(coarse.total_mass, SPEED, R, math.inf, ep.STEEL)
    force = contact.force(result)
    assert force.max() == pytest.approx(1.014 * hertz.peak_force, rel=0.004)
    assert np.trapezoid(force, result.t) == pytest.approx(2 * coarse.total_mass * SPEED, rel=1e-3)
    assert np.ptp(energy_of([ball], contact, result)) < 1e-4 * ball.energy(result)[0]
    other = drop(coarse, (-0.08, 0.02, -1))[1:]
    assert other[0].force(other[1]).max() == pytest.approx(force.max(), rel=1e-3)
    stress = contact.largest_stress(result)
    radius = (0.75 * force.max() * R / ep.STEEL.plane_strain_modulus) ** (1 / 3)
    assert stress.semi_axes == pytest.approx((radius, radius), rel=1e-9)
    assert contact.radius(result).max() == pytest.approx(radius, rel=1e-9)
    assert contact.pressure(result).max() == pytest.approx(stress.pressure, rel=1e-9)
    assert any("whether facets resolve it" in said for said in contact.left_out)


def test_a_stored_result_knows_the_ellipse(dropped, tmp_path):
    """Area and radius of contact need no model."""
    _, contact, result = dropped
    result.save(tmp_path / "run.npz")
    read = ep.Result.load(tmp_path / "run.npz")
    (stored,) = read.contacts
    assert stored.area(read) == pytest.approx(contact.area(result), rel=1e-12)
    assert stored.radius(read) == pytest.approx(contact.radius(result), rel=1e-12)


@pytest.mark.parametrize(
    "options",
    [{"frame": "floating"}, {"carried": True}, {"method": "implicit"}],
    ids=["floating", "carried", "implicit"],
)
def test_frames_carriers_and_methods_agree(coarse, dropped, options):
    expected = dropped[1].force(dropped[2])
    _, contact, result = drop(coarse, **options)
    np.testing.assert_allclose(contact.force(result), expected, atol=2e-3 * expected.max())


def pair(coarse, along=0.0, frame="inertial", **options):
    """Two balls, the upper one upside down."""
    mbs = exu.SystemContainer().AddSystem()
    velocities = [0.5 * along, 0, SPEED], [-0.5 * along, 0, -SPEED]
    turned = {"referenceRotationMatrix": np.diag([1.0, -1, -1]).tolist(), "frame": "floating"}
    lower = ep.CreatePartitionBody(mbs, coarse, initialVelocity=velocities[0], **turned)
    place = {"referencePosition": [0, 0, 2 * R + 2e-7], "frame": frame}
    upper = ep.CreatePartitionBody(mbs, coarse, initialVelocity=velocities[1], **place)
    contact = ep.CreatePartitionContact(mbs, upper, lower, formulation="hertz", **options)
    mbs.Assemble()
    return [lower, upper], contact, ep.solve_dynamic(mbs, end_time=72e-6, step=0.2e-6)


def test_two_balls_meet_as_one_meets_a_plane(coarse, dropped):
    """By symmetry, with twice the speed."""
    bodies, contact, result = pair(coarse)
    expected = dropped[1].force(dropped[2])
    assert contact.force(result).max() == pytest.approx(expected.max(), rel=2e-3)
    np.testing.assert_allclose(sum(body.momentum(result)[:, :3] for body in bodies), 0, atol=1e-9 * SPEED)
    assert np.ptp(energy_of(bodies, contact, result)) < 1e-4 * bodies[0].energy(result)[0]


def test_a_ball_in_an_elastic_groove_is_hertz_s_ellipse(coarse):
    """Both are a little stiffer than half-spaces, by the order of the contact over their size."""
    bore, speed = 14e-3, SPEED
    block = occ.Box(occ.Pnt(-15e-3, -15e-3, -15e-3), occ.Pnt(15e-3, 15e-3, 3e-3))
    fem = ep.fe_model(
        block - occ.Cylinder(occ.Pnt(-20e-3, 0, bore), occ.X, bore, 40e-3),
        ep.STEEL, maxh=6e-3, refine=[ep.Refine((0, 0, 0), 4e-3, 1e-3)], grading=0.6,
    )  # fmt: skip
    groove = ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 3.5e-3, axes="xyz"), f_cut=100e3)
    mbs = exu.SystemContainer().AddSystem()
    place = {"referencePosition": [0, 0, R + 1e-7], "initialVelocity": [0, 0, -speed]}
    bodies = [ep.CreatePartitionBody(mbs, coarse, **place), ep.CreatePartitionBody(mbs, groove)]
    contact = ep.CreatePartitionContact(mbs, *bodies, formulation="hertz")
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=80e-6, step=0.2e-6)
    point = PointContact((1 / R, 1 / R - 1 / bore), ep.STEEL.plane_strain_modulus / 2)
    mass = ep.hertz.effective(coarse.total_mass, groove.total_mass)
    approach = (1.25 * mass * speed**2 * point.yielding**1.5) ** 0.4
    assert contact.force(result).max() == pytest.approx((approach / point.yielding) ** 1.5, rel=0.025)
    assert np.trapezoid(contact.force(result), result.t) == pytest.approx(2 * mass * speed, rel=1e-3)
    energy = energy_of(bodies, contact, result)
    assert np.ptp(energy) < 1e-4 * energy[0]


def test_a_ball_in_a_groove_touches_each_face_as_a_plane():
    """Two contacts of one body: each is that of a fall on a plane at the speed along its normal, but for 0.8 %."""
    faces = np.array([[1.0, 0.0, -1.0], [-1.0, 0.0, -1.0]]) / math.sqrt(2)
    refine = [ep.Refine(tuple(R * n), 4e-3, 1.1e-3) for n in faces]
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), R), ep.STEEL, maxh=3.5e-3, refine=refine, grading=0.6)
    first, second = (ep.Partition.ball(fem, R * n, 3.8e-3, axes="xyz", direction=n) for n in faces)
    mbs, body = exu.SystemContainer().AddSystem(), ep.reduce(fem, first | second, f_cut=150e3)
    item = ep.CreatePartitionBody(mbs, body, initialVelocity=[0, 0, -SPEED])
    contacts = [
        ep.CreatePartitionContact(mbs, item, ep.RigidPlane((R + 1e-7) * n, -n), formulation="hertz", slavePatch=i)
        for i, n in enumerate(faces)
    ]
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=80e-6, step=0.2e-6)
    peak = ElasticSphere(R, ep.STEEL).impact(SPEED / math.sqrt(2))[0]
    for contact in contacts:
        assert contact.force(result).max() == pytest.approx(peak, rel=1e-2)
        impulse = np.trapezoid(contact.force(result), result.t)
        assert impulse == pytest.approx(math.sqrt(2) * body.total_mass * SPEED, rel=2e-3)
    energy = item.energy(result) + sum(contact.energy(result) for contact in contacts)
    assert np.ptp(energy) < 1e-4 * energy[0]


def test_a_static_press_is_hertz_s(coarse):
    """The depth is Hertz's approach, less what the weight of the ball, spread over it, and friction stiffen."""
    mbs, load = exu.SystemContainer().AddSystem(), 800.0
    ball = ep.CreatePartitionBody(mbs, coarse, gravity=[0, 0, -load / coarse.total_mass])
    contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane((0, 0, -R)), formulation="hertz", friction=MU)
    add_springs(mbs, ball, 1e3 / coarse.total_mass)
    mbs.Assemble()
    result = ep.solve_static(mbs)
    assert contact.force(result)[-1] == pytest.approx(load, rel=1e-4)
    way = -ball.rigid_motion(ball.coordinates(result))[-1, 2]
    hertz = (9 * load**2 / (16 * ep.STEEL.plane_strain_modulus**2 * R)) ** (1 / 3)
    assert way == pytest.approx(hertz, rel=0.035)


@pytest.mark.parametrize("along", [1, 0], ids=["across the groove", "along it"])
def test_an_oblique_impact_in_a_bore_has_the_stiffness_of_its_ellipse(coarse, along):
    """Sticking at first, the ball swings back: on a rigid ball, but for what the elastic one yields beside."""
    bore, sliding = 16e-3, 0.45
    mbs, n = exu.SystemContainer().AddSystem(), np.array([0.0, 0, -1])
    way = np.eye(3)[along]
    velocity = SPEED * n + sliding * way
    ball = ep.CreatePartitionBody(mbs, coarse, frame="floating", initialVelocity=list(velocity))
    hollow = ep.RigidCylinder((0, 0, bore - R - 1e-7), (1, 0, 0), bore, hollow=True)
    contact = ep.CreatePartitionContact(mbs, ball, hollow, formulation="hertz", friction=MU)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=76e-6, step=0.2e-6)
    point = PointContact((1 / R, 1 / R - 1 / bore), ep.STEEL.plane_strain_modulus)
    shear = point.shear_moduli([ep.STEEL])[1 - along]
    slide = rebound(point.sphere, point.modulus, shear, coarse.total_mass, sliding)
    impulse = np.trapezoid(contact.friction.tangential_force(result), result.t, axis=0)
    assert -impulse @ way == pytest.approx(coarse.total_mass / 3.5 * (sliding - slide), rel=0.04)
    assert abs(impulse @ np.cross(way, n)) < 2e-3 * abs(impulse @ way)
    energy = energy_of([ball], contact, result)
    assert np.ptp(energy) < 1e-3 * energy[0]


def test_a_ball_yields_along_the_plane_as_a_whole_sphere_does(coarse):
    """Beyond half-spaces, by vector spherical harmonics; it grows as the contact is smaller, by the log of its size."""
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, coarse)
    contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane((0, 0, -R)), formulation="hertz", friction=MU)
    law, rows = contact.mechanics.law, contact.mechanics.rows
    kept, omega = rows.jacobian(np.zeros(1, dtype=int))[1, : coarse.n_shapes], coarse.basis.omega
    modes = float(np.sum((np.asarray(kept).ravel()[omega > 0] / omega[omega > 0]) ** 2))
    found = [modes + law.beside(force)[0, 0] for force in (10.0, 1000.0)]
    sphere = ElasticSphere(R, ep.STEEL)
    radii = [(0.75 * force * R / ep.STEEL.plane_strain_modulus) ** (1 / 3) for force in (10.0, 1000.0)]
    slope = (sphere.rest(0.02 * R) - sphere.rest(0.04 * R)) / math.log(2)
    expected = [sphere.rest(a) - 0.25 * slope for a in radii]
    np.testing.assert_allclose(found, expected, rtol=0.12)  # 0.5 % of what the contact yields in all


def test_balls_that_slide_past_each_other_keep_momenta_and_energy(coarse):
    """The point of contact wanders by a tenth of the kernel and more, while friction slips."""
    bodies, contact, result = pair(coarse, along=6.0, frame="floating", friction=MU)
    momenta = sum(body.momentum(result) for body in bodies)
    scale = coarse.total_mass * 3.0
    np.testing.assert_allclose(momenta[:, :3], np.tile(momenta[0, :3], (len(momenta), 1)), atol=1e-9 * scale)
    np.testing.assert_allclose(momenta[:, 3:], np.tile(momenta[0, 3:], (len(momenta), 1)), atol=1e-4 * scale * R)
    energy = energy_of(bodies, contact, result)
    assert np.ptp(energy) < 1e-4 * energy[0]
    gaps, q = contact.mechanics.gaps, np.hstack([body.coordinates(result)[::40] for body in bodies[::-1]])
    forward = [gaps.surface_gap(x) for x in q]
    assert forward == [gaps.surface_gap(x) for x in q[::-1]][::-1]  # of the place alone, not of what was asked before
    tangential = np.trapezoid(np.linalg.norm(contact.friction.tangential_force(result), axis=1), result.t)
    assert tangential == pytest.approx(MU * np.trapezoid(contact.force(result), result.t), rel=1e-3)


@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_a_ball_that_slides_is_turned_by_the_force_at_its_surface(coarse, frame):
    """It slips all the time: the tangential impulse is mu times the normal one, and its lever is the radius."""
    ball, contact, result = drop(coarse, (0, 0, -1), sliding=2.0, frame=frame, friction=MU)
    normal = np.trapezoid(contact.force(result), result.t)
    tangential = np.trapezoid(contact.friction.tangential_force(result), result.t, axis=0)
    assert np.linalg.norm(tangential) == pytest.approx(MU * normal, rel=1e-3)
    turned, late = ball.rigid_motion(ball.coordinates(result))[:, 3:], result.t > 66e-6
    spin = np.polyfit(result.t[late], turned[late], 1)[0]
    assert 0.4 * coarse.total_mass * R**2 * np.linalg.norm(spin) == pytest.approx(
        R * np.linalg.norm(tangential), rel=5e-3
    )
    energy = energy_of([ball], contact, result)
    assert np.ptp(energy) < 1e-4 * energy[0]


def test_a_ball_that_hits_a_stiffer_body_slips_towards_the_middle(coarse):
    """Without any tangential motion of the bodies friction takes energy, and the rebound is slower by that."""
    ball, contact, result = drop(coarse, (0, 0, -1), friction=MU)
    taken, energy = contact.dissipated_energy(result), energy_of([ball], contact, result)
    assert np.ptp(energy) < 2e-4 * energy[0]
    assert 3e-4 * energy[0] < taken[-1] < 3e-3 * energy[0]
    assert np.diff(taken).min() > -1e-6 * energy[0]
    assert np.linalg.norm(contact.friction.tangential_force(result), axis=1).max() < 1e-3 * contact.force(result).max()
    _, smooth, without = drop(coarse, (0, 0, -1))
    stiffer = contact.force(result).max() / smooth.force(without).max() - 1
    beta = (1 - 2 * ep.STEEL.nu) / (2 - 2 * ep.STEEL.nu)
    assert 0.0 < stiffer < 0.4 * (beta**2 / 3 + beta**4 / 5)  # of a flat punch that sticks as a whole, after Spence


@pytest.mark.parametrize("friction", [None, MU])
def test_the_tangent_is_the_derivative_of_the_forces(coarse, friction):
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, coarse)
    plane = ep.RigidPlane((0, 0, -R - 1e-7))
    contact = ep.CreatePartitionContact(mbs, ball, plane, formulation="hertz", friction=friction)
    mechanics = contact.mechanics.for_run("implicit")
    q = coarse.rigid @ [1e-6, 0.5e-6, -4e-6, 0, 0, 0]
    mechanics.at(0 * q)
    mechanics.accept(0.0, 1e-6)
    tangent = mechanics.at(q).tangent()
    rng = np.random.default_rng(1)
    for way in rng.normal(size=(3, len(q))) * 1e-10:
        sides = [mechanics.at(q + side * way).generalised for side in (-0.5, 0.5)]
        change = sides[0] - sides[1]
        np.testing.assert_allclose(change, tangent @ way, atol=2e-3 * abs(change).max())


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.ModelLimitWarning")
def test_a_contact_that_is_wide_beside_its_surfaces_is_told(coarse):
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, coarse, initialVelocity=[0, 0, -120.0])
    ep.CreatePartitionContact(mbs, ball, ep.RigidPlane((0, 0, -R - 1e-7)), formulation="hertz")
    mbs.Assemble()
    with pytest.warns(PartitionWarning, match=r"more than 0\.2 of the radius of its surfaces"):
        ep.solve_dynamic(mbs, end_time=10e-6, step=0.1e-6)


def test_rows_that_facets_do_not_resolve_tell_of_hertz_s_law(coarse):
    """Three closed rows too, in the middle of a facet. The radius is that of the true force, but for a tenth."""
    facets = coarse.partition.patches[0].facets[:, :3]
    middles = coarse.points[facets].mean(axis=1)
    middle = middles[np.linalg.norm(middles - [0, 0, -R], axis=1).argmin()]
    n = middle / np.linalg.norm(middle)
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, coarse, initialVelocity=list(SPEED * n))
    contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane((R + 1e-7) * n, -n))
    mbs.Assemble()
    warned = r"By Hertz's law the contact has a radius of 0\.0003\d* m, .* Take formulation='hertz'"
    with pytest.warns(PartitionWarning, match=warned):
        result = ep.solve_dynamic(mbs, end_time=72e-6, step=0.2e-6)
    assert contact.closed_rows(result)[contact.force(result).argmax()] > 2


def test_default_steps_resolve_the_impact_also_with_friction(coarse, dropped):
    """As by rows: the step follows from the rigid masses and the stored energy."""
    expected = dropped[1].force(dropped[2]).max()
    for friction in (None, MU):
        mbs = exu.SystemContainer().AddSystem()
        n = np.array([0.05, 0.03, -1.0]) / np.linalg.norm([0.05, 0.03, -1.0])
        ball = ep.CreatePartitionBody(mbs, coarse, initialVelocity=list(SPEED * n))
        plane = ep.RigidPlane((R + 1e-7) * n, -n)
        contact = ep.CreatePartitionContact(mbs, ball, plane, formulation="hertz", friction=friction)
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=40e-6)
        assert 20 < np.count_nonzero(contact.force(result)) < 1000
        # With friction, the stiffer plane holds the ball's surface, which would move towards the middle.
        assert contact.force(result).max() == pytest.approx(expected, rel=5e-3 if friction is None else 1e-2)


def test_a_point_that_leaves_its_patch_is_told(coarse):
    plate = occ.Box(occ.Pnt(-12e-3, -12e-3, -11e-3), occ.Pnt(12e-3, 12e-3, 0))
    fem = ep.fe_model(plate, ep.STEEL, maxh=6e-3, refine=[ep.Refine((0, 0, 0), 3e-3, 1e-3)], grading=0.7)
    body = ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 3.2e-3, axes="xyz"), f_cut=60e3)
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, coarse, referencePosition=[0, 0, R + 1e-7], initialVelocity=[70.0, 0, -SPEED])
    contact = ep.CreatePartitionContact(mbs, ball, ep.CreatePartitionBody(mbs, body), formulation="hertz")
    mbs.Assemble()
    with pytest.warns(ContactPatchWarning, match="reached the edge of its patch"):
        result = ep.solve_dynamic(mbs, end_time=45e-6, step=0.2e-6)
    assert contact.edge_reached(result)[0] > 5e-6


# What is refused.


def test_what_cannot_be_is_refused_by_name(coarse, ball, rounded):
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, coarse)
    plane = ep.RigidPlane((0, 0, -R - 1e-7))

    def refused(match, master=plane, error=InputError, slave=item, **options):
        with pytest.raises(error, match=match):
            ep.CreatePartitionContact(mbs, slave, master, formulation="hertz", **options)

    refused("has rows='spot'", rows="integrated")
    refused("no interference", interference=1e-6)
    refused("overlap by", ep.RigidPlane((0, 0, -R + 1e-5)), PenetrationError)
    angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    curve = 5e-3 * np.column_stack([np.cos(angle), np.sin(angle)])
    refused("got a RigidProfile", ep.RigidProfile(curve, (0, 0, -R - 6e-3), (0, 1, 0)))
    barrel = ep.RigidCylinder((0, 0, -2 * R), (0, 1, 0), R - 1e-6)
    torus = ep.CreatePartitionBody(mbs, rounded[0], referencePosition=[0.0, 0.0, 0.1])
    refused("two solid cylinders that cross, got a torus and a cylinder", replace(barrel, hollow=True), slave=torus)
    refused("smaller than the bore", ep.RigidCylinder((0, 0, 0), (0, 1, 0), R, hollow=True))
    with pytest.raises(InputError, match="'spot'"):
        ep.CreatePartitionContact(mbs, item, plane, rows="spot")
    partition = ep.Partition.ball(ball[0], (0, 0, 0), 0.4e-3)
    small = ep.CreatePartitionBody(mbs, ep.reduce(ball[0], partition, f_cut=60e3), referencePosition=[0, 0, 1.0])
    refused("does not reach as far", ep.RigidPlane((0, 0, 1.0 - 1e-7)), slave=small)
