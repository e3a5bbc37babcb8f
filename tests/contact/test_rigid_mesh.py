"""Rigid surfaces of triangles: signed distances of solids, files, and contact with them."""

import functools
import itertools

import exudyn as exu
import meshio
import netgen.occ as occ
import numpy as np
import pytest
from oracles import compliant, floating, moved, without_numba
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.contact.rigid import RigidGaps
from exudyn_partition.errors import InputError, MeshError, RunError, UnitsWarning

HALF = np.array([0.03, 0.02, 0.001])  # half sides of a thin plate
CORNERS = HALF * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
TWELVE = np.array([[q[i] for i in three] for q in FACES for three in ((0, 1, 2), (0, 2, 3))])


def of_plate(x):
    """Signed distance of points from the plate, in closed form."""
    beyond = abs(x) - HALF
    return np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0)


def scattered(n, seed=0):
    """Points around and in the plate."""
    return np.random.default_rng(seed).uniform(-1.5, 1.5, (n, 3)) * (HALF + 0.003)


@pytest.mark.parametrize("sense", [1, -1])
def test_distances_from_a_plate_of_twelve_triangles(sense):
    x = scattered(2000)
    gap, normal = ep.RigidMesh(CORNERS, TWELVE[:, ::sense]).project(x)
    np.testing.assert_allclose(gap, of_plate(x), atol=1e-15)
    assert np.count_nonzero(gap < 0) > 100
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1)
    np.testing.assert_allclose(of_plate(x - gap[:, None] * normal), 0, atol=1e-15)


def test_triangles_of_all_sizes_and_needles():
    """Triangles at one corner of the plate are divided again and again; the solid stays the same."""
    points, triangles = [*CORNERS], [tuple(t) for t in TWELVE]
    for _ in range(40):
        k = min(k for k, t in enumerate(triangles) if 7 in t)
        a, b, c = triangles.pop(k)
        points.append(np.mean([points[a], points[b], points[c]], axis=0))
        triangles += [(a, b, len(points) - 1), (b, c, len(points) - 1), (c, a, len(points) - 1)]
    mesh, x = ep.RigidMesh(points, triangles), scattered(500, 1)
    extent = np.ptp(mesh.points[mesh.triangles], axis=1).max(axis=1)
    assert extent.max() > 20 * extent.min()
    np.testing.assert_allclose(mesh.project(x)[0], of_plate(x), atol=1e-15)


@pytest.mark.parametrize("faces", [(3, 4), (3,), (0, 1, 2, 4)])
def test_the_normal_of_a_corner_does_not_depend_on_how_its_faces_are_divided(faces):
    """Points beside a sharp corner take their side from it: triangles count by their angles there."""
    corner, points, triangles = len(CORNERS) - 1, [*CORNERS], []
    for k, t in enumerate(TWELVE):
        if k // 2 in faces and corner in t:  # divided through the corner, as a fan
            a, b = (t[(list(t).index(corner) + i) % 3] for i in (1, 2))
            points += [points[a] + share * (points[b] - points[a]) for share in (0.1, 0.2, 0.7)]
            fan = [a, *range(len(points) - 3, len(points)), b]
            triangles += [(corner, i, j) for i, j in itertools.pairwise(fan)]
        else:
            triangles.append(tuple(t))
    mesh = ep.RigidMesh(points, triangles)
    gap, normal = mesh.project(CORNERS[corner:])
    np.testing.assert_allclose(gap, 0, atol=1e-15)
    np.testing.assert_allclose(normal, [np.ones(3) / np.sqrt(3)], atol=1e-12)


