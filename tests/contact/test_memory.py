"""What a contact with friction remembers of a step."""

from types import SimpleNamespace

import numpy as np

from exudyn_partition.algebra.friction import OPEN, SLIP, STICK
from exudyn_partition.contact.memory import RowMemory


def test_slip_paths_add_up_over_steps_and_rows_that_stick_or_are_open_add_nothing():
    """Rows are those of nodes 3, 0 and 2 of four; the first and the last one slip in both steps, along any way."""
    rows = SimpleNamespace(gaps=SimpleNamespace(row_nodes=np.array([3, 0, 2])), axes=np.eye(3))
    memory = RowMemory.none(4)
    for status, slips in (
        ([SLIP, STICK, SLIP], [[3.0, 4.0], [9.0, 9.0], [0.0, -1.0]]),
        ([SLIP, OPEN, SLIP], [[0.0, -2.0], [9.0, 9.0], [0.6, 0.8]]),
    ):
        slid = np.array(slips)
        memory = memory.after(rows, np.ones(3), np.zeros((3, 3)), np.array(status), slid, np.hypot(*slid.T), 0.5)
    np.testing.assert_allclose(memory.path, [0, 0, 2, 7])
    np.testing.assert_allclose(memory.speed, [0, 0, 1, 2])
    assert memory.slipped.tolist() == [False, False, True, True]
    assert memory.dissipated == 1.0
