"""Exudyn's renderer: what it would draw, as data, and pictures by its raytracer; neither needs a screen."""

import os
import sys

import exudyn as exu
import numpy as np
import pytest
from exudyn.utilities import InertiaCuboid
from matplotlib import colormaps
from oracles import TOP
from scipy.spatial import cKDTree

import exudyn_partition as ep
from exudyn_partition.errors import InputError, RunError
from exudyn_partition.present.graphics import rigid_shapes


def drawn_points(SC):
    """Corners of the triangles that the renderer would draw, (n, 3) [m], and their colours."""
    data = SC.renderer.GetGraphicsData(flatShapes=True)["triangles"]
    return np.asarray(data["points"]).reshape(-1, 3), np.asarray(data["colors"]).reshape(-1, 4)


@pytest.fixture
def scene(bodies):
    """The ball about to hit the block, with a view whose deformation is drawn a hundred times as large."""
    SC = exu.SystemContainer()
    mbs = SC.AddSystem()
    striker = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP, initialVelocity=[0, 0, -1.0])
    target = ep.CreatePartitionBody(mbs, bodies[1])
    contact = ep.CreatePartitionContact(mbs, striker, target, rows="node-to-segment")
    ep.CreatePartitionView(mbs, scale=100.0)
    mbs.Assemble()
    return SC, mbs, striker, target, contact


def test_the_renderer_draws_the_deformed_surfaces(scene):
    SC, mbs, striker, target, _ = scene
    result = ep.solve_dynamic(mbs, end_time=20e-6, step=0.5e-6)
    expected, magnitude = [], []
    for item in (striker, target):
        nodes = np.unique(item.body.facets)
        at, q = item.kinematics.at(nodes), item.coordinates(result)[-1]
        expected.append(at.place(q) + 99 * at.deformation(q))
        magnitude.append(np.linalg.norm(at.deformation(q), axis=1))
    points, colours = drawn_points(SC)
    above = points[:, 1] > max(places[:, 1].max() for places in expected) + 1e-9
    bar, scale = points[above], colours[above]
    points, colours = points[~above], colours[~above]
    # The bar has the colours of the map, from left to right.
    for end, share in ((bar[:, 0].argmin(), 0.0), (bar[:, 0].argmax(), 1.0)):
        np.testing.assert_allclose(scale[end, :3], colormaps["viridis"](share)[:3], atol=0.01)
    # Exudyn draws in single precision.
    for some, others in ((points, np.vstack(expected)), (np.vstack(expected), points)):
        assert cKDTree(others).query(some)[0].max() < 1e-8
    largest = np.concatenate(magnitude)
    hottest = np.vstack(expected)[largest.argmax()]
    nearest = np.linalg.norm(points - hottest, axis=1).argmin()
    np.testing.assert_allclose(colours[nearest, :3], colormaps["viridis"](1.0)[:3], atol=0.01)
    text = SC.renderer.GetGraphicsData()["texts"]["text"]
    ends = [f"{largest.min():.3g}", f"{largest.max():.3g}"]
    assert text == [*ends, "deformation [m]", "deformed x 100: bodies may seem to overlap"]


def test_a_view_costs_nothing(scene, impact):
    """Neither coordinates nor a call of its function, and the run is the same in every bit."""
    _, mbs, *_, contact = scene
    plain, *_, other = impact
    assert mbs.systemData.ODE2Size() == plain.systemData.ODE2Size()
    force = contact.force(ep.solve_dynamic(mbs, end_time=20e-6, step=0.5e-6))
    np.testing.assert_array_equal(force, other.force(ep.solve_dynamic(plain, end_time=20e-6, step=0.5e-6)))


def test_a_picture_shows_the_bodies_and_their_colours(impact, ball, block):
    mbs, striker, target, _ = impact
    result = ep.solve_dynamic(mbs, end_time=20e-6, step=0.5e-6)
    pairs = [(striker, ball[0]), (target, block)]
    image = ep.view.picture(result, 15e-6, pairs, field="von_mises", limits=(0, 50e6), size=(320, 240))
    assert (image.shape, image.dtype) == ((240, 320, 3), np.uint8)
    coloured = np.ptp(image.astype(int), axis=2) > 30
    assert 0.05 < coloured.mean() < 0.6
    coloured[180:, :80] = False  # the axes of space
    assert np.flatnonzero(coloured.any(axis=1))[[0, -1]].mean() == pytest.approx(120, abs=12)  # in the middle
    other = ep.view.picture(result, 15e-6, pairs, field="von_mises", limits=(0, 5e9), size=(320, 240))
    assert abs(image.astype(int) - other).mean() > 0.3  # the colours follow their limits