def test_a_sphere_is_right_to_the_sag_of_its_edges():
    R, h = 0.01, 1.5e-3
    mesh = ep.RigidMesh.of(occ.Sphere(occ.Pnt(0, 0, 0), R), maxh=h)
    x = 0.012 * np.random.default_rng(2).standard_normal((300, 3))
    x = x[np.linalg.norm(x, axis=1) > 0.5 * R]
    gap, normal = mesh.project(x)
    expected, outwards = ep.RigidSphere((0, 0, 0), R).project(x)
    edge = np.linalg.norm(np.diff(mesh.points[mesh.triangles], axis=1), axis=2).max()
    assert 0 < (gap - expected).max() < edge**2 / (6 * R)  # of a triangle, the centre lies deeper than an edge's middle
    assert np.einsum("kd,kd->k", normal, outwards).min() > np.cos(edge / R)


@pytest.mark.parametrize("ending", ["stl", "obj", "ply"])
def test_files_in_millimetres(tmp_path, ending):
    path = tmp_path / f"plate.{ending}"
    meshio.write_points_cells(path, 1e3 * CORNERS, [("triangle", TWELVE)])
    x = scattered(200)
    np.testing.assert_allclose(ep.RigidMesh.of(path, scale=1e-3).project(x)[0], of_plate(x), atol=1e-9)
    with pytest.warns(UnitsWarning, match="60 m large.*scale=1e-3"):
        ep.RigidMesh.of(path)
    with pytest.raises(InputError, match="maxh: only for STEP files"):
        ep.RigidMesh.of(path, maxh=1e-3)


def test_a_step_file(tmp_path):
    path = tmp_path / "plate.step"
    occ.Box(tuple(-HALF), tuple(HALF)).WriteStep(str(path))
    x = scattered(200)
    np.testing.assert_allclose(ep.RigidMesh.of(path, maxh=0.02).project(x)[0], of_plate(x), atol=1e-9)
    with pytest.raises(InputError, match=r"scale: expected 1e-09 to 1e\+09, .* got 1e\+20"):
        ep.RigidMesh.of(path, maxh=0.02, scale=1e20)
    with pytest.raises(InputError, match="maxh: expected the longest edge"):
        ep.RigidMesh.of(path)


def test_a_ball_presses_on_it_as_on_a_plane(round_body):
    """The plate has turned with the body that carries it, and lies under the ball with an edge of its triangles."""
    A = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    mesh = ep.RigidMesh(CORNERS @ A, TWELVE)
    force = []
    for surface, pose in ((mesh, lambda: (np.array([0, 0, -HALF[2]]), A)), (ep.RigidPlane(), None)):
        side = floating(round_body)
        law = compliant(RigidGaps(side, surface, pose=pose))
        law.at(moved(side, [0, 0, -4e-6]))
        force.append(law.evaluation.resultant())
    assert force[1][2] > 50
    np.testing.assert_allclose(*force, rtol=1e-9, atol=1e-9 * force[1][2])


def test_wrong_meshes(tmp_path):
    triangle = [[0, 1, 2]]
    for points, triangles, error, match in (
        (np.eye(3), [[0, 1, 3]], InputError, "whole numbers from 0 to 2"),
        (np.eye(3), [[0, 1, 0.5]], InputError, "whole numbers"),
        (np.ones((3, 3)), triangle, MeshError, "some with an area"),
        (np.eye(4)[:, :3], [[0, 1, 2], [0, 1, 3]], MeshError, "1 edges have .* opposite senses"),
    ):
        with pytest.raises(error, match=match):
            ep.RigidMesh(points, triangles)
    path = tmp_path / "quads.obj"
    meshio.write_points_cells(path, CORNERS, [("quad", np.array(FACES))])
    with pytest.raises(MeshError, match="expected triangles with three corners alone, got 6 quad"):
        ep.RigidMesh.of(path)


def rows_of(body, surface, **position):
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, **position)
    return item, ep.CreatePartitionContact(mbs, item, surface).mechanics.for_run("static").gaps


def disc(radius, thickness, n=24):
    """A disc whose top is the plane z = 0."""
    angle = 2 * np.pi * np.arange(n) / n
    rim = radius * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    down = np.array([0, 0, -thickness])
    i, j = np.arange(n), np.roll(np.arange(n), -1)
    flat = np.column_stack([np.full(n, 2 * n), i, j]), np.column_stack([np.full(n, 2 * n + 1), j + n, i + n])
    sides = np.column_stack([i, i + n, j]), np.column_stack([j, i + n, j + n])
    return ep.RigidMesh(np.vstack([rim, rim + down, [[0, 0, 0], down]]), np.vstack([*flat, *sides]))


