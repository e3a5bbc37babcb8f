"""Strain and stress: patch tests, gauges against quadrature, beam and wave theory, reduced against full."""

import exudyn as exu
import meshio
import netgen.occ as occ
import numpy as np
import pytest
import scipy.sparse.linalg
from oracles import box, relative
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.algebra.krylov import eigenmodes, mass_normalised
from exudyn_partition.errors import InputError, ModelLimitWarning
from exudyn_partition.reduction import recovery

RADIUS = 0.010
GRADIENT = np.array([[1.0, 2.0, -0.5], [0.3, -0.7, 4.0], [2.5, -3.0, 0.6]])  # du_a / dx_b
BAR = ep.Material(E=210e9, nu=0.0, rho=7800.0)  # no lateral contraction: beam theory is exact


def voigt(tensor):
    """xx, yy, zz, yz, xz, xy of symmetric tensors, (..., 3, 3)."""
    return tensor[..., [0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]


def engineering(gradient):
    """Strain of displacement gradients, (..., 3, 3), shear counted twice."""
    return voigt((gradient + np.swapaxes(gradient, -1, -2)) / 2) * [1, 1, 1, 2, 2, 2]


def hooke(gradient, material):
    """Stress tensor of one displacement gradient [Pa]."""
    strain = (gradient + gradient.T) / 2
    return 2 * material.shear_modulus * strain + material.lame * np.trace(strain) * np.eye(3)


def points_in_box(n, lx, ly, lz):
    """Random points of `conftest.box`."""
    return (np.random.default_rng(1).random((n, 3)) - [0.5, 0.5, 0]) * [lx, ly, lz]


def points_in_ball(n, radius):
    """Random points of a ball around the origin, a third of them on its surface."""
    rng = np.random.default_rng(2)
    unit = rng.normal(size=(n, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    return unit * radius * np.minimum(1.5 * rng.random((n, 1)), 1)


KINDS = ["block, linear", "block, quadratic", "ball, faceted", "ball, curved", "ball, cubic"]


@pytest.fixture(scope="module", params=KINDS)
def sample(request, block):
    """An FE model and points in it."""
    if request.param.startswith("block"):
        linear = request.param.endswith("linear")
        fem = ep.fe_model(box(0.01, 0.02, 0.03), ep.STEEL, order=1, maxh=6e-3) if linear else block
        return fem, points_in_box(200, 0.01, 0.02, 0.03)
    order = ["faceted", "curved", "cubic"].index(request.param.split()[-1]) + 1
    shape = occ.Sphere(occ.Pnt(0, 0, 0), RADIUS)
    fem = ep.fe_model(shape, ep.ALUMINIUM, order=order, maxh=8e-3 if order == 3 else 4e-3)
    return fem, points_in_ball(200, RADIUS if order > 1 else 0.85 * RADIUS)


@pytest.fixture(scope="module")
def bar():
    """A bar of 8 x 10 x 100 mm along z."""
    return ep.fe_model(box(0.008, 0.010, 0.1), BAR, maxh=8e-3)


def test_linear_fields_are_exact_anywhere(sample):
    fem, points = sample
    u = (fem.points @ GRADIENT.T + [1, 2, 3]).ravel()
    np.testing.assert_allclose(
        (recovery.displacement_rows(fem, points) @ u).reshape(-1, 3), points @ GRADIENT.T + [1, 2, 3], atol=1e-10
    )
    strain, stress = engineering(GRADIENT), voigt(hooke(GRADIENT, fem.material))
    for got, expected in (
        ((recovery.strain_rows(fem, points) @ u).reshape(-1, 6), strain),
        ((recovery.stress_rows(fem, points) @ u).reshape(-1, 6), stress),
        (recovery.nodal_strain(fem, u.reshape(-1, 3)), strain),
        (recovery.nodal_stress(fem, u.reshape(-1, 3)), stress),
    ):
        np.testing.assert_allclose(got, np.tile(expected, (len(got), 1)), atol=1e-8 * abs(expected).max())


def test_gauges_of_a_linear_field_read_its_normal_strain(sample):
    fem, points = sample
    u = (fem.points @ GRADIENT.T).ravel()
    axes = np.random.default_rng(3).normal(size=(20, 3))
    gauges = [ep.StrainGauge(0.7 * p + [0, 0, 1e-3], d, 0.5e-3) for p, d in zip(points, axes, strict=False)]
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    expected = np.einsum("ga,ab,gb->g", axes, GRADIENT, axes)
    np.testing.assert_allclose(recovery.gauge_rows(fem, gauges) @ u, expected, atol=1e-8)


def test_rigid_motion_strains_nothing(sample):
    fem, points = sample
    modes = fem.rigid_modes
    scale = abs(modes).max() / 1e-3
    gauge = ep.StrainGauge(points[0] / 2 + [0, 0, 1e-3], (1, 2, 3), 1e-3)
    assert abs(recovery.strain_rows(fem, points) @ modes).max() < 1e-12 * scale
    assert abs(recovery.gauge_rows(fem, [gauge]) @ modes).max() < 1e-12 * scale
    assert abs(recovery.nodal_strain(fem, modes[:, 3].reshape(-1, 3))).max() < 1e-12 * scale


def test_quadratic_fields_are_exact_on_straight_quadratic_elements(block):
    second = np.random.default_rng(4).normal(size=(3, 3, 3))
    second += second.transpose(0, 2, 1)  # u_a = second_abc x_b x_c / 2
    u = np.einsum("abc,nb,nc->na", second, block.points, block.points) / 2
    points = points_in_box(100, 0.01, 0.02, 0.03)
    strain = (recovery.strain_rows(block, points) @ u.ravel()).reshape(-1, 6)
    np.testing.assert_allclose(strain, engineering(np.einsum("abc,nc->nab", second, points)), atol=1e-11)
    field = recovery.nodal_strain(block, u)
    np.testing.assert_allclose(field, engineering(np.einsum("abc,nc->nab", second, block.points)), atol=1e-11)


def test_a_gauge_reads_the_mean_of_the_strain_along_it(block):
    """Numerical quadrature over several elements, of a field that jumps between them."""
    u = np.sin(block.points @ np.array([[300.0, 0, 200], [0, 250, 100], [400, 0, 300]]))
    gauge = ep.StrainGauge((1e-3, 2e-3, 0.015), (1, 3, 5), 0.02)
    start, end = gauge.ends
    n = 4000
    along = start + (np.arange(n)[:, None] + 0.5) / n * (end - start)
    strain = (recovery.strain_rows(block, along) @ u.ravel()).reshape(-1, 6)
    tensor = (strain * [1, 1, 1, 0.5, 0.5, 0.5])[:, [0, 5, 4, 5, 1, 3, 4, 3, 2]].reshape(-1, 3, 3)
    mean = np.einsum("a,nab,b->n", gauge.direction, tensor, gauge.direction).mean()
    assert (recovery.gauge_rows(block, [gauge]) @ u.ravel())[0] == pytest.approx(mean, rel=1e-3)


def test_a_gauge_on_a_curved_surface():
    """Its ends stand out of the ball by L^2 / 8R = 12.5 um, which moves no reading of a linear field."""
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), RADIUS), ep.STEEL, maxh=4e-3)
    gauge = ep.StrainGauge((0, 0, RADIUS), (1, 0, 0), 1e-3)
    assert np.linalg.norm(gauge.ends, axis=1) == pytest.approx(RADIUS + 12.5e-6, abs=1e-7)
    reading = recovery.gauge_rows(fem, [gauge]) @ (fem.points @ GRADIENT.T).ravel()
    assert reading == pytest.approx([GRADIENT[0, 0]], rel=1e-9)


