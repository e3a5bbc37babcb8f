"""The history of benchmarks: a row for each result that git has and that differs from the one before."""

import json
import subprocess

from validation import history


def test_rows_are_the_results_that_changed(tmp_path, monkeypatch):
    monkeypatch.setattr(history, "ROOT", tmp_path)
    git = ["git", "-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=a@b.c"]
    subprocess.run([*git, "init", "-q"], check=True)
    path = tmp_path / "speed.json"
    for ratio, other in ((0.5, 1), (0.5, 2), (0.25, 2)):
        path.write_text(json.dumps({"found": {"ratio": ratio}, "other": other, "limits": {"ratio": 0.8, "new": 1.0}}))
        subprocess.run([*git, "add", "."], check=True)
        subprocess.run([*git, "commit", "-q", "-m", "measured"], check=True)
    head, _, *rows = history.table(path).splitlines()
    assert head == "| date | commit | ratio | new |"
    assert [row.split("|")[3].strip() for row in rows] == ["0.5", "0.25", "0.8"]
    assert "limit" in rows[-1]


def test_numbers_are_those_that_have_a_limit():
    assert history.numbers({"found": {"a": 1.0, "b": [2.0]}}, ["a", "b", "c"]) == {"a": 1.0}
    assert history.numbers({"a": 1.0, "d": 2.0}, ["a"]) == {"a": 1.0}
