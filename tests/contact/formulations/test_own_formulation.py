"""A law of one's own, from the contributing page alone: linear springs on rows, with friction and without."""

import exudyn as exu
import numpy as np
import pytest
import scipy.linalg
from oracles import TOP, contributed, inertial

import exudyn_partition as ep
from exudyn_partition.contact.law import Forces
from exudyn_partition.contact.patch_contact import PatchContact
from exudyn_partition.contact.patch_gaps import PatchGaps
from exudyn_partition.errors import InputError, RunError

page = contributed("class Spring(Law)")
Springs, STIFFNESS = page["Springs"], page["K"]


def strike(bodies, method="explicit", formulation=None, friction=None, speed=(0, 0, -0.5), at=TOP, **options):
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=at, initialVelocity=speed, **options)
    block = ep.CreatePartitionBody(mbs, bodies[1])
    contact = ep.CreatePartitionContact(
        mbs, ball, block, formulation=formulation or Springs(), friction=friction, name="tip"
    )
    mbs.Assemble()
    return ep.solve_dynamic(mbs, end_time=80e-6, step=0.1e-6, method=method), (ball, block), contact


@pytest.mark.filterwarnings("ignore:contact 'tip' reached the edge of its patch")
@pytest.mark.parametrize(
    ("method", "frame"), [("explicit", "inertial"), ("implicit", "inertial"), ("explicit", "floating")]
)
def test_springs_on_rows_conserve_and_are_springs(bodies, method, frame):
    result, items, contact = strike(bodies, method, frame=frame)
    force = contact.force(result)
    assert force.max() > 100
    # What each row's force is, by the coordinates alone.
    gaps = contact.mechanics.gaps.for_run()
    q = np.hstack([item.coordinates(result) for item, _ in contact.sides])
    depths = [np.maximum(-gaps.at(x), 0.0) for x in q]
    np.testing.assert_allclose(force, [STIFFNESS * depth.sum() for depth in depths], rtol=1e-6, atol=1e-6 * force.max())
    stored = [STIFFNESS * (depth**2).sum() / 2 for depth in depths]
    np.testing.assert_allclose(contact.energy(result), stored, rtol=1e-6, atol=1e-6 * max(stored))
    momentum = sum(item.momentum(result) for item in items)
    assert abs(momentum - momentum[0]).max() < 1e-6 * abs(momentum[0]).max()
    energy = sum(item.energy(result) for item in items) + contact.energy(result)
    assert abs(energy / energy[0] - 1).max() < 2e-3
    np.testing.assert_allclose(contact.row_forces(result).sum(axis=1).A1, force, rtol=1e-12)


def test_the_stability_limit_knows_the_springs(bodies):
    """That of the dense matrices."""
    mbs = exu.SystemContainer().AddSystem()
    items = [ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP), ep.CreatePartitionBody(mbs, bodies[1])]
    mbs.Assemble()
    free = ep.stability_limit(mbs)
    contact = ep.CreatePartitionContact(mbs, *items, formulation=Springs())
    K = scipy.linalg.block_diag(*(item.body.stiffness.toarray() for item, _ in contact.sides))
    H = contact.mechanics.gaps.jacobian(np.arange(contact.n_rows))
    highest = np.linalg.eigvalsh(K + STIFFNESS * H.T @ H)[-1]
    assert ep.stability_limit(mbs) == pytest.approx(2 / np.sqrt(highest), rel=1e-6)
    assert ep.stability_limit(mbs) < free


@pytest.mark.filterwarnings("ignore:contact 'tip' reached the edge of its patch")
@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_friction_takes_what_bodies_lose(round_body, flat_body, method):
    """An oblique impact: momentum is kept, friction takes energy, no row pulls more than its bound."""
    bodies, oblique = (round_body, flat_body), {"friction": 0.2, "speed": (0.4, 0, -0.5), "at": (0, 0, 0)}
    result, items, contact = strike(bodies, method, **oblique)
    momentum = sum(item.momentum(result) for item in items)
    assert abs(momentum - momentum[0]).max() < 1e-6 * abs(momentum[0]).max()
    taken = contact.friction.work(result)
    assert taken[-1] > 0
    energy = sum(item.energy(result) for item in items) + contact.energy(result) + taken
    assert abs(energy / energy[0] - 1).max() < 5e-3
    tangential, normal = np.linalg.norm(contact.friction.tangential_force(result), axis=1), contact.force(result)
    assert tangential.max() > 10
    assert (tangential <= 0.2 * normal * (1 + 1e-9) + 1e-9).all()


