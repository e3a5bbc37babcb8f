"""Histories: finite ascending samples, in files that are whole."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

import exudyn_partition as ep
from exudyn_partition.errors import InputError
from exudyn_partition.support import archive


@pytest.fixture
def history():
    """A force and the velocity of a point."""
    t = np.linspace(0, 1, 101)
    velocity = np.column_stack([0 * t, 0 * t, np.sin(t)])
    return ep.History(t, np.sin(t) ** 2, {"far end": velocity}, {"steps": 100, "label": "one"})


def test_histories_survive_saving(history, tmp_path):
    history.save(tmp_path / "history.npz")
    loaded = ep.History.load(tmp_path / "history.npz")
    np.testing.assert_allclose(loaded.force, history.force, rtol=1e-6)
    np.testing.assert_allclose(loaded.velocity["far end"], history.velocity["far end"], rtol=1e-6)
    assert loaded.info == history.info


def test_what_friction_does_survives_too(history, tmp_path):
    assert ep.History.load(saved(history, tmp_path)).tangential_force is None
    tangential = np.column_stack([history.force, 2 * history.force, 0 * history.t])
    slides = replace(history, tangential_force=tangential, dissipated=history.t**2)
    loaded = ep.History.load(saved(slides, tmp_path))
    np.testing.assert_allclose(loaded.tangential_force, tangential, rtol=1e-6)
    np.testing.assert_allclose(loaded.dissipated, history.t**2, rtol=1e-6)
    half = loaded.until(0.5)
    assert half.tangential_force.shape == (51, 3)
    assert half.dissipated[-1] == pytest.approx(0.25)
    with pytest.raises(InputError, match="tangential_force"):
        replace(history, tangential_force=history.force)


def saved(history, folder):
    """Path of the file that the history was written to."""
    history.save(folder / "history.npz")
    return folder / "history.npz"


def test_a_history_is_found_by_the_name_it_was_saved_under(history, tmp_path):
    """NumPy appends npz to a name without it, so that "run" was there and could not be loaded."""
    history.save(tmp_path / "run")
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
    np.testing.assert_array_equal(ep.History.load(tmp_path / "run").t, history.t)


def test_each_name_has_its_own_values(history, tmp_path):
    """The file of "a" and "a.npy" gave the values of the one for those of the other."""
    named = {name: np.full((101, 3), value) for value, name in enumerate(("a", "a.npy", "t", "force", "a/b", "ä "))}
    loaded = ep.History.load(saved(replace(history, velocity=named), tmp_path))
    assert loaded.velocity.keys() == named.keys()
    for name, values in named.items():
        np.testing.assert_array_equal(loaded.velocity[name], values)


@pytest.mark.parametrize("scale", [1e39, 1e-39, 1e-300])
def test_numbers_beyond_single_precision_survive(history, scale, tmp_path):
    """A force of 1e39 N was saved and could not be loaded; a small one was zero."""
    loaded = ep.History.load(saved(replace(history, force=scale * history.force), tmp_path))
    np.testing.assert_allclose(loaded.force, scale * history.force, rtol=1e-6)


def test_a_small_file_that_would_unpack_to_much_is_refused_before(tmp_path, monkeypatch):
    monkeypatch.setattr(archive, "ALWAYS", 1 << 20)
    path, zeros = tmp_path / "bomb", np.zeros(1 << 18)
    np.savez_compressed(path.open("wb"), format=1, t=zeros, force=zeros, info="{}")
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match="is no history, or a damaged one") as caught:
            ep.History.load(path)
        assert tracemalloc.get_traced_memory()[1] < 5e5
    finally:
        tracemalloc.stop()
    assert "would unpack to 4194" in str(caught.value.__cause__)


@pytest.mark.parametrize("content", [b"", b"text", b"\x93NUMPY\x01\x00", b"PK\x03\x04damaged"])
def test_what_is_no_history_is_not_taken_for_a_pickle(content, tmp_path):
    path = tmp_path / "odd"
    path.write_bytes(content)
    with pytest.raises(InputError, match="is no history, or a damaged one") as caught:
        ep.History.load(path)
    assert "pickle" not in str(caught.value)


def test_a_history_that_was_cut_off_is_not_loaded(history, tmp_path):
    history.save(tmp_path / "run")
    whole = (tmp_path / "run").read_bytes()
    for end in np.linspace(1, len(whole) - 1, 20).astype(int):
        (tmp_path / "run").write_bytes(whole[:end])
        with pytest.raises(InputError, match="damaged"):
            ep.History.load(tmp_path / "run")


def test_unreadable_histories(tmp_path):
    with pytest.raises(InputError, match="there is none at"):
        ep.History.load(tmp_path / "missing.npz")
    np.savez(tmp_path / "other.npz", x=1)
    with pytest.raises(InputError, match="is no history of format 1"):
        ep.History.load(tmp_path / "other.npz")


def test_histories_of_finite_ascending_samples():
    t = np.linspace(0, 1, 11)
    for bad, message in (
        ((t, np.full(11, np.nan), {}), "force: expected finite numbers, got nan"),
        ((t[::-1], t, {}), "t: expected times that ascend"),
        ((t, t, {"P": t}), r"P: expected shape \(11, 3\)"),
        ((t, t[:5], {}), r"force: expected shape \(11,\)"),
        ((t[:0], t[:0], {}), "t: expected at least one sample"),
    ):
        with pytest.raises(InputError, match=message):
            ep.History(*bad)
    mine = np.zeros(11)
    ep.History(t, mine, {})
    mine[0] = 1.0  # what was given stays its owner's
