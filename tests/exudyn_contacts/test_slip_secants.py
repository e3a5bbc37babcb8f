"""Share of secants in the Jacobian of a static run: whole after a residual that has grown, and none at the end."""

from types import SimpleNamespace

import pytest

from exudyn_partition.exudyn_contacts.slip_secants import SlipSecants


def shares(*residuals, **options):
    """Shares in the iterations of a load step with these residuals."""
    secants = SlipSecants(**options)
    solvers = [
        SimpleNamespace(it=SimpleNamespace(newtonSteps=step), conv=SimpleNamespace(residual=residual))
        for step, residual in enumerate(residuals, 1)
    ]
    return [secants.share(solver) for solver in solvers]


def test_shares_fall_with_the_residual_and_rise_with_it():
    assert shares(10.0, 40.0, 10.0, 2.5, 5.0) == [0.0, 1.0, 0.5, 0.25, 1.0]


def test_secants_that_do_not_last_have_the_share_of_the_largest_residual():
    assert shares(10.0, 40.0, 10.0, 2.5, 5.0, lasting=False) == [0.0, 1.0, 0.25, 0.0625, 0.125]
    assert shares(0.0, 0.0, 0.0, lasting=False) == [0.0, 1.0, 1.0]


def test_newtons_method_is_quick_at_the_end():
    assert shares(1.0, 1.0, 1e-4, 1e-8)[-1] == pytest.approx(1e-4)


def test_a_residual_of_zero_is_no_error():
    assert shares(0.0, 0.0, 0.0) == [0.0, 1.0, 1.0]
