"""Several contacts on one body: hit on both ends at once, a cradle, and pairs that are found."""

import contextlib
import cProfile
from itertools import pairwise

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
from oracles import MARBLE_RADIUS as R
from oracles import box, relative

import exudyn_partition as ep
from exudyn_partition.errors import EmptyRegionError, InputError, ModelLimitWarning


def three_bars(basis, speeds):
    """Three equal bars that touch, end to end, with these speeds; returns model, bars and contacts."""
    mbs = exu.SystemContainer().AddSystem()
    bar = ep.fe_model(box(0.010, 0.008, 0.030), ep.STEEL, maxh=5e-3)
    top = ep.Partition.ball(bar, (0, 0, 0.03), 8e-3, name="top")
    bottom = ep.Partition.ball(bar, (0, 0, 0), 8e-3, name="bottom")
    body = ep.reduce(bar, bottom | top, basis=basis, f_cut=150e3)
    bars = [
        ep.CreatePartitionBody(
            mbs, body, name=f"bar {i}", referencePosition=[0, 0, 0.03 * i], initialVelocity=[0, 0, v]
        )
        for i, v in enumerate(speeds, start=-1)
    ]
    formulation = "compliance" if basis == "contact-adapted" else "lagrange"
    between = {"slavePatch": "top", "masterPatch": "bottom", "formulation": formulation}
    contacts = [ep.CreatePartitionContact(mbs, *pair, **between) for pair in pairwise(bars)]
    mbs.Assemble()
    return mbs, bars, contacts


def run(mbs, basis, end_time):
    """Nodes with mass lose their approach velocity when they meet; the residual flexibility has none to lose."""
    lost = pytest.warns(ModelLimitWarning, match="have lost .* nodes with mass lose when multipliers stop them")
    with contextlib.nullcontext() if basis == "contact-adapted" else lost:
        return ep.solve_dynamic(mbs, end_time=end_time)


def test_a_contact_that_exudyn_refuses_leaves_the_groups_of_others_as_they_are(monkeypatch):
    """Its items are added before it joins others, so that a run of these knows nothing of it."""
    mbs, bars, contacts = three_bars("contact-adapted", (1.0, 0.0, -1.0))
    groups, together = [[*contact.group] for contact in contacts], contacts[0].together
    with monkeypatch.context() as patch:
        patch.setattr(exu.MainSystem, "AddSensor", refuse)
        with pytest.raises(RuntimeError, match="no more sensors"):
            ep.CreatePartitionContact(mbs, bars[0], ep.RigidPlane((0, 0, -0.031)), slavePatch="bottom")
    assert [[*contact.group] for contact in contacts] == groups
    assert contacts[0].together == together
    plane = ep.CreatePartitionContact(mbs, bars[0], ep.RigidPlane((0, 0, -0.031)), slavePatch="bottom")
    assert {*plane.group} == {*contacts, plane}
    assert contacts[0].together != together


def refuse(mbs, *unused):
    """As Exudyn, where an item cannot be added."""
    raise RuntimeError("no more sensors")


@pytest.mark.parametrize(("basis", "loss"), [("contact-adapted", 5e-3), ("free", 0.05), ("craig-bampton", 0.07)])
@pytest.mark.filterwarnings("ignore:the force rings")
def test_a_body_is_hit_on_both_ends_at_once(basis, loss):
    """A bar between two equal ones that come from both sides: symmetric forces, it stays in place."""
    mbs, bars, contacts = three_bars(basis, (1.0, 0.0, -1.0))
    result = run(mbs, basis, 12e-6)
    forces = [contact.force(result) for contact in contacts]
    assert forces[0].max() > 100
    assert relative(forces[0], forces[1]) < 0.1  # the mesh is not symmetric
    momentum = [bar.momentum(result)[-1, 2] - bar.momentum(result)[0, 2] for bar in bars]
    assert abs(sum(momentum)) < 1e-9 * abs(momentum[0])
    energy = sum(item.energy(result) for item in (*bars, *contacts))
    np.testing.assert_allclose(energy, energy[0], rtol=loss)


@pytest.mark.filterwarnings("ignore:the force rings")
def test_a_cradle_of_bars_whose_shapes_move_both_patches():
    """Craig-Bampton: multipliers of two contacts are one problem, with the impulses of another basis."""
    impulses = []
    for basis in ("craig-bampton", "contact-adapted"):
        mbs, bars, contacts = three_bars(basis, (1.0, 0.0, 0.0))
        result = run(mbs, basis, 26e-6)
        assert result.status == "finished"
        momentum = [bar.momentum(result)[:, 2] for bar in bars]
        np.testing.assert_allclose(sum(momentum), momentum[0][0], rtol=1e-9)
        impulses.append([result.history(contact).impulse for contact in contacts])
        assert momentum[2][-1] > 0.9 * momentum[0][0]
    np.testing.assert_allclose(*impulses, rtol=0.05)


def row_of(mbs, marble, places):
    """Marbles in some places along z."""
    return [
        ep.CreatePartitionBody(mbs, marble, referencePosition=[0, 0, z], initialVelocity=[0, 0, -40 * z])
        for z in places
    ]


