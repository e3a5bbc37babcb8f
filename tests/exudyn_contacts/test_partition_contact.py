"""The contact as an object of Python: its views."""

import copy

import exudyn as exu
import pytest

import exudyn_partition as ep
from exudyn_partition.errors import InputError


@pytest.fixture(scope="module")
def contact(round_body):
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, round_body, referencePosition=[0, 0, 1e-6])
    return ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), friction=ep.Coulomb(0.3, 0.2, 0.1))


def test_coefficients_are_those_of_coulombs_law(contact):
    assert (contact.friction.coulomb.static, contact.friction.coulomb.kinetic) == (0.3, 0.2)


def test_other_names_are_no_attributes(contact):
    for thing in (contact, contact.friction, contact.plastic):
        with pytest.raises(AttributeError, match=f"'{type(thing).__name__}' object has no attribute 'forse'"):
            thing.forse  # noqa: B018


def test_views_are_false_where_there_is_nothing(contact):
    assert contact.friction
    assert not contact.plastic
    assert not contact.plastic.zones
    with pytest.raises(InputError, match="has no plastic zones"):
        contact.plastic.strain(None)


def test_energies_of_another_model_are_refused(marble):
    """Also where the contact has neither friction nor plastic zones, and the answer would be zero."""
    runs = []
    for _ in range(2):
        mbs = exu.SystemContainer().AddSystem()
        item = ep.CreatePartitionBody(mbs, marble, referencePosition=[0, 0, 5e-3])
        contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), slavePatch="south")
        mbs.Assemble()
        runs.append((contact, ep.solve_dynamic(mbs, end_time=2e-7, step=1e-7)))
    (contact, result), (_, other) = runs
    for taken in (contact.friction.work, contact.plastic.work, contact.dissipated_energy):
        assert not taken(result).any()
        with pytest.raises(InputError, match=r"result: expected one of the model that .* belongs to"):
            taken(other)


def test_copies_have_views_of_their_own(contact):
    again = copy.copy(contact)
    assert dict(again) == dict(contact)
    assert again.friction.coulomb is contact.mechanics.friction
