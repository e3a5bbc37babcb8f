"""Figures: they show the numbers of the run, with units on every axis."""

import re
from itertools import pairwise

import matplotlib.pyplot as plt
import numpy as np
import pytest

import exudyn_partition as ep
from exudyn_partition.errors import InputError

UNIT = re.compile(r"\[[^\]]+\]$")


@pytest.fixture
def run(impact):
    mbs, *items = impact
    return ep.solve_dynamic(mbs, end_time=60e-6, step=0.2e-6), *items


@pytest.fixture
def comparisons():
    return {
        "coarse": ep.Comparison({"force": 0.05, "P1": 0.04}, 0.1, 100.0, 1e-3),
        "wasteful": ep.Comparison({"force": 0.06, "P1": 0.01}, 0.5, 100.0, 1e-3),
        "fine": ep.Comparison({"force": 0.01, "P1": 0.02}, 2.0, 100.0, 1e-3),
    }


def line(axes, label):
    return next(line for line in axes.lines if line.get_label() == label).get_xydata()


def test_every_axis_has_its_unit(run, comparisons, bodies):
    result, striker, *_ = run
    axes = [
        ep.plot.force(None, result),
        ep.plot.velocity(None, (0, 0, 0.02), result, body=striker),
        ep.plot.spectrum(None, result),
        ep.plot.spectrum(None, result, (0, 0, 0.02), body=striker),
        ep.plot.energy(None, result),
        ep.plot.pressure(None, result, 20e-6),
        ep.plot.pareto(None, comparisons),
    ]
    for one in axes:
        assert UNIT.search(one.get_xlabel()), one.get_xlabel()
        assert UNIT.search(one.get_ylabel()), one.get_ylabel()
        one.figure.canvas.draw()
    modes = ep.plot.modes(None, bodies[0])
    assert (modes.get_xlabel(), modes.get_ylabel()) == ("number of the shape", "frequency [kHz]")


def test_the_label_of_a_force_tells_name_and_kind_apart(run):
    result, *_, contact = run
    assert contact.name
    assert ep.plot.force(None, result).get_ylabel() == f"contact force of '{contact.name}' [N]"


def test_a_result_is_drawn_like_its_history(run):
    result, striker, _, contact = run
    history = result.history(contact, {"north pole": (striker, (0, 0, 0.02))})
    for drawn in (ep.plot.force(None, result), ep.plot.force(None, history), ep.plot.overview(result).axes[0]):
        np.testing.assert_array_equal(drawn.lines[0].get_xydata(), np.c_[1e3 * result.t, contact.force(result)])
    of_result = ep.plot.velocity(None, (0, 0, 0.02), result, body=striker).lines[0]
    of_history = ep.plot.velocity(None, "north pole", history).lines[0]
    np.testing.assert_array_equal(of_result.get_xydata(), of_history.get_xydata())
    assert of_history.get_xydata()[0] == pytest.approx([0, -1.0])


def test_the_spectrum_begins_with_the_impulse_and_shows_f_cut(run):
    result, *_, contact = run
    axes = ep.plot.spectrum(None, result)
    spectrum = line(axes, result.history(contact).info["label"])
    assert spectrum[0, 1] == pytest.approx(np.trapezoid(contact.force(result), result.t), rel=1e-6)
    assert line(axes, "f_cut")[0, 0] == 150.0
    assert axes.get_xlim()[1] == pytest.approx(300, rel=0.01)


def test_spectrum_of_a_half_sine():
    """Its Fourier integral is 2 a T / pi |cos(pi f T)| / |1 - (2 f T)^2|."""
    T, a = 50e-6, 700.0
    t = np.linspace(0, T, 2001)
    f, got = ep.amplitude_spectrum(t, a * np.sin(np.pi * t / T))
    low = (f < 10 / T) & (abs(2 * f * T - 1) > 1e-3)
    expected = abs(2 * a * T / np.pi * np.cos(np.pi * f * T) / (1 - (2 * f * T) ** 2))
    np.testing.assert_allclose(got[low], expected[low], atol=1e-5 * expected.max())
    uneven = T * np.sort(np.random.default_rng(1).random(500))
    with pytest.raises(InputError, match="equally spaced"):
        ep.amplitude_spectrum(uneven, uneven)
    pulse = ep.History(uneven, a * np.sin(np.pi * uneven / T), {})
    drawn = ep.plot.spectrum(None, pulse).lines[0].get_xydata()
    assert drawn[0, 1] == pytest.approx(2 * a * T / np.pi, rel=1e-3)  # samples of an adaptive run


