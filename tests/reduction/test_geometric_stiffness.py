"""Geometric stiffness of loads: virials, Euler's columns and rotating beams, and an energy with its derivatives."""

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
import scipy.linalg
from oracles import box, each_way, hexahedra, split, write_deck

import exudyn_partition as ep
from exudyn_partition.errors import InputError
from exudyn_partition.fe.facets import nodal_area
from exudyn_partition.frames.loops import stiffening_force

LENGTH, WIDTH, HEIGHT = 0.3, 0.010, 0.006
EULER = np.pi**2 * ep.ALUMINIUM.E * WIDTH * HEIGHT**3 / 12 / LENGTH**2
# Frequencies of a cantilever that rotates about its clamped end, across the plane of rotation, by the rate of rotation;
# both times the root of rho A L^4 / E I. A. D. Wright et al., J. Appl. Mech. 49, 1982, table 1.
WRIGHT = {1: 3.6816, 3: 4.7973, 6: 7.3604}
AT_REST = 3.5160


def column_model(kind):
    shape = box(WIDTH, HEIGHT, LENGTH)
    shape.faces.Min(occ.Z).name, shape.faces.Max(occ.Z).name = "foot", "head"
    fem = ep.fe_model(shape, ep.ALUMINIUM, maxh=12e-3)
    ends = [ep.Partition.interface(fem, name, name, kind=kind) for name in ("foot", "head")]
    return fem, ends[0] | ends[1]


@pytest.fixture(scope="module", params=["rigid", "averaged"])
def model(request):
    """A column along z with an interface at each end."""
    return column_model(request.param)


def with_patch(fem, partition):
    """The same with a contact patch on a side, whose nodes basis "free" keeps."""
    return fem, partition | ep.Partition.ball(fem, (0, HEIGHT / 2, LENGTH / 2), 13e-3)


@pytest.fixture(scope="module", params=["contact-adapted", "free"])
def column(model, request):
    own = with_patch(*model) if request.param == "free" else model
    return ep.reduce(*own, f_cut=5e3, basis=request.param, geometric_stiffness=True)


@pytest.fixture(scope="module")
def block_model():
    fem = ep.fe_model(box(0.01, 0.01, 0.01), ep.STEEL, maxh=5e-3)
    return fem, ep.Partition.ball(fem, (0, 0, 0.01), 3e-3)


def stress_integral(body, load):
    """Integral of the stress over the body (3, 3), by the work of rigid rotations: tr(S) 1 - S."""
    turned = body.rigid[:, 3:]
    work = turned.T @ body.geometric_stiffness(load) @ turned
    return np.trace(work) / 2 * np.eye(3) - work


def test_the_stress_of_loads_in_balance_has_their_virial(column):
    """Of tension and shear force times length, of torsion none."""
    foot, head = column.interface_rows("foot"), column.interface_rows("head")
    virial = np.zeros((3, 3))
    virial[2, 2] = 700 * LENGTH
    assert stress_integral(column, 700 * (head[2] - foot[2])) == pytest.approx(virial, abs=1e-6 * 700 * LENGTH)
    assert abs(stress_integral(column, head[5] - foot[5])).max() < 1e-8
    if column.partition.interfaces[0].kind == "averaged":  # the moment on a rigid one turns with it
        shear = 700 * (head[0] - foot[0]) - 700 * LENGTH * foot[4]
        virial = np.zeros((3, 3))
        virial[0, 2] = virial[2, 0] = 700 * LENGTH
        assert stress_integral(column, shear) == pytest.approx(virial, abs=1e-6 * 700 * LENGTH)


