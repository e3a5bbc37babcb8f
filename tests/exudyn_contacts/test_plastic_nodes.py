"""Plastic zones in the paper's basis, whose nodes are coordinates with mass: multipliers in explicit steps."""

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
from oracles import energy_by_start, small_zone

import exudyn_partition as ep
from exudyn_partition.errors import InputError, RunError

MATERIAL = ep.Material(E=70e9, nu=0.33, rho=2700.0, yield_stress=200e6, hardening=500e6)
RADIUS, SPEED, END = 1e-3, 0.7, 8e-6
LAGRANGE = {"formulation": "lagrange", "rows": "integrated"}


@pytest.fixture(scope="module")
def models():
    """A small plate, all of which is impact region and in part may yield, beneath a coarse steel punch."""
    fine = [ep.Refine((0, 0, 0), 0.2e-3, 0.08e-3)]
    steel = ep.Material(E=210e9, nu=0.3, rho=7850.0)
    ball = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, RADIUS), RADIUS), steel, maxh=1e-3, refine=fine, grading=0.9)
    box = occ.Box(occ.Pnt(-8e-4, -8e-4, -6e-4), occ.Pnt(8e-4, 8e-4, 0))
    plate = ep.fe_model(box, MATERIAL, maxh=1e-3, refine=fine, grading=0.9)
    return [
        (ball, ep.Partition.ball(ball, (0, 0, 0), 1.0, contact_radius=0.13e-3, direction=(0, 0, -1))),
        (plate, ep.Partition.ball(plate, (0, 0, 0), 1.0, contact_radius=0.2e-3, direction=(0, 0, 1),
                                  plastic_radius=0.2e-3)),
    ]  # fmt: skip


@pytest.fixture(scope="module")
def bodies(models):
    return [ep.reduce(*model, basis="free", f_cut=1e6) for model in models]


def pair(bodies, *, frame="inertial", velocity=(0, 0, -SPEED), states=None, **options):
    """Model, items and contact of the punch on the plate."""
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=velocity, frame=frame, name="ball")
    plate = ep.CreatePartitionBody(mbs, bodies[1], frame=frame, name="plate", plasticStates=states)
    contact = ep.CreatePartitionContact(mbs, ball, plate, passes="given", **LAGRANGE, **options)
    mbs.Assemble()
    return mbs, (ball, plate), contact


def solve(mbs, end, **options):
    """Result of a run."""
    with small_zone():
        return ep.solve_dynamic(mbs, end_time=end, sample_period=5e-8, **options)


def fall(bodies, *, end=END, **options):
    """Items, contact and result of the punch on the plate."""
    mbs, items, contact = pair(bodies, **options)
    return items, contact, solve(mbs, end)


@pytest.fixture(scope="module")
def run(bodies):
    return fall(bodies)


def test_an_impact_region_of_all_nodes_is_the_full_fe_model(models, run):
    _, contact, result = run
    full = [
        ep.reference.FullBody(*model, velocity=v, mass="lumped")
        for model, v in zip(models, ((0, 0, -SPEED), (0, 0, 0)), strict=True)
    ]
    reference = ep.reference.simulate(full, end_time=result.t[-1], step=2e-8, alpha=0.0)
    assert ep.compare(result.history(contact), reference).error["force"] < 0.01
    assert contact.plastic.work(result)[-1] == pytest.approx(reference.info["plastic_work_J"][0], rel=5e-3)
    assert contact.plastic.strain(result)[-1] == pytest.approx(reference.info["plastic_strain"][0], rel=2e-2)


def test_energy_is_kept(run):
    items, contact, result = run
    assert contact.plastic.work(result)[-1] > 0.03 * items[0].energy(result)[0]
    assert energy_by_start(*run)[-1] == pytest.approx(1.0, abs=1e-4)
    momentum = sum(item.momentum(result) for item in items)
    np.testing.assert_allclose(momentum, momentum[:1].repeat(len(momentum), 0), atol=1e-9 * abs(momentum).max())


def test_floating_frames_agree(bodies, run):
    """Samples lie up to a step beside each other; the last force is that of the step before it alone."""
    _, contact, result = fall(bodies, frame="floating", end=1.5e-6)
    expected = np.interp(result.t, run[2].t, run[1].force(run[2]))
    np.testing.assert_allclose(contact.force(result)[:-1], expected[:-1], atol=1e-2 * expected.max())
    strain = np.interp(result.t[-1], run[2].t, run[1].plastic.strain(run[2]))
    assert contact.plastic.strain(result)[-1] == pytest.approx(strain, rel=2e-2)
    assert strain > 1e-3


