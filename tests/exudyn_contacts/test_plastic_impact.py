"""Impacts of bodies that yield: against the full FE model, energy, frames, solvers, and what is left behind."""

import math
import warnings
from dataclasses import replace

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
from oracles import SIZE, energy_by_start, hexahedra, quadratic, small_zone, split, write_deck

import exudyn_partition as ep
from exudyn_partition.errors import InputError, ModelLimitWarning, YieldWarning
from exudyn_partition.fe.model import node_dofs
from exudyn_partition.fe.shapes import integration_points, tetrahedron_functions
from exudyn_partition.plasticity.zone import PlasticZone
from exudyn_partition.reduction.free_body import FreeBody
from validation.inelastic import pressed_block

MATERIAL = ep.Material(E=70e9, nu=0.33, rho=2700.0, yield_stress=200e6, hardening=500e6)
STEEL = replace(ep.STEEL, yield_stress=None)
RADIUS, SPEED, F_CUT = 5e-3, 0.5, 150e3


@pytest.fixture(scope="module")
def models():
    """A steel ball on an aluminium plate, both coarse."""
    ball = occ.Sphere(occ.Pnt(0, 0, RADIUS), RADIUS)
    plate = occ.Box(occ.Pnt(-6e-3, -6e-3, -3e-3), occ.Pnt(6e-3, 6e-3, 0))
    found = []
    for shape, material, sign, reach in ((ball, STEEL, -1, 0.40e-3), (plate, MATERIAL, 1, 0.52e-3)):
        fem = ep.fe_model(shape, material, maxh=4e-3, refine=[ep.Refine((0, 0, 0), 0.4e-3, 0.16e-3)], grading=0.6)
        found.append((fem, ep.Partition.ball(fem, (0, 0, 0), reach, direction=(0, 0, sign))))
    return found


@pytest.fixture(scope="module")
def bodies(models):
    return [ep.reduce(*model, f_cut=F_CUT) for model in models]


def fall(bodies, *, frame="inertial", speed=SPEED, end=45e-6, **options):
    """Items, contact and result of the ball on the plate."""
    mbs = exu.SystemContainer().AddSystem()
    items = [
        ep.CreatePartitionBody(mbs, body, initialVelocity=[0, 0, v], frame=frame, name=name)
        for body, v, name in zip(bodies, (-speed, 0.0), ("ball", "plate"), strict=True)
    ]
    contact = ep.CreatePartitionContact(mbs, *items)
    mbs.Assemble()
    with small_zone():
        result = ep.solve_dynamic(mbs, end_time=end, **options)
    return items, contact, result


@pytest.fixture(scope="module")
def run(bodies):
    return fall(bodies)


def test_force_work_and_rebound_are_those_of_the_full_fe_model(models, run):
    items, contact, result = run
    full = [ep.reference.FullBody(*model, velocity=(0, 0, v)) for model, v in zip(models, (-SPEED, 0), strict=True)]
    if contact.slave is not items[0]:
        full = full[::-1]
    reference = ep.reference.simulate(full, end_time=result.t[-1], step=2 * result.step)
    assert ep.compare(result.history(contact), reference).error["force"] < 0.01
    assert contact.force(result).max() == pytest.approx(reference.force.max(), rel=3e-3)
    work = contact.plastic.work(result)[-1]
    assert work == pytest.approx(sum(reference.info["plastic_work_J"]), rel=3e-3)
    assert contact.plastic.strain(result)[-1] == pytest.approx(max(reference.info["plastic_strain"]), rel=2e-2)
    assert abs(reference.info["energy_error"]) < 1e-3
    initial = items[0].energy(result)[0]
    assert work / initial > 0.05


def test_energy_is_kept_and_momentum_too(run):
    items, contact, result = run
    np.testing.assert_allclose(energy_by_start(*run), 1.0, atol=2e-4)
    assert (np.diff(contact.plastic.work(result)) >= -1e-12).all()
    momentum = sum(item.momentum(result) for item in items)
    np.testing.assert_allclose(
        momentum, np.broadcast_to(momentum[0], momentum.shape), atol=1e-9 * abs(momentum[0]).max()
    )


