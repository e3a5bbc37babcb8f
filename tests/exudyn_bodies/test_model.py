"""Which items of this library a model holds after a Reset, and how often Exudyn is asked for that."""

import exudyn as exu
import pytest

import exudyn_partition as ep
from exudyn_partition.exudyn_bodies.model import registered
from exudyn_partition.exudyn_bodies.partition_body import PartitionBody


def row_of(mbs, body, n):
    """Bodies side by side, each on its plane."""
    items = [ep.CreatePartitionBody(mbs, body, referencePosition=[i, 0, 0]) for i in range(n)]
    return items, [
        ep.CreatePartitionContact(mbs, item, ep.RigidPlane((0, 0, -1)), slavePatch="south") for item in items
    ]


def test_a_contact_asks_exudyn_as_often_in_a_large_model_as_in_a_small_one(marble, monkeypatch):
    asked, ask = [], PartitionBody.is_in
    monkeypatch.setattr(PartitionBody, "is_in", lambda item, mbs: asked.append(item) or ask(item, mbs))
    counts = []
    for n in (2, 12):
        mbs = exu.SystemContainer().AddSystem()
        items = [ep.CreatePartitionBody(mbs, marble, referencePosition=[i, 0, 0]) for i in range(n)]
        asked.clear()
        ep.CreatePartitionContact(mbs, items[0], ep.RigidPlane((0, 0, -1)), slavePatch="south")
        counts.append(len(asked))
    assert counts[0] == counts[1]


@pytest.mark.parametrize("others", [0, 1, 4])
def test_only_items_since_a_reset_are_held(mbs, marble, others):
    """Also where Exudyn's own items come first, so that new bodies get other numbers, some of them old ones."""
    row_of(mbs, marble, 3)
    mbs.Reset()
    for _ in range(others):
        mbs.CreateMassPoint(referencePosition=[0, 0, 0], mass=1.0)
    items, contacts = row_of(mbs, marble, 2)
    held = registered(mbs)
    assert [*held.bodies.values()] == items
    assert [*held.contacts.values()] == contacts
    assert [contact.name for contact in contacts] == ["body 0 on plane", "body 1 on plane 2"]
    assert [held.contacts_on([item]) for item in items] == [[contact] for contact in contacts]
    mbs.Reset()
    held = registered(mbs)
    assert (held.bodies, held.contacts) == ({}, {})
