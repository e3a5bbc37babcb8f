"""Geometric stiffness of a reduced body: how stress from its loads stiffens or softens it, and energy to third order.

The stress of unit loads, sigma_k, does work on the product of displacement gradients, so that

    G_k = T' (integral of sigma_k : grad u' grad v) T .

Unit loads are those of interfaces, of contact patches, distributed ones, and centrifugal ones. Inertia balances each
load, as it does in motion, so gravity needs none. Static answers of all loads are combined to m states of stress of
unit energy, orthogonal to each other. The coordinates q stress the body by amplitudes a = S q, and a load f by S K^+ f.

The amplitudes of a run come from the deformation, not from the loads, which a body does not know (joints). With the
stretch s_k = q' G_k q / 2 that rotation of parts of the body adds, the strain energy is

    U = q' K q / 2 + a . s + s . s / 2 = q' (K - S' S) q / 2 + |a + s|^2 / 2 .

It is never negative. In equilibrium a + s are the amplitudes of the loads, whatever the body's deflection: K plus their
geometric stiffness is what remains for small motion. SID files and Wallrapp and Schwertassek have the same matrices.

O. Wallrapp, R. Schwertassek, Representation of geometric stiffening in multibody system simulation, 1991.

Theory: examples/site/theory.md, "Geometric stiffness".
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from ..algebra.blas_threads import one_blas_thread
from ..fe.model import FEModel, node_dofs
from ..fe.partition import Partition
from ..fe.patches import LoadPattern
from ..support.arrays import Array
from ..support.checks import check_floats, read_only
from .free_body import FreeBody
from .inertia import PAIRS
from .loads import resultants, unit_loads

_LEAST_ENERGY = 1e-2  # of a centrifugal load, by that of the one with most at the same speed
_SAME = 1e-3  # share of a unit load's energy norm that others do not have, below which it is no state of its own


@dataclass(frozen=True, eq=False)
class GeometricStiffness:
    """States of stress of a body, and the geometric stiffness of each.

    Parameters
    ----------
    states : (m, n_dofs) array
        S, amplitudes of the states by the body's coordinates; the energy of an amplitude a is a^2 / 2.
    matrices : (m, n_dofs, n_dofs) array
        G_k of unit amplitudes.
    """

    states: Array
    matrices: Array

    def __post_init__(self) -> None:
        check_floats("states", self.states, (None, None))
        m, n = self.states.shape
        check_floats("matrices", self.matrices, (m, n, n))
        for name in ("states", "matrices"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name)))
        read_only(self.states, self.matrices)

    @classmethod
    def of(cls, fem: FEModel, partition: Partition, shapes: Array, omega: Array) -> GeometricStiffness:
        """States of the unit loads of a partition, on shapes (3n, ns) with circular frequencies (ns,), rigid ones zero.

        Static answers are those of the shapes: exact, as far as these have them.
        """
        elastic = np.flatnonzero(omega)
        loads = unit_loads(fem, partition).T @ resultants(fem, partition)
        answers = (shapes[:, elastic].T @ loads) / omega[elastic, None]  # by the root of the stiffness
        answers = answers[:, (sizes := np.linalg.norm(answers, axis=0)) > 0] / sizes[sizes > 0]
        vectors, values, _ = np.linalg.svd(answers, full_matrices=False)
        vectors = vectors[:, values > _SAME * values.max(initial=0.0)]
        states = np.zeros((vectors.shape[1], len(omega)))
        states[:, elastic] = vectors.T * omega[elastic]
        fields = shapes[:, elastic] @ (vectors / omega[elastic, None])
        # The displacements' three components have the same stiffness.
        moved = [np.ascontiguousarray(shapes[axis::3]) for axis in range(3)]
        by_stress = [sum(own.T @ (stress @ own) for own in moved) for stress in _stress_forms(fem, fields)]
        matrices = np.array(by_stress).reshape(len(states), len(omega), len(omega))
        return cls(states, matrices + _of_rigid_interfaces(fem, partition, shapes, fields))

    def of_load(self, amplitudes: Array) -> Array:
        """Geometric stiffness, (n_dofs, n_dofs), of states of stress with amplitudes (m,)."""
        return np.asarray(np.tensordot(amplitudes, self.matrices, 1))

    def without_rigid(self) -> GeometricStiffness:
        """The same for deformation alone, in mean axes: without the six rigid shapes, which stand first."""
        return GeometricStiffness(self.states[:, 6:], self.matrices[:, 6:, 6:])

    def _answer(self, q: Array) -> tuple[Array, Array, Array]:
        """Amplitudes a + s, (m,), their part s, (m,), and each matrix times q, (m, n)."""
        turned = self.matrices @ q
        stretch = turned @ q / 2
        return self.states @ q + stretch, stretch, turned

    def force(self, q: Array) -> Array:
        """Generalised forces, (n,), beside K q, that oppose the deformation."""
        amplitudes, stretch, turned = self._answer(q)
        force: Array = amplitudes @ turned + stretch @ self.states
        return force

    def tangent(self, q: Array) -> Array:
        """Derivative of `force`, (n, n)."""
        amplitudes, _, turned = self._answer(q)
        mixed = self.states.T @ turned
        tangent: Array = self.of_load(amplitudes) + mixed + mixed.T + turned.T @ turned
        return tangent

    def energy(self, q: Array) -> Array:
        """Strain energy beside q' K q / 2, (...) [J], of coordinates (..., n)."""
        stretch = np.einsum("...i,kij,...j->...k", q, self.matrices, q, optimize=True) / 2
        energy: Array = np.sum((q @ self.states.T + stretch / 2) * stretch, axis=-1)
        return energy


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
