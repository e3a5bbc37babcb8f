"""Default steps that resolve contacts, when contacts start and end, and contacts that nothing resolves."""

import re

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
from oracles import MARBLE_RADIUS
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.errors import ModelLimitWarning
from exudyn_partition.prediction.default_step import resolving_step

RIGID = ep.Material(E=1e25, nu=0.3, rho=1.0)


def on_a_plane(body, speed, gap=0.0, drop=0.0, **options):
    """A body that flies onto a rigid plane: model, body, contact. With `drop` it falls from rest, from that height."""
    mbs = exu.SystemContainer().AddSystem()
    motion = {"gravity": [0, 0, -(speed**2) / (2 * drop)]} if drop else {"initialVelocity": [0, 0, -speed]}
    item = ep.CreatePartitionBody(mbs, body, referencePosition=[0, 0, gap + drop], **motion)
    patch = {"slavePatch": 0} if len(body.partition.patches) > 1 else {}
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), **patch, **options)
    mbs.Assemble()
    return mbs, item, contact


@pytest.fixture(scope="module")
def large_sphere():
    """An aluminium sphere of 0.1 m, and Hertz's impact at 0.2 m/s on a rigid plane."""
    R, speed = 0.1, 0.2
    shape = occ.Sphere(occ.Pnt(0, 0, R), R)
    mass = 4 / 3 * np.pi * R**3 * ep.ALUMINIUM.rho
    hertz = ep.hertz.impact(mass, speed, R, np.inf, ep.ALUMINIUM, RIGID)
    a = hertz.contact_radius
    fem = ep.fe_model(shape, ep.ALUMINIUM, maxh=0.4 * R, refine=[ep.Refine((0, 0, 0), 1.2 * a, a / 3)], grading=0.5)
    part = ep.Partition.ball(fem, (0, 0, 0), 1.6 * a)
    return ep.reduce(fem, part, basis="contact-adapted", tolerance=1e-2, speed=speed), hertz, speed


@pytest.mark.parametrize("way", ["explicit", "implicit", "dropped"])
def test_the_default_step_and_the_surface_tell_how_long_a_contact_lasts(large_sphere, way):
    """f_cut, far below the contact's own frequency, would take 29 steps, and mean gaps close a step late."""
    body, hertz, speed = large_sphere
    dropped = way == "dropped"
    gap = 1e-6
    mbs, item, contact = on_a_plane(body, speed, gap=0.0 if dropped else gap, drop=5e-3 * dropped)
    start = 0.01 / speed if dropped else gap / speed
    result = ep.solve_dynamic(mbs, end_time=start + 1e-3, method="explicit" if dropped else way)
    (impact,) = contact.impacts(result)
    assert impact.start == pytest.approx(start, abs=0.003 * hertz.duration)
    assert impact.end - impact.start == pytest.approx(hertz.duration, rel=0.016)
    assert impact.peak == pytest.approx(hertz.peak_force, rel=0.03)
    assert 28 < hertz.duration / result.step < 45  # no more than it takes
    energy = item.energy(result) + contact.energy(result)
    if not dropped:
        assert abs(energy[-1] / energy[0] - 1) < 2e-3


def test_the_default_step_does_not_depend_on_the_frame():
    """Pairs that follow the motion are few at the start, but a deep impact closes more: the ball is not flat."""
    bodies, R = [], 0.01
    for shape, side in ((occ.Sphere(occ.Pnt(0, 0, R), R), -1), (occ.Box((-R, -R, -R), (R, R, 0)), 1)):
        fem = ep.fe_model(shape, ep.STEEL, maxh=0.5 * R, refine=[ep.Refine((0, 0, 0), 0.5e-3, 0.15e-3)], grading=0.6)
        part = ep.Partition.ball(fem, (0, 0, 0), 0.6e-3 if side < 0 else 0.75e-3, direction=(0, 0, side))
        bodies.append(ep.reduce(fem, part, f_cut=20e3))
    steps = []
    for frame in ("inertial", "floating"):
        mbs = exu.SystemContainer().AddSystem()
        ball = ep.CreatePartitionBody(mbs, bodies[0], frame=frame, initialVelocity=[0, 0, -1])
        ep.CreatePartitionContact(mbs, ball, ep.CreatePartitionBody(mbs, bodies[1], frame=frame))
        mbs.Assemble()
        steps.append(ep.solve_dynamic(mbs, end_time=12e-6, method="implicit").step)
    assert steps[1] == pytest.approx(steps[0], rel=0.1)


def test_contact_times_do_not_depend_on_the_step(large_sphere):
    """Forces begin with the first mean gap, the contact with the lowest point."""
    body, hertz, speed = large_sphere
    times = []
    for step in (25e-6, 2.5e-6):
        mbs, _, contact = on_a_plane(body, speed, gap=1e-6)
        result = ep.solve_dynamic(mbs, end_time=1e-3, step=step)
        (impact,) = contact.impacts(result)
        times.append((impact.start, impact.end))
        first, last = contact.closed_samples(result)[0]
        assert impact.start < result.t[first]
        assert impact.end > result.t[last]
    np.testing.assert_allclose(times[0], times[1], atol=0.003 * hertz.duration)


def test_start_end_and_speeds_are_of_the_same_instants(large_sphere):
    """It falls a little, so that it is much faster when its first mean gap closes than when it touches."""
    body, _, _ = large_sphere
    drop, speed = 1e-7, 0.01
    mbs, item, contact = on_a_plane(body, speed, drop=drop)
    result = ep.solve_dynamic(mbs, end_time=2e-3, step=1e-6)
    impact = contact.impacts(result)[0]
    velocity, force = item.momentum(result)[:, 2] / body.total_mass, contact.force(result)
    assert velocity[np.flatnonzero(force)[0]] < -1.1 * speed
    assert impact.start == pytest.approx(2 * drop / speed, rel=1e-3)
    assert impact.speed_before == pytest.approx(speed, rel=1e-3)
    assert impact.speed_after == pytest.approx(np.interp(impact.end, result.t, velocity), rel=1e-4)


