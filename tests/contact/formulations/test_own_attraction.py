"""A law that pulls, from the contributing page alone: surfaces attract each other within its reach."""

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
from oracles import MARBLE_RADIUS as R
from oracles import contributed, energy_by_start, inertial

import exudyn_partition as ep
from exudyn_partition.contact.patch_contact import PatchContact
from exudyn_partition.contact.patch_gaps import PatchGaps
from exudyn_partition.errors import InputError

page = contributed("class Attraction(Law)")
Attractions, Attraction, REACH, STRENGTH = (page[name] for name in ("Attractions", "Attraction", "REACH", "STRENGTH"))
FACE = 4e-3  # edge of the faces that are pulled apart [m]


@pytest.fixture(scope="module")
def brick():
    """A small steel block with its lower and its upper face as patches."""
    fem = ep.fe_model(occ.Box(occ.Pnt(-FACE / 2, -FACE / 2, 0), occ.Pnt(FACE / 2, FACE / 2, 3e-3)), ep.STEEL, maxh=2e-3)
    lower, upper = (ep.Partition.ball(fem, (0, 0, z), 1.6e-3, name=name) for z, name in ((0, "lower"), (3e-3, "upper")))
    return ep.reduce(fem, lower | upper, f_cut=400e3)


def traction(gap):
    """Traction by the gap, (k,) [Pa]: pulls are positive."""
    s = np.minimum(gap / REACH, 1.0)
    return 6.75 * STRENGTH * s * np.where(s > 0, (1 - s) ** 2, 1.0)


def brute_work():
    """Area under the curve [J/m2]."""
    gap = np.linspace(0, REACH, 100_001)
    return np.trapezoid(traction(gap), gap)


def pull_off(brick, method="explicit", frame="inertial", on_brick=False, speed=1.0, end=16e-6, **how):
    """Two faces that touch part: from a plane, or from another block."""
    mbs = exu.SystemContainer().AddSystem()
    place = {"referencePosition": [0, 0, 0], "initialVelocity": [0, 0, speed]}
    items = [ep.CreatePartitionBody(mbs, brick, frame=frame, name="upper", **place)]
    other, patches = ep.RigidPlane(), {"slavePatch": "lower"}
    if on_brick:
        other = ep.CreatePartitionBody(mbs, brick, frame=frame, name="lower", referencePosition=[0, 0, -3e-3])
        items, patches = [*items, other], {**patches, "masterPatch": "upper"}
    contact = ep.CreatePartitionContact(mbs, items[0], other, formulation=Attractions(), name="glue", **patches)
    mbs.Assemble()
    how = {"step": 0.05e-6, **how}
    return ep.solve_dynamic(mbs, end_time=end, method=method, **how), items, contact


@pytest.mark.parametrize(
    ("method", "frame", "on_brick"),
    [
        ("explicit", "inertial", False),
        ("explicit", "floating", False),
        ("implicit", "inertial", False),
        ("explicit", "inertial", True),
        ("explicit", "floating", True),
    ],
)
def test_the_work_of_separation_is_the_area_under_the_curve(brick, method, frame, on_brick):
    result, items, contact = pull_off(brick, method, frame, on_brick)
    area = contact.mechanics.gaps.all_points.node_areas.sum()
    energy = sum(item.energy(result) for item in items)
    assert contact.force(result).min() < -0.9 * STRENGTH * area
    assert contact.gap(result)[-1] > REACH
    assert contact.force(result)[-1] == contact.energy(result)[-1] == 0.0
    assert energy[0] - energy[-1] == pytest.approx(brute_work() * area, rel=1e-3)
    assert abs(energy_by_start(items, contact, result) - 1).max() < 1e-3
    momentum = sum(item.momentum(result) for item in items)
    impulse = np.trapezoid(contact.force_on_slave(result), result.t, axis=0) * (0.0 if on_brick else 1.0)
    np.testing.assert_allclose(momentum[-1] - momentum[0], impulse, rtol=0, atol=1e-4 * abs(momentum[0]).max())
    assert not result.warnings


@pytest.mark.filterwarnings("ignore:contact 'glue' reached the edge")  # it springs back on a part of a face
def test_what_is_too_slow_stays(brick):
    """With less energy than the work of separation."""
    area = np.pi * 1.6e-3**2
    speed = np.sqrt(0.5 * 2 * brute_work() * area / brick.total_mass)
    result, items, contact = pull_off(brick, speed=speed, end=60e-6)
    assert contact.gap(result).max() < REACH
    assert abs(energy_by_start(items, contact, result) - 1).max() < 1e-2


