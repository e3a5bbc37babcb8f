"""Steps that a law in a run begins, and what a group of contacts keeps."""

from types import SimpleNamespace

import numpy as np

from exudyn_partition.exudyn_contacts.contact_record import ContactRecord
from exudyn_partition.exudyn_contacts.contact_run import ContactRun
from exudyn_partition.exudyn_contacts.group_run import CoupledRun


class Diary:
    """A contact that writes down which steps it is told of."""

    points = SimpleNamespace(node_areas=np.ones(1), pressures=None)
    gaps = SimpleNamespace(all_points=points, carried=False)
    zones, remembers, ahead, damped, elastic, law = None, True, False, False, True, None
    state, evaluation = SimpleNamespace(memory=None), SimpleNamespace(plastic=None, pushes=True)

    def __init__(self):
        self.pages = []

    def accept(self, start, end):
        self.pages.append(("accept", start, end))

    def begin(self, *, end, freezes):
        self.pages.append(("begin", end))


def test_laws_that_remember_are_told_of_steps_once_and_of_those_that_are_repeated():
    """A step is the one before again if it begins at the same time and ends at another."""
    law = Diary()
    run = ContactRun("contact", law, [slice(0, 1)], 0.0, "implicit")
    for start, end in [(0.0, 1.0), (0.0, 1.0), (0.0, 0.5), (0.0, 0.25), (0.25, 0.5), (0.25, 0.5), (0.5, 0.75)]:
        run.accept(start, end)
    first = ("accept", 0.0, 1.0), ("begin", 0.5), ("begin", 0.25)
    assert law.pages == [*first, ("accept", 0.25, 0.5), ("accept", 0.5, 0.75)]


def test_a_group_keeps_what_each_member_has_once_a_time_and_notes_its_edge():
    """By rows of all members, one after the other: the first row of the second member lies at the edge of its patch."""
    loops = SimpleNamespace(
        starts=np.array([0, 2, 4]), lam=np.array([0.0, 3.0, 2.0, 0.0]), row_nodes=np.array([5, 6, 7, 8]),
        leaves_at=np.array([np.inf, np.inf, 0.0, np.inf]),
        h=-np.ones(4), stored=np.array([0.1, 0.2]), values=np.zeros((2, 6)),
        pushes=True, force=np.ones(1), at=lambda q: True, kept=None,
    )  # fmt: skip
    at_edge = SimpleNamespace(evaluation=SimpleNamespace(edge_reached=lambda: np.zeros(3)), damped=False)
    members = [
        SimpleNamespace(
            dofs=np.zeros(1, int), place=None, join=lambda group, place: None, acts_within=True, remembers=False,
            force=None, pushes=False, impulses=None, mechanics=at_edge, record=ContactRecord(Diary()),
            coordinates_in=lambda q: q,
        )
        for _ in range(2)
    ]  # fmt: skip
    group = CoupledRun(members, SimpleNamespace(frozen=lambda dofs, last: loops, answer_as=lambda *answer: True))
    for t, size in ((1.0, 7.0), (1.0, 1.0), (2.0, 4.0)):  # the first time is asked for again
        loops.lam, loops.stored[:] = size * np.array([0.0, 3.0, 2.0, 0.0]), [0.1 * size, 0.2 * size]
        group.at(None, t, np.array([size]))
        group.keep(t, lambda: np.zeros(1))
    first, second = (member.record for member in members)
    assert first.edge is None
    assert second.edge is not None
    assert second.edge[0] == 1.0
    kept = [(t, nodes.tolist(), lam.tolist()) for t, nodes, lam in second.samples]
    assert kept == [(1.0, [7], [2.0]), (2.0, [7], [8.0])]
    assert [nodes.tolist() for _, nodes, _ in first.samples] == [[6], [6]]
    assert second.stored == {1.0: 0.2, 2.0: 0.8}


class Known(Diary):
    """A law whose force is known."""

    remembers = False


def test_forces_of_a_body_that_touches_itself_add_up():
    """Both sides have the same coordinates; other members of the group have coordinates of their own."""
    forces = [np.array([1.0, 2.0, 10.0, 20.0]), np.array([3.0, 4.0])]
    members = [
        ContactRun("contact", Known(), [slice(n, n + 1) for n in dofs], 0.0, "explicit")
        for dofs in ([1, 2, 1, 2], [0, 2])
    ]
    group = CoupledRun(members, SimpleNamespace(frozen=lambda dofs, last: None, forces_at=lambda q, parts: forces))
    mbs = SimpleNamespace(systemData=SimpleNamespace(GetTime=lambda configuration: 0.0))
    group.at(mbs, 0.0, np.zeros(4))
    total = np.zeros(4)
    group.add_force(total)
    assert group.pushes
    assert total.tolist() == [3.0, 11.0, 26.0, 0.0]
