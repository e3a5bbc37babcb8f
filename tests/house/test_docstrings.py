"""The reference: what every public name, and every method of what it returns, says of itself."""

import ast
import inspect
import re
import textwrap
from types import ModuleType

import pytest

import exudyn_partition as ep

KNOWN = {"self", "cls", "mbs", "result", "progress"}  # the same everywhere
ARRAYS = ("Array", "ndarray", "csr_matrix")
SHAPE = re.compile(r"\((\d*[a-z]?\w*,[^()]*|\.\.\.[^()]*)\)")  # (n, 3), (3,), (...)


def exported(module):
    """Names that a module offers: those it says, or all that are defined in it."""
    own = [key for key, value in vars(module).items() if getattr(value, "__module__", "") == module.__name__]
    return getattr(module, "__all__", own)


def classes_behind(names):
    """Public classes and functions: exported ones, those of exported modules, and classes that they return."""
    found = {}
    for name in names:
        thing = getattr(ep, name)
        members = vars(thing) if isinstance(thing, ModuleType) else {name: thing}
        for key, value in members.items():
            own = not isinstance(thing, ModuleType) or key in exported(thing)
            if own and not key.startswith("_") and (inspect.isclass(value) or inspect.isfunction(value)):
                found[f"{value.__module__}.{value.__qualname__}"] = value
    return found


def callables():
    """Everything public that can be called or read, by its full name."""
    found = {}
    for name, thing in classes_behind(ep.__all__).items():
        found[name] = thing
        if inspect.isclass(thing):
            for base in reversed([c for c in thing.__mro__ if c.__module__.startswith("exudyn_partition")]):
                for key, value in vars(base).items():
                    value = value.fget if isinstance(value, property) else getattr(value, "__func__", value)
                    value = getattr(value, "func", value)  # cached_property
                    if not key.startswith("_") and inspect.isfunction(value):
                        found[f"{name}.{key}"] = value
    return found


PUBLIC = callables()


def raised(function):
    """Names of the errors that the function itself raises; checks of its input raise InputError."""
    names = set()
    for node in ast.walk(ast.parse(textwrap.dedent(inspect.getsource(function)))):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
            names.add(node.exc.func.id)
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "").startswith("validate_"):
            names.add("InputError")
    return names - {"NotImplementedError", "AttributeError"}


@pytest.mark.parametrize("name", PUBLIC)
def test_what_a_public_name_says(name):
    thing = PUBLIC[name]
    text = inspect.getdoc(thing) or ""
    assert text.splitlines()[:1], "no docstring"
    assert text.split("\n\n")[0].rstrip().endswith((".", "::")), "its first paragraph is no sentence"
    if inspect.isclass(thing):
        fields = getattr(thing, "__dataclass_fields__", {})
        missing = [field for field in fields if not re.search(rf"\b{field}\b", text)]
        assert not missing, f"fields that are not described: {missing}"
        return
    signature = inspect.signature(thing)
    missing = [p for p in signature.parameters if p not in KNOWN and not re.search(rf"\b{p}\b", text)]
    assert not missing, f"parameters that are not described: {missing}"
    if any(word in str(signature.return_annotation) for word in ARRAYS):
        assert SHAPE.search(text), "no shape of the array that it returns"
    for error in raised(thing):
        kinds = {
            kind.__name__ for kind in getattr(ep.errors, error).__mro__ if issubclass(kind, ep.errors.PartitionError)
        }
        assert any(kind in text for kind in kinds), f"{error} is not among what it raises"


def test_every_public_name_is_there():
    for name in ep.__all__:
        assert getattr(ep, name).__doc__, name
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        ep.nothing  # noqa: B018
