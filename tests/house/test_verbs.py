"""State: three verbs move it, `begin`, `at` and `accept`, see the contributing page."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / "exudyn_partition"
PACKAGES = "contact", "exudyn_contacts", "compiled"
VERBS = {"begin", "at", "accept"}  # and helpers that are named after them, as `_begin_step`
STATE = {  # attributes that have it
    "accepted", "opening", "since", "state", "_before", "_evaluated_at", "_known_at", "_multipliers", "_start",
    "_state", "_t",
}  # fmt: skip
ELSEWHERE = {  # where else it is assigned; nothing is added here
    "ContactRun._mean_force": "an answer of `at`",
    "ContactRun.apply_ahead": "multipliers of explicit steps, which act at their starts",
    "ContactRun.expect_impulse": "the same",
    "MultiplierStep.before_step": "called by Exudyn",
    "MultiplierStep.after_step": "called by Exudyn",
    "MultiplierStep._apply": "by both",
    "ModelRun._press": "an input: load steps close overlaps",
    "Gaps.exchange_flexibility": "no run has begun",
    "SpotGaps._prepare": "no run has begun",
    "RunRecord.advance": "a record",
}
GONE = {  # verbs that rewound attributes, or moved a state in another way
    "accept_ahead", "commit", "enter", "freeze", "go_on", "reset", "restore", "resume", "retry", "rewind", "rollback",
    "step_back", "take", "undo",
}  # fmt: skip


@pytest.fixture(scope="module")
def methods():
    """Methods of all classes of the packages that have state, by the names of class and method."""
    paths = [path for package in PACKAGES for path in (PACKAGE / package).rglob("*.py")]
    things = (thing for path in paths for thing in ast.parse(path.read_text()).body if isinstance(thing, ast.ClassDef))
    parts = ((thing, part) for thing in things for part in thing.body if isinstance(part, ast.FunctionDef))
    return {f"{thing.name}.{part.name}": part for thing, part in parts}


def assigned(method):
    """Attributes that a method assigns, but to a new object that it returns."""
    for node in ast.walk(method):
        stored = isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store)
        if stored and getattr(node.value, "id", "") != "result":
            yield node.attr


def test_state_is_assigned_by_its_verbs_alone(methods):
    found = {name for name, method in methods.items() if STATE.intersection(assigned(method))}
    others = {name for name in found if name.split(".")[1].lstrip("_").split("_")[0] not in {*VERBS, "init"}}
    assert others == set(ELSEWHERE)
    assert len(found - others) > 10


def test_verbs_that_are_gone_stay_away(methods):
    assert not [name for name in methods if name.split(".")[1] in GONE]
