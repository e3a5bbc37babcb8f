"""The page that plays: what it holds, and what a browser makes of it."""

import base64
import gzip
import html
import io
import itertools
import json
import re

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
import pytest
from exudyn import graphics
from exudyn.utilities import InertiaCuboid
from oracles import MARBLE_RADIUS, hit_by_a_spinning_ball
from PIL import Image

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
    motion = motion_of(run, frames=times).rounded()
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


@pytest.fixture(scope="module")
def bounces(marble):
    """A marble between two floors hits each, in 3 ms; an impact lasts a hundredth of that. Model, contacts and run."""
    mbs, way = exu.SystemContainer().AddSystem(), 1e-3
    ball = ep.CreatePartitionBody(
        mbs, marble, name="marble", referencePosition=[0, 0, MARBLE_RADIUS + 2e-6], initialVelocity=[0, 0, -0.5]
    )
    floor = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), slavePatch="south", name="floor")
    top = ep.RigidPlane((0, 0, 2 * MARBLE_RADIUS + way), (0, 0, -1))
    roof = ep.CreatePartitionContact(mbs, ball, top, slavePatch="north", name="roof")
    mbs.Assemble()
    return mbs, floor, roof, ep.solve_dynamic(mbs, end_time=3e-3, method="implicit", adaptive=True)