@pytest.mark.parametrize("basis", ["contact-adapted", "residual", "free"])
def test_the_stress_of_a_force_on_a_patch_has_its_virial_below_all_axial_modes(basis):
    """Inertia balances the force: its tension falls to zero over the length, so that the mean is a half of it."""
    fem = ep.fe_model(box(WIDTH, HEIGHT, LENGTH), ep.ALUMINIUM, maxh=12e-3)
    ends = ep.Partition.ball(fem, (0, 0, 0), 4e-3) | ep.Partition.ball(fem, (0, 0, LENGTH), 4e-3)
    column = ep.reduce(fem, ends, f_cut=3e3, basis=basis, geometric_stiffness=True)
    patch = ends.patches[1]
    share = nodal_area(fem.points, patch.facets)[patch.nodes]
    forces = np.outer(share / share.sum(), [0, 0, 700.0])
    pulled = stress_integral(column, column.rows(patch.nodes).T @ forces.ravel())
    assert pulled[2, 2] == pytest.approx(700 * LENGTH / 2, rel=5e-3)


def test_centrifugal_loads_are_those_of_the_mesh(model, column):
    """By rho omega x (omega x X) at every node; the integral of the stress is half the second moment of inertia's."""
    fem, _ = model
    omega, arms = np.array([30.0, -50.0, 20.0]), fem.points - fem.centre_of_mass
    mass = fem.mass if column.basis.mass == "consistent" else fem.lumped_mass_matrix
    forces = mass @ -np.cross(omega, np.cross(omega, arms)).ravel()
    on_coordinates = column.rows(np.arange(fem.n_nodes)).T @ forces
    load = column.centrifugal_load(omega)
    assert load == pytest.approx(on_coordinates, rel=1e-8, abs=1e-10 * abs(load).max())
    # Around an axis across the column: tension rho w^2 (L^2 / 4 - z^2) / 2, whose integral is m w^2 L^2 / 12.
    across = stress_integral(column, column.centrifugal_load([40.0, 0, 0]))
    assert across[2, 2] == pytest.approx(column.total_mass * 40.0**2 * LENGTH**2 / 12, rel=1e-3)


@pytest.mark.parametrize(
    "basis", ["contact-adapted", "residual", "free", "free with nodes", "craig-bampton with nodes"]
)
def test_a_hinged_strut_loses_stiffness_as_euler_says(model, basis):
    own = with_patch(*model) if basis.endswith("with nodes") else model
    column = ep.reduce(*own, f_cut=5e3, basis=basis.removesuffix(" with nodes"), geometric_stiffness=True)
    foot, head = column.interface_rows("foot"), column.interface_rows("head")
    free = scipy.linalg.null_space(np.vstack([foot[:3], foot[5:], head[:2]]))
    K, M, G = (
        free.T @ matrix @ free
        for matrix in (column.stiffness, column.mass, column.geometric_stiffness(head[2] - foot[2]))
    )

    def lowest(force):
        return np.sqrt(scipy.linalg.eigh(K - force * G, M, eigvals_only=True)[0])

    for share in (-1.0, 0.4, 0.8):
        assert lowest(share * EULER) == pytest.approx(lowest(0.0) * np.sqrt(1 - share), rel=2e-3)


def test_rotation_stiffens_a_cantilever_across_its_plane():
    """Clamped at the axis of rotation, against Wright's table."""
    length = 0.5
    shape = box(length, 0.010, 0.008)
    shape.faces.Min(occ.X).name = "root"
    fem = ep.fe_model(shape, ep.STEEL, maxh=15e-3)
    body = ep.reduce(fem, ep.Partition.interface(fem, "root", "root"), f_cut=1e3, geometric_stiffness=True)
    root = body.interface_rows("root")
    free = scipy.linalg.null_space(root)

    def lowest(omega):
        reaction = -root[0] * body.total_mass * omega**2 * length / 2
        K = body.stiffness + body.geometric_stiffness(body.centrifugal_load([0, omega, 0]) + reaction)
        # Bending along y, which rotation about y does not soften; thicker than along z.
        values, motions = scipy.linalg.eigh(free.T @ K @ free, free.T @ body.mass @ free)
        tip = body.rows(np.array([body.nearest_node((length / 2, 0, 0.004))])) @ free @ motions
        return np.sqrt(values[int((abs(tip[1]) > abs(tip[2])).argmax())])

    for rate, frequency in WRIGHT.items():
        found = lowest(rate * lowest(0.0) / AT_REST) / lowest(0.0)
        assert found == pytest.approx(frequency / AT_REST, rel=2e-3)


