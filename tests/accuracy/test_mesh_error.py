"""Estimated error of meshes: beside the true one, by body, and what is refused."""

from dataclasses import replace
from types import SimpleNamespace

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
import scipy.sparse as sp
from oracles import SPHERE_MATERIAL
from scipy.spatial import Delaunay

import exudyn_partition as ep
from exudyn_partition.accuracy.correction import Change, Finer
from exudyn_partition.accuracy.mesh_error import estimate_of
from exudyn_partition.accuracy.modal_pair import impact_of
from exudyn_partition.algebra.sparse.solver import solved_by
from exudyn_partition.errors import EmptyRegionError, InputError, PenetrationError, ToleranceWarning
from exudyn_partition.prediction.modal_impact import Impact
from exudyn_partition.reduction.estimate import grow_to_tolerance
from exudyn_partition.reduction.reduction import bodies_of
from exudyn_partition.surfaces.points import contact_points
from exudyn_partition.surfaces.surface import Surface
from validation.mesh import row_spacing

RADIUS, SPEED, END = 5e-3, 0.3, 45e-6
MASS = SPHERE_MATERIAL.rho * 4 / 3 * np.pi * RADIUS**3
A = ep.hertz.impact(MASS / 2, SPEED, RADIUS, RADIUS, SPHERE_MATERIAL, SPHERE_MATERIAL).contact_radius


def marble(h, up):
    """A ball that touches the origin from above or below, of elements of h contact radii: by order, (FEModel, body)."""
    shape = occ.Sphere(occ.Pnt(0, 0, RADIUS if up else -RADIUS), RADIUS)
    fine = ep.Refine((0, 0, 0), 1.8 * A, h * A)
    mesh = ep.generate_mesh(shape, maxh=5e-3, refine=[fine], grading=0.7)
    models = {order: ep.fe_model(mesh, SPHERE_MATERIAL, order=order) for order in (2, 3)}
    parts = {
        order: ep.Partition.ball(fem, (0, 0, 0), (2.2 + h) * A, direction=(0, 0, -1 if up else 1))
        for order, fem in models.items()
    }
    return {order: (fem, ep.reduce(fem, parts[order], f_cut=140e3)) for order, fem in models.items()}


@pytest.fixture(scope="module")
def marbles():
    return [marble(h, up) for h, up in ((0.9, True), (1.0, False))]


@pytest.fixture(scope="module")
def coarse(marbles):
    return [of_order[2] for of_order in marbles]


@pytest.fixture(scope="module")
def grown(coarse):
    """Spaces that keep their factors, their estimate, and FE models with the bodies."""
    models = [(fem, body.partition) for fem, body in coarse]
    options = {"tolerance": 0.02, "speed": SPEED, "duration": END}
    spaces, truncation = grow_to_tolerance(models, [[0, 0]], **options, keep=True)
    bodies = bodies_of(spaces, truncation, 0.0)
    return spaces, truncation, [(fem, body) for (fem, _), body in zip(coarse, bodies, strict=True)]


def force(pairs):
    mbs = exu.SystemContainer().AddSystem()
    (_, upper), (_, lower) = pairs
    striker = ep.CreatePartitionBody(mbs, upper, initialVelocity=[0, 0, -SPEED])
    contact = ep.CreatePartitionContact(mbs, striker, ep.CreatePartitionBody(mbs, lower), passes="given")
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=END, step=0.1e-6)
    return contact.force(result)


@pytest.fixture(scope="module")
def exact(marbles):
    return force([of_order[3] for of_order in marbles])


def test_the_estimate_is_near_what_the_next_order_makes(exact, coarse):
    """On the same mesh; cubic elements have finer rows too. The estimates of each body alone are parts of that."""
    true = np.linalg.norm(force(coarse) - exact) / np.linalg.norm(exact)
    estimate = ep.mesh_error(*coarse, speed=SPEED, duration=END)
    assert true > 0.02
    assert 0.6 < estimate.force / true < 1.7
    assert max(estimate.of_bodies) < estimate.force < 1.2 * sum(estimate.of_bodies)
    assert 0 < estimate.velocity < estimate.force == estimate.error


