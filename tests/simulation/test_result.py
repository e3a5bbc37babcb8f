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
from exudyn_partition.plasticity.flow import PlasticState
from exudyn_partition.plasticity.strain_history import StrainHistory
from exudyn_partition.results.history import History

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
        with pytest.raises(InputError, match=r"result: .* model that (contact .*|the body) belongs to, .* another"):
            ask(result)


@pytest.mark.parametrize("number", [None, "x", 2.5, True, float("nan"), [1]])
def test_numbers_of_sensors_that_cannot_be_are_named(impact, number):
    mbs, striker, _, contact = impact
    result = ep.solve_dynamic(mbs, end_time=1e-6)
    np.testing.assert_array_equal(result.sensor_of(contact, contact["sForce"]), result.sensor(contact["sForce"]))
    for ask in (result.sensor, lambda one: result.sensor_of(striker, one)):
        with pytest.raises(InputError, match="number: expected a whole number"):
            ask(number)


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


def written(value):
    """Write into all arrays of an answer, as far as NumPy allows it."""
    match value:
        case np.ndarray() if value.flags.writeable:
            value[...] = 7
        case dict():
            written(list(value.values()))
        case list() | tuple():
            for item in value:
                written(item)
        case _ if sp.issparse(value):
            written(value.data)
        case PlasticState():
            written([value.strain, value.equivalent, value.back])
        case History():
            written([value.t, value.force, value.tangential_force, value.dissipated, dict(value.velocity)])
        case StrainHistory():
            written(value.strain(5))


def plain(value):
    """The same answer in lists and numbers."""
    match value:
        case np.ndarray():
            return value.tolist()
        case dict():
            return {key: plain(item) for key, item in value.items()}
        case list() | tuple():
            return [plain(item) for item in value]
        case _ if sp.issparse(value):
            return plain(value.toarray())
        case PlasticState():
            return plain([value.strain, value.equivalent, value.back])
        case History():
            return plain([value.t, value.force, value.tangential_force, value.dissipated, dict(value.velocity)])
        case StrainHistory():
            return plain(value.strain(5))
    return value


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("stored", [False, True])
def test_what_a_user_writes_into_an_answer_changes_no_other(mbs, yielding, tmp_path, stored):
    """A conversion of units in place had changed the result itself: impulses, energies, pages and files."""
    item = ep.CreatePartitionBody(
        mbs, yielding, name="ball", referencePosition=[0, 0, 1e-6], initialVelocity=[0.5, 0, -1.5]
    )
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), friction=0.3, name="floor")
    contact.AddMomentSensor(mbs)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=12e-6, step=0.25e-6)
    if stored:
        result.save(tmp_path / "run")
        result = ep.Result.load(tmp_path / "run", mbs)
    asked = {f"sensor {number}": (lambda number=number: result.sensor(number)) for number in result.sensors}
    asked |= {"t": lambda: result.t, "history": lambda: result.history(contact)}
    asked |= {"at": lambda: [result.at(5).t, contact.force(result.at(5))]}
    for of in (contact, contact.friction, contact.plastic, item):
        for name in dir(type(of)):
            method = getattr(of, name, None)
            if callable(method) and not name.startswith(("_", "Create", "Add")) and name not in dir(dict):
                asked[f"{type(of).__name__}.{name}"] = lambda method=method: method(result)
    answers = {}
    for name, ask in list(asked.items()):
        try:
            answers[name] = plain(ask())
        except (TypeError, AttributeError, InputError):  # it takes something else than a result alone
            del asked[name]
    assert len(asked) > 35
    assert {"PartitionContact.force", "FrictionResults.slip_path", "PlasticResults.states"} < {*asked}
    for ask in asked.values():
        written(ask())
    assert [name for name, ask in asked.items() if repr(plain(ask())) != repr(answers[name])] == []
    for mine in (result.t, contact.force(result), contact.friction.work(result)):
        with pytest.raises(ValueError, match="read-only"):
            mine *= 1e3
