"""From shapes to bodies: the promise beside Hertz, what is told, and what is refused."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
import scipy.optimize
import scipy.special
from oracles import SPHERE_MATERIAL, relative

import exudyn_partition as ep
from exudyn_partition.accuracy.contact_place import contact_place, sides_of
from exudyn_partition.accuracy.design_search import Search
from exudyn_partition.accuracy.impact_scene import Scene, first_circle
from exudyn_partition.accuracy.mesh_rules import Sizes, count_of_dofs, first_sizes
from exudyn_partition.errors import (
    EmptyRegionError,
    InputError,
    InvertedElementsError,
    MemoryLimitError,
    MeshError,
    ToleranceWarning,
)

RADIUS, SPEED, TOLERANCE = 5e-3, 0.3, 0.05
BALL = occ.Sphere(occ.Pnt(0, 0, RADIUS), RADIUS)
MASS = SPHERE_MATERIAL.rho * 4 / 3 * np.pi * RADIUS**3
HERTZ = ep.hertz.impact(MASS, SPEED, RADIUS, np.inf, SPHERE_MATERIAL)
END = 1.3 * HERTZ.duration


def designed(**options):
    options = {"speed": SPEED, "contact": (0, 0, 0), "tolerance": TOLERANCE, "duration": END} | options
    return ep.design_impact((BALL, SPHERE_MATERIAL), ep.RigidPlane(), **options)


@pytest.fixture(scope="module")
def design():
    return designed()


@pytest.fixture(scope="module")
def corrected():
    return designed(correct=True)


@pytest.mark.parametrize("name", ["design", "corrected"])
def test_a_ball_on_a_rigid_plane_is_hertz_within_the_tolerance(name, request):
    """A ball is no half-space: Hertz himself is off by less than the tolerance here."""
    design = request.getfixturevalue(name)
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, design.bodies[0], initialVelocity=[0, 0, -SPEED])
    contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), passes="given")
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=END, step=design.step)
    exact = np.interp(result.t, HERTZ.t, HERTZ.force, right=0.0)
    assert relative(contact.force(result), exact) < TOLERANCE
    assert design.look.peak == pytest.approx(HERTZ.peak_force, rel=TOLERANCE)
    assert design.look.circle == pytest.approx(HERTZ.contact_radius, rel=TOLERANCE)


def barrel(radius, crown, half):
    """A body of revolution about a line along y at z = radius, whose sides are arcs of `crown` and touch the origin."""
    drop = crown - np.sqrt(crown**2 - half**2)
    corners = [occ.Pnt(0, y, z) for y, z in ((-half, radius), (-half, drop), (0, 0), (half, drop), (half, radius))]
    sides = occ.Segment(*corners[:2]), occ.ArcOfCircle(*corners[1:4]), occ.Segment(*corners[3:])
    face = occ.Face(occ.Wire([*sides, occ.Segment(corners[4], corners[0])]))
    return face.Revolve(occ.Axis(occ.Pnt(0, 0, radius), occ.Y), 360)


def of_an_ellipse(low, high, modulus):
    """Force over approach^1.5 of Hertz's ellipse, and the ratio of its axes, by elliptic integrals.

    Johnson, Contact Mechanics, eq. 4.26 and 4.28; `low` and `high` are relative curvatures [1/m].
    """

    def integrals(short):
        m = 1 - short**2
        return m, scipy.special.ellipk(m), scipy.special.ellipe(m)

    def off(short):
        _, K, E = integrals(short)
        return (E / short**2 - K) / (K - E) - high / low

    short = scipy.optimize.brentq(off, 0.02, 1 - 1e-9)
    m, K, E = integrals(short)
    F1_cubed = 4 / (np.pi * m) * short**1.5 * np.sqrt((E / short**2 - K) * (K - E))
    # a = long axis: (a^2 short)^1.5 = 3 P Re / (4 E*) F1^3, approach = 3 P K / (2 pi a E*)
    a_cubed = 3 / (4 * modulus * np.sqrt(low * high)) * F1_cubed / short**1.5  # by P
    return (2 * np.pi * a_cubed ** (1 / 3) * modulus / (3 * K)) ** 1.5, 1 / short


def test_a_barrel_on_a_rigid_plane_is_hertz_with_an_ellipse_and_its_patch_is_one():
    """A long contact, 4.5 : 1; the barrel counts as rigid beside its contact, as Hertz assumes."""
    radius, crown, speed = 6e-3, 60e-3, 0.3
    shape = barrel(radius, crown, 8e-3)
    stiffness, ratio = of_an_ellipse(1 / crown, 1 / radius, SPHERE_MATERIAL.plane_strain_modulus)
    mass = SPHERE_MATERIAL.rho * shape.mass
    approach = (1.25 * mass * speed**2 / stiffness) ** 0.4
    end = 3.8 * approach / speed
    design = ep.design_impact(
        (shape, SPHERE_MATERIAL), ep.RigidPlane(), speed=speed, contact=(0, 0, 0), tolerance=TOLERANCE, duration=end
    )
    assert design.look.peak == pytest.approx(stiffness * approach**1.5, rel=TOLERANCE)
    (fem,), (partition,) = design.fems, design.partitions
    (patch,) = partition.patches
    assert abs(design.place.along[1]) == pytest.approx(1, abs=1e-3)
    long, short = design.place.semi_axes(design.look.circle)
    assert long / short == pytest.approx(ratio, rel=0.03)
    x, y = abs(fem.points[patch.facets[:, :3]].mean(axis=1)[:, :2]).T
    across, along = (1.5 * axis + design.look.sizes[0].near / 2 for axis in (short, long))
    assert ((x / across) ** 2 + (y / along) ** 2).max() < 1.1**2  # a first look gave the semi-axes, nearly
    assert y.max() > 1.25 * long > 2 * x.max()


def test_the_tolerance_is_for_force_and_whole_bodies(design):
    """Momentum: the velocity of the whole ball is the impulse over its mass, so its error follows the force's."""
    look = design.look
    assert look.error == max(look.force, look.mean_velocity)
    assert look.truncation.mean_velocity <= look.truncation.velocity
    assert look.mesh.mean_velocity <= look.mesh.force
    (ball,) = design.bodies
    assert ball.estimate == look.truncation
    assert ball.estimate.error == max(ball.estimate.force, ball.estimate.mean_velocity)


