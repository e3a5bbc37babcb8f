"""Files for ParaView: read back, they hold the bodies' own recovery, and what theory says of it."""

from xml.etree import ElementTree

import meshio
import numpy as np
import pytest
from oracles import TOP, relative

import exudyn_partition as ep
from exudyn_partition.errors import InputError
from exudyn_partition.present.output import FIELDS, write_paraview
from exudyn_partition.reduction import recovery

TETRA_VOLUME_SHARE = 1 / 6


@pytest.fixture
def run(impact):
    """The ball on the block, followed over the impact's peak."""
    mbs, striker, target, contact = impact
    return ep.solve_dynamic(mbs, end_time=20e-6, step=0.2e-6), striker, target, contact


def files_of(pvd):
    """(time, part, path) of each file that a PVD lists."""
    root = ElementTree.parse(pvd).getroot()
    assert (root.tag, root.get("type")) == ("VTKFile", "Collection")
    return [(float(d.get("timestep")), int(d.get("part")), pvd.parent / d.get("file")) for d in root.iter("DataSet")]


def test_fields_read_back_are_the_body_s_own(run, ball, block, tmp_path):
    result, striker, target, _ = run
    times = [0.0, 10e-6, 17.03e-6]
    pairs = [(striker, ball[0]), (target, block)]
    fields = [field for field in FIELDS if not field.startswith("contact_")]
    pvd = write_paraview(tmp_path, result, pairs, fields=fields, times=times, surface=False, static_answer=False)
    files = files_of(pvd)
    assert [(round(t * 1e6, 6), part) for t, part, _ in files] == [
        (t, part) for t in (0.0, 10.0, 17.0) for part in (0, 1)
    ]
    for t, part, path in files:
        mesh, (item, fem) = meshio.read(path), pairs[part]
        i = int(np.argmin(abs(result.t - t)))
        q, q_t = item.coordinates(result)[i], item.coordinates_t(result)[i]
        u, data = item.body.displacement(q), mesh.point_data
        np.testing.assert_array_equal(mesh.cells_dict["tetra10"], fem.cells)
        np.testing.assert_allclose(mesh.points, fem.points + item.position, atol=1e-15)
        np.testing.assert_allclose(data["displacement"], u, atol=1e-15)
        np.testing.assert_allclose(data["velocity"], item.body.displacement(q_t), atol=1e-12)
        stress = recovery.nodal_stress(fem, u)
        np.testing.assert_allclose(data["stress"], stress, atol=1e-9 * abs(stress).max())
        np.testing.assert_allclose(data["von_mises"], recovery.von_mises(stress), atol=1e-9 * abs(stress).max())
        # The mean displacement by mass is the motion of the centre of mass, and deformation has none.
        for name, expected in (("displacement", item.kinematics.rigid_motion(q)[:3]), ("deformation", np.zeros(3))):
            momentum = (fem.mass @ data[name].ravel()).reshape(-1, 3).sum(axis=0)
            np.testing.assert_allclose(momentum / fem.total_mass, expected, atol=1e-9 * abs(u).max() + 1e-18)
    assert {*data} == {*fields}


def test_quadratic_elements_have_their_nodes_where_vtk_wants_them(run, ball, tmp_path):
    """The ball's volume by VTK's own shape functions: mid-side nodes at other edges would fold its elements."""
    result, striker, *_ = run
    pvd = write_paraview(tmp_path, result, [(striker, ball[0])], times=1, surface=False)
    mesh = meshio.read(files_of(pvd)[0][2])
    # VTK's quadratic tetrahedron: mid-side nodes of edges 01, 12, 20, 03, 13, 23.
    edges = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]
    corner_gradient = np.vstack([-np.ones(3), np.eye(3)])
    a, b = (5 - np.sqrt(5)) / 20, (5 + 3 * np.sqrt(5)) / 20
    volume = 0.0
    for barycentric in np.full((4, 4), a) + (b - a) * np.eye(4):
        gradient = [(4 * barycentric[i] - 1) * corner_gradient[i] for i in range(4)]
        gradient += [4 * (barycentric[i] * corner_gradient[j] + barycentric[j] * corner_gradient[i]) for i, j in edges]
        jacobian = np.einsum("eka,kb->eab", mesh.points[mesh.cells_dict["tetra10"]], np.array(gradient))
        determinant = np.linalg.det(jacobian)
        assert (determinant > 0).all()
        volume += determinant.sum() / 4 * TETRA_VOLUME_SHARE
    assert volume == pytest.approx(ball[0].total_mass / ep.STEEL.rho, rel=1e-6)
    assert volume == pytest.approx(4 / 3 * np.pi * 0.010**3, rel=2e-3)


