"""Interfaces for joints and several patches: exact static answers, rigid ties, mean axes, labels, bad input."""

from itertools import pairwise

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
import pytest
import scipy.linalg
import scipy.sparse.linalg
from conftest import box, relative

import exudyn_partition as ep
from exudyn_partition.errors import EmptyRegionError, InputError
from exudyn_partition.fe.model import node_dofs
from exudyn_partition.reduction.tied import tie

BASES = ["free", "craig-bampton", "residual", "contact-adapted"]
F_CUT = 60e3


@pytest.fixture(scope="module")
def link():
    """A bar along z, 10 x 8 x 60 mm."""
    return ep.fe_model(box(0.010, 0.008, 0.060), ep.STEEL, maxh=6e-3)


def end(fem, z):
    return np.flatnonzero(abs(fem.points[:, 2] - z) < 1e-9)


def jointed(fem, kind, axes="normal"):
    """Contact on a side face, an interface at each end."""
    side = ep.Partition.ball(fem, (0.005, 0, 0.03), 5e-3, axes=axes, name="side")
    foot = ep.Partition.interface(fem, "foot", end(fem, 0.0), kind=kind)
    return side | foot | ep.Partition.interface(fem, "head", end(fem, 0.06), kind=kind)


@pytest.fixture(scope="module", params=[(b, k) for b in BASES for k in ("rigid", "averaged")], ids="-".join)
def body(request, link):
    basis, kind = request.param
    return ep.reduce(link, jointed(link, kind), basis=basis, f_cut=F_CUT)


def elastic_answer(fem, partition, body, load):
    """Full FE answer of the free body to a load, inertia relief by a bordered system; without rigid motion."""
    model = tie(fem, partition, body.basis.mass)
    f = model.expand.T @ load
    border = model.mass @ model.rigid_modes
    balanced = f - border @ np.linalg.solve(model.rigid_modes.T @ border, model.rigid_modes.T @ f)
    system = np.block([[model.stiffness.toarray() / ep.STEEL.E, border], [border.T, np.zeros((6, 6))]])
    return model.expand @ np.linalg.solve(system, np.r_[balanced / ep.STEEL.E, np.zeros(6)])[: model.n]


def test_static_answer_to_joint_forces_is_exact(link, body):
    """No spurious compliance: equal and opposite forces and moments at the two interfaces, and their motion."""
    head, foot = body.interface_rows("head"), body.interface_rows("foot")
    # Opposite resultants about one point: what acts at the head, moved to the foot.
    arm = body.partition.find_interface("head").position - body.partition.find_interface("foot").position
    moved = np.eye(6)
    moved[3:, :3] = np.cross(arm, np.eye(3)).T
    for wrench in np.eye(6):
        load = wrench @ head - (moved @ wrench) @ foot
        rows = [body.partition.find_interface(name) for name in ("head", "foot")]
        full_load = np.zeros((link.n_nodes, 3))
        full_load[rows[0].nodes] = (wrench @ rows[0].motion).reshape(-1, 3)
        full_load[rows[1].nodes] -= ((moved @ wrench) @ rows[1].motion).reshape(-1, 3)
        expected = elastic_answer(link, body.partition, body, full_load.ravel()).reshape(-1, 3)
        expected = [joint.motion @ expected[joint.nodes].ravel() for joint in rows]
        # Relative motion of the interfaces by the reduced stiffness: the pseudo-inverse leaves rigid motion out.
        q = scipy.linalg.lstsq(body.stiffness.toarray(), load, cond=1e-12)[0]
        stretch = head @ q - moved_motion(arm, foot @ q)
        assert relative(stretch, expected[0] - moved_motion(arm, expected[1])) < STATIC[body.basis.name]


# The paper's basis does not know the field that a joint causes within the impact region's nodes' elements otherwise.
STATIC = {"free": 0.02, "craig-bampton": 1e-7, "residual": 1e-7, "contact-adapted": 1e-7}


def moved_motion(arm, motion):
    """Rigid motion at a point `arm` away."""
    return np.r_[motion[:3] + np.cross(motion[3:], arm), motion[3:]]


