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
