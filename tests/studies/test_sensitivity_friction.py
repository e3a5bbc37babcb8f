"""Derivatives of runs with friction are those of differences between runs, and those of Coulomb's law by hand."""

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
from oracles import MARBLE_RADIUS as R
from oracles import without_numba

import exudyn_partition as ep
from exudyn_partition.errors import InputError

pytestmark = pytest.mark.filterwarnings("ignore::exudyn_partition.errors.PartitionWarning")
STEP, END, MU = 0.2e-6, 16e-6, 0.3
WITHIN = 1e-6  # of the largest derivative of a kind
SIZES = {
    "initialVelocity": 0.5, "initialAngularVelocity": 100.0, "referencePosition": 1e-6, "gravity": 1e4,
    "damping": 0.02, "E": ep.STEEL.E, "rho": ep.STEEL.rho, "friction": 0.1,
}  # fmt: skip
OF_CONTACT = {"peak_force": "peak", "impulse": "impulse", "dissipated": "dissipated"}
DIRECTION = np.array([1.0, 0.3, 0.2])


@pytest.fixture(scope="module")
def ball():
    """A ball with a patch at either pole, for forces in all directions."""
    shape = occ.Sphere(occ.Pnt(0, 0, 0), R)
    refine = [ep.Refine((0, 0, z), 0.3e-3, 0.13e-3) for z in (-R, R)]
    fem = ep.fe_model(shape, ep.STEEL, maxh=5e-3, refine=refine, grading=0.9)
    patches = [ep.Partition.ball(fem, (0, 0, z), 0.35e-3, name=name, axes="xyz") for z, name in ((-R, "s"), (R, "n"))]
    return ep.reduce(fem, patches[0] | patches[1], f_cut=300e3)


def fall(ball, friction=MU, velocity=(0.3, 0.1, -1.0), **options):
    """A ball that falls on a plane."""
    mbs = exu.SystemContainer().AddSystem()
    place = {"referencePosition": [0, 0, R + 1e-7], "initialVelocity": velocity, "gravity": [0, 0, -2e4]}
    item = ep.CreatePartitionBody(mbs, ball, name="ball", damping=0.03, **(place | options))
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), slavePatch="s", name="floor", friction=friction)
    mbs.Assemble()
    return mbs, [item], [contact]


def in_a_row(ball, *frictions):
    """Balls in a row, the last of which hits the others."""
    mbs, balls, n = exu.SystemContainer().AddSystem(), [], len(frictions)
    for i in range(n + 1):
        velocity, place = [0.2 * (i == n), 0, -0.5 * (i == n)], [0, 0, (2 * R + 1e-7) * i]
        motion = {"referencePosition": place, "initialVelocity": velocity, "gravity": [0, 0, -2e4]}
        balls.append(ep.CreatePartitionBody(mbs, ball, name=str(i), damping=0.02, **motion))
    patches = {"slavePatch": "s", "masterPatch": "n"}
    contacts = [
        ep.CreatePartitionContact(mbs, balls[i + 1], balls[i], name=f"contact {i}", friction=mu, **patches)
        for i, mu in enumerate(frictions)
    ]
    mbs.Assemble()
    return mbs, balls, contacts


SCENES = {  # and the velocity of the last body
    "plane": (lambda m: fall(m), (0.3, 0.1, -1.0)),
    "slides": (lambda m: fall(m, 0.1, (1.0, 0.3, -1.0)), (1.0, 0.3, -1.0)),
    "pair": (lambda m: in_a_row(m, MU), (0.2, 0, -0.5)),
    "row": (lambda m: in_a_row(m, None, MU), (0.2, 0, -0.5)),
}


def value_of(item, name, velocity):
    """Present value of a parameter of a body, the last one of which has a velocity, or of a contact."""
    if name in ("E", "rho"):
        return np.array(SIZES[name])
    given = {"initialVelocity": velocity, "gravity": (0, 0, -2e4)}
    if name == "friction":
        return np.array(item.mechanics.friction.static)
    if name == "damping":
        return np.array(item.ratios)
    return np.array(item.position if name == "referencePosition" else given.get(name, np.zeros(3)), dtype=float)


def differences(mbs, item, name, value, share):
    """Central differences by the entries of a parameter: of the numbers of contacts, and of momenta of bodies."""
    change = share * SIZES[name]
    ways = change * np.concatenate([np.eye(max(value.size, 1)), -np.eye(max(value.size, 1))])
    vary = {item: {name: value + (ways if value.ndim else ways[:, 0])}}
    runs = ep.run_many(mbs, end_time=END, step=STEP, vary=vary, histories=())
    found = {of: getattr(runs, name)[:, -1] for of, name in OF_CONTACT.items()}
    for number in range(runs.momentum.shape[2]):
        found[number] = runs.momentum[:, 1, number] @ DIRECTION
    return {of: (more - less) / (2 * change) for of, (more, less) in ((k, np.split(v, 2)) for k, v in found.items())}