def test_rigid_interfaces_move_rigidly_and_averaged_ones_deform(link, body):
    for joint in body.partition.interfaces:
        rows = body.rows(joint.nodes)
        rows = rows if isinstance(rows, np.ndarray) else rows.toarray()
        motion = rows - joint.rigid_motion(link) @ (joint.motion @ rows)
        warping = abs(motion).max() / abs(rows).max()
        assert warping < 1e-9 if joint.kind == "rigid" else warping > 1e-3


def test_elastic_columns_keep_the_mean_axes(link, body):
    """Tisserand: no linear nor angular momentum of the whole body in any elastic column."""
    if body.basis.name == "free":
        pytest.skip("its columns are parts of motions; the coupling to rigid motion stays in its mass matrix")
    T = np.column_stack([body.displacement(unit).ravel() for unit in np.eye(body.n_dofs)])
    rigid = link.rigid_modes / np.sqrt(np.einsum("ij,ij->j", link.rigid_modes, link.mass @ link.rigid_modes))
    assert abs(rigid.T @ (link.mass @ T[:, 6:])).max() < 1e-10
    np.testing.assert_allclose(T.T @ (link.mass @ T), np.eye(body.n_dofs), atol=1e-9)


def test_reduced_matrices_are_those_of_a_dense_product(link, body):
    T = np.column_stack([body.displacement(unit).ravel() for unit in np.eye(body.n_dofs)])
    M = link.mass if body.basis.mass == "consistent" else link.lumped_mass_matrix
    for reduced, full in ((body.mass, M), (body.stiffness, link.stiffness)):
        expected = T.T @ (full @ T)
        np.testing.assert_allclose(reduced.toarray(), expected, atol=1e-9 * abs(expected).max())


def test_columns_are_labelled(body):
    labels = body.labels
    assert len(labels) == body.n_dofs == len(body.table().splitlines())
    kinds = {label.split()[0] for label in labels}
    expected = {
        "free": {"region", "nodal"},
        "craig-bampton": {"rigid", "fixed-interface", "constraint"},
        "residual": {"rigid", "elastic", "attachment"},
        "contact-adapted": {"rigid", "elastic", "attachment"},
    }
    assert kinds == expected[body.basis.name]


@pytest.mark.parametrize("kind", ["rigid", "averaged"])
@pytest.mark.parametrize("basis", BASES)
def test_a_body_without_contact(link, basis, kind):
    """Interfaces alone: six rigid columns, named so, with no stiffness at all, and modes and static answers of joints.

    What lies below f_cut is an elastic mode, what lies above is an attachment, which only joints brought in.
    """
    partition = ep.Partition.interface(link, "foot", end(link, 0.0), kind=kind)
    if basis == "craig-bampton" and kind == "averaged":
        with pytest.raises(InputError, match="'craig-bampton' needs a boundary that holds the body"):
            ep.reduce(link, partition, basis=basis, f_cut=F_CUT)
        return
    body = ep.reduce(link, partition, basis=basis, f_cut=F_CUT)
    T = np.column_stack([body.displacement(unit).ravel() for unit in np.eye(body.n_dofs)])
    M = link.mass if body.basis.mass == "consistent" else link.lumped_mass_matrix
    np.testing.assert_allclose(T.T @ (M @ T), np.eye(body.n_dofs), atol=1e-10)
    assert (body.basis.omega[:6] == 0).all()
    assert all(label.startswith("rigid") for label in body.labels[:6])
    np.testing.assert_allclose(T @ body.rigid, link.rigid_modes, atol=1e-9)
    kept = 1.5 * F_CUT if basis == "contact-adapted" else F_CUT
    if basis != "craig-bampton":
        kinds = ["elastic" if w < 2 * np.pi * kept else "attachment" for w in body.basis.omega[6:]]
        assert [label.split()[0] for label in body.labels[6:]] == kinds


def test_many_modes_leave_little_of_an_answer_that_is_still_mass_normalised(block):
    """Craig-Bampton: the answer to an averaged interface's load is nearly in the span of many held modes."""
    partition = ep.Partition.ball(block, (0, 0, 0.03), 3e-3)
    partition |= ep.Partition.interface(block, "foot", end(block, 0.0), kind="averaged")
    body = ep.reduce(block, partition, basis="craig-bampton", f_cut=0.99 * block.resolved_frequency)
    T = body.basis.shapes
    np.testing.assert_allclose(T.T @ (block.mass @ T), np.eye(body.n_dofs), atol=1e-11)


