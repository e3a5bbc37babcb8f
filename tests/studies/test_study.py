"""Studies of plain functions: points, order, workers that die, files that go on, tasks of an array."""

import functools
import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import plain_functions as plain
import pytest
from oracles import LONGEST, press_ctrl_c

import exudyn_partition as ep
from exudyn_partition.errors import FailedRunsWarning, InputError, ModelLimitWarning, RunError
from exudyn_partition.support.interrupt import interruptible

POINTS = {"x": list(range(40))}


def lines(path):
    """Runs that a file holds, without the line of what they are of."""
    return [json.loads(line) for line in path.read_text().splitlines()[1:]]


def test_a_grid_has_axes_in_their_order_and_the_same_values_everywhere():
    found = ep.study(plain.square, {"x": np.array([1.0, 2.0, 3.0]), "y": (0.5, np.float32(1.5))})
    x, y = np.array([[1.0], [2.0], [3.0]]), np.array([0.5, 1.5])
    np.testing.assert_array_equal(found["square"], x**2 + y)
    np.testing.assert_array_equal(found["both"][..., 1], y + 0 * x)
    np.testing.assert_array_equal(found["x"], x + 0 * y)
    held = ep.study(plain.square, {"x": [1.0, 2.0], "y": 7})
    assert held.shape == (2,)
    np.testing.assert_array_equal(held["square"], [8.0, 11.0])
    table = found.to_dataframe()
    assert table.columns.tolist() == ["x", "y", "square", "both", "error"]
    with pytest.raises(InputError, match="name: expected one of x, y, square, both, got 'cube'"):
        found["cube"]


@pytest.mark.parametrize("method", ["sobol", "latin"])
def test_each_slice_of_a_range_has_one_point(method):
    points = ep.sample_parameters({"x": (-1.0, 3.0), "y": (0.0, 1.0), "h": 0.1}, 32, method=method, seed=5)
    for name, low, high in (("x", -1.0, 3.0), ("y", 0.0, 1.0)):
        slices = (np.array([point[name] for point in points]) - low) / (high - low) * 32
        assert sorted(np.floor(slices)) == list(range(32))
    assert {point["h"] for point in points} == {0.1}
    if method == "sobol":  # also each of 4 x 4 fields has two
        fields = np.array([[(point["x"] + 1) / 4, point["y"]] for point in points]) // 0.25
        assert {*np.unique(fields, axis=0, return_counts=True)[1]} == {2}
    again = ep.sample_parameters({"x": (-1.0, 3.0), "y": (0.0, 1.0), "h": 0.1}, 32, method=method, seed=5)
    assert points == again


def test_a_failure_is_recorded_with_its_cause_and_the_others_go_on():
    with pytest.warns(FailedRunsWarning, match=r"1 of 5 runs failed, the first: ValueError: 3 is refused \(at x=3\)"):
        found = ep.study(plain.picky, {"x": [1, 2, 3, 4, 5]})
    np.testing.assert_array_equal(found["value"], [1, 2, np.nan, 4, 5])
    assert "plain_functions.py" in found.failures[2].traceback
    with pytest.raises(RunError, match="ValueError: 3 is refused"):
        ep.study(plain.picky, {"x": [1, 2, 3, 4, 5]}, stop=True)
    with pytest.warns(FailedRunsWarning, match="returned value: expected numbers, .* got set"):
        ep.study(lambda x: {x}, {"x": [1]})


def test_only_what_failed_is_run_again(tmp_path):
    path, flag = tmp_path / "study.jsonl", tmp_path / "flag"
    function = functools.partial(plain.mended, flag=str(flag))
    with pytest.warns(FailedRunsWarning):
        ep.study(function, {"x": [0, 1, 2]}, file=path)
    flag.touch()
    found = ep.study(function, {"x": [0, 1, 2]}, file=path)
    assert found.info["new"] == 1
    np.testing.assert_array_equal(found["value"], [0, 1, 2])
    assert [line["parameters"]["x"] for line in lines(path)] == [0, 1, 2, 1]
    np.testing.assert_array_equal(ep.Study.load(path)["value"], [0, 1, 2])


