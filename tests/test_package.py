"""Architecture, README, and the examples as a user runs them."""

import ast
import graphlib
import importlib
import json
import re
import subprocess
import sys
from pathlib import Path

import matplotlib.image
import pytest

import exudyn_partition as ep
from exudyn_partition.cli.commands import parser
from exudyn_partition.errors import MissingPackageError
from exudyn_partition.support.optional import require

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "exudyn_partition"
LAYERS = [  # lowest first; a package may import those before it, and so may what is imported for type checking
    "_version", "errors", "support", "algebra", "fe", "meshing", "surfaces", "prediction", "reduction", "frames",
    "contact", "contact.formulations", "results", "exudyn_bodies", "exudyn_contacts", "present", "simulation",
    "reference", "cli", "__main__", "__init__",
]  # fmt: skip


def imports(path):
    """Modules of the package, and packages outside, that a module imports, also through `require`."""
    module = ".".join(path.relative_to(PACKAGE).with_suffix("").parts)
    inside, outside = set(), set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = module.split(".")[: -node.level]
            names = [node.module] if node.module else [alias.name for alias in node.names]
            inside |= {".".join([*base, name]) for name in names}
        elif isinstance(node, ast.ImportFrom):
            outside.add(node.module.split(".")[0])
        elif isinstance(node, ast.Import):
            outside |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "require":
            outside.add(node.args[0].value.split(".")[0])
    return module, inside, outside


def layer(module):
    """Number of the layer of a module: that of the longest name in `LAYERS` that it begins with."""
    return LAYERS.index(max((name for name in LAYERS if f"{module}.".startswith(f"{name}.")), key=len))


def test_imports_point_to_lower_layers():
    modules = [imports(path)[:2] for path in PACKAGE.rglob("*.py")]
    assert {layer(module) for module, _ in modules} == set(range(len(LAYERS)))
    upward = {(module, name) for module, inside in modules for name in inside if layer(name) > layer(module)}
    assert not upward


def test_no_modules_import_each_other():
    order = graphlib.TopologicalSorter({module: inside for module, inside, _ in map(imports, PACKAGE.rglob("*.py"))})
    order.prepare()  # raises CycleError, which names them


def test_folders_and_files_stay_small():
    folders = {path.parent for path in PACKAGE.rglob("*.py")}
    for folder in folders:
        assert len([path for path in folder.glob("*.py") if path.name != "__init__.py"]) <= 12, folder
    long = {path.name: n for path in PACKAGE.rglob("*.py") if (n := len(path.read_text().splitlines())) > 400}
    assert not long


def test_outer_packages_have_one_door_each():
    users = {"ngsolve": set(), "netgen": set(), "meshio": set(), "exudyn": set()}
    for path in PACKAGE.rglob("*.py"):
        module, _, outside = imports(path)
        for package in outside & users.keys():
            users[package].add(module)
    assert users["ngsolve"] == {"meshing.netgen_mesh", "meshing.ngsolve_fem"}
    assert users["netgen"] == {"meshing.netgen_mesh", "meshing.ngsolve_fem", "cli.doctor"}  # the doctor tries them
    assert users["meshio"] == {"meshing.mesh_files"}
    folders = {module.split(".")[0] for module in users["exudyn"]}
    assert folders == {"exudyn_bodies", "exudyn_contacts", "present", "simulation", "cli"}
    assert {module for module in users["exudyn"] if module.startswith("present.")} == {"present.view"}


def test_import_needs_neither_exudyn_nor_ngsolve():
    code = "import sys, exudyn_partition as ep; ep.Material; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"exudyn", "ngsolve", "netgen", "meshio", "matplotlib", "scipy.sparse", "rich"} & set(loaded)


def test_every_public_name_is_there_and_documented():
    for name in ep.__all__:
        assert getattr(ep, name).__doc__, name
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        ep.nothing  # noqa: B018


def test_a_missing_package_is_named_with_its_pip_line():
    with pytest.raises(MissingPackageError, match="pip install no_such_package"):
        require("no_such_package")


