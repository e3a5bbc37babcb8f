"""Another sparse solver in the place of the own one: SuperLU of SciPy."""

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg
from oracles import box

import exudyn_partition as ep
from exudyn_partition.algebra.sparse.multifrontal import Factorisation
from exudyn_partition.algebra.sparse.solver import SparseFactors, factorise, solved_by
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