@pytest.mark.parametrize("scene", SCENES)
def test_derivatives_are_differences_of_runs(ball, scene):
    mbs, bodies, contacts = SCENES[scene][0](ball)
    options = {"end_time": END, "step": STEP}
    found = {of: ep.sensitivity(mbs, of=of, at=contacts[-1], **options) for of in OF_CONTACT}
    for number, item in enumerate(bodies):
        found[number] = ep.sensitivity(mbs, of="velocity", at=item, direction=DIRECTION, **options)
    assert found["impulse"].changes > 2
    assert found["impulse"].edges == 0
    assert not found["impulse"].caution
    assert "E" in found["impulse"].by[bodies[0]]
    for item, of_item in found["impulse"].by.items():
        last = item == bodies[-1]
        for name in of_item:
            value = value_of(item, name, SCENES[scene][1] if last else np.zeros(3))
            errors = []
            for share in (1e-5, 1e-6):  # the smaller one crosses fewer changes of status, the larger one rounds less
                by_runs = differences(mbs, item, name, value, share)
                errors.append([])
                for of, one in found.items():
                    mass = 1.0 if of in OF_CONTACT else bodies[of].body.total_mass
                    if name == "rho" and of not in OF_CONTACT:
                        continue  # the mass is another one too
                    right, scale = np.atleast_1d(one.by[item][name]), abs(np.atleast_1d(one.value)).max()
                    size = max(scale, abs(right).max() * SIZES[name])
                    errors[-1].append(abs(right - by_runs[of] / mass).max() * SIZES[name] / size)
            assert np.min(errors, axis=0).max() <= WITHIN, (item, name, errors)


def test_a_coefficient_that_falls_as_contact_slips(ball):
    law = {"static": 0.3, "kinetic": 0.1, "decay": 0.2}

    def found(**changed):
        mbs, _, [contact] = fall(ball, ep.Coulomb(**(law | changed)), (0.6, 0.1, -1.0))
        options = {"end_time": END, "step": STEP, "direction": (1, 0, 0)}
        result = ep.sensitivity(mbs, of="friction_impulse", at=contact, **options)
        return result.value, result.by[contact]

    _, by = found()
    assert [*by] == [*law]
    for name, value in law.items():
        change = 1e-6 * value
        by_runs = (found(**{name: value + change})[0] - found(**{name: value - change})[0]) / (2 * change)
        assert by[name] == pytest.approx(by_runs, rel=1e-5)


def test_a_ball_that_slides_through_the_impact(ball):
    """Coulomb's law: the tangential impulse is mu times the normal one, and the velocity changes by it."""
    mu, options = 0.1, {"end_time": 30e-6, "step": STEP}
    mbs, [item], [contact] = fall(ball, mu, (2.0, 0, -1.0), gravity=[0, 0, 0])
    normal, tangential = (
        ep.sensitivity(mbs, of=of, at=contact, direction=(1, 0, 0), **options) for of in ("impulse", "friction_impulse")
    )
    velocity = ep.sensitivity(mbs, of="velocity", at=item, direction=(1, 0, 0), **options)
    assert tangential.value == pytest.approx(-mu * normal.value, rel=1e-3)  # not all rows slip along x
    assert tangential.by[contact]["friction"] == pytest.approx(-normal.value, rel=2e-3)
    assert velocity.by[contact]["friction"] * item.body.total_mass == pytest.approx(-normal.value, rel=2e-3)
    for name in ("initialVelocity", "E", "rho", "damping"):  # the momentum along x is that of friction
        change = np.array(tangential.by[item][name]) - item.body.total_mass * np.array(velocity.by[item][name])
        if name == "initialVelocity":
            change = change + item.body.total_mass * np.array([1.0, 0, 0])
        if name != "rho":
            assert abs(change).max() * SIZES[name] < 1e-9 * normal.value


def test_a_ball_that_sticks_through_the_impact(ball):
    """More friction changes nothing, but on the outermost rows, which slip as they open. Sliding, it is 2 m/s."""
    mbs, [item], [contact] = fall(ball, 5.0, (0.02, 0, -1.0))
    found = ep.sensitivity(mbs, end_time=30e-6, step=STEP, of="velocity", at=item, direction=(1, 0, 0))
    assert abs(found.by[contact]["friction"]) < 1e-4
    assert abs(found.by[item]["initialVelocity"]).max() > 0.1


def test_values_may_have_another_friction(ball):
    mbs, _, [contact] = fall(ball)
    other, _, [of_other] = fall(ball, 0.2)
    options = {"end_time": END, "step": STEP, "of": "dissipated"}
    found = ep.sensitivity(mbs, at=contact, values={contact: {"friction": 0.2}}, **options)
    right = ep.sensitivity(other, at=of_other, **options)
    assert found.value == right.value
    assert found.by[contact] == right.by[of_other]


def test_many_times_are_single_ones(ball):
    """All numbers of one pass back are those of passes for each."""
    mbs, [item], [contact] = fall(ball)
    options = {"end_time": END, "step": STEP, "of": "velocity", "at": item, "direction": DIRECTION}
    times = np.array([6e-6, END])
    many = ep.sensitivity(mbs, times=times, **options)
    for j, time in enumerate(times):
        one = ep.sensitivity(mbs, times=[time], **options)
        assert one.value[0] == many.value[j]
        for key, name in ((item, "initialVelocity"), (item, "E"), (contact, "friction")):
            np.testing.assert_allclose(one.by[key][name][0], many.by[key][name][j], rtol=1e-9, atol=1e-15)


