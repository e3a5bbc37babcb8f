"""Results in files, and the models that they are of."""

import exudyn as exu
import numpy as np
import pytest
from oracles import TOP

import exudyn_partition as ep
from exudyn_partition.errors import InputError

END = 60e-6


def striking(mbs, bodies, **options):
    """Ball and block, assembled: model, ball, contact."""
    ball = ep.CreatePartitionBody(
        mbs, bodies[0], name="ball", referencePosition=TOP, initialVelocity=[0, 0, -1.0], **options
    )
    block = ep.CreatePartitionBody(mbs, bodies[1], name="block")
    contact = ep.CreatePartitionContact(mbs, ball, block, name="tip")
    mbs.Assemble()
    return mbs, ball, contact


def test_a_result_that_is_saved_is_that_of_the_model_built_again(mbs, bodies, tmp_path):
    """All that sensors told, to the bit; what contacts keep beside them is refused by name."""
    _, ball, contact = striking(mbs, bodies)
    result = ep.solve_dynamic(mbs, end_time=END, step=0.5e-6)
    path = tmp_path / "run.npz"
    result.save(path)
    again, same_ball, same_contact = striking(exu.SystemContainer().AddSystem(), bodies)
    loaded = ep.Result.load(path, again)
    assert repr(loaded) == repr(result)
    np.testing.assert_array_equal(loaded.t, result.t)
    np.testing.assert_array_equal(same_contact.force(loaded), contact.force(result))
    point = (0, 0, 0.02)
    np.testing.assert_array_equal(same_ball.velocity(loaded, point), ball.velocity(result, point))
    np.testing.assert_allclose(same_contact.energy(loaded), contact.energy(result), atol=1e-12)
    assert same_contact.impacts(loaded) == contact.impacts(result)
    with pytest.raises(
        InputError, match="forces of rows, pressures, contact areas and the edge of a patch are not in files"
    ):
        same_contact.row_forces(loaded)
    with pytest.raises(InputError, match="expected one of the model that body 'ball' belongs to"):
        ball.momentum(loaded)


def test_results_of_other_models_are_refused(mbs, bodies, tmp_path):
    striking(mbs, bodies)
    result = ep.solve_dynamic(mbs, end_time=1e-6)
    path = tmp_path / "run.npz"
    result.save(path)
    floating, *_ = striking(exu.SystemContainer().AddSystem(), bodies, frame="floating")
    with pytest.raises(
        InputError, match=r"mbs: expected the model that was run.* 'ball', inertial.*has body 'ball', flo"
    ):
        ep.Result.load(path, floating)
    with pytest.raises(InputError, match="this one has nothing"):
        ep.Result.load(path, exu.SystemContainer().AddSystem())
    bodies[0].save(tmp_path / "ball.npz")
    with pytest.raises(InputError, match="expected a saved result"):
        ep.Result.load(tmp_path / "ball.npz", mbs)
