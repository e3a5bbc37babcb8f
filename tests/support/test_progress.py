"""Bars of what takes long, and lines in the log where there is no terminal."""

import logging
import time
from types import SimpleNamespace

import exudyn as exu
import pytest
from oracles import box

import exudyn_partition as ep
from exudyn_partition.simulation import hooks
from exudyn_partition.support import progress


class Terminal:
    """Takes the place of rich's bar on a terminal; tells what happens to it."""

    disable = False

    def __init__(self):
        self.calls, self.live = [], SimpleNamespace(is_started=False)

    def add_task(self, title, total):
        self.calls.append((title, total))

    def start(self):
        self.live.is_started = True
        self.calls.append("start")

    def stop(self):
        self.calls.append("stop")


@pytest.mark.parametrize(("long", "expected"), [(0.0, ["start", "stop"]), (60.0, [])])
def test_what_takes_long_shows_that_it_runs(monkeypatch, long, expected):
    bar = Terminal()
    monkeypatch.setattr(progress, "terminal_bar", lambda: bar)
    monkeypatch.setattr(progress, "LONG", long)
    ep.generate_mesh(box(1, 1, 1), maxh=0.5)
    assert bar.calls == [("mesh", None), *expected]


def test_work_without_a_share_tells_how_long_it_has_taken_where_there_is_no_bar(monkeypatch, caplog):
    """Ever less often, and no more after its end."""
    monkeypatch.setattr(progress, "FIRST_LINE", 0.02)
    with caplog.at_level(logging.INFO, "exudyn_partition"):  # `capsys` may lose a line that another thread writes
        with progress.pulsing("mesh"):
            while len(caplog.messages) < 2:  # the watch of another thread
                time.sleep(1e-3)
        told_until_its_end = list(caplog.messages)
        time.sleep(0.1)
        assert caplog.messages == told_until_its_end
    assert told_until_its_end[:2] == ["mesh: 0.02 s so far", "mesh: 0.04 s so far"]


class Clock:
    """A clock that a test sets."""

    def __init__(self, monkeypatch):
        self.now = 0.0
        monkeypatch.setattr(progress.time, "perf_counter", lambda: self.now)


def told(monkeypatch, title, reports, **options):
    """Report shares at times [s]."""
    clock = Clock(monkeypatch)
    with ep.progress(title, **options) as report:
        for clock.now, share in reports:
            report(share)


EVENLY = [(0.5 * k, 0.5 * k / 124) for k in range(240)]  # work of 124 s


def test_work_that_takes_long_says_so_ahead_and_on_the_way(monkeypatch, capsys):
    """Without a terminal, as in pipes and notebooks: lines on stderr, ever less often."""
    told(monkeypatch, "a long study", EVENLY)
    assert capsys.readouterr().err.splitlines() == [
        "a long study: about 2.1 min in all",
        "a long study: 8% after 10 s, about 1.9 min left",
        "a long study: 16% after 20 s, about 1.7 min left",
        "a long study: 32% after 40 s, about 84 s left",
        "a long study: 65% after 80 s, about 44 s left",
    ]


def test_a_log_that_takes_such_lines_has_them_instead(monkeypatch, capsys, caplog):
    with caplog.at_level(logging.INFO, "exudyn_partition"):
        told(monkeypatch, "a long study", EVENLY)
    assert len(caplog.records) == 5
    assert not capsys.readouterr().err


def test_compiling_at_the_start_does_not_count(monkeypatch, capsys):
    """Thirty seconds in which nothing happens, then all in three."""
    told(monkeypatch, "steps", [(30.0, 0.01), *[(30.0 + k, 0.01 + 0.33 * k) for k in (1, 2)], (33.0, 1.0)])
    assert capsys.readouterr().err.splitlines() == ["steps: 34% after 31 s, about 2 s left", "steps: about 33 s in all"]


def test_compiling_at_the_first_touch_does_not_count(monkeypatch, capsys):
    """A loop is compiled for four seconds in the second look; hours were told for a run of 24 s."""
    told(monkeypatch, "steps", [(1.0, 0.05), (5.0, 0.0501), *[(5.0 + k, 0.05 + 0.05 * k) for k in range(1, 20)]])
    assert capsys.readouterr().err.splitlines()[0] == "steps: about 24 s in all"


def test_work_that_hardly_goes_on_is_told_no_time(monkeypatch, capsys):
    told(monkeypatch, "load steps", [(1.5, 0.05), (3.0, 0.1), (12.0, 0.1 + 1e-16), (30.0, 0.12)])
    assert capsys.readouterr().err.splitlines() == [
        "load steps: 10% after 12 s, it hardly goes on",
        "load steps: 12% after 30 s, about 13 min left",
    ]


def test_short_work_says_nothing(monkeypatch, capsys):
    told(monkeypatch, "steps", [(0.1 * k, k / 90) for k in range(91)])
    assert not capsys.readouterr().err


def test_work_shorter_than_its_bar_makes_none(monkeypatch):
    """To make a bar takes longer than a short run; one that comes late counts from the begin of the work."""
    made, terminal_bar = [], progress.terminal_bar
    monkeypatch.setattr(progress, "terminal_bar", lambda: made.append(terminal_bar()) or made[-1])
    told(monkeypatch, "steps", [(0.1, 0.1), (1.9, 0.9)], after=2.0)
    assert not made
    told(monkeypatch, "steps", [(0.5, 0.1), (2.5, 0.5)], after=2.0)
    assert made[0].tasks[0].finished_time == 2.5


def test_a_run_that_is_slow_is_looked_at_each_second(monkeypatch, marble):
    """Its first hundredth may take long: the share done is told before."""
    clock, shares = Clock(monkeypatch), []
    monkeypatch.setattr(hooks.time, "perf_counter", lambda: clock.now)
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, marble, initialVelocity=[0, 0, -0.1], referencePosition=[0, 0, 0.02])
    ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), slavePatch="south")
    mbs.Assemble()

    def slow(mbs, t):
        clock.now += 0.6
        return True

    mbs.SetPreStepUserFunction(slow)
    ep.solve_dynamic(mbs, end_time=1e-4, step=1e-7, progress=shares.append)
    assert 480 <= len(shares) <= 520


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.0, "0 s"), (8.26, "8.3 s"), (89.0, "89 s"), (90.1, "1.5 min"), (5300, "88 min"), (9e4, "25 h")],
)
def test_times_have_the_unit_that_suits_them(seconds, text):
    assert progress.duration(seconds) == text
