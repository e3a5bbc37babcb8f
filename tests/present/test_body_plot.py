"""Still pictures of bodies by matplotlib: what is selected has its colour, and bodies stand where they are."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from oracles import TOP
from scipy.ndimage import binary_erosion

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
    flat = block.points[patch.facets[:, :3]]  # their mid-side nodes lie on straight edges
    expected = abs(np.cross(flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0])).sum() / 2
    assert area_of(corners[blue]) == pytest.approx(1e6 * expected, rel=1e-6)
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == [f"patch 0: {len(patch.nodes)} nodes", f"interface 'foot': {len(foot)} nodes"]
    orange = abs(np.cross(colours, to_rgb("C1"))).max(axis=1) < 1e-6
    assert area_of(corners[orange]) == pytest.approx(10 * 20, rel=1e-9)  # mm2: the whole foot


def hues(axes, width=640):
    """How far pixels within the body's outline are from grey, 0 to 255."""
    figure = axes.figure
    figure.set_dpi(width / figure.get_size_inches()[0])
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())[..., :3].astype(int)
    box = axes.get_window_extent()
    inside = pixels[::-1][int(box.y0) + 2 : int(box.y1) - 2, int(box.x0) + 2 : int(box.x1) - 2]
    drawn = binary_erosion((inside < 255).any(axis=2), iterations=2)  # lines of edges reach over the outline
    return np.ptp(inside, axis=2)[drawn]


@pytest.mark.parametrize("direction", [(1.0, -1.6, 0.8), (0.3, -0.5, 0.05), (0.2, 0.1, 3.0)])
def test_what_is_behind_does_not_shine_through(block, direction):
    """Seams between triangles let nothing through, and large triangles are not drawn before what they hide."""
    foot = ep.Partition.interface(block, "foot", np.flatnonzero(block.points[:, 2] < 1e-9))
    axes = ep.plot.selection(block, foot, direction=direction)
    axes.get_legend().remove()
    for width in (500, 640, 977):
        assert hues(axes, width).max() < 30  # no orange or blue, for the foot is seen from below alone
    axes = ep.plot.selection(block, foot, direction=np.negative(direction))
    axes.get_legend().remove()
    assert hues(axes).max() > 60


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
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("y [mm]", "z [mm]")
    assert axes.get_title().split("\n")[1:] == ["no contact presses now"]
    assert not axes.lines
    (bar,) = (other for other in axes.figure.axes if other is not axes)
    assert bar.get_ylabel() == "speed [m/s]"
    assert bar.get_ylim() == (0.0, 2.0)


@pytest.mark.parametrize("scale", [1.0, 100.0])
def test_a_contact_that_presses_has_a_circle_and_its_force(mbs, bodies, scale):
    ball = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=[0.003, 0, 0], initialVelocity=[0, 0, -1.0])
    contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane((0, 0, 0)))
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=2e-5, step=0.5e-6)
    axes = ep.plot.bodies(result, direction=(0, -1, 0), scale=scale)
    (circle,) = axes.lines
    np.testing.assert_allclose(np.ravel(circle.get_data()), [3.0, 0.0], atol=0.02 * 20)  # mm; the ball is 20 mm wide
    assert f"{contact.force(result).max():.4g} N" in axes.get_title()
    axes = ep.plot.bodies(result, direction=(1, -1.6, 0.8), scale=scale)
    assert [text.get_text() for text in axes.texts if text.get_text()] == ["x", "y", "z"]
    assert ep.plot.bodies(result, direction=(0, 1, 0)).get_xlabel() == "-x [mm]"


def test_what_is_refused(block, sphere):
    with pytest.raises(InputError, match="direction"):
        ep.plot.selection(sphere[0], sphere[1], direction=(0, 0, 0))
    with pytest.raises(InputError, match="partition"):
        ep.plot.selection(block, sphere[1])
    with pytest.raises(InputError, match="result"):
        ep.plot.bodies(None)