@functools.cache
def plate():
    """A thin plate whose top is the plane z = 0."""
    return ep.RigidMesh.of(occ.Box((-0.03, -0.03, -2e-5), (0.03, 0.03, 0)), maxh=0.06)


@pytest.mark.parametrize("sheet", [plate, lambda: disc(0.03, 2e-5)], ids=["plate", "disc"])
@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_rows_within_a_thin_sheet_are_as_deep_as_within_a_solid(round_body, sheet, frame):
    """Also beyond half its thickness, where its back is nearer."""
    gaps = [
        rows_of(round_body, surface, referencePosition=[0, 0, 1e-6], frame=frame)[1]
        for surface in (ep.RigidPlane(), sheet())
    ]
    item, _ = rows_of(round_body, ep.RigidPlane(), referencePosition=[0, 0, 1e-6], frame=frame)
    for depth in (5e-6, 1.2e-5, 1.8e-5):
        q = item.kinematics.moved(
            np.zeros(round_body.n_dofs), -depth * item.kinematics.weight(np.array([0, 0, 1.0])) / item.kinematics.mass
        )
        right, found = (one.at(q) for one in gaps)
        closed = right < 0
        assert closed.any()
        np.testing.assert_allclose(found[closed], right[closed], atol=1e-12)
        np.testing.assert_allclose(gaps[1].stage.normal[closed], np.tile([0, 0, 1.0], (closed.sum(), 1)), atol=1e-12)


def test_how_much_of_a_sheet_is_left_before_a_row():
    sheet = ep.RigidMesh.of(occ.Box((-1, -1, -0.1), (1, 1, 0)), maxh=2)
    down = np.array([[0, 0, -1.0]])
    for depth in (0.04, 0.07, 0.09):
        x = np.array([[0.1, 0.2, -depth]])
        gap, normals, left = sheet.entered(x, down, *sheet.project(x))
        np.testing.assert_allclose(gap, -depth, atol=1e-12)
        np.testing.assert_allclose(normals, -down, atol=1e-12)
        np.testing.assert_allclose(left, 0.1 - depth if depth > 0.05 else np.inf, atol=1e-12)


def test_the_side_beside_an_edge_is_no_back():
    """A body enters a block near its edge and looks aside: the face that is nearest and looks its way is the side."""
    block = ep.RigidMesh.of(occ.Box((-1, -1, -1), (1, 1, 0)), maxh=2)
    x, outward = np.array([[0.99, 0.1, -0.05]]), np.array([[0.6, 0, -0.8]])
    gap, normals, left = block.entered(x, outward, *block.project(x))
    np.testing.assert_allclose(gap, -0.05, atol=1e-12)
    np.testing.assert_allclose(normals, [[0, 0, 1]], atol=1e-12)
    assert np.isinf(left).all()


def test_a_body_has_come_through_the_sheet_that_it_is_in():
    """There are sheets before it and behind it, all in one mesh."""
    sheets = [ep.RigidMesh.of(occ.Box((-1, -1, z - 0.1), (1, 1, z)), maxh=2) for z in (-1.0, 0.0, 2.0)]
    first = np.cumsum([0] + [len(sheet.points) for sheet in sheets])
    triangles = [sheet.triangles + n for sheet, n in zip(sheets, first, strict=False)]
    mesh = ep.RigidMesh(np.vstack([sheet.points for sheet in sheets]), np.vstack(triangles))
    for z, sense in ((-0.07, 1), (-0.03, -1)):  # from above and from below
        x, up = np.array([[0.1, 0.2, z]]), np.array([[0, 0, float(sense)]])
        gap, normals, left = mesh.entered(x, -up, *mesh.project(x))
        np.testing.assert_allclose(gap, -0.07, atol=1e-12)
        np.testing.assert_allclose(normals, up, atol=1e-12)
        np.testing.assert_allclose(left, 0.03, atol=1e-12)


