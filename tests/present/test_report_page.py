"""The page of a run: its numbers are the run's, it stands alone, and it says what went wrong."""

import base64
import dataclasses
import html
import json
import re
import warnings
from html.parser import HTMLParser
from xml.etree import ElementTree

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
import pytest
from oracles import MARBLE_RADIUS, TOP, add_loads

import exudyn_partition as ep
from exudyn_partition.errors import InputError, StoppedRunWarning, YieldWarning


class Cells(HTMLParser):
    """Rows of all tables, as text, and the sources of all images; open tags are counted."""

    def __init__(self, page):
        super().__init__()
        self.rows, self.images, self.open = [], [], []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
        if tag == "img":
            self.images.append(dict(attrs)["src"])
        elif tag != "meta":
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] in ("td", "th"):
            self.rows[-1][-1] += data

    def row(self, first):
        (found,) = (row[1:] for row in self.rows if row and row[0] == first)
        return found


def read(path):
    page = path.read_text(encoding="utf-8")
    cells = Cells(page)
    assert not cells.open
    return page, cells


def test_the_page_holds_the_run_s_own_numbers(impact, tmp_path):
    mbs, striker, target, contact = impact
    result = ep.solve_dynamic(mbs, end_time=60e-6, step=0.2e-6)
    path = result.report(tmp_path / "run.html", title="ball <on> block")
    page, cells = read(path)
    assert "<h1>ball &lt;on&gt; block</h1>" in page
    force = contact.force(result)
    peak, when = cells.row("peak force")[0].split(" N at ")
    assert float(peak) == pytest.approx(force.max(), rel=1e-4)
    assert float(when.split()[0]) == pytest.approx(result.t[force.argmax()], rel=1e-5)
    assert float(cells.row("impulse")[0].split()[0]) == pytest.approx(np.trapezoid(force, result.t), rel=1e-4)
    assert cells.row("step") == ["2e-07 s, 300 steps"]
    stress = contact.largest_stress(result)
    assert float(cells.row("Hertz-equivalent pressure")[0].split()[0]) == pytest.approx(
        1e-6 * stress.pressure, rel=1e-3
    )
    assert cells.row("von Mises stress of the master")[0].endswith("times its yield stress")
    assert "the von Mises stress of the slave reaches" in page
    energy = striker.energy(result) + target.energy(result) + contact.energy(result)
    start, end, change = map(float, cells.row("with contacts' [J]"))
    assert (start, end) == pytest.approx((energy[0], energy[-1]), rel=1e-5)
    assert change == pytest.approx(energy[-1] - energy[0], rel=0.01, abs=1e-9 * energy.max())
    assert float(cells.row("momentum z [N s]")[0]) == pytest.approx(-striker.body.total_mass, rel=1e-5)
    assert abs(float(cells.row("momentum z [N s]")[2])) < 1e-9 * striker.body.total_mass
    assert cells.row("exudyn") == [ep.versions()["exudyn"]]
    for said in (*striker.left_out, *contact.left_out):
        assert said in html.unescape(page)
    (listed,) = (row for row in cells.rows if len(row) == 8 and re.fullmatch(r"[\d.e-]+", row[0]))
    (impact_,) = contact.impacts(result)
    numbers = [impact_.peak, impact_.mean_force, impact_.impulse, impact_.speed_before, impact_.speed_after]
    numbers.append(impact_.restitution)
    assert [*map(float, listed[2:])] == pytest.approx(numbers, rel=1e-5)


@pytest.mark.filterwarnings("ignore:.*facets")  # what counts is the order of the impacts
@pytest.mark.parametrize("pushed", [True, False])
def test_the_page_says_why_bodies_separate_faster_than_they_approach(mbs, marble, tmp_path, pushed):
    """A ball on a plane is struck from above while they touch, and rebounds twice as fast, at the same energy."""
    lower = ep.CreatePartitionBody(mbs, marble, name="lower", initialVelocity=[0, 0, -0.1])
    plane = ep.RigidPlane(point=(0, 0, -MARBLE_RADIUS - 1e-6))
    contact = ep.CreatePartitionContact(mbs, lower, plane, slavePatch="south", name="floor")
    if pushed:
        place = [0, 0, 2 * MARBLE_RADIUS + 6e-6]
        upper = ep.CreatePartitionBody(mbs, marble, name="upper", referencePosition=place, initialVelocity=[0, 0, -0.6])
        ep.CreatePartitionContact(mbs, upper, lower, slavePatch="south", masterPatch="north", name="between")
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=120e-6)
    energy = sum(item.energy(result) for item in result.bodies) + sum(c.energy(result) for c in result.contacts)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-3)
    impacts = [i for i in contact.impacts(result) if i.speed_before is not None and i.speed_after is not None]
    faster = [i for i in impacts if i.speed_after > 1.5 * i.speed_before]
    page, _ = read(result.report(tmp_path / "run.html"))
    said = f"In {len(faster)} of {len(impacts)} sub-impacts the bodies separate faster than they approach."
    assert bool(faster) == pushed
    assert (said in page) == pushed
    assert ("In 1 of these another contact pushed one of the bodies meanwhile." in page) == pushed