@pytest.mark.filterwarnings("ignore:.*contact.* reached the edge")
def test_energy_is_kept_where_hardly_any_strain_is_elastic(bodies):
    """Plastic strain is thousands of times what stress carries: an error that is small in it is a large stress."""
    soft = replace(MATERIAL, yield_stress=1e6, hardening=0.0)
    found = fall([bodies[0], replace(bodies[1], material=soft)], end=15e-6)
    np.testing.assert_allclose(energy_by_start(*found), 1.0, atol=5e-4)
    assert found[1].plastic.strain(found[2])[-1] > 5e3 * soft.yield_stress / soft.E


def test_stress_is_on_the_yield_surface_where_the_plate_has_yielded(models, run):
    """At the integration points with the largest strain, which flow until the force is largest."""
    (_, plate), contact, result = run
    (fem, part), (state,) = models[1], contact.plastic.states(result).values()
    most = np.argsort(state.equivalent)[-6:]
    region = part.patches[0].plastic
    shares = tetrahedron_functions(integration_points(10), 10)[0]
    points = np.einsum("qk,cka->cqa", shares, fem.points[region.cells]).reshape(-1, 3)[most]
    stress = ep.recovery.von_mises(plate.stress(result, points, fem))
    flow = MATERIAL.yield_stress + MATERIAL.hardening * state.equivalent[most]
    np.testing.assert_allclose(stress.max(axis=0), flow, rtol=1e-3)
    top = stress[contact.force(result).argmax()]
    np.testing.assert_allclose(top, flow, rtol=5e-2)
    assert (stress[-1] < 0.9 * flow).all()


def ends_with_the_force(contact, result):
    """Whether an impact ends with its force: mean gaps open half a micrometre before the last point of the surface."""
    (impact,) = contact.impacts(result)
    last = result.t[np.flatnonzero(contact.force(result))[-1]]
    return 0 < (impact.end - last) * impact.speed_after < 0.5e-6


def test_an_impact_ends_in_the_dent_that_it_has_made(bodies, run):
    """The undented surface would be in contact for 6 us more, in which bodies part by 2 um."""
    _, contact, result = run
    assert ends_with_the_force(contact, result)
    (impact,) = contact.impacts(result)
    assert impact.speed_after < 0.9 * impact.speed_before
    # A file does not hold the dent: there contact lasts from one sample without a force to the next one.
    (read,) = contact.impacts(replace(result, runs=()))
    assert read.end == pytest.approx(impact.end, abs=1e-6)


def test_an_impact_in_an_old_dent_begins_and_ends_there(bodies, run):
    (state,) = run[1].plastic.states(run[2]).values()
    _, contact, result = fall_again(bodies, state)
    assert ends_with_the_force(contact, result)
    first = result.t[np.flatnonzero(contact.force(result))[0]]
    assert contact.impacts(result)[0].start == pytest.approx(first, abs=5 * result.step)


def test_floating_frames_agree(bodies, run):
    _, contact, result = fall(bodies, frame="floating")
    assert ends_with_the_force(contact, result)
    np.testing.assert_allclose(contact.force(result), run[1].force(run[2]), atol=2e-4 * run[1].force(run[2]).max())


def test_implicit_steps_agree_with_explicit_ones(bodies, run):
    found = fall(bodies, method="implicit", step=2.5 * run[2].step)
    assert found[1].force(found[2]).max() == pytest.approx(run[1].force(run[2]).max(), rel=2e-3)
    assert found[1].plastic.work(found[2])[-1] == pytest.approx(run[1].plastic.work(run[2])[-1], rel=1e-2)
    np.testing.assert_allclose(energy_by_start(*found), 1.0, atol=2e-3)


@pytest.mark.filterwarnings("ignore")  # the whole block yields, from end to end
def test_a_block_that_yields_as_a_whole_follows_the_curve_of_its_material():
    """Also where the full FE model would share an error of the flow: one of a per cent in any constant is noticed."""
    material = pressed_block.CASES["both"]
    found, expected = pressed_block.pressed(material), pressed_block.exact(material)
    for key, value in expected.items():
        assert found[key] == pytest.approx(value, rel=pressed_block.LIMITS[key])