def test_nodal_strain_is_weighted_by_volume():
    """Against a loop over the nodes of linear elements, whose strain is that at their centroids."""
    fem = ep.fe_model(box(0.01, 0.02, 0.03), ep.STEEL, order=1, maxh=1e-2)
    u = np.random.default_rng(7).normal(size=(fem.n_nodes, 3))
    rows = recovery.strain_rows(fem, fem.points[fem.cells].mean(axis=1))
    in_cells = (rows @ u.ravel()).reshape(-1, 6)
    expected = []
    for node in range(fem.n_nodes):
        around = (fem.cells == node).any(axis=1)
        expected.append(np.average(in_cells[around], axis=0, weights=fem.cell_mass[around]))
    np.testing.assert_allclose(recovery.nodal_strain(fem, u), expected, rtol=1e-9, atol=1e-9)


def test_a_node_at_which_a_cell_is_nearly_flat_has_the_strain_of_what_is_around(block, tmp_path):
    """A middle node near a quarter of its edge leaves the cell no volume at the corner: derivatives there are huge."""
    points, cell = block.points.copy(), block.cells[len(block.cells) // 2]
    points[cell[4]] = points[cell[0]] + 0.251 * (points[cell[1]] - points[cell[0]])
    meshio.write(tmp_path / "spoiled.vtu", meshio.Mesh(points, [("tetra10", block.cells)]))
    spoiled = ep.fe_model(tmp_path / "spoiled.vtu", ep.STEEL)
    x, y, z = spoiled.points.T
    exact = np.column_stack([np.zeros((len(x), 3)), z, x, y])
    error = abs(recovery.nodal_strain(spoiled, spoiled.points[:, [1, 2, 0]] ** 2 / 2) - exact).max()
    assert error < 0.2 * abs(exact).max()  # as strain changes within a cell; ten times all strain by its derivatives


def test_a_rosette_reads_shear(block):
    """Three gauges at 0, 45 and 90 degrees as in the paper's figure 5: gamma_xy = 2 S2 - S1 - S3."""
    u = (block.points @ GRADIENT.T).ravel()
    S1, S2, S3 = (ep.StrainGauge((0, 0, 0.03), d, 1e-3) for d in ((1, 0, 0), (1, 1, 0), (0, 1, 0)))
    s1, s2, s3 = recovery.gauge_rows(block, [S1, S2, S3]) @ u
    assert (s1, s3) == pytest.approx((GRADIENT[0, 0], GRADIENT[1, 1]))
    assert 2 * s2 - s1 - s3 == pytest.approx(GRADIENT[0, 1] + GRADIENT[1, 0])


def test_points_in_a_graded_mesh_are_found(sphere):
    """Beside small elements the centroid of a large one is farther than those of hundreds of small ones."""
    fem, _ = sphere
    points = points_in_ball(500, 1.2e-3) + np.array([0, 0, 1.3e-3])
    got = recovery.displacement_rows(fem, points) @ fem.points.ravel()
    np.testing.assert_allclose(got, points.ravel(), atol=1e-15)


def test_von_mises_is_the_norm_of_the_deviator():
    stress = np.random.default_rng(5).normal(size=(4, 5, 3, 3))
    stress += np.swapaxes(stress, -1, -2)
    deviator = stress - np.trace(stress, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) / 3
    expected = np.sqrt(1.5 * (deviator**2).sum(axis=(-2, -1)))
    np.testing.assert_allclose(recovery.von_mises(voigt(stress)), expected, rtol=1e-12)
    assert recovery.von_mises([-7, 0, 0, 0, 0, 0]) == pytest.approx(7)


def consistent_load(fem, facets, traction):
    """(3n,) nodal forces of a uniform traction on flat quadratic facets, which stands at their mid-side nodes."""
    a, b, c = (fem.points[facets[:, i]] for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    load = np.zeros((fem.n_nodes, 3))
    np.add.at(load, facets[:, 3:].ravel(), np.outer(np.repeat(area / 3, 3), traction))
    return load.ravel()


def clamped_bar(bar, traction):
    """Displacements (n, 3) of the bar, clamped at z = 0, under a uniform traction on its other end."""
    load = consistent_load(bar, bar.facets[(bar.points[bar.facets, 2] > 0.1 - 1e-9).all(axis=1)], traction)
    free = np.flatnonzero(np.repeat(bar.points[:, 2] > 1e-9, 3))
    u = np.zeros(bar.n_dofs)
    u[free] = scipy.sparse.linalg.spsolve(bar.stiffness[free][:, free].tocsc(), load[free])
    return u


def test_axial_load_against_bar_theory(bar):
    u = clamped_bar(bar, (0, 0, 5e6))
    gauge = ep.StrainGauge((0.004, 0, 0.05), (0, 0, 1), 5e-3)
    assert (recovery.gauge_rows(bar, [gauge]) @ u)[0] == pytest.approx(5e6 / BAR.E, rel=1e-9)
    stress = recovery.nodal_stress(bar, u.reshape(-1, 3))
    np.testing.assert_allclose(stress, np.tile([0, 0, 5e6, 0, 0, 0], (bar.n_nodes, 1)), atol=5e-2)
    np.testing.assert_allclose(recovery.von_mises(stress), 5e6, rtol=1e-8)


def test_bending_against_beam_theory(bar):
    u = clamped_bar(bar, (1e6, 0, 0))
    force, inertia = 1e6 * 0.008 * 0.010, 0.010 * 0.008**3 / 12
    upper, lower, middle = (ep.StrainGauge((x, 0, 0.04), (0, 0, 1), 5e-3) for x in (0.004, -0.004, 0))
    strains = recovery.gauge_rows(bar, [upper, lower, middle]) @ u
    expected = -force * (0.1 - 0.04) * 0.004 / (BAR.E * inertia)
    np.testing.assert_allclose(strains, [expected, -expected, 0], atol=5e-3 * abs(expected))


def test_strain_of_the_first_longitudinal_mode(bar):
    """U = A cos(pi z / L), strain -A pi / L sin(pi z / L), whose mean over a gauge has a factor sinc."""
    modes = eigenmodes(bar.stiffness, bar.mass, mass_normalised(bar.rigid_modes, bar.mass), 2 * np.pi * 28e3)
    shapes = modes.vectors.reshape(-1, 3, len(modes.omega))
    axial = int(np.argmax(bar.lumped_mass @ shapes[:, 2] ** 2))
    assert modes.omega[axial] == pytest.approx(np.pi * BAR.bar_wave_speed / 0.1, rel=1e-4)
    amplitude = shapes[bar.nearest_node((0, 0, 0)), 2, axial]
    z, length = np.array([0.02, 0.03, 0.05, 0.08]), 20e-3
    gauges = [ep.StrainGauge((0.004, 0.001, height), (0, 0, 1), length) for height in z]
    expected = -amplitude * np.pi / 0.1 * np.sin(np.pi * z / 0.1) * np.sinc(length / 0.2)
    np.testing.assert_allclose(recovery.gauge_rows(bar, gauges) @ modes.vectors[:, axial], expected, rtol=2e-3)


@pytest.mark.parametrize("basis", ["free", "residual", "contact-adapted"])
def test_reduced_rows_recover_what_the_full_ones_do(block, top, basis):
    body = ep.reduce(block, top, basis=basis, f_cut=80e3)
    gauges = [ep.StrainGauge((0, 0, 0.03), (1, 1, 0), 1e-3), ep.StrainGauge((0.005, 0, 0.01), (0, 0, 1), 1e-3)]
    q = np.random.default_rng(6).normal(size=body.n_dofs)
    for rows in (recovery.gauge_rows(block, gauges), recovery.stress_rows(block, [(0, 0, 0.029), (0, 0.004, 0.01)])):
        expected = rows @ body.displacement(q).ravel()
        reduced = body.reduced_rows(rows)
        assert reduced.shape == (rows.shape[0], body.n_dofs)
        assert relative(reduced @ q, expected) < 1e-12


def test_history_of_a_run(impact, block):
    mbs, _, target, contact = impact
    result = ep.solve_dynamic(mbs, end_time=30e-6, step=0.5e-6)
    gauges = [ep.StrainGauge((0.005, 0, z), (0, 0, 1), 1e-3, f"S{z}") for z in (0.02, 0.005)]
    rows = recovery.gauge_rows(block, gauges)
    strain = target.recover(result, rows)
    assert strain.shape == (len(result.t), 2)
    u = target.body.displacement(target.coordinates(result)[-1]).ravel()
    np.testing.assert_allclose(strain[-1], rows @ u, rtol=1e-9)
    # The block is pushed from above: the pressure wave reaches the upper gauge first, and compresses it.
    begins = [np.flatnonzero(s < 0.2 * s.min())[0] for s in strain.T]
    assert contact.force(result).max() > 0
    assert begins[0] < begins[1]


@pytest.mark.parametrize("basis", ["residual", "contact-adapted"])
def test_static_correction_leaves_inertia_alone(block, top, basis):
    """Harmonic pressure on the patch: the gauges' error falls with the square of the frequency, to nothing."""
    body = ep.reduce(block, top, basis=basis, f_cut=80e3)
    gauges = [ep.StrainGauge((0.005, 0, 0.025), (0, 0, 1), 1e-3), ep.StrainGauge((0, 0.008, 0.03), (1, 0, 0), 1e-3)]
    rows = recovery.gauge_rows(block, gauges)
    load = consistent_load(block, top.patches[0].facets, -top.patches[0].direction)
    load /= np.linalg.norm(load.reshape(-1, 3).sum(axis=0))
    correction = rows @ recovery.static_correction(block, body).ravel()
    kept, corrected = [], []
    for frequency in (2e3, 4e3):
        omega_squared = (2 * np.pi * frequency) ** 2
        full = rows @ scipy.sparse.linalg.spsolve((block.stiffness - omega_squared * block.mass).tocsc(), load)
        shapes = (load @ body.basis.shapes) / (body.basis.omega**2 - omega_squared)
        reduced = body.reduced_rows(rows) @ shapes
        kept.append(relative(reduced, full))
        corrected.append(relative(reduced + correction, full))
    assert min(kept) > 0.02  # why the correction is worth while
    assert corrected[1] < 0.02 * kept[1]
    assert corrected[1] / corrected[0] == pytest.approx(4, rel=0.05)


BELOW, FAR = (0, 0, -0.006), (0.02, 0.02, -0.006)  # the ball on the plate; and its corner
SIDE = ep.StrainGauge((0, 0, -0.006), (1, 0, 0), 1e-3)


@pytest.fixture(scope="module")
def plate():
    """A plate of aluminium, 40 x 40 x 6 mm, with a patch at the origin."""
    shape = occ.Box(occ.Pnt(-0.02, -0.02, -0.006), occ.Pnt(0.02, 0.02, 0))
    fine = ep.Refine((0, 0, 0), 1e-3, 0.5e-3)
    fem = ep.fe_model(shape, ep.ALUMINIUM, maxh=6e-3, refine=[fine], grading=0.6)
    return fem, ep.Partition.ball(fem, (0, 0, 0), 1.5e-3)


@pytest.fixture(scope="module")
def reduced_plate(plate, kept):
    """The same, reduced to a frequency."""
    return lambda f_cut: ep.reduce(*plate, basis="residual", f_cut=f_cut, cache=kept)


def strike(striker, body, plate, frame="inertial", static=True):
    """A ball on the plate: force, displacement, velocity and strain below, and the plate, the result."""
    mbs = exu.SystemContainer().AddSystem()
    turned = Rotation.from_rotvec([0, 0.5 * np.pi * (frame == "floating"), 0]).as_matrix()
    options = {"frame": "floating", "referenceRotation": turned} if frame == "floating" else {}
    thrown = ep.CreatePartitionBody(mbs, striker, initialVelocity=-0.5 * turned[:, 2], **options)
    item = ep.CreatePartitionBody(mbs, body, name="plate", **options)
    contact = ep.CreatePartitionContact(mbs, thrown, item)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=80e-6, step=5e-7, method="implicit", spectral_radius=1.0)
    fem = recovery.StaticAnswer(plate[0], body) if static else None
    strain = item.recover(result, recovery.gauge_rows(plate[0], [SIDE]), fem=fem)
    u, v = (tell(result, BELOW, fem=fem) @ turned for tell in (item.displacement, item.velocity))
    return (contact.force(result), u, v, strain), item, result


@pytest.fixture(scope="module")
def rich(bodies, reduced_plate, plate):
    """Histories with far more modes."""
    return strike(bodies[0], reduced_plate(200e3), plate)[0]


@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_points_near_a_contact_have_its_static_answer(ball, plate, bodies, reduced_plate, rich, frame):
    """Below a plate that is hit, against far more modes: the force is there with few, and with `fem` the motion is."""
    striker, coarse = bodies[0], reduced_plate(30e3)
    with pytest.warns(ModelLimitWarning, match=r"body 'plate': near a contact the (velocity|displacement) of a point"):
        kept, item, result = strike(striker, coarse, plate, frame, static=False)
    complete = strike(striker, coarse, plate, frame)[0]
    errors = [[relative(*pair) for pair in zip(history, rich, strict=True)] for history in (kept, complete)]
    assert errors[0][0] < 0.02
    for before, after in zip(errors[0][1:], errors[1][1:], strict=True):
        assert after < 0.5 * before
    item.velocity(result, FAR)  # without a warning
    for ask in (lambda: item.velocity(result, BELOW), lambda: result.history(result.contacts[0], {"": (item, BELOW)})):
        with pytest.warns(ModelLimitWarning) as caught:
            ask()
        assert caught[0].filename == __file__
    points = {"below": (item, BELOW, plate[0]), "far": (item, FAR)}
    velocity = result.history(result.contacts[0], points).velocity
    np.testing.assert_array_equal(velocity["below"], item.velocity(result, BELOW, fem=plate[0]))
    with pytest.raises(InputError, match="fem: expected the body's own mesh"):
        item.velocity(result, BELOW, fem=ball[0])
    with pytest.raises(InputError, match="fem: expected what fe_model"):
        item.velocity(result, BELOW, fem=3.0)
    other = recovery.StaticAnswer(plate[0], reduced_plate(30e3))
    with pytest.raises(InputError, match="got one of another body"):
        item.displacement(result, BELOW, fem=other)


def test_static_correction_needs_a_residual_flexibility_and_its_mesh(block, top, ball):
    with pytest.raises(InputError, match="body: basis 'free' has no residual flexibility"):
        recovery.static_correction(block, ep.reduce(block, top, basis="free", f_cut=80e3))
    with pytest.raises(InputError, match="fem: expected the body's own mesh"):
        recovery.static_correction(ball[0], ep.reduce(block, top, basis="residual", f_cut=80e3))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((0, 0, 0), (0, 0, 0), 1e-3), "direction: expected the gauge's axis"),
        (((0, 0, 0), (1, 0, 0), 0.0), "length: expected a finite number above zero in m"),
        (((0, 0), (1, 0, 0), 1e-3), r"position: expected shape \(3,\)"),
        (((0, 0, 0), (1, 0, np.inf), 1e-3), "direction: expected finite numbers"),
    ],
)
def test_bad_gauges(arguments, message):
    with pytest.raises(InputError, match=message):
        ep.StrainGauge(*arguments)


