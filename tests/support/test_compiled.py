"""Inner loops are compiled if numba is there, and done by NumPy if not."""

from oracles import without_numba

from exudyn_partition.support import compiled


def test_without_numba_there_are_no_loops():
    assert compiled.kernels("surfaces").__name__ == "exudyn_partition.surfaces.kernels"
    with without_numba():
        assert compiled.kernels("surfaces") is None
    assert compiled.compiles()


def test_loops_are_compiled_where_they_cannot_be_kept():
    """Code without a file has no folder beside it, like that in a folder that nobody may write to."""
    scope = {}
    exec("def twice(x):\n    return 2 * x", scope)
    twice = compiled.compiled(scope["twice"])
    assert twice(2.0) == 4.0
    assert len(twice.signatures) == 1
