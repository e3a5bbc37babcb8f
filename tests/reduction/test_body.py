"""Reduced bodies: matrices, rigid motion and rows of every basis against its dense columns."""

import numpy as np
import pytest
from oracles import dense_basis, mass_matrix

import exudyn_partition as ep

BASES = ["free", "craig-bampton", "residual", "contact-adapted"]


@pytest.fixture(scope="module", params=BASES)
def body(request, block, top):
    return ep.reduce(block, top, basis=request.param, f_cut=80e3)


def test_reduced_matrices_are_those_of_a_dense_product(block, body):
    T = dense_basis(body)
    for reduced, full in ((body.mass, mass_matrix(block, body)), (body.stiffness, block.stiffness)):
        expected = T.T @ (full @ T)
        np.testing.assert_allclose(reduced.toarray(), expected, atol=1e-9 * abs(expected).max())
    assert np.linalg.eigvalsh(body.mass.toarray())[0] > 0


def test_rigid_motion_is_in_every_basis(block, body):
    motion = np.array([0.1, -0.2, 0.3, 4.0, 5.0, -6.0])
    np.testing.assert_allclose(body.displacement(body.rigid @ motion).ravel(), block.rigid_modes @ motion, atol=1e-9)


def test_rows_are_rows_of_the_basis(body):
    T = dense_basis(body)
    nodes = np.r_[body.partition.nodes[::7], 0]
    rows = body.rows(nodes)
    rows = rows if isinstance(rows, np.ndarray) else rows.toarray()
    np.testing.assert_array_equal(rows, T.reshape(-1, 3, body.n_dofs)[nodes].reshape(-1, body.n_dofs))


def test_a_body_prints_itself(body):
    assert body.basis.name in repr(body)
    lines = body.table().splitlines()
    assert len(lines) == len(body.labels) == body.n_dofs
    assert all("Hz" in sentence or "(" in sentence or "recovery" in sentence for sentence in body.left_out)
