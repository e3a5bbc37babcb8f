"""The random scenes: what finds that bodies lie within each other, and some of the scenes."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from exudyn_partition.contact.formulations.choices import Penalty
from validation.stability import random_scenes

SCENE = random_scenes.Scene(
    ("ball", "block"), "residual", "compliance", "inertial", None, None, False, (0, 0, -1.5), (0.0,) * 3, (0.0, 0.0)
)
LIMITS = random_scenes.LIMITS
R = 2.0
FLAT = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 0, 0], [0.5, 0.5, 0], [0, 0.5, 0]])
FACET = np.arange(6)[None]


def test_gaps_to_a_curved_facet_are_those_to_its_paraboloid():
    bowl = FLAT + [[0, 0, -(x @ x) / (2 * R)] for x in FLAT]
    local = np.array([[0.2, 0.3], [0.6, 0.1], [0.05, 0.05]])
    feet = np.column_stack([local, -(local**2).sum(axis=1) / (2 * R)])
    normals = np.column_stack([local / R, np.ones(3)])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    for gap in (-1e-2, 0.0, 3e-2):
        found = random_scenes.point_gaps(feet + gap * normals, bowl, FACET)
        np.testing.assert_allclose(found, gap, atol=1e-12)
    assert np.isnan(random_scenes.point_gaps(np.array([[2.0, 0.5, 0.1]]), bowl, FACET)).all()  # beside it


def test_rows_are_means_over_hats():
    points, rows, areas = random_scenes.row_points(FLAT, FACET, integrated=True)
    # Hats on four triangles of area 1/8: corners have one of them, the nodes between have three.
    np.testing.assert_allclose(areas, np.array([1, 1, 1, 3, 3, 3]) / 24)
    corner = (2 * FLAT[0] + FLAT[3] + FLAT[5]) / 4  # the mean place over a hat of one triangle
    np.testing.assert_allclose((rows @ points @ FLAT)[0], corner, atol=1e-15)


def test_forces_at_a_distance_are_found():
    gaps, forces = np.array([[0.0, 2e-6], [-3e-6, np.nan]]), np.array([[1.0, 1.0], [3.0, 1.0]])
    overlap, apart, depth, seen = random_scenes.laws(gaps, gaps - 1e-6, forces)
    assert (overlap, apart, depth, seen) == pytest.approx((3e-6, 0.5e-6, 4e-6, 5 / 6))


def run(scene):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return scene, *random_scenes.run(scene, "explicit")


def test_surfaces_overlap_without_what_the_contact_yields():
    scene, items, contact, result = run(SCENE)
    overlap, apart, depth, seen = random_scenes.surface_laws(scene, items, contact, result)
    assert overlap < LIMITS["overlap"]
    assert apart < LIMITS["apart"]
    assert seen > 0.5
    assert LIMITS["overlap"] < depth < LIMITS["depth"]


def test_bodies_that_nothing_keeps_apart_are_found():
    _, _, depth, _ = random_scenes.surface_laws(*run(replace(SCENE, formulation=Penalty(1e6))))
    assert depth > LIMITS["depth"]


@pytest.mark.parametrize("seed", [3, 4])
def test_a_seed_draws_one_scene_and_it_holds(seed):
    row = random_scenes.checked(seed)
    assert row["scene"] == str(random_scenes.drawn(seed))
    assert not row["beyond"], row
    assert row["touched"]
    assert {*row["found"]} == {*LIMITS}
