"""The runner of the validation: sweeps over executors, resuming, what a report says."""

import concurrent.futures
import json
import os
import sys
from pathlib import Path

import pytest

from validation import run_all


def die_once(mark):
    """A call whose process dies the first time."""
    if not Path(mark).exists():
        Path(mark).touch()
        os._exit(1)
    return "done"


def fail_once(mark):
    if not Path(mark).exists():
        Path(mark).touch()
        raise RuntimeError("a worker died")
    return "done"


def test_a_call_that_fails_is_made_again_and_others_are_not_lost(tmp_path):
    tasks = {"first": (str(tmp_path / "a"),), "second": (str(tmp_path / "b"),)}
    with concurrent.futures.ThreadPoolExecutor(1) as executor:
        assert dict(run_all.sweep(fail_once, tasks, executor)) == {"first": "done", "second": "done"}
        (tmp_path / "b").unlink()
        found = dict(run_all.sweep(fail_once, tasks, executor, retries=0))
    assert found["first"] == "done"
    assert isinstance(found["second"], RuntimeError)


def test_a_dask_worker_that_dies_loses_only_its_case(tmp_path):
    distributed = pytest.importorskip("distributed")
    tasks = {name: (str(tmp_path / name),) for name in "abc"}
    (tmp_path / "b").touch()
    own = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0"}
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, **own) as cluster,
        distributed.Client(cluster) as client,
    ):
        found = dict(run_all.sweep(die_once, tasks, client.get_executor()))
    assert found == {"a": "done", "b": "done", "c": "done"}


@pytest.fixture
def scripts(tmp_path, monkeypatch):
    """A folder with scripts: one that holds, one that does not, one that hangs, one without an end, one that lacks."""
    folder = tmp_path / "validation"
    folder.mkdir()
    (folder / "good.py").write_text(
        "import json, pathlib\n"
        "pathlib.Path(__file__).with_suffix('.json').write_text(json.dumps({'limits': {'x': 1.0}, 'x': 0.5}))\n"
    )
    (folder / "bad.py").write_text("import sys\nsys.exit('beyond the stated limits: y')\n")
    (folder / "hangs.py").write_text("import time\ntime.sleep(60)\n")
    (folder / "busy.py").write_text("while True:\n    pass\n")
    (folder / "lacks.py").write_text("print('skipped: no other code here')\n")
    monkeypatch.setattr(run_all, "HERE", folder)
    names = "good", "bad", "hangs", "busy", "lacks"
    cases = {name: run_all.Case(f"{name}.py", run_all.limits(("x",)), quick=()) for name in names}
    monkeypatch.setattr(run_all, "CASES", cases)
    monkeypatch.setattr(run_all, "QUICK_LIMIT", 1.0)
    monkeypatch.setattr(run_all, "STALL", 4.0)
    return folder


def test_failures_are_isolated_listed_and_what_is_done_is_not_done_again(scripts, monkeypatch, capsys):
    out = scripts / "out"
    monkeypatch.setattr(sys, "argv", ["run_all.py", "--quick", "--jobs", "5", "--out", str(out)])
    with pytest.raises(SystemExit, match="failed: bad, hangs, busy"):
        run_all.main()
    page, text = (out / "report.html").read_text(), (out / "report.md").read_text()
    assert "| good | x | stated limit | 1 | 0.5 | yes |" in text
    assert "beyond the stated limits: y" in text
    assert "| lacks | not run |  |  | skipped: no other code here | skipped |" in text
    assert "used no processor time for 4 s" in page
    assert "not done after 1 s of processor time" in page
    assert run_all.commit() in page
    good = (out / "good.json").stat().st_mtime_ns
    with pytest.raises(SystemExit):
        run_all.main()
    assert (out / "good.json").stat().st_mtime_ns == good
    assert "good: done for" in capsys.readouterr().out


def test_waiting_beside_other_work_costs_a_case_no_time(scripts, monkeypatch):
    """A case that spends longer than its limit, but hardly any processor time, ends by itself."""
    (scripts / "hangs.py").write_text("import time\ntime.sleep(1.5)\n")
    record = run_all.run_case("hangs", str(scripts), True, "a commit")
    assert record["code"] == 0
    assert record["time_s"] > 1.5 > run_all.QUICK_LIMIT > record["processor_s"]


# The scripts say so too: corrections of meshes that no promise is made for, and reviews of runs whose steps are short.
BEYOND = {"correct: least", "outside_steps: fifty"}


def test_headline_numbers_of_all_stored_results_can_be_read_and_hold():
    """Those of the results in the repository, by the list of cases."""
    beyond = set()
    for name, case in run_all.CASES.items():
        record = {"name": name, "data": json.loads(case.result(()).read_text()), "code": 0, "message": ""}
        *rows, _ = run_all.headline(record)
        assert rows or name == "crank_slider", name  # which only compares
        assert all(reference != "the list in run_all.py" for _, reference, *_ in rows), (name, rows)
        beyond |= {f"{name}: {quantity}" for quantity, *_, agrees in rows if not agrees}
    assert beyond == BEYOND
