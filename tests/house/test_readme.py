"""The README and what is published with it: it is short, its links lead somewhere, commands parse."""

import importlib
import json
import re
from pathlib import Path

import pytest

import exudyn_partition as ep
from exudyn_partition import cli
from validation import gallery

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text()


def test_it_starts_with_two_shell_blocks_that_name_what_exists():
    blocks = re.findall(r"^```(\w*)\n(.*?)^```", README, re.M | re.S)
    assert [language for language, _ in blocks[:2]] == ["sh", "sh"]
    assert sum(language == "sh" for language, _ in blocks) == 2
    assert "python examples/two_spheres.py --quick" in blocks[0][1]
    assert blocks[1][1].strip().splitlines()[-1] == "python -m pytest"


def test_it_is_short_and_has_one_program():
    """The site's test runs the program, for pages of the site go on from it."""
    assert len(README.replace("|", " ").split()) < 1050
    assert len(re.findall(r"^```python\n", README, re.M)) == 1


def test_what_whole_programs_cost_is_what_the_gallery_measured():
    known = json.loads((ROOT / "validation" / "gallery.json").read_text())
    assert gallery.costs(known) in README


@pytest.mark.parametrize("page", ["README.md", "examples/README.md"])
def test_links_lead_somewhere(page):
    text = (ROOT / page).read_text()
    anchors = {title.lower().replace(" ", "-") for title in re.findall(r"^#+ ([\w ]+)$", text, re.M)}
    links = [link for link in re.findall(r"\]\(([^)]+)\)", text) if not link.startswith("http")]
    assert links
    for link in links:
        assert link[1:] in anchors if link.startswith("#") else ((ROOT / page).parent / link).exists(), link


def test_calls_in_the_table_of_commands_are_understood(tmp_path, monkeypatch, capsys):
    """A call that does not parse ends the program with 2; a file that is not there, as here, with 1."""
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "examples" / "site" / "command-line.md").read_text()
    calls = re.findall(r"^\| `((?:reduce|info|estimate|impact|study|doctor)\b[^`]*)` \|", page, re.M)
    assert len(calls) == 7
    for call in calls:
        code = cli.main(call.split())
        assert code == {"reduce": 1, "info": 1, "impact": 1, "study": 2}.get(call.split()[0], 0)
        assert ("(working directory" in capsys.readouterr().err) == (code > 0)


def test_what_is_published_names_this_version_and_runs_the_same_checks():
    citation = (ROOT / ".github" / "CITATION.cff").read_text()
    assert re.search(r"^version: (.+)$", citation, re.M)[1] == ep.__version__
    assert f"**{ep.__version__}**" in README
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text()
    assert workflow.rstrip().endswith("- run: .ci/run")
    project = (ROOT / "pyproject.toml").read_text()
    module, function = re.search(r'^exudyn-partition = "(.+):(.+)"$', project, re.M).groups()
    assert callable(getattr(importlib.import_module(module), function))
    assert (ROOT / "exudyn_partition" / "py.typed").is_file()
