"""Contacts on common bodies, whose forces are found together."""

from dataclasses import replace
from itertools import permutations
from types import SimpleNamespace

import netgen.occ as occ
import numpy as np
import pytest
import scipy.linalg
from oracles import broken_law, compliant

import exudyn_partition as ep
from exudyn_partition.algebra.complementarity import regularised
from exudyn_partition.algebra.friction import SLIP, STICK, FrictionProblem
from exudyn_partition.algebra.products import dense
from exudyn_partition.contact.formulations.coupled import CoupledContacts
from exudyn_partition.contact.formulations.coupled_friction import CoupledFriction
from exudyn_partition.contact.formulations.coupled_zones import CoupledZones
from exudyn_partition.contact.rigid import RigidGaps, RigidPlane
from exudyn_partition.contact.side import Side
from exudyn_partition.contact.stages import Standing
from exudyn_partition.errors import ComplementarityError, IndefiniteMatrixError
from exudyn_partition.frames.inertial import InertialKinematics
from exudyn_partition.support.compiled import compiles


class Runaway:
    """A contact whose force grows with what another pushes: patches that move each other more than themselves."""

    carried = remembers = elastic = begun = False
    d = 1
    friction, since, yielding, placement = None, 0.0, None, SimpleNamespace(overlap=0.0)
    memory = SimpleNamespace(forces=np.zeros((1, 1)), closed=False)

    def __init__(self):
        self.gaps = self.rows = self.state = self.evaluation = self.anchoring = self
        self.reset()

    def reset(self):
        self.lam, self.index = np.ones(1), np.zeros(1, dtype=int)

    @property
    def on_rows(self):
        return self.lam[:, None]

    def gap_at(self, q):
        return q

    def standing(self):
        return Standing(self, None)

    def found_at(self, anchor, make):
        return make()

    def side_rows(self, side):
        return np.eye(1)

    def answer(self, h, pushed=None):
        self.lam = np.maximum(-(h if pushed is None else h + pushed[:, 0]), 0.0)
        return self

    def lacks_rows(self, *, shared):
        return False


def test_contacts_that_do_not_settle_are_an_error():
    """The sweeps used to end after their hundredth with whatever forces there were."""
    laws = [Runaway(), Runaway()]
    links = [(0, 0, 1, 0, -1.5 * np.eye(1)), (1, 0, 0, 0, -1.5 * np.eye(1))]
    with pytest.raises(ComplementarityError, match="2 contacts on common bodies did not settle in 100 sweeps"):
        CoupledZones(laws, lambda: links).for_run(laws).forces([np.array([-1.0]), np.array([-2.0])])


class Spring(Runaway):
    """A contact whose forces are the depths of its row."""

    def reset(self):
        self.answer(np.ones(1))

    def answer(self, h, pushed=None):
        super().answer(h, pushed)
        self.index = np.flatnonzero(self.lam)
        return self

    def generalised(self):
        return self.lam


def test_a_contact_that_only_the_other_closes_is_closed():
    """Contacts with a memory used to be asked only if two were closed without each other."""
    laws = [Spring(), Spring()]
    links = [(0, 0, 1, 0, np.full((1, 1), -0.3)), (1, 0, 0, 0, np.full((1, 1), -0.3))]
    found = CoupledZones(laws, lambda: links).for_run(laws).forces([np.array([-1.0]), np.array([0.1])])
    # a = 1 + 0.3 b and b = 0.3 a - 0.1
    np.testing.assert_allclose(np.concatenate(found), [0.97 / 0.91, 0.3 * 0.97 / 0.91 - 0.1], rtol=1e-9)


def test_a_contact_that_opens_pushes_no_longer():
    """The first one is asked while the second still pushes it, which then opens."""
    laws, apart = [Spring(), Spring()], np.full((1, 1), 0.3)
    together = CoupledZones(laws, lambda: [(0, 0, 1, 0, apart), (1, 0, 0, 0, apart)]).for_run(laws)
    np.testing.assert_allclose(together.forces([np.array([-1.0]), np.array([-0.1])]), [[1.0], [0.0]], rtol=1e-12)


class Roaming(Spring):
    """The same with one row, at a node that its coordinates name."""

    row_nodes = np.zeros(1, dtype=int)

    @property
    def last(self):
        return np.zeros((1, 3))

    def reset(self):
        super().reset()
        self.memory = SimpleNamespace(forces=np.zeros((2, 1)), closed=False)

    def accept(self):
        """Remember the present force at its node."""
        forces = np.zeros((2, 1))
        forces[self.row_nodes] = self.lam
        self.memory = SimpleNamespace(forces=forces, closed=bool(forces.any()))

    def gap_at(self, q):
        self.row_nodes = q[:1].astype(int)
        return q[1:]