def test_against_a_rigid_plane_the_mesh_is_what_limits(coarse):
    """Half of the speed on a plane is the same impact as that of two equal balls: by symmetry it has the same error."""
    fem, body = coarse[0]
    upper, lower = (ep.mesh_error(pair, ep.RigidPlane(), speed=SPEED / 2, duration=END) for pair in (coarse[0], (
        coarse[0][0], ep.reduce(fem, body.partition, tolerance=0.02, speed=SPEED / 2, duration=END))))  # fmt: skip
    both = ep.mesh_error(*coarse, speed=SPEED, duration=END)
    assert upper.force == pytest.approx(both.force, rel=0.35)
    assert upper.force == pytest.approx(np.hypot(upper.of_bodies[0], upper.rows), rel=0.02)
    assert upper.far[0] < 0.2 * upper.local[0] == pytest.approx(0.2 * upper.error, rel=0.2)
    assert upper.limit == ""
    with pytest.raises(InputError, match="truncation: not known"):
        upper.total  # noqa: B018
    estimate = lower.truncation
    assert lower.total == max(lower.force + estimate.force, lower.velocity + estimate.velocity) > 0.02
    assert lower.limit.startswith("the mesh of the body, at the contact")


def test_a_contact_within_few_rows_is_told(coarse):
    with pytest.warns(ToleranceWarning, match="expected 4 rows of the contact or more that carry force, got [1-3]"):
        ep.mesh_error(coarse[0], ep.RigidPlane(), speed=SPEED / 20, duration=END)


def test_bodies_tell_all_errors_apart_and_together_and_name_the_mesh(grown, coarse, tmp_path):
    """In a file too."""
    _, truncation, pairs = grown
    with pytest.raises(InputError, match="the error of the meshes is not known"):
        truncation.total  # noqa: B018
    with pytest.warns(
        ToleranceWarning, match=r"total error is 0\.\d+, of which .* is the mesh of the (slave|master), at"
    ):
        told, other = ep.with_mesh_error(*pairs)
    estimate, found = told.estimate, ep.mesh_error(*pairs, speed=SPEED, duration=END)
    assert estimate == other.estimate
    assert (estimate.mesh_force, estimate.mesh_velocity, estimate.total) == (found.force, found.velocity, found.total)
    assert (estimate.force, estimate.velocity) == (truncation.force, truncation.velocity)
    assert 0 < estimate.step < 2 * estimate.force
    assert estimate.limit == found.limit
    told.save(tmp_path / "told.npz")
    assert ep.load_body(tmp_path / "told.npz").estimate == estimate
    with pytest.raises(InputError, match="speed: expected one"):
        ep.with_mesh_error(*coarse, duration=END)
    with pytest.raises(InputError, match="estimate: a body has none"):
        ep.with_mesh_error(pairs[0], coarse[1])


def test_corrected_bodies_have_a_smaller_error(exact, grown):
    """The rows of the contact keep their own; the estimate stays that of the meshes."""
    _, _, pairs = grown
    with pytest.warns(ToleranceWarning, match="total error"):
        better = ep.with_mesh_error(*pairs, correct=True)
    corrected = [(fem, body) for (fem, _), body in zip(pairs, better, strict=True)]
    before, after = (np.linalg.norm(force(each) - exact) / np.linalg.norm(exact) for each in (pairs, corrected))
    assert after < 0.5 * before < 0.5 * 1.7 * better[0].estimate.mesh_force
    with pytest.raises(InputError, match="correct: expected"):
        ep.with_mesh_error(*pairs, correct="yes")


def test_factors_that_a_reduction_keeps_serve_the_estimate_and_the_next_reduction(grown):
    """So neither factorises anything, and both give what they give alone."""
    spaces, truncation, pairs = grown
    options = {"speed": SPEED, "duration": END}
    alone = ep.mesh_error(*pairs, **options)
    models = [(fem, body.partition) for fem, body in pairs]
    with solved_by(lambda matrix: pytest.fail("a matrix is factorised")):
        again, same = grow_to_tolerance(models, [[0, 0]], tolerance=0.02, **options, known=spaces)
        finers = [Finer(*pair, space.elastic) for pair, space in zip(pairs, again, strict=True)]
        estimate = estimate_of(*impact_of(pairs, [0, 0], SPEED), SPEED, END, finers)
    assert same == truncation
    assert (estimate.force, estimate.velocity) == pytest.approx((alone.force, alone.velocity), rel=1e-6)