def test_a_dented_body_rests_and_the_next_run_knows_its_dent(bodies, run):
    items, contact, result = run
    state = contact.plastic.states(result)["master"]
    slow = fall(bodies, velocity=(0, 0, -1e-9), states={0: state}, end=2e-7)
    q = slow[0][1].coordinates(slow[2])
    assert abs(q[0]).max() > 0
    np.testing.assert_allclose(q, q[:1].repeat(len(q), 0), atol=1e-6 * abs(q[0]).max())
    assert slow[1].plastic.work(slow[2])[-1] == 0.0
    moved = items[1].displacement(result, (0, 0, 0))[-1] - items[1].displacement(result, (0, 0, -6e-4))[-1]
    assert contact.plastic.dents(result)["master"] == pytest.approx(-moved[2], rel=0.3)  # it still rings


def test_friction_and_plastic_flow_together(bodies):
    """Energy ripples in contact by central differences; with friction, the balance is the same within a part of it."""
    rough, smooth = (fall(bodies, velocity=(0.5, 0, -SPEED), end=1.4e-6, friction=friction) for friction in (0.2, None))
    contact, result = rough[1:]
    assert contact.plastic.work(result)[-1] > 0
    assert contact.dissipated_energy(result)[-1] > 1.2 * contact.plastic.work(result)[-1]
    np.testing.assert_allclose(energy_by_start(*rough), energy_by_start(*smooth), atol=2e-4)


def test_what_knows_no_nodes_that_yield_is_refused(bodies, models):
    mbs = exu.SystemContainer().AddSystem()
    ball, plate = (ep.CreatePartitionBody(mbs, body) for body in bodies)
    for formulation, said in (("compliance", "residual flexibility"), ("penalty", "knows no plastic zones")):
        with pytest.raises(InputError, match=said):
            ep.CreatePartitionContact(mbs, ball, plate, formulation=formulation)
    ep.CreatePartitionContact(mbs, ball, plate, **LAGRANGE)
    with pytest.raises(InputError, match="already has the contact"):
        ep.CreatePartitionContact(mbs, plate, ep.RigidPlane((0, 0, 1e-3), (0, 0, -1)), **LAGRANGE)
    mbs.Assemble()
    with pytest.raises(RunError, match="knows no plastic zones of basis 'free'"):
        ep.solve_dynamic(mbs, end_time=1e-6, method="implicit")
    with pytest.raises(InputError, match="knows no plastic zones"):
        ep.reduce(models[1][0], ep.Partition.ball(models[1][0], (0, 0, 0), 2e-4), basis="craig-bampton", f_cut=1e6)


def test_a_zone_within_an_interface_is_refused(models):
    fem, _ = models[1]
    part = ep.Partition.ball(fem, (0, 0, 0), 2e-4, plastic_radius=4e-4)
    beyond = np.setdiff1d(part.patches[0].plastic.nodes, part.nodes)
    with pytest.raises(InputError, match="a plastic zone and interface 'held' share nodes"):
        ep.reduce(fem, part | ep.Partition.interface(fem, "held", beyond), basis="free", f_cut=1e6)


def test_a_run_that_goes_on_knows_its_plastic_strain(bodies):
    """Two halves of a run end as one."""
    step, half, end = 2.5e-9, 1.2e-6, 1.4e-6  # 20 steps a sample
    mbs, _, contact = pair(bodies)
    whole = solve(mbs, end, step=step)
    force, strain = contact.force(whole)[-1], contact.plastic.strain(whole)[-1]
    first = solve(mbs, half, step=step)
    before = contact.plastic.strain(first)[-1]
    mbs.systemData.SetSystemState(mbs.systemData.GetSystemState(), exu.ConfigurationType.Initial)
    second = solve(mbs, end, step=step, start_time=half)
    assert contact.plastic.strain(second)[0] == before > 0
    assert contact.plastic.strain(second)[-1] == pytest.approx(strain, rel=1e-9)
    assert contact.force(second)[-1] == pytest.approx(force, rel=1e-9)
