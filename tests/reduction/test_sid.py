"""Standard input data say what our own floating frame does, read back and put into their equations of motion."""

import re

import numpy as np
import pytest
import scipy.linalg
from oracles import box
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.errors import InputError
from exudyn_partition.frames.inertia_forces import TERMS, InertiaForces

LENGTH = 0.03


@pytest.fixture(scope="module")
def body():
    fem = ep.fe_model(box(0.006, 0.008, LENGTH), ep.STEEL, maxh=8e-3)
    part = ep.Partition.interface(fem, "foot", plane=((0, 0, 0), (0, 0, -1)))
    part |= ep.Partition.interface(fem, "head", plane=((0, 0, LENGTH), (0, 0, 1)), kind="averaged")
    return ep.reduce(fem, part, f_cut=60e3)


def skew(place):
    """Matrix of the cross product with a vector."""
    return -np.cross(np.eye(3), np.ravel(place)).T


class Sid:
    """A file of standard input data, read as Wallrapp describes it; matrices linear in q by `at(name, q)`."""

    def __init__(self, path):
        lines = path.read_text().splitlines()
        self.n_frames, self.n = map(int, lines[0].partition(":")[0].split())
        self.mass = _value(next(line for line in lines if line.strip().startswith("mass ")))
        self.frames, self.matrices, where, inside = [], {}, None, None
        for line in lines[1:]:
            word = line.split("=")[0].strip()
            if word == "new node":
                where = {}
                self.frames.append(where)
            elif word == "end node":
                where = self.matrices
            elif word.startswith("end "):
                inside = None
            elif "=" not in line and word in NAMES:
                inside = (self.matrices if where is None else where).setdefault(word, {"m0": {}, "m1": {}})
            elif inside is not None and (found := re.match(r"(m[01])\(([\d, ]+)\)", word)):
                inside[found[1]][tuple(int(i) - 1 for i in found[2].split(","))] = _value(line)
            elif inside is not None:
                inside[word] = int(_value(line))

    def at(self, name, q, of=None):
        """M0 + M1 q; elements of M1 are row, coordinate, column."""
        found = (self.matrices if of is None else of)[name]
        if found["structure"] == 4:
            return np.eye(found["nrow"])
        matrix = np.zeros((found["nrow"], found["ncol"]))
        for (i, j), value in found["m0"].items():
            matrix[i, j] += value
        for (i, k, j), value in found["m1"].items():
            matrix[i, j] += value * q[k]
        return matrix

    def moments(self, q):
        xx, yy, zz, xy, xz, yz = self.at("J", q).ravel()
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    def by_blocks(self, name, q):
        """Sum of blocks of three columns, one for each coordinate, times the coordinate."""
        return np.einsum("rka,k->ra", self.at(name, q).reshape(-1, self.n, 3), q)

    def right_side(self, omega, q, q_t):
        """Torque and generalised forces of inertia on the right-hand side."""
        x, y, z = omega
        squares = [x * x, y * y, z * z, x * y, y * z, x * z]
        torque = self.by_blocks("Gr", q_t) @ omega + np.cross(omega, self.moments(q) @ omega)
        return -torque, -(self.by_blocks("Ge", q_t) @ omega + self.at("Oe", q) @ squares)


NAMES = "origin phi psi AP mdCM J Ct Cr Me Gr Ge Oe ksigma Ke De".split()


def _value(line):
    return float(line.partition("=")[2].replace("D", "E"))


@pytest.fixture(scope="module")
def sid(body, tmp_path_factory):
    return Sid(body.save_sid(tmp_path_factory.mktemp("sid") / "bar.SID_FEM", nodes=[3, 7]))


@pytest.fixture(scope="module")
def state(body):
    rng, n = np.random.default_rng(3), body.n_dofs - 6
    return rng.normal(size=3) * 100, rng.normal(size=n), rng.normal(size=n) * 1e4


