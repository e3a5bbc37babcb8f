"""Energy that damping takes, in implicit steps that are longer than static shapes vibrate, and in explicit steps."""

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


@pytest.mark.parametrize("damping", [0.05, ep.Rayleigh(5e3, 1e-7)], ids=["ratio", "proportional"])
def test_balance_of_explicit_steps_near_the_stability_limit(mbs, arm_body, frame, damping):
    """Energy in the middle of steps, v v / 2 + x K y / 2, with what damping takes is constant; 4 % were missing."""
    item = ep.CreatePartitionBody(mbs, arm_body, frame=frame, damping=damping)
    speeds = 1e-3 * np.r_[np.zeros(6), np.sin(np.arange(arm_body.n_dofs - 6))]
    modal = speeds if frame == "inertial" else speeds[6:]
    mbs.SetNodeParameter(item["nModal"], "initialCoordinates_t", modal)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=100e-6, step=0.9 * ep.stability_limit(mbs))
    q, lost = item.coordinates(result), item.dissipated_energy(result)
    K = item.kinematics.proportional_matrix(0.0, 1.0)
    middle = 0.5 * (np.diff(q, axis=0) / result.step) ** 2 @ item.kinematics.mass
    middle += 0.5 * np.sum(q[1:] * (K @ q[:-1].T).T, axis=1)
    at_samples = (middle[1:] + middle[:-1]) / 2
    assert lost[-1] > 0.1 * middle[0]
    np.testing.assert_allclose(at_samples + lost[1:-1], at_samples[0] + lost[1], rtol=1e-9)
