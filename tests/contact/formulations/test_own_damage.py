"""A law whose rows remember, from the contributing page alone: glue that stays damaged."""

from itertools import pairwise

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
from oracles import contributed, energy_by_start, inertial

import exudyn_partition as ep
from exudyn_partition.contact.law import Forces
from exudyn_partition.contact.patch_contact import PatchContact
from exudyn_partition.contact.rigid import RigidGaps
from exudyn_partition.errors import InputError

page = contributed("class Damaged(Law)")
Glue, Damaged, STRENGTH, BEGINS, ENDS, TOUGHNESS = (
    page[name] for name in ("Glue", "Damaged", "STRENGTH", "BEGINS", "ENDS", "TOUGHNESS")
)
FACE, STEP = 4e-3, 0.05e-6  # edge of the faces that are glued [m], and time step [s]


@pytest.fixture(scope="module")
def brick():
    """A small steel block with its lower face as a patch."""
    fem = ep.fe_model(occ.Box(occ.Pnt(-FACE / 2, -FACE / 2, 0), occ.Pnt(FACE / 2, FACE / 2, 3e-3)), ep.STEEL, maxh=2e-3)
    return ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 1.6e-3), f_cut=400e3)


def made_by(law):
    """A formulation whose law is of this class."""

    class Made(Glue):
        def law(self, rows):
            return law(rows)

    return Made()


def traction(opening, largest):
    """Pull of glue, (k,) [Pa], at an opening up to the largest one so far: along a line from there to zero."""
    at_largest = STRENGTH * np.interp(largest, [0, BEGINS, ENDS], [0, 1, 0])
    return np.where(opening < ENDS, at_largest * opening / np.maximum(largest, 1e-30), 0.0)


def glued(brick, speed):
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, brick, initialVelocity=[0, 0, speed])
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), formulation=Glue(), name="glue")
    mbs.Assemble()
    return mbs, item, contact


def swinging(brick):
    """Speed with which glue opens, is damaged, and holds [m/s]."""
    return float(np.sqrt(0.6 * 2 * TOUGHNESS * np.pi * 1.6e-3**2 / brick.total_mass))


def test_rows_open_load_and_unload_by_the_curve(brick):
    """A block that moves as if rigid: the work of the pulls is what glue stores and what it has taken."""
    contact = PatchContact(RigidGaps(inertial(brick), ep.RigidPlane()), Glue())
    area, rigid = contact.gaps.area, brick.rigid[:, 2]
    largest, work, before, t = 0.0, 0.0, np.zeros(len(area)), 0.0
    turns = 1e-6 * np.array([0, 2, 0.3, 3, 5])
    way = np.concatenate([np.linspace(start, end, 400) for start, end in pairwise(turns)])
    for opening, moved in zip(way, np.diff(way, prepend=0.0), strict=True):
        contact.accept(t)
        contact.at((opening + 1e-6) * rigid)  # a place that is given up
        contact.begin()
        answer = contact.at(opening * rigid)
        t, largest = t + STEP, max(largest, opening)
        np.testing.assert_allclose(-answer.lam, area * traction(opening, largest), rtol=1e-6, atol=1e-9)
        work, before = work - 0.5 * moved * float((answer.lam + before).sum()), answer.lam
        assert answer.stored + answer.law_work(t) == pytest.approx(work, rel=2e-3, abs=1e-3 * TOUGHNESS * area.sum())
    assert answer.law_work(t) == pytest.approx(TOUGHNESS * area.sum(), rel=1e-12)
    contact.accept(t)
    back = contact.at(0.1 * BEGINS * rigid)  # nothing holds any more
    assert abs(back.lam).max() == back.stored == 0.0


@pytest.mark.filterwarnings("ignore:contact 'glue' reached the edge")
@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_what_breaks_takes_the_work_of_separation(brick, method):
    mbs, item, contact = glued(brick, 1.5)
    result = ep.solve_dynamic(mbs, end_time=12e-6, step=STEP, method=method)
    area = contact.mechanics.gaps.all_points.node_areas.sum()
    energy = item.energy(result)
    assert energy[0] - energy[-1] == pytest.approx(TOUGHNESS * area, rel=2e-3)
    assert contact.dissipated_energy(result)[-1] == pytest.approx(TOUGHNESS * area, rel=1e-9)
    assert contact.force(result).min() == pytest.approx(-STRENGTH * area, rel=0.05)
    assert abs(energy_by_start([item], contact, result) - 1).max() < 2e-3


@pytest.mark.filterwarnings("ignore:contact 'glue' reached the edge")
def test_glue_that_held_once_is_softer_for_ever(brick):
    """Also in a run that goes on from a file, which is the same as one run."""
    mbs, item, contact = glued(brick, swinging(brick))
    whole = ep.solve_dynamic(mbs, end_time=40e-6, step=STEP)
    gap, force = contact.gap(whole), contact.force(whole)
    peaks = np.flatnonzero((gap[1:-1] > gap[:-2]) & (gap[1:-1] >= gap[2:]) & (gap[1:-1] > BEGINS)) + 1
    assert len(peaks) >= 2
    assert gap.max() < ENDS
    area = contact.mechanics.gaps.all_points.node_areas.sum()
    again = slice(peaks[0] + 1, peaks[1])  # it opens again, no further than before
    ratio = -force[again] / (area * np.maximum(gap[again], 1e-12))
    pulled = gap[again] > 0.2e-6
    np.testing.assert_allclose(ratio[pulled] * gap[peaks[0]], traction(gap[peaks[0]], gap[peaks[0]]), rtol=0.05)
    assert abs(energy_by_start([item], contact, whole) - 1).max() < 5e-3


@pytest.mark.filterwarnings("ignore:contact 'glue' reached the edge")
def test_damage_goes_through_files(brick, tmp_path):
    speed = swinging(brick)
    mbs, _, contact = glued(brick, speed)
    whole = contact.force(ep.solve_dynamic(mbs, end_time=20e-6, step=STEP))
    first, _, _ = glued(brick, speed)
    ep.solve_dynamic(first, end_time=10e-6, step=STEP).save(tmp_path / "run")
    second, _, contact = glued(brick, speed)
    end = ep.Result.load(tmp_path / "run", second)
    rest = ep.solve_dynamic(second, end_time=20e-6, step=STEP, go_on=end)
    np.testing.assert_allclose(contact.force(rest), whole[-len(rest.t) :], rtol=0, atol=1e-9 * abs(whole).max())


def test_memories_that_cannot_be_are_refused(brick):
    gaps = RigidGaps(inertial(brick), ep.RigidPlane())

    def contact(**more):
        return PatchContact(gaps, made_by(type("Wrong", (Damaged,), more)))

    with pytest.raises(InputError, match="law Wrong: it acts ahead of steps, where no law has a reach or a memory"):
        contact(ahead=True)
    with pytest.raises(InputError, match="law Wrong: it has a memory, which only laws with elastic = False have"):
        contact(elastic=True)
    none = np.zeros((len(gaps.row_nodes), 1)), np.empty(0, int)
    for answer, said in (
        (Forces(*none, memory=none[0][:, 0]), "expected a memory of shape"),
        (Forces(*none), "expected a memory of shape .*, got None"),
        (tuple(none), "expected an answer of type contact.law.Forces, got tuple"),
    ):
        with pytest.raises(InputError, match=f"law Wrong: {said}"):
            contact(answer=lambda self, places, answer=answer: answer).at(np.zeros(brick.n_dofs))