def test_processes_give_the_same_in_the_same_order_and_one_that_dies_takes_no_other_run_with_it():
    with pytest.warns(FailedRunsWarning, match="1 of 40 runs failed, the first: WorkerDied"):
        found = ep.study(plain.deadly, POINTS, workers=2)
    assert {*found.failures} == {3}
    np.testing.assert_array_equal(found["value"], [np.nan if x == 3 else x for x in POINTS["x"]])


class Counting(ThreadPoolExecutor):
    """Threads that keep how many runs each task had."""

    def __init__(self):
        super().__init__(2)
        self.tasks = []

    def submit(self, function, *arguments):
        if len(arguments) > 1:
            self.tasks.append([parameters for _, parameters in arguments[1]])
        return super().submit(function, *arguments)


def test_short_runs_share_tasks_and_what_belongs_together_stays_together():
    with Counting() as executor:
        found = ep.study(lambda x: float(x), {"x": list(range(2000))}, workers=executor)
    np.testing.assert_array_equal(found["value"], np.arange(2000.0))
    assert len(executor.tasks) < 100
    with Counting() as executor:
        ep.study(lambda x, y: x * y, {"x": [1, 2, 3], "y": [4, 5, 6]}, workers=executor, together="y")
    assert sorted({point["y"] for point in task} for task in executor.tasks) == [{4}, {5}, {6}]
    with Counting() as executor:
        ep.study(lambda x: x, {"x": list(range(10))}, workers=executor, chunk=4)
    assert [len(task) for task in executor.tasks] == [4, 4, 2]


def test_a_cluster_of_dask_gives_the_same_and_takes_functions_of_notebooks():
    distributed = pytest.importorskip("distributed", reason="Dask is not installed")
    own = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0"}
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, **own) as cluster,
        distributed.Client(cluster) as client,
    ):
        for _ in range(3):  # the cluster forgets what one study has sent to it while the next one begins
            found = ep.study(lambda x: {"process": os.getpid(), "cube": x**3}, POINTS, workers=client, chunk=1)
        with pytest.warns(FailedRunsWarning, match="1 of 40 runs failed"):
            named = ep.study(plain.picky, POINTS, workers=client.get_executor())
    np.testing.assert_array_equal(found["cube"], np.arange(40) ** 3)
    assert len({*found["process"]} - {os.getpid()}) == 2
    assert {*named.failures} == {3}


