"""Interfaces for joints and several patches: exact static answers, rigid ties, mean axes, labels, bad input."""

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
import pytest
import scipy.linalg
import scipy.sparse.linalg
from oracles import end, relative

import exudyn_partition as ep
from exudyn_partition.errors import InputError
from exudyn_partition.fe.model import node_dofs
from exudyn_partition.reduction.tied import tie

BASES = ["free", "craig-bampton", "residual", "contact-adapted"]


F_CUT = 60e3


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
    settings.solution.file.write = False
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
