"""Errors for arguments in the wrong spelling name the right one."""

import pickle

import pytest

import exudyn_partition as ep
from exudyn_partition.support.spelling import spelled


@spelled
def impact(mass, *, initialVelocity=0.0, end_time=0.0):
    """What an impact gives."""
    return mass * (initialVelocity + end_time)


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        ("initial_velocity", "initialVelocity"),
        ("initialvelocity", "initialVelocity"),
        ("endTime", "end_time"),
        ("end_tme", "end_time"),
        ("colour", "It has mass, initialVelocity, end_time"),
    ],
)
def test_a_wrong_spelling_is_told_the_right_one(given, meant):
    with pytest.raises(TypeError, match=rf"impact\(\) has no argument '{given}'. (Take )?{meant}$"):
        impact(1.0, **{given: 1.0})


def test_right_calls_and_the_function_stay_as_they_are():
    assert impact(2.0, initialVelocity=1.0, end_time=2.0) == 6.0
    assert impact.__doc__ == "What an impact gives."
    assert pickle.loads(pickle.dumps(ep.reduce)) is ep.reduce


def test_other_mistakes_in_a_call_are_python_s():
    with pytest.raises(TypeError, match="missing 1 required positional argument: 'mass'"):
        impact(end_time=1.0)


@pytest.mark.parametrize(
    ("call", "meant"),
    [
        (
            lambda: ep.CreatePartitionBody(None, None, initial_velocity=0),
            "initialVelocity",
        ),
        (lambda: ep.CreatePartitionContact(None, None, None, slave_patch=0), "slavePatch"),
        (lambda: ep.solve_dynamic(None, endTime=1.0), "end_time"),
        (lambda: ep.solve_static(None, load_steps=1, Settings=None), "no argument"),
        (lambda: ep.reduce(None, None, fCut=1e3), "f_cut"),
        (lambda: ep.fe_model(None, None, max_h=1e-3), "maxh"),
        (lambda: ep.reduce_pair(None, None, tol=0.1), "It has slave, master"),
        (lambda: ep.design_impact(None, None, velocity=1.0, Tolerance=0.1), "It has"),
    ],
)
def test_functions_of_the_library(call, meant):
    with pytest.raises(TypeError, match=meant):
        call()
