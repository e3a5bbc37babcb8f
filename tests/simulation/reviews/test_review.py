"""Limits that the review of a run tells: vibration that lasts without damping, contact that leaves its patch."""

import contextlib

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
from oracles import box

import exudyn_partition as ep
from exudyn_partition.errors import ContactPatchWarning, ModelLimitWarning


@pytest.fixture(scope="module")
def bar():
    fem = ep.fe_model(box(0.01, 0.01, 0.1), ep.STEEL, maxh=0.01)
    return ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0.1), 4e-3), basis="residual", f_cut=30e3)


@pytest.mark.filterwarnings("ignore:the bodies have gained")  # in steps that resolve little damping coarsely
@pytest.mark.parametrize("frame", ["inertial", "floating"])
@pytest.mark.parametrize(
    ("end", "speed", "damping", "told"),
    [(0.08, 0.0, None, True), (0.01, 0.0, None, False), (0.08, 5.0, None, False), (0.08, 0.0, 1e-4, False)],
)
def test_vibration_that_lasts_without_damping_is_told(bar, frame, end, speed, damping, told):
    """Not if it is short, little beside the motion, or damped."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, bar, name="bar", frame=frame, initialVelocity=[speed, 0, 0], damping=damping)
    start = np.array(mbs.GetNodeParameter(item["nModal"], "initialCoordinates_t"))
    own = start[6:] if frame == "inertial" else start
    own[0] = 0.3 * np.sqrt(bar.total_mass)  # the first bending
    mbs.SetNodeParameter(item["nModal"], "initialCoordinates_t", start)
    mbs.Assemble()
    said = pytest.warns(ModelLimitWarning, match="'bar' vibrates without damping: .* damping= ")
    with said if told else contextlib.nullcontext():
        ep.solve_dynamic(mbs, end_time=end, step=2e-5, method="implicit", spectral_radius=1.0)


RADIUS = 5e-3


@pytest.fixture(scope="module")
def small_patches():
    """Balls with a patch at their south and north pole; its radius is hardly more than a facet."""
    found = []
    for pole, radius in (((0, 0, -RADIUS), 0.3e-3), ((0, 0, RADIUS), 0.25e-3)):
        shape, refine = occ.Sphere(occ.Pnt(0, 0, 0), RADIUS), [ep.Refine(pole, radius, 0.2e-3)]
        fem = ep.fe_model(shape, ep.STEEL, maxh=2.5e-3, refine=refine, grading=0.5)
        found.append(ep.reduce(fem, ep.Partition.ball(fem, pole, radius), f_cut=200e3))
    return found


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.YieldWarning")
@pytest.mark.filterwarnings("ignore:.*rows? (is|are) closed at the peak")
@pytest.mark.parametrize("frame", ["inertial", "floating"])
@pytest.mark.parametrize("formulation", ["compliance", "penalty"])
@pytest.mark.parametrize(("speed", "share"), [(0.1, (0.0, 0.4)), (4.0, (1.0, 2.0))])
def test_contact_leaves_a_small_patch_only_where_it_is_as_wide(small_patches, frame, formulation, speed, share):
    """By the width of the contact after Hertz, as a share of the patch's; one facet of the patch is that of the rim."""
    mbs = exu.SystemContainer().AddSystem()
    place = {"referencePosition": [0, 0, 2 * RADIUS + 1e-6], "initialVelocity": [0, 0, -speed]}
    upper = ep.CreatePartitionBody(mbs, small_patches[0], frame=frame, **place)
    lower = ep.CreatePartitionBody(mbs, small_patches[1], frame=frame)
    contact = ep.CreatePartitionContact(mbs, upper, lower, formulation=formulation)
    mbs.Assemble()
    reached = share[0] >= 1.0
    with pytest.warns(ContactPatchWarning, match="reached the edge") if reached else contextlib.nullcontext():
        result = ep.solve_dynamic(mbs, end_time=1e-6 / speed + 40e-6 * (0.1 / speed) ** 0.2)
    half_modulus = ep.STEEL.E / (1 - ep.STEEL.nu**2) / 2
    width = (0.75 * contact.force(result).max() * RADIUS / 2 / half_modulus) ** (1 / 3)
    assert share[0] < width / 0.25e-3 < share[1]
