"""Bodies that come out of the back of a thin wall are told; those that bounce off it, slide or roll on it are not."""

import warnings

import netgen.occ as occ
import numpy as np
import pytest
from oracles import MARBLE_RADIUS, box

import exudyn_partition as ep
from exudyn_partition.errors import ContactPatchWarning, PartitionWarning
from exudyn_partition.simulation.reviews.through_walls import thickness

THICK = 0.2e-3
SOFT = ep.Material(E=1e6, nu=0.3, rho=1000.0)
METHODS = [{}, {"method": "implicit"}, {"adaptive": True}, {"method": "implicit", "adaptive": True}]
BLOCK = occ.Box((0, 0, 0), (6e-3, 3e-3, 3e-3))
TOLD = "came out of the back of a thin wall"
OTHER_WARNINGS = pytest.mark.filterwarnings("ignore::exudyn_partition.errors.PartitionWarning")


@pytest.fixture(scope="module")
def sheet():
    """A soft sheet whose patch has both of its faces; its top is the plane z = 0."""
    fem = ep.fe_model(box(4e-3, 4e-3, THICK).Move((0, 0, -THICK)), SOFT, maxh=0.7e-3)
    return ep.reduce(fem, ep.Partition.surface(fem, ((-1, -1, -1), (1, 1, 1)), axes="xyz"), f_cut=2e3)


@pytest.fixture(scope="module")
def rigid_sheet():
    return ep.RigidMesh.of(occ.Box((-0.03, -0.03, -THICK), (0.03, 0.03, 0)), maxh=0.06)


def falls(mbs, marble, below, speed, gap, *, swapped=False):
    """A marble that falls on a body or a rigid surface below; `swapped`: the rows are those of what is below."""
    ball = ep.CreatePartitionBody(
        mbs,
        marble,
        name="ball",
        frame="floating",
        referencePosition=[0, 0, MARBLE_RADIUS + gap],
        initialVelocity=[0, 0, -speed],
    )
    if isinstance(below, ep.RigidMesh | ep.RigidSphere):
        contact = ep.CreatePartitionContact(mbs, ball, below, slavePatch="south")
    else:
        sides = [ball, ep.CreatePartitionBody(mbs, below, name="sheet", frame="floating")]
        patch = {"masterPatch" if swapped else "slavePatch": "south"}
        contact = ep.CreatePartitionContact(mbs, *(sides[::-1] if swapped else sides), passes="given", **patch)
    mbs.Assemble()
    return contact


def told(run):
    """Whether a run says that a body came out of a wall, and its result."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", PartitionWarning)
        result = run()
    return any(TOLD in str(each.message) for each in said), result


@OTHER_WARNINGS
@pytest.mark.parametrize("options", METHODS, ids=str)
@pytest.mark.parametrize("kind", ["elastic", "rigid"])
def test_a_jump_through_a_sheet_is_told(mbs, marble, sheet, rigid_sheet, options, kind):
    """From 0.3 mm above it to 0.5 mm below its back: no row was ever within."""
    contact = falls(mbs, marble, sheet if kind == "elastic" else rigid_sheet, 2000.0, 0.3e-3)
    what = "body 'sheet'" if kind == "elastic" else "the rigid surface"
    with pytest.warns(ContactPatchWarning, match=rf"between t = 0 and 5e-07 s .* {TOLD} of {what} .* too long"):
        result = ep.solve_dynamic(mbs, end_time=1.5e-6, step=0.5e-6, **options)
    assert not contact.force(result).any()


@OTHER_WARNINGS
@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_a_sheet_that_a_body_passed_is_told_though_the_rows_are_the_sheet_s(mbs, marble, sheet, method):
    """They are held by the marble until it is past them."""
    contact = falls(mbs, marble, sheet, 2000.0, 0.3e-3, swapped=True)
    with pytest.warns(ContactPatchWarning, match=rf"body 'ball' {TOLD} of body 'sheet'"):
        result = ep.solve_dynamic(mbs, end_time=1.5e-6, step=0.5e-6, method=method)
    assert contact.force(result)[-1] == 0


@OTHER_WARNINGS
@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_a_body_that_sinks_through_an_elastic_sheet_is_told(mbs, marble, sheet, method):
    """In steps of a twentieth of the thickness: it is held until its rows are lost behind the back."""
    contact = falls(mbs, marble, sheet, 100.0, 1e-6)
    with pytest.warns(ContactPatchWarning, match=rf"body 'ball' {TOLD} of body 'sheet' .* face alone"):
        result = ep.solve_dynamic(mbs, end_time=9e-6, step=1e-7, method=method)
    force, depth = contact.force(result), contact.depth(result)
    assert force.max() > 0
    assert force[-1] == 0
    assert depth > THICK


@OTHER_WARNINGS
def test_a_patch_of_one_face_holds_at_any_depth_and_nothing_is_told(mbs, marble, sheet):
    """As the warning advises."""
    fem = ep.fe_model(box(4e-3, 4e-3, THICK).Move((0, 0, -THICK)), SOFT, maxh=0.7e-3)
    top = fem.points[:, 2].max()
    part = ep.Partition.surface(fem, ((-1, -1, top - 1e-6), (1, 1, top + 1e-6)), axes="xyz")
    contact = falls(mbs, marble, ep.reduce(fem, part, f_cut=2e3), 100.0, 1e-6)
    was_told, result = told(lambda: ep.solve_dynamic(mbs, end_time=6e-6, step=1e-7))
    assert not was_told
    assert contact.depth(result) > 1.5 * THICK


@pytest.mark.parametrize("below", ["sheet", "rigid sheet", "ball"])
@pytest.mark.parametrize("period", [0.5e-6, 10e-6])
def test_what_bounces_off_is_not_told(mbs, marble, sheet, rigid_sheet, below, period):
    """With rare samples too, between which it comes and goes by more than its gaps then."""
    walls = {"sheet": sheet, "rigid sheet": rigid_sheet, "ball": ep.RigidSphere((0, 0, -1e-3), 1e-3)}
    contact = falls(mbs, marble, walls[below], 5.0, 2e-6)
    was_told, result = told(lambda: ep.solve_dynamic(mbs, end_time=40e-6, step=0.5e-6, sample_period=period))
    assert not was_told
    assert contact.force(result).any()


@pytest.mark.parametrize(
    ("shape", "maxh", "expected"),
    [
        (occ.Box((0, 0, 0), (6e-3, 6e-3, 1e-3)), 2e-3, (0.999e-3, 1.001e-3)),
        (BLOCK - occ.Box((1e-3, 0, 1e-3), (6e-3, 3e-3, 1.4e-3)), 1.5e-3, (0.99e-3, 1.01e-3)),
        (occ.Sphere((0, 0, 0), 3e-3), 1.5e-3, (4.5e-3, 6e-3)),
    ],
    ids=["plate", "slit", "ball"],
)
def test_walls_are_as_thick_as_they_are(shape, maxh, expected):
    """Between faces that look away from each other: not the width of a slit, whose faces look at each other."""
    fem = ep.fe_model(shape, SOFT, maxh=maxh)
    body = ep.reduce(fem, ep.Partition.surface(fem, ((-1, -1, -1), (1, 1, 1)), axes="xyz"), f_cut=1e3)
    assert expected[0] < thickness(body.surface(np.zeros(3), 0)) < expected[1]
