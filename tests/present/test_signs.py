"""Shapes of signs: closed, small, and where the items are."""

import exudyn.itemInterface as items
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

import exudyn_partition as ep
from exudyn_partition.errors import InputError
from exudyn_partition.exudyn_bodies.other_bodies import OtherBody
from exudyn_partition.present.signs import sign_shapes

TIMES = np.array([0.0, 1.0, 2.0])
YELLOW = -2.0, -1.0  # ends of the colours, such that all of a body is beyond the upper one
BOUNDS = np.zeros(3), np.array([0.3, 0.4, 0.0])  # half a metre across


def sign(kind, place, end, name="", turn=None):
    """One with a motion at `TIMES`."""
    turns = np.tile(np.eye(3), (3, 1, 1)) if turn is None else turn
    none = np.zeros((0, 3)), np.zeros((0, 3), dtype=int)
    places, ends = (np.tile(np.asarray(p, dtype=float), (3, 1)) if np.ndim(p) == 1 else p for p in (place, end))
    return OtherBody(-1, name, *none, TIMES, places, turns, kind, ends)


@pytest.mark.parametrize(
    "kind",
    [
        "hinge", "ball joint", "slider", "fixed joint", "joint", "rod", "spring", "drive", "force", "torque", "gravity",
        "ground",
    ],
)  # fmt: skip
def test_each_is_closed_outward_and_small(kind):
    (shape,) = sign_shapes([sign(kind, [0.1, 0.1, 0.0], [0.1, 0.15, 0.02])], TIMES, BOUNDS)
    places = shape.at(1)
    a, b, c = places[shape.triangles].swapaxes(0, 1)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) > 0  # outward
    np.testing.assert_allclose(np.cross(b - a, c - a).sum(axis=0), 0.0, atol=1e-12)  # closed
    assert np.linalg.norm(np.ptp(places, axis=0)) < 0.15
    assert shape.name.startswith(kind)
    assert all(0 <= share <= 1 for share in shape.rgb)


def test_a_spring_reaches_from_end_to_end():
    ends = np.array([[0.1, 0, 0], [0.2, 0, 0], [0.1, 0.1, 0.1]])
    (shape,) = sign_shapes([sign("spring", [0.0, 0.0, 0.0], ends, "wire")], TIMES, BOUNDS)
    assert shape.name == "spring 'wire'"
    for frame, end in enumerate(ends):
        places = shape.at(frame)
        way = end / np.linalg.norm(end)
        assert (places @ way).min() == pytest.approx(0, abs=2e-3)
        assert (places @ way).max() == pytest.approx(np.linalg.norm(end), abs=2e-3)
        assert np.linalg.norm(places - np.outer(places @ way, way), axis=1).max() < 0.015


def test_arrows_show_loads():
    """The tip of a force is where it acts, and the arrow is as long as the force is large."""
    values = np.array([[0, 0, 10.0], [0, 0, -5.0], [0, 0, 0]])
    push, pull = sign("force", [0.1, 0.0, 0.0], values), sign("force", [0.2, 0.0, 0.0], [2.0, 0, 0])
    one, other = sign_shapes([push, pull], TIMES, BOUNDS)
    heights = [np.ptp(one.at(frame)[:, 2]) for frame in range(3)]
    assert heights[1] == pytest.approx(heights[0] / 2)
    assert heights[2] == 0
    assert one.at(0)[:, 2].max() == pytest.approx(0.0, abs=1e-12)
    assert one.at(1)[:, 2].min() == pytest.approx(0.0, abs=1e-12)
    assert np.ptp(other.at(0)[:, 0]) == pytest.approx(heights[0] / 5)


def test_gravity_is_there_once():
    down = sign("gravity", [0, 0, 0], [0, 0, -9.81], "gravity")
    (shape,) = sign_shapes([down, down], TIMES, BOUNDS)
    assert shape.name == "gravity, 9.81 m/s2"
    assert not shape.moves
    assert shape.at(0)[:, 2].min() > -1e-12
    assert sign_shapes([sign("", [0, 0, 0], [0, 0, 0])], TIMES, BOUNDS) == []


# In pictures, as on the page and in films.


@pytest.fixture
def hanging(mbs, arm_body):
    """Run of a bar on a hinge within it, with gravity."""
    arm = ep.CreatePartitionBody(mbs, arm_body, name="arm", frame="floating", gravity=[0, 0, -9.81])
    foot = arm.CreateInterfaceMarker(mbs, "foot")
    pin = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.CreateGround()))
    mbs.AddObject(items.GenericJoint(name="pin", markerNumbers=[pin, foot], constrainedAxes=[1, 1, 1, 1, 0, 1]))
    mbs.Assemble()
    return ep.solve_dynamic(mbs, end_time=2e-4, step=1e-5, method="implicit")


def bluish(pixels):
    """Which pixels, (h, w, 3) of 0 to 255, are as blue as a hinge."""
    red, _, blue = np.moveaxis(np.asarray(pixels, dtype=int)[..., :3], -1, 0)
    return blue - red > 60


def drawn(axes):
    """Pixels of a figure."""
    canvas = FigureCanvasAgg(axes.figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())


def test_figures_show_signs(hanging):
    """The hinge is within the bar and shines through, where it is."""
    axes = ep.plot.bodies(hanging, direction=(0, -1, 0), scale=1)
    with_signs = drawn(axes)
    x, y = axes.transData.transform((0.0, 0.0)).astype(int)  # of the pin [mm]
    there = with_signs[len(with_signs) - y, x, :3].astype(int)
    without = drawn(ep.plot.bodies(hanging, direction=(0, -1, 0), scale=1, signs=False))
    assert bluish(with_signs).sum() > bluish(without).sum() + 100
    assert there[2] > there[0] + 20


def test_pictures_show_signs(hanging):
    look = {"size": (300, 300), "limits": YELLOW}
    with_signs, without = (ep.view.picture(hanging, **look, signs=signs) for signs in (True, False))
    assert bluish(with_signs).sum() > bluish(without).sum() + 20


def test_scenes_of_pyvista_show_signs(hanging):
    pytest.importorskip("pyvista")
    scenes = [ep.pyvista_view.plotter(hanging, size=(300, 300), limits=YELLOW, signs=signs) for signs in (True, False)]
    scenes[1].camera_position = scenes[0].camera_position
    with_signs, without = (np.asarray(scene.screenshot(return_img=True), dtype=int) for scene in scenes)
    yellow = (without[..., 0] - without[..., 2]) > 100
    assert (yellow & (abs(with_signs - without).max(axis=2) > 40)).sum() > 20  # the hinge within the bar
    names = [[name for name in scene.actors if name.startswith("sign")] for scene in scenes]
    assert (len(names[0]), names[1]) == (6, [])  # hinge, ground and gravity, each as it is and as it shines through
    for scene in scenes:
        scene.close()


def test_signs_is_a_flag(hanging):
    for draw in (ep.plot.bodies, ep.view.picture, ep.pyvista_view.plotter):
        with pytest.raises(InputError, match="signs: expected True or False"):
            draw(hanging, signs="few")