def test_a_yield_stress_out_of_reach_changes_nothing(bodies):
    """Of strains so small, the answer is the elastic one, through the checks of the zone, but for the order of sums."""
    strong = [
        replace(body, material=replace(body.material, yield_stress=20e9)) if body.basis.zones else body
        for body in bodies
    ]
    elastic = [replace(body, basis=replace(body.basis, zones=())) for body in bodies]
    (_, contact, result), (_, other, expected) = fall(strong), fall(elastic)
    np.testing.assert_allclose(contact.force(result), other.force(expected), rtol=1e-12)
    assert contact.plastic.work(result)[-1] == 0.0
    assert not other.plastic


def test_the_next_impact_on_the_same_place_finds_a_dent(bodies, run):
    """The ball of the same speed does less plastic work in its own dent, and rebounds faster."""
    items, contact, result = run
    (name,) = contact.plastic.states(result)
    again, second, repeated = fall_again(bodies, contact.plastic.states(result)[name])
    assert second.plastic.work(repeated)[-1] < 0.7 * contact.plastic.work(result)[-1]
    assert again[0].momentum(repeated)[-1, 2] > 1.01 * items[0].momentum(result)[-1, 2]
    assert second.plastic.strain(repeated)[0] == pytest.approx(contact.plastic.strain(result)[-1])
    np.testing.assert_allclose(energy_by_start(again, second, repeated), 1.0, atol=5e-4)


def fall_again(bodies, state):
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, bodies[0], initialVelocity=[0, 0, -SPEED], name="ball")
    plate = ep.CreatePartitionBody(mbs, bodies[1], name="plate", plasticStates={0: state})
    contact = ep.CreatePartitionContact(mbs, ball, plate)
    mbs.Assemble()
    with small_zone():
        result = ep.solve_dynamic(mbs, end_time=45e-6)
    return (ball, plate), contact, result


def test_a_dented_body_rests(bodies, run):
    """Residual stress is in equilibrium: nothing moves until something touches."""
    state = run[1].plastic.states(run[2])
    mbs = exu.SystemContainer().AddSystem()
    plate = ep.CreatePartitionBody(mbs, bodies[1], plasticStates={0: next(iter(state.values()))})
    ep.CreatePartitionContact(mbs, plate, ep.RigidSphere((0, 0, RADIUS + 1e-3), RADIUS))
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=20e-6)
    q = plate.coordinates(result)
    assert abs(q[0]).max() > 0
    np.testing.assert_allclose(q, np.broadcast_to(q[0], q.shape), atol=1e-9 * abs(q[0]).max())


def test_a_dented_body_rests_in_the_full_fe_model_too(models, run):
    """It takes the state of a partition body, and its own come back as what it was given."""
    (state,) = run[1].plastic.states(run[2]).values()
    (ball, ball_part), (plate, plate_part) = models
    dented = ep.reference.FullBody(plate, plate_part, plastic_state=state)
    far = ep.reference.FullBody(ball, ball_part, position=(0, 0, 5e-5), velocity=(0, 0, -1e-3))
    point = {"dent": (1, (0, 0, 0))}
    reference = ep.reference.simulate([far, dented], end_time=4e-6, step=1e-6, points=point)
    depth = run[1].plastic.dents(run[2])["master" if run[1].slave is run[0][0] else "slave"]
    assert abs(reference.velocity["dent"]).max() * 4e-6 < 1e-9 * depth
    assert abs(reference.info["energy_error"]) < 1e-12
    (found,) = reference.info["plastic_states"]
    np.testing.assert_array_equal(found["strain"], state.strain)
    with pytest.raises(InputError, match="expected the PlasticState of a zone with"):
        ep.reference.FullBody(plate, plate_part, plastic_state=ep.PlasticState.virgin(3))
    with pytest.raises(InputError, match="this body cannot yield"):
        ep.reference.FullBody(ball, ball_part, plastic_state=state)


