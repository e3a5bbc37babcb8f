"""Tables have the histories of the run, by names and units."""

import exudyn as exu
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


def test_each_column_has_its_unit(run):
    table = run[-1].to_dataframe()
    units = table.attrs["units"]
    assert set(units) == {*table.columns, "t [s]"}
    assert all(column.endswith(f" [{unit}]") for column, unit in units.items())


def test_bodies_have_places_and_velocities(run):
    """The velocity is the change of the place, and begins with what the ball was given."""
    ball, _, result = run
    table = result.to_dataframe()
    place, velocity = (table[f"ball: {name}"] for name in ("place of centre z [m]", "velocity of centre z [m/s]"))
    assert place.iloc[0] == pytest.approx(TOP[2] + ball.body.centre_of_mass[2], rel=1e-12)
    assert velocity.iloc[0] == pytest.approx(-1.0, rel=1e-9)
    np.testing.assert_allclose(np.gradient(place, result.t)[1:-1], velocity[1:-1], rtol=1e-3)


def test_a_body_that_spins_has_its_rotation(bodies):
    """Free, about an axis of inertia: by its angular velocity times time."""
    mbs = exu.SystemContainer().AddSystem()
    spin = [0, 0, 300.0]
    ep.CreatePartitionBody(mbs, bodies[0], name="ball", frame="floating", initialAngularVelocity=spin)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=1e-3, step=2e-6)
    table = result.to_dataframe()
    np.testing.assert_allclose(table["ball: rotation vector z [rad]"], 300.0 * result.t, atol=1e-3)


def test_contacts_have_forces_areas_and_pressures(run):
    _, contact, result = run
    table = result.to_dataframe()
    np.testing.assert_array_equal(table["hit: closed rows [1]"] > 0, table["hit: force [N]"] > 0)
    np.testing.assert_array_equal(table["hit: force on slave z [N]"], contact.force_on_slave(result)[:, 2])
    np.testing.assert_array_equal(table["hit: contact area [m2]"], contact.area(result))
    assert table["hit: largest pressure [Pa]"].max() == contact.pressure(result).max() > 0


def test_a_result_without_its_model_has_what_it_knows(run, tmp_path):
    run[-1].save(tmp_path / "run.npz")
    table, alone = run[-1].to_dataframe(), ep.Result.load(tmp_path / "run.npz").to_dataframe()
    assert set(alone) < set(table)
    np.testing.assert_array_equal(alone["ball: momentum z [N s]"], table["ball: momentum z [N s]"])


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
