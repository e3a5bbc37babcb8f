"""Contact patches of whole faces: `Partition.surface`."""

import netgen.occ as occ
import numpy as np
import pytest
from oracles import box

import exudyn_partition as ep
from exudyn_partition.errors import EmptyRegionError, InputError

R, WIDTH = 5e-3, 3e-3


@pytest.fixture(scope="module")
def disc():
    """A disc about the z axis; its rim is a boundary of that name."""
    shape = occ.Cylinder(occ.Pnt(0, 0, -WIDTH / 2), occ.Z, r=R, h=WIDTH)
    for face in shape.faces:
        face.name = "rim" if abs(face.center.z) < WIDTH / 4 else "side"
    return ep.fe_model(shape, ep.STEEL, maxh=2.5e-3)


def test_a_rim_has_local_normals_and_no_end(disc):
    (rim,) = ep.Partition.surface(disc, "rim", name="rim").patches
    points = disc.points[rim.nodes]
    radial = np.column_stack([points[:, :2] / np.linalg.norm(points[:, :2], axis=1)[:, None], np.zeros(len(points))])
    assert np.einsum("kd,kd->k", rim.normals, radial).min() > np.cos(0.15)
    assert rim.wanders
    assert not len(rim.rim)  # beyond an edge the surface does not continue


def test_faces_by_name_number_choice_and_box_are_the_same(disc):
    number = np.asarray(disc.boundaries["rim"])
    chosen = np.zeros(len(disc.facets), dtype=bool)
    chosen[number] = True
    slab = (-1.1 * R, -1.1 * R, -0.49 * WIDTH), (1.1 * R, 1.1 * R, 0.49 * WIDTH)
    named = ep.Partition.surface(disc, "rim").patches[0]
    for faces in (["rim"], number, chosen, slab):
        np.testing.assert_array_equal(ep.Partition.surface(disc, faces).patches[0].facets, named.facets)


def test_a_part_of_a_smooth_surface_ends_at_its_rim(disc):
    half = ep.Partition.surface(disc, ((-1, 0, -0.49 * WIDTH), (1, 1, 0.49 * WIDTH))).patches[0]
    assert len(half.rim)
    assert abs(disc.points[half.rim, 1]).max() < 2.5e-3


@pytest.mark.parametrize("order", [1, 2])
def test_a_flat_face_ends_at_sharp_edges_and_a_curved_one_has_none(order):
    """A curved face has its nodes further out than its facets, so that rows of nodes would close too early."""
    fem = ep.fe_model(occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, r=R, h=WIDTH), ep.STEEL, maxh=2.5e-3, order=order)
    (flat,) = ep.Partition.surface(fem, plane=((0, 0, 0), (0, 0, -1))).patches
    (curved,) = ep.Partition.surface(fem, cylinder=((0, 0, 0), (0, 0, 1), R)).patches
    np.testing.assert_array_equal(flat.ends, np.intersect1d(flat.nodes, curved.nodes))
    assert flat.ends.size
    assert not curved.ends.size
    both = [np.flatnonzero(np.isin(fem.facets, patch.nodes).all(axis=1)) for patch in (flat, curved)]
    assert not ep.Partition.surface(fem, np.concatenate(both)).patches[0].ends.size


def test_a_slightly_curved_face_of_fine_facets_has_no_ends_either():
    """Also where a facet at a corner is coplanar with its only neighbour."""
    radius, length = 50 * R, 4 * R
    lens = occ.Cylinder(occ.Pnt(0, -R, -radius), occ.Y, r=radius, h=2 * R) * box(length, 2 * R, length).Move((0, 0, -R))
    fem = ep.fe_model(lens, ep.STEEL, maxh=R)
    assert not ep.Partition.surface(fem, near=(0, 0, 0)).patches[0].ends.size
    assert ep.Partition.surface(fem, near=(0, 0, -R)).patches[0].ends.size


def test_a_part_of_a_face_ends_at_the_edges_of_the_body_alone():
    """Neither where the face goes on, nor at the foot of a step."""
    step = box(4 * R, 2 * R, R).Move((0, 0, -R)) + box(2 * R, 2 * R, R).Move((R, 0, 0))
    fem = ep.fe_model(step, ep.STEEL, maxh=R)
    at = fem.points[fem.facets]
    part = ep.Partition.surface(fem, (abs(at[..., 2]).max(axis=1) < 1e-9) & (at[..., 1].mean(axis=1) > 0)).patches[0]
    x, y = fem.points[part.nodes, :2].T
    foot, cut = np.isclose(x, 0, atol=1e-9), y < R / 2
    assert foot.any()
    assert cut.any()
    np.testing.assert_array_equal(part.ends, part.nodes[np.isclose(x, -2 * R) | np.isclose(y, R)])


