"""Limits of bodies that the review of a run tells: vibration that lasts without damping."""

import contextlib

import exudyn as exu
import numpy as np
import pytest
from oracles import box

import exudyn_partition as ep
from exudyn_partition.errors import ModelLimitWarning


@pytest.fixture(scope="module")
def bar():
    fem = ep.fe_model(box(0.01, 0.01, 0.1), ep.STEEL, maxh=0.01)
    return ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0.1), 4e-3), basis="residual", f_cut=30e3)


@pytest.mark.filterwarnings("ignore:the bodies have gained")  # in steps that resolve little damping coarsely
@pytest.mark.parametrize("frame", ["inertial", "floating"])
@pytest.mark.parametrize(
    ("end", "speed", "damping", "told"),
    [(0.08, 0.0, None, True), (0.01, 0.0, None, False), (0.08, 5.0, None, False), (0.08, 0.0, 1e-4, False)],
)
def test_vibration_that_lasts_without_damping_is_told(bar, frame, end, speed, damping, told):
    """Not if it is short, little beside the motion, or damped."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, bar, name="bar", frame=frame, initialVelocity=[speed, 0, 0], damping=damping)
    start = np.array(mbs.GetNodeParameter(item["nModal"], "initialCoordinates_t"))
    own = start[6:] if frame == "inertial" else start
    own[0] = 0.3 * np.sqrt(bar.total_mass)  # the first bending
    mbs.SetNodeParameter(item["nModal"], "initialCoordinates_t", start)
    mbs.Assemble()
    said = pytest.warns(ModelLimitWarning, match="'bar' vibrates without damping: .* damping= ")
    with said if told else contextlib.nullcontext():
        ep.solve_dynamic(mbs, end_time=end, step=2e-5, method="implicit", spectral_radius=1.0)