def test_force_and_tangent_are_derivatives_of_an_energy_above_zero(column):
    rng = np.random.default_rng(0)
    sizes = np.full(column.n_dofs, 1e-6)  # of nodes [m]
    sizes[: column.n_shapes] = np.where(column.basis.omega > 0, 1 / column.basis.omega.max(), 1e-3)
    q, way = rng.normal(size=(2, column.n_dofs)) * sizes
    stiffening, small = column.stiffening, 1e-4
    assert column.strain_energy(q) > 0
    more, less = q + small * way, q - small * way
    slope = (column.strain_energy(more) - column.strain_energy(less)) / (2 * small)
    assert slope == pytest.approx((column.stiffness @ q + stiffening.force(q)) @ way, rel=1e-5)
    change = (stiffening.force(more) - stiffening.force(less)) / (2 * small)
    assert change == pytest.approx(stiffening.tangent(q) @ way, rel=1e-4, abs=1e-6 * abs(change).max())
    assert column.strain_energy(np.array([q, way])) == pytest.approx([column.strain_energy(x) for x in (q, way)])


def test_compiled_forces_are_those_of_numpy(column):
    q = np.random.default_rng(1).normal(size=column.n_dofs) * 1e-4
    compiled, plain = each_way(lambda: stiffening_force(column.stiffening, q))
    np.testing.assert_allclose(compiled, plain, rtol=1e-9, atol=1e-12 * abs(plain).max())


def test_a_compact_body_may_have_nothing_to_stiffen(block_model):
    """All its modes lie above: it has no states of stress, and runs."""
    fem, partition = block_model
    body = ep.reduce(fem, partition, f_cut=2e3, geometric_stiffness=True)
    assert body.strain_energy(np.ones(body.n_dofs)) >= 0
    for frame in ("inertial", "floating"):
        mbs = exu.SystemContainer().AddSystem()
        ep.CreatePartitionBody(mbs, body, frame=frame, initialVelocity=[0, 0, 1.0])
        mbs.Assemble()
        assert ep.solve_dynamic(mbs, end_time=1e-5, step=1e-6, method="implicit").status == "finished"


def test_without_it_bodies_are_as_before(model):
    body = ep.reduce(*model, f_cut=5e3)
    assert body.stiffening is None
    assert any("geometric_stiffness=True" in said for said in body.left_out)
    with pytest.raises(InputError, match="body: it has no geometric stiffness"):
        body.geometric_stiffness(np.zeros(body.n_dofs))


def test_it_is_kept_in_files(column, tmp_path):
    column.save(tmp_path / "column.npz")
    read = ep.load_body(tmp_path / "column.npz")
    assert not any("geometric_stiffness=True" in said for said in read.left_out)
    load = column.interface_rows("head")[2]
    assert (read.geometric_stiffness(load) == column.geometric_stiffness(load)).all()


def test_all_kinds_of_elements_have_that_virial(tmp_path):
    points, blocks = split(*hexahedra(2, 2, 3), ["wedge"] * 6 + ["hexahedron", "pyramid"] * 3)
    fem = ep.fe_model(write_deck(tmp_path / "bar.inp", points, *blocks), ep.STEEL)
    ends = [
        ep.Partition.interface(fem, name, plane=((0, 0, z), (0, 0, side)), kind="averaged")
        for name, z, side in (("foot", 0, -1), ("head", 0.03, 1))
    ]
    body = ep.reduce(fem, ends[0] | ends[1], f_cut=0.8 * fem.resolved_frequency, geometric_stiffness=True)
    pulled = stress_integral(body, body.interface_rows("head")[2] - body.interface_rows("foot")[2])
    assert pulled == pytest.approx(np.diag([0, 0, 0.03]), abs=1e-6 * 0.03)


def test_what_has_none_is_refused(model):
    fem, partition = model
    alone = ep.FEModel.from_matrices(fem.mass, fem.stiffness, fem.points, fem.facets, material=fem.material)
    with pytest.raises(InputError, match="geometric stiffness needs the elements"):
        ep.reduce(alone, partition, f_cut=5e3, geometric_stiffness=True)
