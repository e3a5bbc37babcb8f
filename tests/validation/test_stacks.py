"""Stacked blocks of `validation.friction.stacks`: a sample of the random ones, and a start that rounding decides."""

import exudyn as exu
import numpy as np
import pytest

import exudyn_partition as ep
from validation.friction import stacks


@pytest.fixture(scope="module")
def blocks():
    return stacks.blocks()


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.PartitionWarning")  # of explicit steps, and of edges
@pytest.mark.parametrize("seed", [4, 5, 11, 14, 25, 50, 54, 122, 182])
def test_random_stacks_run_and_keep_the_cone(blocks, seed):
    """From 25 on, a whole face slips on the way to the rest: there the tangents of friction lead far away."""
    weights, cone, _ = stacks.random_stack(blocks, seed)
    assert weights < 1e-8
    assert cone < 1e-9


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.PartitionWarning")
def test_blocks_rest_on_faces_of_which_rounding_has_closed_a_part():
    """Some rows of faces that just touch overlap by 1e-18 m; the first step of Newton's method used to know no others.

    Blocks then tilted far on these, and some lost contact.
    """
    body, angles = stacks.block(10e-3, 10e-3, 10e-3, maxh=2.7e-3, f_cut=150e3, share=0.35), 7.0 * np.arange(4)
    places = [[1e-3 * (i % 2), 0.5e-3 * (i % 3), 10e-3 * i] for i in range(4)]
    mbs = exu.SystemContainer().AddSystem()
    contacts = stacks.stand(mbs, [body] * 4, places, angles, [0.3] * 4, 9810.0)
    result = ep.solve_static(mbs, load_steps=1)
    found = [contact.force(result)[-1] / (9810.0 * body.total_mass) for contact in contacts]
    np.testing.assert_allclose(found, [4, 3, 2, 1], rtol=1e-6)
    assert result.work.newton_iterations < 15


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.PartitionWarning")
def test_a_block_beyond_the_edge_of_another_has_no_rest(blocks):
    mbs = exu.SystemContainer().AddSystem()
    places = [[0.0, 0.0, 0.0], [6e-3, 0.0, 8e-3]]  # the lower one ends at 4 mm
    stacks.stand(mbs, [blocks[1], blocks[1]], places, [0.0, 0.0], [0.3, 0.3], 9810.0)
    with pytest.raises(ep.errors.RunError, match="tips over, because the weight above a face lies beside it"):
        ep.solve_static(mbs, load_steps=1)
