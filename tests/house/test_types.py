"""Types for users: what an editor and a checker of types see of the package."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest
from mypy import api

import exudyn_partition as ep

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = Path(__file__).parent / "typed"


def test_the_stub_has_the_names_of_the_package():
    stub = ast.parse((ROOT / "exudyn_partition" / "__init__.pyi").read_text())
    names = {}
    for node in stub.body:
        if isinstance(node, ast.ImportFrom):
            names |= {alias.asname or alias.name: (node.module, alias.name) for alias in node.names}
    assert names.pop("__version__") == ("_version", "__version__")
    assert sorted(names) == ep.__all__
    assert sorted(ast.literal_eval(stub.body[-1].value)) == ep.__all__
    for name, (module, there) in names.items():
        value = getattr(ep, name)
        home = f"exudyn_partition.{module}" if module else "exudyn_partition"
        if isinstance(value, type(ep)):
            assert value.__name__ == f"{home}.{there}"
        elif hasattr(value, "__module__") and name not in ("STEEL", "ALUMINIUM"):
            assert (value.__module__, value.__name__) == (home, there)


@pytest.fixture(scope="module")
def found():
    """What mypy says of both scripts: the code of each error by file and line."""
    scripts = [str(path) for path in sorted(SCRIPTS.glob("*.py"))]
    out, err, _ = api.run(["--config-file", str(ROOT / "pyproject.toml"), *scripts])
    assert not err
    errors = re.findall(r"(\w+)\.py:(\d+): error: .*\[([\w-]+)\]$", out, re.M)
    assert len(errors) == out.count(": error: ")
    return {(name, int(line)): code for name, line, code in errors}


def test_a_right_script_has_right_types(found):
    assert not [place for place in found if place[0] != "wrong"]


def test_pyright_too_accepts_the_right_script_and_refuses_each_wrong_call():
    pytest.importorskip("pyright")
    said = subprocess.run([sys.executable, "-m", "pyright", str(SCRIPTS)], check=False, capture_output=True, text=True)
    found = set(re.findall(r"(\w+)\.py:(\d+):\d+ - error", said.stdout))
    lines = (SCRIPTS / "wrong.py").read_text().splitlines()
    assert found == {("wrong", str(i)) for i, line in enumerate(lines, 1) if re.search(r"  # [\w-]+$", line)}


def test_each_wrong_call_is_refused(found):
    lines = (SCRIPTS / "wrong.py").read_text().splitlines()
    marked = {("wrong", i): mark[1] for i, line in enumerate(lines, 1) if (mark := re.search(r"  # ([\w-]+)$", line))}
    assert len(marked) > 20
    assert found == marked
