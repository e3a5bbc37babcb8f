"""Bars of what takes long, and lines in the log where there is no terminal."""

import logging
from types import SimpleNamespace

import pytest
from oracles import box

import exudyn_partition as ep
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


@pytest.mark.parametrize(("after", "lines"), [(0.0, ["30 %", "90 %"]), (60.0, [])])
def test_without_a_terminal_each_tenth_is_a_line_in_the_log(caplog, after, lines):
    with caplog.at_level(logging.INFO, "exudyn_partition"), ep.progress("a long study", after=after) as report:
        for share in (0.05, 0.31, 0.39, 0.9, 0.95):
            report(share)
    assert [record.getMessage().split(" after")[0] for record in caplog.records] == [
        f"a long study: {line}" for line in lines
    ]
