"""Options of a reduction: frequencies that the mesh resolves, bases by name, and what is left out."""

import re

import pytest
from oracles import box

import exudyn_partition as ep
from exudyn_partition.errors import FrequencyRangeError, InputError


def test_frequency_above_what_the_mesh_resolves(block, top):
    with pytest.raises(FrequencyRangeError, match=r"the mesh resolves .* Refine it to elements of .* or lower f_cut"):
        ep.reduce(block, top, f_cut=1e7)


def test_the_proposed_maxh_resolves_the_frequency(block, top):
    f_cut = 2 * block.resolved_frequency
    with pytest.raises(FrequencyRangeError, match="with a maxh of about") as caught:
        ep.reduce(block, top, f_cut=f_cut)
    maxh = float(re.search(r"maxh of about ([^,]*),", str(caught.value))[1])
    assert ep.fe_model(box(0.01, 0.02, 0.03), ep.STEEL, maxh=maxh).resolved_frequency > f_cut


def test_what_is_left_out_above_says_how_to_keep_it(block, top, ball):
    (said,) = (s for s in ep.reduce(block, top, f_cut=80e3).left_out if s.startswith("the dynamics"))
    assert "motion above 120000 Hz, 1.5 f_cut (f_cut raises that)" in said
    (said,) = (s for s in ep.reduce(*ball, tolerance=0.5).left_out if s.startswith("the dynamics"))
    assert "(a smaller tolerance keeps more)" in said


@pytest.mark.parametrize("basis", ["free", "craig-bampton"])
def test_no_mode_below_the_truncation_frequency(block, top, basis):
    with pytest.raises(FrequencyRangeError, match=r"no elastic mode lies below 100 Hz.*take .*contact-adapted"):
        ep.reduce(block, top, basis=basis, f_cut=100.0)


def test_a_frequency_that_round_off_hides(block, top):
    with pytest.raises(FrequencyRangeError, match=r"round-off hides modes among the rigid ones, got 0\.001 Hz"):
        ep.reduce(block, top, basis="residual", f_cut=1e-3)


def test_bad_arguments(block, top, sphere):
    with pytest.raises(InputError, match=r"basis: expected one of 'free', 'craig-bampton', .*, got 'cms'"):
        ep.reduce(block, top, basis="cms", f_cut=1e5)
    for f_cut in (float("nan"), 0.0, -1.0):
        with pytest.raises(InputError, match=f"f_cut: expected a finite number above zero in Hz, got {f_cut}"):
            ep.reduce(block, top, f_cut=f_cut)
    with pytest.raises(InputError, match="made for another mesh"):
        ep.reduce(block, sphere[1], f_cut=1e5)
