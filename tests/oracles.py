"""What several tests share: small bodies by their measures, models of a few lines, dense answers to compare with."""

import contextlib
import os
import re
import signal
import sys
import warnings
from pathlib import Path

import exudyn as exu
import exudyn.itemInterface as items
import meshio
import netgen.occ as occ
import numpy as np
import pytest
import scipy.sparse as sp
from exudyn.FEM import FEMinterface, ObjectFFRFreducedOrderInterface
from scipy.spatial.transform import Rotation

import exudyn_partition as ep
from exudyn_partition.contact.formulations.choices import Compliance, Lagrange
from exudyn_partition.contact.patch_contact import PatchContact
from exudyn_partition.contact.side import Side
from exudyn_partition.errors import YieldWarning
from exudyn_partition.fe.elements import BY_NAME
from exudyn_partition.frames.floating import FloatingKinematics
from exudyn_partition.frames.inertial import InertialKinematics
from exudyn_partition.support.compiled import compiles, kernels

SPHERE_RADIUS = 0.010  # of the fixtures `sphere`, `other_sphere` and `ball` [m]
MARBLE_RADIUS = 5e-3  # [m]
SIZE = np.array([0.01, 0.02, 0.03])  # of the fixture `block` [m]
TOP = (0.0, 0.0, 0.03)  # centre of its upper face [m]
SPHERE_MATERIAL = ep.Material(E=210e9, nu=0.3, rho=7850.0)
PLACE = np.array([0.1, -0.2, 0.3])  # anywhere [m]
TURNED = Rotation.from_rotvec([0.5, -1.0, 0.7]).as_matrix()
SPIN = np.array([100.0, 200.0, 200.0])  # 300 in all [rad/s]
HINGE = [1, 1, 1, 1, 0, 1]  # axes of a joint that is free about y
LONGEST = 3600  # s: what takes longer hangs, also where other processes take most of the machine
KINDS = {4: "tetra", 10: "tetra10", 8: "hexahedron"}  # meshio's names, by the number of nodes


def relative(x, y):
    """||x - y|| / ||y||."""
    return np.linalg.norm(x - y) / np.linalg.norm(y)


def contributed(mark):
    """Names that the program of the contributing page defines in which `mark` stands."""
    page = (Path(__file__).parents[1] / ".github" / "CONTRIBUTING.md").read_text()
    (program,) = [text for text in re.findall(r"^```python\n(.*?)^```", page, re.M | re.S) if mark in text]
    names = {}
    exec(compile(program, "CONTRIBUTING.md", "exec"), names)
    return names


def compliant(gaps, friction=None):
    """Contact through the residual flexibility, outside of a model."""
    return PatchContact(gaps, Compliance(), friction)


def multipliers(gaps, friction=None):
    """Contact by multipliers, outside of a model."""
    return PatchContact(gaps, Lagrange(), friction)


def broken_law(F, h, mu, lam):
    """Largest violation of the law of friction by forces lam, (nr, 3), relative to the largest force and gap.

    F, (3 nr, 3 nr), h, (nr, 3), and mu, (nr,), are as for `FrictionProblem`.
    """
    w = h + (F @ lam.ravel()).reshape(-1, 3)
    force, slip = np.linalg.norm(lam[:, 1:], axis=1), np.linalg.norm(w[:, 1:], axis=1)
    opposite = force[:, None] * w[:, 1:] + slip[:, None] * lam[:, 1:]
    gaps, forces = abs(h).max(), max(abs(lam).max(), 1e-300)
    return max(
        -lam[:, 0].min() / forces,
        -w[:, 0].min() / gaps,
        abs(lam[:, 0] * w[:, 0]).max() / forces / gaps,
        (force - mu * lam[:, 0]).max() / forces,
        abs(opposite).max() / forces / gaps,
        (slip * (mu * lam[:, 0] - force)).max() / forces / gaps,
    )


# Shapes and meshes.


def rows_on_few_nodes(seed, rows=100, side=5, own=1e-5):
    """Flexibility of the rows of a stiff body on a soft one with few nodes, (n, n), and the rows' places, (n, 2).

    The soft body is a square of nodes that move each other as 1 / r. The rows' gaps are bilinear between them; `own` is
    what a row gives way by itself.
    """
    line = np.linspace(-1, 1, side)
    nodes = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
    soft = 1 / (np.linalg.norm(nodes[:, None] - nodes, axis=2) + 1 / (side - 1))
    places = np.random.default_rng(seed).uniform(-1, 1, (rows, 2))
    hats = np.maximum(1 - abs(places[:, None] - nodes) * (side - 1) / 2, 0).prod(axis=2)
    return hats @ soft @ hats.T + own * np.eye(rows), places