SCRIPT = """
import plain_functions, exudyn_partition as ep
if __name__ == "__main__":
    ep.study(plain_functions.slow, {"x": list(range(30))}, file="study.jsonl", workers=2, chunk=1)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="there is no such signal")
def test_a_study_that_was_killed_goes_on(tmp_path):
    (tmp_path / "script.py").write_text(SCRIPT)
    path = tmp_path / "study.jsonl"
    paths = os.pathsep.join(filter(None, [os.path.dirname(plain.__file__), os.environ.get("PYTHONPATH")]))  # noqa: PTH120
    environment = {**os.environ, "PYTHONPATH": paths}
    process = subprocess.Popen([sys.executable, "script.py"], cwd=tmp_path, env=environment)
    begin = time.monotonic()
    while not path.exists() or len(path.read_text().splitlines()) < 9:
        assert process.poll() is None
        assert time.monotonic() - begin < LONGEST
        time.sleep(5e-3)
    process.kill()
    process.wait()
    before = lines(path)
    assert 8 <= len(before) < 30
    workers = {line["values"]["process"] for line in before}
    while any(map(alive, workers)):  # they end by themselves, for nobody would end them
        assert time.monotonic() - begin < LONGEST
        time.sleep(5e-3)
    with path.open("a") as file:
        file.write('{"parameters": {"x": 29}, "val')  # the write that was cut off
    found = ep.study(plain.slow, {"x": list(range(30))}, file=path)
    assert found.info["new"] == 30 - len(before)
    assert [*found["x"]] == list(range(30))
    assert sorted(line["parameters"]["x"] for line in lines(path)) == list(range(30))


def alive(pid):
    """Whether a process runs; one that has ended and waits for its parent does not."""
    try:
        with open(f"/proc/{pid}/stat") as file:  # noqa: PTH123
            return file.read().rpartition(")")[2].split()[0] not in "ZX"
    except FileNotFoundError:
        return False


def test_tasks_of_an_array_find_together(tmp_path):
    path = tmp_path / "study.jsonl"
    for task in ("1/3", (2, 3)):
        part = ep.study(plain.square, POINTS, file=path, task=task)
        assert len(part) in (13, 14)
    assert not path.exists()
    assert len(ep.Study.load(path)) == 27
    whole = ep.study(plain.square, POINTS, file=path)
    assert whole.info["new"] == 13
    np.testing.assert_array_equal(whole["square"], np.arange(40.0) ** 2)
    for part in tmp_path.glob("*of3.jsonl"):
        part.unlink()
    assert ep.study(plain.square, POINTS, file=path).info["new"] == 0
    with pytest.raises(InputError, match="file: expected a path beside task="):
        ep.study(plain.square, POINTS, task="1/3")
    for wrong in ("4/3", "0/3", "3", (1, 2, 3)):
        with pytest.raises(InputError, match="task: expected"):
            ep.study(plain.square, POINTS, file=path, task=wrong)


def test_a_file_of_something_else_is_refused_and_kept(tmp_path):
    path = tmp_path / "study.jsonl"
    ep.study(functools.partial(plain.square, y=1.0), {"x": [1]}, file=path)
    for function, other in ((functools.partial(plain.square, y=2.0), "y"), (plain.picky, "function, fixed")):
        with pytest.raises(InputError, match=f"is of other {other}"):
            ep.study(function, {"x": [1]}, file=path)
    for text in ("a thesis", "a thesis\n", '{"study": 9}\n', path.read_text() + "{}\n"):
        path.write_text(text)
        with pytest.raises(InputError, match=r"file: .* holds no study"):
            ep.study(plain.square, {"x": [1]}, file=path)
        assert path.read_text() == text
    with pytest.raises(InputError, match="there is none at"):
        ep.Study.load(tmp_path / "none.jsonl")


@pytest.mark.parametrize("parameters", [{}, [], {"x": []}, [{}, 3], {"x": [object()]}, {1: [2]}, "x", None])
def test_points_that_are_none_are_refused(parameters):
    with pytest.raises(InputError, match=r"parameters.*: expected"):
        ep.study(plain.square, parameters)


def test_two_studies_do_not_write_into_one_file(tmp_path):
    pytest.importorskip("fcntl")
    path = tmp_path / "study.jsonl"

    def nested(x):
        ep.study(plain.square, {"x": [1]}, file=path)

    with pytest.warns(FailedRunsWarning, match="another process writes into"):
        ep.study(nested, {"x": [1]}, file=path)


def test_a_run_that_ctrl_c_has_ended_is_not_kept(tmp_path):
    """Also if the function returns what it has until then, as one does that calls `solve_dynamic`."""
    path = tmp_path / "study.jsonl"

    def stopped(x, asks):
        if x < 2:
            return x
        if not asks:
            press_ctrl_c()
        with interruptible() as interrupt:
            press_ctrl_c()
            return float(interrupt.asked)

    for asks in (True, False):
        with pytest.raises(KeyboardInterrupt):
            ep.study(stopped, {"x": [0, 1, 2, 3], "asks": asks}, file=path)
        assert [line["parameters"]["x"] for line in lines(path)][-2:] == [0, 1]


def test_warnings_of_runs_are_told_once():
    with pytest.warns(ModelLimitWarning) as caught:
        ep.study(plain.warning, {"x": [1, 2, 3, 4]})
    assert [str(w.message) for w in caught] == ["2 of 4 runs warn, the first: 2 is even"]
    assert caught[0].filename == __file__


def test_an_executor_that_is_closed_is_told():
    with ThreadPoolExecutor(1) as executor:
        pass
    with pytest.raises(RunError, match="workers: the executor or cluster takes no task"):
        ep.study(plain.square, {"x": [1]}, workers=executor)


def test_what_workers_cannot_import_is_told_before_any_run(monkeypatch):
    monkeypatch.setitem(sys.modules, "cloudpickle", None)
    with pytest.raises(InputError, match="function: expected one of a module"):
        ep.study(lambda x: x, {"x": [1, 2]}, workers=2)
