"""What rings in lasting contact."""

import numpy as np
import pytest

from exudyn_partition.simulation.reviews.lasting import ringing_frequency


@pytest.mark.parametrize("grows", [0.0, 1e3, -1e3])
def test_a_force_that_grows_steadily_rings_with_its_own_frequency(grows):
    """A load that grows by a thousand times the amplitude is no ringing, though most of the spectrum is its."""
    t = np.r_[np.linspace(0, 0.4e-3, 300), np.linspace(0.4e-3, 1e-3, 900)[1:]]  # steps that are not equal
    force = 2e3 + grows * t / t[-1] + np.sin(2 * np.pi * 21e3 * t)
    assert ringing_frequency(t, force, 1e-6) == pytest.approx(21e3, rel=0.01)
