"""Architecture: which module may import which."""

import ast
import graphlib
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "exudyn_partition"
LAYERS = [  # lowest first; a package may import those before it, and so may what is imported for type checking
    "_version", "errors", "support", "algebra", "fe", "meshing", "surfaces", "plasticity", "prediction", "reduction",
    "frames", "contact.plasticity", "contact", "contact.formulations", "compiled", "accuracy", "results",
    "exudyn_bodies", "exudyn_contacts", "present", "simulation", "studies", "reference", "cli", "__main__", "__init__",
]  # fmt: skip


class Imports(NamedTuple):
    """Modules of the package, and packages outside, that a module imports, also through `require`."""

    inside: set[str]
    outside: set[str]


def imports_of(module, nodes):
    inside, outside = set(), set()
    for node in nodes:
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
    return Imports(inside, outside)


@pytest.fixture(scope="module")
def syntax():
    """All nodes of the syntax of each module of the package, by its dotted name."""
    paths = {".".join(path.relative_to(PACKAGE).with_suffix("").parts): path for path in PACKAGE.rglob("*.py")}
    return {module: [*ast.walk(ast.parse(path.read_text()))] for module, path in paths.items()}


@pytest.fixture(scope="module")
def modules(syntax):
    """What each module of the package imports, by its dotted name."""
    return {module: imports_of(module, nodes) for module, nodes in syntax.items()}


def layer(module):
    """Number of the layer of a module: that of the longest name in `LAYERS` that it begins with."""
    return LAYERS.index(max((name for name in LAYERS if f"{module}.".startswith(f"{name}.")), key=len))


def test_imports_point_to_lower_layers(modules):
    assert {layer(module) for module in modules} == set(range(len(LAYERS)))
    upward = {
        (module, name) for module, found in modules.items() for name in found.inside if layer(name) > layer(module)
    }
    assert not upward


def test_the_lowest_folder_knows_no_package_above_it(syntax):
    """Neither by imports nor by name: a text with the name of a package would be a way around the layers."""
    above = {name.split(".")[0] for name in LAYERS[LAYERS.index("support") + 1 :]} - {"__main__", "__init__"}
    lowest = {module: nodes for module, nodes in syntax.items() if module.startswith("support.")}
    assert len(lowest) > 10
    for module, nodes in lowest.items():
        texts = [node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)]
        assert not above & {*texts}, module


def test_no_modules_import_each_other(modules):
    order = graphlib.TopologicalSorter({module: found.inside for module, found in modules.items()})
    order.prepare()  # raises CycleError, which names them


def test_outer_packages_have_one_door_each(modules):
    users = {
        package: {module for module, found in modules.items() if package in found.outside}
        for package in ("ngsolve", "netgen", "meshio", "exudyn")
    }
    assert users["ngsolve"] == {"meshing.netgen_mesh", "meshing.ngsolve_fem"}
    assert users["netgen"] == {"meshing.netgen_mesh", "meshing.ngsolve_fem", "cli.doctor"}  # the doctor tries them
    assert users["meshio"] == {"meshing.mesh_files"}
    folders = {module.split(".")[0] for module in users["exudyn"]}
    assert folders == {"exudyn_bodies", "exudyn_contacts", "present", "simulation", "studies", "cli"}
    assert {module for module in users["exudyn"] if module.startswith("present.")} == {"present.view"}


def test_compiled_loops_have_one_door_a_layer(syntax):
    """Callers of loops do not ask whether numba is there. The doctor says it, and products are a door of their own."""
    asking, doors = {}, set()
    for module, nodes in syntax.items():
        calls = [node.func for node in nodes if isinstance(node, ast.Call)]
        named = {getattr(call, "id", getattr(call, "attr", "")) for call in calls}
        if asked := named & {"kernels", "compiles"}:
            asking[module] = asked
        if module.endswith("kernels") and not module.startswith("support."):
            doors.add(f"{module.rsplit('.', 1)[0]}.loops")
    assert asking.pop("support.compiled") == {"compiles"}
    assert asking.pop("cli.doctor") == {"compiles"}
    assert asking == {door: {"kernels"} for door in {*doors, "algebra.products"}}


def test_compiled_loops_write_arrays_entry_by_entry(syntax):
    """An array that is written at once brings code that tells of other shapes in words, seconds to compile."""
    loops = {module: nodes for module, nodes in syntax.items() if module.endswith("kernels")}
    assert len(loops) > 10
    for module, nodes in loops.items():
        for node in nodes:
            for target in node.targets if isinstance(node, ast.Assign) else ():
                pairs = [(target, node.value)]
                if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                    pairs = [*zip(target.elts, node.value.elts, strict=True)]
                for place, value in pairs:
                    sliced = isinstance(place, ast.Subscript) and any(
                        isinstance(part, ast.Slice) for part in ast.walk(place.slice)
                    )
                    assert not sliced or isinstance(value, ast.Constant), f"{module}:{node.lineno}"


def test_sparse_matrices_are_factorised_by_one_function(syntax):
    """So that another solver can take its place. SuperLU solves small or unsymmetric systems of bodies and joints."""
    users = {
        module
        for module, nodes in syntax.items()
        for node in nodes
        if isinstance(node, ast.Call) and getattr(node.func, "id", getattr(node.func, "attr", "")) == "Factorisation"
    }
    assert users == {"algebra.sparse.solver"}


def test_import_needs_neither_exudyn_nor_ngsolve():
    code = "import sys, exudyn_partition as ep; ep.Material; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"exudyn", "ngsolve", "netgen", "meshio", "matplotlib", "scipy.sparse", "rich", "numba"} & set(loaded)


def test_a_run_needs_no_module_that_takes_long_to_import():
    """`scipy.signal` brings `scipy.stats`; minimisers, integrators and splines take long too."""
    code = "import sys, exudyn_partition as ep; ep.solve_dynamic, ep.CreatePartitionContact; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "scipy.spatial" in loaded
    late = ("signal", "stats", "optimize", "integrate", "interpolate")
    assert not {f"scipy.{name}" for name in late} & {*loaded}
