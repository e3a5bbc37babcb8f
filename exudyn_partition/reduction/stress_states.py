"""States of stress of a reduced body, and the geometric stiffness of each: see module `geometric_stiffness`.

States are those of unit loads: of interfaces, of contact patches, distributed ones, and centrifugal ones. Inertia
balances each load, as it does in motion, so gravity needs none. Static answers of all loads are combined to states of
unit energy, orthogonal to each other.

Theory: examples/site/theory.md, "Geometric stiffness".
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from ..algebra.blas_threads import one_blas_thread
from ..algebra.krylov import eigenmodes, mass_normalised, orthonormal_complement
from ..fe.model import FEModel, node_dofs
from ..fe.partition import Partition
from ..fe.patches import LoadPattern
from ..support.arrays import Array
from .basis import least_frequency
from .body import ReducedBody
from .free_body import FreeBody
from .geometric_stiffness import GeometricStiffness
from .inertia import PAIRS
from .inertia_relief import static_answers
from .loads import resultants, unit_loads

_LEAST_ENERGY = 1e-2  # of a centrifugal load, by that of the one with most at the same speed
_SAME = 1e-3  # share of a unit load's energy norm that others do not have, below which it is no state of its own


def stress_states(fem: FEModel, body: ReducedBody) -> GeometricStiffness:
    """States of stress of the unit loads of a body's partition, and their geometric stiffness.

    Static answers are those of the body: exact, as far as its shapes and nodes have them.
    """
    partition = body.partition
    loads = body.reduced_rows(resultants(fem, partition).T @ unit_loads(fem, partition)).T
    answers = static_answers(body.stiffness, body.mass, body.rigid, loads)
    energies = np.sum(answers * (body.stiffness @ answers), axis=0)
    answers = answers[:, energies > 0] / np.sqrt(energies[energies > 0])
    values, vectors = np.linalg.eigh(answers.T @ (body.stiffness @ answers))
    kept = values > _SAME**2 * values.max(initial=0.0)
    answers = answers @ (vectors[:, kept] / np.sqrt(values[kept]))
    states, motions, fields, onto = (body.stiffness @ answers).T, body.basis.shapes, _displacements(body, answers), None
    if len(body.basis.nodal):
        slow, onto = _slow_motions(body, answers)
        states, motions = states @ slow, _displacements(body, slow)
    # The displacements' three components have the same stiffness.
    moved = [np.ascontiguousarray(motions[axis::3]) for axis in range(3)]
    by_stress = [sum(own.T @ (stress @ own) for own in moved) for stress in _stress_forms(fem, fields)]
    matrices = np.array(by_stress).reshape(len(states), motions.shape[1], motions.shape[1])
    return GeometricStiffness(states, matrices + _of_rigid_interfaces(fem, partition, motions, fields), onto)


def _displacements(body: ReducedBody, q: Array) -> Array:
    """Displacements of all nodes, (3n, p) [m], by coordinates q, (n_dofs, p)."""
    u: Array = body.basis.shapes @ q[: body.n_shapes]
    u[node_dofs(body.basis.nodal)] += q[body.n_shapes :]
    return u


def _slow_motions(body: ReducedBody, answers: Array) -> tuple[Array, Array]:
    """Slow motions of a body that keeps nodes, (n_dofs, k), and their amplitudes by its coordinates, (k, n_dofs).

    They are rigid motion, modes up to f_cut, and the static answers, (n_dofs, p), as far as these are none of them.
    """
    mass, stiffness, rigid = body.mass, body.stiffness, mass_normalised(body.rigid, body.mass)
    f_cut = max(body.f_cut, least_frequency(stiffness, mass))
    modes = np.hstack([rigid, eigenmodes(stiffness, mass, rigid, 2 * np.pi * f_cut).vectors])
    static = orthonormal_complement(answers, mass, modes)
    forces = stiffness @ static
    # Loads find the amplitudes of static answers, by the work that they do on them.
    return np.hstack([modes, static]), np.vstack([(mass @ modes).T, np.linalg.solve(static.T @ forces, forces.T)])


def with_centrifugal_loads(fem: FEModel, partition: Partition) -> Partition:
    """Partition with distributed loads for rotation about the centre of mass, whose static answers bases then have.

    There are six products of angular velocities. Combinations of small energy are left out: a rod has only one that
    matters, a tension.
    """
    with one_blas_thread():
        loads = centrifugal_forces(fem)
        body = FreeBody(fem, partition)
        on_model = body.model.expand.T @ loads.reshape(6, -1).T
        energies, combinations = np.linalg.eigh(on_model.T @ body.flexibility()(on_model))
    kept = combinations[:, energies > _LEAST_ENERGY * energies.max()]
    nodes = np.arange(fem.n_nodes)
    patterns = [
        LoadPattern(f"centrifugal load {i} of geometric stiffness", nodes, np.tensordot(weights, loads, 1))
        for i, weights in enumerate(kept.T)
    ]
    return replace(partition, loads=(*partition.loads, *patterns))


def centrifugal_forces(fem: FEModel) -> Array:
    """Forces, (6, n, 3) [N s2], of products of angular velocities about the centre of mass, in order of `PAIRS`."""
    arms = fem.points - fem.centre_of_mass
    fields = np.zeros((6, fem.n_nodes, 3))
    for field, (a, b) in zip(fields, PAIRS, strict=True):
        field[:, a] -= arms[:, b]
        field[:, b] -= arms[:, a] if a != b else 0.0
        field += arms if a == b else 0.0
    return np.array([(fem.mass @ field.ravel()).reshape(-1, 3) for field in fields])


def _of_rigid_interfaces(fem: FEModel, partition: Partition, shapes: Array, fields: Array) -> Array:
    """Part of the matrices, (m, ns, ns), of the nodes' second-order motion with a rigid interface, w x (w x arm) / 2.

    Ties move them along their tangents, which stretches the face. The forces that hold its nodes in the displacement
    fields, (3n, m), would do work on that.
    """
    matrices = np.zeros((fields.shape[1], shapes.shape[1], shapes.shape[1]))
    forces = fem.stiffness @ fields
    for interface in partition.interfaces:
        if interface.kind == "rigid":
            dofs = node_dofs(interface.nodes)
            arms, turns = fem.points[interface.nodes] - interface.position, interface.motion[3:] @ shapes[dofs]
            virials = np.einsum("na,nbm->mab", arms, forces[dofs].reshape(len(arms), 3, -1))
            traces = np.trace(virials, axis1=1, axis2=2)[:, None, None]
            matrices += turns.T @ ((virials + virials.swapaxes(1, 2)) / 2 - traces * np.eye(3)) @ turns
    return matrices


def _stress_forms(fem: FEModel, fields: Array) -> Iterator[sp.csr_matrix]:
    """Matrices, (n, n) [N/m], of the stress in displacement fields, (3n, m): of the nodes' values in one direction."""
    parts = []
    for kind, cells in fem.kinds:
        nodes = fem.cells[cells][:, kind.columns]
        jacobian = np.einsum("eka,qkj->eqaj", fem.points[nodes], kind.gradients)
        gradient = kind.gradients @ np.linalg.inv(jacobian)  # (ne, q, k, 3)
        parts.append((cells, nodes, gradient, np.linalg.det(jacobian) * kind.rule[1]))
    for field in fields.T:
        values, rows, columns = [], [], []
        for cells, nodes, gradient, volume in parts:
            k = nodes.shape[1]
            slopes = np.einsum("eqkb,eka->eqab", gradient, field.reshape(-1, 3)[nodes], optimize=True)
            stress = _stresses(fem, cells, slopes) * volume[:, :, None, None]
            on_points = (gradient @ stress).swapaxes(1, 2).reshape(len(nodes), k, -1)
            values.append(on_points @ gradient.swapaxes(1, 2).reshape(len(nodes), k, -1).swapaxes(1, 2))
            rows.append(np.repeat(nodes, k, axis=1))
            columns.append(np.tile(nodes, (1, k)))
        entries = np.concatenate([value.ravel() for value in values])
        where = tuple(np.concatenate([part.ravel() for part in ends]) for ends in (rows, columns))
        yield sp.csr_matrix((entries, where), shape=(fem.n_nodes,) * 2)


def _stresses(fem: FEModel, cells: Array, slopes: Array) -> Array:
    """Stress in elements, (m,) int, by gradients du_a/dx_b at points of each; both (m, q, 3, 3) [Pa]."""
    shear, lame = (
        np.broadcast_to(value, len(fem.cells))[cells, None, None, None]
        for value in (fem.elastic.shear_modulus, fem.elastic.lame)
    )
    dilatation = np.trace(slopes, axis1=2, axis2=3)[:, :, None, None]
    stress: Array = shear * (slopes + slopes.swapaxes(2, 3)) + lame * dilatation * np.eye(3)
    return stress
