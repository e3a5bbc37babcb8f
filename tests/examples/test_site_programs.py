"""The programs of the site run: of its pages, and of its reference."""

import importlib.util
import re
import runpy
import sys
from pathlib import Path
from types import SimpleNamespace

import matplotlib.pyplot as plt
import pytest

ROOT = Path(__file__).resolve().parents[2]
SITE = ROOT / "examples" / "site"
PAGES = {path.stem: path.read_text() for path in sorted(SITE.glob("*.md"))}


def programs(text):
    return re.findall(r"^```python\n(.*?)^```", text, re.M | re.S)


@pytest.fixture(scope="module")
def first_program(tmp_path_factory):
    """Names of the README's program, after it has run; the page `start` shows it."""
    with pytest.MonkeyPatch.context() as context:
        context.chdir(tmp_path_factory.mktemp("readme"))
        names = {"__name__": "__main__"}
        exec(compile(programs((ROOT / "README.md").read_text())[0], "README.md", "exec"), names)
        plt.close("all")
        assert Path("balls.html").stat().st_size > 10_000
    return names


@pytest.mark.parametrize("page", [name for name, text in PAGES.items() if programs(text)])
def test_the_programs_of_a_page_run_one_after_the_other(page, first_program, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if "artificialIntelligence" in PAGES[page]:
        pytest.importorskip("gymnasium")
        if importlib.util.find_spec("stable_baselines3") is None:  # of which Exudyn asks the version alone
            monkeypatch.setitem(sys.modules, "stable_baselines3", SimpleNamespace(__version__="2.3.0"))
    names = dict(first_program) if "first program](" in PAGES[page] else {}
    with plt.rc_context():  # Exudyn's PlotSensor enlarges all fonts from then on
        for program in programs(PAGES[page]):
            exec(compile(program, f"{page}.md", "exec"), names)
    plt.close("all")


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.PartitionWarning")  # of coarse meshes
def test_examples_of_the_reference_run(tmp_path, monkeypatch):
    """They are one program; a process of its own would load all libraries again."""
    monkeypatch.chdir(tmp_path)
    with plt.rc_context():
        runpy.run_path(str(SITE / "api_examples.py"), run_name="__main__")
    plt.close("all")
