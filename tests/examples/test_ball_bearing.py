"""The example of a ball bearing as a user runs it, with `--quick`, and its theory."""

import importlib

import matplotlib.pyplot as plt
import numpy as np
import pytest

import exudyn_partition as ep


def test_ball_bearing(tmp_path):
    result = importlib.import_module("ball_bearing").main(["--quick", "--out", str(tmp_path)])
    plt.close("all")
    assert (tmp_path / "ball_bearing.png").exists()
    assert result["error"]["force_at_rest"] < 0.02
    assert result["error"]["force"] < 0.02
    assert abs(result["error"]["deflection"]) < 0.04  # one to two elements in the radius of contact
    assert 4.3 < result["stribeck"] < 4.6


def test_springs_of_the_bearing():
    """A ball on equal curvatures is Hertz's sphere; without clearance the largest force is Stribeck's."""
    theory = importlib.import_module("models.ball_bearing_theory")
    model = importlib.import_module("models.ball_bearing")
    angles = 2 * np.pi * np.arange(model.BALLS) / model.BALLS - np.pi / 2
    place, forces = theory.equilibrium(1000.0, 0.0, angles)
    assert forces.max() * model.BALLS / 1000.0 == pytest.approx(4.37, rel=3e-3)
    assert forces @ np.sin(angles) + model.SOFT * place[1] == pytest.approx(-1000.0, rel=1e-9)
    sphere = (3 / (4 * ep.STEEL.plane_strain_modulus * np.sqrt(model.RADIUS))) ** (2 / 3)
    inner, outer = (theory.approach(1.0, side) for side in (-1, 1))
    assert outer < sphere < inner  # a bore fits the ball better, a shaft worse
    assert np.sqrt(inner * outer) == pytest.approx(sphere, rel=0.02)