@pytest.mark.parametrize(
    "surface",
    [
        ep.RigidPlane((0, 0, -1e-6), (0, 0, 2.0)),
        ep.RigidSphere((0, 0, -0.02), 0.02 - 1e-6),
        ep.RigidSphere((0, 0, -100), 100 - 1e-6),
        ep.RigidCylinder((0, 0, -0.006), (1, 0.3, 0), 0.006 - 1e-6),
    ],
)
def test_rigid_surfaces_are_drawn_where_bodies_touch_them(round_body, surface):
    SC = exu.SystemContainer()
    mbs = SC.AddSystem()
    item = ep.CreatePartitionBody(mbs, round_body, initialVelocity=[0, 0, -1.0])
    ep.CreatePartitionContact(mbs, item, surface, rows="node-to-segment")
    ep.CreatePartitionView(mbs)
    mbs.Assemble()
    points, colours = drawn_points(SC)
    grey = np.ptp(colours[:, :3], axis=1) < 0.05
    off = surface.project(points[grey].astype(float))[0]
    size = np.ptp(round_body.points, axis=0).max()
    assert abs(off).max() < 1e-5 * max(1.0, getattr(surface, "radius", 0.0))  # in single precision
    extent = np.ptp(points[grey], axis=0)
    assert size < extent[0] < 3 * size
    contact_point = round_body.points[round_body.points[:, 2].argmin()]
    nearest = np.linalg.norm(points[grey] - contact_point, axis=1).min()
    assert nearest < 0.05 * size


