"""The page that plays: what it holds, and what a browser makes of it."""

import base64
import gzip
import json
import re

import exudyn as exu
import numpy as np
import pytest
from exudyn import graphics
from exudyn.utilities import InertiaCuboid
from oracles import MARBLE_RADIUS, hit_by_a_spinning_ball

import exudyn_partition as ep
from exudyn_partition.errors import InputError
from exudyn_partition.present.motion import motion_of
from exudyn_partition.present.scene import few_shapes, force_curve, split_at_edges


@pytest.fixture(scope="module")
def run(bodies):
    """A ball that spins hits a block; the name of one has what would end a script of the page."""
    return hit_by_a_spinning_ball(bodies, "ball </script>", name="block")[-1]


def read(page):
    """Facts and arrays of a page, decoded without a browser."""
    facts = json.loads(re.search(r'<script id="facts"[^>]*>(.*?)</script>', page, re.DOTALL).group(1))
    data = re.search(r'<script id="data"[^>]*>(.*?)</script>', page, re.DOTALL).group(1)
    block = gzip.decompress(base64.b64decode(data))
    kinds = {"f4": np.float32, "i2": np.int16, "u4": np.uint32, "u1": np.uint8}
    return facts, lambda entry: np.frombuffer(block, kinds[entry[0]], entry[2], entry[1])


def test_the_page_holds_the_motion(run, tmp_path):
    times = np.linspace(run.t[0], run.t[-1], 9)
    scene = run.scene(tmp_path / "run.html", frames=times)
    assert scene.path.read_text() == scene.page
    facts, array = read(scene.page)
    assert facts["title"] == "run"
    motion = motion_of(run, frames=times)
    middle = np.mean(motion.bounds, axis=0)
    for given, body in zip(facts["bodies"], motion.bodies, strict=True):
        points, amplitudes = array(given["points"]).reshape(-1, 3), array(given["amplitudes"]).reshape(9, -1)
        shapes = array(given["shapes"]).reshape(amplitudes.shape[1], -1)
        largest = abs(body.deformation).max()
        for frame in range(9):
            local = points + (amplitudes[frame] @ shapes).reshape(-1, 3)
            place = array(given["place"]).reshape(9, 3)[frame] + local @ array(given["turn"]).reshape(9, 3, 3)[frame].T
            away = abs(place + middle - body.at(frame)).max()
            assert away < 0.01 * largest + 1e-6 * motion.size  # half a per cent, and single precision
        for colour, values in zip(given["colours"], body.colours.values(), strict=True):
            most = max(other.colours["speed"].max() for other in motion.bodies)
            if values is body.colours["speed"]:
                read_back = most * (array(colour).reshape(9, -1) / 255.0) ** 2
                np.testing.assert_allclose(read_back, values, atol=2 * most / 255)


def test_the_largest_force_is_that_of_all_samples(marble, mbs):
    """Of an impact that is a hundred times shorter than the run: curve, frames and pressures have its peak."""
    ball = ep.CreatePartitionBody(
        mbs, marble, referencePosition=[0, 0, MARBLE_RADIUS + 2e-6], initialVelocity=[0, 0, -0.5]
    )
    contact = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), slavePatch="south")
    mbs.Assemble()
    run = ep.solve_dynamic(mbs, end_time=6e-3, method="implicit", adaptive=True)
    force = contact.force(run)
    facts, _ = read(run.scene(frames=5).page)
    (curve,) = (entry["values"] for entry in facts["forces"])
    assert max(curve) == pytest.approx(force.max(), rel=1e-4)
    assert min(curve) == 0.0
    assert facts["start"] == run.t[force.argmax()]
    assert facts["start"] in facts["t"]
    at_peak, _ = read(run.scene(frames=[0.0, facts["start"]]).page)
    pressures = [c["largest"] for page in (facts, at_peak) for c in page["colours"] if "pressure" in c["name"]]
    assert len(pressures) == 2
    assert pressures[0] == pytest.approx(pressures[1], rel=1e-6)
    assert pressures[0] > 0


