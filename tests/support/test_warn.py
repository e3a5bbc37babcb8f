"""A warning names the line of the user's program, however deep in the package it arises."""

import warnings

import pytest
from oracles import box

import exudyn_partition as ep
from exudyn_partition.errors import UnitsWarning


def test_through_one_function_or_several(tmp_path):
    """`fe_models` calls `fe_model`, whose warnings told of a line within the package."""
    block = box(0.01, 0.01, 0.02)
    block.WriteStep(str(tmp_path / "block.step"))
    assembly = ep.read_step(tmp_path / "block.step")
    calls = [
        lambda: ep.fe_model(block, ep.STEEL, maxh=0.05),
        lambda: ep.fe_models(assembly, dict.fromkeys(assembly.names, ep.STEEL), maxh=50.0),
    ]
    for call in calls:
        with pytest.warns(UnitsWarning) as caught:
            call()
        assert {warning.filename for warning in caught} == {__file__}


def test_many_warnings_of_one_line_can_be_silenced_there():
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        for _ in range(2):
            ep.fe_model(box(0.01, 0.01, 0.02), ep.STEEL, maxh=0.05)
    assert len(caught) == 1
