"""The law between impacts: exact on the grid and for linear tables, its error, and the program to paste."""

import numpy as np
import pytest

import exudyn_partition as ep
from exudyn_partition.errors import InputError

SPEED, ANGLE = np.array([0.1, 0.2, 0.4, 0.8]), np.array([0.0, 0.3, 0.5])


def law_of(function):
    table = function(SPEED[:, None], ANGLE[None, :])
    tables = {"restitution": table, "impulse_ratio": 0.1 * table}
    return ep.RestitutionLaw({"speed": SPEED, "angle": ANGLE}, {"place": 0.0, "friction": 0.1}, tables)


@pytest.fixture
def bent():
    return law_of(lambda v, a: 0.9 - 0.21234 * v**2 + 0.3 * a**2)


def test_a_bilinear_table_is_interpolated_exactly():
    law = law_of(lambda v, a: 0.5 + 0.2 * v - 0.3 * a + 0.7 * v * a)
    for v, a in ((0.1, 0.0), (0.8, 0.5), (0.15, 0.31), (0.77, 0.02)):
        assert law(speed=v, angle=a)["restitution"] == pytest.approx(0.5 + 0.2 * v - 0.3 * a + 0.7 * v * a, abs=1e-12)
    assert law.error == {"restitution": pytest.approx(0, abs=1e-12), "impulse_ratio": pytest.approx(0, abs=1e-12)}


@pytest.mark.parametrize("factors", [(0.2, 0.3), (0.4, 0.3)])
def test_the_error_is_that_of_values_between_their_neighbours(factors):
    """Of v^2 between a and b, at c: (c - a) (b - c) of its factor; along whichever axis it is largest."""
    law = law_of(lambda v, a: 0.9 - factors[0] * v**2 + factors[1] * a**2)
    assert law.error["restitution"] == pytest.approx(max(factors[0] * 0.2 * 0.4, factors[1] * 0.3 * 0.2), rel=1e-9)


def test_the_program_to_paste_is_the_law(bent):
    names = {}
    exec(compile(bent.source(), "law.py", "exec"), names)
    for v, a in ((0.1, 0.0), (0.8, 0.5), (0.33, 0.41)):
        expected = bent(speed=v, angle=a)
        assert names["rebound"](v, a) == pytest.approx(tuple(expected.values()), abs=1e-5)
    with pytest.raises(ValueError, match=r"speed: the table holds from 0\.1 to 0\.8, got 0\.9"):
        names["rebound"](0.9, 0.1)
    assert "Valid for speed from 0.1 to 0.8." in names["__doc__"]


def test_points_beyond_the_grid_or_of_other_axes_are_refused(bent):
    with pytest.raises(InputError, match=r"speed: the law holds from 0\.1 to 0\.8, got 0\.05"):
        bent(speed=0.05, angle=0.1)
    with pytest.raises(InputError, match="point: expected speed, angle, got speed"):
        bent(speed=0.2)
    with pytest.raises(InputError, match="angle"):
        bent(speed=0.2, angle="steep")
    with pytest.raises(InputError, match="axes: expected one that varies"):
        ep.RestitutionLaw({}, {"speed": 1.0}, {"restitution": np.array(0.5)}).source()
