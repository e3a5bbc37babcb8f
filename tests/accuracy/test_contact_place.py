"""Where shapes touch: curvatures and normals of surfaces that are known, anyhow they lie in space, and wrong places."""

from types import SimpleNamespace

import netgen.occ as occ
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.accuracy.contact_place import contact_place, relative_curvature
from exudyn_partition.errors import EmptyRegionError, InputError

RADIUS = 8e-3
BALL, BELOW = (occ.Sphere(occ.Pnt(0, 0, z), RADIUS) for z in (RADIUS, -RADIUS))
PLATE = occ.Box(occ.Pnt(-0.06, -0.04, -0.008), occ.Pnt(0.06, 0.04, 0))
ACROSS = occ.Cylinder(occ.Pnt(-0.05, 0, -0.005), occ.X, r=0.005, h=0.1)
ALONG = occ.Cylinder(occ.Pnt(0, -0.05, 0.01), occ.Y, r=0.01, h=0.1)
SOCKET = occ.Box(occ.Pnt(-0.02, -0.02, -0.02), occ.Pnt(0.02, 0.02, 0.005)) - occ.Sphere(occ.Pnt(0, 0, 0.016), 0.016)


def place(shapes, point=(0, 0, 0), rigid=None, force=500.0):
    def radius_of(radius):
        return ep.hertz.contact_radius(force, radius, np.inf, ep.STEEL)

    return contact_place(shapes, rigid, np.asarray(point, dtype=float), radius_of)


@pytest.mark.parametrize(
    ("shapes", "rigid", "radii"),
    [
        ((BALL, PLATE), None, (RADIUS, RADIUS)),
        ((BALL, BELOW), None, (RADIUS / 2, RADIUS / 2)),
        ((ALONG, ACROSS), None, (0.01, 0.005)),
        ((BALL, SOCKET), None, (2 * RADIUS, 2 * RADIUS)),
        ((ALONG,), ep.RigidSphere((0, 0, -0.01), 0.01), (0.01, 0.005)),
    ],
)
def test_curvatures_and_normal_of_known_surfaces(shapes, rigid, radii):
    """Two bodies are turned: the seams and poles of their surfaces lie anywhere."""
    axis, turn = np.array([1.0, 2.0, 0.5]) / np.linalg.norm([1.0, 2.0, 0.5]), Rotation.identity()
    if rigid is None:
        turn = Rotation.from_rotvec(50 * axis, degrees=True)
        shapes = [shape.Rotate(occ.Axis(occ.Pnt(0, 0, 0), occ.Dir(*axis)), 50) for shape in shapes]
    found = place(shapes, rigid=rigid)
    np.testing.assert_allclose(1 / np.array(found.curvatures), radii, rtol=0.01)
    np.testing.assert_allclose(found.normal, turn.apply([0, 0, -1]), atol=2e-3)
    assert found.radius == pytest.approx(np.sqrt(np.prod(radii)), rel=0.01)


@pytest.mark.parametrize("axis", [0, 2])
def test_curvatures_at_seam_and_pole_of_an_ellipsoid(axis):
    """OCC draws it as a spline: seam and pole are at the ends of these axes."""
    radii = np.array([2e-3, 1e-3, 3e-3])
    turn = Rotation.from_rotvec([0.3, -0.5, 0.9])
    way = occ.Axis(occ.Pnt(0, 0, 0), occ.Dir(*turn.as_rotvec()))
    shape = occ.Ellipsoid(occ.Axes((0, 0, 0), occ.Z, occ.X), *radii[[2, 0, 1]])
    shape = shape.Rotate(way, np.rad2deg(turn.magnitude()))
    end = turn.apply(np.eye(3)[axis])
    plane = ep.RigidPlane(radii[axis] * end, -end)
    found = place((shape,), radii[axis] * end, plane, force=20.0)
    others = np.delete(radii, axis)
    np.testing.assert_allclose(found.curvatures, np.sort(radii[axis] / others**2), rtol=0.01)
    np.testing.assert_allclose(found.normal, end, atol=1e-3)


def test_an_ellipse_has_the_area_of_its_circle():
    """Its axes are those of Hertz: of crossed cylinders of 10 and 5 mm, with the exact integrals, a / b = 1.5985."""
    found = place((ALONG, ACROSS))
    np.testing.assert_allclose(abs(found.along), [1, 0, 0], atol=1e-2)  # along the thinner cylinder
    long, short = found.semi_axes(1e-3)
    assert long * short == pytest.approx(1e-6)
    assert long / short == pytest.approx(1.5985, rel=0.02)


@pytest.mark.parametrize(
    ("shapes", "point", "error", "message"),
    [
        ((BALL, PLATE), (0, 0, 1e-3), EmptyRegionError, r"the first shape is 0.001 m away from .*, expected a point"),
        ((BALL, PLATE), (5e-3, 0, 0), EmptyRegionError, "the first shape is .* m away"),
        ((PLATE, BALL), (59.9, 0, 0), EmptyRegionError, "it would touch at .*Give the point in metres"),
        ((PLATE,), (0.06, 0, 0), InputError, "got an edge or a corner of the first shape"),
        ((PLATE,), (0, 0, 0), InputError, "touch along a line or an area"),
        ((ALONG, PLATE), (0, 0, 0), InputError, "touch along a line or an area"),
        ((BALL, occ.Sphere(occ.Pnt(0, 0, RADIUS), RADIUS)), (0, 0, 0), EmptyRegionError, "do not face each other"),
    ],
)
def test_wrong_places_are_named(shapes, point, error, message):
    with pytest.raises(error, match=message):
        place(shapes, point, ep.RigidPlane(normal=(0, 0, -1)) if len(shapes) == 1 else None)


def test_a_contact_as_large_as_the_body_is_refused():
    with pytest.raises(InputError, match=r"contact: its radius would be .*; expected at most 0\.25 of it"):
        place((BALL, PLATE), force=1e8)


def test_the_tip_of_a_cone_is_refused():
    """The fitted curvature would grow without end as the circles shrink. OCC needs long for a real one."""
    slope, down = 0.2, np.array([0.0, 0.0, -1.0])

    def depths(starts, way, reach):
        return slope * np.hypot(starts[:, 0], starts[:, 1]) - starts[:, 2]

    plane = SimpleNamespace(depths=lambda starts, way, reach: starts[:, 2])
    with pytest.raises(InputError, match=r"off a paraboloid by 22%: there is the tip of a cone, .*Round the tip"):
        relative_curvature([SimpleNamespace(depths=depths), plane], [np.zeros(3)] * 2, down, 1e-4)
