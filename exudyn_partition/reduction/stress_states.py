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
from ..fe.facets import nodal_area
from ..fe.model import FEModel, MassKind, node_dofs
from ..fe.partition import Partition
from ..fe.patches import LoadPattern, Patch
from ..support.arrays import Array
from .basis import least_frequency
from .body import ReducedBody
from .free_body import FreeBody
from .geometric_stiffness import GeometricStiffness
from .inertia_relief import static_answers
from .loads import centrifugal_accelerations, resultants, unit_loads

_LEAST_ENERGY = 1e-2  # of a centrifugal load, by that of the one with most at the same speed
_SAME = 1e-3  # share of a unit load's energy norm that others do not have, below which it is no state of its own
_APART = 1e-2  # such a share, far above which a state has all stress that the coordinates' answers lack


def stress_states(fem: FEModel, body: ReducedBody, n_loads: int, of_patches: Array) -> GeometricStiffness:
    """States of stress of the first unit loads of a body's partition, `n_loads` of them, and their geometric stiffness.

    The coordinates tell the size of a load by their own answer to it. Its stress is that of the exact answer. Both are
    the same for loads that have attachment modes. The coordinates' answers to forces on patches lack a part: exact are
    the answers `of_patches`, (3n, p), to the first p loads. Where such an answer is almost that of other loads, this
    part is left out, since the size would be arbitrary.
    """
    partition, K, p = body.partition, body.stiffness, of_patches.shape[1]
    loads = body.reduced_rows(resultants(fem, partition).T @ unit_loads(fem, partition)).T[:, :n_loads]
    answers = static_answers(K, body.mass, body.rigid, loads)
    energies = np.sum(answers * (K @ answers), axis=0)
    scales = np.where(energies > 0, 1 / np.sqrt(np.where(energies > 0, energies, 1.0)), 0.0)
    lacking = (of_patches - _displacements(body, answers[:, :p])) * scales[:p]
    answers = answers * scales
    values, combined = _independent(answers[:, p:], K)
    others = answers[:, p:] @ (combined / np.sqrt(values))
    rest = answers[:, :p] - others @ (others.T @ (K @ answers[:, :p]))
    values, combined = _independent(rest, K)
    answers = np.hstack([others, rest @ (combined / np.sqrt(values))])
    fields = _displacements(body, answers)
    fields[:, others.shape[1] :] += lacking @ (combined * (np.sqrt(values) / (values + _APART**2)))
    states, motions, onto = (K @ answers).T, body.basis.shapes, None
    if _keeps_dents(body):
        slow, onto = _slow_motions(body, answers)
        states, motions = states @ slow, _displacements(body, slow)
    # The displacements' three components have the same stiffness.
    moved = [np.ascontiguousarray(motions[axis::3]) for axis in range(3)]
    by_stress = [sum(shapes.T @ (stress @ shapes) for shapes in moved) for stress in _stress_forms(fem, fields)]
    matrices = np.array(by_stress).reshape(len(states), motions.shape[1], motions.shape[1])
    return GeometricStiffness(states, matrices + _of_rigid_interfaces(fem, partition, motions, fields), onto)


def _independent(answers: Array, stiffness: sp.csr_matrix) -> tuple[Array, Array]:
    """Energies, (k,), and combinations, (p, k), of answers, (n_dofs, p), which are independent of each other."""
    values, combined = np.linalg.eigh(answers.T @ (stiffness @ answers))
    kept = values > _SAME**2
    return values[kept], combined[:, kept]


def _displacements(body: ReducedBody, q: Array) -> Array:
    """Displacements of all nodes, (3n, p) [m], by coordinates q, (n_dofs, p)."""
    u: Array = body.basis.shapes @ q[: body.n_shapes]
    u[node_dofs(body.basis.nodal)] += q[body.n_shapes :]
    return u


def _keeps_dents(body: ReducedBody) -> bool:
    """Whether most coordinates are fast, as where a basis keeps the motion of patches."""
    slow = np.count_nonzero(body.basis.omega <= 2 * np.pi * body.f_cut)
    return bool(len(body.basis.nodal) or slow < body.n_dofs / 4)


def _slow_motions(body: ReducedBody, answers: Array) -> tuple[Array, Array]:
    """Slow motions of a body, (n_dofs, k), and their amplitudes by its coordinates, (k, n_dofs).

    They are rigid motion, modes up to f_cut, and the static answers, (n_dofs, p), as far as these are none of them.
    """
    mass, stiffness, rigid = body.mass, body.stiffness, mass_normalised(body.rigid, body.mass)
    f_cut = max(body.f_cut, least_frequency(stiffness, mass))
    modes = np.hstack([rigid, eigenmodes(stiffness, mass, rigid, 2 * np.pi * f_cut).vectors])
    static = orthonormal_complement(answers, mass, modes)
    forces = stiffness @ static
    # Loads find the amplitudes of static answers, by the work that they do on them.
    return np.hstack([modes, static]), np.vstack([(mass @ modes).T, np.linalg.solve(static.T @ forces, forces.T)])


def with_stress_loads(fem: FEModel, partition: Partition, mass: MassKind) -> tuple[Partition, int, Array]:
    """Partition with distributed loads whose static answers bases then have; and what else `stress_states` needs.

    Unit loads are those of the partition, and of rotation about the centre of mass. The latter are six products of
    angular velocities. Combinations of small energy are left out: a rod has only one that matters, a tension.

    The answer to a force on a patch is no shape: its dent belongs to the residual flexibility. The inertia of its
    motion is a load without a dent. The answer to that tells the force from other loads.
    """
    weights = fem.mass if mass == "consistent" else fem.lumped_mass_matrix
    with one_blas_thread():
        body = FreeBody(fem, partition, mass)
        flexibility, expand = body.flexibility(), body.model.expand

        def answer(loads: Array) -> Array:
            return np.asarray(expand @ flexibility(expand.T @ loads))

        centrifugal = weights @ centrifugal_accelerations(fem)
        energies, combinations = np.linalg.eigh(centrifugal.T @ answer(centrifugal))
        kept = combinations[:, energies > _LEAST_ENERGY * energies.max()]
        rotating = _with_loads(partition, "centrifugal load", centrifugal @ kept)
        on_patches = replace(partition, interfaces=(), loads=())
        of_patches = answer((unit_loads(fem, on_patches).T @ resultants(fem, on_patches)).toarray())
        tractions = [_tractions(fem, patch) for patch in partition.patches if not patch.wanders]
        moved = answer(np.hstack([np.empty((fem.n_dofs, 0)), *tractions]))
        n_loads = resultants(fem, rotating).shape[1]
        return _with_loads(rotating, "inertia of a force on a patch", weights @ moved), n_loads, of_patches


def _with_loads(partition: Partition, name: str, loads: Array) -> Partition:
    """Partition with more distributed loads, (3n, k) [N]."""
    nodes = np.arange(partition.n_nodes)
    patterns = [
        LoadPattern(f"{name} {i} of geometric stiffness", nodes, load.reshape(-1, 3)) for i, load in enumerate(loads.T)
    ]
    return replace(partition, loads=(*partition.loads, *patterns))


def _tractions(fem: FEModel, patch: Patch) -> Array:
    """Uniform tractions on a patch, (3n, d), of unit resultants along its direction or along all axes."""
    share = nodal_area(fem.points, patch.facets)
    directions = patch.direction[:, None] if patch.axes == "normal" else np.eye(3)
    return np.kron((share / share.sum())[:, None], directions)


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