def box(lx, ly, lz):
    """A box from the origin upwards, centred in x and y."""
    return occ.Box(occ.Pnt(-lx / 2, -ly / 2, 0), occ.Pnt(lx / 2, ly / 2, lz))


def dome(height=0.1):
    """One quadratic facet bent upwards, over the triangle between the unit vectors of x and y."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    middle = (corners + np.roll(corners, -1, axis=0)) / 2 + [0, 0, height]
    return np.vstack([corners, middle])


def hexahedra(*n):
    """Points and cells of a box of `SIZE` from the origin upwards, centred in x and y."""
    axes = [np.linspace(0, length, k + 1) for length, k in zip(SIZE, n, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3) - [*SIZE[:2] / 2, 0]
    number = np.arange(len(points)).reshape([k + 1 for k in n])
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    parts = [number[tuple(slice(a, a + k) for a, k in zip(corner, n, strict=True))].ravel() for corner in corners]
    return points, np.stack(parts, axis=1)


def split(points, hexahedra, kinds):
    """Split hexahedra into elements of other kinds.

    `kinds` names for each hexahedron: "hexahedron"; "wedge", two, whose quadrilaterals are upright; "pyramid", six
    around its middle; or "foot", the same with two tetrahedra below. Returns points and blocks for `write_deck`.
    """
    faces = [[0, 1, 2, 3], [4, 7, 6, 5], [0, 4, 5, 1], [1, 5, 6, 2], [2, 6, 7, 3], [3, 7, 4, 0]]
    parts = {"hexahedron": [], "wedge": [], "pyramid": [], "tetra": []}
    middles = []
    for cell, kind in zip(np.asarray(hexahedra), kinds, strict=True):
        if kind == "hexahedron":
            parts[kind].append(cell)
        elif kind == "wedge":
            parts[kind] += [cell[[0, 1, 2, 4, 5, 6]], cell[[0, 2, 3, 4, 6, 7]]]
        else:
            middle = len(points) + len(middles)
            middles.append(points[cell].mean(axis=0))
            for number, (a, b, c, d) in enumerate(cell[faces]):
                if kind == "foot" and number == 0:
                    parts["tetra"] += [[a, b, c, middle], [a, c, d, middle]]
                else:
                    parts["pyramid"].append([a, b, c, d, middle])
    points = np.vstack([points, np.reshape(middles, (-1, 3))])
    return points, [(kind, np.array(cells)) for kind, cells in parts.items() if cells]


QUADRATIC = {"hexahedron": "hexahedron20", "wedge": "wedge15", "pyramid": "pyramid13", "tetra": "tetra10"}


def quadratic(points, blocks):
    """Add the nodes in the middle of edges to elements of the first order."""
    ends = [np.sort(cells[:, BY_NAME[kind].edges], axis=2) for kind, cells in blocks]
    edges, number = np.unique(np.concatenate([part.reshape(-1, 2) for part in ends]), axis=0, return_inverse=True)
    middles = np.split(len(points) + number.ravel(), np.cumsum([part[..., 0].size for part in ends])[:-1])
    added = [
        (QUADRATIC[kind], np.hstack([cells, own.reshape(len(cells), -1)]))
        for (kind, cells), own in zip(blocks, middles, strict=True)
    ]
    return np.vstack([points, points[edges].mean(axis=1)]), added


def write(path, points, *blocks, file_format=None, **data):
    """Write a mesh to a file, and return its path."""
    blocks = [block if isinstance(block, tuple) else (KINDS[block.shape[1]], block) for block in blocks]
    meshio.write(path, meshio.Mesh(points, blocks, **data), file_format=file_format)
    return path


TYPES = {"hexahedron": "C3D8", "hexahedron20": "C3D20", "wedge": "C3D6", "wedge15": "C3D15", "pyramid": "C3D5",
         "pyramid13": "C3D13", "tetra": "C3D4", "tetra10": "C3D10"}  # fmt: skip


def write_deck(path, points, *blocks, more=()):
    """Write elements of several kinds to a deck of CalculiX, and return its path."""
    lines = ["*NODE", *(f"{i}, {x!r}, {y!r}, {z!r}" for i, (x, y, z) in enumerate(points.tolist(), 1))]
    number = 0
    for kind, cells in blocks:
        lines.append(f"*ELEMENT, TYPE={TYPES[kind]}, ELSET=body")
        for nodes in (cells + 1).tolist():
            number += 1
            row = [str(number), *map(str, nodes)]
            parts = [row[i : i + 16] for i in range(0, len(row), 16)]
            lines.append(",\n".join(", ".join(part) for part in parts))
    path.write_text("\n".join([*lines, *more, ""]))
    return path


def end(fem, z):
    """Nodes at a height."""
    return np.flatnonzero(abs(fem.points[:, 2] - z) < 1e-9)


# Bodies.


def dense_basis(body):
    """T as a dense matrix, column by column."""
    return np.column_stack([body.displacement(unit).ravel() for unit in np.eye(body.n_dofs)])


def mass_matrix(fem, body):
    """The FE mass that a body's basis is normalised by."""
    return fem.mass if body.basis.mass == "consistent" else fem.lumped_mass_matrix


