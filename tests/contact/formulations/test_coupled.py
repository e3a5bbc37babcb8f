"""Contacts on common bodies, whose forces are found together."""

import numpy as np
import pytest

from exudyn_partition.contact.formulations.coupled import CoupledContacts
from exudyn_partition.contact.side import Standing
from exudyn_partition.errors import ComplementarityError


class Runaway:
    """A law whose force grows with what another pushes: patches that move each other more than themselves."""

    carried = remembers = False
    friction = None
    pushes, since = True, 0.0
    node_areas = np.ones(1)

    def __init__(self):
        self.gaps = self
        self.reset()

    def reset(self):
        self.lam, self.index = np.ones(1), np.zeros(1, dtype=int)

    @property
    def forces(self):
        return self.lam

    def at(self, q):
        return q

    def standing(self):
        return Standing(self, self, np.zeros(1))

    def side_rows(self, side):
        return np.eye(1)

    def answer(self, h, pushed=0.0):
        self.lam = np.maximum(-(h + pushed), 0.0)


def test_contacts_that_do_not_settle_are_an_error():
    """The sweeps used to end after their hundredth with whatever forces there were."""
    laws = [Runaway(), Runaway()]
    links = [(0, 0, 1, 0, -1.5 * np.eye(1)), (1, 0, 0, 0, -1.5 * np.eye(1))]
    with pytest.raises(ComplementarityError, match="2 contacts on common bodies did not settle in 100 sweeps"):
        CoupledContacts(laws, lambda: links).for_run(laws).forces([np.array([-1.0]), np.array([-2.0])])


class Spring(Runaway):
    """A law whose forces are the depths of its row."""

    def reset(self):
        self.answer(np.ones(1))

    @property
    def pushes(self):
        return self.index.size > 0

    def answer(self, h, pushed=0.0):
        super().answer(h, pushed)
        self.index = np.flatnonzero(self.lam)

    def generalised(self):
        return self.lam


def test_a_contact_that_only_the_other_closes_is_closed():
    """Laws with a memory used to be asked only if two were closed without each other."""
    laws = [Spring(), Spring()]
    links = [(0, 0, 1, 0, np.full((1, 1), -0.3)), (1, 0, 0, 0, np.full((1, 1), -0.3))]
    found = CoupledContacts(laws, lambda: links).for_run(laws).forces([np.array([-1.0]), np.array([0.1])])
    # a = 1 + 0.3 b and b = 0.3 a - 0.1
    np.testing.assert_allclose(np.concatenate(found), [0.97 / 0.91, 0.3 * 0.97 / 0.91 - 0.1], rtol=1e-9)