@pytest.mark.parametrize("known", [True, False])
def test_the_page_says_each_warning_once(impact, tmp_path, known):
    """On top as the run gave it; of a run that was read from a file, which has no warnings, beside its contact."""
    mbs, *_ = impact
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = ep.solve_dynamic(mbs, end_time=60e-6, step=0.2e-6)
    result = result if known else dataclasses.replace(result, warnings=None)
    page, _ = read(result.report(tmp_path / "run.html"))
    told = re.findall(r'<details class="warning">.*?</details>', page, flags=re.DOTALL)
    assert sum("the von Mises stress of the slave reaches" in one for one in told) == 1
    assert ("Beyond first yield" in page) != known


def test_the_page_stands_alone_with_its_figures(impact, tmp_path):
    mbs, *_ = impact
    result = ep.solve_dynamic(mbs, end_time=40e-6, step=0.2e-6)
    page, cells = read(result.report(tmp_path / "run.html"))
    assert len(cells.images) == 2  # force and energy
    assert not re.search(r"(src|href)=\"(?!data:image/(png|svg\+xml);base64,)", page)
    curves = (base64.b64decode(source.split(",")[1]) for source in cells.images)
    titles = [{*ElementTree.fromstring(curve).itertext()} for curve in curves]
    assert "time [ms]" in titles[0] & titles[1]
    (frame,) = re.findall(r'<iframe[^>]* srcdoc="([^"]*)"', page)
    facts = json.loads(re.search(r'<script id="facts"[^>]*>(.*?)</script>', html.unescape(frame), re.DOTALL)[1])
    assert len(facts["bodies"]) == 2
    assert facts["scale"] >= 10


def test_a_phone_shows_the_page_without_scrolling_aside(impact, tmp_path, opened):
    mbs, *_ = impact
    result = ep.solve_dynamic(mbs, end_time=40e-6, step=0.2e-6)
    page, faults = opened(result.report(tmp_path / "run.html"), width=390, height=780, ready="true")
    page.frames[1].wait_for_function("window.ready === true")
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    assert page.locator("details").count() == page.locator("details:not([open])").count() > 0
    assert faults == []


def test_a_dark_theme_is_dark_and_figures_stay_on_white(impact, tmp_path, opened):
    mbs, *_ = impact
    result = ep.solve_dynamic(mbs, end_time=4e-6, step=0.2e-6)
    page, _ = opened(result.report(tmp_path / "run.html"), ready="true")
    page.emulate_media(color_scheme="dark")
    colour = (
        "([name, key]) => getComputedStyle(document.querySelector(name))[key].match(/[0-9]+/g).slice(0, 3).map(Number)"
    )
    assert max(page.evaluate(colour, ["body", "backgroundColor"])) < 60
    assert min(page.evaluate(colour, ["body", "color"])) > 200
    assert page.evaluate(colour, [".zoom", "backgroundColor"]) == [255, 255, 255]


def test_a_run_that_ended_early_says_so(impact, tmp_path):
    mbs, *_ = impact
    mbs.SetPreStepUserFunction(lambda mbs, t: t < 10e-6)
    with pytest.warns(StoppedRunWarning):
        result = ep.solve_dynamic(mbs, end_time=40e-6, step=0.2e-6)
    page, _ = read(result.report(tmp_path / "run.html"))
    assert re.search(r'<p class="warning">interrupted: a PreStep or other user function ended the run', page)


def test_bodies_that_miss_each_other(mbs, bodies, tmp_path):
    striker = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP, initialVelocity=[0, 0, 1.0])
    ep.CreatePartitionContact(mbs, striker, ep.CreatePartitionBody(mbs, bodies[1]))
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=10e-6, step=0.2e-6)
    _, cells = read(result.report(tmp_path / "run.html"))
    assert cells.row("peak force")[0].startswith("none: the bodies did not touch; smallest gap ")