@pytest.mark.parametrize(
    "surface", [ep.RigidCylinder((0, 0, -0.006), (1, 0.3, 0), 0.006), ep.RigidSphere((0, 0, -0.005), 0.005)]
)
def test_round_surfaces_look_round(round_body, surface):
    """Middles of the drawn triangles are nowhere further inside than a polygon of 48 sides is."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, round_body)
    ep.CreatePartitionContact(mbs, item, surface, rows="node-to-segment")
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=1e-6, step=0.5e-6)
    (shape,) = rigid_shapes(result, result.t[-1:], {item: item.body.points[None]})
    triangles = shape.points[shape.triangles]
    for place in (triangles.mean(axis=1), triangles[:, :2].mean(axis=1)):
        assert -surface.project(place)[0].min() < (1 - np.cos(np.pi / 48)) * surface.radius


def test_a_carried_surface_is_drawn_where_its_carrier_is(round_body):
    SC = exu.SystemContainer()
    mbs = SC.AddSystem()
    item = ep.CreatePartitionBody(mbs, round_body)
    speed = np.array([0.0, 0.0, 2.0])
    carrier = mbs.CreateRigidBody(
        referencePosition=[0, 0, -0.01], inertia=InertiaCuboid(7800, [0.01] * 3), initialVelocity=speed.tolist(),
        initialAngularVelocity=[300.0, 0, 0], nodeType=exu.NodeType.RotationRotationVector,
    )  # fmt: skip
    ep.CreatePartitionContact(mbs, item, ep.RigidPlane((0, 0, 0.004)), masterBody=carrier)
    ep.CreatePartitionView(mbs)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=1e-3, step=1e-6)
    points, colours = drawn_points(SC)
    grey = points[np.ptp(colours[:, :3], axis=1) < 0.05]
    turn = np.array(mbs.GetObjectOutputBody(carrier, exu.OutputVariableType.RotationMatrix)).reshape(3, 3)
    local = (grey - place_of(mbs, carrier)) @ turn
    assert turn[2, 1] == pytest.approx(np.sin(0.3), rel=1e-3)
    np.testing.assert_allclose(local[:, 2], 0.004, atol=1e-8)
    assert SC.renderer.GetGraphicsData()["texts"]["text"][-1] == "deformation [m]"
    # As pictures of the result have it.
    kept, brick = rigid_shapes(result, result.t[-1:], {item: item.body.points[None]})
    assert np.ptp(brick.points, axis=0) == pytest.approx([0.01] * 3)  # which Exudyn draws for the inertia
    cos = abs(kept.turn[0, :, 2] @ turn[:, 2])
    assert cos == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose((kept.at(0) - place_of(mbs, carrier)) @ turn[:, 2], 0.004, atol=1e-12)
    picture, early = (ep.view.picture(result, time, size=(80, 60)) for time in (1e-3, 0.0))
    assert (picture != early).any()


def place_of(mbs, carrier):
    """Where a body is [m]."""
    return np.array(mbs.GetObjectOutputBody(carrier, exu.OutputVariableType.Position))


def test_the_peak_is_shown_unless_a_time_is_given(impact):
    mbs, _, _, contact = impact
    result = ep.solve_dynamic(mbs, end_time=60e-6, step=0.5e-6)
    peak = result.t[contact.force(result).argmax()]
    assert 0 < peak < result.t[-1]
    images = [ep.view.picture(result, *time, size=(80, 60)) for time in ((), (peak,), (0.0,))]
    np.testing.assert_array_equal(images[0], images[1])
    assert (images[0] != images[2]).any()


@pytest.mark.parametrize("rotation", [(0, 0, 0), (-1.2, 0, 0.3), (0.4, 2.0, -0.5)])
def test_the_text_stands_above_the_bodies_from_where_they_are_seen(impact, rotation):
    mbs, *_ = impact
    result = ep.solve_dynamic(mbs, end_time=5e-6, step=0.5e-6)
    image = ep.view.picture(result, 0.0, rotation=rotation, size=(320, 240)).astype(int)
    coloured = np.ptp(image, axis=2) > 30
    text = ~coloured & (image.max(axis=2) < 100)
    coloured[180:, :80] = text[180:, :80] = False  # the axes of space
    assert text.any()
    assert np.flatnonzero(text.any(axis=1)).max() < np.flatnonzero(coloured.any(axis=1)).min()


def test_a_film_needs_a_screen(impact):
    mbs, *_ = impact
    result = ep.solve_dynamic(mbs, end_time=5e-6, step=0.5e-6)
    if os.environ.get("DISPLAY"):  # run so once, under Xvfb
        ep.view.show(result, times=3, cycles=1)
    else:
        with pytest.raises(RunError, match="no screen"):
            ep.view.show(result, times=3, cycles=1)


@pytest.mark.skipif(sys.platform != "linux", reason="X11 of Linux")
@pytest.mark.parametrize("name", [":4711", "no screen of this name"])
def test_a_screen_that_is_not_there_is_named(impact, monkeypatch, name):
    """Exudyn's own error would come through, and end the process when Python ends."""
    mbs, *_ = impact
    result = ep.solve_dynamic(mbs, end_time=5e-6, step=0.5e-6)
    monkeypatch.setenv("DISPLAY", name)
    with pytest.raises(RunError, match=r"show: .*ep.view.picture draws without one"):
        ep.view.show(result, times=3, cycles=1)


def test_what_cannot_be_shown(mbs, impact):
    empty = exu.SystemContainer().AddSystem()
    with pytest.raises(InputError, match="bodies: there is no partition body to show; call CreatePartitionBody before"):
        ep.CreatePartitionView(empty)
    with pytest.raises(InputError, match="field: expected one of 'displacement', 'deformation', 'velocity', got 'von_"):
        ep.CreatePartitionView(mbs, field="von_mises")
    with pytest.raises(InputError, match="scale: expected a finite number above zero"):
        ep.CreatePartitionView(mbs, scale=0)
    result = ep.solve_dynamic(mbs, end_time=5e-6, step=0.5e-6)
    with pytest.raises(InputError, match="stress of 'a body' needs its FE model"):
        ep.view.picture(result, 0.0, field="von_mises")


def test_bodies_of_another_model_are_refused_before_anything_is_drawn(scene, bodies):
    """Within Exudyn's drawing an error would end nothing."""
    _, mbs, *_ = scene
    result = ep.solve_dynamic(mbs, end_time=2e-6, step=0.5e-6)
    foreign = ep.CreatePartitionBody(exu.SystemContainer().AddSystem(), bodies[0])
    with pytest.raises(InputError, match="of another model"):
        ep.view.picture(result, bodies=[foreign])
