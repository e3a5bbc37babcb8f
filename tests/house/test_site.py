"""The site: its programs run, its reference has every public name, and it builds without a warning where Sphinx is."""

import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

import exudyn_partition as ep

ROOT = Path(__file__).resolve().parents[2]
SITE = ROOT / "examples" / "site"
PAGES = {path.stem: path.read_text() for path in sorted(SITE.glob("*.md"))}


def test_every_page_is_in_the_table_of_contents():
    listed = re.search(r"\{toctree\}.*?\n\n(.*?)```", PAGES["index"], re.S)[1].split()
    assert sorted(listed) == sorted(set(PAGES) - {"index"})


def test_the_reference_has_every_public_name():
    modules = {getattr(ep, name).__name__.removeprefix("exudyn_partition."): name for name in ep.__all__
               if inspect.ismodule(getattr(ep, name))}  # fmt: skip
    listed = re.findall(r"^   (\w[\w.]*)$", PAGES["api"], re.M)
    assert sorted(modules.get(name, name) for name in listed) == ep.__all__


def test_arguments_in_the_table_of_exudyn_s_function_exist():
    known = inspect.signature(ep.CreatePartitionBody).parameters
    theirs = inspect.signature(__import__("exudyn").MainSystem.CreateFFRFReducedOrderObject).parameters
    rows = re.findall(r"^\| `(\w+)`[^|]*\| `(\w+)`[^|]*\|$", PAGES["ffrf"], re.M)
    assert len(rows) == 10
    assert {name for _, name in rows} <= set(known)
    missed = set(theirs) - {name for name, _ in rows} - {"mbs", "self", "femInterface"}
    assert missed == {"showMarkers", "verbose"}


def test_what_pages_include_is_there():
    for name, page in PAGES.items():
        for file, options in re.findall(r"\{include\} (\S+)\n(.*?)```", page, re.S):
            text = (SITE / file).read_text()
            for mark in re.findall(r'^:(?:start-after|end-before): "(.*)"$', options, re.M):
                assert text.count(mark.replace("\\n", "\n")) == 1, (name, mark)


def test_sources_are_cited():
    text = "".join(path.read_text() for path in [*(ROOT / "exudyn_partition").rglob("*.py"), SITE / "theory.md"])
    for key, author in re.findall(r"^- \*\*\[(\w+)\]\*\* (?:[A-Z]\. )+([A-Z]\w+)", PAGES["bibliography"], re.M):
        assert author in text or key in text, author


def test_the_programs_beside_exudyn_s_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {}
    programs = re.findall(r"^```python\n(.*?)^```", PAGES["ffrf"], re.M | re.S)
    assert len(programs) == 8
    for program in programs:
        exec(compile(program, "ffrf.md", "exec"), names)


def test_the_site_builds_without_a_warning(tmp_path):
    for package in ("sphinx", "myst_parser", "numpydoc", "furo"):
        pytest.importorskip(package)
    command = [sys.executable, "-m", "sphinx", "-W", "-q", "-b", "html", str(SITE), str(tmp_path / "site")]
    subprocess.run(command, check=True)
    assert (tmp_path / "site" / "reference" / "exudyn_partition.reduce.html").is_file()