class Listener(Runaway):
    """A contact with friction that presses nothing, and knows what the other one has pushed it."""

    d = 3
    friction, remembers, viscous, on_rows = True, True, False, np.zeros((1, 3))
    row_nodes, index = np.zeros(1, dtype=int), np.empty(0)

    def reset(self):
        self.lam = np.zeros(1)

    def side_rows(self, side):
        return np.eye(3)

    def answer(self, h, pushed=None):
        self.pushed = pushed
        return self

    def generalised(self):
        return self.lam


def test_rows_that_a_neighbour_has_again_have_pushed_nothing_in_the_last_step():
    """Friction counts what a frictionless contact has changed since the last step, on the rows that it had then."""
    laws, found = [Listener(), Roaming()], []
    links = [(0, 0, 1, 0, np.ones((3, 1))), (1, 0, 0, 0, np.ones((1, 3)))]
    together = CoupledZones(laws, lambda: links).for_run(laws)
    for n, (node, depth) in enumerate([(0, 1), (0, 4), (1, 3), (0, 5)]):
        laws[0].since = float(n)
        together.forces([np.zeros(1), np.array([node, -depth], dtype=float)])
        found.append(laws[0].pushed[0])
        laws[1].accept()
    np.testing.assert_allclose(found, [[1, 1, 1], [4, 3, 3], [3, 3, 3], [5, 5, 5]])


def test_contacts_with_friction_that_a_run_resumes_have_other_rows_than_forces():
    """Where they stand is known then, and forces are not yet; such runs used to end with a raw error."""
    laws = [Listener(), Roaming()]
    laws[0].row_nodes, laws[0].lam = np.arange(3), np.zeros(2)
    links = [(0, 0, 1, 0, np.ones((3, 1))), (1, 0, 0, 0, np.ones((1, 3)))]
    together = CoupledZones(laws, lambda: links).for_run(laws)
    np.testing.assert_allclose(together.forces([np.zeros(1), np.array([0.0, -2.0])])[1], [2.0])


MU = 0.3
WAYS = np.array([  # of a block that is pressed on, pushed along, tilted so that a foot opens, and left where it is [um]
    (0, 0, 0), (0, 0, -1), (0.2, 0, -1), (0.5, 0.1, -1.2), (0.2, 0.4, 0.5), (0.2, 0.4, -0.8), (0.2, 0.4, -0.8)
]) * 1e-6  # fmt: skip
TILTS = np.array([0, 0, 0, 0, 6e-4, -1e-4, -1e-4])  # [rad]


def block_on(radius, maxh):
    """A block over a rigid plane with three patches side by side, which push each other in all directions."""
    fem = ep.fe_model(occ.Box((0, 0, 0), (0.012, 0.004, 0.003)), ep.STEEL, maxh=maxh)
    feet = [ep.Partition.ball(fem, (x, 2e-3, 0), radius, axes="xyz") for x in (2e-3, 6e-3, 10e-3)]
    return ep.reduce(fem, feet[0] | feet[1] | feet[2], f_cut=150e3)


@pytest.fixture(scope="module")
def block_on_feet():
    """Its rows are few."""
    return block_on(1.2e-3, maxh=1.3e-3)


@pytest.fixture(scope="module")
def block_on_broad_feet():
    """Its rows are too many for one dense factor."""
    return block_on(1.6e-3, maxh=0.9e-3)


def of_feet(body, friction=MU):
    """Contacts of a run, and what solves them together."""
    sides = [Side.of(InertialKinematics(body, np.zeros(3)), patch) for patch in range(3)]
    laws = [compliant(RigidGaps(side, RigidPlane()), friction and ep.Coulomb(friction)) for side in sides]
    links = [(j, 0, k, 0, body.flexibility(j, k)) for j, k in permutations(range(3), 2)]
    kind = CoupledContacts if friction is None else CoupledFriction
    return laws, kind(laws, lambda: links).for_run(laws)


