"""Tables have the histories of the run, by names and units."""

import numpy as np
import pytest
from oracles import TOP

import exudyn_partition as ep
from exudyn_partition.errors import MissingPackageError

pytest.importorskip("pandas")
pytest.importorskip("xarray")


@pytest.fixture(scope="module")
def run(bodies):
    """A ball falls on a block; another one flies."""
    import exudyn as exu

    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, bodies[0], name="ball", referencePosition=TOP, initialVelocity=[0, 0, -1.0])
    block = ep.CreatePartitionBody(mbs, bodies[1])
    contact = ep.CreatePartitionContact(mbs, ball, block, name="hit")
    mbs.Assemble()
    return ball, contact, ep.solve_dynamic(mbs, end_time=20e-6, step=0.5e-6)


def test_a_table_has_names_and_units(run, tmp_path):
    ball, contact, result = run
    table = result.to_dataframe()
    assert table.index.name == "t [s]"
    np.testing.assert_array_equal(table.index, result.t)
    np.testing.assert_array_equal(table["hit: force [N]"], contact.force(result))
    np.testing.assert_array_equal(table["hit: gap [m]"], contact.gap(result))
    np.testing.assert_array_equal(table["ball: momentum z [N s]"], ball.momentum(result)[:, 2])
    assert "body 1: energy [J]" in table
    assert table.attrs["status"] == "finished"
    table.to_csv(tmp_path / "run.csv")
    assert (tmp_path / "run.csv").read_text().startswith("t [s],hit: force [N],")


def test_a_data_set_has_dimensions(run):
    ball, contact, result = run
    data = result.to_xarray()
    np.testing.assert_array_equal(data.force.sel(contact="hit"), contact.force(result))
    np.testing.assert_array_equal(data.body_momentum.sel(body="ball", axis="z"), ball.momentum(result)[:, 2])
    assert data.force.attrs["units"] == "N"
    assert data.body_energy.dims == ("t", "body")
    assert data.attrs["steps"] == result.steps


def test_what_is_missing_is_named(run, monkeypatch):
    for package, ask in (("pandas", run[-1].to_dataframe), ("xarray", run[-1].to_xarray)):
        monkeypatch.setitem(__import__("sys").modules, package, None)
        with pytest.raises(MissingPackageError, match=f"pip install {package}"):
            ask()