def test_flow_at_the_edge_of_the_zone_warns(models):
    fem, _ = models[1]
    small = ep.Partition.ball(fem, (0, 0, 0), 0.52e-3, direction=(0, 0, 1), plastic_radius=0.25e-3)
    mbs = exu.SystemContainer().AddSystem()
    plate = ep.CreatePartitionBody(mbs, ep.reduce(fem, small, f_cut=F_CUT), initialVelocity=[0, 0, SPEED], name="plate")
    contact = ep.CreatePartitionContact(mbs, plate, ep.RigidSphere((0, 0, RADIUS), RADIUS), name="anvil")
    mbs.Assemble()
    with pytest.warns(YieldWarning, match="reached the edge of its plastic zone") as warned:
        result = ep.solve_dynamic(mbs, end_time=20e-6)
    assert not any("stays elastic here" in str(w.message) for w in warned)
    side, place = contact.plastic.flow_at_border(result)
    assert side == "slave"
    border = fem.points[small.patches[0].plastic.border]
    assert np.linalg.norm(border - place, axis=1).min() == 0.0


@pytest.mark.parametrize(
    ("order", "per_radius", "told"), [(1, 0.5, True), (1, 4, False), (2, 0.5, True), (2, 2, False)]
)
def test_hexahedra_that_are_coarse_for_the_contact_are_told(tmp_path, order, per_radius, told):
    """Elements of the body, by their number in the radius that 2.8 times the yield stress gives the contact."""
    force = 40.0
    h = np.sqrt(force / (2.8 * np.pi * MATERIAL.yield_stress)) / per_radius
    points, cells = hexahedra(6, 6, 4)
    points = (points / SIZE - [0, 0, 1]) * [6 * h, 6 * h, 4 * h]
    points, blocks = split(points, cells, np.full(len(cells), "hexahedron"))
    if order == 2:
        points, blocks = quadratic(points, blocks)
    fem = ep.fe_model(write_deck(tmp_path / "box.inp", points, *blocks), MATERIAL, order=order)
    part = ep.Partition.ball(fem, (0, 0, 0), 2.2 * h, direction=(0, 0, 1), plastic_radius=2.2 * h)
    mbs = exu.SystemContainer().AddSystem()
    speed = np.sqrt(2 * force * 1e-6 / fem.total_mass)
    block = ep.CreatePartitionBody(mbs, ep.reduce(fem, part, f_cut=F_CUT), initialVelocity=[0, 0, speed])
    ep.CreatePartitionContact(mbs, block, ep.RigidSphere((0, 0, RADIUS), RADIUS))
    mbs.Assemble()
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        ep.solve_dynamic(mbs, end_time=8e-6 / speed)
    assert any("does not resolve the flow" in str(one.message) for one in warned) == told


@pytest.mark.parametrize("speed", [0.1, 1.5])
def test_a_zone_that_flow_just_reaches_is_wide_enough(speed):
    """Two balls that yield, with one element beyond the estimate of how far flow reaches: it ends in these.

    No warning comes. In a wider zone no other elements flow, and the force is the same but for the elements that no
    longer lock. A zone of 0.4 of the width changes the force, and a warning tells.
    """
    radii = 4e-3, 7e-3
    mass = ep.hertz.effective(*(4 / 3 * math.pi * R**3 * MATERIAL.rho for R in radii))
    hertz = ep.hertz.impact(mass, speed, *radii, MATERIAL, MATERIAL)
    a = 1.4 * hertz.contact_radius
    reached = hertz.plastic_radius + a / 1.5
    models = []
    for R, sign in zip(radii, (-1, 1), strict=True):
        ball = occ.Sphere(occ.Pnt(0, 0, -sign * R), R)
        refine = [ep.Refine((0, 0, 0), 2 * a, a / 1.5)]
        models.append((ep.fe_model(ball, MATERIAL, maxh=4e-3, refine=refine, grading=0.6), sign))

    def impact(width):
        mbs = exu.SystemContainer().AddSystem()
        items = []
        for (fem, sign), v in zip(models, (-speed, 0.0), strict=True):
            radius = width * reached
            part = ep.Partition.ball(fem, (0, 0, 0), 1.7 * a, direction=(0, 0, sign), plastic_radius=radius)
            items.append(ep.CreatePartitionBody(mbs, ep.reduce(fem, part, f_cut=80e3), initialVelocity=[0, 0, v]))
        contact = ep.CreatePartitionContact(mbs, *items)
        mbs.Assemble()
        return contact, ep.solve_dynamic(mbs, end_time=0.7 * hertz.duration, step=hertz.duration / 70)

    with warnings.catch_warnings():
        warnings.filterwarnings("error", message=".*reached the edge of its plastic zone")
        warnings.filterwarnings("ignore", message=".*does not resolve the flow")
        (contact, result), found = impact(1.0), impact(1.5)
    assert contact.plastic.flow_at_border(result) is None
    force = contact.force(result)
    wide, states = found[0].force(found[1]), found[0].plastic.states(found[1])
    for side, run in found[0].plastic.zones:
        flows = states["slave" if side == 0 else "master"].equivalent > 0
        assert flows.any()
        assert np.linalg.norm(run.zone.place(flows), axis=1).max() < reached
    assert np.linalg.norm(force - wide) < 4e-3 * np.linalg.norm(wide)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*does not resolve the flow")
        with pytest.warns(YieldWarning, match="reached the edge of its plastic zone"):
            small = impact(0.4)
    assert small[0].force(small[1]).max() > 1.005 * wide.max()