def test_an_attachment_a_little_above_f_cut_is_no_elastic_mode(block):
    for f_cut in (45e3, 50e3, 60e3):
        body = ep.reduce(block, ep.Partition.interface(block, "foot", end(block, 0.0)), basis="residual", f_cut=f_cut)
        assert 1 < body.basis.omega[body.basis.omega > 2 * np.pi * f_cut][0] / (2 * np.pi * f_cut) < 1.5
        assert sum(label.startswith("elastic") for label in body.labels) == np.sum(
            body.basis.omega[6:] < 2 * np.pi * f_cut
        )


@pytest.mark.parametrize("basis", ["free", "residual", "contact-adapted"])
def test_a_rigid_interface_that_holds_all_nodes(link, basis):
    everything = ep.Partition.interface(link, "all", np.arange(link.n_nodes))
    with pytest.raises(InputError, match="a rigid interface holds all nodes, so that nothing deforms"):
        ep.reduce(link, everything, basis=basis, f_cut=F_CUT)


def test_a_body_with_joints_in_a_file(body, tmp_path):
    body.save(tmp_path / "body.npz")
    again = ep.load_body(tmp_path / "body.npz")
    np.testing.assert_array_equal(again.interface_rows("head"), body.interface_rows("head"))
    assert again.labels == body.labels


@pytest.mark.parametrize("basis", ["residual", "contact-adapted"])
def test_a_joint_s_first_frequency_is_that_of_the_full_model(link, basis):
    """The bar clamped at its rigid foot: the clamp is a load on the body, which its static answer has to carry."""
    partition = jointed(link, "rigid")
    body = ep.reduce(link, partition, basis=basis, f_cut=F_CUT)
    hold = scipy.linalg.null_space(body.interface_rows("foot"))
    reduced = scipy.linalg.eigvalsh(hold.T @ body.stiffness @ hold, hold.T @ body.mass @ hold)[:4]
    inner = np.delete(np.arange(link.n_dofs), node_dofs(end(link, 0.0)))
    model = tie(link, partition)
    inner = np.setdiff1d(np.arange(model.n), model.interface_columns[:6])
    full = scipy.sparse.linalg.eigsh(
        model.stiffness[inner][:, inner].tocsc(), 4, model.mass[inner][:, inner].tocsc(), sigma=0.0
    )[0]
    np.testing.assert_allclose(np.sqrt(reduced), np.sqrt(np.sort(full)), rtol=2e-4)


@pytest.mark.parametrize("basis", ["residual", "contact-adapted"])
def test_tangential_forces_are_answered_statically(link, basis):
    """axes="xyz": a traction across the line of contact, balanced by inertia, against the full FE model."""
    partition = jointed(link, "averaged", axes="xyz")
    body = ep.reduce(link, partition, basis=basis, f_cut=F_CUT)
    nodes = partition.patches[0].nodes
    load = np.random.default_rng(0).standard_normal((len(nodes), 3))
    full_load = np.zeros((link.n_nodes, 3))
    full_load[nodes] = load
    expected = elastic_answer(link, partition, body, full_load.ravel()).reshape(-1, 3)[nodes]
    at_patch = body.rows(nodes)
    elastic = body.basis.omega > 0
    modal = at_patch[:, elastic] @ ((load.ravel() @ at_patch)[elastic] / body.basis.omega[elastic] ** 2)
    assert relative(modal + body.flexibility() @ load.ravel(), expected.ravel()) < 1e-8
    assert not any("tangential" in sentence for sentence in body.left_out)


def test_normal_flexibility_is_a_part_of_that_in_all_directions(link):
    normal, xyz = (
        ep.reduce(link, jointed(link, "rigid", axes), basis="residual", f_cut=F_CUT) for axes in ("normal", "xyz")
    )
    direction = normal.partition.patches[0].direction
    part = np.kron(np.eye(len(normal.partition.patch_nodes)), direction)
    assert relative(part @ xyz.flexibility() @ part.T, normal.flexibility()) < 1e-8


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