@pytest.mark.parametrize("order", [1, 2])
def test_two_faces_end_at_all_edges_but_their_own(order):
    """Each of the others has rows up to the corners; the edge between both has rows as such."""
    fem = ep.fe_model(box(R, R, R), ep.STEEL, maxh=R / 2, order=order)
    at = fem.points[fem.facets]
    x, z = abs(at[..., 0] - R / 2).max(axis=1) < 1e-9, abs(at[..., 2]).max(axis=1) < 1e-9
    (patch,) = ep.Partition.surface(fem, x | z).patches
    side = np.isclose(abs(fem.points[patch.nodes, 1]), R / 2)
    x, z = np.isclose(fem.points[patch.nodes, 0], R / 2), np.isclose(fem.points[patch.nodes, 2], 0)
    far = np.isclose(fem.points[patch.nodes, 0], -R / 2) | np.isclose(fem.points[patch.nodes, 2], R)
    np.testing.assert_array_equal(patch.ends, patch.nodes[(side | far) & ~(x & z)])


def test_ball_patches_have_the_line_of_contact_as_normals(disc):
    (tip,) = ep.Partition.ball(disc, (0, R, 0), 2e-3).patches
    assert not tip.wanders
    np.testing.assert_array_equal(tip.node_normals, np.tile(tip.direction, (len(tip.nodes), 1)))


@pytest.mark.parametrize(
    ("faces", "error", "match"),
    [
        ("hub", InputError, "expected one of"),
        ([0.5, 1.5], InputError, "faces: expected names"),
        ([10**6], InputError, "numbers of facets"),
        (np.array([], dtype=int), EmptyRegionError, "no facet is chosen"),
        (((1, 1, 1), (2, 2, 2)), EmptyRegionError, "the body spans"),
        (((1, 1, 1), (0, 0, 0)), InputError, "lower and upper"),
        ({"rim"}, InputError, "faces: expected names"),
    ],
)
def test_wrong_faces_have_named_errors(disc, faces, error, match):
    with pytest.raises(error, match=match):
        ep.Partition.surface(disc, faces)


def test_a_patch_without_a_line_of_contact_has_no_tolerance(disc):
    with pytest.raises(InputError, match="one line of contact"):
        ep.reduce(disc, ep.Partition.surface(disc, "rim"), tolerance=0.1)
    ball = ep.fe_model(box(1e-3, 1e-3, 1e-3), ep.STEEL, maxh=1e-3)
    with pytest.raises(InputError, match="one line of contact"):
        ep.reduce_pair(
            (disc, ep.Partition.surface(disc, "rim")),
            (ball, ep.Partition.ball(ball, (0, 0, 1e-3), 1e-3)),
            tolerance=0.1,
            speed=1.0,
        )


def test_a_skin_has_all_faces():
    fem = ep.fe_model(box(0.01, 0.008, 0.006), ep.STEEL, maxh=4e-3)
    (patch,) = ep.Partition.skin(fem).patches
    assert (patch.name, patch.axes, patch.wanders) == ("skin", "xyz", True)
    np.testing.assert_array_equal(patch.nodes, np.unique(fem.facets))


def test_a_skin_leaves_faces_to_what_is_beside_it():
    fem = ep.fe_model(box(0.01, 0.008, 0.006), ep.STEEL, maxh=2e-3)
    bottom = fem.points[:, 2].min()
    foot = ep.Partition.interface(fem, "foot", plane=((0, 0, bottom), (0, 0, -1)))
    part = ep.Partition.skin(fem, foot, axes="normal", name="rest")
    (patch,), (interface,) = part.patches, part.interfaces
    assert (patch.name, patch.axes, interface.name) == ("rest", "normal", "foot")
    assert not np.isin(patch.nodes, interface.nodes).any()
    free = [facet for facet in fem.facets if not np.isin(facet, interface.nodes).any()]
    np.testing.assert_array_equal(patch.nodes, np.unique(free))


def test_skins_that_are_none():
    fem, other = (ep.fe_model(box(0.01, 0.008, 0.006), ep.STEEL, maxh=maxh) for maxh in (4e-3, 2e-3))
    with pytest.raises(InputError, match="beside: expected"):
        ep.Partition.skin(fem, "foot")
    with pytest.raises(InputError):
        ep.Partition.skin(fem, ep.Partition.skin(other))
    with pytest.raises(EmptyRegionError, match="touch all faces"):
        ep.Partition.skin(fem, ep.Partition.skin(fem))
