"""Static answer to contact forces and plastic strain in results of a body: what the kept shapes lack, and warnings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from ..errors import ModelLimitWarning, YieldWarning
from ..fe.facets import nodal_area
from ..fe.model import FEModel, node_dofs
from ..frames.kinematics import Kinematics
from ..plasticity.strain_history import StrainHistory
from ..plasticity.zone_stress import ZoneStress
from ..reduction.body import ReducedBody
from ..reduction.recovery import locate, stress_rows
from ..reduction.static_answer import StaticAnswer
from ..support.arrays import Array, Vector
from ..support.checks import validate_array
from ..support.warn import warn
from .model import BodyItem, Samples

Static = FEModel | StaticAnswer

_AT_REST = 1e-2  # change of a force over the force, below which the body rests
_LACKING = 0.02  # largest missing share of a history; its estimate is right within a factor of about two


class RecoveredBody(BodyItem, Protocol):
    """A body whose results are recovered."""

    @property
    def kinematics(self) -> Kinematics:
        """Motion of the body in space."""

    def coordinates(self, result: Samples) -> Array:
        """Coordinates q, (n, n_dofs), at the times of `result`."""


def check_static(body: ReducedBody, fem: Static) -> None:
    """Raise `InputError` unless `fem` is the FE model of a body, or the static answer of one."""
    if isinstance(fem, StaticAnswer):
        fem.check(body)
    else:
        body.check_fem(fem)


def static_motion(item: RecoveredBody, result: Samples, nodes: Array, weights: Array, fem: Static) -> Array:
    """Static part of the mean displacement of nodes, (k,), that the kept shapes do not have, (n, 3) [m]."""
    entries = np.repeat(weights, 3), (np.tile(np.arange(3), len(nodes)), node_dofs(nodes))
    select = sp.csr_matrix(entries, shape=(3, item.body.fe_dofs))
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
    lacking = least = 0.0  # of what changes in the run, as `kept` does
    for contact in result.contacts:
        for side_item, number in contact.sides:
            if side_item == item and item.body.basis.flexibility is not None and contact.compliant:
                patch = item.body.partition.patches[number]
                area = nodal_area(item.body.points, patch.facets)[patch.nodes]
                load = area / area.sum()
                if patch.axes == "xyz":
                    load = (load[:, None] * patch.node_normals).ravel()
                radius = np.sqrt(area.sum() / np.pi)
                away = np.linalg.norm(item.body.points[patch.nodes] - point, axis=1).min()
                compliance = load @ item.body.flexibility(number) @ load * radius / (radius + away)
                force = of_force(contact.force(result))
                lacking += compliance * float(np.linalg.norm(force - force[0]))
                least += _AT_REST * compliance * float(np.linalg.norm(force))
    size = float(np.linalg.norm(kept - kept[0])) if len(kept) else 0.0
    if lacking > max(_LACKING * size, least) and size > 0.0:
        warn(
            f"body {item.name!r}: near a contact the {what} of a point lacks its static answer to the contact's "
            f"force; at {np.round(point, 6)} m this is about {lacking / size:.2g} of it. Give the FE model: "
            f"{what}(..., fem=fem)",
            ModelLimitWarning,
        )


def static_part(item: RecoveredBody, result: Samples, rows: sp.csr_matrix, fem: Static) -> Array:
    """Rows, (k, 3 nodes), times the static answer that the kept shapes do not have, (n, k).

    It is that to contact forces, and to the pseudo-forces of plastic strain.
    """
    check_static(item.body, fem)
    total = np.zeros((len(result.t), rows.shape[0]))
    on_body = [c for c in result.contacts if c.compliant and any(side_item == item for side_item, _ in c.sides)]
    if item.body.basis.flexibility is None or not on_body or not rows.shape[0]:
        return total
    answer = fem if isinstance(fem, StaticAnswer) else StaticAnswer(fem, item.body)
    # The flexibility is symmetric: the rows act as loads, and their answers are taken at the loaded nodes.
    patches, histories = item.body.partition.patches, [*zone_histories(item, result)]
    loaded = np.unique(np.concatenate([item.body.partition.patch_nodes, *(h.zone.nodes for _, h in histories)]))
    fields = np.array([answer(row.toarray().reshape(-1, 3), loaded) for row in rows])
    axes = item.kinematics.frame(item.coordinates(result))[1]
    for contact in on_body:
        for (side_item, patch), forces in zip(contact.sides, contact.nodal_forces(result), strict=True):
            if side_item == item:
                at_patch = fields[:, np.searchsorted(loaded, patches[patch].nodes)]
                total += np.einsum("tna,tab,knb->tk", forces, axes, at_patch, optimize=True)
    for _, history in histories:
        at_zone = fields[:, np.searchsorted(loaded, history.zone.nodes)].reshape(len(fields), -1)
        numbers, of_sample = np.unique(history.numbers(result.t), return_inverse=True)
        by_strain = [at_zone @ history.zone.pseudo_forces(history.strain(number)) for number in numbers]
        total += np.array(by_strain)[of_sample]
    return total


def zone_histories(item: RecoveredBody, result: Samples) -> Iterator[tuple[int, StrainHistory]]:
    """Plastic strain of the body's zones in the run, with the numbers of their patches."""
    for contact in result.contacts:
        if any(body == item for body, _ in contact.sides):
            for (body, patch), history in zip(contact.sides, contact.plastic.strain_histories(result), strict=False):
                if body == item and history is not None:
                    yield patch, history


