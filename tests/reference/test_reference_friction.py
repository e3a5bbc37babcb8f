"""The full FE reference with friction: conservation, stick and slip, and limits that are known."""

import dataclasses

import numpy as np
import pytest
from oracles import hexahedra, relative, write

import exudyn_partition as ep
from exudyn_partition.errors import InputError
from exudyn_partition.reference.laws import Frictional
from exudyn_partition.surfaces.rows import pair_surfaces

SPEED = 0.5  # [m/s]


def block(path, n, shape=lambda points: points):
    """A steel block of hexahedra, whose points are mapped, and its lower or upper face around the origin."""
    points, cells = hexahedra(*n)
    points = shape(points)
    if points[:, 2].min() < 0:
        cells = cells[:, [4, 5, 6, 7, 0, 1, 2, 3]]  # mirrored
    fem = ep.fe_model(write(path, points, cells), ep.STEEL)
    return fem, ep.Partition.ball(fem, (0, 0, 0), 0.02)


def crowned(points):
    """The lower face curved by a radius of 2 m."""
    z = (points[:, 0] ** 2 + points[:, 1] ** 2) / 4.0
    return points + np.outer(z * (1 - points[:, 2] / points[:, 2].max()), [0, 0, 1])


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """A block with a slightly curved face that touches a wider one."""
    folder = tmp_path_factory.mktemp("blocks")
    below = block(folder / "lower.vtu", (5, 5, 3), lambda points: points * [1.3, 1.3, -1])
    return block(folder / "upper.vtu", (4, 4, 3), crowned), below


def simulate(pair, tangential, friction, end_time=30e-6, **options):
    """Impact of the upper block with a tangential velocity along x [m/s]."""
    bodies = [ep.reference.FullBody(*pair[0], velocity=(tangential, 0, -SPEED)), ep.reference.FullBody(*pair[1])]
    return ep.reference.simulate(bodies, end_time=end_time, step=0.3e-6, friction=friction, **options)


@pytest.fixture(scope="module")
def partial(pair):
    """An impact that sticks at first, and then slips."""
    return simulate(pair, 0.3, 0.3, alpha=0.0)


def test_energy_goes_into_friction_and_comes_from_nowhere(pair, partial):
    """Without numerical damping, only rows that close take some more, as much as without friction."""
    smooth = simulate(pair, 0.3, None, alpha=0.0)
    closing = smooth.info["energy_error"]
    assert -0.01 < closing < 0
    assert partial.info["energy_error"] == pytest.approx(closing, rel=1e-4)
    assert partial.info["dissipated_J"] == partial.dissipated[-1] > 1e-3 * energy(pair)
    assert partial.dissipated[-1] < energy(pair)
    assert np.diff(partial.dissipated).min() > -1e-12 * partial.dissipated[-1]
    early = simulate(pair, 0.3, 0.3, 10e-6, alpha=0.0)  # while both bodies are deformed
    assert closing - 1e-6 < early.info["energy_error"] < 1e-9


def energy(pair):
    """Kinetic energy at the start [J]."""
    return 0.5 * pair[0][0].mass.sum() / 3 * (0.3**2 + SPEED**2)


def test_the_law_holds_in_sum(partial):
    tangential = np.linalg.norm(partial.tangential_force, axis=1)
    assert (tangential <= 0.3 * partial.force * (1 + 1e-9)).all()
    assert tangential.max() > 0.1 * partial.peak_force
    assert abs(partial.tangential_force[:, 1:]).max() < 0.1 * tangential.max()
    assert len(partial.info["row_states"]) == len(partial.info["slip_path_m"]) == partial.info["contact_nodes"]
    assert max(partial.info["slip_path_m"]) > 0


def test_full_slip_has_the_kinetic_coefficient(pair):
    for law, mu in ((ep.Coulomb(static=0.3, kinetic=0.2), 0.2), (ep.Coulomb(0.3, 0.2, decay=1e3), 0.3)):
        history = simulate(pair, 5.0, law, 9e-6)
        np.testing.assert_allclose(history.tangential_force[20:, 0], -mu * history.force[20:], rtol=2e-3)
        assert history.info["friction"] == dataclasses.asdict(law)


def test_no_coefficient_is_no_friction_to_the_last_bit(pair):
    smooth, zero, tiny = (simulate(pair, 0.3, friction, 9e-6) for friction in (None, 0.0, 1e-12))
    np.testing.assert_array_equal(smooth.force, zero.force)
    assert zero.tangential_force is zero.dissipated is None
    assert "row_states" not in zero.info
    assert relative(tiny.force, smooth.force) < 1e-9


def test_mirrored_bodies_do_not_slip(tmp_path):
    """Equal blocks on equal meshes, head-on: Poisson's effect moves both faces sideways alike."""
    upper = block(tmp_path / "upper.vtu", (2, 2, 3))
    lower = block(tmp_path / "lower.vtu", (2, 2, 3), lambda points: points * [1, 1, -1])
    bodies = [ep.reference.FullBody(*of, velocity=(0, 0, v)) for of, v in ((upper, -0.1), (lower, 0.1))]
    rough, smooth = (ep.reference.simulate(bodies, end_time=2e-5, step=5e-7, friction=mu) for mu in (0.5, None))
    assert abs(rough.tangential_force).max() < 1e-9 * rough.peak_force
    assert relative(rough.force, smooth.force) < 1e-9


def test_motions_of_both_bodies_together_move_no_row(pair):
    """So contact changes neither their momentum nor, where they touch, their angular momentum."""
    slave, master = (ep.reference.FullBody(*of).surface for of in pair)
    rows = pair_surfaces(slave, master)
    law = Frictional(rows, [len(slave.points), len(master.points)], 1, friction=ep.Coulomb(0.3), step=1e-6)

    def moved(motion):
        parts = zip(law.matrices, (slave, master), strict=True)
        return sum(G @ motion(side.points).ravel() for G, side in parts).reshape(-1, 3)

    assert abs(moved(lambda x: np.tile([1.0, 2.0, 3.0], (len(x), 1)))).max() < 1e-12
    spin = np.array([0.6, -0.8, 0.5])
    by_turn = np.linalg.norm(moved(lambda x: np.cross(spin, x)), axis=1)
    assert (by_turn < 1.01 * np.linalg.norm(spin) * rows.gap).all()  # the way between the points of a pair


def test_wrong_friction(pair):
    for friction, message in (
        (-0.1, "0 to 10"),
        (np.nan, "friction"),
        ("0.3", "expected a coefficient"),
        (True, "True: truth values are no numbers"),
    ):
        with pytest.raises(InputError, match=message):
            simulate(pair, 0.0, friction)
    with pytest.raises(InputError, match="kinetic: expected at most"):
        dataclasses.replace(ep.Coulomb(0.2), kinetic=0.3)
