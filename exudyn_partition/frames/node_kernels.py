"""Compiled motion of the nodes of a contact's patch, in inertial and floating frames alike.

What stays the same lies in one object, `FlatNodes`: to pass each of its arrays would take several times as long.
"""

from __future__ import annotations

import numpy as np
from numba.experimental import structref

from ..support.arrays import Array
from ..support.compiled import compiled, inner
from ..support.struct_kernels import StructType, define_struct
from .kernels import add_generalised, body_axes, change_of_axes, place_turned, set_torque


@structref.register
class FlatNodesType(StructType):
    """Type of `FlatNodes` in compiled loops."""


class FlatNodes(structref.StructRefProxy):
    """Nodes of a body that are followed, k of the np nodes of a patch, see `loops.flat_nodes`."""

    active: Array
    start: Array
    arms: Array
    rows: Array
    growth: Array
    rotation: Array
    node_axes: Array
    axes: Array
    floats: bool


define_struct(FlatNodes, FlatNodesType, [*FlatNodes.__annotations__])


@compiled
def flat_nodes(arrays: tuple[Array, Array, Array, Array, Array, Array, Array, Array], floats: bool) -> FlatNodes:
    """Make one of its fields; unlike its own constructor, this is kept on disk."""
    return FlatNodes(*arrays, floats)  # type: ignore[no-untyped-call]


@inner
def set_places(nodes: FlatNodes, q: Array, products: Array, x: Array) -> None:
    """Set places x, (np, 3), of the nodes at coordinates q, see `Kinematics.place`; others are left as they are.

    `products`, (6,), are those by which the body grows; empty if it does not.
    """
    active, start, arms, rows, growth = nodes.active, nodes.start, nodes.arms, nodes.rows, nodes.growth
    if not nodes.floats:
        for i in range(len(active)):
            a, b, c = start[i, 0], start[i, 1], start[i, 2]
            for k in range(rows.shape[1]):
                a += rows[3 * i, k] * q[k]
                b += rows[3 * i + 1, k] * q[k]
                c += rows[3 * i + 2, k] * q[k]
            x[active[i], 0], x[active[i], 1], x[active[i], 2] = a, b, c
        return
    axes, change = body_axes(q, nodes.rotation, nodes.node_axes), change_of_axes(q, nodes.rotation, nodes.node_axes)
    if len(growth) > 0 and len(products) > 0:
        start, arms, first = start.copy(), arms.copy(), nodes.axes
        for i in range(len(active)):
            for a in range(3):
                grown = 0.0
                for c in range(6):
                    grown += growth[3 * i + a, c] * products[c]
                arms[i, a] += grown
                for b in range(3):
                    start[i, b] += first[b, a] * grown
    for i in range(len(active)):
        place_turned(q, axes, change, start, arms, rows, i, x, active[i])


@inner
def axes_at(nodes: FlatNodes, q: Array) -> Array:
    """Axes of the body at coordinates q, as columns, (3, 3)."""
    if nodes.floats:
        return body_axes(q, nodes.rotation, nodes.node_axes)
    return nodes.axes


@inner
def act(nodes: FlatNodes, q: Array, forces: Array, result: Array) -> None:
    """Add generalised forces of forces on the patch's nodes, (np, 3), to a result, (n,); see `Kinematics.generalised`.

    Entries of a floating body's torque are set.
    """
    active, rows, arms, floats = nodes.active, nodes.rows, nodes.arms, nodes.floats
    torque, axes = np.zeros(3), nodes.axes
    if floats:
        axes = body_axes(q, nodes.rotation, nodes.node_axes)
    for i in range(len(active)):
        f, g, h = forces[active[i], 0], forces[active[i], 1], forces[active[i], 2]
        if f != 0.0 or g != 0.0 or h != 0.0:
            if floats:
                add_generalised(q, axes, arms, rows, i, f, g, h, torque, result)
            else:
                for k in range(rows.shape[1]):
                    result[k] += f * rows[3 * i, k] + g * rows[3 * i + 1, k] + h * rows[3 * i + 2, k]
    if floats:
        set_torque(torque, nodes.node_axes, result)