def test_a_surface_carried_by_another_body(mbs, bodies, tmp_path):
    """Its contact cannot be evaluated after the run, which tells what it stored: nothing is lost while it is closed."""
    ground = mbs.AddObject(items.ObjectGround())
    striker = ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=[0, 0, -1.0])
    ep.CreatePartitionContact(mbs, striker, ep.RigidPlane((0, 0, 0), (0, 0, 1)), masterBody=ground)
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = 10e-6, 100
    settings.timeIntegration.verboseMode = 0
    settings.solution.sensors.writePeriod = 0.1e-6
    settings.solution.file.write = False
    mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.VelocityVerlet)
    _, cells = read(ep.collect(mbs).report(tmp_path / "run.html"))
    before, after, _ = map(float, cells.row("with contacts' [J]"))
    assert after == pytest.approx(before, rel=1e-4)
    assert float(cells.row("energy of the bodies [J]")[1]) < 0.99 * after
    assert cells.row("step") == ["1e-07 s, 100 steps"]


def test_a_page_needs_a_folder(impact, tmp_path):
    mbs, *_ = impact
    result = ep.solve_dynamic(mbs, end_time=2e-6, step=0.2e-6)
    with pytest.raises(InputError, match=r"there is no folder .*nowhere to write run\.html into; make it first"):
        result.report(tmp_path / "nowhere" / "run.html")


def test_the_page_lists_the_warnings_of_the_run(impact, tmp_path):
    """They also come as warnings, from the line that ran the model."""
    mbs, *_ = impact
    with pytest.warns(YieldWarning) as caught:
        result = ep.solve_dynamic(mbs, end_time=40e-6, step=0.2e-6)
    assert [str(warning.message) for warning in caught] == [*result.warnings]
    assert {warning.filename for warning in caught} == {__file__}
    assert ep.collect(mbs).warnings == result.warnings
    page, _ = read(result.report(tmp_path / "run.html"))
    assert all(f"</summary>{text}</details>" in html.unescape(page) for text in result.warnings)
    result.save(tmp_path / "run.npz")
    assert ep.Result.load(tmp_path / "run.npz", mbs).warnings == result.warnings
    unknown = dataclasses.replace(result, warnings=None)
    assert "Warnings of the run are not known" in read(unknown.report(tmp_path / "unknown.html"))[0]
    early, _ = read(ep.solve_dynamic(mbs, end_time=1e-6, step=0.2e-6).report(tmp_path / "early.html"))
    assert "The run gave no warning" in early


def test_what_several_items_leave_out_is_said_once(impact, tmp_path):
    mbs, striker, target, _ = impact
    result = ep.solve_dynamic(mbs, end_time=2e-6, step=0.2e-6)
    page = html.unescape(read(result.report(tmp_path / "run.html"))[0])
    (both,) = (said for said in striker.left_out if said in target.left_out and said.startswith("strain and stress"))
    assert page.count(both) == 1
    assert f"{both} <i>(body 0, body 1)</i>" in page


OTHERS = "given by joints, springs and loads (ep.CreateWorkSensor tells them apart); else the steps' error [J]"


def test_what_all_else_gave_is_in_the_balance(mbs, bodies, tmp_path):
    """A body under its weight gains the weight's work, which has a row; under a load, the last row has the load's."""
    striker = ep.CreatePartitionBody(mbs, bodies[0], gravity=[0, 0, -9.81], initialVelocity=[0, 0, -1.0])
    add_loads(mbs, striker, np.asarray(striker.body.mass @ striker.body.rigid)[:, 2] * -9.81)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=20e-6, step=0.2e-6)
    _, cells = read(result.report(tmp_path / "run.html"))
    given = [float(cells.row(name)[1]) for name in ("given by gravity on body 0 [J]", OTHERS)]
    assert given == pytest.approx([striker.body.total_mass * 9.81 * 20e-6] * 2, rel=1e-3)


def test_what_damping_steps_took_is_in_the_balance(impact, tmp_path):
    mbs, *_ = impact
    result = ep.solve_dynamic(mbs, end_time=40e-6, step=0.4e-6, method="implicit", spectral_radius=0.3)
    _, cells = read(result.report(tmp_path / "run.html"))
    taken = float(cells.row("taken by the damping of the steps [J]")[1])
    assert taken > 0
    assert float(cells.row(OTHERS)[1]) == pytest.approx(float(cells.row("with contacts' [J]")[2]) + taken, rel=0.01)


def test_adaptive_steps_are_named(mbs, bodies, tmp_path):
    striker = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP, initialVelocity=[0, 0, -1.0])
    ep.CreatePartitionContact(mbs, striker, ep.CreatePartitionBody(mbs, bodies[1], referencePosition=[0, 0, -20e-6]))
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=40e-6, method="implicit", step=0.2e-6, adaptive=True)
    _, cells = read(result.report(tmp_path / "run.html"))
    said = re.fullmatch(r"adaptive, 2e-07 s in contact, (\S+) s in the mean, (\d+) steps", cells.row("step")[0])
    assert float(said[1]) == pytest.approx(40e-6 / int(said[2]), rel=1e-3)