def test_readme_starts_with_two_shell_blocks_that_name_what_exists():
    blocks = re.findall(r"^```(\w*)\n(.*?)^```", (ROOT / "README.md").read_text(), re.M | re.S)
    assert [language for language, _ in blocks[:2]] == ["sh", "sh"]
    assert sum(language == "sh" for language, _ in blocks) == 2
    assert "python examples/rod_on_plate.py" in blocks[0][1]
    assert blocks[1][1].strip().splitlines()[-1] == "python -m pytest"


def test_the_program_in_the_readme_runs(tmp_path):
    blocks = re.findall(r"^```python\n(.*?)^```", (ROOT / "README.md").read_text(), re.M | re.S)
    assert blocks
    for block in blocks:
        subprocess.run([sys.executable, "-c", block], cwd=tmp_path, check=True, timeout=120)


@pytest.mark.parametrize("page", ["README.md", "examples/README.md"])
def test_links_lead_somewhere(page):
    text = (ROOT / page).read_text()
    anchors = {title.lower().replace(" ", "-") for title in re.findall(r"^#+ ([\w ]+)$", text, re.M)}
    links = [link for link in re.findall(r"\]\(([^)]+)\)", text) if not link.startswith("http")]
    assert links
    for link in links:
        assert link[1:] in anchors if link.startswith("#") else ((ROOT / page).parent / link).exists(), link


def test_calls_in_the_readme_s_table_of_commands_parse():
    calls = re.findall(r"^\| `((?:reduce|info|estimate|doctor)\b[^`]*)` \|", (ROOT / "README.md").read_text(), re.M)
    assert len(calls) == 4
    for call in calls:
        parser().parse_args(call.split())


def test_what_is_published_names_this_version_and_runs_the_same_checks():
    citation = (ROOT / ".github" / "CITATION.cff").read_text()
    assert re.search(r"^version: (.+)$", citation, re.M)[1] == ep.__version__
    assert f"**{ep.__version__}**" in (ROOT / "README.md").read_text()
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text()
    assert workflow.rstrip().endswith("- run: .ci/run")
    project = (ROOT / "pyproject.toml").read_text()
    module, function = re.search(r'^exudyn-partition = "(.+):(.+)"$', project, re.M).groups()
    assert callable(getattr(importlib.import_module(module), function))
    assert 'exudyn_partition = ["py.typed"]' in project
    assert (PACKAGE / "py.typed").is_file()


def test_rod_on_plate_in_quick_mode(tmp_path):
    command = [sys.executable, str(ROOT / "examples" / "rod_on_plate.py"), "--quick", "--out", str(tmp_path)]
    printed = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300).stdout
    picture = Path(printed.strip().splitlines()[-1])
    assert picture.parent == tmp_path.resolve()
    assert matplotlib.image.imread(picture).std() > 0.05
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["error"]["force"] < 0.01
    assert result["error"]["velocity_p1"] < 0.01
    assert result["error"]["velocity_p2"] < 0.03
    assert result["dofs"] <= 150 < result["fe_dofs"]
    assert result["momentum_error"] < 1e-6
    assert abs(result["energy_error"]) < 1e-3
    # A wave returns from the rod's far end after 0.31 ms; until the plate answers, the force is that of two impedances.
    assert 450 < result["peak_force_N"] < 800
    assert result["time"]["reference_s"] > 50 * result["time"]["online_s"]
    assert set(result["time"]) == {"mesh_s", "fem_s", "reduce_s", "online_s", "reference_s"}


def test_existing_model_in_quick_mode(tmp_path):
    command = [sys.executable, str(ROOT / "examples" / "existing_model.py"), "--quick", "--out", str(tmp_path)]
    printed = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300).stdout
    assert matplotlib.image.imread(Path(printed.strip().splitlines()[-1])).std() > 0.05
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["error"]["tip_displacement"] < 1e-3
    assert result["error"]["deflection"] < 0.02
    assert result["largest_deflection_m"] > 1e-4
    assert result["dofs"] < 60 < result["fe_dofs"]
    assert set(result["time"]) == {"reduce_s", "online_s", "cms_reduce_s", "cms_online_s"}