@pytest.mark.parametrize(("basis", "loss"), [("contact-adapted", 5e-3), ("free", 0.05), ("craig-bampton", 0.07)])
def test_a_body_is_hit_on_both_ends_at_once(basis, loss):
    """A bar between two equal ones that come from both sides: symmetric forces, it stays in place."""
    mbs, bars, contacts = three_bars(basis, (1.0, 0.0, -1.0))
    result = ep.solve_dynamic(mbs, end_time=12e-6)
    forces = [contact.force(result) for contact in contacts]
    assert forces[0].max() > 100
    assert relative(forces[0], forces[1]) < 0.1  # the mesh is not symmetric
    momentum = [bar.momentum(result)[-1, 2] - bar.momentum(result)[0, 2] for bar in bars]
    assert abs(sum(momentum)) < 1e-9 * abs(momentum[0])
    energy = sum(item.energy(result) for item in (*bars, *contacts))
    # Nodes with mass lose their approach velocity when they meet; the residual flexibility has none to lose.
    np.testing.assert_allclose(energy, energy[0], rtol=loss)


def test_a_cradle_of_bars_whose_shapes_move_both_patches():
    """Craig-Bampton: multipliers of two contacts are one problem, with the impulses of another basis."""
    impulses = []
    for basis in ("craig-bampton", "contact-adapted"):
        mbs, bars, contacts = three_bars(basis, (1.0, 0.0, 0.0))
        result = ep.solve_dynamic(mbs, end_time=26e-6)
        assert result.status == "finished"
        momentum = [bar.momentum(result)[:, 2] for bar in bars]
        np.testing.assert_allclose(sum(momentum), momentum[0][0], rtol=1e-9)
        impulses.append([result.history(contact).impulse for contact in contacts])
        assert momentum[2][-1] > 0.9 * momentum[0][0]
    np.testing.assert_allclose(*impulses, rtol=0.05)


def test_a_patch_takes_one_contact_only(mbs, link):
    body = ep.reduce(link, jointed(link, "rigid"), f_cut=F_CUT)
    ball = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), 5e-3), ep.STEEL, maxh=2e-3)
    ball_body = ep.reduce(ball, ep.Partition.ball(ball, (-5e-3, 0, 0), 2e-3), f_cut=300e3)
    target = ep.CreatePartitionBody(mbs, body)
    balls = [ep.CreatePartitionBody(mbs, ball_body, referencePosition=[0.0101, 0, 0.03]) for _ in range(2)]
    ep.CreatePartitionContact(mbs, balls[0], target, masterPatch=0)
    with pytest.raises(InputError, match="its patch 0 already has the contact"):
        ep.CreatePartitionContact(mbs, balls[1], target, masterPatch="side")
    with pytest.raises(InputError, match=r"patch: expected the name or number of one of the 1 contact patches"):
        ep.CreatePartitionContact(mbs, balls[1], target, masterPatch="back")


def test_a_link_without_contact(link):
    """Interfaces alone make a body; nothing of a contact is in it."""
    joints = ep.Partition.interface(link, "foot", end(link, 0.0)) | ep.Partition.interface(
        link, "head", end(link, 0.06)
    )
    for basis in ("contact-adapted", "craig-bampton", "residual"):
        body = ep.reduce(link, joints, basis=basis, f_cut=F_CUT)
        assert 6 + 12 < body.n_dofs < 60
        mbs = exu.SystemContainer().AddSystem()
        ep.CreatePartitionBody(mbs, body, initialVelocity=[0, 0, 1.0])
        mbs.Assemble()
        assert ep.stability_limit(mbs) > 0


def test_named_boundaries_of_the_shape_are_interfaces():
    shape = box(0.010, 0.008, 0.060)
    shape.faces.Min(occ.Z).name = "foot"
    fem = ep.fe_model(shape, ep.STEEL, maxh=6e-3)
    (joint,) = ep.Partition.interface(fem, "pin", "foot").interfaces
    np.testing.assert_array_equal(joint.nodes, end(fem, 0.0))
    np.testing.assert_allclose(joint.position, [0, 0, 0], atol=1e-9)
    assert joint.weights.sum() == pytest.approx(1)
    with pytest.raises(InputError, match=r"nodes: expected one of .*'foot'.*, got 'feet'"):
        ep.Partition.interface(fem, "pin", "feet")


