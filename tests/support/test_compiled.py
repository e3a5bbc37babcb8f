"""Inner loops are compiled if numba is there, and done by NumPy if not."""

import gc
import os
import subprocess
import sys

import numpy as np
import pytest
from oracles import without_numba

from exudyn_partition.support import compiled


def test_without_numba_there_are_no_loops():
    assert compiled.kernels("surfaces").__name__ == "exudyn_partition.surfaces.kernels"
    with without_numba():
        assert compiled.kernels("surfaces") is None
    assert compiled.compiles()


def test_loops_are_compiled_where_they_cannot_be_kept():
    """Code without a file has no folder beside it, like that in a folder that nobody may write to."""
    scope = {}
    exec("def twice(x):\n    return 2 * x", scope)
    twice = compiled.compiled(scope["twice"])
    assert twice(2.0) == 4.0
    assert len(twice.signatures) == 1


def test_garbage_is_not_collected_while_a_loop_is_compiled():
    """But again afterwards, also if the compiler refuses the loop."""
    events = pytest.importorskip("numba.core.event")
    collected = []
    kept = {
        "on_start": lambda listener, event: collected.append(gc.isenabled()),
        "on_end": lambda listener, event: None,
    }
    scope = {"__name__": "exudyn_partition.made_here"}
    exec("def twice(x):\n    return 2 * x\ndef wrong(x):\n    return x.no_such_name", scope)
    twice, wrong = compiled.compiled(scope["twice"]), compiled.compiled(scope["wrong"])
    with events.install_listener("numba:run_pass", type("Listener", (events.Listener,), kept)()):
        assert twice(2.0) == 4.0
        with pytest.raises(Exception, match="no_such_name"):
            wrong(2.0)
    assert len(collected) > 10
    assert not any(collected)
    assert gc.isenabled()


PROGRAM = """
import logging
import numpy as np
from exudyn_partition.algebra import product_kernels
logging.basicConfig(level=logging.INFO, format="%(message)s")
product_kernels.add(1.0, np.ones(3), np.ones(3))
product_kernels.add_to_three(1.0, 1.0, 1.0, *np.ones((4, 3)))
"""


@pytest.mark.parametrize("terminal", [True, False])
def test_compiling_is_told_once_on_the_terminal_or_in_the_log(tmp_path, terminal):
    """Not again by a process that finds the code on disk."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "TTY_COMPATIBLE": str(int(terminal))}
    said = []
    for _ in range(2):
        command = [sys.executable, "-c", PROGRAM]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        said.append(" ".join(done.stderr.split()).count("numba compiles inner loops"))
        assert not done.stdout
    assert said == [1, 0]


def test_compiled_code_older_than_any_module_is_deleted(tmp_path):
    """It may hold loops of that module; younger code stays."""
    caches = tmp_path / "contact" / "__pycache__"
    caches.mkdir(parents=True)
    for age, path in (
        (30, caches / "kernels.old.nbi"),
        (20, tmp_path / "kernels.py"),
        (10, caches / "kernels.new.nbi"),
    ):
        path.touch()
        os.utime(path, (1e9 - age, 1e9 - age))
    compiled.forget_stale(tmp_path)
    assert [path.name for path in caches.iterdir()] == ["kernels.new.nbi"]


def test_loops_that_call_each_other_are_compiled_once():
    """A number that stands in a call, as `True`, does not compile the called loop anew, and its code stays apart."""
    loops = compiled.kernels("algebra", "product_kernels")
    if loops is None:
        pytest.skip("numba is not there")
    rows, F = np.array([[1.0, 0.0, 2.0], [0.0, 3.0, 0.0]]), np.diag([1.0, 2.0, 3.0])
    np.testing.assert_allclose(loops.congruence(rows, F, False), rows @ F @ rows.T, rtol=1e-15)
    of_these = [kinds for kinds in loops.sparse_product.overloads if str(kinds[0]) == "array(float64, 2d, C)"]
    assert len({kinds[:2] for kinds in of_these}) == len(of_these) > 0


KEPT = """
from exudyn_partition.support.compiled import compiled, inlined, inner

@inner
def deep(x):
    return x + 1.0

@inlined
def middle(x):
    return 2.0 * deep(x)

@compiled
def outer(x, y):
    return middle(x) + y
"""


def test_code_on_disk_finds_what_it_calls_through_code_that_was_on_disk(tmp_path):
    """The second process reads `middle` from disk and compiles `outer` for other types, which the third one reads."""
    if not compiled.compiles():
        pytest.skip("numba is not there")
    (tmp_path / "kept_kernels.py").write_text(KEPT)
    options = {"cwd": tmp_path, "env": os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "kept")}}
    for y, found in (("1", "5.0"), ("1.0", "5.0"), ("1.0", "5.0")):
        command = [sys.executable, "-c", f"from kept_kernels import outer; print(outer(1.0, {y}))"]
        done = subprocess.run(command, **options, capture_output=True, text=True, check=True)
        assert done.stdout.strip().splitlines()[-1] == found
