"""Attributes that are not there lead to those that are meant."""

import copy
import inspect
import pickle

import numpy as np
import pytest

import exudyn_partition as ep


@pytest.mark.parametrize(
    ("name", "meant"),
    [("time", "t, the times"), ("time_s", 'info."time_s".'), ("forces", "force"), ("velocty", "velocity")],
)
def test_of_a_history(name, meant):
    history = ep.History(np.arange(3.0), np.arange(3.0), {})
    for one in (history, copy.deepcopy(history), pickle.loads(pickle.dumps(history))):
        with pytest.raises(AttributeError, match=f"History has no attribute '{name}'. Take {meant}"):
            getattr(one, name)


def shown(thing):
    return {name for name in dir(thing) if not name.startswith("_")}


@pytest.mark.parametrize("name", [name for name in ep.__all__ if inspect.ismodule(getattr(ep, name))])
def test_dir_of_a_module_shows_what_it_offers(name):
    module = getattr(ep, name)
    assert shown(module)
    assert not shown(module) & {"np", "Array", "annotations", "require"}  # which it imports for itself
    for one in shown(module):
        what = getattr(module, one)
        if callable(what):
            assert what.__module__.startswith("exudyn_partition.")
            assert inspect.getdoc(what), one
            assert not one.startswith("validate")


def test_dir_of_results_and_items_shows_what_a_user_may_take(impact):
    mbs, striker, target, contact = impact
    result = ep.solve_dynamic(mbs, end_time=2e-6, step=0.5e-6)
    assert {"force", "gap", "pressure", "friction", "plastic", "name", "slave"} <= shown(contact)
    assert {"velocity", "energy", "CreateInterfaceMarker", "body", "name"} <= shown(striker)
    assert {"t", "status", "scene", "film", "report", "contacts", "at"} <= shown(result)
    assert {"table", "save", "matrices", "n_dofs"} <= shown(striker.body)
    inside = {"update", "clear", "slices", "mechanics", "group", "as_made", "seldom", "marks", "check_nodes"}
    for one in (contact, striker, target, result, striker.body):
        assert not shown(one) & inside
        for name in shown(one):  # all of it is there
            getattr(one, name)
    assert contact.mechanics is not None  # the library itself finds the rest