def rigid_rows(body):
    """Rows that take the rigid motion out of a body's coordinates, (6, n_dofs); its shapes have none."""
    momentum = np.asarray(body.mass @ body.rigid)
    return np.linalg.solve(body.rigid.T @ momentum, momentum.T)


def in_frame(body):
    """Kinematics of all nodes of a body, whose frame has the axes of the mesh."""
    return FloatingKinematics(body, np.zeros(3), np.zeros(3), np.arange(len(body.points)))


def inertial(body, at=(0.0, 0.0, 0.0)):
    """Contact side of a body that is held in space."""
    return Side.of(InertialKinematics(body, np.array(at)))


def floating(body, at=(0.0, 0.0, 0.0), rotation=(0.0, 0.0, 0.0)):
    """Contact side of a body in a floating frame."""
    return Side.of(FloatingKinematics(body, np.array(at), np.array(rotation)))


def moved(side, translation, rotation=(0.0, 0.0, 0.0)):
    """Coordinates of a side whose body has moved as a whole."""
    if isinstance(side.kinematics, FloatingKinematics):
        return np.r_[translation, rotation, np.zeros(side.n - 6)]
    return side.kinematics.body.rigid @ np.r_[translation, rotation]


def energy_by_start(items, contact, result):
    """Sum of all energies, and of what plastic flow and friction have taken, by that of the start."""
    total = sum(each.energy(result) for each in (*items, contact)) + contact.dissipated_energy(result)
    return total / total[0]


@contextlib.contextmanager
def small_zone():
    """Runs in which a little flow reaches the border of the zone that may yield: zone and meshes are small."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", YieldWarning)
        warnings.filterwarnings("ignore", message=".*does not resolve the flow")
        yield


def closed(round_body, flat_body):
    """Coordinates of both, the round body pressed into the flat one by 4 um."""
    return np.r_[moved(inertial(round_body), [0, 0, -4e-6]), np.zeros(flat_body.n_dofs)]


# Models.


def ground(mbs, place=(0, 0, 0), axes=None):
    """Marker fixed in space."""
    frame = np.eye(4)
    frame[:3, 3], frame[:3, :3] = place, np.eye(3) if axes is None else axes
    return mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.AddObject(items.ObjectGround()), localHT=frame))


def sensors(mbs, marker, kinds):
    """Sensors of a marker, one of each kind."""
    return [
        mbs.AddSensor(items.SensorMarker(markerNumber=marker, outputVariableType=k, storeInternal=True)) for k in kinds
    ]


def by_exudyn(mbs, fem, partition, body, *, at=(0, 0, 0), gravity=(0, 0, 0), node="RotationRotationVector"):
    """Exudyn's own floating frame with the same modes, at a place: markers of its interfaces."""
    model = FEMinterface()
    model.nodes["Position"] = fem.points - fem.centre_of_mass
    model.massMatrix, model.stiffnessMatrix = sp.csr_matrix(fem.mass), sp.csr_matrix(fem.stiffness)
    model.modeBasis = {"matrix": np.array(body.basis.shapes[:, 6:]), "type": "NormalModes"}
    model.elements = [{"Name": "solid", "Tet4": fem.cells[:, :4]}]
    modes = ObjectFFRFreducedOrderInterface(model, rigidBodyNodeType=getattr(exu.NodeType, node))
    keys = modes.AddObjectFFRFreducedOrder(mbs, positionRef=fem.centre_of_mass + at, gravity=list(gravity))
    return [
        mbs.AddMarker(
            items.MarkerSuperElementRigid(
                bodyNumber=keys["oFFRFreducedOrder"],
                meshNodeNumbers=[*map(int, interface.nodes)],
                weightingFactors=interface.weights,
            )
        )
        for interface in partition.interfaces
    ]


