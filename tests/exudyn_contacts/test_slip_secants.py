"""Share of secants in the Jacobian of a static run: whole after a residual that has grown, and none at the end."""

from types import SimpleNamespace

import pytest

from exudyn_partition.exudyn_contacts.slip_secants import SlipSecants


def in_step(secants, residuals, length=1.0):
    """Shares in the iterations of a load step of this length with these residuals."""
    its = [SimpleNamespace(newtonSteps=step, currentStepSize=length) for step in range(1, len(residuals) + 1)]
    return [
        secants.share(SimpleNamespace(it=it, conv=SimpleNamespace(residual=residual)))
        for it, residual in zip(its, residuals, strict=True)
    ]


def shares(*residuals, **options):
    """Shares in the iterations of the first load step with these residuals."""
    return in_step(SlipSecants(**options), residuals)


def test_secants_that_do_not_last_go_when_a_step_is_divided_and_come_again_at_the_next_division():
    secants = SlipSecants(lasting=False)
    found = [in_step(secants, (1.0, 1.0), length)[1] for length in (1.0, 0.5, 0.5, 1.0, 0.5, 0.25)]
    assert found == [1.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    lasting = SlipSecants()
    assert [in_step(lasting, (1.0, 1.0), length)[1] for length in (1.0, 0.5)] == [1.0, 1.0]


def test_shares_fall_with_the_residual_and_rise_with_it():
    assert shares(10.0, 40.0, 10.0, 2.5, 5.0) == [0.0, 1.0, 0.5, 0.25, 1.0]


def test_secants_that_do_not_last_have_the_share_of_the_largest_residual():
    assert shares(10.0, 40.0, 10.0, 2.5, 5.0, lasting=False) == [0.0, 1.0, 0.25, 0.0625, 0.125]
    assert shares(0.0, 0.0, 0.0, lasting=False) == [0.0, 1.0, 1.0]


def test_newtons_method_is_quick_at_the_end():
    assert shares(1.0, 1.0, 1e-4, 1e-8)[-1] == pytest.approx(1e-4)


def test_a_residual_of_zero_is_no_error():
    assert shares(0.0, 0.0, 0.0) == [0.0, 1.0, 1.0]
