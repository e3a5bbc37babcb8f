"""Patches where bodies of an assembly come near each other: which facets they have, and that contact works there."""

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
from scipy.optimize import minimize

import exudyn_partition as ep
from exudyn_partition.errors import EmptyRegionError, InputError
from exudyn_partition.fe.facing import nearest_on_triangles

GAP, SIDE, BORE = 2e-5, 0.01, 4e-3


def made(shape, maxh=4e-3):
    return ep.fe_model(shape, ep.STEEL, maxh=maxh)


def block(x, y, z, *size):
    return occ.Box((x, y, z), (x + size[0], y + size[1], z + size[2]))


@pytest.fixture(scope="module")
def stack():
    """A slab on two feet, and a pin in a bore of the slab; feet and slab have small gaps."""
    slab = block(0, 0, 0, 3 * SIDE, SIDE, SIDE) - occ.Cylinder((1.5 * SIDE, -1, SIDE / 2), occ.Y, r=BORE, h=2)
    feet = [block(x, 0, -GAP - SIDE, SIDE, SIDE, SIDE) for x in (0, 2 * SIDE)]
    pin = occ.Cylinder((1.5 * SIDE, -5e-3, SIDE / 2), occ.Y, r=BORE - GAP, h=SIDE + 1e-2)
    return {"slab": made(slab), "left": made(feet[0]), "right": made(feet[1]), "pin": made(pin, 2e-3)}


@pytest.fixture(scope="module")
def parts(stack):
    return ep.Partition.facing(stack, within=1e-4)


def area(fem, patch):
    corners = fem.points[patch.facets[:, :3]]
    return np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2


def patch_of(part, name):
    (found,) = (patch for patch in part.patches if patch.name == name)
    return found


def test_each_pair_has_a_patch_on_both_sides(stack, parts):
    assert {name: {patch.name for patch in part.patches} for name, part in parts.items()} == {
        "slab": {"left", "right", "pin"},
        "left": {"slab"},
        "right": {"slab"},
        "pin": {"slab"},
    }
    for foot in ("left", "right"):
        own = patch_of(parts[foot], "slab")
        assert area(stack[foot], own) == pytest.approx(SIDE**2, rel=1e-12)  # its whole upper side, and nothing else
        np.testing.assert_allclose(stack[foot].points[own.nodes, 2], -GAP, atol=1e-12)
        theirs = patch_of(parts["slab"], foot)
        np.testing.assert_allclose(stack["slab"].points[theirs.nodes, 2], 0, atol=1e-12)
        assert SIDE**2 < area(stack["slab"], theirs) < 2 * SIDE**2  # facets reach beyond the edge of the foot
        inner = stack["slab"].points[theirs.rim]
        assert len(inner) > 0
        assert (abs(inner[:, 0] - 1.5 * SIDE) < SIDE / 2).all()  # the rim lies between the feet


def test_a_pin_and_its_bore(stack, parts):
    """Chords come nearer than the radii say; all of the bore, and the length of the pin within it."""
    bore = patch_of(parts["slab"], "pin")
    away = np.linalg.norm(stack["slab"].points[bore.nodes][:, [0, 2]] - [1.5 * SIDE, SIDE / 2], axis=1)
    np.testing.assert_allclose(away, BORE, rtol=2e-3)
    whole = ep.Partition.surface(stack["slab"], cylinder=((1.5 * SIDE, 0, SIDE / 2), (0, 1, 0), BORE)).patches[0]
    np.testing.assert_array_equal(bore.nodes, whole.nodes)
    reach = stack["pin"].points[patch_of(parts["pin"], "slab").nodes][:, 1]
    assert -5e-3 <= reach.min() < 0
    assert SIDE < reach.max() <= SIDE + 5e-3


def test_a_ball_between_nodes_of_a_coarse_plate():
    """The nearest node of the plate is far away, but its facet is near; the far side of a thin plate is not."""
    plate = made(block(-0.01, -0.01, -1e-3, 0.02, 0.02, 1e-3), 1e-2)
    ball = made(occ.Sphere((1.3e-3, 0.7e-3, 2e-3 + 1e-6), 2e-3), 1e-3)
    for order in ([plate, ball], [ball, plate]):
        parts = dict(zip(map(id, order), ep.Partition.facing(order, within=1.5e-3), strict=True))
        (own,), (tip,) = parts[id(plate)].patches, parts[id(ball)].patches
        np.testing.assert_allclose(plate.points[own.nodes, 2], 0, atol=1e-12)
        assert len(own.facets) > 0
        low = ball.points[tip.nodes]
        assert low[:, 2].min() == pytest.approx(1e-6, abs=1e-4)
        assert low[:, 2].max() < 3e-3


