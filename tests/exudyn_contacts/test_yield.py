"""Stress beneath contacts after runs, against Hertz; and that first yield is told once, and only beyond it."""

import math
import warnings
from dataclasses import replace

import exudyn as exu
import numpy as np
import pytest
from oracles import SPHERE_RADIUS, box, small_zone

import exudyn_partition as ep
from exudyn_partition.errors import PartitionWarning, YieldWarning

FASTER, SLOWER = 4.0, 1.2  # m/s: three and two facets in the radius of contact


@pytest.fixture(scope="module")
def sphere_body(bodies):
    return bodies[0]


def drop(body, speed, yield_stress=None, rows="integrated"):
    """The sphere on a rigid plane until after the peak of its force."""
    mbs = exu.SystemContainer().AddSystem()
    body = replace(body, material=replace(ep.STEEL, yield_stress=yield_stress))
    item = ep.CreatePartitionBody(mbs, body, name="ball", initialVelocity=[0, 0, -speed])
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), rows=rows, name="floor")
    mbs.Assemble()
    return mbs, contact, hertz(body, speed, yield_stress)


def hertz(body, speed, yield_stress=None):
    material = replace(ep.STEEL, yield_stress=yield_stress)
    return ep.hertz.impact(body.total_mass, speed, SPHERE_RADIUS, math.inf, material)


def run(mbs, expected):
    return ep.solve_dynamic(mbs, end_time=0.6 * expected.duration)


@pytest.mark.parametrize("speed", [FASTER, SLOWER])
@pytest.mark.parametrize("rows", ["integrated", "node-to-segment"])
def test_the_largest_pressure_is_hertz_s(sphere_body, speed, rows):
    """From force and radius of the sphere: p0 = (6 P E*^2 / (pi^3 R^2))^(1/3), first yield at p0 = 1.61 Y."""
    mbs, contact, expected = drop(sphere_body, speed, 1e9, rows)
    with small_zone():
        result = run(mbs, expected)
    found = contact.largest_stress(result)
    force, modulus = contact.force(result).max(), ep.STEEL.plane_strain_modulus
    assert found.force == pytest.approx(force, rel=0.02)
    assert contact.force(result)[result.t == found.time] == found.force
    pressure = (6 * force * modulus**2 / (math.pi**3 * SPHERE_RADIUS**2)) ** (1 / 3)
    assert found.pressure == pytest.approx(pressure, rel=0.05)
    radius = (3 * force * SPHERE_RADIUS / (4 * modulus)) ** (1 / 3)
    np.testing.assert_allclose(found.semi_axes, radius, rtol=0.04)
    assert found.yield_ratio == pytest.approx(pressure / 1.613e9, rel=0.05)
    assert found.yield_force == pytest.approx(expected.yield_force, rel=0.15)
    assert not found.flat


def test_first_yield_is_told_once_and_only_beyond_it(sphere_body):
    limit = hertz(sphere_body, FASTER, 1e9).stress.von_mises[0]
    mbs, contact, expected = drop(sphere_body, FASTER, limit / 1.5)
    message = (
        r"contact 'floor' at t = .*: the von Mises stress of body 'ball' reaches .* 1\.[56]\d* times the yield stress"
    )
    with pytest.warns(YieldWarning, match=message) as caught:
        result = run(mbs, expected)
    assert len(caught) == 1
    assert all(word in str(caught[0].message) for word in ("begins to yield at", "Reduce", "yield_stress="))
    with pytest.warns(YieldWarning, match=message):
        ep.collect(mbs)
    assert any("(yield_stress= of Material tells of it)" in said for said in contact.slave.left_out)
    for yield_stress in (1.1 * limit, None):
        mbs, contact, expected = drop(sphere_body, FASTER, yield_stress)
        with warnings.catch_warnings():
            warnings.simplefilter("error", PartitionWarning)
            result = run(mbs, expected)
    assert any("(yield_stress= of Material would tell of it)" in said for said in contact.slave.left_out)
    assert contact.largest_stress(result).yield_ratio is None
    ((_, said),) = contact.largest_stress(result).by_body(contact.side_names)
    assert said.endswith("MPa, no yield stress is known")


def test_a_contact_that_never_closes_has_no_stress(sphere_body):
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, sphere_body, referencePosition=[0, 0, 1e-5])
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane())
    mbs.Assemble()
    assert contact.largest_stress(ep.solve_dynamic(mbs, end_time=1e-6)) is None


def test_the_end_of_a_bar_is_stressed_by_its_mean_pressure(mbs):
    fem = ep.fe_model(box(4e-3, 4e-3, 4e-3), replace(ep.ALUMINIUM, yield_stress=1e6), maxh=4e-3)
    body = ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 3.5e-3), f_cut=100e3)
    item = ep.CreatePartitionBody(mbs, body, name="bar", initialVelocity=[0, 0, -0.1])
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane())
    mbs.Assemble()
    with pytest.warns(YieldWarning, match="stress of body 'bar' .*the mean pressure"):
        result = ep.solve_dynamic(mbs, end_time=6e-6)
    stress = contact.largest_stress(result)
    assert stress.flat
    assert stress.von_mises[0] == pytest.approx(contact.force(result).max() / 16e-6, rel=1e-3)


def test_bodies_of_before_there_was_a_yield_stress(sphere_body, tmp_path):
    """Such files are read as they are; so are runs of their bodies."""
    old = replace(sphere_body, material=None)
    old.save(tmp_path / "old.npz")
    read = ep.load_body(tmp_path / "old.npz")
    assert read.material is None
    assert any("would tell" in said for said in read.left_out)
    known = replace(sphere_body, material=replace(ep.STEEL, yield_stress=1e9))
    known.save(tmp_path / "new.npz")
    assert ep.load_body(tmp_path / "new.npz").material == known.material
    models = []
    for body in (read, known):
        mbs = exu.SystemContainer().AddSystem()
        item = ep.CreatePartitionBody(mbs, body, initialVelocity=[0, 0, -SLOWER])
        contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane())
        mbs.Assemble()
        models.append((mbs, contact))
    (mbs, contact), (other, _) = models
    result = ep.solve_dynamic(mbs, end_time=4e-6)
    assert contact.largest_stress(result).von_mises == (None,)
    result.save(tmp_path / "run.npz")
    assert ep.Result.load(tmp_path / "run.npz", other).steps == result.steps
