"""Factorisation, flexibility, Krylov vectors and eigenmodes against dense linear algebra."""

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from oracles import box

import exudyn_partition as ep
from exudyn_partition.algebra.krylov import BlockKrylov, eigenmodes, mass_normalised
from exudyn_partition.algebra.sparse.flexibility import FreeBodyFlexibility
from exudyn_partition.algebra.sparse.multifrontal import Factorisation
from exudyn_partition.errors import ModeAccuracyError, ModeCountWarning


@pytest.fixture(scope="module")
def cube():
    """A cube, whose modes come in pairs and triples."""
    return ep.fe_model(box(0.02, 0.02, 0.02), ep.STEEL, maxh=9e-3)


@pytest.fixture(scope="module")
def dense(cube):
    omega_squared, vectors = scipy.linalg.eigh(cube.stiffness.toarray(), cube.mass.toarray())
    return np.sqrt(omega_squared[6:]), vectors[:, 6:]


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
        # Settled to 1e-6 in the norm of the shifted operator; this one counts the stiffest motion more.
        assert abs(residual).max() < 1e-5 * abs(cube.stiffness @ modes.vectors).max()


def test_negative_pivots_count_the_modes_of_the_dense_spectrum(block):
    omega_squared = scipy.linalg.eigvalsh(block.stiffness.toarray(), block.mass.toarray())
    omega = np.sqrt(np.maximum(omega_squared, 0.0))
    for k in (5, 6, 11, 40, 200):
        shifted = block.stiffness - ((omega[k] + omega[k + 1]) / 2) ** 2 * block.mass
        assert Factorisation(shifted).negative_pivots() == k + 1


def test_double_modes_count_twice():
    """A square held membrane of springs: the modes (i, j) and (j, i) are one frequency."""
    n = 12
    chain = sp.diags([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], [-1, 0, 1])
    K, M = sp.csr_matrix(sp.kronsum(chain, chain)), sp.identity(n * n, format="csr")
    squared = 4 * np.sin(np.arange(1, n + 1) * np.pi / (2 * (n + 1))) ** 2
    exact = np.sort(np.sqrt(np.add.outer(squared, squared)).ravel())
    assert np.count_nonzero(np.diff(exact) < 1e-9) > 60
    for k in (1, 4, 6, 30, 70):
        omega = 0.5 * (exact[k] + exact[exact > exact[k] + 1e-9][0])
        below = exact[exact < omega]
        assert Factorisation(K - omega**2 * M).negative_pivots() == len(below)
        np.testing.assert_allclose(eigenmodes(K, M, np.empty((n * n, 0)), omega).omega, below, rtol=1e-10)


def test_a_missed_mode_is_reported(cube, dense, monkeypatch):
    omega, _ = dense
    counted = Factorisation.negative_pivots
    monkeypatch.setattr(Factorisation, "negative_pivots", lambda self: counted(self) + 1)
    rigid = mass_normalised(cube.rigid_modes, cube.mass)
    expected = np.count_nonzero(omega < 1.01 * omega[30])
    with pytest.warns(ModeCountWarning, match=f"expected {expected + 1} elastic modes .* found {expected}"):
        modes = eigenmodes(cube.stiffness, cube.mass, rigid, 1.01 * omega[30])
    assert len(modes.omega) == expected


def test_inaccurate_factors_are_reported(cube, dense, monkeypatch):
    """Solves of blocks with another matrix than the one that was given: pairs converge, to wrong frequencies."""
    solve = Factorisation.solve
    off = 1 + 1e-5 * np.random.default_rng(0).standard_normal((cube.n_dofs, 1))
    monkeypatch.setattr(Factorisation, "solve", lambda self, b: solve(self, off * b if b.size > len(off) else b))
    rigid = mass_normalised(cube.rigid_modes, cube.mass)
    with pytest.raises(ModeAccuracyError, match=r"strain energy is off by .* move the end of the band, f_cut"):
        eigenmodes(cube.stiffness, cube.mass, rigid, 1.01 * dense[0][30])


def test_a_band_that_ends_at_a_mode_includes_it(cube, dense):
    omega, _ = dense
    rigid = mass_normalised(cube.rigid_modes, cube.mass)
    simple = next(k for k in range(1, 40) if min(omega[k] - omega[k - 1], omega[k + 1] - omega[k]) > 1e-3 * omega[k])
    modes = eigenmodes(cube.stiffness, cube.mass, rigid, omega[simple])
    np.testing.assert_allclose(modes.omega, omega[: simple + 1], rtol=1e-9)


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


@pytest.mark.parametrize("n", range(7, 40))
def test_a_space_smaller_than_its_blocks_is_exhausted(n):
    """The last blocks, and blocks of nearly dependent loads, hold less than they have columns: round-off is dropped."""
    rng = np.random.default_rng(n)
    K, M = sp.diags(np.geomspace(1e6, 1e12, n), format="csr"), sp.identity(n, format="csr")
    loads = rng.standard_normal((n, 5))
    loads = np.hstack([loads, loads @ rng.standard_normal((5, 3)) + 1e-12 * rng.standard_normal((n, 3))])
    krylov = BlockKrylov(Factorisation(K + 1e9 * M).solve, M, 1e9, np.eye(n)[:, :6], loads)
    assert not krylov.grow(n)
    V = krylov.vectors
    np.testing.assert_allclose(V.T @ V, np.eye(n - 6), atol=1e-12)
    np.testing.assert_allclose(krylov.rayleigh_ritz(K)[0] ** 2, K.diagonal()[6:], rtol=1e-6)