def test_energy_is_the_run_s_and_adds_up(run):
    result, striker, target, contact = run
    axes = ep.plot.energy(None, result)
    assert axes.get_ylabel() == "energy [mJ]"
    curves = [line(axes, label)[:, 1] for label in ("body 0", "body 1", "tip", "sum")]
    np.testing.assert_allclose(curves[0], 1e3 * striker.energy(result))
    np.testing.assert_allclose(curves[2], 1e3 * contact.energy(result))
    np.testing.assert_allclose(curves[3], sum(curves[:3]))
    assert curves[3] == pytest.approx(500 * striker.body.total_mass, rel=0.01)
    assert target.energy(result).max() > 0


def test_modes_are_those_of_the_basis(bodies):
    axes = ep.plot.modes(None, bodies[0])
    rigid = line(axes, "rigid: 6")
    np.testing.assert_array_equal(rigid[:, 1], 0)
    elastic = line(axes, f"elastic: {bodies[0].n_dofs - 6}")
    np.testing.assert_allclose(elastic[:, 1], bodies[0].basis.omega[6:] / 2e3 / np.pi)
    assert line(axes, "f_cut")[0, 1] == 150.0


def test_the_pareto_front_leaves_out_what_is_dominated(comparisons):
    front = ep.plot.pareto(None, comparisons).lines[0].get_xydata()
    np.testing.assert_allclose(front, [[0.1, 5], [2.0, 1]])
    front = ep.plot.pareto(None, comparisons, "P1").lines[0].get_xydata()
    np.testing.assert_allclose(front, [[0.1, 4], [0.5, 1]])
    assert ep.report.front(comparisons) == ["coarse", "fine"]


def test_numbers_at_the_errors_do_not_overlap(comparisons):
    axes = ep.plot.pareto(plt.subplots(figsize=(4, 3.5), layout="constrained")[1], comparisons)
    axes.set_ylim(0.04, 2)
    axes.figure.canvas.draw()
    shown = [text for minor in (False, True) for text in axes.get_yticklabels(minor=minor) if text.get_text()]
    boxes = sorted((text.get_window_extent() for text in shown), key=lambda box: box.y0)
    boxes = [box for box in boxes if axes.bbox.y0 <= (box.y0 + box.y1) / 2 <= axes.bbox.y1]
    assert len(boxes) >= 4
    assert all(lower.y1 <= upper.y0 for lower, upper in pairwise(boxes))


def test_pressure_stands_where_the_contact_is(run):
    result, *_, contact = run
    peak = float(result.t[contact.force(result).argmax()])
    axes = ep.plot.pressure(None, result)
    assert axes.get_title() == f"t = {1e3 * peak:.4g} ms"
    values = axes.collections[0].get_array()
    assert values.max() == pytest.approx(1e-6 * contact.pressure(result.at([peak])).max())
    limits = np.array([axes.get_xlim(), axes.get_ylim()])
    assert 0.5 < abs(limits).max() < 2  # mm, the radius of the patch is 1.2


def test_forces_of_all_contacts_are_drawn_if_none_is_named(mbs, bodies):
    balls = [
        ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=[0, 0, -v], referencePosition=[v, 0, 0]) for v in (1, 2)
    ]
    contacts = [
        ep.CreatePartitionContact(mbs, ball, ep.RigidPlane(), name=name)
        for ball, name in zip(balls, ("a", ""), strict=True)
    ]
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=4e-6)
    axes = ep.plot.force(None, result)
    for contact, label in zip(contacts, ("a", "body 1 on plane 2"), strict=True):
        np.testing.assert_array_equal(line(axes, label)[:, 1], contact.force(result))
    assert len(ep.plot.force(None, result, contact=contacts[0]).lines) == 1
    with pytest.raises(
        InputError, match=r"contact: expected one of the run's 2 contacts \('a', 'body 1 on plane 2'\), as CreatePart"
    ):
        ep.plot.force(None, result, result.history(contacts[0]))
    with pytest.raises(InputError, match="contact: expected one of the run's 2 contacts"):
        ep.plot.overview(result)


def test_what_is_meant_has_to_be_said(run, comparisons):
    result, striker, *_ = run
    for call, message in (
        (lambda: ep.plot.velocity(None, (0, 0, 0), result), "body: expected one of the run's 2 bodies"),
        (lambda: ep.plot.velocity(None, "P1", result, body=striker), "a Result has no named points"),
        (lambda: ep.plot.velocity(None, "P1", result.history(result.contacts[0])), "point: expected one of , got 'P1'"),
        (lambda: ep.plot.pareto(None, {}), "runs: expected at least one comparison"),
        (lambda: ep.plot.pareto(None, comparisons, "P3"), "quantity: expected one of 'force', 'P1', got 'P3'"),
        (lambda: ep.plot.force(result, None), "axes: expected those of matplotlib, or None for a new figure, got Res"),
    ):
        with pytest.raises(InputError, match=message):
            call()