@pytest.mark.parametrize("turn", [(0.0, 0, 0), (0.4, 0.2, -0.3), (2.5, 1.0, 0.5)])
@pytest.mark.parametrize("since", [False, True], ids=["placed", "turned since"])
def test_sheets_that_a_body_carries_are_entered_as_planes_are(round_body, turn, since):
    """Wherever body and sheet have turned together, from the start or since then."""
    place, A, found = np.array([0.3, 0.1, 0]), Rotation.from_rotvec(turn).as_matrix(), []
    for surface in (ep.RigidPlane(), plate()):
        pose = {"A": np.eye(3) if since else A}
        side = floating(round_body, place, np.zeros(3) if since else turn)
        gaps = RigidGaps(side, surface, pose=lambda pose=pose: (place, pose["A"]))
        pose["A"] = A
        down, arm = A @ [0, 0, -1.8e-5], side.kinematics.origin - place
        q = moved(side, down + A @ arm - arm, turn) if since else moved(side, down)
        found.append((gaps.at(q), gaps.stage.normal))
    closed = found[0][0] < 0
    assert closed.any()
    for plane, mesh in zip(*found, strict=True):
        np.testing.assert_allclose(mesh[closed], plane[closed], atol=1e-12)


def test_the_gap_of_a_surface_within_a_thin_sheet_is_its_depth(round_body):
    found = []
    for surface in (ep.RigidPlane(), disc(0.03, 2e-5)):
        gaps = RigidGaps(floating(round_body), surface)
        found.append(gaps.surface_gap(moved(gaps.slave, [0, 0, -1.8e-5])))
    assert found[1] == pytest.approx(found[0], abs=1e-12)


def test_rows_that_pass_through_a_sheet_are_refused(round_body):
    """Behind it nothing would hold them."""
    gaps = RigidGaps(floating(round_body), plate())
    gaps.at(moved(gaps.slave, [0, 0, -1.8e-5]))
    with pytest.raises(RunError, match=r"has passed through a part of the mesh that is 2e-05 m thick"):
        gaps.at(moved(gaps.slave, [0, 0, -1.98e-5]))


def test_a_row_meets_the_rim_of_a_thin_disc_that_its_body_has_come_through():
    """Its flat faces are nearer, but the body has not come through them."""
    round_one = disc(1.0, 0.02, 96)
    for z in (-0.004, 0.0, 0.006):
        x, outward = np.array([[0.96, 0.0, z - 0.01]]), np.array([[-np.cos(z), 0.0, np.sin(z)]])
        gap, normals, left = round_one.entered(x, outward, *round_one.project(x))
        assert left[0] == np.inf
        assert gap[0] == pytest.approx(-0.04, abs=2e-3)  # the sag of its edges
        assert normals[0, 0] > 0.99


@pytest.mark.parametrize("count", [1, 5, 1000])
def test_a_tree_finds_the_triangles_that_all_distances_find(count):
    """Of triangles anywhere, one of them much larger, for points near and far; NumPy tries all that are near."""
    numbers = np.random.default_rng(count)
    corners = numbers.uniform(-1, 1, (count, 1, 3)) + 0.1 * numbers.uniform(-1, 1, (count, 3, 3))
    corners[0] *= 5.0
    mesh = ep.RigidMesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))
    x = np.vstack([numbers.uniform(-2, 2, (200, 3)), corners.mean(axis=1)[:200], corners[:200, 0]])
    with without_numba():
        gap, normals = mesh.project(x)
    by_tree = mesh.project(x)
    np.testing.assert_allclose(by_tree[0], gap, atol=1e-14)
    apart = abs(gap) > 1e-12  # on an edge of two triangles either normal is right
    np.testing.assert_allclose(by_tree[1][apart], normals[apart], atol=1e-9)