def zone_stresses(body: ReducedBody, fem: FEModel) -> dict[int, ZoneStress]:
    """Stress in the plastic zones of a body, by the numbers of their patches."""
    zones = {}
    for number, patch in enumerate(body.partition.patches):
        if patch.plastic is not None:
            zones[number] = ZoneStress(fem, patch.plastic, patch.material or fem.material)
    return zones


def stress_parts(item: RecoveredBody, result: Samples, points: Array, fem: FEModel) -> tuple[sp.csr_matrix, Array]:
    """Rows of the stress of the strain at points, (6k, 3 nodes), and what plastic strain takes from it, (n, k, 6) [Pa].

    The rows know the elements of the zones, see `plasticity.zone_stress`.
    """
    points = validate_array("points", points, (None, 3))
    rows, at, zones = stress_rows(fem, points), locate(fem, points), zone_stresses(item.body, fem)
    taken = np.zeros((len(result.t), len(points), 6))
    for zone in zones.values():
        rows = sp.csr_matrix(rows + zone.rows(*at))
    for patch, history in zone_histories(item, result):
        numbers, of_sample = np.unique(history.numbers(result.t), return_inverse=True)
        taken += np.array([zones[patch].taken(*at, history.strain(number)) for number in numbers])[of_sample]
    return rows, taken


def warn_within_zones(item: RecoveredBody, result: Samples, rows: sp.csr_matrix) -> None:
    """Warn if rows, (k, 3 nodes), lie within a plastic zone that has flowed: those of stress lack plastic strain."""
    used = abs(sp.csr_matrix(rows)).astype(bool).astype(int)
    for contact in result.contacts:
        for body, number in contact.sides:
            region = item.body.partition.patches[number].plastic if body == item else None
            if region is not None and contact.plastic.work(result).any():
                inside = np.zeros(item.body.fe_dofs, dtype=int)
                inside[node_dofs(region.nodes)] = 1
                within = np.flatnonzero((used @ inside == used.sum(axis=1).A1) & (used @ inside > 0))
                if within.size:
                    warn(
                        f"body {item.name!r}: rows {within[0]} to {within[-1]} lie where the material has yielded. "
                        "Strains are right, stresses lack what plastic strain takes from them: take "
                        "stress(result, points, fem) of the body",
                        YieldWarning,
                    )