def test_a_point_outside_names_its_distance_and_the_nearest_point(block):
    with pytest.raises(InputError, match=r"points\[1\]: .* outside the body, 0\.002 m from .*, \[0\.005 0\.001 0\.01 "):
        recovery.strain_rows(block, [(0, 0, 0.01), (0.007, 0.001, 0.01)])


def test_a_gauge_that_leaves_the_body(block):
    inside = ep.StrainGauge((0, 0, 0.03), (0, 1, 0), 1e-3)
    out = ep.StrainGauge((0, 0, 0.03), (0, 1, 1), 5e-3, "S2")  # on the upper face, but not along it
    with pytest.raises(InputError, match=r"gauges\[1\] 'S2': .* outside the body"):
        recovery.gauge_rows(block, [inside, out])


def test_wrong_shapes(block, top):
    with pytest.raises(InputError, match=r"displacement: expected shape"):
        recovery.nodal_strain(block, np.zeros(block.n_dofs))
    with pytest.raises(InputError, match="stress: expected six components"):
        recovery.von_mises(np.zeros((6, 2)))
    body = ep.reduce(block, top, basis="residual", f_cut=80e3)
    with pytest.raises(InputError, match=r"rows: expected \d+ columns"):
        body.reduced_rows(scipy.sparse.csr_matrix((1, 3)))


def test_hexahedra_recover_a_uniform_strain(bricks):
    gradient = 1e-4 * np.array([[1.0, 0.5, -0.2], [0.3, -0.4, 0.2], [0.1, 0.6, 0.7]])
    strain = (gradient + gradient.T) / 2
    rows = recovery.strain_rows(bricks, bricks.points.mean(axis=0)[None] + 1e-4)
    voigt = [*strain.diagonal(), *2 * strain[[1, 0, 0], [2, 2, 1]]]
    np.testing.assert_allclose(rows @ (bricks.points @ gradient.T).ravel(), voigt, atol=1e-15)
