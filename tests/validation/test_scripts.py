"""Each script of validation/ starts: it can be imported, and takes the arguments that run_all gives it."""

import argparse
import importlib
import json
import re
import shlex
import sys
from pathlib import Path

import pytest

from validation import run_all
from validation.mesh import design

ROOT = Path(__file__).resolve().parents[2]
MODULES = [
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in sorted((ROOT / "validation").rglob("*.py"))
    if path.name != "__init__.py"
]
SCRIPTS = {".".join(["validation", *Path(case.script).with_suffix("").parts]): case for case in run_all.CASES.values()}


class StartedError(Exception):
    """The arguments of a script have been read."""


@pytest.fixture
def started(monkeypatch):
    """Start a script with some arguments; it ends where it has read them."""
    read = argparse.ArgumentParser.parse_args

    def parse(parser, *given):
        read(parser, *given)
        raise StartedError

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", parse)

    def start(module, arguments):
        monkeypatch.setattr(sys, "argv", [module, *arguments])
        with pytest.raises(StartedError):
            importlib.import_module(module).main()

    return start


@pytest.mark.parametrize("name", MODULES)
def test_it_starts(name, started, tmp_path):
    module, case = importlib.import_module(name), SCRIPTS.get(name)
    source = Path(module.__file__).read_text()
    assert (case is not None) <= hasattr(module, "main")
    given = [[part.format(out=tmp_path) for part in one] for one in (case.quick or (), case.full)] if case else [()]
    if hasattr(module, "main") and re.search(r"ArgumentParser|\b(options|arguments)\(__doc__", source):
        for arguments in given:
            started(name, arguments)
    else:
        assert not any(given), "it takes no arguments"


@pytest.mark.parametrize("name", MODULES)
def test_the_command_in_its_docstring_is_its_own(name):
    text = importlib.import_module(name).__doc__
    own = name.replace(".", "/") + ".py"
    for command in re.findall(r"^ +python (.+)$", text, flags=re.MULTILINE):
        words = shlex.split(command.translate(str.maketrans("[]", "  ")))
        assert words[:2] == ["-m", name] or words[0] in (own, Path(own).name), command


def test_a_quick_design_is_shown(capsys):
    """It has no full FE model beside it."""
    found = json.loads((ROOT / "validation/mesh/design.json").read_text())["scenes"]["spheres"]
    for run in found["runs"]:
        del run["full_fe"]
    design.shown("spheres", found)
    assert "estimated" in capsys.readouterr().out