@pytest.mark.parametrize(("strain", "told"), [(0.2, True), (0.05, False)])
def test_plastic_strain_that_is_not_small_is_told(bodies, run, strain, told):
    """Of an earlier impact too."""
    (state,) = run[1].plastic.states(run[2]).values()
    mbs = exu.SystemContainer().AddSystem()
    before = {0: replace(state, strain=0 * state.strain, equivalent=np.full(len(state.equivalent), strain))}
    plate = ep.CreatePartitionBody(mbs, bodies[1], plasticStates=before)
    ep.CreatePartitionContact(mbs, plate, ep.RigidPlane((0, 0, 1e-3), (0, 0, -1)))
    mbs.Assemble()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        ep.solve_dynamic(mbs, end_time=1e-7)
    assert any(f"has reached {strain}" in str(w.message) for w in caught) == told


@pytest.mark.parametrize(("distance", "near"), [(2.1, True), (4.0, False)])
def test_flow_of_two_zones_near_each_other_warns(distance, near):
    """What the zones do not feel is known from the whole body: the stress that the strain of one makes in the other."""
    radius = 0.5e-3
    places = [np.array([sign * distance * radius / 2, 0, 0]) for sign in (-1, 1)]
    plate = occ.Box(occ.Pnt(-5e-3, -4e-3, -2.5e-3), occ.Pnt(5e-3, 4e-3, 0))
    refine = [ep.Refine(place, 0.45e-3, 0.22e-3) for place in places]
    fem = ep.fe_model(plate, MATERIAL, maxh=3e-3, refine=refine, grading=0.7)
    first, second = (
        ep.Partition.ball(fem, place, 0.33e-3, direction=(0, 0, 1), plastic_radius=radius) for place in places
    )
    body = ep.reduce(fem, first | second, f_cut=F_CUT)
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, initialVelocity=[0, 0, 3 * SPEED], name="plate")
    contacts = []
    for i, (x, y, z) in enumerate(places):
        sphere = ep.RigidSphere((x, y, z + RADIUS), RADIUS)
        contacts.append(ep.CreatePartitionContact(mbs, item, sphere, slavePatch=i, name=f"{i}"))
    mbs.Assemble()
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        result = ep.solve_dynamic(mbs, end_time=5e-6)
    told = [str(one.message) for one in told if issubclass(one.category, ModelLimitWarning)]
    told = [text for text in told if "does not resolve the flow" not in text]  # the mesh is coarse, too
    assert ["beneath contact '0' and contact '1'" in text for text in told] == [True] * near
    assert not any("J of energy" in text for text in told)  # contacts count what they push each other

    zones = [PlasticZone(fem.points, part.patches[0].plastic, MATERIAL) for part in (first, second)]
    (state,) = contacts[0].plastic.states(result).values()
    force = np.zeros(fem.n_dofs)
    force[node_dofs(zones[0].nodes)] = zones[0].pseudo_forces(state.strain)
    moved = FreeBody(fem, first | second).flexibility()(force[:, None])[:, 0]
    strain = np.linalg.norm(zones[1].strains(moved[node_dofs(zones[1].nodes)]), axis=1)
    missing = zones[1].flow.of_strain(strain.max()) / MATERIAL.yield_stress
    assert (missing > 0.1) if near else (missing < 0.03)


