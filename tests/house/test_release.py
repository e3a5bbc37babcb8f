"""What is released: versions, workflows and the pages that GitHub reads agree with the code."""

import re
import runpy
import subprocess
from pathlib import Path

import exudyn as exu
import pytest
import yaml
from oracles import TOP

import exudyn_partition as ep

ROOT = Path(__file__).resolve().parents[2]
GITHUB = ROOT / ".github"
PROJECT = (ROOT / "pyproject.toml").read_text()
WORKFLOWS = {path.name: yaml.safe_load(path.read_text()) for path in sorted((GITHUB / "workflows").glob("*.yml"))}


def test_the_newest_entry_of_the_changes_is_this_version():
    versions = re.findall(r"^## (\d\S*?),", (GITHUB / "CHANGELOG.md").read_text(), re.M)
    assert versions[0] == ep.__version__


def test_oldest_and_newest_python_are_tested_on_every_system():
    pythons = re.findall(r'"Programming Language :: Python :: (3\.\d+)"', PROJECT)
    oldest = re.search(r'^requires-python = ">=(.+)"$', PROJECT, re.M)[1]
    assert pythons[0] == oldest
    matrix = WORKFLOWS["tests.yml"]["jobs"]["test"]["strategy"]["matrix"]
    assert {system.split("-")[0] for system in matrix["os"]} == {"ubuntu", "windows", "macos"}
    assert matrix["python"] == [oldest, pythons[-1]]
    assert matrix["resolution"] == ["lowest-direct", "highest"]
    assert matrix["exclude"] == [{"python": pythons[-1], "resolution": "lowest-direct"}]
    assert {oldest, *(run["python"] for run in matrix["include"]), pythons[-1]} <= set(pythons)


def test_a_release_knows_its_repository(monkeypatch):
    """Every link of the README that PyPI shows leads to a file of the commit; without a repository nothing changes."""
    names, text = runpy.run_path(str(GITHUB / "metadata.py")), (ROOT / "README.md").read_text()
    hook, found = names["ReleaseMetadata"](str(ROOT), {}), {}
    monkeypatch.delenv("GITHUB_REPOSITORY", raising=False)
    hook.update(found)
    assert found == {"readme": {"content-type": "text/markdown", "text": text}}
    for name, value in (("REPOSITORY", "someone/partition"), ("SERVER_URL", "https://host"), ("SHA", "abc")):
        monkeypatch.setenv(f"GITHUB_{name}", value)
    hook.update(found)
    assert found["urls"]["Documentation"] == "https://someone.github.io/partition/"
    shown = found["readme"]["text"]
    before, after = (re.findall(r"(!?)\[[^\]]*\]\(([^)]+)\)", page) for page in (text, shown))
    for (mark, file), (_, address) in zip(before, after, strict=True):
        kind = "raw" if mark else "blob"
        outside = file.startswith(("http", "#"))
        assert address == (file if outside else f"https://host/someone/partition/{kind}/abc/{file}")


def test_workflows_only_run_what_there_is():
    for name, workflow in WORKFLOWS.items():
        assert workflow[True], name  # "on", which YAML reads as a truth value
        for job in workflow["jobs"].values():
            for command in (step["run"] for step in job["steps"] if "run" in step):
                assert all((ROOT / path).exists() for path in re.findall(r"(?<![\w/*])\.ci/\w+", command)), name
                extras = re.findall(r"\w+", " ".join(re.findall(r"\.\[(.+)\]", command)))
                assert all(f"\n{extra} = [" in PROJECT for extra in extras), name


def test_issue_forms_are_complete():
    for path in sorted((GITHUB / "ISSUE_TEMPLATE").glob("[!c]*.yml")):
        form = yaml.safe_load(path.read_text())
        assert {"name", "description", "body"} <= set(form)
        assert len({field["id"] for field in form["body"]}) == len(form["body"])
        assert all(field["attributes"]["label"] for field in form["body"])


@pytest.mark.parametrize("page", ["CONTRIBUTING.md", "PULL_REQUEST_TEMPLATE.md", "SECURITY.md"])
def test_files_that_the_pages_name_exist(page):
    names = re.findall(r"`([\w./-]+/[\w./-]+|\w+\.(?:py|md|cff|yml))`", (GITHUB / page).read_text())
    assert names
    known = {path.name for path in ROOT.rglob("*") if ".venv" not in path.parts}
    for name in names:
        assert (ROOT / name).exists() or name in known, name


def test_the_recipe_for_conda_needs_what_the_project_needs():
    recipe = yaml.safe_load((GITHUB / "conda" / "recipe.yaml").read_text())
    assert recipe["context"]["version"] == ep.__version__
    block = re.search(r"^dependencies = \[\n(.*?)^\]", PROJECT, re.M | re.S)[1]
    needed = {f"{name} {version}" for name, version in re.findall(r'^  "([\w-]+)(>=[\d.]+)"', block, re.M)}
    assert len(needed) == 10
    found = {one.replace("matplotlib-base", "matplotlib") for one in recipe["requirements"]["run"]}
    assert found == needed | {f"python >={re.search(r'^requires-python = .>=(.+).$', PROJECT, re.M)[1]}"}


def test_the_paper_cites_what_its_list_has_and_numbers_that_were_measured():
    text, sources = ((GITHUB / "paper" / name).read_text() for name in ("paper.md", "paper.bib"))
    assert set(re.findall(r"@(\w+)", text)) == set(re.findall(r"^@\w+\{(\w+),", sources, re.M))
    (row,) = re.findall(r"^\| rod on plate \| (.+) \|$", (ROOT / "README.md").read_text(), re.M)
    dofs, kept, error, offline, online, full = row.split(" | ")[:6]
    for number in (f"{int(dofs):,}".replace(",", " "), kept, error.replace("%", " %"), offline, online, full):
        assert number in text, number


def test_the_patch_for_exudyn_applies_and_its_example_runs(tmp_path):
    """The pendulum comes with the speed of a rigid one."""
    patch = ROOT / "examples" / "for_exudyn" / "partition_body_impact.patch"
    subprocess.run(["git", "init", "-q", str(tmp_path)], check=True)
    subprocess.run(["git", "apply", str(patch)], cwd=tmp_path, check=True)
    (example,) = tmp_path.rglob("*.py")
    names = runpy.run_path(str(example))
    assert names["impact"].speed_before == pytest.approx(names["rigidSpeed"], rel=1e-3)
    assert names["impact"].peak > 0


def test_the_formulation_in_the_guide_works(bodies):
    program = re.search(r"^```python\n(.*?)^```", (GITHUB / "CONTRIBUTING.md").read_text(), re.M | re.S)[1]
    names = {}
    exec(compile(program, "CONTRIBUTING.md", "exec"), names)
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP, initialVelocity=[0, 0, -0.3])
    block = ep.CreatePartitionBody(mbs, bodies[1])
    contact = ep.CreatePartitionContact(mbs, ball, block, formulation=names["Springs"]())
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=40e-6, step=0.2e-6)
    energy = sum(item.energy(result) for item in (ball, block, contact))
    assert contact.force(result).max() > 10
    assert abs(energy / energy[0] - 1).max() < 2e-3