def test_a_contact_of_one_row_says_so(marble):
    """Slowly, the marble touches with less than a facet."""
    mbs, _, contact = on_a_plane(marble, 0.005, gap=MARBLE_RADIUS, name="slow")
    with pytest.warns(
        ModelLimitWarning, match=r"contact 'slow' .*: 1 of \d+ rows is closed at the peak .* [Rr]efine the mesh there"
    ):
        result = ep.solve_dynamic(mbs, end_time=150e-6)
    assert contact.closed_rows(result).max() == 1
    stiff = 4 / 3 * ep.STEEL.plane_strain_modulus * np.sqrt(MARBLE_RADIUS)
    peak = stiff * (1.25 * marble.total_mass * 0.005**2 / stiff) ** 0.6
    assert contact.force(result).max() > 1.1 * peak  # what is warned of


@pytest.mark.filterwarnings("ignore:.* with no closed row around")
def test_a_narrow_stop_that_sinks_between_rows_says_how_deep(mbs, block, top):
    """A rigid ball smaller than the facets of a face: the first mean gap closes long after the touch."""
    radius, gap, speed = 2e-3, 1e-5, 2.0
    item = ep.CreatePartitionBody(mbs, ep.reduce(block, top, f_cut=50e3), initialVelocity=[0, 0, speed])
    ball = ep.RigidSphere((0, 0, 0.03 + radius + gap), radius)
    contact = ep.CreatePartitionContact(mbs, item, ball, name="stop")
    mbs.Assemble()
    with pytest.warns(ModelLimitWarning, match=r"contact 'stop' .*comes too late by that way") as caught:
        result = ep.solve_dynamic(mbs, end_time=0.4e-3, step=0.5e-6)
    late = result.t[contact.force(result) > 0][0] - gap / speed
    told = next(
        found for one in caught if (found := re.search(r"lay ([-.e\d]+) m within each other", str(one.message)))
    )
    assert float(told[1]) == pytest.approx(speed * late, rel=0.02)


@pytest.fixture(scope="module", params=["cube", "block", "disc"])
def flat(request):
    """A steel body with its whole lower face as a patch, and the time from its touch until it has left the plane."""
    low, side = occ.Pnt(-5e-3, -5e-3, 0), 5e-3
    height = {"cube": 10e-3, "block": 30e-3, "disc": 6e-3}[request.param]
    shape, reach = occ.Box(low, occ.Pnt(side, side, height)), 7.2e-3
    if request.param == "disc":
        shape, reach = occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, r=side, h=height), 5.2e-3
    fem = ep.fe_model(shape, ep.STEEL, maxh=4e-3)
    part = ep.Partition.ball(fem, (0, 0, 0), reach, direction=(0, 0, -1))
    return ep.reduce(fem, part, f_cut=60e3), 1.2e-3 * height


@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_a_whole_flat_face_keeps_its_energy_at_the_default_step(flat, method):
    """All rows close and open within a step; its phase decides what that adds or takes."""
    body, lasts = flat
    step, speed = 0.0, 0.1
    for phase in (0.0, 0.3, 0.6, 0.9):
        mbs, item, contact = on_a_plane(body, speed, gap=1e-7 + phase * step * speed)
        result = ep.solve_dynamic(mbs, end_time=4e-6 + lasts, method=method)
        step = result.step
        energy, force = item.energy(result) + contact.energy(result), contact.force(result)
        assert force[-1] == 0
        assert abs(energy[-1] / energy[0] - 1) < 1e-3
        assert np.count_nonzero(force) >= 32


def test_a_face_that_is_a_little_aslant_keeps_its_energy(flat):
    """Its rows close within two steps."""
    body, lasts = flat
    mbs = exu.SystemContainer().AddSystem()
    tilt = Rotation.from_rotvec([0, 7e-7, 0]).as_matrix()
    options = {"referenceRotationMatrix": tilt, "initialVelocity": [0, 0, -0.1], "frame": "floating"}
    item = ep.CreatePartitionBody(mbs, body, referencePosition=[0, 0, 1e-7], **options)
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane())
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=4e-6 + lasts)
    energy = item.energy(result) + contact.energy(result)
    assert contact.force(result)[-1] == 0
    assert abs(energy[-1] / energy[0] - 1) < 1e-3


@pytest.mark.parametrize("rows", [4, 50])
def test_rows_that_close_at_once_change_no_more_energy_than_the_step_is_chosen_for(rows):
    """A mass on equal springs by central differences, over all phases, against the energy before."""
    mass, stiffness, speed = 0.3, 2e8 / rows, 0.7

    def press(gap):
        return 0.5 * stiffness * float(np.minimum(gap, 0.0) @ np.minimum(gap, 0.0)), np.count_nonzero(gap < 0)

    step = resolving_step(
        np.zeros(rows), np.full(rows, -speed), lambda _: 1 / mass, press, size=1e-3, limit=lambda: np.inf
    )
    changes = []
    for phase in np.linspace(0, 1, 41):
        x, v = phase * speed * step, -speed
        for _ in range(200):
            v -= 0.5 * step * rows * stiffness * min(x, 0.0) / mass
            x += step * v
            v -= 0.5 * step * rows * stiffness * min(x, 0.0) / mass
        assert x > 0
        changes.append((v / speed) ** 2 - 1)
    assert 4e-4 < max(map(abs, changes)) < 8e-4  # shorter steps would be spent for nothing
