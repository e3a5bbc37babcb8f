"""Slips of units that leave each number plausible by itself are warned of, and what is plausible is not."""

from dataclasses import replace

import exudyn as exu
import numpy as np
import pytest
from oracles import box

import exudyn_partition as ep
from exudyn_partition.errors import UnitsWarning

MM_T_S = ep.Material(E=210e3, nu=0.3, rho=7.8e-9)
MM_KG_MS = ep.Material(E=210.0, nu=0.3, rho=7.8e-6)
MM_KG_S = ep.Material(E=210e6, nu=0.3, rho=7.8e-6)
MM_G_S = ep.Material(E=210e9, nu=0.3, rho=7.8e-3)
FOAM = ep.Material(E=20.0, nu=0.3, rho=2e-11)  # 20 kg/m3, in mm, t and s
SIZE = np.array([10.0, 10.0, 40.0])  # mm


def block(material, scale):
    return ep.fe_model(box(*(scale * SIZE)), material, maxh=20 * scale)


@pytest.mark.parametrize("material", [MM_T_S, MM_KG_MS, MM_KG_S, MM_G_S, FOAM])
def test_a_material_in_millimetres_on_a_geometry_in_metres(material):
    assert material.in_millimetres
    with pytest.warns(UnitsWarning, match=r"the body is 0\.04 long .* solid in millimetres.*scale it by 1e3") as caught:
        block(material, 1e-3)
    assert (len(caught), caught[0].filename) == (1, __file__)
    block(material, 1.0)  # without a warning


@pytest.mark.parametrize(
    "material",
    [ep.STEEL, ep.ALUMINIUM, ep.Material(E=1e6, nu=0.4, rho=30.0), ep.Material(E=1.0, nu=0.3, rho=1.0)],
    ids=["steel", "aluminium", "foam", "without dimensions"],
)
def test_materials_in_si_or_without_dimensions_are_no_such(material):
    assert not material.in_millimetres
    block(material, 1e-3)


@pytest.fixture(scope="module")
def body():
    fem = block(ep.STEEL, 1e-3)
    return ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 8e-3, direction=(0, 0, -1)), f_cut=90e3)


def created(body, **options):
    mbs = exu.SystemContainer().AddSystem()
    return mbs, ep.CreatePartitionBody(mbs, body, initialVelocity=[0, 0, -1], **options)


@pytest.mark.parametrize(
    ("damping", "said"),
    [
        (2.0, "a ratio of 2, above 1"),
        (lambda f: np.where(f > f.min(), 3.0, 0.01), "a ratio of 3, above 1"),
        (ep.Rayleigh(beta=1e-3), "the ratios of all modes, from .*, above 1"),
    ],
    ids=["one", "of some", "Rayleigh"],
)
def test_damping_in_per_cent(body, damping, said):
    with pytest.warns(UnitsWarning, match=f"damping: {said}.* 2 % are 0.02") as caught:
        created(body, damping=damping)
    assert (len(caught), caught[0].filename) == (1, __file__)


def test_plausible_damping(body):
    """Rayleigh damping may hold high modes still."""
    omega = body.basis.omega[6:]
    assert omega.max() > 2 * omega.min()
    for damping in (0.02, 1.0, lambda f: 0.3 + 0 * f, ep.Rayleigh(beta=1.0 / omega.min())):
        created(body, damping=damping)


def test_gravity_of_the_earth_in_other_units(body):
    with pytest.warns(UnitsWarning, match=r"gravity: 9810 is that of the earth in mm/s2, .* expected 9\.81 there"):
        created(body, gravity=[0, 0, -9810])
    in_mm = replace(body, material=MM_T_S)
    with pytest.warns(UnitsWarning, match=r"gravity: 9\.81 is that of the earth in m/s2, .* expected 9810 there"):
        created(in_mm, gravity=[0, 0, -9.81])
    for one, gravity in ((body, 9.81), (body, 5000.0), (body, 9.5e3), (in_mm, 9810.0), (in_mm, 1.0)):
        created(one, gravity=[0, gravity, 0])


AWAY = {
    "plane": ep.RigidPlane((0, 0, -5.0)),
    "sphere": ep.RigidSphere((0, 0, -40.0), 10.0),
    "cylinder": ep.RigidCylinder((0, 0, -12.0), (1, 0, 0), 10.0),
}


def fall(body, surface, end_time=20e-6, **options):
    mbs, item = created(body, **options)
    ep.CreatePartitionContact(mbs, item, surface, name="floor")
    mbs.Assemble()
    return ep.solve_dynamic(mbs, end_time=end_time, step=0.5e-6)


@pytest.mark.parametrize("name", AWAY)
def test_a_rigid_surface_metres_away(body, name):
    with pytest.warns(UnitsWarning, match=r"contact 'floor' never closed: .* m away .* in millimetres\?") as caught:
        result = fall(body, AWAY[name])
    assert len(caught) == 1
    assert caught[0].filename == __file__
    assert any("in millimetres" in said for said in result.warnings)


def test_another_body_metres_away(body):
    mbs, upper = created(body, name="upper")
    lower = ep.CreatePartitionBody(mbs, body, frame="floating", referencePosition=[0, 0, -4.0],
                                   referenceRotationMatrix=np.diag([1.0, -1, -1]))  # fmt: skip
    ep.CreatePartitionContact(mbs, upper, lower)
    mbs.Assemble()
    with pytest.warns(UnitsWarning, match=r"never closed: its slave's patch was 4 m away"):
        ep.solve_dynamic(mbs, end_time=20e-6, step=0.5e-6)


def test_surfaces_that_are_near_or_come_nearer_are_right(body):
    fall(body, ep.RigidPlane((0, 0, -0.5)))
    mbs, item = created(body, gravity=[0, 0, -9.81])
    ep.CreatePartitionContact(mbs, item, ep.RigidPlane((0, 0, -1.0)))
    mbs.Assemble()
    ep.solve_dynamic(mbs, end_time=20e-3, step=0.1e-3, method="implicit")


@pytest.mark.parametrize("name", ["radius", "plastic_radius"])
def test_a_region_far_larger_than_the_body(name):
    fem = block(replace(ep.STEEL, hardening=0.0), 1e-3)
    radii = {"radius": 8e-3, name: 8.0}
    with pytest.warns(UnitsWarning, match=rf"{name}: 8 m is .* times the size of the body") as caught:
        ep.Partition.ball(fem, (0, 0, 0), **radii)
    assert (len(caught), caught[0].filename) == (1, __file__)
    ep.Partition.ball(fem, (0, 0, 0), **{**radii, name: 0.1})
    ep.Partition.ball(fem, (0, 0, 0), 8.0, contact_radius=8e-3, plastic_radius=0.1)  # for all nodes