@pytest.fixture(scope="module")
def fine():
    return designed(tolerance=0.02)


def test_round_sides_miss_no_more_volume_than_their_share(fine):
    """Meshes are made anew until they do, so that no reduction is spent on them; the first look may miss more."""
    first, *others = fine.looks
    assert first.missed[0] > 0.002
    assert all(look.missed[0] < 0.1 * 1.25 * 0.02 for look in others)


def test_step_and_truncation_leave_most_of_the_tolerance_to_the_meshes(fine):
    """Steps and a few modes cost less than the smaller elements that their error would ask for."""
    assert fine.look.step_error < 0.05 * 0.02
    assert fine.look.truncation.error < 0.27 / 1.5 * 0.02


def test_later_meshes_take_the_truncation_of_the_first_look(design):
    """Bodies are then no richer than they must be: what the first look's richer ones told stays the estimate."""
    first, *others = design.looks
    assert first.truncation.limit == ""
    for look in others:
        assert look.truncation.f_cut == first.truncation.f_cut == design.bodies[0].f_cut
        assert look.truncation.velocity == first.truncation.velocity


def test_a_corrected_ball_is_softer(corrected):
    """A mesh is too stiff: functions of one order more make it softer."""
    (fem,), (partition,), (ball,) = corrected.fems, corrected.partitions, corrected.bodies
    given = ep.reduce(fem, partition, f_cut=50e3)  # no mode of the ball lies below
    assert ball.basis.flexibility.trace() > given.basis.flexibility.trace()


def test_what_a_design_says_of_itself(design):
    mesh, truncation = design.look.mesh, design.look.truncation
    assert (len(design.fems), len(design.bodies), design.limit) == (1, 1, "")
    (missed,) = design.look.missed
    parts = max(mesh.force + truncation.force, mesh.mean_velocity + truncation.mean_velocity)
    assert design.error == pytest.approx(parts + missed, rel=1e-12)
    assert missed == pytest.approx(1 - design.fems[0].total_mass / MASS, rel=1e-6)
    assert design.error <= TOLERANCE / 1.25
    assert truncation.against == "the rigid surface"
    assert design.look.step_error <= truncation.force + 1e-3
    assert design.fems[0].n_dofs == design.look.dofs[0]
    assert design.seconds["reduce"] == pytest.approx(sum(look.seconds["reduce"] for look in design.looks))
    table = str(design)
    for text in (f"{design.error:.2%}", f"{mesh.force:.2%}", "contact radius", "asked for 5.00%, reached", "order 3"):
        assert text in table


