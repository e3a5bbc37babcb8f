"""Another sparse solver in the place of the own one: SuperLU of SciPy."""

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg
from oracles import box

import exudyn_partition as ep
from exudyn_partition.algebra.sparse import loops, multifrontal
from exudyn_partition.algebra.sparse.multifrontal import Factorisation
from exudyn_partition.algebra.sparse.solver import Refined, SparseFactors, factorise, solved_by
from exudyn_partition.errors import IndefiniteMatrixError


class SuperLU(SparseFactors):
    """With pivots on the diagonal, whose signs are then those of the eigenvalues."""

    made = 0

    def __init__(self, matrix):
        type(self).made += 1
        try:
            self._factors = scipy.sparse.linalg.splu(
                matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
            )
        except RuntimeError as error:
            raise IndefiniteMatrixError(str(error)) from error

    def solve(self, rhs):
        return self._factors.solve(rhs)

    def negative_pivots(self):
        return int(np.count_nonzero(self._factors.U.diagonal() < 0))


def test_both_do_the_same(block):
    shifted = sp.csc_matrix(block.stiffness - 2e9 * block.mass)
    own, other = factorise(lambda: shifted), SuperLU(shifted)
    assert isinstance(own, Factorisation)
    assert own.negative_pivots() == other.negative_pivots() > 5
    rhs = np.random.default_rng(0).standard_normal((block.n_dofs, 3))
    rows = sp.csr_matrix(([1.0, 2.0, -1.0], ([0, 1, 1], [3, 5, 8])), shape=(2, block.n_dofs))
    for one, same in (
        (own.solve(rhs), other.solve(rhs)),
        (own.energies(rhs), other.energies(rhs)),
        (own.inverse_at(rows), other.inverse_at(rows)),
    ):
        np.testing.assert_allclose(one, same, rtol=0, atol=1e-7 * abs(one).max())


@pytest.mark.parametrize("basis", ["contact-adapted", "craig-bampton"])
def test_a_reduction_has_the_same_matrices(block, basis):
    part = ep.Partition.ball(block, (0, 0, 0.03), 4e-3)

    def reduced():
        body = ep.reduce(block, part, basis=basis, f_cut=150e3)
        patch = body.rows(body.partition.patch_nodes)
        return body, patch if isinstance(patch, np.ndarray) else patch.toarray()

    (own, rows), before = reduced(), SuperLU.made
    with solved_by(SuperLU):
        other, others_rows = reduced()
    made = SuperLU.made
    assert made > before
    assert reduced()[0].n_dofs == own.n_dofs
    assert SuperLU.made == made  # afterwards it is the own one again
    for name in ("mass", "stiffness"):
        one, same = getattr(own, name).toarray(), getattr(other, name).toarray()
        np.testing.assert_allclose(one, same, rtol=0, atol=1e-8 * abs(one).max())
    # Shapes have any sign; their products with themselves do not.
    at_patch = [
        shapes @ np.linalg.pinv(body.stiffness.toarray()) @ shapes.T
        for body, shapes in ((own, rows), (other, others_rows))
    ]
    np.testing.assert_allclose(*at_patch, rtol=0, atol=1e-7 * abs(at_patch[0]).max())
    if own.basis.flexibility is not None:
        np.testing.assert_allclose(
            own.flexibility(0), other.flexibility(0), rtol=0, atol=1e-8 * abs(own.flexibility(0)).max()
        )


def test_a_singular_matrix_is_an_error_of_both():
    singular = sp.csr_matrix((4, 4))
    for solver in (factorise, SuperLU):
        with pytest.raises(IndefiniteMatrixError):
            solver(sp.csc_matrix(singular))


def test_a_plastic_zone_has_the_same_flexibility():
    """Another solver has no fronts; the zone then keeps its inverse as one dense front."""
    material = ep.Material(E=70e9, nu=0.33, rho=2700.0, yield_stress=200e6, hardening=500e6)
    fem = ep.fe_model(box(10e-3, 12e-3, 4e-3), material, maxh=4e-3)
    part = ep.Partition.ball(fem, (0, 0, 4e-3), 2e-3, plastic_radius=3e-3)
    (own,) = ep.reduce(fem, part, f_cut=60e3).basis.zones
    with solved_by(SuperLU):
        (other,) = ep.reduce(fem, part, f_cut=60e3).basis.zones
    assert len(other.own.fronts.starts) == 2 < len(own.own.fronts.starts)
    everything = np.eye(len(own.own))
    np.testing.assert_allclose(
        own.own @ everything, other.own @ everything, rtol=0, atol=1e-8 * abs(own.of_patch).max()
    )
    np.testing.assert_allclose(own.of_patch, other.of_patch, rtol=0, atol=1e-8 * abs(own.of_patch).max())


@pytest.mark.parametrize("way", ["loops", "loops in two threads", "NumPy"])
def test_factors_in_half_of_the_memory_solve_as_well(block, way, monkeypatch):
    """A matrix that is nearly singular, as it is for a body whose mesh is fine."""
    if way == "NumPy":
        monkeypatch.setattr(loops, "kernels", lambda *layer: None)
    if way == "loops in two threads":
        monkeypatch.setattr(multifrontal, "TWO_THREADS_FROM", 0)
    matrix = sp.csr_matrix(block.stiffness + 1e6 * block.mass)
    rng = np.random.default_rng(0)
    rhs, places = rng.standard_normal((block.n_dofs, 3)), rng.choice(block.n_dofs, (40, 3))
    rows = sp.csr_matrix((rng.standard_normal(120), places.ravel(), np.arange(0, 121, 3)), (40, block.n_dofs))
    exact, light = factorise(matrix), factorise(lambda: matrix, rows=rows)
    assert isinstance(light, Refined)
    for found, right in (
        (light.inverse_at(rows), exact.inverse_at(rows)),
        (light.inverse_at(rows[::-1]), exact.inverse_at(rows[::-1])),
        (light.solve(rhs), exact.solve(rhs)),
        (light.solve(rhs[:, 0]), exact.solve(rhs[:, 0])),
        (light.energies(rhs), exact.energies(rhs)),
    ):
        assert found.shape == right.shape
        np.testing.assert_allclose(found, right, rtol=0, atol=1e-9 * abs(right).max(initial=0.0))
    assert light.negative_pivots() == 0
    assert light.solve(rhs[:, :0]).shape == (block.n_dofs, 0)


def test_factors_that_are_too_rough_are_an_error():
    """Springs of many sizes: more modes are lost in single precision than conjugate gradients find."""
    sizes = np.geomspace(1.0, 1e-15, 200)
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((200, 200)))[0]
    matrix = sp.csr_matrix((turn * sizes) @ turn.T)
    with pytest.raises(IndefiniteMatrixError):
        factorise((matrix + matrix.T) / 2, rows=sp.identity(200, format="csr")[:1]).solve(np.ones(200))


def test_another_solver_is_asked_for_rows_as_for_others(block):
    rows = sp.identity(block.n_dofs, format="csr")[:5]
    matrix = block.stiffness + 1e9 * block.mass
    with solved_by(SuperLU):
        other = factorise(matrix, rows=rows)
    found, right = other.inverse_at(rows), factorise(matrix).inverse_at(rows)
    np.testing.assert_allclose(found, right, rtol=0, atol=1e-9 * abs(right).max())
