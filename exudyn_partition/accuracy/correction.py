"""What functions of one order more change of a reduced body: stiffness, gaps and flexibility.

The functions s that the next order adds on the same elements (hierarchical surplus) have the residuals

    r_i = (w_i^2 M - K)_s phi_i of the kept shapes,    R = g_s - M_s2 P g - K_s2 u of the rows g of the contact,

where u is the static answer that the kept shapes do not contain, and P g the part of the load that they do. With
r = [r_1 ... R], x = K_ss^-1 r, y = (K - w^2 M)_2s x, and the flexibility F_r of all that the kept shapes leave out,

    E = x' r + y' F_r y

are the changes, of opposite sign for the stiffness diag(w^2) of the shapes, of their gaps at the rows, and of the
flexibility F there: the first two terms of a series for the inverse of a Schur complement. K_ss is well conditioned, so
a few steps of conjugate gradients solve with it. Shapes above the truncation frequency, the static answers to
interfaces and loads, count with w = 0 in the residuals. On a rigid interface, which cannot deform, the functions are
held.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from ..algebra.sparse.conjugate_gradients import solve_roughly
from ..algebra.sparse.flexibility import FreeBodyFlexibility
from ..errors import InputError
from ..fe.model import FEModel, node_dofs
from ..fe.patches import Patch
from ..fe.shapes import FACET_NODES
from ..meshing.ngsolve_fem import surplus_of
from ..meshing.surplus import Surplus
from ..plasticity.dilatation import with_free_zones
from ..reduction.body import ReducedBody
from ..reduction.free_body import DROP_ABOVE, FreeBody
from ..reduction.inertia import InertiaIntegrals
from ..reduction.loads import patch_slice
from ..support.arrays import Array
from ..surfaces.points import contact_points
from ..surfaces.rows import point_matrix
from ..surfaces.surface import Surface

_SOLVED = 0.03  # relative residual of conjugate gradients, whose square is the error of x' r
LEFT = 0.5  # share of the error that functions show, which stays in a corrected body at most: `validation/mesh/correct`
_LEAST = 0.25  # least square of a frequency that is left, by the lowest one: coarser meshes have no useful estimate
_INSIDE = np.array([[0.3, 0.2], [0.2, 0.3], [0.5, 0.25]])  # of a facet: where no function of its own is zero


@dataclass(frozen=True, eq=False)
class Points:
    """Points on the surface of a body at which rows push.

    Parameters
    ----------
    corners, local, normals : (p, 3) int array, (p, 2) array, (p, 3) array
        Facets' corner nodes, places in the facets, and directions.
    mean : (k, p) csr matrix
        Weights of the points in each of k rows.
    """

    corners: Array
    local: Array
    normals: Array
    mean: sp.csr_matrix


@dataclass(frozen=True, eq=False)
class Change:
    """What the functions change of one body with ns shapes and of k rows.

    Parameters
    ----------
    turn : (ns, ns) array
        New shapes by the old ones, orthogonal.
    squares : (ns,) array
        Squares of the new shapes' frequencies [rad2/s2].
    gaps : (k, ns) array
        What the old shapes have in addition at the rows.
    flexibility : (k, k) array
        Added to that of the rows [m/N].
    """

    turn: Array
    squares: Array
    gaps: Array
    flexibility: Array


class Finer:
    """A reduced body and the functions that the next order adds to its mesh.

    Parameters
    ----------
    fem : FEModel
    body : ReducedBody
    elastic : FreeBodyFlexibility, optional
        Of the whole body with its rigid interfaces tied; default: it is made, by a factorisation.
    surplus : Surplus, optional
        The functions; default: they are assembled.
    """

    def __init__(
        self,
        fem: FEModel,
        body: ReducedBody,
        elastic: FreeBodyFlexibility | None = None,
        surplus: Surplus | None = None,
    ) -> None:
        self.fem, self.body = fem, body
        self._at_nodes: dict[int, Change] = {}
        free = FreeBody(with_free_zones(fem, body.partition), body.partition)
        self._expand = free.model.expand
        self._elastic = elastic or free.flexibility()
        self._surplus = surplus = surplus or surplus_of(fem)
        self._stiffness, self._coupling, self._mass = surplus.stiffness, surplus.coupling, surplus.mass_coupling
        fixed = self._fixed_functions()
        if len(fixed):
            kept = np.ones(3 * surplus.size)
            kept[node_dofs(fixed)] = 0.0
            only = sp.diags(kept)
            self._stiffness = (only @ self._stiffness @ only + sp.diags(1 - kept)).tocsr()
            self._coupling, self._mass = (only @ matrix for matrix in (self._coupling, self._mass))

    def _fixed_functions(self) -> Array:
        """Numbers of the functions that do not vanish on rigid interfaces, whose facets have all nodes in one."""
        numbers = [np.empty(0, dtype=np.int64)]
        for interface in self.body.partition.interfaces:
            facets = self.fem.facets[np.isin(self.fem.facets, interface.nodes).all(axis=1)]
            if interface.kind == "rigid" and len(facets):
                corners = np.repeat(facets[:, :3], len(_INSIDE), axis=0)
                numbers.append(np.unique(self._surplus.values_at(corners, np.tile(_INSIDE, (len(facets), 1))).indices))
        return np.unique(np.concatenate(numbers))

    def change(self, on_nodes: sp.csr_matrix, points: Points) -> Change:
        """What the functions change of the body and of k rows.

        Parameters
        ----------
        on_nodes : (k, 3n) csr matrix
            The rows on the displacements of all nodes.
        points : Points
            The same rows by their points.
        """
        basis = self.body.basis
        moving = np.flatnonzero(basis.omega > 0)
        rigid, shapes, squares = basis.shapes[:, basis.omega == 0], basis.shapes[:, moving], basis.omega[moving] ** 2
        loads, m = on_nodes.T.toarray(), len(squares)

        kept = np.hstack([rigid, shapes])
        static = self._expand @ self._elastic(self._expand.T @ loads)
        static -= shapes @ ((shapes.T @ loads) / squares[:, None])  # what the kept shapes do not contain
        of_rows = self._of_rows(points) - self._mass @ (kept @ (kept.T @ loads)) - self._coupling @ static
        # Shapes above are static answers to interfaces and loads. They follow motion of much lower frequencies.
        kept_squares = np.where(squares <= (DROP_ABOVE * 2 * np.pi * self.body.f_cut) ** 2, squares, 0.0)
        of_shapes = (self._mass @ shapes) * kept_squares - self._coupling @ shapes
        residuals = np.hstack([of_shapes, of_rows])
        # Apart: those of shapes, which are smooth, take two to three times the steps of those of rows.
        answers = np.hstack([solve_roughly(self._stiffness, each, _SOLVED) for each in (of_shapes, of_rows)])
        back = self._coupling.T @ answers
        back[:, :m] -= (self._mass.T @ answers[:, :m]) * kept_squares
        of_kept = shapes.T @ back
        E = answers.T @ residuals + self._elastic.energies(self._expand.T @ back)
        E -= of_kept.T @ (of_kept / squares[:, None])
        E = (E + E.T) / 2
        values, vectors = np.linalg.eigh(np.diag(squares) - E[:m, :m])
        turn, gaps = np.eye(len(basis.omega)), np.zeros((loads.shape[1], len(basis.omega)))
        turn[np.ix_(moving, moving)], gaps[:, moving] = vectors, E[m:, :m]
        new = basis.omega**2
        new[moving] = np.maximum(values, _LEAST * squares.min(initial=0.0))
        return Change(turn, new, gaps, E[m:, m:])

    def _of_rows(self, points: Points) -> Array:
        """Forces of k rows on the functions, (3 s, k)."""
        size = self._surplus.size
        at_points = self._surplus.values_at(points.corners, points.local)
        by_axis = sp.hstack([sp.diags(points.normals[:, axis]) @ at_points for axis in range(3)], format="csr")
        interleaved = np.arange(3 * size).reshape(3, size).T.ravel()
        return np.asarray((points.mean @ by_axis[:, interleaved]).T.toarray())

    def at_nodes(self, number: int) -> Change:
        """What the functions change of the body and of the rows of a patch's nodes.

        The change is known for even loads around each node of the patch, hat functions. A matrix gives the mean
        displacements under these by those of the nodes; its inverse gives the change of the nodes themselves.
        """
        if number not in self._at_nodes:
            patch = self.body.partition.patches[number]
            on_nodes, to_rows, points = self._hats(patch)
            change = self.change(to_rows @ on_nodes, points)
            of_nodes = np.linalg.inv(to_rows.toarray())
            self._at_nodes[number] = replace(
                change, gaps=of_nodes @ change.gaps, flexibility=of_nodes @ change.flexibility @ of_nodes.T
            )
        return self._at_nodes[number]

    def corrected(self, number: int) -> ReducedBody:
        """Return the body with what the functions change of it and of the static answer of one of its patches.

        Raises
        ------
        InputError
            If the body has a plastic zone.
        """
        body, basis = self.body, self.body.basis
        if basis.zones:
            raise InputError("correct: expected elastic bodies, got one with a plastic zone, which it leaves as it is")
        patch, columns = body.partition.patches[number], patch_slice(body.partition, number)
        change = self.at_nodes(number)
        assert basis.flexibility is not None
        flexibility, shapes = np.array(basis.flexibility), basis.shapes @ change.turn
        flexibility[columns, columns] += change.flexibility
        inertia = InertiaIntegrals.of(self.fem, shapes[:, 6:], basis.mass)
        # A shape moves in addition at the patch alone, which has no mass.
        shapes = shapes + self._on_nodes(patch).T @ (change.gaps @ change.turn)
        better = replace(basis, shapes=shapes, omega=np.sqrt(change.squares), flexibility=flexibility)
        return replace(body, basis=better, stiffness=sp.diags(change.squares, format="csr"), inertia=inertia)

    def _on_nodes(self, patch: Patch) -> sp.csr_matrix:
        """Rows of the patch's nodes on all nodes."""
        n, dofs = len(patch.nodes), node_dofs(patch.nodes)
        spread = sp.csr_matrix((np.ones(3 * n), (np.arange(3 * n), dofs)), (3 * n, self.fem.n_dofs))
        return sp.kron(sp.identity(n), patch_axes(patch), format="csr") @ spread

    def _hats(self, patch: Patch) -> tuple[sp.csr_matrix, sp.csr_matrix, Points]:
        """Rows of the patch's nodes on all nodes, rows of hat functions on those, and points of the latter."""
        surface, n = Surface.of(self.fem.points, patch, np.zeros(3)), len(patch.nodes)
        points = contact_points(surface, "integrated")
        nodes, weights, mean = points.nodes, points.weights, points.mean
        local = weights @ FACET_NODES[nodes.shape[1]]
        axes = patch_axes(patch)
        by_node = np.arange(len(axes) * n).reshape(len(axes), n).T.ravel()  # axes of a node stand together
        normals = np.repeat(axes, len(nodes), axis=0)
        to_rows = sp.kron(mean @ point_matrix(nodes, weights, n), sp.identity(len(axes)), format="csr")
        rows = sp.block_diag([mean] * len(axes), format="csr")[by_node]
        corners = np.tile(patch.nodes[nodes[:, :3]], (len(axes), 1))
        return self._on_nodes(patch), to_rows, Points(corners, np.tile(local, (len(axes), 1)), normals, rows)


def patch_axes(patch: Patch) -> Array:
    """Directions of the rows of a patch's nodes, (1 or 3, 3)."""
    return patch.direction[None] if patch.axes == "normal" else np.eye(3)