def test_a_limit_is_named_and_the_best_design_returned():
    with pytest.warns(ToleranceWarning, match=r"tolerance: 0\.01 cannot be promised; .* limits it is max_dofs: 6500"):
        design = designed(tolerance=0.01, max_dofs=6500)
    assert design.error > 0.01 / 1.25
    assert sum(design.look.dofs) <= 6500
    assert "not reached" in str(design)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"speed": 0}, InputError, "speed: expected a finite number above zero"),
        ({"speed": -1.0}, InputError, "speed: expected a finite number above zero"),
        ({"tolerance": 1e-4}, InputError, r"tolerance: expected 0\.002 to 0\.2, got 0\.0001"),
        ({"tolerance": 0.5}, InputError, r"tolerance: expected 0\.002 to 0\.2"),
        ({"contact": (0, 0, 2e-3)}, EmptyRegionError, "contact: the first shape is 0.002 m away"),
        ({"contact": (0, 0)}, InputError, "contact: expected shape"),
        ({"max_dofs": 1000}, MemoryLimitError, "max_dofs: 1000, and the meshes that are needed next have"),
        ({"scale": 0}, InputError, "scale: expected"),
    ],
)
def test_wrong_calls_are_named(options, error, message):
    with pytest.raises(error, match=message):
        designed(**options)


def test_what_is_no_body_is_named(tmp_path):
    options = {"speed": SPEED, "contact": (0, 0, 0)}
    with pytest.raises(InputError, match=r"first: expected \(shape or path of a STEP file, ep.Material\), got"):
        ep.design_impact(BALL, ep.RigidPlane(), **options)
    with pytest.raises(InputError, match=r"second: expected .*, or a RigidPlane, RigidSphere or RigidCylinder, got"):
        ep.design_impact((BALL, ep.STEEL), (ep.STEEL, BALL), **options)
    plastic = ep.Material(E=210e9, nu=0.3, rho=7850, yield_stress=355e6, hardening=0)
    with pytest.raises(InputError, match="first: its material has hardening="):
        ep.design_impact((BALL, plastic), ep.RigidPlane(), **options)
    with pytest.raises(InputError, match=r"there is none at .*rod\.step"):
        ep.design_impact((tmp_path / "rod.step", ep.STEEL), ep.RigidPlane(), **options)
    with pytest.raises(InputError, match=r"first: expected a file of STEP, IGES or BREP \(\.step, .*\), got rod\.vtu"):
        ep.design_impact(("rod.vtu", ep.STEEL), ep.RigidPlane(), **options)


def test_a_later_mesh_that_fails_leaves_the_best_design(design, monkeypatch):
    """The first look and one design are made; what comes next cannot be meshed."""
    done = iter([replace(design.look, mesh=None), design.look])

    def look(search, *_, **__):
        try:
            now = next(done)
        except StopIteration:
            raise MeshError("maxh: Netgen made no mesh") from None
        search.looks.append(now)
        search.models = {0: (now.sizes[0], now.circle, (design.fems[0], design.partitions[0]))}
        search.best = None if now.mesh is None else design
        return now

    monkeypatch.setattr(Search, "look_at", look)
    with pytest.warns(ToleranceWarning, match="limits it is maxh: Netgen made no mesh"):
        found = designed(tolerance=0.5 * design.error)
    assert found.bodies == design.bodies
    assert len(found.looks) == 2


def test_meshes_change_even_if_each_part_of_the_error_is_small(design):
    """Else the same meshes would be tried until there are six."""
    small = replace(design.look.mesh, far=(1e-4,), local=(1e-4,))
    look = replace(design.look, mesh=small, truncation=replace(design.look.truncation, limit=""))
    search = Search(SimpleNamespace(tolerance=TOLERANCE), END)
    search.models = {0: (look.sizes[0], look.circle, (design.fems[0], design.partitions[0]))}
    assert search.refined(look)[0].near < look.sizes[0].near


def test_an_error_between_promise_and_tolerance_is_told(design):
    beyond = replace(design, limit="max_dofs", tolerance=1.1 * design.error)
    assert f"not promised: must be below {1.1 * design.error / 1.25:.2%}" in str(beyond)


@dataclass(frozen=True, eq=False)
class UnluckyScene(Scene):
    """Its first meshes cannot be used, as some of Netgen's have an element without volume."""

    sizes: list = field(default_factory=list)  # of elements that were tried
    error: type = InvertedElementsError

    def model(self, i, mesh, sizes, circle):
        self.sizes.append(sizes.far)
        if len(self.sizes) < 4:
            raise self.error("1 of 2747 elements are inverted or have no volume")
        return super().model(i, mesh, sizes, circle)


@pytest.fixture
def unlucky():
    place = contact_place((BALL,), ep.RigidPlane(), np.zeros(3), lambda radius: 0.05 * radius)
    return UnluckyScene((BALL,), (SPHERE_MATERIAL,), ep.RigidPlane(), place, SPEED, TOLERANCE, 100_000)


