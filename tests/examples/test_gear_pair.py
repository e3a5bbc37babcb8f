"""The gears of the example: their profile by the theory of involutes."""

import numpy as np
import pytest

from models import gear_pair_parts as shapes

GEARS = shapes.Gear(20, 20e-3), shapes.Gear(31, 30e-3)


def unrelieved(gear):
    """Points of the flank below its relief; the polar angle of an involute grows by tan(a) - a, cos(a) = base / r."""
    points = gear.flank(400)
    return points[: np.argmax(abs(points) > gear.pitch)]


@pytest.mark.parametrize("gear", GEARS)
def test_flanks_are_involutes_of_the_base_circle(gear):
    points = unrelieved(gear)
    pressure = np.arccos(gear.base / abs(points))
    start = np.angle(points) + np.tan(pressure) - pressure
    assert np.ptp(start) < 1e-13
    # half of the gap at the pitch circle, with its share of the backlash
    half = (np.pi * shapes.MODULE / 4 + shapes.BACKLASH / 4) / gear.pitch
    assert start[0] - np.tan(shapes.ANGLE) + shapes.ANGLE == pytest.approx(-half, abs=1e-13)


@pytest.mark.parametrize("gear", GEARS)
def test_fillets_go_from_the_root_circle_into_the_flank(gear):
    fillet, flank = gear.fillet(2000), gear.flank(2000)
    assert abs(fillet[0]) == pytest.approx(gear.pitch - shapes.DEDENDUM, rel=1e-12)
    assert abs(fillet[-1] - flank[0]) < 1e-15
    ends = np.array([fillet[-1] - fillet[-2], flank[1] - flank[0]])
    assert abs(np.diff(np.angle(ends))) < 1e-2
    # the root circle at its lower end
    assert abs(np.angle((fillet[1] - fillet[0]) / fillet[0]) + np.pi / 2) < 1e-2
    assert abs(flank[-1]) == pytest.approx(gear.tip, rel=1e-6)


def test_rigid_gears_touch_at_every_turn_after_the_play():
    """So their transmission error is zero; the upper flank of tooth 0 drives that of the wheel's tooth -1."""
    pinion, wheel = GEARS
    for turn in np.linspace(-0.3, 0.2, 6) * 2 * np.pi / pinion.teeth:
        (angle, _), (other, place) = shapes.poses(GEARS, turn, shapes.play())
        driving = pinion.flank(4000) * np.exp(1j * (angle + 2 * np.pi / pinion.teeth))
        driven = wheel.flank(4000) * np.exp(1j * other) + place[0]
        near = abs(driving[:, None] - driven[None, ::20]).min(axis=0)
        k = 20 * near.argmin()
        fine = driven[max(k - 40, 0) : k + 40]
        # signed: positive if the wheel's flank lies outside of the pinion's tooth, whose flank runs outward
        along = np.gradient(driving)
        closest = abs(driving[:, None] - fine).argmin(axis=0)
        gap = ((fine - driving[closest]) * np.conj(1j * along[closest] / abs(along[closest]))).real
        assert abs(gap.min()) < 1e-9
