"""Energy that damping takes, in implicit steps that are longer than the vibration of static shapes."""

import exudyn.itemInterface as items
import numpy as np
import pytest
from oracles import jointed

import exudyn_partition as ep


@pytest.mark.parametrize(
    "damping", [0.05, ep.Rayleigh(0.0, 1e-6), ep.Rayleigh(5e3, 0.0)], ids=["ratio", "stiffness", "mass"]
)
def test_balance_of_a_body_that_a_static_load_lets_go(arm_body, frame, damping):
    """Static shapes swing far above f_cut: powers at the ends of steps counted too much, in soft bodies by half."""
    mbs, item, _ = jointed(arm_body, frame, damping=damping)
    tip = item.CreatePointMarker(mbs, (0.005, 0.004, 0.06))
    load = mbs.AddLoad(items.LoadForceVector(markerNumber=tip, loadVector=[10.0, 0, 0]))
    mbs.Assemble()
    ep.solve_static(mbs, update_initial=True)
    mbs.SetLoadParameter(load, "loadVector", [0.0, 0, 0])
    step = 1 / (10 * arm_body.f_cut)
    result = ep.solve_dynamic(mbs, end_time=200 * step, step=step, method="implicit", spectral_radius=1.0)
    energy, lost = item.energy(result), item.dissipated_energy(result)
    assert lost[-1] > 0.1 * energy[0]
    np.testing.assert_allclose(energy + lost, energy[0], rtol=1e-6)