def test_a_curve_of_few_points_follows_each_sample():
    """Points are at most one interval away from the samples, and none of these is above or below the curve's ends."""
    t = np.sort(np.random.default_rng(0).random(5000))
    force = np.maximum(0.0, np.sin(300 * t)) * 1e-4  # far below a millinewton
    curve = np.array(force_curve(t, force))
    assert curve.max() == pytest.approx(force.max(), rel=1e-4)
    at, step = np.linspace(t[0], t[-1], len(curve)), np.ptp(t) / (len(curve) // 2)
    for time, value in zip(at, curve, strict=True):
        near = force[abs(t - time) < 2 * step]
        assert near.min() - 1e-8 <= value <= near.max() + 1e-8


def test_text_from_the_user_cannot_end_the_script(run):
    page = run.scene(frames=2, title="</script><b>").page
    assert "</script><b>" not in page
    assert page.count("</script>") == 3
    assert page.isascii()  # within a notebook's frame other letters would be read wrongly


def test_a_notebook_shows_the_page(run):
    shown = run.scene(frames=2, height=300).in_frame()
    assert shown.startswith("<iframe")
    assert "height:300px" in shown
    assert "<script" not in shown  # all of the page is escaped


def test_few_shapes_reach_the_tolerance():
    random = np.random.default_rng(3)
    frames = np.einsum("mr,rnk->mnk", random.normal(size=(20, 3)), random.normal(size=(3, 40, 3)))
    shapes, amplitudes = few_shapes(frames, 1e-9)
    assert len(shapes) == 3
    np.testing.assert_allclose(np.einsum("mr,rnk->mnk", amplitudes, shapes), frames, atol=1e-9 * abs(frames).max())
    shapes, amplitudes = few_shapes(np.zeros((4, 5, 3)))
    assert not (amplitudes @ shapes.reshape(len(shapes), -1)).any()


def test_vertices_are_split_at_sharp_edges_alone():
    corners = np.array([[x, y, z] for x in (0.0, 1) for y in (0.0, 1) for z in (0.0, 1)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    split, nodes = split_at_edges(corners, triangles)
    assert len(nodes) == 24  # four for each face of the cube
    np.testing.assert_array_equal(nodes[split], triangles)


def test_what_is_refused(run, tmp_path):
    with pytest.raises(InputError, match="no folder"):
        run.scene(tmp_path / "no" / "run.html")
    with pytest.raises(InputError, match="scale"):
        run.scene(scale=0.0)
    with pytest.raises(InputError, match="height"):
        run.scene(height=1)


def test_a_browser_plays_the_page(opened, run, tmp_path):
    times = np.linspace(run.t[0], run.t[-1], 21)
    page, faults = opened(run.scene(tmp_path / "run.html", frames=times, scale=1.0).path)
    motion = motion_of(run, frames=times)
    middle = np.mean(motion.bounds, axis=0)
    for frame in (0, 7, 20):  # vertices are where the bodies are
        page.evaluate(f"scene.set(scene.times[{frame}])")
        for number, body in enumerate(motion.bodies):
            drawn = np.array(page.evaluate(f"Array.from(scene.bodies[{number}].places)")).reshape(-1, 3)
            nodes = np.array(page.evaluate(f"Array.from(scene.bodies[{number}].nodes)"))
            expected = (body.at(frame) - middle)[nodes]
            assert abs(drawn - expected).max() < 0.01 * abs(body.deformation).max() + 1e-6 * motion.size
            pixel = np.array(page.evaluate(f"scene.project({number}, 0)"))[:2]
            np.testing.assert_allclose(pixel, projected(page, expected[0]), atol=1.0)
    before = page.locator("canvas").screenshot()
    page.evaluate("scene.set(scene.times[0])")
    page.click("#play")
    page.wait_for_function("scene.state.time > scene.times[1]")
    page.click("#play")
    assert page.locator("canvas").screenshot() != before
    still = page.locator("canvas").screenshot()
    page.select_option("#colour", "1")
    page.wait_for_timeout(200)
    assert page.locator("canvas").screenshot() != still  # colours change
    page.mouse.move(450, 250)
    assert "m" in page.locator("#value").text_content() or page.locator("#value").is_hidden()
    assert faults == []


def test_what_is_rigid_moves_in_the_browser(opened, round_body, tmp_path):
    """A plate of Exudyn carries the plane that hits a ball at rest, and turns; a floor stays where it is."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, round_body)
    plate = mbs.CreateRigidBody(
        name="plate", referencePosition=[0, 0, -0.02], inertia=InertiaCuboid(7800, [0.02] * 3),
        initialVelocity=[0, 0, 5.0], initialAngularVelocity=[0, 200.0, 0], nodeType=exu.NodeType.RotationRotationVector,
        graphicsDataList=[graphics.Brick(size=[0.02, 0.02, 0.01])],
    )  # fmt: skip
    mbs.CreateGround(name="floor", graphicsDataList=[graphics.Brick(centerPoint=[0, 0, -0.1], size=[0.1, 0.1, 0.01])])
    ep.CreatePartitionContact(mbs, item, ep.RigidPlane((0, 0, 0.005)), masterBody=plate)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=2e-3, step=1e-6)
    page, faults = opened(result.scene(tmp_path / "run.html", frames=11).path)
    motion = motion_of(result, frames=11)
    middle = np.mean(motion.bounds, axis=0)
    assert [shape.moves for shape in motion.rigid] == [True, True, False]
    for frame in (0, 4, 10):
        page.evaluate(f"scene.set(scene.times[{frame}])")
        for number, shape in enumerate(motion.rigid):
            drawn = np.array(page.evaluate(f"Array.from(scene.surfaces[{number}].places)")).reshape(-1, 3)
            expected = shape.at(frame) - middle
            away = np.linalg.norm(drawn[:, None] - expected[None], axis=2)
            assert max(away.min(axis=0).max(), away.min(axis=1).max()) < 1e-6 * motion.size  # single precision
    place, turn = result.others[0].at(np.array([2e-3]))
    top = (motion.rigid[0].at(10) - place[0]) @ turn[0]
    np.testing.assert_allclose(top[:, 2], 0.005, atol=1e-12)  # the plane stays on its plate
    assert page.locator("#bodies label").all_text_contents() == ["body 0", "plate", "floor"]
    still = page.locator("canvas").screenshot()
    page.uncheck("#bodies label:nth-child(2) input")
    page.wait_for_timeout(200)
    assert page.locator("canvas").screenshot() != still
    assert faults == []


def projected(page, place):
    """Pixel of a place by a camera that is written here again: perspective from above, at 0.42 rad."""
    width, height = page.evaluate(
        "[document.querySelector('canvas').clientWidth, document.querySelector('canvas').clientHeight]"
    )
    size = page.evaluate("JSON.parse(document.getElementById('facts').textContent).size")
    azimuth, elevation, distance = -1.05, 0.42, 1.9 * size
    back = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    seen = np.array([right @ place, np.cross(back, right) @ place, distance - back @ place])
    zoom = min(1.0, width / height / 0.7) / np.tan(0.26) * height / 2
    return np.array([width / 2 + zoom * seen[0] / seen[2], height / 2 - zoom * seen[1] / seen[2]])


def test_a_phone_needs_no_scrolling(opened, run, tmp_path):
    page, faults = opened(run.scene(tmp_path / "run.html", frames=5).path, width=390, height=780)
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    assert page.evaluate("document.querySelector('#panel').getBoundingClientRect().bottom") <= 780
    assert faults == []