def test_mass_and_stiffness(body, sid):
    assert sid.n == body.n_dofs - 6
    assert sid.mass == pytest.approx(body.total_mass, rel=1e-14)
    zero = np.zeros(sid.n)
    np.testing.assert_allclose(sid.moments(zero), body.inertia.tensor, atol=1e-14 * body.inertia.tensor.max())
    np.testing.assert_allclose(sid.at("Ke", zero), np.diag(body.basis.omega[6:] ** 2), rtol=1e-14)
    np.testing.assert_array_equal(sid.at("Me", zero), np.eye(sid.n))
    for name in ("mdCM", "Ct", "ksigma", "De"):
        assert not sid.at(name, np.ones(sid.n)).any()


def test_equations_of_motion_are_those_of_the_floating_frame(body, sid, state):
    """Coupling and generalised forces exactly, moments and torque but for parts of second order in the deformation."""
    omega, q, q_t = state
    J, C = body.inertia.of_place(q * 1e-9)
    np.testing.assert_allclose(sid.at("Cr", q * 1e-9), C.T, atol=1e-13 * abs(C).max())
    own = InertiaForces(body.inertia, lambda z: 0 * z, [name for name in TERMS if name != "coupling"])
    torque, force = sid.right_side(omega, q, q_t)
    expected = own.force(omega, q, q_t)
    np.testing.assert_allclose(force, expected[3:], atol=1e-12 * abs(expected[3:]).max())
    off = []
    for size in (1e-6, 1e-7):
        J, _ = body.inertia.of_place(q * size)
        torque, _ = sid.right_side(omega, q * size, q_t * size)
        expected = own.force(omega, q * size, q_t * size)[:3]
        still = own.force(omega, 0 * q, 0 * q)[:3]
        assert np.linalg.norm(torque - expected) < 0.05 * np.linalg.norm(expected - still)
        off.append([np.linalg.norm(sid.moments(q * size) - J), np.linalg.norm(torque - expected)])
    np.testing.assert_allclose(np.divide(*off), 100, rtol=0.05)


def test_frames_are_interfaces_and_nodes(body, sid, state):
    """Places and axes of frames follow the deformation; nodes have no rotation."""
    _, q, _ = state
    assert sid.n_frames == len(sid.frames) == 4
    for frame, joint in zip(sid.frames, body.partition.interfaces, strict=False):
        moved = body.interface_rows(joint.name)[:, 6:] @ q
        place = sid.at("origin", q, frame).ravel()
        np.testing.assert_allclose(place, joint.position - body.centre_of_mass + moved[:3], rtol=1e-12)
        np.testing.assert_allclose(sid.at("phi", q, frame) @ q, moved[:3], atol=1e-12)
        np.testing.assert_allclose(sid.at("psi", q, frame) @ q, moved[3:], rtol=1e-12)
        small = 1e-7 / np.linalg.norm(moved[3:])
        turn = Rotation.from_rotvec(moved[3:] * small).as_matrix()
        np.testing.assert_allclose(sid.at("AP", q * small, frame), turn, atol=1e-13)
    moved = body.rows(np.array([3, 7])).reshape(2, 3, -1)[:, :, 6:]
    for frame, node, phi in zip(sid.frames[2:], (3, 7), moved, strict=True):
        place = sid.at("origin", q, frame).ravel()
        np.testing.assert_allclose(place, body.points[node] - body.centre_of_mass + phi @ q, rtol=1e-11)
        np.testing.assert_array_equal(sid.at("AP", q, frame), np.eye(3))


@pytest.fixture(scope="module")
def strut(tmp_path_factory):
    """A slender bar with geometric stiffness, and its file."""
    fem = ep.fe_model(box(0.010, 0.006, 0.3), ep.ALUMINIUM, maxh=15e-3)
    part = ep.Partition.interface(fem, "foot", plane=((0, 0, 0), (0, 0, -1)))
    part |= ep.Partition.interface(fem, "head", plane=((0, 0, 0.3), (0, 0, 1)))
    strut = ep.reduce(fem, part, f_cut=5e3, geometric_stiffness=True)
    return strut, Sid(strut.save_sid(tmp_path_factory.mktemp("strut") / "strut.SID_FEM", nodes=[3]))