@pytest.fixture(scope="module", params=[1, 2])
def lever(request):
    """A bar along x with a bore about z, meshed fine on one side of it."""
    bar = occ.Box((-0.015, -0.012, 0), (0.08, 0.012, 0.008)) - occ.Cylinder((0, 0, -1e-3), occ.Z, 6e-3, 10e-3)
    for face in bar.faces:
        if abs(face.center.x) < 5e-3 and 1e-3 < face.center.z < 7e-3 and abs(face.center.y) < 5e-3:
            face.name = "bore"
    fine = ep.Refine((6e-3, 0, 0), radius=1e-3, h=1e-3)
    return ep.fe_model(bar, ep.STEEL, maxh=10e-3, refine=[fine], order=request.param)


def test_a_bore_s_interface_is_on_its_axis(lever):
    """However uneven its mesh: the mean of its nodes is a sixth of the radius off."""
    pin = ep.Partition.interface(lever, "pin", "bore").interfaces[0]
    assert np.linalg.norm(lever.points[pin.nodes].mean(axis=0)[:2]) > 0.5e-3
    assert np.linalg.norm(pin.position[:2]) < 1e-15
    assert pin.position[2] == pytest.approx(4e-3, abs=1e-5)  # along it, elements of different size show


def test_an_interface_s_point_may_be_given(link):
    """Its motion is that of a rigid body there; forces on it are statically the same forces anywhere else."""
    place = np.array([1e-3, -2e-3, 5e-3])
    for kind in ("rigid", "averaged"):
        joint, given = (
            ep.Partition.interface(link, "foot", end(link, 0.0), kind=kind, position=position).interfaces[0]
            for position in (None, place)
        )
        np.testing.assert_array_equal(given.position, place)
        np.testing.assert_allclose(given.motion @ given.rigid_motion(link).reshape(-1, 6), np.eye(6), atol=1e-12)
        arm = place - joint.position
        moved = joint.motion[:3] + np.cross(joint.motion[3:].T, arm).T
        np.testing.assert_allclose(given.motion, np.vstack([moved, joint.motion[3:]]), atol=1e-9)
    with pytest.raises(InputError, match=r"position: expected the point where joints attach.* away from the nodes"):
        ep.Partition.interface(link, "foot", end(link, 0.0), position=1e3 * place)
    with pytest.raises(InputError, match="position: expected shape"):
        ep.Partition.interface(link, "foot", end(link, 0.0), position=[0, 0])


def test_the_middle_of_other_faces_is_the_mean_over_their_area():
    """Half a bore, a sphere, a square hole: no axis."""
    half = occ.Box((0, -8e-3, 0), (12e-3, 8e-3, 6e-3)) - occ.Cylinder((0, 0, -1e-3), occ.Z, 5e-3, 9e-3)
    for face in half.faces:
        face.name = "half" if 3e-3 < face.center.x < 4e-3 else "other"
    fem = ep.fe_model(half, ep.STEEL, maxh=3e-3)
    place = ep.Partition.interface(fem, "half", "half").interfaces[0].position
    np.testing.assert_allclose(place, [2 / np.pi * 5e-3, 0, 3e-3], atol=3e-5)
    ball = ep.fe_model(occ.Sphere((1e-3, 0, 0), 5e-3), ep.STEEL, maxh=3e-3)
    surface = ep.Partition.interface(ball, "all", np.unique(ball.facets)).interfaces[0]
    np.testing.assert_allclose(surface.position, [1e-3, 0, 0], atol=2e-5)


def test_bad_interfaces(link):
    edge = np.flatnonzero((abs(link.points[:, 0] - 5e-3) < 1e-9) & (abs(link.points[:, 2]) < 1e-9))
    for nodes in (edge, edge[:2], edge[:1]):
        with pytest.raises(InputError, match=r"lie on one line.* at least three that span a plane"):
            ep.Partition.interface(link, "hinge", nodes)
    with pytest.raises(EmptyRegionError, match="interface 'pin' has none"):
        ep.Partition.interface(link, "pin", [])
    with pytest.raises(InputError, match="expected numbers of nodes, 0 to"):
        ep.Partition.interface(link, "pin", [0, 1, 10**9])
    with pytest.raises(InputError, match="expected one of 'rigid', 'averaged', got 'RBE2'"):
        ep.Partition.interface(link, "pin", end(link, 0.0), kind="RBE2")