@pytest.mark.parametrize("block", ["block_on_feet", "block_on_broad_feet"])
def test_frictional_forces_are_those_of_the_whole_problem(block, request):
    """A patch moves rows of others along their tangents too, by what its forces have changed since the last step."""
    body = request.getfixturevalue(block)
    laws, together = of_feet(body)
    rows, F = [law.rows.side_rows(0) for law in laws], [[law.rows.flexibility()] * 3 for law in laws]
    for j, k in permutations(range(3), 2):
        F[j][k] = rows[j] @ body.flexibility(j, k) @ rows[k].T
    F = np.block(F)
    assert (len(F) > 200) == (block == "block_on_broad_feet")
    whole, lam, last_q = FrictionProblem(regularised(F)), np.zeros((len(F) // 3, 3)), np.zeros(body.n_dofs)
    for n, (way, tilt) in enumerate(zip(WAYS, TILTS, strict=True)):
        for law in laws:
            law.accept(float(n))
        q = body.rigid @ [*way, 0, tilt, 0]
        together.forces([q] * 3)
        moved = [law.rows.jacobian(np.arange(len(law.gaps.row_nodes))) @ (q - last_q) for law in laws]
        h = (np.concatenate(moved) - F @ lam.ravel()).reshape(-1, 3)
        h[:, 0] = np.concatenate([law.gaps.at(q) for law in laws])
        lam, last_q = whole.solve(h, np.full(len(h), MU)).copy(), q
        found = np.concatenate([law.evaluation.on_rows for law in laws])
        np.testing.assert_allclose(found, lam, rtol=0, atol=1e-8 * abs(lam).max())
        assert not found.any() or broken_law(F, h, np.full(len(h), MU), found) < 1e-7  # by plain NumPy
        if n == 3:
            pushed = sum(
                rows[1] @ body.flexibility(1, k) @ (laws[k].evaluation.on_rows.ravel() @ rows[k]) for k in (0, 2)
            )
            assert {STICK, SLIP} < {*np.concatenate([law.evaluation.status for law in laws])}
            assert abs(pushed.reshape(-1, 3)[:, 1:]).max() > 1e-7
    for law in laws:  # nothing moved in the last step
        assert abs(law.evaluation.slips[law.evaluation.index]).max() < 1e-12


def test_energy_of_patches_that_move_each_other_is_that_of_their_forces(block_on_feet):
    """While rows stick there is a potential; it used to lack what each patch stores by the displacements of others."""
    body, (laws, together) = block_on_feet, of_feet(block_on_feet, 10.0)
    together.forces([np.zeros(body.n_dofs)] * 3)
    for law in laws:
        law.accept(0.0)
    q = body.rigid[:, :3] @ [0.2e-6, 0.1e-6, -1.2e-6]
    found = sum(together.forces([q] * 3))
    assert all((law.evaluation.status[law.evaluation.index] == STICK).all() for law in laws)
    for way in np.random.default_rng(1).standard_normal((3, body.n_dofs)):
        way *= 1e-9 / abs(np.vstack([law.evaluation.row_jacobian() for law in laws]) @ way).max()
        energy = []
        for sign in (1, -1):
            together.forces([q + sign * way] * 3)
            energy.append(sum(law.evaluation.stored for law in laws))
        assert -found @ way == pytest.approx((energy[0] - energy[1]) / 2, rel=1e-4)


def test_a_patch_that_is_not_positive_definite_is_refused(block_on_feet):
    """Also if another contact closes first."""
    sides = [Side.of(InertialKinematics(block_on_feet, np.zeros(3)), patch) for patch in range(3)]
    sides[2] = replace(sides[2], flexibility=-sides[2].flexibility)
    laws = [compliant(RigidGaps(side, RigidPlane()), ep.Coulomb(MU)) for side in sides]
    links = [(j, 0, k, 0, block_on_feet.flexibility(j, k)) for j, k in permutations(range(3), 2)]
    together = CoupledFriction(laws, lambda: links).for_run(laws)
    away, near = (block_on_feet.rigid @ [0, 0, z, 0, tilt, 0] for z, tilt in ((0.0, -1e-4), (-1e-6, 0.0)))
    together.forces([away] * 3)
    assert laws[0].evaluation.index.size
    assert not laws[2].evaluation.index.size
    with pytest.raises(IndefiniteMatrixError):
        together.forces([near] * 3)


def test_contacts_without_friction_among_others(block_on_feet):
    """They are as contacts with a coefficient of zero: their normal forces push the others along tangents too."""
    body, found = block_on_feet, []
    for none in (None, ep.Coulomb(0.0)):
        sides = [Side.of(InertialKinematics(body, np.zeros(3)), patch) for patch in range(3)]
        laws = [
            compliant(RigidGaps(side, RigidPlane()), friction)
            for side, friction in zip(sides, [none, ep.Coulomb(MU), none], strict=True)
        ]
        links = [(j, 0, k, 0, body.flexibility(j, k)) for j, k in permutations(range(3), 2)]
        together, forces = CoupledFriction(laws, lambda links=links: links).for_run(laws), []
        for n, (way, tilt) in enumerate(zip(WAYS, TILTS, strict=True)):
            for law in laws:
                law.accept(float(n))
            forces += [
                *together.forces([body.rigid @ [*way, 0, tilt, 0]] * 3),
                [sum(law.evaluation.stored for law in laws)],
            ]
        found.append(np.concatenate(forces))
    assert abs(found[0]).max() > 1.0
    np.testing.assert_allclose(*found, rtol=1e-7, atol=1e-7 * abs(found[1]).max())


@pytest.mark.parametrize("friction", [None, MU])
def test_stiffness_of_coupled_contacts_against_finite_differences(block_on_feet, friction):
    """Between all closed rows of both, in stick and in slip, where it is not symmetric."""
    body, (laws, together) = block_on_feet, of_feet(block_on_feet, friction)
    for n, way in enumerate(WAYS[:4]):
        for law in laws:
            law.accept(float(n))
        q = body.rigid[:, :3] @ way
        together.forces([q] * 3)
    rows = {j: np.eye(law.rows.d * law.evaluation.index.size) for j, law in enumerate(laws)}
    stiffness = together.stiffness(rows)
    stiffness = np.block([[stiffness[j, k] for k in rows] for j in rows])
    index, states = [law.evaluation.index for law in laws], [law.evaluation.status for law in laws]
    H = np.vstack([law.evaluation.row_jacobian() for law in laws])

    def forces(way):
        together.forces([q + way] * 3)
        for law, rows, state in zip(laws, index, states, strict=True):
            np.testing.assert_array_equal(law.evaluation.index, rows)
            np.testing.assert_array_equal(law.evaluation.status, state)
        return np.concatenate([law.evaluation.on_rows[rows].ravel() for law, rows in zip(laws, index, strict=True)])

    for way in np.random.default_rng(0).standard_normal((3, body.n_dofs)):
        way *= 1e-10 / abs(H @ way).max()
        change = (forces(way) - forces(-way)) / 2
        np.testing.assert_allclose(-stiffness @ (H @ way), change, rtol=0, atol=2e-4 * abs(change).max())


@pytest.mark.parametrize("friction", [None, MU])
def test_stiffness_of_contacts_that_just_touch(block_on_feet, friction):
    """It is that of the whole flexibility of all their rows: the load on one foot moves the rows of the others."""
    body, (laws, together) = block_on_feet, of_feet(block_on_feet, friction)
    together.forces([np.zeros(body.n_dofs)] * 3)
    all_rows = [np.arange(len(law.gaps.row_nodes)) for law in laws]
    H = [dense(law.rows.jacobian(rows)) for law, rows in zip(laws, all_rows, strict=True)]
    sides = [law.rows.side_rows(0) for law in laws]
    F = [[sides[j] @ body.flexibility(j, k) @ sides[k].T for k in range(3)] for j in range(3)]
    for j in range(3):
        F[j][j] = regularised(laws[j].rows.flexibility(all_rows[j]))
    for places in ([0, 1, 2], [2, 0]):
        inverse = np.linalg.inv(np.block([[F[j][k] for k in places] for j in places]))
        whole = scipy.linalg.block_diag(*(H[j] for j in places))
        found = together.closed_stiffness(places)
        found = np.block([[found[j, k] for k in places] for j in places])
        expected = whole.T @ inverse @ whole
        alone = scipy.linalg.block_diag(*(laws[j].closed_stiffness() for j in places))
        np.testing.assert_allclose(found, expected, rtol=0, atol=0.02 * abs(alone - expected).max())


@pytest.mark.skipif(not compiles(), reason="numba does not load here")
def test_compiled_loops_tell_what_the_laws_do(block_on_feet):
    """Forces, energies and gaps, also of a contact that is open; laws keep what they took when loops go on."""
    body, (laws, together) = block_on_feet, of_feet(block_on_feet, None)
    frozen = together.frozen([np.arange(body.n_dofs)] * 3, None)
    for tilt in (0.0, 2e-4, -3e-4):
        q = body.rigid @ [0, 0, -5e-7, 0, tilt, 0]
        own, alone = of_feet(body, None)
        forces = alone.forces([q] * 3)
        assert frozen.at(q)
        assert frozen.force.any()
        np.testing.assert_allclose(frozen.force, sum(forces), rtol=0, atol=1e-9 * abs(frozen.force).max())
        for law, values, stored in zip(own, frozen.values, frozen.stored, strict=True):
            gap = law.evaluation.least_gap
            expected = [law.evaluation.lam.sum(), law.evaluation.index.size, *law.evaluation.resultant(), gap]
            np.testing.assert_allclose(values, expected, rtol=1e-8, atol=1e-15)
            assert stored == pytest.approx(law.evaluation.stored, rel=1e-8, abs=1e-20)
    assert not all(law.evaluation.index.size for law in own)
    assert together.answer_as(frozen, [q] * 3)
    frozen.at(2 * q)
    for law, same in zip(laws, own, strict=True):
        np.testing.assert_allclose(
            law.evaluation.lam, same.evaluation.lam, rtol=0, atol=1e-9 * same.evaluation.lam.max()
        )
        assert law.evaluation.least_gap == pytest.approx(same.evaluation.least_gap, rel=1e-9)
