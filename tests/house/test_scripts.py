"""Tests and scripts use what is public, and find each other without a change of the search path."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = [path for folder in ("tests", "validation", "examples") for path in sorted((ROOT / folder).rglob("*.py"))]
BY_NAME = {"getattr", "setattr", "delattr", "hasattr"}  # also those of monkeypatch and mock
PUBLIC = {"_exit"}  # of os, whose name has an underscore only


def private(name):
    return name.startswith("_") and not name.endswith("__") and name not in PUBLIC


def nodes_of(code):
    """All nodes of the code's tree, walked once for all rules."""
    return [*ast.walk(ast.parse(code))]


def reached_for(nodes):
    """Private names of other modules and objects that the code mentions, with the lines."""
    for node in nodes:
        if isinstance(node, ast.ImportFrom):
            names = [*(node.module or "").split("."), *(alias.name for alias in node.names)]
        elif isinstance(node, ast.Import):
            names = [part for alias in node.names for part in alias.name.split(".")]
        elif isinstance(node, ast.Attribute):
            own = isinstance(node.value, ast.Name) and node.value.id in ("self", "cls")
            names = [] if own else [node.attr]
        elif isinstance(node, ast.Call) and (getattr(node.func, "attr", "") or getattr(node.func, "id", "")) in BY_NAME:
            names = [a.value for a in node.args if isinstance(a, ast.Constant) and isinstance(a.value, str)]
        else:
            names = []
        yield from ((node.lineno, name) for name in names if private(name))


def search_path(nodes):
    """Lines of code that mention the search path."""
    for node in nodes:
        if isinstance(node, ast.Attribute) and node.attr == "path" and getattr(node.value, "id", "") == "sys":
            yield node.lineno


def found_by(rule, paths=SCRIPTS):
    """What a rule finds in scripts, by their paths."""
    found = {str(path.relative_to(ROOT)): [*rule(nodes_of(path.read_text()))] for path in paths}
    return {path: places for path, places in found.items() if places}


def test_nothing_private_is_reached_for_and_the_search_path_stays():
    assert len(SCRIPTS) > 400
    assert found_by(lambda nodes: [*reached_for(nodes), *search_path(nodes)]) == {}


@pytest.mark.parametrize(
    "code",
    ["from a import _b", "from a._b import c", "import a._b", "a._b()", "a.b._c = 1", "f.setattr(a, '_b', 1)"],
)
def test_the_rule_finds_each_way(code):
    assert [*reached_for(nodes_of(code))]


def test_the_rule_finds_the_search_path():
    assert [*search_path(nodes_of("import sys\nsys.path.append('a')"))] == [2]


STARTS = ("Client", "LocalCluster")  # names of what starts a cluster
LOOPBACK = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0"}


def opened(nodes):
    """Lines of calls that start a cluster of Dask's on this machine without saying that only it may listen.

    They say so by keywords, or by a dict of them that the code names.
    """
    dicts = {
        target.id: node.value
        for node in nodes
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Dict)
        for target in node.targets
        if isinstance(target, ast.Name)
    }
    for node in nodes:
        name = getattr(node.func, "attr", "") or getattr(node.func, "id", "") if isinstance(node, ast.Call) else ""
        if name in STARTS and not (name == "Client" and node.args):
            given = {keyword.arg: getattr(keyword.value, "value", None) for keyword in node.keywords if keyword.arg}
            for keyword in node.keywords:
                if keyword.arg is None and isinstance(keyword.value, ast.Name):
                    given |= ast.literal_eval(dicts[keyword.value.id])
            if not given.items() >= LOOPBACK.items():
                yield node.lineno


def test_clusters_listen_on_this_machine_alone():
    """Dask's dashboard listens to the whole network by default, and shows code and data."""
    naming = [path for path in SCRIPTS if any(name in path.read_text() for name in STARTS)]
    assert naming
    assert found_by(opened, naming) == {}


@pytest.mark.parametrize(
    "code", ["Client()", "distributed.Client(n_workers=2)", "LocalCluster(2, host='127.0.0.1')", "LocalCluster(2)"]
)
def test_the_rule_finds_each_cluster(code):
    assert [*opened(nodes_of(code))]