def test_every_node_of_an_interface_has_its_share(link):
    """By area on a whole face; equally where some nodes span a facet by chance and others none."""
    face = ep.Partition.interface(link, "face", end(link, 0.0), kind="averaged").interfaces[0]
    np.testing.assert_allclose(face.position, (0, 0, 0), atol=1e-12)
    layer = np.flatnonzero(link.points[:, 2] < 0.012)
    assert (ep.Partition.interface(link, "layer", layer).interfaces[0].weights == 1 / len(layer)).all()
    some = np.union1d(link.facets[0], end(link, 0.06)[::7])
    assert (ep.Partition.interface(link, "some", some).interfaces[0].weights > 0).all()


def test_what_may_not_overlap(link):
    side = ep.Partition.ball(link, (0.005, 0, 0.03), 5e-3)
    foot = ep.Partition.interface(link, "foot", end(link, 0.0))
    with pytest.raises(InputError, match=r"patch 0 '' and interface 'foot' share \d+ nodes, such as node"):
        foot | ep.Partition.ball(link, (0.005, 0, 0), 5e-3)
    with pytest.raises(InputError, match="patch 0 '' and patch 1 '' share"):
        side | side
    with pytest.raises(InputError, match=r"name: expected each name once, got 'foot', 'foot'"):
        foot | ep.Partition.interface(link, "foot", end(link, 0.06))
    other = ep.fe_model(box(0.010, 0.008, 0.030), ep.STEEL, maxh=6e-3)
    with pytest.raises(InputError, match="one is of a mesh with"):
        side | ep.Partition.interface(other, "foot", end(other, 0.0))


@pytest.mark.parametrize("kind", ["rigid", "averaged"])
@pytest.mark.parametrize("basis", ["craig-bampton", "residual", "contact-adapted"])
def test_exudyn_s_constraint_and_load_attach_without_spurious_compliance(mbs, link, basis, kind):
    """The foot held by Exudyn, a wrench on the head: its static solver finds the FE model's motion of the head."""
    foot = ep.Partition.interface(link, "foot", end(link, 0.0))
    partition = foot | ep.Partition.interface(link, "head", end(link, 0.06), kind=kind)
    body = ep.reduce(link, partition, basis=basis, f_cut=F_CUT)
    head, wrench = body.interface_rows("head"), np.array([100.0, 50.0, -30.0, 1.0, 2.0, 3.0])
    item = ep.CreatePartitionBody(mbs, body)
    ground = mbs.AddMarker(items.MarkerNodeCoordinates(nodeNumber=mbs.AddNode(items.NodePointGround())))
    coordinates = mbs.AddMarker(items.MarkerObjectODE2Coordinates(objectNumber=item["oGenericODE2"]))
    mbs.AddObject(
        items.ObjectConnectorCoordinateVector(
            markerNumbers=[ground, coordinates], scalingMarker0=[], scalingMarker1=body.interface_rows("foot")
        )
    )
    mbs.SetObjectParameter(item["oGenericODE2"], "forceVector", head.T @ wrench)
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.solutionSettings.writeSolutionToFile = False
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    assert mbs.SolveStatic(settings)
    q = mbs.GetNodeOutput(item["nModal"], exu.OutputVariableType.Coordinates)

    model = tie(link, partition)
    moving = np.setdiff1d(np.arange(model.n), model.interface_columns[:6])
    load = np.zeros((link.n_nodes, 3))
    joint = partition.find_interface("head")
    load[joint.nodes] = (wrench @ joint.motion).reshape(-1, 3)
    u = np.zeros(model.n)
    u[moving] = scipy.sparse.linalg.spsolve(
        model.stiffness[moving][:, moving].tocsc(), (model.expand.T @ load.ravel())[moving]
    )
    expected = joint.motion @ (model.expand @ u).reshape(-1, 3)[joint.nodes].ravel()
    np.testing.assert_allclose(head @ q, expected, rtol=1e-6, atol=1e-6 * abs(expected[:3]).max())
