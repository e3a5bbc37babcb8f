"""Contact with compiled loops against the same contact in NumPy: forces to rounding."""

from contextlib import nullcontext

import numpy as np
import pytest
import scipy.sparse as sp
from oracles import compliant, each_way, floating, inertial, moved, relative, without_numba

from exudyn_partition.algebra.coulomb import Coulomb
from exudyn_partition.contact import loops
from exudyn_partition.contact.patch_gaps import PatchGaps
from exudyn_partition.surfaces.points import ROWS, ContactPoints


def ways(slave, n_master):
    """Coordinates of a ball that comes down on a plate, slides over its facets, tilts and leaves."""
    for u in np.linspace(0, 1, 60):
        depth = 5e-6 * np.sin(2 * np.pi * u) + 2e-6
        tilt = [2e-4 * np.sin(9 * u), 1e-4 * u, 0.0]
        yield np.r_[moved(slave, [0.3e-3 * u, 0.1e-3 * u, -depth], tilt), np.zeros(n_master)]


@pytest.mark.parametrize("frame", [inertial, floating])
@pytest.mark.parametrize("kind", ROWS)
def test_forces_are_the_same(round_body, flat_body, kind, frame):
    sides = frame(round_body), inertial(flat_body)

    def forces():
        law = compliant(PatchGaps(*sides, kind))
        found = [law.at(q).generalised.copy() for q in ways(sides[0], flat_body.n_dofs)]
        assert law.gaps.moving
        return np.array(found)

    compiled, plain = each_way(forces)
    assert relative(compiled, plain) < 1e-9
    assert 0 < np.count_nonzero(plain.any(axis=1)) < len(plain)


def test_rows_are_chosen_at_the_same_places(round_body, flat_body):
    """Also while the ball bulges out and in, which rigid motion does not foretell: then others may close early."""
    sides, bulge = (inertial(round_body), inertial(flat_body)), np.zeros(round_body.n_dofs)
    bulge[-1] = 2e-6 / abs(round_body.rows(round_body.partition.patches[0].nodes)[:, -1]).max()

    def rows():
        gaps, found = PatchGaps(*sides), []
        gaps.follow()
        for step, q in enumerate(ways(sides[0], flat_body.n_dofs)):
            q[: len(bulge)] += np.sin(step) * bulge
            gaps.at(q)
            found.append(set(gaps.row_nodes))
        return found

    compiled, plain = each_way(rows)
    assert compiled == plain
    assert len({len(some) for some in plain}) > 3


@pytest.mark.parametrize("frame", [inertial, floating])
@pytest.mark.parametrize("compiled", [True, False])
def test_following_only_the_nodes_that_rows_need_changes_no_force(round_body, flat_body, frame, compiled, monkeypatch):
    sides, found = (frame(round_body), inertial(flat_body)), []
    for many in (0, 10**9):
        monkeypatch.setattr("exudyn_partition.contact.sides.MANY", many)
        with nullcontext() if compiled else without_numba():
            law = compliant(PatchGaps(*sides), Coulomb(0.3))
            forces = [law.at(q).generalised.copy() for q in ways(sides[0], flat_body.n_dofs)]
            followed = [side.n_followed for side in law.gaps.stage.rows.sides]
        assert (followed < [side.n_followed for side in law.gaps.sides]) is (many == 0)
        found.append(np.array(forces))
    assert relative(*found) < 1e-9
    assert found[0].any()


def test_forces_with_friction_are_the_same(round_body, flat_body):
    """Rows stick, slip, open and close on the way."""
    sides = inertial(round_body), inertial(flat_body)

    def forces():
        law, found, states = compliant(PatchGaps(*sides), Coulomb(0.3)), [], set()
        for step, q in enumerate(ways(sides[0], flat_body.n_dofs)):
            law.accept(float(step))
            found.append(law.at(q).generalised.copy())
            states |= set(law.evaluation.status)
        assert states == {0, 1, 2}
        return np.array([*found, np.full(len(found[0]), law.evaluation.dissipated)])

    compiled, plain = each_way(forces)
    assert relative(compiled, plain) < 1e-8
    assert plain[-1, 0] > 0


def test_rows_may_need_no_nodes():
    """As those of a contact on a skin that sleeps."""
    nodes, weights, normals = np.zeros((0, 6), dtype=np.int64), np.zeros((0, 6)), np.zeros((0, 3))
    mean, none, two = sp.csr_matrix((2, 0)), sp.csr_matrix((0, 0)), np.arange(2)
    points = ContactPoints(nodes, weights, mean, two, np.ones(2), none)
    for along in each_way(lambda: loops.rows_along(points, nodes, weights, normals, 0)):
        assert along.shape == (2, 0)
    tangents = np.zeros((2, 2, 3))
    for directed in each_way(lambda: loops.directed_rows(points, two, nodes, weights, normals, tangents, 0)):
        assert directed.shape == (6, 0)
