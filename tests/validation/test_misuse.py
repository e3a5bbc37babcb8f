"""Wrong calls of every public function end in the library's own errors, or a right result, not in raw ones.

The wrong values are those of validation/stability/misuse.py, which tries all of them; here some, drawn by hypothesis.
"""

import inspect
import os
import re
import warnings
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exudyn_partition.errors import PartitionError, PartitionWarning
from validation.stability.misuse import GOOD, RIGHT, classify
from validation.stability.misuse_calls import CALLS, NOT_CALLED, Misuse, misuses, public, right_calls
from validation.stability.misuse_scenes import SCENES
from validation.stability.misuse_values import Scene

WRONG = misuses()
# Numbers that happen to be right may let these run for long.
SLOW = {
    *(
        "design_impact",
        "fe_model",
        "generate_mesh",
        "reduce",
        "reduce_pair",
        "solve_dynamic",
        "solve_static",
        "reference.simulate",
        "view.picture",
    ),
}
QUICK = [name for name in CALLS if name not in SLOW]
KINDS = [kind for entry in CALLS.values() for kind in entry.arguments.values()]
VALUES = [*{id(value): value for kind in KINDS for value in kind.wrong.values()}.values()]


@pytest.fixture(scope="module")
def scene():
    """Bodies, a run, and files; what is written without a folder goes there too."""
    made, before = Scene(), Path.cwd()
    os.chdir(made.folder)
    yield made
    os.chdir(before)


def test_every_public_function_is_called_with_every_argument():
    """A new one cannot be forgotten."""
    assert {*public()} == {*CALLS} | {*NOT_CALLED}
    for name, entry in CALLS.items():
        expected = {*inspect.signature(public()[name]).parameters} - {"self", "cls"}
        assert {*entry.arguments} == expected, name


def test_right_values_are_taken(scene):
    """What refuses these as well tells nothing of the wrong ones."""
    for call in right_calls():
        row = classify(call, scene)
        assert row["kind"] in RIGHT, row


@settings(max_examples=400, deadline=None, database=None)
@given(misuse=st.sampled_from(WRONG))
def test_a_wrong_value_is_named(scene, misuse):
    row = classify(misuse, scene)
    assert row["kind"] in GOOD, row


# What is refused for another argument, which it contradicts.
ELSEWHERE = {"Partition.interface", "Partition.surface", "Partition.load", "RigidMesh.of", "reduce_pair"}
OF_NO_KIND = [
    (misuse, found[1])
    for misuse in WRONG
    if (found := re.fullmatch(r"(?:.*)\((\w+)=(?:None|text|dict|object)\)", misuse.name))
    and misuse.name.partition("(")[0] not in ELSEWHERE
]


@settings(max_examples=300, deadline=None, database=None)
@given(case=st.sampled_from(OF_NO_KIND))
def test_messages_name_the_argument_as_the_caller_wrote_it(scene, case):
    misuse, argument = case
    row = classify(misuse, scene)
    said = row["said"].partition(": ")[2] if row["kind"] == "named error" else ""
    assert not said or re.search(rf"\b{argument}\b", said.partition(":")[0]), row


@settings(max_examples=200, deadline=None, database=None)
@given(data=st.data(), name=st.sampled_from(QUICK))
def test_values_of_any_kind(scene, data, name):
    """Some of them happen to be right, which must not end in an error of the inside either."""
    entry = CALLS[name]
    given_ = {argument: kind.right for argument, kind in entry.arguments.items()}
    changed = data.draw(st.lists(st.sampled_from([*given_]), min_size=1, max_size=3, unique=True))
    for argument in changed:
        given_[argument] = data.draw(st.sampled_from(VALUES) | st.none() | st.floats() | st.text() | st.integers())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            Misuse(name, public()[name], entry.of, given_)(scene)
        except (PartitionError, PartitionWarning):
            pass


@pytest.mark.parametrize("misuse", [s for s in SCENES if "command" in s.name][::6], ids=lambda misuse: misuse.name)
def test_a_wrong_command_is_named(scene, misuse):
    row = classify(misuse, scene)
    assert row["kind"] in GOOD, row