def test_pairs_of_many_bodies_are_found(marble):
    """They are those that a user would name, whatever the order of the bodies is; one ball is too far away."""
    d, force = 2 * R, []
    for found in (True, False):
        mbs = exu.SystemContainer().AddSystem()
        first, second, far, third = row_of(mbs, marble, [0, d, 4 * d, 2 * d])
        if found:
            contacts = ep.CreatePartitionContact(mbs, [first, second, far, third], name="touch")
            assert [contact.name for contact in contacts] == ["touch 1", "touch 2"]
        else:
            named = {"slavePatch": "north", "masterPatch": "south"}
            contacts = [ep.CreatePartitionContact(mbs, *two, **named) for two in ((first, second), (second, third))]
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=12e-6, step=0.1e-6)
        force.append([contact.force(result) for contact in contacts])
    np.testing.assert_array_equal(*force)
    assert (np.max(force, axis=2) > 1.0).all()


def test_contacts_of_a_chain_take_the_same_effort_each(mbs, marble):
    """Calls of functions are counted. A group that is formed anew for each contact makes more for later ones."""
    balls, calls = row_of(mbs, marble, [2 * R * i for i in range(16)]), []
    for pair in pairwise(balls):
        profile = cProfile.Profile()
        with profile:
            contact = ep.CreatePartitionContact(mbs, *pair, slavePatch="north", masterPatch="south")
        calls.append(sum(entry.callcount for entry in profile.getstats()))
    assert len(contact.group) == 15
    assert calls[-1] < calls[4] + 5


def test_a_contact_that_joins_two_groups_lets_them_be_solved_together(mbs, marble):
    """Whichever of the groups is larger, and as in the order of the chain: forces of an impact are the same."""
    d, forces = 2 * R, []
    for order in ([0, 1, 2, 3], [0, 1, 3, 2], [3, 0, 2, 1]):
        mbs = exu.SystemContainer().AddSystem()
        balls = row_of(mbs, marble, [0, d, 2 * d, 3 * d, 4 * d])
        named = {"slavePatch": "north", "masterPatch": "south"}
        contacts = {i: ep.CreatePartitionContact(mbs, balls[i], balls[i + 1], **named) for i in order}
        assert all({*contact.group} == {*contacts.values()} for contact in contacts.values())
        assert len({id(contact.together) for contact in contacts.values()}) == 1
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=4e-6, step=0.2e-6)
        forces.append([contacts[i].force(result) for i in range(4)])
    assert np.max(forces[0]) > 1.0
    for force in forces[1:]:
        np.testing.assert_allclose(force, forces[0], rtol=1e-8, atol=1e-8 * np.max(forces[0]))


def test_how_near_pairs_are_can_be_given(mbs, marble):
    balls = row_of(mbs, marble, [0, 3 * R])
    with pytest.raises(EmptyRegionError, match="no two patches of these 2 bodies face each other nearby"):
        ep.CreatePartitionContact(mbs, balls)
    assert len(ep.CreatePartitionContact(mbs, balls, within=1.1 * R)) == 1


def test_patches_that_look_away_from_each_other_are_no_pair(mbs, marble):
    """Two balls overlap, pole to pole: the north of each is near, but no pole faces it."""
    first, second = row_of(mbs, marble, [0]) + row_of(mbs, marble, [1e-4])
    with pytest.raises(EmptyRegionError):
        ep.CreatePartitionContact(mbs, [first, second])


def test_wrong_sequences_of_bodies(mbs, marble):
    balls = row_of(mbs, marble, [0, 2 * R])
    for wrong, match in (
        ((5,), "slave: expected a list"),
        (([balls[0], "ball"],), "at index 1"),
        (([balls[0]],), "at least one body and something"),
        (([balls[0]] * 2,), "each of them once"),
        ((balls[0],), "master: expected"),
    ):
        with pytest.raises(InputError, match=match):
            ep.CreatePartitionContact(mbs, *wrong)
    with pytest.raises(InputError, match="all patches are looked at"):
        ep.CreatePartitionContact(mbs, balls, slavePatch="north")
    with pytest.raises(InputError, match="within: only for a sequence"):
        ep.CreatePartitionContact(mbs, *balls, within=1.0)
    with pytest.raises(InputError, match="within: expected"):
        ep.CreatePartitionContact(mbs, balls, within=-1.0)


def test_a_patch_takes_one_contact_of_most_formulations(mbs, link):
    body = ep.reduce(link, ep.Partition.ball(link, (0.005, 0, 0.03), 5e-3, name="side"), f_cut=60e3)
    ball = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), 5e-3), ep.STEEL, maxh=2e-3)
    ball_body = ep.reduce(ball, ep.Partition.ball(ball, (-5e-3, 0, 0), 2e-3), f_cut=300e3)
    target = ep.CreatePartitionBody(mbs, body)
    balls = [ep.CreatePartitionBody(mbs, ball_body, referencePosition=[0.0101, 0, 0.03]) for _ in range(2)]
    ep.CreatePartitionContact(mbs, balls[0], target, masterPatch=0, formulation="penalty")
    with pytest.raises(InputError, match="its patch 0 already has the contact"):
        ep.CreatePartitionContact(mbs, balls[1], target, masterPatch="side", formulation="penalty")
    with pytest.raises(InputError, match=r"^masterPatch: expected the name or number of one of the 1 contact patches"):
        ep.CreatePartitionContact(mbs, balls[1], target, masterPatch="back")
