"""Radial return against closed answers: uniaxial strain paths, hardening curves, and the back stress."""

import numpy as np
import pytest

import exudyn_partition as ep
from exudyn_partition.errors import InputError
from exudyn_partition.plasticity.flow import Flow, PlasticState, validate_state, von_mises

E, NU, Y = 200e9, 0.3, 250e6
SHEAR = E / (2 * (1 + NU))
ALONG = np.array([[2 / 3, -1 / 3, -1 / 3, 0, 0, 0]])  # deviator of uniaxial strain
MIXED = np.array([[0.3, 0.1, -0.4, 0.5, -0.2, 0.7]])


def material(hardening, back=0.0):
    return ep.Material(E=E, nu=NU, rho=7800.0, yield_stress=Y, hardening=hardening, kinematic_hardening=back)


def follow(flow, strains):
    """States and stresses along a path of strains, (n, 6)."""
    state, stresses = PlasticState.virgin(1), []
    for strain in strains:
        state = flow.answer(strain[None], state)
        stresses.append(flow.stress(strain[None], state)[0])
    return state, np.array(stresses)


@pytest.mark.parametrize("direction", [ALONG, MIXED])
@pytest.mark.parametrize("slope", [0.0, 1e6, 2e9])
def test_monotone_strain_hardens_by_the_slope(direction, slope):
    """Beyond yield, 3 G (e - e_p) = Y + H e_p in equivalent strains, however the path is cut into steps."""
    size = von_mises(direction)[0] * 2 / 3  # equivalent strain of one unit
    wanted = 0.01
    expected = (3 * SHEAR * wanted - Y) / (3 * SHEAR + slope)
    for steps in (1, 7, 50):
        path = np.linspace(0, wanted / size, steps + 1)[1:, None] * direction
        state, stresses = follow(Flow(material(slope)), path)
        assert state.equivalent[0] == pytest.approx(expected, rel=1e-9)
        assert von_mises(stresses[-1:])[0] == pytest.approx(Y + slope * expected, rel=1e-9)
        assert abs(state.strain[0, :3].sum()) < 1e-15  # volume stays


def test_below_yield_nothing_flows():
    flow = Flow(material(0.0))
    state = PlasticState.virgin(1)
    strain = 0.999 * Y / (3 * SHEAR) * MIXED / (von_mises(MIXED)[0] * 2 / 3)
    assert flow.answer(strain, state) is state
    assert von_mises(flow.stress(strain, state))[0] == pytest.approx(0.999 * Y)


def test_a_curve_of_hardening_is_followed_beyond_its_end():
    curve = ((0.0, Y), (0.01, Y + 50e6), (0.05, Y + 90e6))
    flow = Flow(material(curve))
    strain = np.array([0.0, 0.005, 0.02, 0.09])
    assert flow.flow_stress(strain) == pytest.approx([Y, Y + 25e6, Y + 60e6, Y + 130e6])
    size = von_mises(ALONG)[0] * 2 / 3
    for wanted in (0.004, 0.03, 0.2):
        state, stresses = follow(flow, np.array([wanted / size * ALONG[0]]))
        a = state.equivalent
        assert von_mises(stresses)[0] == pytest.approx(flow.flow_stress(a)[0], rel=1e-9)
        assert 3 * SHEAR * (wanted - a[0]) == pytest.approx(flow.flow_stress(a)[0], rel=1e-9)


def test_linear_slope_and_two_points_of_a_curve_are_the_same():
    path = np.linspace(0, 0.02, 9)[1:, None] * MIXED
    by_slope, _ = follow(Flow(material(3e9)), path)
    by_curve, _ = follow(Flow(material(((0.0, Y), (0.5, Y + 1.5e9)))), path)
    np.testing.assert_allclose(by_slope.strain, by_curve.strain, rtol=1e-10)


def test_kinematic_hardening_yields_earlier_on_the_way_back():
    """Bauschinger: the elastic range stays 2 Y wide, where isotropic hardening widens it."""
    slope, size = 20e9, von_mises(ALONG)[0] * 2 / 3
    reach = 0.01 / size * ALONG[0]
    for back, range_ in ((True, 2 * Y), (False, None)):
        flow = Flow(material(0.0, slope) if back else material(slope))
        state, stresses = follow(flow, np.linspace(0, 1, 40)[1:, None] * reach)
        peak = von_mises(stresses[-1:])[0]
        assert peak == pytest.approx(Y + slope * state.equivalent[0], rel=1e-9)
        elastic_range = range_ or 2 * peak
        for share, flows in ((0.99, False), (1.01, True)):
            turned = reach * (1 - share * elastic_range / (3 * SHEAR) / 0.01)
            assert (flow.answer(turned[None], state) is not state) == flows


def test_wrong_states_and_materials_are_refused():
    with pytest.raises(InputError, match="elastic; give yield_stress= and hardening="):
        Flow(ep.STEEL)
    with pytest.raises(InputError, match="expected the PlasticState of a zone with 3 points, got 2 points"):
        validate_state("state", PlasticState.virgin(2), 3)
    with pytest.raises(InputError, match="got list"):
        validate_state("state", [1.0], 3)


@pytest.mark.parametrize(
    ("hardening", "back", "message"),
    [
        (-1e6, 0.0, "slopes from 0"),
        (300e9, 0.0, "Are they in MPa"),
        (float("nan"), 0.0, "hardening"),
        (0.0, -1.0, "slopes from 0"),
        ([(0.0, Y)], 0.0, "at least two pairs"),
        ([(0.0, 2 * Y), (0.1, 3 * Y)], 0.0, r"the first \(0, yield_stress\)"),
        ([(0.0, Y), (0.1, 0.5 * Y)], 0.0, "softens"),
        ([(0.0, Y), (0.1, Y), (0.1, 2 * Y)], 0.0, "strains that grow"),
        (None, 1e9, "needs hardening= too"),
    ],
)
def test_wrong_hardening_is_refused(hardening, back, message):
    with pytest.raises(InputError, match=message):
        material(hardening, back)


def test_hardening_needs_a_yield_stress():
    with pytest.raises(InputError, match="begins at the yield stress"):
        ep.Material(E=E, nu=NU, rho=7800.0, hardening=0.0)