def fall(marble, frame="inertial", plate=None, method="explicit", speed=-0.1, **how):
    """A ball that nears a plane, or a plate, from out of reach."""
    mbs = exu.SystemContainer().AddSystem()
    place = {"referencePosition": [0, 0, R + 1.2 * REACH], "initialVelocity": [0.05, 0, speed]}
    item = ep.CreatePartitionBody(mbs, marble, frame=frame, **place)
    items, other = [item], ep.RigidPlane()
    if plate is not None:
        other = ep.CreatePartitionBody(mbs, plate, frame=frame)
        items = [item, other]
    contact = ep.CreatePartitionContact(mbs, item, other, slavePatch="south", formulation=Attractions())
    mbs.Assemble()
    how = {"step": 0.2e-6, **how}
    return ep.solve_dynamic(mbs, end_time=90e-6, method=method, **how), items, contact


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.YieldWarning")
@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_rows_within_reach_are_present(marble, flat_body, frame):
    """The force at the coordinates of each sample is that of all rows of the patch, near or far."""
    result, items, contact = fall(marble, frame, flat_body)
    force = contact.force(result)
    assert force.min() < -0.05
    q = np.hstack([item.coordinates(result) for item in items])
    gaps = contact.mechanics.gaps.for_run()
    for sample in range(0, len(q), 25):
        rows, _ = gaps.project(*gaps.sides.places(q[sample]))
        right = -(rows.points.area @ traction(rows.gap))
        assert force[sample] == pytest.approx(right, rel=1e-3, abs=2e-3 * abs(force).max())
    assert abs(energy_by_start(items, contact, result) - 1).max() < 1e-3


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.YieldWarning")
def test_steps_become_short_where_forces_begin(marble):
    """Adaptive steps end before the surfaces are within reach, not before they touch."""
    fixed, _, glue = fall(marble)
    adaptive, _, contact = fall(marble, adaptive=True)
    force, right = contact.force(adaptive), glue.force(fixed)
    at_once = np.flatnonzero(force)[0]
    assert adaptive.t[at_once] - adaptive.t[at_once - 1] < 1.5 * 0.2e-6
    np.testing.assert_allclose(np.interp(fixed.t, adaptive.t, force), right, rtol=0, atol=0.02 * abs(right).max())


def test_time_to_contact_is_that_until_forces_begin(marble):
    _, (item,), contact = fall(marble)
    q, q_t = np.zeros(item.body.n_dofs), item.body.rigid[:, :3] @ [0, 0, -0.1]
    gap = contact.mechanics.gaps.for_run().at(q).min()
    assert ep.time_to_contact(contact, q, q_t) == pytest.approx((gap - REACH) / 0.1, rel=1e-6)


def test_a_reach_that_rows_cannot_follow_is_refused(round_body, flat_body):
    sides = inertial(round_body), inertial(flat_body)

    def reaching(reach, **more):
        law = type("Far", (Attraction,), {"reach": reach, **more})
        return type("Fars", (Attractions,), {"law": lambda self, rows: law(rows)})()

    gaps = PatchGaps(*sides)
    with pytest.raises(InputError, match=r"law: expected a reach from 0 to .* m, up to which rows follow patches"):
        PatchContact(gaps, reaching(0.51 * gaps.size))
    with pytest.raises(InputError, match="law: expected a reach from 0"):
        PatchContact(gaps, reaching(-1e-6))
    with pytest.raises(InputError, match="law Far: it acts ahead of steps, where no law has a reach"):
        PatchContact(gaps, reaching(1e-6, ahead=True))
    assert PatchContact(gaps, reaching(0.49 * gaps.size)).reach == 0.49 * gaps.size


def test_the_tangent_is_the_slope_of_the_force(round_body, flat_body):
    """Also where the traction falls."""
    sides = inertial(round_body), inertial(flat_body)
    contact, rng = PatchContact(PatchGaps(*sides), Attractions()), np.random.default_rng(0)
    rigid = sides[0].kinematics.body.rigid[:, 2]
    for height in (-1e-6, 0.2 * REACH, 0.7 * REACH):
        q = np.r_[height * rigid, np.zeros(sides[1].n)]
        answer = contact.at(q)
        H, tangent = answer.row_jacobian(), answer.tangent()
        way = rng.standard_normal(len(q))
        way *= 1e-6 * REACH / abs(H @ way).max()
        slope = (contact.at(q + way).generalised - contact.at(q - way).generalised) / 2
        np.testing.assert_allclose(-tangent @ way, slope, rtol=0, atol=1e-3 * abs(slope).max())


def test_energy_that_jumps_where_forces_begin_is_named(round_body, flat_body):
    """The law pulls, but its reach was forgotten: its energy is not zero where surfaces touch."""

    class Short(Attraction):
        reach = 0.0

    class Shorts(Attractions):
        def law(self, rows):
            return Short(rows)

    contact = PatchContact(PatchGaps(inertial(round_body), inertial(flat_body)), Shorts())
    with pytest.raises(InputError, match="law Short: expected a stored energy of zero where its forces begin"):
        contact.press(np.full(len(contact.gaps.row_nodes), -1e-9))


def test_pressing_rows_are_the_area_and_all_rows_within_reach_are_closed(brick):
    result, _, contact = pull_off(brick)
    pulls = contact.force(result) < 0
    assert pulls.sum() > 10
    assert (contact.closed_rows(result)[pulls] > 0).all()
    assert (contact.area(result)[pulls] == 0.0).all()