def test_the_surface_alone_is_closed_and_has_the_same_values(run, ball, block, tmp_path):
    result, _, target, _ = run
    inside = files_of(write_paraview(tmp_path / "all", result, [(target, block)], times=[20e-6], surface=False))
    outside = files_of(write_paraview(tmp_path / "surface", result, [target], times=[20e-6]))
    full, mesh = meshio.read(inside[0][2]), meshio.read(outside[0][2])
    triangles = mesh.cells_dict["triangle6"]
    assert len(np.unique(triangles)) == len(mesh.points) < len(full.points)
    a, b, c = mesh.points[triangles[:, :3]].transpose(1, 0, 2)
    volume = np.einsum("fi,fi->", a, np.cross(b, c)) / 6  # divergence theorem, outward facets
    assert volume == pytest.approx(0.01 * 0.02 * 0.03, rel=1e-9)
    middle = (mesh.points[triangles[:, [0, 1, 2]]] + mesh.points[triangles[:, [1, 2, 0]]]) / 2
    np.testing.assert_allclose(mesh.points[triangles[:, 3:]], middle, atol=1e-15)  # a box has straight edges
    order = np.lexsort(np.round(full.points, 9).T)
    of_full = {
        tuple(np.round(x, 9)): u
        for x, u in zip(full.points[order], full.point_data["displacement"][order], strict=True)
    }
    kept = np.array([of_full[tuple(np.round(x, 9))] for x in mesh.points])
    # With an FE model the static answer comes on top; without contact it is nothing, here it is a share.
    assert 1e-3 < relative(mesh.point_data["displacement"], kept) < 0.5


def test_static_answer_closes_the_contact_and_stresses_what_is_beneath(run, ball, block, tmp_path):
    """Complementarity with the full FE answer: rows that carry force have no gap left, all others have one."""
    result, striker, target, contact = run
    pairs = [(striker, ball[0]), (target, block)]
    peak = float(result.t[contact.force(result).argmax()])
    options = {"times": [peak], "fields": ["displacement", "von_mises"], "surface": False}
    meshes = {
        key: [
            meshio.read(path)
            for *_, path in files_of(write_paraview(tmp_path / str(key), result, pairs, static_answer=key, **options))
        ]
        for key in (True, False)
    }
    gaps = contact.mechanics.gaps
    lam = contact.row_forces(result.at([peak])).toarray()[0][gaps.row_nodes]
    left = {}
    for key, fields in meshes.items():
        h = gaps.stage.linear.start.copy()
        for (nodes, weights), (item, patch) in zip(gaps.stage.shares, contact.sides, strict=True):
            mesh = fields[0 if item is striker else 1]
            u = mesh.point_data["displacement"][item.body.partition.patches[patch].nodes]
            h += np.einsum("pk,pkd,pd->p", weights, u[nodes], gaps.stage.normals)
        left[key] = h
    depth = -left[False].min()
    assert depth > 1e-7
    assert abs(left[True][lam > 0]).max() < 0.01 * depth
    assert left[True][lam == 0].min() > -0.01 * depth
    largest = {key: max(mesh.point_data["von_mises"].max() for mesh in fields) for key, fields in meshes.items()}
    assert largest[True] > 2 * largest[False]


def test_contact_pressure_carries_the_force(run, ball, tmp_path):
    result, striker, target, contact = run
    peak = float(result.t[contact.force(result).argmax()])
    files = files_of(write_paraview(tmp_path, result, fields="contact_pressure", times=[peak]))
    of = {part: meshio.read(path) for _, part, path in files}
    slave = [striker, target].index(contact.slave)
    assert "contact_pressure" not in of[1 - slave].point_data
    mesh = of[slave]
    triangles, p = mesh.cells_dict["triangle6"], mesh.point_data["contact_pressure"]
    a, b, c = mesh.points[triangles[:, :3]].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    force = area @ p[triangles[:, :3]].mean(axis=1)
    assert force == pytest.approx(contact.force(result).max(), rel=0.05)
    np.testing.assert_allclose(p[triangles[:, 3:]], (p[triangles[:, :3]] + p[triangles[:, [1, 2, 0]]]) / 2)


