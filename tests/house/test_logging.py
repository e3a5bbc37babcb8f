"""Log records: what was chosen at INFO, counts at DEBUG, and nothing printed."""

import logging

import netgen.occ as occ

import exudyn_partition as ep


def messages(caplog, module, level):
    """Messages of a module at a level."""
    name = f"exudyn_partition.{module}"
    return [r.getMessage() for r in caplog.records if (r.name, r.levelno) == (name, level)]


def test_what_a_model_and_its_reduction_chose_is_told(caplog, capsys, tmp_path):
    caplog.set_level(logging.DEBUG, logger="exudyn_partition")
    fem = ep.fe_model(occ.Box(occ.Pnt(0, 0, 0), occ.Pnt(0.01, 0.01, 0.01)), ep.STEEL, maxh=6e-3)
    (said,) = messages(caplog, "meshing.ngsolve_fem", logging.INFO)
    assert f"{fem.n_nodes} nodes, {len(fem.cells)} elements of order 2" in said
    part = ep.Partition.ball(fem, (0.005, 0.005, 0.01), 6e-3)
    for _ in range(2):
        body = ep.reduce(fem, part, f_cut=200e3, cache=tmp_path)
    (said,) = messages(caplog, "reduction.reduction", logging.INFO)  # the second comes from the cache
    assert f"{body.n_shapes} shapes" in said
    kept, read = messages(caplog, "support.cache", logging.INFO)
    (path,) = tmp_path.iterdir()
    assert kept.endswith(str(path))
    assert read.endswith(str(path))
    assert kept != read
    sizes = [int(said.split()[2]) for said in messages(caplog, "reduction.free_body", logging.DEBUG)]
    assert sizes == sorted(sizes)
    assert sizes[-1] <= fem.n_dofs
    assert capsys.readouterr() == ("", "")


def test_nobody_hears_it_who_does_not_ask():
    logger = logging.getLogger("exudyn_partition")
    assert not logger.handlers
    assert logger.level == logging.NOTSET
