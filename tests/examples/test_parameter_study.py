"""The example of a study: it goes on where it was stopped, in another way with the same numbers."""

import importlib
import json

import matplotlib.pyplot as plt
import pytest


def run(folder, workers):
    arguments = ["--quick", "--workers", str(workers), "--out", str(folder)]
    result = importlib.import_module("parameter_study").main(arguments)
    plt.close("all")
    assert (folder / "parameter_study.png").exists()
    assert json.loads((folder / "result.json").read_text()) == result
    return result


def test_a_study_that_was_stopped_goes_on_in_another_way(tmp_path):
    first = run(tmp_path, 1)
    assert first["new"] == 4
    assert first["error"] < 0.03
    file = tmp_path / "results_quick.jsonl"
    whole = file.read_text().splitlines(keepends=True)
    file.write_text("".join(whole[:4]) + whole[4][:30])  # one is missing, for which one process starts
    again = run(tmp_path, 2)
    assert again["new"] == 1
    for name in ("speed", "peak_force_N"):
        assert again[name] == pytest.approx(first[name], rel=1e-9)