def test_few_ways_of_forces_tell_as_much_as_all_nodes_of_the_patches(grown):
    """Bodies that keep nearly all of the error are judged by what each node of their patches changes."""
    spaces, _, pairs = grown
    finers = [Finer(*pair, space.elastic) for pair, space in zip(pairs, spaces, strict=True)]
    scene = *impact_of(pairs, [0, 0], SPEED), SPEED, END
    few, every = (estimate_of(*scene, finers, left) for left in (1.0, 1 - 1e-9))
    assert (few.force, few.velocity) == pytest.approx((every.force, every.velocity), rel=0.15)


def test_rows_that_carry_force_are_those_inside_the_circle_of_hertz(coarse):
    """Rows farther away than an element of their own width carry none; the estimate corrects none of them."""
    _, impact = impact_of(coarse, [0, 0], SPEED)
    loaded = impact.loaded(END, impact.step(140e3))
    away = np.sqrt(2 * RADIUS / 2 * impact.gap)  # gaps of two spheres: r^2 / (2 R*), R* = R / 2
    assert away[loaded].max() < A + impact.size
    assert loaded[away < 0.7 * A].all()
    assert 0.1 < loaded.mean() < 0.6


def test_rows_on_a_coarser_grid_bear_an_even_pressure_too(marbles):
    """Its forces on the rows are as their areas."""
    for fem, body in marbles[0].values():
        (side,), _ = impact_of([(fem, body)], [0], SPEED, ep.RigidPlane())
        area = contact_points(Surface.of(fem.points, side.patch, np.zeros(3)), "integrated").area
        pressed = np.linalg.lstsq(side.coarse.T, area)[0]
        assert len(side.coarse) < len(area)
        np.testing.assert_allclose(pressed @ side.coarse, area, rtol=1e-9)


END_OF_FIVE = 3.0  # [s]


def of_five_rows():
    """A body with a rigid motion and three modes, two of one frequency, that hits with five rows in a line; its side.

    Rows share points with the rows beside them.
    """
    rng = np.random.default_rng(0)
    H = np.column_stack([np.ones(5), 0.3 * rng.normal(size=(5, 3))])
    F = 0.05 * (np.eye(5) + 0.3 * np.exp(-abs(np.subtract.outer(np.arange(5), np.arange(5)))))
    gap = np.array([0.6, 0.02, 0.0, 0.03, 0.6])
    impact = Impact(gap, H, F, np.array([0.0, 3.0, 3.0, 5.0]), np.array([-1.0, 0.0, 0.0, 0.0]), 1.0)
    return impact, bare_side(sp.diags([0.5, 0.5], [0, 1], shape=(5, 6), format="csr"))