def test_a_spinning_body(mbs, bodies, block, tmp_path):
    """A quarter of a turn in a floating frame: displacement is the turn and a small rest, the deformation."""
    omega, angle = 2e3, np.pi / 2
    spin = ep.CreatePartitionBody(mbs, bodies[1], name="a b", frame="floating", initialAngularVelocity=[0, 0, omega])
    mbs.Assemble()
    end = angle / omega
    result = ep.solve_dynamic(mbs, end_time=end, step=1e-6)
    fields = ("displacement", "deformation", "velocity", "stress")
    files = files_of(write_paraview(tmp_path, result, [(spin, block)], fields=fields, times=[end], surface=False))
    assert files[0][2].name == "a_b_0000.vtu"
    data = meshio.read(files[0][2])
    c = block.centre_of_mass
    turn = spin.kinematics.frame(spin.coordinates(result)[-1])[1]
    np.testing.assert_allclose(turn, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-4)  # it widens, and turns slower
    place = (block.points - c) @ turn.T + c
    moved, deformation = (data.point_data[key] for key in ("displacement", "deformation"))
    size = abs(deformation).max()
    assert 0 < size < 1e-6
    np.testing.assert_allclose(block.points + moved, place + deformation, atol=1e-12)
    np.testing.assert_allclose(
        data.point_data["velocity"], np.cross([0, 0, omega], place - c), atol=0.02 * omega * 0.01
    )
    u = spin.body.displacement(spin.kinematics.elastic(spin.coordinates(result)[-1]))
    u += spin.kinematics.at(np.arange(block.n_nodes)).grown(spin.coordinates_t(result)[-1])
    stress = recovery.nodal_stress(block, u)
    np.testing.assert_allclose(data.point_data["stress"], stress, atol=1e-9 * abs(stress).max())


def test_what_is_asked_for_must_be_there(run, ball, block, tmp_path):
    result, striker, *_ = run
    for options, message in (
        ({"fields": "vonMises"}, "fields: expected one of 'displacement', .*, got 'vonMises'"),
        ({"fields": "von_mises"}, r"bodies: stress of 'a body' needs its FE model, give pairs \(body, fem\)"),
        ({"surface": False}, "bodies: the inside of 'a body' needs its FE model"),
        (
            {"bodies": [(striker, block)]},
            r"bodies, 'a body': expected the body's own mesh: is of a mesh with \d+ nodes",
        ),
        ({"bodies": [striker.body]}, "expected what CreatePartitionBody returns, .* got ReducedBody"),
        ({"times": [0.0, 1.0]}, "times: expected times of the run, 0 to 2e-05 s, got 1"),
        ({"times": 0}, "times: expected a whole number of at least 1"),
    ):
        with pytest.raises(InputError, match=message):
            write_paraview(tmp_path / "none", result, **options)
    assert not (tmp_path / "none").exists()


def test_frames_are_spread_over_the_run(run, tmp_path):
    result, *_ = run
    files = files_of(write_paraview(tmp_path, result, times=5))
    np.testing.assert_allclose(sorted({t for t, *_ in files}), np.linspace(0, 20e-6, 5), atol=0.1e-6)
    assert len(files) == 10
    assert {path.name for *_, path in files} == {path.name for path in tmp_path.glob("*.vtu")}


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.ContactPatchWarning")  # the coarse block's own pass
@pytest.mark.parametrize("options", [{}, {"rows": "node-to-segment"}, {"formulation": "penalty"}])
def test_nodal_forces_are_those_of_the_run(mbs, bodies, options, tmp_path):
    striker = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP, initialVelocity=[0, 0, -1.0])
    target = ep.CreatePartitionBody(mbs, bodies[1])
    contact = ep.CreatePartitionContact(mbs, striker, target, **options)
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=15e-6, step=0.1e-6)
    some = result.at(4)
    force = contact.force_on_slave(some)
    forces = contact.nodal_forces(some)
    assert abs(force[-1]).max() > 500
    for sign, on_nodes in zip((1, -1), forces, strict=True):
        np.testing.assert_allclose(on_nodes.sum(axis=1), sign * force, atol=1e-6 * abs(force).max())
    files = files_of(write_paraview(tmp_path, some, fields="contact_pressure", times=some.t[-1:]))
    with_pressure = ["contact_pressure" in meshio.read(path).point_data for *_, path in files]
    assert sum(with_pressure) == 1


@pytest.mark.parametrize(
    "names",
    [("a b", "a/b"), ("Rod", "rod"), ("a_2", "a", "A"), ("x" * 400, "x" * 401), ("\u00e4" * 300, "$"), ("", "body0")],
)
def test_every_body_has_files_of_its_own(mbs, bodies, tmp_path, names):
    """Names that differed only in what a file cannot have shared their files, and long ones had none."""
    items = [
        ep.CreatePartitionBody(mbs, bodies[1], name=name, referencePosition=[0.1 * i, 0, 0])
        for i, name in enumerate(names)
    ]
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=1e-6, step=0.5e-6)
    files = files_of(write_paraview(tmp_path, result, times=2))
    assert len({path.name.casefold() for *_, path in files}) == 2 * len(items)
    for _, part, path in files:
        assert meshio.read(path).points[:, 0].min() == pytest.approx(0.1 * part - 5e-3)