@pytest.mark.parametrize("friction", [None, ep.Coulomb(0.3)])
def test_the_tangent_is_the_slope_of_the_force(round_body, flat_body, friction):
    sides = inertial(round_body), inertial(flat_body)
    contact, rng = PatchContact(PatchGaps(*sides), Springs(), friction), np.random.default_rng(0)
    body = sides[0].kinematics.body
    q = np.r_[body.rigid[:, :3] @ [0, 0, -3e-6], np.zeros(sides[1].n)]
    for start in (0.0, 1.0):
        contact.accept(start)
        contact.at(q)
    q = q + np.r_[body.rigid[:, :3] @ [1e-6, 4e-7, 0], np.zeros(sides[1].n)]
    answer = contact.at(q)
    tangent, closed, state, H = answer.tangent(), answer.index, answer.status, answer.row_jacobian()
    for _ in range(4):
        way = rng.standard_normal(len(q))
        way *= 1e-10 / abs(H @ way).max()
        there, back = contact.at(q + way), contact.at(q - way)
        for moved in (there, back):
            np.testing.assert_array_equal(moved.index, closed)
            np.testing.assert_array_equal(moved.status, state)
        slope = (there.generalised - back.generalised) / 2
        np.testing.assert_allclose(-tangent @ way, slope, rtol=0, atol=1e-4 * abs(slope).max())


class Layered(Springs):
    """Springs per area: the law keeps its rows, and a run that goes on has a law of its own."""

    def law(self, rows):
        return PerArea(rows)


class PerArea(page["Spring"]):
    def __init__(self, rows):
        super().__init__(rows)
        self.rows = rows

    def answer(self, places):
        lam = 1e12 * self.rows.gaps.area * np.maximum(-places.gap, 0.0)
        return Forces(lam[:, None], np.flatnonzero(lam))


@pytest.mark.filterwarnings("ignore:contact 'tip' reached the edge of its patch")
def test_a_run_that_goes_on_has_its_own_law(bodies):
    def model():
        mbs = exu.SystemContainer().AddSystem()
        ball = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP, initialVelocity=[0, 0, -0.5])
        block = ep.CreatePartitionBody(mbs, bodies[1])
        contact = ep.CreatePartitionContact(mbs, ball, block, formulation=Layered(), name="tip")
        mbs.Assemble()
        return mbs, contact

    mbs, contact = model()
    whole = contact.force(ep.solve_dynamic(mbs, end_time=20e-6, step=0.1e-6))
    mbs, contact = model()
    parts = [
        contact.force(ep.solve_dynamic(mbs, end_time=end, step=0.1e-6, go_on=end > 5e-6))[1:]
        for end in (5e-6, 12e-6, 20e-6)
    ]
    np.testing.assert_allclose(np.concatenate(parts), whole[1:], rtol=1e-6, atol=1e-9 * whole.max())


class Dashpot(page["Spring"]):
    """A spring whose force also depends on the velocities: it has no potential."""

    elastic = False

    def answer(self, places):
        found = super().answer(places)
        unchanged = 1.0 + 0.0 * float(places.motion.q_t @ places.motion.q_t)
        return Forces(unchanged * found.on_rows, found.closed)


class Dashpots(Springs):
    def law(self, rows):
        return Dashpot(rows)


@pytest.mark.filterwarnings("ignore:contact 'tip' reached the edge of its patch")
def test_a_law_may_ask_for_velocities(bodies):
    """Also where the run chooses its step before there are any."""
    forces = []
    for formulation in (Dashpots(), Springs()):
        mbs = exu.SystemContainer().AddSystem()
        ball = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP, initialVelocity=[0, 0, -0.5])
        contact = ep.CreatePartitionContact(
            mbs, ball, ep.CreatePartitionBody(mbs, bodies[1]), formulation=formulation, name="tip"
        )
        mbs.Assemble()
        result = ep.solve_dynamic(mbs, end_time=10e-6)
        forces.append(np.interp(np.linspace(0, 10e-6, 50), result.t, contact.force(result)))
    assert forces[0].max() > 10
    np.testing.assert_allclose(*forces, atol=0.02 * forces[1].max())


@pytest.mark.parametrize("friction", [None, ep.Coulomb(0.3)])
def test_springs_on_nodes_with_mass_have_a_limit(pair_of, friction):
    """Rows of bases with nodal coordinates are sparse."""
    sides = [inertial(body, at) for body, at in zip(pair_of("free"), (TOP, (0, 0, 0)), strict=True)]
    K = PatchContact(PatchGaps(*sides), Springs(), friction).closed_stiffness()
    assert np.linalg.eigvalsh(K).min() > -1e-6 * np.linalg.eigvalsh(K).max()
    assert np.linalg.eigvalsh(K).max() > STIFFNESS / 100


