"""Memory of a reduction: told before it is asked for, named where it runs out."""

from dataclasses import replace

import pytest

import exudyn_partition as ep
from exudyn_partition.errors import MemoryLimitError, MemoryWarning
from exudyn_partition.reduction import free_body, memory


def test_memory_is_told_before_it_is_asked_for(block, top, monkeypatch):
    need = memory.needed([(block, top)], "contact-adapted")
    assert 1e6 < need < 1e8
    assert 1.05 * need < memory.needed([(block, top)] * 2, "contact-adapted") < 1.9 * need  # one after the other
    assert memory.needed([(block, top)], "craig-bampton") > memory.needed([(block, top)], "residual")
    free, most = memory.available_memory()
    assert 0 < free <= most
    monkeypatch.setattr(memory, "available_memory", lambda: (0.5 * need, 2 * need))
    with pytest.warns(MemoryWarning, match=r"1560 dofs with 21 patch nodes needs some 0\.0\d+ GB .* Coarsen") as said:
        ep.reduce(block, top, f_cut=80e3)
    assert said[0].filename == __file__
    monkeypatch.setattr(memory, "available_memory", lambda: (0.5 * need, 0.5 * need))
    for reduction in (
        lambda: ep.reduce(block, top, f_cut=80e3),
        lambda: ep.reduce_pair((block, top), (block, top), tolerance=0.1, speed=1.0),
    ):
        with pytest.raises(MemoryLimitError, match="three elements per contact radius are enough"):
            reduction()


def test_a_plastic_zone_is_told_without_a_square_of_its_nodes(block):
    """At most 2.5 times what is kept of the zone; a dense matrix of it would be told as more."""
    soft = replace(block, material=replace(block.material, yield_stress=200e6, hardening=500e6))
    part = ep.Partition.ball(soft, (0, 0, 0.03), 4e-3, plastic_radius=12e-3)
    (zone,), n = ep.reduce(soft, part, f_cut=80e3).basis.zones, 3 * len(part.patches[0].plastic.nodes)
    elastic = replace(part, patches=(replace(part.patches[0], plastic=None),))
    told, without = (memory.needed([(soft, one)], "contact-adapted") for one in (part, elastic))
    assert 0.5 < (told - without) / (zone.own.fronts.store.nbytes + zone.of_patch.nbytes) < 2.5
    assert memory.needed([(soft, part)], "free") == memory.needed([(soft, elastic)], "free")
    assert told - without < 8 * n**2


def test_memory_that_runs_out_is_named(block, top, monkeypatch):
    def full(*_):
        raise MemoryError

    monkeypatch.setattr(free_body.BlockKrylov, "grow", full)
    with pytest.raises(MemoryLimitError, match="memory ran out while reducing 1560 dofs with 21 patch nodes"):
        ep.reduce(block, top, f_cut=80e3)