def jointed(body, frame, axes=(1,) * 6, **options):
    """A body whose interface foot is on a joint at the origin."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, frame=frame, **options)
    joint = items.GenericJoint(markerNumbers=[ground(mbs), item.CreateInterfaceMarker(mbs, "foot")])
    joint.constrainedAxes = list(axes)
    return mbs, item, mbs.AddObject(joint)


def collide(bodies, mbs=None, gap=0.0, formulation="compliance", **options):
    """Ball and block at 1 m/s, assembled."""
    mbs = mbs or exu.SystemContainer().AddSystem()
    striker = ep.CreatePartitionBody(
        mbs, bodies[0], referencePosition=np.add(TOP, [0, 0, gap]), **{"initialVelocity": [0, 0, -1.0], **options}
    )
    target = ep.CreatePartitionBody(mbs, bodies[1])
    contact = ep.CreatePartitionContact(mbs, striker, target, formulation=formulation)
    mbs.Assemble()
    return mbs, striker, target, contact


def hit_by_a_spinning_ball(bodies, called="ball", **block):
    """Ball that spins in a floating frame and hits the block in an inertial one: both, their contact, the result."""
    mbs = exu.SystemContainer().AddSystem()
    ball = ep.CreatePartitionBody(
        mbs,
        bodies[0],
        name=called,
        frame="floating",
        referencePosition=TOP,
        initialVelocity=[0, 0, -1.0],
        initialAngularVelocity=[900.0, 0, 0],
    )
    target = ep.CreatePartitionBody(mbs, bodies[1], frame="inertial", **block)
    contact = ep.CreatePartitionContact(mbs, ball, target, name="ball on block")
    mbs.Assemble()
    return ball, target, contact, ep.solve_dynamic(mbs, end_time=60e-6, step=0.5e-6)


def add_springs(mbs, item, stiffness):
    """Add springs on a body's rigid motion, and return their matrix: (6, 6) [N/m], or times its mass [1/s2]."""
    rows, body = rigid_rows(item.body), item.body
    if np.ndim(stiffness) == 0:
        stiffness = stiffness * (body.rigid.T @ np.asarray(body.mass @ body.rigid))
    K = rows.T @ stiffness @ rows
    mbs.AddObject(
        items.ObjectGenericODE2(
            nodeNumbers=item.nodes,
            stiffnessMatrix=exu.MatrixContainer(K),
            visualization=items.VObjectGenericODE2(show=False),
        )
    )
    return K


def add_loads(mbs, item, load, **options):
    """Add loads on the coordinates of a body in an inertial frame, (n_dofs,), with options of LoadCoordinate."""
    for i in np.flatnonzero(abs(load) > 1e-9 * abs(load).max()):
        marker = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=item.nodes[0], coordinate=int(i)))
        mbs.AddLoad(items.LoadCoordinate(markerNumber=marker, load=load[i], **options))


def add_force(mbs, item, vector):
    """Add a constant force, spread over the body's mass, (3,) [N]."""
    body = item.body
    load = np.r_[vector, np.zeros(body.n_dofs - 3)]
    if item.frame == "inertial":
        load = body.mass @ body.rigid[:, :3] @ vector / body.total_mass
    mbs.AddObject(
        items.ObjectGenericODE2(
            nodeNumbers=item.nodes, forceVector=load, visualization=items.VObjectGenericODE2(show=False)
        )
    )


def press_ctrl_c():
    os.kill(os.getpid(), signal.SIGINT)


def ctrl_c_after(begin):
    """A function for `progress` that presses Ctrl-C once, after a share of the work."""
    pressed = []

    def report(share):
        if share > begin and not pressed:
            pressed.append(share)
            press_ctrl_c()

    return report


@contextlib.contextmanager
def without_numba():
    """Let inner loops run in NumPy, as if numba were not installed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "numba", None)
        _look_again()
        assert not compiles()
        yield
    _look_again()


def _look_again():
    for cached in (compiles, kernels):
        cached.cache_clear()


def each_way(work):
    """What a function returns with compiled inner loops, and with those in NumPy."""
    if not compiles():
        pytest.skip("numba does not load here")
    compiled = work()
    with without_numba():
        return compiled, work()
