"""Rows that forces push shut, and that nobody follows, are told where it is a guess which rows these are."""

import warnings

import exudyn as exu
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.contact import followed
from exudyn_partition.contact.patch_gaps import PatchGaps

TOLD = "forces push rows shut that are not followed"


def landed(thin_plate):
    """Force and texts of warnings of a plate that lands on another one with an edge, fast and tilted."""
    mbs, axes = exu.SystemContainer().AddSystem(), Rotation.from_rotvec([0.03, 0, 0]).as_matrix()
    clearance = 1e-3 - (thin_plate.points @ axes.T)[:, 2].min() + 1e-7
    place = {"referencePosition": [1.3e-3, 0.7e-3, clearance], "referenceRotationMatrix": axes}
    upper = ep.CreatePartitionBody(mbs, thin_plate, frame="floating", initialVelocity=[0, 0, -60.0], **place)
    lower = ep.CreatePartitionBody(mbs, thin_plate, frame="floating")
    contact = ep.CreatePartitionContact(mbs, upper, lower, slavePatch="low", masterPatch="high")
    mbs.Assemble()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of stress and of the steps
        result = ep.solve_dynamic(mbs, end_time=8e-6, step=0.4e-6)
    return contact.force(result), result.warnings


def test_rows_that_no_guess_has_followed_are_told(thin_plate, monkeypatch):
    """Plates of 1 mm bend, so that forces push rows shut far from the deepest one: without these, force is missing."""
    monkeypatch.setattr(PatchGaps, "guesses", lambda self, *, shared: True)
    force, told = landed(thin_plate)
    assert not any(TOLD in text for text in told)
    monkeypatch.setattr(PatchGaps, "follow_pushed", lambda self, *args, **options: False)
    monkeypatch.setattr(followed, "BULGE", 0.0)
    other, told = landed(thin_plate)
    assert abs(other - force).max() > 0.1 * force.max()
    assert any(TOLD in text for text in told)
