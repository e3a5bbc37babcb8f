"""Points of contact of whole skins: faces on the far side of a body touch nothing, however much surfaces overlap."""

import warnings
from dataclasses import replace

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.errors import PenetrationError

pytestmark = pytest.mark.filterwarnings("ignore:.*Left out, so that nothing keeps")
R, THICK, BORE, RIM, SPEED, CLEARANCE = 8e-3, 12e-3, 12e-3, 20e-3, 0.3, 1e-6
STEEL = replace(ep.STEEL, yield_stress=None)


def skin(shape, maxh=4e-3):
    return ep.reduce(ep.fe_model(shape, STEEL, maxh=maxh), skin=True, f_cut=60e3)


@pytest.fixture(scope="module")
def block():
    """Its upper face is z = 0."""
    return skin(occ.Box(occ.Pnt(-10e-3, -10e-3, -THICK), occ.Pnt(10e-3, 10e-3, 0)))


@pytest.fixture(scope="module")
def ring():
    outer, bore = (occ.Cylinder(occ.Pnt(0, 0, -8e-3), occ.Z, r=r, h=16e-3) for r in (RIM, BORE))
    return skin(outer - bore, maxh=3.2e-3)


@pytest.fixture(scope="module")
def ball():
    return skin(occ.Sphere(occ.Pnt(0, 0, 0), R).Rotate(occ.Axis(occ.Pnt(0, 0, 0), occ.Dir(1, 0.3, 0.1)), 50))


def touching(body, place, velocity, ball=None):
    """Body at the origin, and a ball at a place, rigid unless it is given: the model and its contacts."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, frame="floating", initialVelocity=velocity)
    if ball is None:
        other = ep.RigidSphere(place, R)
    else:
        other = ep.CreatePartitionBody(mbs, ball, frame="floating", referencePosition=place)
    contacts = ep.CreatePartitionContact(mbs, [item, other], formulation="hertz")
    mbs.Assemble()
    return mbs, contacts


def peaks(mbs, contacts):
    """Largest forces of the contacts, the largest one last."""
    result = ep.solve_dynamic(mbs, end_time=50e-6)
    return sorted(float(contact.force(result).max()) for contact in contacts)


@pytest.mark.parametrize("side", [1, -1])
def test_a_ball_above_a_block_or_below_it(block, side):
    """The lower face's plane, without an end, has a ball above the block 28 mm deep in it: that is no contact."""
    place = (0, 0, R + CLEARANCE if side > 0 else -THICK - R - CLEARANCE)
    mbs, contacts = touching(block, place, [0, 0, side * SPEED])
    assert len(contacts) == 6
    assert min(contact.mechanics.gaps.placement.clearance for contact in contacts) == pytest.approx(CLEARANCE, rel=1e-3)
    found = peaks(mbs, contacts)
    assert found[:-1] == [0.0] * 5
    hertz = ep.hertz.impact(block.total_mass, SPEED, R, np.inf, STEEL)
    assert found[-1] == pytest.approx(hertz.peak_force, rel=0.02)  # some energy goes into vibration


@pytest.mark.parametrize(("place", "axis"), [((RIM + R + CLEARANCE, 0, 0), 1), ((BORE - R - CLEARANCE, 0, 0), 0)])
def test_a_ball_outside_a_ring_or_within(ring, ball, place, axis):
    """Where a ball touches one of both cylinders, the other one is behind the wall."""
    mbs, contacts = touching(ring, place, [SPEED * (2 * axis - 1), 0, 0], ball)
    found = peaks(mbs, contacts)
    assert found[:-1] == [0.0] * 3
    assert found[-1] > 150.0


@pytest.mark.parametrize("depth", [2e-3, R, R + THICK / 2])
def test_bodies_that_overlap_are_refused(block, depth):
    with pytest.raises(PenetrationError, match="overlap by"):
        touching(block, (0, 0, R - depth), [0, 0, SPEED])


def test_no_face_is_nearer_than_the_bodies_are(block):
    """Else contacts with faces on the far side, whose planes overlap the ball, would be looked at in each step."""
    _, contacts = touching(block, (0, 0, 2 * R), [0, 0, SPEED])
    gaps = [contact.mechanics.gaps for contact in contacts]
    distances = sorted(of_face.least_distance(np.zeros(of_face.n)) for of_face in gaps)
    assert distances[0] > R - gaps[0].size
    assert distances[-1] > R + THICK - gaps[0].size
    # Nor does the default step look for impacts of faces beside which the ball is.
    near = [of_face for of_face in gaps if not of_face.beside]
    assert [of_face.placement.clearance for of_face in near] == [pytest.approx(R)]


def rounded_blocks():
    """Two blocks with a rounded corner, above which the other one's corner is: the contacts of their faces."""
    round_off, size = 6e-3, np.array([9e-3, 8e-3, 7e-3])
    box = occ.Box(occ.Pnt(*-size), occ.Pnt(*size))
    ends = [place * size for place in ([0, 1, 1], [1, 0, 1], [1, 1, 0])]  # middles of the edges of one corner
    edges = [edge for edge in box.edges if any(np.allclose([*edge.center], end, atol=1e-9) for end in ends)]
    body = skin(box.MakeFillet(edges, round_off), maxh=1.9e-3)
    turn = Rotation.align_vectors([[0, 0, -1]], [[1, 1, 1]])[0].as_matrix()
    middle = turn @ (size - round_off)
    mbs = exu.SystemContainer().AddSystem()
    lower = ep.CreatePartitionBody(mbs, body, frame="floating", referencePosition=[1e-3, 2e-3, -size[2]])
    place = [-middle[0], -middle[1], round_off - middle[2] + CLEARANCE]
    upper = ep.CreatePartitionBody(mbs, body, frame="floating", referencePosition=place, referenceRotationMatrix=turn)
    return ep.CreatePartitionContact(mbs, [upper, lower], formulation="hertz")


@pytest.fixture(scope="module")
def corner_contacts():
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*Left out, so that nothing keeps")
        return rounded_blocks()


def test_blocks_touch_where_a_rounded_corner_is(corner_contacts):
    """Of all pairs of faces one is near: surfaces go on beyond seams, where both bodies are elsewhere."""
    gaps = sorted(contact.mechanics.gaps.placement.clearance for contact in corner_contacts)
    assert gaps[0] == pytest.approx(CLEARANCE, rel=1e-3)
    assert gaps[1] > 1e-4
    touching = min(corner_contacts, key=lambda contact: contact.mechanics.gaps.placement.clearance)
    shapes = [type(face.surface.shape).__name__ for face in touching.mechanics.gaps.faces]
    assert sorted(shapes) == ["RigidPlane", "RigidSphere"]


def test_distances_of_faces_are_bounded_by_where_their_facets_are(corner_contacts):
    """A cylinder comes near to a ball where the rounded edge is not: such contacts were looked at in each step."""
    for contact in corner_contacts:
        gaps = contact.mechanics.gaps
        q = np.zeros(gaps.n)
        both = zip(gaps.sides.places(q), gaps.faces, strict=True)
        first, second = (places[np.unique(face.facets)] for places, face in both)
        distance = cKDTree(first).query(second)[0].min()
        least = gaps.least_distance(q)
        edges = [
            np.linalg.norm(places[facet[:3]] - places[facet[[1, 2, 0]]], axis=1).max()
            for places, facet in (
                (gaps.makers[side].points, facet) for side, face in enumerate(gaps.faces) for facet in face.around
            )
        ]
        assert least < distance
        assert least > 0.9 * distance - 4 * max(edges) - gaps.size  # a kernel reaches two edges beyond a sharp one
