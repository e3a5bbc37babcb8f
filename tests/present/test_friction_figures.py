"""Friction in figures, pages and files."""

import exudyn as exu
import matplotlib.pyplot as plt
import meshio
import numpy as np
import pytest
from matplotlib.quiver import QuiverKey

import exudyn_partition as ep


@pytest.fixture(scope="module")
def run(round_body):
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(
        mbs, round_body, name="ball", referencePosition=[0, 0, 1e-6], initialVelocity=[0.2, 0, -0.3]
    )
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), friction=ep.Coulomb(0.25, 0.2), name="tip")
    mbs.Assemble()
    return item, contact, ep.solve_dynamic(mbs, end_time=30e-6)


def test_stick_and_slip_are_drawn_with_their_numbers(run):
    _, contact, result = run
    peak = int(contact.force(result).argmax())
    axes = ep.plot.stick(None, result)
    stuck, closed = contact.friction.stuck_rows(result)[peak], contact.closed_rows(result)[peak]
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == [f"sticks ({stuck} rows)", f"slips ({closed - stuck} rows)"]
    plt.close(axes.figure)


def test_a_narrow_picture_of_a_patch_keeps_its_legend_and_scale_in_its_frame_and_names_its_axes(run):
    figure, axes = plt.subplots(figsize=(2.6, 3.2), layout="constrained")
    ep.plot.stick(axes, run[2])
    figure.canvas.draw()
    frame = axes.get_window_extent()
    (key,) = (artist for artist in axes.artists if isinstance(artist, QuiverKey))
    for box in (axes.get_legend().get_window_extent(), key.vector.get_tightbbox()):
        assert frame.x0 <= box.x0
        assert box.x1 <= frame.x1
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("-x of ball [mm]", "y of ball [mm]")  # from below
    plt.close(figure)


def test_energy_counts_what_friction_takes(run):
    _, contact, result = run
    axes = ep.plot.energy(None, result)
    curves = {line.get_label(): line.get_ydata() for line in axes.lines}
    plt.close(axes.figure)
    np.testing.assert_allclose(curves["sum"], curves["sum"][0], rtol=1e-4)
    assert curves["taken by friction"][-1] > 0
    assert contact.dissipated_energy(result)[-1] > 0


def test_page_tells_coefficients_and_balance(run, tmp_path):
    _, _, result = run
    page = result.report(tmp_path / "run.html").read_text()
    assert "0.25 in stick, 0.2 in slip" in page
    assert "what friction took" in page
    assert "frictionless" not in page


def test_paraview_has_traction_and_state(run, tmp_path):
    _, contact, result = run
    peak = float(result.t[contact.force(result).argmax()])
    ep.output.write_paraview(tmp_path, result, fields=("contact_traction", "contact_state"), times=[peak])
    (file,) = tmp_path.glob("*.vtu")
    data = meshio.read(file).point_data
    assert {*np.unique(data["contact_state"])} <= {0.0, 1.0, 2.0}
    assert data["contact_state"].max() > 0
    assert data["contact_traction"][:, 0].min() < 0
