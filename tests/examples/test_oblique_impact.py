"""The example of friction as a user runs it, with `--quick`."""

import importlib

import matplotlib.pyplot as plt
import pytest


@pytest.mark.filterwarnings("ignore:f_cut. bending waves")  # of the coarse plate, which the reference has too
def test_oblique_impact(tmp_path):
    result = importlib.import_module("oblique_impact").main(["--quick", "--end-time", "0.1e-3", "--out", str(tmp_path)])
    plt.close("all")
    assert (tmp_path / "oblique_impact.png").exists()
    assert result["error"]["normal"] < 0.01
    assert result["error"]["tangential"] < 0.02
    assert result["error"]["velocity_tip"] < 0.02
    sticks, slips, grazes = result["runs"].values()
    assert sticks["most_stuck_rows"] > 0
    for run in (slips, grazes):
        assert abs(run["impulse_ratio"] / result["friction"] - 1) < 5e-3
    assert sticks["dissipated_J"] < slips["dissipated_J"] < grazes["dissipated_J"]
    for run in result["runs"].values():
        assert run["energy_error"] < 1e-4
        assert run["momentum_error"] < 1e-9
