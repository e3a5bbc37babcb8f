"""Studies from the command line: points, tasks of an array, failures."""

import json
import sys

import numpy as np
import pytest

import exudyn_partition as ep
from exudyn_partition.cli import main

FUNCTION = """
def product(x, y, unit="m"):
    if x == 13:
        raise ValueError("bad luck")
    return {"area": x * y, "unit": unit}
"""


@pytest.fixture
def study(tmp_path, capsys, monkeypatch):
    """Call the command with the function in a file; its exit code, what it tells, and stderr."""
    (tmp_path / "products.py").write_text(FUNCTION)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)  # and taken away again
    monkeypatch.delitem(sys.modules, "products", raising=False)

    def call(*arguments):
        code = main(["study", "products.py:product", *arguments, "-o", "study.jsonl", "--json"])
        out, err = capsys.readouterr()
        return code, json.loads(out), err

    return call


def test_tasks_of_an_array_are_put_together_and_what_failed_is_told(study):
    points = ["--grid", "x=1,2,13", "--grid", "unit=mm", "--between", "y=-1,1", "--count", "4"]
    for task in ("1/2", "2/2"):
        code, told, err = study(*points, "--task", task)
        assert (code, told["runs"], told["new"], told["failed"]) == (1, 6, 6, 2)
        assert "warning: 2 of 6 runs failed, the first: ValueError: bad luck (at x=13, unit='mm', y=" in err
    code, told, _ = study(*points)
    assert (code, told["runs"], told["new"], told["failed"]) == (1, 12, 4, 4)
    code, told, _ = study(*points[:1], "x=1,2", *points[2:], "--workers", "2")
    assert (code, told["new"]) == (0, 0)
    found = ep.Study.load("study.jsonl")
    assert {*found["unit"]} == {"mm", None}  # None where the run failed
    np.testing.assert_array_equal(found["area"], np.where(found["x"] == 13, np.nan, found["x"] * found["y"]))


def test_points_of_a_file_and_processes(study, tmp_path):
    (tmp_path / "points.json").write_text(json.dumps([{"x": 2, "y": 3}, {"x": 4, "y": 5}]))
    assert study("--points", "points.json", "--workers", "2")[:2] == (
        0, {"file": "study.jsonl", "runs": 2, "new": 2, "failed": 0},
    )  # fmt: skip
    assert ep.Study.load("study.jsonl")["area"].tolist() == [6, 20]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "expected --grid"),
        (["--grid", "x=1", "--points", "p.json"], "--points: expected none"),
        (["--points", "none.json"], "--points: none.json is no file"),
        (["--between", "x=0,1"], "--count: expected together with"),
        (["--grid", "x=1", "--grid", "y=1", "--task", "3"], "task: expected"),
    ],
)
def test_wrong_calls_are_named(study, arguments, message):
    code, _, err = study(*arguments)
    assert code in (1, 2)
    assert message in err


def test_a_function_that_is_not_there_is_named(capsys, tmp_path):
    for function, message in (
        ("impact", "expected a file or module"),
        (f"{tmp_path}/none.py:impact", "there is no file"),
        ("no_such_module:impact", "could not be imported"),
        ("math:impact", "has no function impact"),
    ):
        assert main(["study", function, "--grid", "x=1", "-o", str(tmp_path / "study.jsonl")]) == 2
        assert message in capsys.readouterr().err
