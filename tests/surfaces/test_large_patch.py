"""Flexibility of large patches by few solutions, against all of them."""

import numpy as np
import pytest
from oracles import relative

import exudyn_partition as ep
from exudyn_partition.surfaces import large_patch


def grid(n, m, spacing):
    """Nodes on a part of a cylinder, (n m, 3), and their normals; not quite regular."""
    rng = np.random.default_rng(0)
    radius = n * spacing / 2
    angle = (np.arange(n)[:, None] + 0.2 * rng.standard_normal((n, m))) * spacing / radius
    along = (np.arange(m) + 0.2 * rng.standard_normal((n, m))) * spacing
    normals = np.stack([np.cos(angle), np.sin(angle), np.zeros((n, m))], axis=-1).reshape(-1, 3)
    return radius * normals + np.stack([0 * along, 0 * along, along], axis=-1).reshape(-1, 3), normals


def test_spots_are_as_stiff_as_with_all_solutions():
    """A half-space's answer, 1 / r, blunt at the scale of a node. Spots of all sizes, here and there."""
    points, normals = grid(60, 22, 1.0)
    r = np.linalg.norm(points[:, None] - points, axis=2)
    F, asked = 1 / np.sqrt(r**2 + 0.3**2), []

    def answers(loads):
        asked.append(loads.shape[0])
        return F @ loads.T.toarray()

    found = large_patch.large_flexibility(points, normals, 1, answers)
    assert sum(asked) < large_patch.PAYS * len(F)
    np.testing.assert_array_equal(found, found.T)
    assert relative(found, F) < 1e-3
    for middle in (0, 150, 700, 1200):
        for radius in (1.5, 4.0, 12.0):
            spot = np.ix_(*[np.flatnonzero(r[middle] < radius)] * 2)
            stiffness = [np.linalg.solve(one[spot], np.ones(len(spot[0]))).sum() for one in (found, F)]
            assert stiffness[0] == pytest.approx(stiffness[1], rel=1e-3)
            assert np.linalg.eigvalsh(found[spot]).min() > 0


@pytest.mark.parametrize("axes", ["normal", "xyz"])
def test_a_body_with_a_large_and_a_small_patch_is_the_same(block, top, axes, monkeypatch):
    """All pairs of so small a patch are near, and so exact."""
    side = ((4.9e-3, -1, 0), (5.1e-3, 1, 0.018))
    part = top | ep.Partition.surface(block, side, axes=axes)
    bodies = [ep.reduce(block, part, f_cut=30e3)]
    monkeypatch.setattr(large_patch, "FEWEST", 10)
    monkeypatch.setattr(large_patch, "PAYS", 2)
    bodies.append(ep.reduce(block, part, f_cut=30e3))
    assert relative(bodies[1].basis.flexibility, bodies[0].basis.flexibility) < 1e-9
