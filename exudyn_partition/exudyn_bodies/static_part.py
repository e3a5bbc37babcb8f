"""Static answer to contact forces in results of a body: what the kept shapes lack, and a warning where it matters."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from ..errors import ModelLimitWarning
from ..fe.facets import nodal_area
from ..fe.model import FEModel, node_dofs
from ..frames.kinematics import Kinematics
from ..reduction.static_answer import StaticAnswer
from ..support.arrays import Array, Vector
from ..support.checks import validate_type
from .model import BodyItem, Samples

Static = FEModel | StaticAnswer

_LACKING = 0.02  # largest missing share of a history; its estimate is right within a factor of about two


class RecoveredBody(BodyItem, Protocol):
    """A body whose results are recovered."""

    @property
    def kinematics(self) -> Kinematics:
        """Motion of the body in space."""

    def coordinates(self, result: Samples) -> Array:
        """Coordinates q, (n, n_dofs), at the times of `result`."""


def static_motion(item: RecoveredBody, result: Samples, point: Vector, fem: Static) -> Array:
    """Static part of a node's displacement that the kept shapes do not have, (n, 3) [m]."""
    own = node_dofs(np.array([item.body.nearest_node(point)]))
    select = sp.csr_matrix((np.ones(3), (np.arange(3), own)), shape=(3, item.body.fe_dofs))
    axes = item.kinematics.frame(item.coordinates(result))[1]
    value: Array = np.einsum("tab,tb->ta", axes, static_part(item, result, select, fem))
    return value


def warn_near_contact(
    item: RecoveredBody, result: Samples, point: Vector, kept: Array, what: str, of_force: Callable[[Array], Array]
) -> None:
    """Warn if the static answer that is missing in `kept`, (n, 3), may matter at a point.

    The patch, of radius a, yields to a force by its residual flexibility. A point at a distance d yields by about
    a / (a + d) of that, like the surface of a half-space (Boussinesq).
    """
    lacking = 0.0
    for contact in result.contacts:
        for other, number in contact.sides:
            if other is item and item.body.basis.flexibility is not None and contact.compliant:
                patch = item.body.partition.patches[number]
                area = nodal_area(item.body.points, patch.facets)[patch.nodes]
                load = area / area.sum()
                if patch.axes == "xyz":
                    load = (load[:, None] * patch.node_normals).ravel()
                radius = np.sqrt(area.sum() / np.pi)
                away = np.linalg.norm(item.body.points[patch.nodes] - point, axis=1).min()
                compliance = load @ item.body.flexibility(number) @ load * radius / (radius + away)
                lacking += compliance * float(np.linalg.norm(of_force(contact.force(result))))
    size = float(np.linalg.norm(kept - kept[0])) if len(kept) else 0.0
    if lacking > _LACKING * size > 0:
        warnings.warn(
            f"body {item.name!r}: near a contact the {what} of a point lacks its static answer to the contact's "
            f"force; at {point} this is about {lacking / size:.2g} of it. Give the FE model: {what}(..., fem=fem)",
            ModelLimitWarning,
            stacklevel=4,
        )


def static_part(item: RecoveredBody, result: Samples, rows: sp.csr_matrix, fem: Static) -> Array:
    """Rows, (k, 3 nodes), times the static answer to contact forces that the kept shapes do not have, (n, k)."""
    if not isinstance(fem, StaticAnswer):
        validate_type("fem", fem, FEModel, "fe_model()")
    total = np.zeros((len(result.t), rows.shape[0]))
    own = [c for c in result.contacts if c.compliant and any(other is item for other, _ in c.sides)]
    if item.body.basis.flexibility is None or not own:
        return total
    answer = fem if isinstance(fem, StaticAnswer) else StaticAnswer(fem, item.body)
    answer.check(item.body)
    # The flexibility is symmetric: the rows act as loads, and their answers are taken at the loaded nodes.
    loaded = item.body.partition.patch_nodes
    fields = np.array([answer(row.toarray().reshape(-1, 3), loaded) for row in rows])
    axes = item.kinematics.frame(item.coordinates(result))[1]
    for contact in own:
        for (other, patch), forces in zip(contact.sides, contact.nodal_forces(result), strict=True):
            if other is item:
                at_patch = fields[:, np.searchsorted(loaded, item.body.partition.patches[patch].nodes)]
                total += np.einsum("tna,tab,knb->tk", forces, axes, at_patch, optimize=True)
    return total
