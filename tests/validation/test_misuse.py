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
from validation.stability.misuse import GOOD, RIGHT, call, classify, public, right_calls, scenes, wrong_calls
from validation.stability.misuse_calls import ARGUMENTS, CALLS, NOT_CALLED, OBJECTS
from validation.stability.misuse_objects import Scene

WRONG = wrong_calls()
# Numbers that happen to be right may let these run for long.
SLOW = {
    *(
        "design_impact",
        "fe_model",
        "generate_mesh",
        "reduce",
        "reduce_pair",
        "restitution_map",
        "solve_dynamic",
        "solve_static",
        "reference.simulate",
        "view.picture",
    ),
}
QUICK = [name for name in CALLS if name not in SLOW]
KINDS = [kind for name in CALLS for kind in call(name).arguments.values()]
VALUES = [*{id(value): value for kind in KINDS for value in kind.wrong.values()}.values()]
VALUES = [value for value in VALUES if not callable(value)]  # errors of a caller's own function are the caller's


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
    for name in CALLS:
        expected = {*inspect.signature(public()[name]).parameters} - {"self", "cls"}
        assert {*call(name).arguments} == expected, name


def test_tables_have_nothing_that_is_not_called():
    """What is left of a name that went would seem to be tried."""
    taken = {a for name in CALLS for a, kind in call(name).arguments.items() if CALLS[name].get(a) is not kind}
    assert {*ARGUMENTS} == taken
    assert {*OBJECTS} <= {name.rpartition(".")[0] for name in CALLS}
    with pytest.raises(LookupError, match=r"CALLS has values for \{'colour'\}"):
        call("StrainGauge", {"colour": 1})
    with pytest.raises(LookupError, match="add a kind of values for 'length'"):
        call("StrainGauge", {})


def test_right_values_are_taken(scene):
    """What refuses these as well tells nothing of the wrong ones."""
    for case in right_calls():
        row = classify(case, scene)
        assert row["kind"] in RIGHT, row


@settings(max_examples=400, deadline=None, database=None)
@given(case=st.sampled_from(WRONG))
def test_a_wrong_value_is_named(scene, case):
    row = classify(case, scene)
    assert row["kind"] in GOOD, row


# What is refused for another argument, which it contradicts.
ELSEWHERE = {"Partition.interface", "Partition.surface", "Partition.load", "RigidMesh.of", "reduce_pair"}
OF_NO_KIND = [
    (case, found[1])
    for case in WRONG
    if (found := re.fullmatch(r"(?:.*)\((\w+)=(?:None|text|dict|object)\)", case.name))
    and case.name.partition("(")[0] not in ELSEWHERE
]


@settings(max_examples=300, deadline=None, database=None)
@given(wrong=st.sampled_from(OF_NO_KIND))
def test_messages_name_the_argument_as_the_caller_wrote_it(scene, wrong):
    case, argument = wrong
    row = classify(case, scene)
    said = row["said"].partition(": ")[2] if row["kind"] == "named error" else ""
    assert not said or re.search(rf"\b{argument}\b", said.partition(":")[0]), row


@settings(max_examples=200, deadline=None, database=None)
@given(data=st.data(), name=st.sampled_from(QUICK))
def test_values_of_any_kind(scene, data, name):
    """Some of them happen to be right, which must not end in an error of the inside either."""
    given_ = call(name).right
    changed = data.draw(st.lists(st.sampled_from([*given_]), min_size=1, max_size=3, unique=True))
    for argument in changed:
        given_[argument] = data.draw(st.sampled_from(VALUES) | st.none() | st.floats() | st.text() | st.integers())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            call(name)(scene, given_)
        except (PartitionError, PartitionWarning):
            pass


@pytest.mark.parametrize("case", [s for s in scenes() if "command" in s.name][::6], ids=lambda case: case.name)
def test_a_wrong_command_is_named(scene, case):
    row = classify(case, scene)
    assert row["kind"] in GOOD, row
