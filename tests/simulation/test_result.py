"""Results: what they print, of which model and run they are."""

import copy

import numpy as np
import pytest
import scipy.sparse as sp
from oracles import collide

import exudyn_partition as ep
from exudyn_partition.errors import (
    InputError,
)

END = 60e-6


def test_force_on_the_slave_is_its_change_of_momentum(impact):
    mbs, striker, _, contact = impact
    result = ep.solve_dynamic(mbs, end_time=END, step=0.1e-6)
    impulse = np.trapezoid(contact.force_on_slave(result), result.t, axis=0)
    change = striker.momentum(result)[-1] - striker.momentum(result)[0]
    np.testing.assert_allclose(impulse, change, atol=1e-9 * change[2])


def test_a_result_prints_itself_in_a_line(impact):
    result = ep.solve_dynamic(impact[0], end_time=1e-6, step=0.5e-6)
    assert repr(result) == "Result(finished: reached 1e-06 s; 2 steps of 5e-07 s, explicit, 3 samples)"
    said = "Result(finished: samples of the model's last run; 2 steps of 5e-07 s, explicit, 3 samples)"
    assert str(ep.collect(impact[0])) == said


@pytest.mark.parametrize("times", [7, 10**4, 10**12])
def test_more_times_than_samples_are_all_samples(impact, times):
    result = ep.solve_dynamic(impact[0], end_time=1e-6, step=0.5e-6)
    np.testing.assert_array_equal(result.at(times).t, result.t)


@pytest.mark.parametrize(("name", "meant"), [
    ("time", "t for the times of the samples"), ("force", r"force\(result\) of what CreatePartitionContact returns"),
    ("statuss", "Take status"), ("zzz", "it has .*time_s"),
])  # fmt: skip
def test_an_attribute_that_is_not_there_leads_to_what_is_meant(impact, name, meant):
    result = ep.solve_dynamic(impact[0], end_time=1e-6, step=0.5e-6)
    for thing in (result, copy.copy(result)):
        assert not hasattr(thing, name)
        with pytest.raises(AttributeError, match=f"Result has no attribute '{name}'.*{meant}"):
            getattr(thing, name)


def test_a_result_of_another_model_is_refused(bodies):
    """Sensors of equal models have equal numbers: what they stored would pass for the other's."""
    (mbs, *_), (_, striker, _, contact) = collide(bodies), collide(bodies)
    result = ep.solve_dynamic(mbs, end_time=1e-6)
    for ask in (striker.energy, striker.momentum, contact.force, contact.closed_rows, contact.gap, contact.row_forces):
        with pytest.raises(InputError, match=r"result: .* model that (the contact|the body) belongs to, .* another"):
            ask(result)


def test_results_of_a_model_live_side_by_side(impact):
    """What a contact keeps beside its sensors belongs to the run: a later one takes nothing of it."""
    mbs, _, _, contact = impact
    first = ep.solve_dynamic(mbs, end_time=20e-6)
    force, rows = contact.force(first), contact.row_forces(first)
    assert force.max() > 0
    asked = (contact.row_forces, contact.pressure, contact.area, contact.radius, contact.energy, contact.nodal_forces)
    before = [ask(first) for ask in asked]
    np.testing.assert_allclose(contact.row_forces(first.at(3)).sum(axis=1).A1, contact.force(first.at(3)))
    np.testing.assert_array_equal(contact.row_forces(ep.collect(mbs)).data, rows.data)
    second = ep.solve_dynamic(mbs, end_time=2e-6)
    for ask, was in zip(asked, before, strict=True):
        assert not same(ask(second), was)
        assert same(ask(first), was)
    np.testing.assert_array_equal(contact.force(first), force)


def same(one, other):
    """Whether two answers, arrays or sparse matrices or lists of such, are equal."""
    if isinstance(one, list):
        return all(map(same, one, other))
    if one.shape != other.shape:
        return False
    return (one != other).nnz == 0 if sp.issparse(one) else np.array_equal(one, other)


def test_questions_change_no_run(impact):
    """A run is the same whether results of an earlier one are asked in the midst of it or not."""
    mbs, striker, _, contact = impact
    first = ep.solve_dynamic(mbs, end_time=20e-6)
    asked = []

    def ask(share):
        asked.append(share)
        contact.energy(first)
        contact.nodal_forces(first)
        ep.stability_limit(mbs)
        q = np.zeros(contact.mechanics.gaps.n)
        ep.time_to_contact(contact, q, q)

    second = ep.solve_dynamic(mbs, end_time=20e-6, progress=ask)
    assert len(asked) > 50
    np.testing.assert_array_equal(contact.force(second), contact.force(first))
    np.testing.assert_array_equal(striker.coordinates(second), striker.coordinates(first))