def test_contacts_apart_are_as_alone(ball):
    """Balls beside each other, one without friction, one that slides, and one whose coefficient falls."""
    kinds = (None, (0.0, 0.0, -0.7)), (MU, (0.3, 0.1, -1.0)), (ep.Coulomb(0.3, 0.1, 0.2), (0.6, 0.0, -0.8))

    def beside(some):
        mbs, contacts = exu.SystemContainer().AddSystem(), []
        for i, (friction, velocity) in enumerate(some):
            motion = {"referencePosition": [0, 0.05 * i, R + 1e-7], "initialVelocity": velocity}
            item = ep.CreatePartitionBody(mbs, ball, name=f"ball {i}", **motion)
            options = {"slavePatch": "s", "name": f"floor {i}", "friction": friction}
            contacts.append((item, ep.CreatePartitionContact(mbs, item, ep.RigidPlane(), **options)))
        mbs.Assemble()
        return mbs, contacts

    options = {"end_time": END, "step": STEP, "of": "impulse"}
    together, contacts = beside(kinds)
    for kind, (item, contact) in zip(kinds, contacts, strict=True):
        alone, [(of_alone, contact_alone)] = beside([kind])
        found = ep.sensitivity(together, at=contact, **options)
        right = ep.sensitivity(alone, at=contact_alone, **options)
        pairs = [(found.by[item][name], right.by[of_alone][name]) for name in ("initialVelocity", "E", "rho")]
        if kind[0] is not None:
            pairs += zip(found.by[contact].values(), right.by[contact_alone].values(), strict=True)
        for one, other in pairs:
            np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9 * abs(np.array(other)).max())
        assert all(not found.by[other]["E"] for other, _ in contacts if other != item)


def test_without_friction_its_work_begins_with_the_coefficient(ball):
    """At a coefficient of zero the derivative is that to the side of friction."""
    mbs, _, [contact] = fall(ball)
    work = [
        ep.sensitivity(
            mbs, end_time=END, step=STEP, of="dissipated", at=contact, values={contact: {"friction": friction}}
        )
        for friction in (0.0, 1e-6)
    ]
    assert work[0].value == 0.0
    assert work[0].by[contact]["friction"] == pytest.approx(work[1].value / 1e-6, rel=1e-4)


def test_without_loops_it_is_the_same(ball):
    found, options = [], {"end_time": 8e-6, "step": STEP, "of": "dissipated"}
    for loops in (True, False):
        mbs, [item], [contact] = fall(ball, ep.Coulomb(0.3, 0.1, 0.2), (0.6, 0.1, -1.0))
        if loops:
            one = ep.sensitivity(mbs, at=contact, **options)
        else:
            with without_numba():
                one = ep.sensitivity(mbs, at=contact, **options)
        found.append([one.value, *one.by[contact].values(), *map(np.array, one.by[item].values())])
    for right, plain in zip(*found, strict=True):
        np.testing.assert_allclose(plain, right, rtol=0, atol=1e-8 * max(abs(np.array(right)).max(), 1e-12))


def test_rows_at_the_edge_of_a_status(ball):
    """Where bodies touch at the start, derivatives hold for one direction alone, and that is told."""
    mbs, _, [contact] = fall(ball)
    apart = ep.sensitivity(mbs, end_time=END, step=STEP, of="impulse", at=contact)
    gap = ep.solve_dynamic(mbs, end_time=STEP, step=STEP).sensor(contact["sForce"])[0, 5]
    mbs, _, [contact] = fall(ball, referencePosition=[0, 0, R + 1e-7 - gap])
    touching = ep.sensitivity(mbs, end_time=END, step=STEP, of="impulse", at=contact)
    assert (apart.edges, touching.edges) == (0, 1)
    assert apart.margin > 1e-9 > touching.margin
    assert touching.steps == 80
    assert "in 1 of 81 samples" in touching.caution
    assert touching.caution in repr(touching)


def test_what_is_refused(ball):
    mbs, _, contacts = in_a_row(ball, None, MU)
    options = {"end_time": END, "step": STEP}
    with pytest.raises(InputError, match="at: for 'dissipated' expected a contact with friction, got 'contact 0'"):
        ep.sensitivity(mbs, of="dissipated", at=contacts[0], **options)
    with pytest.raises(InputError, match="values: contact 'contact 0' has no friction"):
        ep.sensitivity(mbs, of="impulse", at=contacts[1], values={contacts[0]: {"friction": 0.2}}, **options)
    mbs, _, [contact] = fall(ball, referencePosition=[0, 0, 2 * R])
    with pytest.raises(InputError, match="at: contact 'floor' never closes in this run"):
        ep.sensitivity(mbs, of="peak_force", at=contact, **options)
    mbs, _, [contact] = fall(ball)
    with pytest.raises(InputError, match="direction: expected one along the surfaces of contact 'floor'"):
        ep.sensitivity(mbs, of="friction_impulse", at=contact, **options)