def test_a_body_near_two_others_at_one_place_has_one_patch():
    """A slab over the joint between two blocks: their patches would share nodes."""
    slab = made(block(0, 0, GAP, 2 * SIDE, SIDE, SIDE / 2))
    below = [made(block(x, 0, -SIDE, SIDE - GAP, SIDE, SIDE)) for x in (0, SIDE)]
    fems = {"slab": slab, "one": below[0], "two": below[1]}
    parts = ep.Partition.facing(fems, within=1e-4)
    assert [patch.name for patch in parts["slab"].patches] == ["one and two"]
    assert [patch.name for patch in parts["one"].patches] == ["slab and two"]


def test_jaws_are_two_patches_for_one_body():
    """A vice around a block."""
    outer = block(-SIDE, 0, 0, 3 * SIDE, SIDE, 2 * SIDE)
    vice = outer - block(-GAP, -1, SIDE, SIDE + 2 * GAP, 3, 2 * SIDE)
    parts = ep.Partition.facing(
        {"vice": made(vice), "block": made(block(0, 0, 1.5 * SIDE, SIDE, SIDE, SIDE))}, within=1e-4
    )
    for part, other in zip(parts.values(), ("block", "vice"), strict=True):
        assert sorted(patch.name for patch in part.patches) == [other, f"{other} 2"]
        assert {round(patch.direction[0]) for patch in part.patches} == {-1, 1}


def test_contact_of_an_assembly_with_faces_that_nobody_named():
    """A block falls on two feet: both push alike, and their impulse is the change of its momentum."""
    slab = made(block(0, 0, GAP / 100, 3 * SIDE, SIDE, SIDE))
    feet = [made(block(x, 0, -SIDE, SIDE, SIDE, SIDE)) for x in (0, 2 * SIDE)]
    parts = ep.Partition.facing([slab, *feet], within=1e-4)
    mbs = exu.SystemContainer().AddSystem()
    items = []
    for i, (fem, part) in enumerate(zip([slab, *feet], parts, strict=True)):
        velocity = [0, 0, -1e-2 if i == 0 else 0]
        items.append(
            ep.CreatePartitionBody(mbs, ep.reduce(fem, part, f_cut=90e3), initialVelocity=velocity, name=str(i))
        )
    contacts = ep.CreatePartitionContact(mbs, items, within=1e-4)
    mbs.Assemble()
    assert len(contacts) == 2
    result = ep.solve_dynamic(mbs, end_time=6e-5)
    forces = [contact.force(result) for contact in contacts]
    assert min(force.max() for force in forces) > 1
    momentum = sum(np.trapezoid(force, result.t) for force in forces)
    change = np.diff(items[0].momentum(result)[[0, -1], 2])[0]
    assert momentum == pytest.approx(change, rel=1e-3)
    assert forces[0] == pytest.approx(forces[1], abs=0.05 * forces[0].max())  # both feet are alike


def test_nearest_points_against_a_search():
    rng = np.random.default_rng(5)
    triangles, points = rng.normal(size=(40, 3, 3)), 2 * rng.normal(size=(40, 3))
    triangles[:3, 2] = triangles[:3, 1]  # edges
    found = nearest_on_triangles(points, triangles)
    for point, (a, b, c), place in zip(points, triangles, found, strict=True):
        best = min(
            minimize(
                lambda w, a=a, b=b, c=c, p=point: ((a + w[0] * (b - a) + w[1] * (c - a) - p) ** 2).sum(),
                start,
                bounds=[(0, 1), (0, 1)],
                constraints={"type": "ineq", "fun": lambda w: 1 - w.sum()},
                options={"ftol": 1e-14},
            ).fun
            for start in ([0.3, 0.3], [0.0, 0.0])
        )
        assert np.linalg.norm(place - point) == pytest.approx(np.sqrt(best), rel=1e-5)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (lambda s: ({**s, "far": made(block(1, 0, 0, SIDE, SIDE, SIDE))}, 1e-4), EmptyRegionError, "no other .* 'far'"),
        (lambda s: (s, 1e-6), EmptyRegionError, "within 1e-06 m"),
        (lambda s: (s, -1.0), InputError, "within: expected"),
        (lambda s: ({"slab": s["slab"]}, 1e-4), InputError, "at least two FE models, .* got 1"),
        (lambda s: ([s["slab"]] * 2, 1e-4), InputError, "each of them once"),
        (lambda s: ({1: s["slab"], 2: s["left"]}, 1e-4), InputError, "fems: expected"),
        (lambda s: (s["slab"], 1e-4), InputError, "fems: expected a list"),
        (lambda s: ([s["slab"], "left"], 1e-4), InputError, "got str at index 1"),
    ],
)
def test_what_is_refused(stack, change, error, message):
    fems, within = change(stack)
    with pytest.raises(error, match=message):
        ep.Partition.facing(fems, within=within)
