"""Bodies whose flexibility is found on demand: the same as with an array, in memory, in files, and to the user."""

import netgen.occ as occ
import numpy as np
import pytest
from samples import assert_same

import exudyn_partition as ep
from exudyn_partition.algebra.sparse.skin_flexibility import SkinFlexibility
from exudyn_partition.algebra.sparse.solver import SparseFactors, solved_by
from exudyn_partition.errors import MemoryLimitError
from exudyn_partition.reduction import free_body, memory

F_CUT = 60e3


@pytest.fixture(scope="module")
def fem():
    bored = occ.Box((0, 0, 0), (12e-3, 10e-3, 8e-3)) - occ.Cylinder(occ.Pnt(6e-3, 5e-3, 0), occ.Z, r=2.5e-3, h=8e-3)
    return ep.fe_model(bored, ep.STEEL, maxh=5e-3)


def surface(fem, axes="xyz"):
    return ep.Partition.surface(fem, range(len(fem.facets)), axes=axes, name="skin")


def below(fem):
    """The lower half of the skin, beside a rigid interface in the bore and another patch."""
    hub = ep.Partition.interface(fem, "hub", cylinder=((6e-3, 5e-3, 0), (0, 0, 1), 2.5e-3))
    rest = (fem.points[fem.facets, 2].max(axis=1) < 6e-3) & ~np.isin(fem.facets, hub.interfaces[0].nodes).any(axis=1)
    low = ep.Partition.surface(fem, rest, axes="xyz", name="low")
    return low | ep.Partition.ball(fem, (11e-3, 9e-3, 8e-3), 2e-3, name="top") | hub


def on_demand(monkeypatch, *model, **options):
    with monkeypatch.context() as patch:
        patch.setattr(free_body, "SMALL", 100)
        body = ep.reduce(*model, f_cut=F_CUT, **options)
    assert isinstance(body.basis.flexibility, SkinFlexibility)
    return body


def with_array(*model, **options):
    body = ep.reduce(*model, f_cut=F_CUT, **options)
    assert isinstance(body.basis.flexibility, np.ndarray)
    return body


@pytest.fixture(scope="module")
def dense(fem):
    """The whole skin, with an array."""
    return with_array(fem, surface(fem))


@pytest.fixture(scope="module")
def lean(fem):
    """The same, on demand."""
    with pytest.MonkeyPatch.context() as patch:
        return on_demand(patch, fem, surface(fem))


PARTITIONS = {
    "all": surface,
    "normals": lambda fem: surface(fem, axes="normal"),
    "beside an interface": below,
}


@pytest.mark.parametrize("basis", ["contact-adapted", "residual"])
@pytest.mark.parametrize("partition", PARTITIONS.values(), ids=list(PARTITIONS))
def test_equal_to_an_array(fem, partition, basis, monkeypatch):
    part = partition(fem)
    body, dense = on_demand(monkeypatch, fem, part, basis=basis), with_array(fem, part, basis=basis)
    np.testing.assert_allclose(body.basis.omega, dense.basis.omega, rtol=1e-9)
    largest = abs(dense.basis.flexibility).max()
    found = np.asarray(body.basis.flexibility)
    np.testing.assert_allclose(found, dense.basis.flexibility, rtol=0, atol=1e-12 * largest)
    names = [patch.name for patch in part.patches]
    for name in names:
        for other in names:
            block, known = body.flexibility(name, other), dense.flexibility(name, other)
            assert block.shape == known.shape
            np.testing.assert_allclose(np.asarray(block), known, rtol=0, atol=1e-12 * largest)


def test_a_file_holds_no_factors(lean, dense, tmp_path):
    """They are found again, to the last bit; the file is far smaller than that of an array."""
    for name, saved in (("skin", lean), ("array", dense)):
        saved.save(tmp_path / name)
    again = ep.load_body(tmp_path / "skin")
    assert_same(again, lean)
    assert_same(again.basis.flexibility.factors.kept, lean.basis.flexibility.factors.kept)
    some = np.arange(60)
    assert (again.basis.flexibility.between(some) == lean.basis.flexibility.between(some)).all()
    assert (tmp_path / "skin").stat().st_size < 0.25 * (tmp_path / "array").stat().st_size


