"""Bodies that spin: how much their rotation would stiffen them, compared with the bending that they have.

Rotation pulls a body across its axis, and the tension stiffens it against bending. By Southwell, a squared bending
frequency grows by a factor times that of the rate of rotation. A body without geometric stiffness has centrifugal
forces alone, and bends too easily. The check takes the lowest modes of the body, as joints hold it, and the directions
along which they bend. It is an estimate, right by a factor of two.

Theory: examples/site/theory.md, "Compression and rotation".
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from ...exudyn_bodies.joints import mass_and_rows
from ...exudyn_bodies.model import dofs_of
from ...exudyn_bodies.partition_body import PartitionBody
from ...frames.floating import FloatingKinematics
from ...reduction.buckling import mean_over
from ...support.arrays import Array
from ...support.foreign import MainSystem
from ..result import called
from .reviewed_run import Finding, ReviewedBody, ReviewedRun, size_of

_GROWTH = 0.01  # of a marker's place by rotation, by what its body's coordinates deform it there, which warns
_LEAST_GROWTH = 1e-5  # by the body's size, below which it is a matter of small stress
_LARGEST = 0.1  # share by which rotation may stiffen the bending of a body that does not know of it
_FREE, _CLAMPED = 3.0, 1.2  # Southwell's factor of a bar: free, hinged, or on a guide; and of a cantilever
_HELD = 1e3  # largest ratio that is expected of squared frequencies, of a free body by those of one that joints hold
_MODES = 4  # number of lowest modes that are looked at
_RIGID = 1e-6  # share of a free body's lowest squared frequency below which a mode is rigid motion
_MOST = 1000  # largest number of coordinates: bases that keep nodes may have many
_NODES = 500  # number of surface nodes by which the directions of bending are found


def spin(run: ReviewedRun) -> Iterator[Finding]:
    """Bodies that spin so fast that their missing geometric stiffness matters."""
    for body in run.bodies if run.result.method != "static" else ():
        item = body.item
        if item.body.stiffening is None and isinstance(item.kinematics, FloatingKinematics):
            if 6 < item.body.n_dofs < _MOST:
                yield from _stiffening_by_spin(run, body, item.kinematics)


def _stiffening_by_spin(run: ReviewedRun, body: ReviewedBody, kinematics: FloatingKinematics) -> Iterator[Finding]:
    """Finding on a body whose rotation would stiffen it against bending by more than a small share."""
    result, item = run.result, body.item
    rotation = body.q_t[:, 3:6] @ kinematics.node_axes.T
    squared = np.sum(rotation**2, axis=1)
    if not squared.any():
        return
    lowest = _lowest(item.body.basis.omega, kinematics)
    if _FREE * _HELD * squared.max() < _LARGEST * lowest:
        return
    rows = _rows(run.mbs, item)
    if not np.isfinite(rows).all():  # the state at the end of an unstable run, of which the result keeps the start
        return
    if not len(rows) and _FREE * squared.max() < _LARGEST * lowest:
        return
    q = body.q[-1]
    values, motions = _held_modes(kinematics, rows)
    rigid = int(np.sum(values < _RIGID * lowest))
    factor = _CLAMPED if rigid <= 1 else _FREE
    axes = np.linalg.eigh(kinematics.node_axes @ kinematics.inertia.tensor @ kinematics.node_axes.T)
    pulled = _pulled(rotation @ axes[1], axes[0])
    for value, motion in zip(values[rigid : rigid + _MODES], motions.T[rigid : rigid + _MODES], strict=True):
        share = factor * mean_over(2 * np.pi / np.sqrt(value), result.t, pulled @ _bent(kinematics, q, motion, axes[1]))
        if share.max() > _LARGEST * value:
            top, first = int(share.argmax()), int((share > _LARGEST * value).argmax())
            support = "held as its joints hold it" if len(rows) else "free"
            yield Finding(
                f"{called(item)} rotates with {np.sqrt(squared[top]):.4g} rad/s, from t = {result.t[first]:.6g} s on "
                f"so fast that its bending at {np.sqrt(value) / (2 * np.pi):.4g} Hz, {support}, would be stiffer by "
                f"about {share[top] / value:.2g} of its stiffness. Rotation does not stiffen this body: it bends too "
                "easily. Reduce it with geometric_stiffness=True"
            )
            return


def missing_growth(run: ReviewedRun) -> Iterator[Finding]:
    """Markers on nodes and points that would move by rotation, but do not: they move by coordinates alone."""
    for body in run.bodies:
        item = body.item
        for point in item.point_markers.values():
            node = item.kinematics.at(np.array([item.body.nearest_node(point)]))
            growth = node.grown(body.q_t)
            if growth is None:
                break
            motions = growth, node.deformation(body.q)
            grown, deformed = (float(np.linalg.norm(motion, axis=-1).max()) for motion in motions)
            if grown > max(_LEAST_GROWTH * size_of(item.body), _GROWTH * deformed):
                yield Finding(
                    f"{called(item)} rotates so fast that centrifugal forces move its point {point} by up to "
                    f"{grown:.3g} m, beside the {deformed:.3g} m of its coordinates. Markers on nodes and points lack "
                    "that; displacement(), stresses and contact have it. Take an interface for a joint, or raise f_cut"
                )
                break


def _lowest(omega: Array, kinematics: FloatingKinematics) -> float:
    """Lowest squared frequency of the free body [rad2/s2], by those of its shapes, (ns,), unless it keeps nodes."""
    if not len(kinematics.body.basis.nodal):
        return float(omega[omega > 0].min() ** 2)
    return float(scipy.linalg.eigvalsh(kinematics.elastic_stiffness, subset_by_index=[0, 0])[0])


def _rows(mbs: MainSystem, item: PartitionBody) -> Array:
    """Rows of all joints on a body's coordinates, (k, n), at the end of the run; what is beyond them counts as held."""
    if not mbs.systemData.AEsize():
        return np.zeros((0, item.body.n_dofs))
    rows = sp.csc_matrix(mass_and_rows(mbs)[1])[:, dofs_of(mbs, item)]
    on_body: Array = rows.toarray()
    return on_body[on_body.any(axis=1)]


