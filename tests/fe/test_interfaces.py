"""Interfaces of a mesh: which nodes, where joints attach, and what may not overlap."""

import netgen.occ as occ
import numpy as np
import pytest
from oracles import box, end

import exudyn_partition as ep
from exudyn_partition.errors import EmptyRegionError, InputError


def test_named_boundaries_of_the_shape_are_interfaces():
    shape = box(0.010, 0.008, 0.060)
    shape.faces.Min(occ.Z).name = "foot"
    fem = ep.fe_model(shape, ep.STEEL, maxh=6e-3)
    (joint,) = ep.Partition.interface(fem, "pin", "foot").interfaces
    np.testing.assert_array_equal(joint.nodes, end(fem, 0.0))
    np.testing.assert_allclose(joint.position, [0, 0, 0], atol=1e-9)
    assert joint.weights.sum() == pytest.approx(1)
    with pytest.raises(InputError, match=r"nodes: expected one of .*'foot'.*, got 'feet'"):
        ep.Partition.interface(fem, "pin", "feet")


@pytest.fixture(scope="module", params=[1, 2])
def lever(request):
    """A bar along x with a bore about z, meshed fine on one side of it."""
    bar = occ.Box((-0.015, -0.012, 0), (0.08, 0.012, 0.008)) - occ.Cylinder((0, 0, -1e-3), occ.Z, 6e-3, 10e-3)
    for face in bar.faces:
        if abs(face.center.x) < 5e-3 and 1e-3 < face.center.z < 7e-3 and abs(face.center.y) < 5e-3:
            face.name = "bore"
    fine = ep.Refine((6e-3, 0, 0), radius=1e-3, h=1e-3)
    return ep.fe_model(bar, ep.STEEL, maxh=10e-3, refine=[fine], order=request.param)


def test_a_bore_s_interface_is_on_its_axis(lever):
    """However uneven its mesh: the mean of its nodes is a sixth of the radius off."""
    pin = ep.Partition.interface(lever, "pin", "bore").interfaces[0]
    assert np.linalg.norm(lever.points[pin.nodes].mean(axis=0)[:2]) > 0.5e-3
    assert np.linalg.norm(pin.position[:2]) < 1e-15
    assert pin.position[2] == pytest.approx(4e-3, abs=1e-15)  # midway, although elements differ in size


def test_an_interface_s_point_may_be_given(link):
    """Its motion is that of a rigid body there; forces on it are statically the same forces anywhere else."""
    place = np.array([1e-3, -2e-3, 5e-3])
    for kind in ("rigid", "averaged"):
        joint, given = (
            ep.Partition.interface(link, "foot", end(link, 0.0), kind=kind, position=position).interfaces[0]
            for position in (None, place)
        )
        np.testing.assert_array_equal(given.position, place)
        np.testing.assert_allclose(given.motion @ given.rigid_motion(link).reshape(-1, 6), np.eye(6), atol=1e-12)
        arm = place - joint.position
        moved = joint.motion[:3] + np.cross(joint.motion[3:].T, arm).T
        np.testing.assert_allclose(given.motion, np.vstack([moved, joint.motion[3:]]), atol=1e-9)
    with pytest.raises(InputError, match=r"position: expected the point where joints attach.* away from the nodes"):
        ep.Partition.interface(link, "foot", end(link, 0.0), position=1e3 * place)
    with pytest.raises(InputError, match="position: expected shape"):
        ep.Partition.interface(link, "foot", end(link, 0.0), position=[0, 0])


def test_the_middle_of_other_faces_is_the_mean_over_their_area():
    """Half a bore, a sphere, a square hole: no axis."""
    half = occ.Box((0, -8e-3, 0), (12e-3, 8e-3, 6e-3)) - occ.Cylinder((0, 0, -1e-3), occ.Z, 5e-3, 9e-3)
    for face in half.faces:
        face.name = "half" if 3e-3 < face.center.x < 4e-3 else "other"
    fem = ep.fe_model(half, ep.STEEL, maxh=3e-3)
    place = ep.Partition.interface(fem, "half", "half").interfaces[0].position
    np.testing.assert_allclose(place, [2 / np.pi * 5e-3, 0, 3e-3], atol=3e-5)
    ball = ep.fe_model(occ.Sphere((1e-3, 0, 0), 5e-3), ep.STEEL, maxh=3e-3)
    surface = ep.Partition.interface(ball, "all", np.unique(ball.facets)).interfaces[0]
    np.testing.assert_allclose(surface.position, [1e-3, 0, 0], atol=2e-5)


def test_bad_interfaces(link):
    edge = np.flatnonzero((abs(link.points[:, 0] - 5e-3) < 1e-9) & (abs(link.points[:, 2]) < 1e-9))
    for nodes in (edge, edge[:2], edge[:1]):
        with pytest.raises(InputError, match=r"lie on one line.* at least three that span a plane"):
            ep.Partition.interface(link, "hinge", nodes)
    with pytest.raises(EmptyRegionError, match="interface 'pin' has none"):
        ep.Partition.interface(link, "pin", [])
    with pytest.raises(InputError, match="expected numbers of nodes, 0 to"):
        ep.Partition.interface(link, "pin", [0, 1, 10**9])
    with pytest.raises(InputError, match="expected one of 'rigid', 'averaged', got 'RBE2'"):
        ep.Partition.interface(link, "pin", end(link, 0.0), kind="RBE2")


def test_every_node_of_an_interface_has_its_share(link):
    """By area on a whole face; equally where some nodes span a facet by chance and others none."""
    face = ep.Partition.interface(link, "face", end(link, 0.0), kind="averaged").interfaces[0]
    np.testing.assert_allclose(face.position, (0, 0, 0), atol=1e-12)
    layer = np.flatnonzero(link.points[:, 2] < 0.012)
    assert (ep.Partition.interface(link, "layer", layer).interfaces[0].weights == 1 / len(layer)).all()
    some = np.union1d(link.facets[0], end(link, 0.06)[::7])
    assert (ep.Partition.interface(link, "some", some).interfaces[0].weights > 0).all()


def test_what_may_not_overlap(link):
    side = ep.Partition.ball(link, (0.005, 0, 0.03), 5e-3)
    foot = ep.Partition.interface(link, "foot", end(link, 0.0))
    with pytest.raises(InputError, match=r"patch 0 '' and interface 'foot' share \d+ nodes, such as node"):
        foot | ep.Partition.ball(link, (0.005, 0, 0), 5e-3)
    with pytest.raises(InputError, match="patch 0 '' and patch 1 '' share"):
        side | side
    with pytest.raises(InputError, match=r"name: expected each name once, got 'foot', 'foot'"):
        foot | ep.Partition.interface(link, "foot", end(link, 0.06))
    other = ep.fe_model(box(0.010, 0.008, 0.030), ep.STEEL, maxh=6e-3)
    with pytest.raises(InputError, match="one is of a mesh with"):
        side | ep.Partition.interface(other, "foot", end(other, 0.0))
