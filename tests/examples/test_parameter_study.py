"""The example of a study: it goes on where it was stopped, and every way gives the same numbers."""

import importlib
import json

import matplotlib.pyplot as plt
import pytest


def run(folder, how):
    result = importlib.import_module("parameter_study").main(
        ["--quick", "--how", how, "--workers", "1", "--out", str(folder)]
    )
    plt.close("all")
    assert (folder / "parameter_study.png").exists()
    assert json.loads((folder / "result.json").read_text()) == result
    return result


@pytest.mark.filterwarnings("ignore:This process .* is multi-threaded:DeprecationWarning")
def test_a_study_that_was_stopped_goes_on_in_another_way(tmp_path):
    first = run(tmp_path, "plain")
    assert (first["new"], len(first["impacts"])) == (4, 4)
    assert first["error"]["peak_force"] < 0.03
    lines = tmp_path / "results_quick.jsonl"
    whole = lines.read_text().splitlines(keepends=True)
    for how, kept, new in (
        ("exudyn", "".join(whole[:2]) + whole[2][:30], 2),
        ("processes", "".join(whole[1:]), 1),
        ("dask", "".join(whole[:3]), 1),
    ):
        lines.write_text(kept)
        again = run(tmp_path, how)
        assert again["new"] == new
        for one, other in zip(first["impacts"], again["impacts"], strict=True):
            assert {**one, "wall_s": 0} == {**other, "wall_s": 0}
    assert run(tmp_path, "plain")["new"] == 0