def _held_modes(kinematics: FloatingKinematics, rows: Array) -> tuple[Array, Array]:
    """Squared frequencies, (m,) [rad2/s2], and motions, (n, m), of unit mass that keep rows, (k, n), at zero."""
    root = 1 / np.sqrt(kinematics.mass)
    stiffness = scipy.linalg.block_diag(np.zeros((6, 6)), kinematics.elastic_stiffness)
    allowed = scipy.linalg.null_space(rows * root) if len(rows) else np.eye(len(root))
    values, vectors = np.linalg.eigh(allowed.T @ (root[:, None] * stiffness * root) @ allowed)
    return values, root[:, None] * (allowed @ vectors)


def _pulled(spin: Array, moments: Array) -> Array:
    """How far rotation, (n, 3) [rad/s], pulls along each principal axis, (n, 3) [rad2/s2], by moments of inertia, (3,).

    A body pulls most along the axis across which it is longest.
    """
    lengths = np.maximum(moments.sum() / 2 - moments, 0.0)  # integrals of the squares of the places along the axes
    pulled: Array = (np.sum(spin**2, axis=1)[:, None] - spin**2) * (lengths / lengths.max())
    return pulled


def _bent(kinematics: FloatingKinematics, q: Array, motion: Array, axes: Array) -> Array:
    """Shares in which a motion, (n,), turns the body along each of its axes, the columns of (3, 3): (3,), sum 2.

    They follow from the squared gradients of a quadratic field through the motion of nodes on the surface. Bending
    along an axis also turns across it, so that both have the same share.
    """
    nodes = np.unique(kinematics.body.facets)
    at = kinematics.at(nodes[:: len(nodes) // _NODES + 1])
    moved = at.velocities(q, motion) @ kinematics.frame(q)[1] @ axes
    places = at.arms @ axes
    x = places / np.ptp(places, axis=0).max()
    pairs = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
    fields = np.column_stack([np.ones(len(x)), x, *(x[:, a] * x[:, b] for a, b in pairs)])
    solution = np.linalg.lstsq(fields, moved, rcond=1e-9)[0]
    squares = np.empty(3)
    for axis in range(3):
        slopes = np.tile(solution[1 + axis], (len(x), 1))
        for (a, b), coefficients in zip(pairs, solution[4:], strict=True):
            slopes += np.outer(x[:, b] * (a == axis) + x[:, a] * (b == axis), coefficients)
        squares[axis] = np.sum(slopes**2)
    shares: Array = 2 * squares / max(squares.sum(), np.finfo(float).tiny)
    return shares