def test_friction_and_plastic_flow_together(models):
    """An oblique impact: both take energy, and the balance counts both."""
    fem, _ = models[1]
    part = ep.Partition.ball(fem, (0, 0, 0), 0.52e-3, direction=(0, 0, 1), axes="xyz")
    mbs = exu.SystemContainer().AddSystem()
    plate = ep.CreatePartitionBody(mbs, ep.reduce(fem, part, f_cut=F_CUT), initialVelocity=[0.2, 0, 0.25])
    contact = ep.CreatePartitionContact(mbs, plate, ep.RigidSphere((0, 0, RADIUS), RADIUS), friction=0.2)
    mbs.Assemble()
    with small_zone():
        result = ep.solve_dynamic(mbs, end_time=40e-6)
    work, taken = contact.plastic.work(result)[-1], contact.dissipated_energy(result)[-1]
    assert 0 < work < taken
    balance = energy_by_start([plate], contact, result)
    np.testing.assert_allclose(balance, 1.0, atol=2e-4)  # also after the impact, where the plate swings about its dent
    along = abs(contact.friction.tangential_force(result)).max(axis=1)
    assert (along <= 0.2 * contact.force(result) * (1 + 1e-9)).all()
    assert ends_with_the_force(contact, result)


def test_what_cannot_yield_is_refused(bodies, models):
    mbs = exu.SystemContainer().AddSystem()
    plate = ep.CreatePartitionBody(mbs, bodies[1])
    with pytest.raises(InputError, match="knows no plastic zones"):
        ep.CreatePartitionContact(mbs, plate, ep.RigidPlane((0, 0, 1e-3), (0, 0, -1)), formulation="penalty")
    contact = ep.CreatePartitionContact(
        mbs, ep.CreatePartitionBody(mbs, bodies[0], referencePosition=(0, 0, 1e-3)), ep.RigidPlane((0, 0, 0), (0, 0, 1))
    )
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=2e-6)
    with pytest.raises(InputError, match="has no plastic zones"):
        contact.plastic.strain(result)
    assert not contact.plastic
    assert not contact.plastic.zones
    assert not contact.plastic.work(result).any()
    with pytest.raises(InputError, match="plasticStates: patch 0 of the body has no plastic zone"):
        ep.CreatePartitionBody(exu.SystemContainer().AddSystem(), bodies[0], plasticStates={0: None})
    with pytest.raises(InputError, match="expected the PlasticState of a zone with"):
        ep.CreatePartitionBody(exu.SystemContainer().AddSystem(), bodies[1], plasticStates={0: math.pi})


def test_states_are_saved_and_read(run, tmp_path):
    (state,) = run[1].plastic.states(run[2]).values()
    state.save(tmp_path / "dent.npz")
    again = ep.PlasticState.load(tmp_path / "dent.npz")
    for name in ("strain", "equivalent", "back"):
        np.testing.assert_array_equal(getattr(again, name), getattr(state, name))


def test_the_report_and_the_figure_of_energy_tell_of_plastic_work(run, tmp_path):
    import matplotlib.pyplot as plt

    _, contact, result = run
    axes = ep.plot.energy(plt.figure().add_subplot(), result)
    assert "taken by plastic flow" in [line.get_label() for line in axes.get_lines()]
    plt.close("all")
    page = result.report(tmp_path / "report.html").read_text()
    assert f"{contact.plastic.work(result)[-1]:.4g} J" in page
    assert "taken by plastic flow [J]" in page
    assert "taken by friction" not in page
    assert "depth of the dent" in page
    assert "its patch yields, see the plastic strain" in page
    assert page.count("no yield stress is known") == 1  # of the ball