def test_a_mesh_that_has_another_fault_is_not_made_again(unlucky):
    scene = replace(unlucky, error=MeshError)
    with pytest.raises(MeshError):
        Search(scene, END).make_model(0, Sizes(2, 3e-3, 0.5e-3, "a test"), 0.2e-3)
    assert scene.sizes == [3e-3]


def test_a_mesh_with_an_element_that_has_no_volume_is_made_again_with_others(unlucky):
    scene, search = unlucky, Search(unlucky, END)
    search.make_model(0, Sizes(2, 3e-3, 0.5e-3, "a test"), 0.2e-3)
    assert scene.sizes == sorted(scene.sizes, reverse=True)
    assert scene.sizes[-1] < scene.sizes[0]
    assert search.models[0][0].far == scene.sizes[-1]


@pytest.mark.parametrize(("length", "order"), [(25, 2), (1, 3)])
def test_a_long_round_rod_takes_quadratic_elements_and_a_short_one_cubic_ones(length, order):
    """All along the rod, its radius asks for more elements than waves do; the short one's are those at the contact."""
    end = occ.Pnt(0, 0, RADIUS)
    rod = occ.Sphere(end, RADIUS) + occ.Cylinder(end, occ.Z, r=RADIUS, h=length * 2 * RADIUS)
    place = contact_place((rod,), ep.RigidPlane(), np.zeros(3), lambda radius: 0.05 * radius)
    scene = Scene((rod,), (SPHERE_MATERIAL,), ep.RigidPlane(), place, SPEED, TOLERANCE, 200_000)
    search = Search(scene, END)
    search.looks = [SimpleNamespace()]  # a first look is done
    cubic, circle = Sizes(3, 2 * RADIUS, 0.2e-3, "a test", 1.3), 0.25e-3
    own, mesh = search.mesh_of(0, cubic, circle)
    assert own.order == order
    if order == 2:
        assert count_of_dofs(mesh, 2) < 0.6 * count_of_dofs(scene.mesh(0, cubic, circle), 3)


@pytest.mark.parametrize(
    ("dofs", "leap", "meshed", "larger"), [(20_000, 0.7, 2, True), (20_000, 0.85, 2, False), (9_000, 0.5, 1, False)]
)
def test_slightly_larger_elements_are_taken_where_the_mesh_has_a_leap_there(dofs, leap, meshed, larger):
    """Meshes that are small by themselves are not tried."""
    made = []

    def mesh(_, sizes, circle):
        made.append(sizes.near)
        share = 1.0 if sizes.near <= 1e-4 else leap
        return SimpleNamespace(nv=share * dofs / 3, nedge=0, nface=0)

    search = Search(SimpleNamespace(mesh=mesh, missed=lambda i, mesh: 0.0, tolerance=TOLERANCE), END)
    search.looks = [SimpleNamespace()]  # a first look is done
    rule = Sizes(3, 5e-3, 1e-4, "a test")
    own, found = search.mesh_of(0, rule, 0.2e-3)
    assert len(made) == meshed
    assert own == replace(rule, near=max(made) if larger else rule.near)
    assert count_of_dofs(found, 3) == pytest.approx(dofs * (leap if larger else 1.0), abs=3)
    assert max(made) <= 1.2 * rule.near


def test_a_first_look_beyond_its_small_share_takes_the_least_f_cut_that_keeps_the_whole_one():
    """A lens on a plate with a hole, which rings. Later meshes would not resolve the richest f_cut."""
    lens = occ.Sphere(occ.Pnt(0, 0, 30e-3), 30e-3) * occ.Cylinder(occ.Pnt(0, 0, -1e-3), occ.Z, r=8e-3, h=6e-3)
    whole = occ.Box(occ.Pnt(-30e-3, -30e-3, -15e-3), occ.Pnt(30e-3, 30e-3, 0))
    shapes = lens, whole - occ.Cylinder(occ.Pnt(15e-3, 0, -16e-3), occ.Z, r=5e-3, h=20e-3)
    materials, tolerance = (ep.STEEL, ep.ALUMINIUM), 0.01
    place = contact_place(shapes, None, np.zeros(3), lambda radius: first_circle(shapes, materials, 1.0, radius))
    search = Search(Scene(shapes, materials, None, place, 1.0, tolerance, 100_000), 120e-6)
    circle = first_circle(shapes, materials, 1.0, place.radius)
    sizes = [first_sizes(sides_of(shape), place.semi_axes(circle)) for shape in shapes]
    found = search.look_at(sizes, circle, estimated=False).truncation
    assert 0.0018 < found.error < 0.003  # beyond 0.27, and within 0.45 of the tolerance, over 1.5
    assert not found.limit
    assert found.f_cut < 0.4 * found.f_top