def test_an_array_that_is_too_large_is_refused_by_name(lean, dense, monkeypatch):
    """Matrices for other codes have all of the flexibility."""
    found, known = (body.matrices().contacts["skin"].flexibility for body in (lean, dense))
    np.testing.assert_allclose(found, known, rtol=0, atol=1e-12 * abs(known).max())
    monkeypatch.setattr("exudyn_partition.algebra.sparse.skin_flexibility.MOST_ROWS", 100)
    with pytest.raises(MemoryLimitError, match=r"flexibility: it is found on demand.*needs a smaller patch"):
        lean.matrices()


def test_small_patches_and_those_that_do_not_wander_have_arrays(fem, monkeypatch):
    ball = ep.Partition.ball(fem, (6e-3, 5e-3, 8e-3), 4e-3, axes="xyz")
    assert not free_body.found_on_demand(surface(fem))
    monkeypatch.setattr(free_body, "SMALL", 10)
    assert free_body.found_on_demand(surface(fem))
    assert len(ball.patch_nodes) * 3 > 10
    with_array(fem, ball)


def test_memory_grows_with_the_factors_not_with_the_square_of_rows(fem, lean, monkeypatch):
    part = surface(fem)
    as_array = memory.needed([(fem, part)], "contact-adapted")
    monkeypatch.setattr(free_body, "SMALL", 100)
    square = 6 * 8.0 * len(lean.basis.flexibility) ** 2
    fronts = lean.basis.flexibility.factors.kept.store.nbytes
    assert fronts < memory.needed([(fem, part)], "contact-adapted") - (as_array - square) < 4 * fronts


def test_factors_of_huge_bodies_stay_in_double_precision(fem, dense, monkeypatch):
    """Single precision would leave 1e-4 of the flexibility."""
    monkeypatch.setattr(free_body, "HUGE", 100)
    found, known = np.asarray(on_demand(monkeypatch, fem, surface(fem)).basis.flexibility), dense.basis.flexibility
    np.testing.assert_allclose(found, known, rtol=0, atol=1e-12 * abs(known).max())


def test_another_solver_gives_an_array(fem, monkeypatch):
    """It has no fronts to keep."""

    class Inverse(SparseFactors):
        def __init__(self, matrix):
            self._inverse = np.linalg.inv(matrix.toarray())

        def solve(self, rhs):
            return self._inverse @ rhs

        def negative_pivots(self):
            return 0

    coarse = ep.fe_model(occ.Box((0, 0, 0), (12e-3, 10e-3, 8e-3)), ep.STEEL, maxh=8e-3)
    dense = with_array(coarse, surface(coarse)).basis.flexibility
    monkeypatch.setattr(free_body, "SMALL", 100)
    with solved_by(Inverse):
        found = with_array(coarse, surface(coarse)).basis.flexibility
    np.testing.assert_allclose(found, dense, rtol=0, atol=1e-8 * abs(dense).max())


def test_the_skin_in_one_word(fem):
    """`skin=True` is `Partition.skin`, beside what else the partition has."""
    assert_same(ep.reduce(fem, skin=True, f_cut=F_CUT).basis, ep.reduce(fem, ep.Partition.skin(fem), f_cut=F_CUT).basis)
    hub = ep.Partition.interface(fem, "hub", cylinder=((6e-3, 5e-3, 0), (0, 0, 1), 2.5e-3))
    body = ep.reduce(fem, hub, skin=True, f_cut=F_CUT)
    assert [patch.name for patch in body.partition.patches] == ["skin"]
    assert body.partition.interfaces[0].name == "hub"