def test_forces_of_another_shape_are_named(round_body, flat_body):
    class Flat(page["Spring"]):
        def answer(self, places):
            return Forces(places.gap, super().answer(places).closed)

    class Flats(Springs):
        def law(self, rows):
            return Flat(rows)

    contact = PatchContact(PatchGaps(inertial(round_body), inertial(flat_body)), Flats())
    with pytest.raises(InputError, match=r"law Flat: expected forces of shape \(\d+, 1\), rows by directions"):
        contact.at(np.r_[round_body.rigid[:, :3] @ [0, 0, -3e-6], np.zeros(flat_body.n_dofs)])


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda lam, closed: Forces(lam, lam[:, 0] > 0), "numbers of the closed rows, .* bool"),
        (lambda lam, closed: Forces(lam, list(closed)), "numbers of the closed rows, .* list"),
        (lambda lam, closed: Forces(lam, closed, power=lam[:, 0]), r"one number as `power`, the sum .* \(\d+,\)"),
        (lambda lam, closed: Forces(lam, closed, taken=lam), r"one number as `taken`, the sum .* \(\d+, 1\)"),
        (lambda lam, closed: Forces(np.nan * lam, closed), "finite numbers .* others in on_rows$"),
        (lambda lam, closed: Forces(lam, closed, power=np.inf, taken=np.nan), "finite .* others in power and taken$"),
    ],
)
def test_an_answer_of_another_kind_is_named(round_body, flat_body, wrong, said):
    class Odd(page["Spring"]):
        elastic = False

        def answer(self, places):
            return wrong(*super().answer(places)[:2])

    class Odds(Springs):
        def law(self, rows):
            return Odd(rows)

    contact = PatchContact(PatchGaps(inertial(round_body), inertial(flat_body)), Odds())
    with pytest.raises(InputError, match=f"law Odd: expected {said}"):
        contact.at(np.r_[round_body.rigid[:, :3] @ [0, 0, -3e-6], np.zeros(flat_body.n_dofs)])


def test_slopes_of_another_shape_are_named(round_body, flat_body):
    class Odd(page["Spring"]):
        def answer(self, places):
            return Forces(*super().answer(places)[:2], damping=lambda: np.eye(len(places.gap)))

        def closed_stiffness(self, rows):
            return np.eye(3)

    class Odds(Springs):
        def law(self, rows):
            return Odd(rows)

    contact = PatchContact(PatchGaps(inertial(round_body), inertial(flat_body)), Odds())
    n = round_body.n_dofs + flat_body.n_dofs
    with pytest.raises(InputError, match=rf"law Odd: expected a closed_stiffness of shape \({n}, {n}\), on the coord"):
        contact.closed_stiffness()
    answer = contact.at(np.r_[round_body.rigid[:, :3] @ [0, 0, -3e-6], np.zeros(flat_body.n_dofs)])
    with pytest.raises(InputError, match=r"law Odd: expected a damping of shape .*, of the closed rows alone, got"):
        answer.damping()


def test_slopes_that_are_no_functions_are_named(round_body, flat_body):
    class Odd(page["Spring"]):
        def answer(self, places):
            found = super().answer(places)
            return Forces(found.on_rows, found.closed, stiffness=found.stiffness(), damping=found.stiffness())

    class Odds(Springs):
        def law(self, rows):
            return Odd(rows)

    contact = PatchContact(PatchGaps(inertial(round_body), inertial(flat_body)), Odds())
    answer = contact.at(np.r_[round_body.rigid[:, :3] @ [0, 0, -3e-6], np.zeros(flat_body.n_dofs)])
    for name, slope in (("stiffness", answer.row_stiffness), ("damping", answer.damping)):
        with pytest.raises(InputError, match=f"law Odd: expected a function .* `{name}`, got ndarray"):
            slope()


def test_an_answer_without_slips_is_named(round_body, flat_body):
    class Silent(page["Spring"]):
        def answer(self, places):
            return Forces(*super().answer(places)[:3])

    class Silents(Springs):
        def law(self, rows):
            return Silent(rows)

    contact = PatchContact(PatchGaps(inertial(round_body), inertial(flat_body)), Silents(), ep.Coulomb(0.3))
    q = np.r_[round_body.rigid[:, :3] @ [0, 0, -3e-6], np.zeros(flat_body.n_dofs)]
    contact.at(q)
    with pytest.raises(RunError, match="law Silent: with friction, its answers need `slips`"):
        contact.accept(1.0)


def test_a_law_without_friction_refuses_it(mbs, bodies):
    class Smooth(Springs):
        friction = False

    items = [ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP), ep.CreatePartitionBody(mbs, bodies[1])]
    with pytest.raises(InputError, match="friction: formulation Smooth has none"):
        ep.CreatePartitionContact(mbs, *items, formulation=Smooth(), friction=0.2)


def test_work_is_counted(bodies):
    """Implicit steps tell of Newton's method; nothing slides, so that pairs are those of the start."""
    result, *_ = strike(bodies, "implicit")
    assert result.work.newton_iterations >= result.steps
    assert 0 < result.work.jacobians < result.work.newton_iterations
    assert 0 < result.work.contact_s < result.time_s
    assert result.work.active_set_iterations == result.work.pair_searches == 0
    by_flexibility, _, contact = strike(bodies, formulation="compliance")
    assert by_flexibility.work.active_set_iterations >= np.count_nonzero(contact.force(by_flexibility)[:-1])
    assert by_flexibility.work.newton_iterations == 0


def test_what_is_no_formulation_is_refused(mbs, bodies):
    items = [ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP), ep.CreatePartitionBody(mbs, bodies[1])]
    with pytest.raises(InputError, match="formulation: expected one of 'compliance', 'lagrange', 'penalty'"):
        ep.CreatePartitionContact(mbs, *items, formulation=object())
    for law, called in ((PerArea, "the class PerArea"), (Dashpot.__new__(Dashpot), "Dashpot")):
        with pytest.raises(InputError, match=rf"whose law\(rows\) returns a law, got {called}$"):
            ep.CreatePartitionContact(mbs, *items, formulation=law)
