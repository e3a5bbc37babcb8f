"""Attributes that are not there lead to those that are meant."""

import copy
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
