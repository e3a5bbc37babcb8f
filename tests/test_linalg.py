"""Factorisation, flexibility, Krylov vectors and eigenmodes against dense linear algebra."""

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from conftest import box

import exudyn_partition as ep
from exudyn_partition.errors import IndefiniteMatrixError
from exudyn_partition.linalg import (
    BlockKrylov,
    Factorisation,
    FreeBodyFlexibility,
    eigenmodes,
    mass_normalised,
)


@pytest.fixture(scope="module")
def cube():
    """A cube, whose modes come in pairs and triples."""
    return ep.fe_model(box(0.02, 0.02, 0.02), ep.STEEL, maxh=9e-3)


@pytest.fixture(scope="module")
def dense(cube):
    omega_squared, vectors = scipy.linalg.eigh(cube.stiffness.toarray(), cube.mass.toarray())
    return np.sqrt(omega_squared[6:]), vectors[:, 6:]


def test_factorisation_solves_blocks(block):
    matrix = block.stiffness + 1e10 * block.mass
    rhs = np.random.default_rng(0).standard_normal((block.n_dofs, 101))
    x = Factorisation(matrix).solve(rhs)
    assert abs(matrix @ x - rhs).max() < 1e-9
    np.testing.assert_allclose(Factorisation(matrix).solve(rhs[:, 7]), x[:, 7], rtol=1e-12)


def test_singular_matrix():
    with pytest.raises(IndefiniteMatrixError, match="cannot be factorised"):
        Factorisation(sp.csr_matrix((4, 4)))


def test_elastic_flexibility_is_the_pseudo_inverse_of_the_modes(cube, dense):
    omega, vectors = dense
    rigid = mass_normalised(cube.rigid_modes, cube.mass)
    loads = np.random.default_rng(1).standard_normal((cube.n_dofs, 3))
    expected = vectors @ ((vectors.T @ loads) / omega[:, None] ** 2)
    got = FreeBodyFlexibility(cube.stiffness, cube.mass, rigid)(loads)
    assert np.linalg.norm(got - expected) < 1e-8 * np.linalg.norm(expected)


def test_eigenmodes_miss_nothing_where_modes_are_multiple(cube, dense):
    omega, _ = dense
    rigid = mass_normalised(cube.rigid_modes, cube.mass)
    for omega_max in (0.99 * omega[30], 1.01 * omega[60]):
        modes = eigenmodes(cube.stiffness, cube.mass, rigid, omega_max)
        expected = omega[omega < omega_max]
        assert len(modes.omega) == len(expected)
        np.testing.assert_allclose(modes.omega, expected, rtol=1e-9)
        gram = modes.vectors.T @ (cube.mass @ modes.vectors)
        np.testing.assert_allclose(gram, np.eye(len(expected)), atol=1e-10)
        residual = cube.stiffness @ modes.vectors - (cube.mass @ modes.vectors) * modes.omega**2
        assert abs(residual).max() < 1e-6 * abs(cube.stiffness @ modes.vectors).max()


def test_no_mode_in_band(cube, dense):
    rigid = mass_normalised(cube.rigid_modes, cube.mass)
    assert len(eigenmodes(cube.stiffness, cube.mass, rigid, 0.5 * dense[0][0]).omega) == 0


def test_all_modes_of_a_held_body_end_the_search():
    """A chain held at both ends: once there is no further mode above the band, the Krylov space is exhausted."""
    n = 30
    ones = np.ones(n - 1)
    K = sp.diags([-ones, 2 * np.ones(n), -ones], [-1, 0, 1], format="csr")
    modes = eigenmodes(K, sp.identity(n, format="csr"), np.empty((n, 0)), 2.5)
    exact = 2 * np.sin(np.arange(1, n + 1) * np.pi / (2 * (n + 1)))
    np.testing.assert_allclose(modes.omega, exact, rtol=1e-10)


def test_krylov_vectors_stay_orthonormal_until_the_space_is_exhausted(block):
    rigid = mass_normalised(block.rigid_modes, block.mass)
    shift = 1e11
    load = np.zeros((block.n_dofs, 1))
    load[2] = 1.0
    krylov = BlockKrylov(Factorisation(block.stiffness + shift * block.mass).solve, block.mass, shift, rigid, load)
    krylov.grow(150)
    V = np.hstack([rigid, krylov.vectors])
    np.testing.assert_allclose(V.T @ (block.mass @ V), np.eye(156), atol=1e-10)
    below, combination = krylov.rayleigh_ritz(block.stiffness)
    X = krylov.vectors @ combination
    np.testing.assert_allclose(np.diag(X.T @ (block.stiffness @ X)), below**2, rtol=1e-8)