def bare_side(mean, **options):
    """A side of points without a place; each of its rows is one dof of the body."""
    n_rows, n = mean.shape
    nodes = np.arange(-(-n_rows // 3))
    return SimpleNamespace(
        body=SimpleNamespace(f_cut=1.0, estimate=None), fem=SimpleNamespace(n_dofs=3 * len(nodes)), mean=mean,
        on_patch=sp.eye(n_rows, 3 * len(nodes), format="csr"), patch=SimpleNamespace(nodes=nodes),
        corners=np.zeros((n, 3), int), local=np.zeros((n, 2)), normals=np.zeros((n, 3)),
        **{"spacing": 1.0, **options},
    )  # fmt: skip


def changing(squares, gaps, flexibility, turn=None):
    """What the next order adds to a body, for each way of forces on its rows."""

    def change(on_nodes, _):
        ways = on_nodes.toarray()[:, : len(gaps)]
        return Change(np.eye(len(squares)) if turn is None else turn, squares, ways @ gaps, ways @ flexibility @ ways.T)

    return SimpleNamespace(change=change)


def test_the_estimate_is_the_difference_to_the_impact_that_has_the_changes():
    """Changes of modes are far from the contact, those of the flexibility at it."""
    impact, side = of_five_rows()
    rng, squares = np.random.default_rng(1), impact.omega**2 * [1.0, 0.9, 0.95, 0.9]
    gaps, flexibility = 0.02 * rng.normal(size=(5, 4)), 0.01 * np.eye(5)

    def off(better):
        (_, f, v), (_, f_better, v_better) = (each.run(END_OF_FIVE, 1e-3) for each in (impact, better))
        by_force = np.linalg.norm(f - f_better) / np.linalg.norm(f_better)
        return by_force, np.linalg.norm(v - v_better) / np.linalg.norm(v_better - v_better[0])

    loaded = impact.loaded(END_OF_FIVE, 1e-3)
    assert loaded.sum() == 3
    far = replace(impact, omega=np.sqrt(squares), H=impact.H + gaps)
    found = estimate_of([side], impact, 1.0, END_OF_FIVE, [changing(squares, gaps, flexibility)])
    assert (found.force, found.velocity) == pytest.approx(off(replace(far, F=impact.F + flexibility)), rel=2e-2)
    assert found.far[0] == pytest.approx(max(off(far)), rel=2e-2)
    assert found.local[0] == pytest.approx(max(off(replace(impact, F=impact.F + flexibility))), rel=2e-2)
    assert found.carrying == 3


def test_modes_of_one_frequency_may_be_mixed():
    """They are the same body then, in other coordinates, also if it vibrates already."""
    impact, side = of_five_rows()
    turn = np.eye(4)
    turn[1:3, 1:3] = [[0.6, -0.8], [0.8, 0.6]]
    for velocity in ([-1.0, 0.0, 0.0, 0.0], [-1.0, 0.3, 0.1, 0.2]):
        impact = replace(impact, velocity=np.array(velocity))
        mixed = changing(impact.omega**2, np.zeros((5, 4)), np.zeros((5, 5)), turn)
        found = estimate_of([side], impact, 1.0, END_OF_FIVE, [mixed])
        assert max(found.force, found.velocity) < 1e-9


def test_rows_beside_those_that_carry_are_changed_too():
    """One row alone carries; it gives way, so that those beside it carry too, where the change is not the same."""
    impact, side = of_five_rows()
    own, beside = impact.F[2, 2:4]
    free = 1.02 * (own - beside) / np.sqrt(own)  # above the sunken row, by a force of (m / F)^1/2 v of the unit mass
    impact = replace(impact, H=np.eye(4)[[0] * 5], gap=np.array([9.0, free, 0.0, free, 9.0]))
    local = 0.1 * (side.mean @ side.mean.T).toarray()

    def off(flexibility):
        (_, f, _), (_, better, _) = (each.run(END_OF_FIVE, 1e-3) for each in (impact, replace(impact, F=flexibility)))
        return np.linalg.norm(f - better) / np.linalg.norm(better)

    alone = impact.F.copy()
    alone[2, 2] += local[2, 2]
    found = estimate_of([side], impact, 1.0, END_OF_FIVE, [changing(impact.omega**2, np.zeros((5, 4)), local)])
    assert found.carrying == 1
    assert found.force == pytest.approx(off(impact.F + local), rel=2e-2)
    assert found.force > 1.5 * off(alone)


def on_half_space(fine, coarse, influence):
    """Impact of a rigid sphere on rows of hat functions, (nr, cells), by the contact radius; and coarser means."""
    means = np.linalg.lstsq(fine.T, coarse.T)[0].T * fine.sum(axis=1)
    rows = fine / fine.sum(axis=1)[:, None]
    gap = rows @ (row_spacing.PLACES**2).sum(axis=1) / 2
    near = gap < 1.3  # the sphere comes to 1
    rows, gap = rows[near], gap[near]
    F = rows @ influence @ rows.T / (2 * row_spacing.WIDTH / row_spacing.CELLS) ** 2
    rigid = row_spacing.MASS**-0.5
    impact = Impact(gap, np.full((len(gap), 1), rigid), (F + F.T) / 2, np.zeros(1), np.array([-1 / rigid]), 1.0)
    whole = means[:, near].sum(axis=1) > 0.999 * means.sum(axis=1)
    return impact, means[np.ix_(whole, near)] / means[whole].sum(axis=1)[:, None]


def test_rows_are_as_wrong_as_the_estimate_says(monkeypatch):
    """A sphere on a half-space, where only rows on random grids are wrong; the true force is that of Hertz.

    As in the validation of the rows' spacing, with squares of even pressure that are three times as long.
    """
    cells = 48
    middle = row_spacing.WIDTH * ((2 * np.arange(cells) + 1) / cells - 1)
    monkeypatch.setattr(row_spacing, "CELLS", cells)
    monkeypatch.setattr(row_spacing, "PLACES", np.stack(np.meshgrid(middle, middle), axis=-1).reshape(-1, 2))
    number, kernel = np.indices((cells, cells)).reshape(2, -1), row_spacing.influence()
    influence = kernel[tuple(number[:, :, None] - number[:, None] + cells - 1)]
    rng, t = np.random.default_rng(0), np.linspace(0, row_spacing.END, row_spacing.STEPS + 1)
    true, found = row_spacing.exact(t), []
    for _ in range(6):
        points = row_spacing.vertices(0.7, rng)
        triangles = Delaunay(points).simplices
        hats = (row_spacing.hats(*row_spacing.divided(triangles, points, k)).toarray() for k in (2, 1))
        impact, coarse = on_half_space(*(own[own.any(axis=1)] for own in hats), influence)
        side = bare_side(sp.identity(len(impact.gap), format="csr"), coarse=coarse, spacing=2.0)
        at, force, _ = impact.run(row_spacing.END, row_spacing.END / row_spacing.STEPS)
        error = np.linalg.norm(np.interp(t, at, force[:, 0]) - true) / np.linalg.norm(true)
        nothing = changing(np.zeros(1), np.zeros((len(impact.gap), 1)), np.zeros((len(impact.gap),) * 2))
        estimate = estimate_of([side], impact, 1.0, row_spacing.END, [nothing])
        assert estimate.rows == estimate.local[0] == max(estimate.force, estimate.velocity)
        found.append((estimate.rows, error))
    estimated, error = np.sqrt(np.mean(np.square(found), axis=0))
    assert error / 1.5 < estimated < 1.5 * error < 0.01


def test_what_is_refused(coarse):
    fem, body = coarse[0]
    with pytest.raises(InputError, match="duration: expected one"):
        ep.mesh_error(*coarse, speed=SPEED)
    with pytest.raises(InputError, match=r"duration: 10000 s are .* steps .* expected at most 1e\+06"):
        ep.mesh_error(*coarse, speed=SPEED, duration=1e4)
    with pytest.raises(EmptyRegionError, match="faces away from the rigid surface"):
        ep.mesh_error(coarse[0], ep.RigidPlane(normal=(0, 0, -1)), speed=SPEED, duration=END)
    with pytest.raises(PenetrationError, match="contact rows start inside the rigid surface"):
        ep.mesh_error(coarse[0], ep.RigidPlane((0, 0, 1e-4)), speed=SPEED, duration=END)
    with pytest.raises(InputError, match="patches: a RigidPlane has none"):
        ep.mesh_error(coarse[0], ep.RigidPlane(), speed=SPEED, duration=END, patches=(0, 0))
    with pytest.raises(InputError, match=r"slave: expected \(FEModel, ReducedBody\)"):
        ep.mesh_error(fem, coarse[1], speed=SPEED, duration=END)
    with pytest.raises(InputError, match="master: expected the body's own mesh: is of a mesh with"):
        ep.mesh_error(coarse[0], (fem, coarse[1][1]), speed=SPEED, duration=END)
    nodal = ep.reduce(fem, body.partition, f_cut=340e3, basis="free")
    with pytest.raises(InputError, match="'free', whose contact has no residual flexibility"):
        ep.mesh_error((fem, nodal), coarse[1], speed=SPEED, duration=END)
    with pytest.raises(InputError, match="patches: expected the slave's and the master's"):
        ep.mesh_error(*coarse, speed=SPEED, duration=END, patches="tip")