@pytest.mark.parametrize("share", [-1.0, 0.4, 0.8])
def test_a_strut_of_a_file_has_the_frequency_that_euler_says(strut, share):
    """Hinged at its frames, with a force that keeps its direction; by small motion about the loaded state."""
    sid = strut[1]
    euler = np.pi**2 * ep.ALUMINIUM.E * 0.010 * 0.006**3 / 12 / 0.3**2
    n, zero = sid.n, np.zeros(sid.n)

    def moving(force, x):
        """Forces, (3 + n,), on rotation and shapes at turns and shapes x, (3 + n,)."""
        q, own = x[3:], Rotation.from_rotvec(x[:3]).inv()
        pushes = [own.apply([0, 0, force]), own.apply([0, 0, -force])]
        torque = sum(np.cross(sid.at("origin", q, f).ravel(), p) for f, p in zip(sid.frames, pushes, strict=False))
        shapes = sum(sid.at("phi", q, f).T @ p for f, p in zip(sid.frames, pushes, strict=False))
        return np.r_[torque, shapes - sid.at("Ke", q) @ q]

    foot, head = (
        np.hstack([np.vstack([np.eye(3), np.zeros((3, 3))]), np.vstack([-skew(sid.at("origin", zero, f)), np.eye(3)]),
                   np.vstack([sid.at("phi", zero, f), sid.at("psi", zero, f)])])
        for f in sid.frames[:2]
    )  # fmt: skip
    free = scipy.linalg.null_space(np.vstack([foot[:3], foot[5:], head[:2]]))
    mass = scipy.linalg.block_diag(sid.mass * np.eye(3), sid.moments(zero), np.eye(n))
    steps = np.r_[np.full(3, 1e-4), np.full(n, 1e-6)]

    def lowest(force):
        K = np.zeros((6 + n, 6 + n))
        for i, step in enumerate(steps):
            way = step * np.eye(3 + n)[i]
            K[3:, 3 + i] = -(moving(force, way) - moving(force, -way)) / (2 * step)
        K = free.T @ K @ free
        return np.sqrt(scipy.linalg.eigh((K + K.T) / 2, free.T @ mass @ free, eigvals_only=True)[0])

    assert lowest(share * euler) == pytest.approx(lowest(0.0) * np.sqrt(1 - share), rel=5e-3)


def test_rotation_stiffens_shapes_of_a_file(strut):
    """Beside the forces of the floating frame, by what the body's own centrifugal loads do."""
    body, sid = strut
    q, omega, zero = np.random.default_rng(0).normal(size=sid.n) * 1e-6, np.array([40.0, -70.0, 30.0]), np.zeros(sid.n)
    own = InertiaForces(body.inertia, lambda z: 0 * z, [name for name in TERMS if name != "coupling"])
    stiffness = body.geometric_stiffness(body.centrifugal_load(omega))[6:, 6:]
    expected = own.force(omega, q, zero)[3:] - stiffness @ q
    found = sid.right_side(omega, q, zero)[1]
    np.testing.assert_allclose(found, expected, atol=1e-9 * abs(expected).max())
    assert abs(stiffness @ q).max() > 1e-6 * abs(expected).max()


def test_a_basis_that_keeps_nodes_is_refused(body, tmp_path):
    fem = ep.fe_model(box(0.006, 0.008, LENGTH), ep.STEEL, maxh=8e-3)
    part = ep.Partition.ball(fem, (0, 0, 0), 4e-3)
    with pytest.raises(InputError, match="keeps nodes, and standard input data have modes alone"):
        ep.reduce(fem, part, f_cut=60e3, basis="free").save_sid(tmp_path / "bar.SID_FEM")
    with pytest.raises(InputError, match="nodes: "):
        body.save_sid(tmp_path / "bar.SID_FEM", nodes=[10**6])
