"""Still pictures of bodies by matplotlib: what is selected has its colour, and bodies stand where they are."""

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from oracles import TOP

import exudyn_partition as ep
from exudyn_partition.errors import InputError


def polygons(axes):
    """Corners, (k, 3, 2), and colours, (k, 3), of what is drawn."""
    (drawn,) = (c for c in axes.collections if isinstance(c, PolyCollection))
    return np.array([path.vertices[:3] for path in drawn.get_paths()]), drawn.get_facecolor()[:, :3]


def area_of(corners):
    """Sum of the areas of triangles, (k, 3, 2), whichever way they turn."""
    a, b, c = corners.swapaxes(0, 1)
    (x, y), (u, v) = (b - a).T, (c - a).T
    return abs(x * v - y * u).sum() / 2


def test_selected_facets_have_their_colour(block):
    part = ep.Partition.ball(block, (0, 0, 0.03), 6e-3)
    foot = np.flatnonzero(block.points[:, 2] < 1e-9)
    part |= ep.Partition.interface(block, "foot", foot)
    axes = ep.plot.selection(block, part, direction=(0, 0, 1))
    corners, colours = polygons(axes)
    patch = part.patches[0]
    blue = abs(np.cross(colours, to_rgb("C0"))).max(axis=1) < 1e-6  # of any brightness
    assert np.count_nonzero(blue) == len(patch.facets) * 4  # a quadratic facet is four flat triangles
    flat = block.points[patch.facets[:, :3]]  # their mid-side nodes lie on straight edges
    expected = abs(np.cross(flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0])).sum() / 2
    assert area_of(corners[blue]) == pytest.approx(1e6 * expected, rel=1e-6)
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == [f"patch 0: {len(patch.nodes)} nodes", f"interface 'foot': {len(foot)} nodes"]
    orange = abs(np.cross(colours, to_rgb("C1"))).max(axis=1) < 1e-6
    assert area_of(corners[orange]) == pytest.approx(10 * 20, rel=1e-9)  # mm2: the whole foot


def test_bodies_stand_where_they_are(mbs, bodies):
    ball = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP, initialVelocity=[0, 0, -1.0])
    ep.CreatePartitionBody(mbs, bodies[1])
    ep.CreatePartitionContact(mbs, ball, ep.RigidPlane((0, 0, -0.1)))
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=5e-6, step=0.5e-6)
    axes = ep.plot.bodies(result, 5e-6, direction=(1, 0, 0), scale=1.0, end=2.0)
    corners, _ = polygons(axes)
    # Seen along x: y to the right, z upwards. The ball stands on the block, 20 mm high.
    assert corners[..., 1].max() == pytest.approx(1e3 * (TOP[2] + 0.02 - 5e-6), abs=1e-3)
    assert axes.get_xlabel() == "to the right [mm]"
    (bar,) = (other for other in axes.figure.axes if other is not axes)
    assert bar.get_ylabel() == "speed [m/s]"
    assert bar.get_ylim() == (0.0, 2.0)


def test_what_is_refused(block, sphere):
    with pytest.raises(InputError, match="direction"):
        ep.plot.selection(sphere[0], sphere[1], direction=(0, 0, 0))
    with pytest.raises(InputError, match="partition"):
        ep.plot.selection(block, sphere[1])
    with pytest.raises(InputError, match="result"):
        ep.plot.bodies(None)