def test_what_the_page_tells_of_short_impacts_is_of_all_samples(bounces):
    """Frames, curves, pressures and colours have the peak of each impact, however few frames are asked for."""
    _, *contacts, run = bounces
    page = run.scene(frames=7).page
    facts, array = read(page)
    total = sum(contact.force(run) for contact in contacts)
    assert facts["start"] == run.t[total.argmax()]
    assert [entry["name"] for entry in facts["forces"]] == ["floor", "roof"]
    for contact, given, spot in zip(contacts, facts["forces"], facts["spots"], strict=True):
        force = contact.force(run)
        assert force.max() > 100
        t, values = array(given["curve"]).reshape(-1, 2).T
        assert values.max() == pytest.approx(force.max(), rel=1e-6)  # single precision
        assert t[values.argmax()] == pytest.approx(run.t[force.argmax()], rel=1e-6)
        assert spot["time"] == run.t[force.argmax()]
        assert spot["time"] in facts["t"]
        first, last = run.t[np.flatnonzero(force)[[0, -1]]]
        if last - first < 0.5e-3:  # a single impact
            assert sum(first <= time <= last for time in facts["t"]) >= 9
            assert any(start <= spot["time"] <= end for start, end in facts["slow"])
    (pressure,) = (colour for colour in facts["colours"] if "pressure" in colour["name"])
    closed = run.t[total > 0]
    each, _ = read(run.scene(frames=closed[:: len(closed) // 300], colours=["contact_pressure"]).page)
    assert pressure["largest"] > 0.98 * each["colours"][0]["largest"]
    assert pressure["end"] > 0.3


def test_the_report_has_the_same_scene(bounces, tmp_path):
    *_, run = bounces
    report = run.report(tmp_path / "run.html").read_text()
    (frame,) = re.findall(r'<iframe[^>]* srcdoc="([^"]*)"', report)
    here, there = (read(page)[0] for page in (run.scene().page, html.unescape(frame)))
    for key in ("t", "speeds", "colours", "slow", "spots", "scale"):
        assert here[key] == there[key]


def test_impacts_are_played_slowly(opened, bounces, tmp_path):
    *_, run = bounces
    page, faults = opened(run.scene(tmp_path / "run.html").path)
    facts, _ = read((tmp_path / "run.html").read_text())
    start, end = facts["slow"][0]
    assert end - start < 0.05 * run.t[-1]
    assert page.locator("#slowly").is_visible()
    assert page.locator("#curves").text_content().startswith("floor: largest ")
    page.evaluate(f"scene.set({start - 1e-9})")
    page.click("#play")
    page.wait_for_function(f"scene.state.time > {start}", timeout=30_000)
    page.wait_for_function("document.querySelector('#slowed').textContent.startsWith('slow motion, 1 s = ')")
    page.wait_for_timeout(200)
    assert page.evaluate("scene.state.time") < end  # at 0.75 ms a second it would be over
    page.uncheck("#slow")
    page.wait_for_function(f"scene.state.time > {end}", timeout=30_000)
    page.wait_for_timeout(100)
    assert page.locator("#slowed").text_content() == ""
    assert faults == []


def test_the_force_that_is_told_is_that_of_the_sample(opened, bounces, tmp_path):
    _, *contacts, run = bounces
    page, _ = opened(run.scene(tmp_path / "run.html").path)
    total = sum(contact.force(run) for contact in contacts)
    told = re.search(r"force (\S+) N", page.locator("#time").text_content())[1]
    assert float(told) == pytest.approx(total.max(), rel=1e-3)
    assert float(page.locator("#peak").text_content().split()[0]) == pytest.approx(total.max(), rel=1e-3)
    page.focus("canvas")
    page.keyboard.press("ArrowRight")
    times = page.evaluate("scene.times")
    assert page.evaluate("scene.state.time") == times[times.index(run.t[total.argmax()]) + 1]


def test_a_curve_of_few_points_has_the_ends_of_each_part():
    """Between neighbouring points no sample is above or below both by more than a pixel's width beside it."""
    t = np.sort(np.random.default_rng(0).random(50_000))
    force = np.maximum(0.0, np.sin(300 * t)) * 1e-4  # far below a millinewton
    at, curve = force_curve(t, force).T
    assert len(at) < 2500
    assert np.isin(at, t).all()
    assert curve.max() == force.max()
    edges = np.linspace(t[0], t[-1], 1201)
    for start, end in itertools.pairwise(edges):
        near = force[(t >= start) & (t < end)]
        kept = curve[(at >= start) & (at < end)]
        assert (kept.min(), kept.max()) == (near.min(), near.max())


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
    motion = motion_of(run, frames=times).rounded()
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
    seen = [still]
    for look in ("faded", "hidden", "solid"):
        page.click("#bodies label:nth-child(2) input")
        page.wait_for_timeout(200)
        assert page.get_attribute("#bodies label:nth-child(2) input", "aria-label") == f"plate: {look}"
        seen.append(page.locator("canvas").screenshot())
    assert seen[3] == seen[0]
    assert len({*seen}) == 3
    assert faults == []


def test_what_is_within_a_drum_is_seen(opened, mbs, round_body, tmp_path):
    """A closed drum around a ball begins see-through, and a floor beneath it does not."""
    item = ep.CreatePartitionBody(mbs, round_body, name="ball", initialVelocity=[0, 0, -1.0])
    drum = graphics.Cylinder(pAxis=[-0.03, 0, 0.01], vAxis=[0.06, 0, 0], radius=0.02, nTiles=32)
    mbs.CreateGround(name="drum", graphicsDataList=[drum])
    mbs.CreateGround(name="floor", graphicsDataList=[graphics.Brick(centerPoint=[0, 0, -0.05], size=[0.1, 0.1, 0.01])])
    ep.CreatePartitionContact(mbs, item, ep.RigidPlane())
    mbs.Assemble()
    run = ep.solve_dynamic(mbs, end_time=20e-6, step=1e-6)
    page, faults = opened(run.scene(tmp_path / "run.html", frames=3).path)
    looks = {name: page.evaluate(f"scene.surfaces.find(s => s.name == '{name}').look") for name in ("drum", "floor")}
    assert looks == {"drum": "faded", "floor": "solid"}
    assert page.evaluate("scene.bodies[0].look") == "solid"
    box = page.locator("#bodies label:nth-child(2) input")
    assert box.evaluate("box => box.indeterminate")
    through = page.locator("canvas").screenshot()
    box.click()  # now hidden
    box.click()
    page.wait_for_timeout(200)
    assert page.evaluate("scene.surfaces.map(s => s.look)").count("solid") == 3
    assert page.locator("canvas").screenshot() != through
    assert faults == []


def test_a_contact_is_looked_at_on_the_body_that_it_presses(opened, run, tmp_path):
    """Seen from where the other body is, which is faded, at its peak; once more pressed, the other body's side."""
    page, faults = opened(run.scene(tmp_path / "run.html").path)
    facts, _ = read((tmp_path / "run.html").read_text())
    (spot,) = facts["spots"]
    assert page.locator("#views button").all_text_contents() == ["all", spot["name"], "front", "side", "top"]
    page.evaluate("scene.set(scene.times[0])")
    page.select_option("#colour", label="contact pressure")
    button = f"#views button:text-is('{spot['name']}')"
    for side, sign in ((0, 1.0), (1, -1.0)):
        page.click(button)
        page.wait_for_timeout(200)
        assert page.evaluate("scene.state.time") == spot["time"]
        assert page.evaluate("scene.state.scale") == 1
        looks = page.evaluate("scene.bodies.map(body => body.look)")
        assert looks == [["solid", "faded"], ["faded", "solid"]][side]
        eye = page.evaluate("scene.eye()")
        assert sign * np.dot(np.subtract(eye, spot["place"]), spot["push"]) < 0  # on the other body's side
        if side == 0:  # the middle of the picture is where pressure is large, which is dark
            pixels = picture(page)
            high, wide = pixels.shape[0] // 2, pixels.shape[1] // 2
            assert pixels[high, wide].sum() < pixels[high, wide // 5].sum() - 150
    page.click("#views button:text-is('side')")
    page.wait_for_timeout(200)
    assert page.evaluate("scene.bodies.map(body => body.look)") == ["solid", "solid"]
    away = np.linalg.norm(page.evaluate("scene.eye()"))
    assert away > 1.5 * facts["size"]  # outside of all bodies, whatever was looked at before
    assert faults == []


def picture(page):
    """Pixels of the canvas, (height, width, 3) int."""
    page.wait_for_timeout(200)
    return np.asarray(Image.open(io.BytesIO(page.locator("canvas").screenshot())).convert("RGB"), dtype=int)


def test_signs_are_drawn_where_joints_are(opened, mbs, arm_body, tmp_path):
    """Within the body too; the pointer gets their names, and a box takes them away."""
    arm = ep.CreatePartitionBody(mbs, arm_body, name="arm", frame="floating", gravity=[0, 0, -9.81])
    foot = arm.CreateInterfaceMarker(mbs, "foot")
    pin = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.CreateGround()))
    mbs.AddObject(items.GenericJoint(name="pin", markerNumbers=[pin, foot], constrainedAxes=[1, 1, 1, 1, 0, 1]))
    mbs.Assemble()
    run = ep.solve_dynamic(mbs, end_time=2e-4, step=1e-5, method="implicit")
    page, faults = opened(run.scene(tmp_path / "run.html", frames=3).path)
    assert page.evaluate("scene.signs.map(sign => sign.name)") == ["hinge 'pin'", "ground 'pin'", "gravity, 9.81 m/s2"]
    middle = -np.mean(motion_of(run, frames=3).bounds, axis=0)  # of the page is that of what moves; the pin is at zero
    drawn = np.array(page.evaluate("Array.from(scene.signs[0].places)")).reshape(-1, 3)
    np.testing.assert_allclose((drawn.min(axis=0) + drawn.max(axis=0)) / 2, middle, atol=1e-6)
    x, y, _ = page.evaluate("scene.pixel(scene.signs[0], 0)")
    box = page.locator("canvas").bounding_box()
    page.mouse.move(box["x"] + x, box["y"] + y)
    assert page.locator("#value").text_content() == "hinge 'pin'"
    with_signs = picture(page)
    page.uncheck("#signs")
    without = picture(page)
    assert (abs(with_signs - without).max(axis=2) > 30).mean() > 2e-3
    page.mouse.move(box["x"] + 5, box["y"] + box["height"] - 5)
    assert faults == []


def test_a_dark_theme_is_dark(opened, run, tmp_path):
    page, _ = opened(run.scene(tmp_path / "run.html", frames=2).path)
    light = picture(page)[-3, 3]
    page.emulate_media(color_scheme="dark")
    dark = picture(page)[-3, 3]
    assert light.min() > 240
    assert dark.max() < 60


def test_a_plane_cuts_bodies(opened, run, tmp_path):
    """What is before the plane is not drawn, and the inside of a cut body looks full."""
    page, faults = opened(run.scene(tmp_path / "run.html", scale=1.0).path)
    whole = picture(page)
    assert page.locator("#place").is_hidden()
    page.select_option("#cut", "y")
    half = picture(page)
    assert page.evaluate("scene.state.cut.side") == -1  # the viewer is at negative y, and that half is cut off
    page.evaluate("p => { p.value = p.min; p.oninput({ target: p }) }", page.locator("#place").element_handle())
    before = picture(page)  # the plane is before all

    def changed(now):
        return (abs(now - whole).max(axis=2) > 30).mean()

    assert changed(before) < 2e-3  # edges alone
    assert changed(half) > 0.05
    page.select_option("#cut", "")
    assert changed(picture(page)) == 0
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
