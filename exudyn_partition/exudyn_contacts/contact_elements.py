"""Exudyn adapter: force elements of contacts, and the stiffness that contacts have across elements."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp

from ..contact.formulations.stabilised import StabilisedContact
from ..contact.gaps import dense
from ..exudyn_bodies.model import runs_implicit, start_of_step
from ..exudyn_bodies.partition_body import PartitionBody
from ..frames.floating import FloatingKinematics
from ..support.arrays import Array
from ..support.optional import require
from .run_record import RunRecord, run_record

if TYPE_CHECKING:
    from .contact_items import PartitionContact

Functions = tuple[Callable[..., Any], Callable[..., Any]]


def add_element(mbs: Any, contact: PartitionContact) -> Any:
    """Add the massless object over the nodes of both bodies that is the contact; returns its number."""
    functions = (_stabilised_functions if contact.multipliers else _law_functions)(contact, run_record(mbs))
    return _add_object(mbs, contact.name, contact.nodes, *functions)


def add_links(mbs: Any, contact: PartitionContact) -> None:
    """Add the stiffness of a contact across elements: with what carries a surface, and with contacts on its bodies.

    These objects have no force, which the contacts' own elements and loads have, and cost nothing in explicit runs.
    Without them Newton's method does not converge where nothing else holds a carrier, or bodies between two contacts.
    """
    if contact.multipliers:
        return
    if contact.carrier is not None and contact.carrier.nodes:
        _add_link(mbs, [contact])
    for other in contact.group:
        if other is not contact and any(item is own for item, _ in other.sides for own, _ in contact.sides):
            _add_link(mbs, [contact, other])


def _law_functions(contact: PartitionContact, record: RunRecord) -> Functions:
    """Force of a law of the coordinates alone, and its Jacobian."""
    exu = require("exudyn")
    law: Any = contact.law
    on_constant_mass = _on_constant_mass(contact)

    def force(mbs: Any, t: float, i: Any, q: Any, q_t: Any) -> Array:
        if record.on:
            record.advance(mbs, t)
        q = np.asarray(q)
        f = law.force(q) if len(contact.group) == 1 else contact.force_in_group(mbs)
        return on_constant_mass(q, f) if law.index.size else f

    def jacobian(mbs: Any, t: float, i: Any, q: Any, q_t: Any, fODE2: float, fODE2_t: float) -> Any:
        if record.on:
            record.advance(mbs, t)
        if len(contact.group) == 1:
            law.force(np.asarray(q))
            return exu.MatrixContainer(sp.csr_matrix(fODE2 * law.tangent()))
        contact.force_in_group(mbs)
        H = dense(law.gaps.jacobian(law.index))
        return exu.MatrixContainer(sp.csr_matrix(fODE2 * (H.T @ _between(contact, contact) @ H)))

    return force, jacobian


def _add_link(mbs: Any, contacts: list[PartitionContact]) -> None:
    """Add an object with the stiffness between one contact and its carrier, or between two contacts of a group."""
    exu, record = require("exudyn"), run_record(mbs)
    nodes: list[Any] = []
    for contact in contacts:
        own = contact.nodes + ([] if contact.carrier is None else contact.carrier.nodes)
        nodes += [node for node in own if int(node) not in map(int, nodes)]

    def jacobian(mbs: Any, t: float, i: Any, q: Any, q_t: Any, fODE2: float, fODE2_t: float) -> Any:
        if record.on:
            record.advance(mbs, t)
        first, last = contacts[0], contacts[-1]
        if len(first.group) > 1:
            first.force_in_group(mbs)
        else:
            coordinates = mbs.systemData.GetODE2Coordinates(copy=False)
            first.law.force(np.concatenate([coordinates[s] for s in first.slices(mbs)]))
        K = np.zeros((len(q), len(q)))
        if first.law.index.size and last.law.index.size:
            place = {dof: k for k, dof in enumerate(_dofs(mbs, nodes))}
            (H, own), (H_last, others) = (_closed_rows(mbs, contact, place) for contact in (first, last))
            K[np.ix_(own, others)] = H.T @ _between(first, last) @ H_last
            if first is last:  # its own element has that of the bodies
                bodies = own[: first.law.gaps.n]
                K[np.ix_(bodies, bodies)] = 0.0
            else:
                K += K.T
        return exu.MatrixContainer(sp.csr_matrix(fODE2 * K))

    _add_object(mbs, "", nodes, 0, jacobian)


def _between(contact: PartitionContact, other: PartitionContact) -> Array:
    """Forces on the closed rows of one contact by gaps of those of another, (na, nb) [N/m]."""
    if len(contact.group) == 1:
        return np.asarray(contact.law.tangent_of(np.eye(len(contact.law.index))))
    return contact.together.stiffness(contact.law, other.law)


def _closed_rows(mbs: Any, contact: PartitionContact, place: dict[int, int]) -> tuple[Array, Array]:
    """Closed rows on the coordinates of bodies and carrier, (na, m), and the place of each of these, (m,)."""
    law, carrier = contact.law, contact.carrier
    H = dense(law.gaps.jacobian(law.index))
    dofs = [dof for s in contact.slices(mbs) for dof in range(s.start, s.stop)]
    if carrier is not None and carrier.nodes:
        H = np.hstack([H, law.gaps.carrier_rows(law.index) @ carrier.by_coordinates(mbs)])
        dofs += _dofs(mbs, carrier.nodes)
    return H, np.array([place[dof] for dof in dofs])


def _dofs(mbs: Any, nodes: list[Any]) -> list[int]:
    """Numbers of the nodes' coordinates in the model."""
    kind = require("exudyn").OutputVariableType.Coordinates
    starts = [(mbs.GetNodeODE2Index(node), len(mbs.GetNodeOutput(node, kind))) for node in nodes]
    return [dof for start, size in starts for dof in range(start, start + size)]


def _on_constant_mass(contact: PartitionContact) -> Callable[[Array, Array], Array]:
    """Return what makes of forces those on the constant mass of floating frames."""
    floating = [
        (s, item.kinematics) for s, item in _own_slices(contact) if isinstance(item.kinematics, FloatingKinematics)
    ]

    def function(q: Array, f: Array) -> Array:
        f = f.copy() if floating else f
        for own, kinematics in floating:
            f[own] = kinematics.on_constant_mass(q[own], f[own])
        return f

    return function


def _stabilised_functions(contact: PartitionContact, record: RunRecord) -> Functions:
    """Force of multipliers in implicit runs, and its Jacobian; nothing in explicit ones."""
    exu = require("exudyn")
    law: StabilisedContact = contact.laws["implicit"]
    on_constant_mass = _on_constant_mass(contact)

    def evaluate(mbs: Any) -> Array:
        data, solver = mbs.systemData, mbs.sys["dynamicSolver"]
        views = data.GetODE2Coordinates(copy=False), data.GetODE2Coordinates_t(copy=False)
        q, q_t = (np.concatenate([view[s] for s in contact.slices(mbs)]) for view in views)
        return on_constant_mass(q, law.force(q, q_t, solver.it.currentStepSize, start_of_step(mbs)))

    def force(mbs: Any, t: float, i: Any, q: Any, q_t: Any) -> Array:
        if record.on:
            record.advance(mbs, t)
        if not runs_implicit(mbs):
            return np.zeros(law.gaps.n)
        contact.law = law
        return evaluate(mbs)

    def jacobian(mbs: Any, t: float, i: Any, q: Any, q_t: Any, fODE2: float, fODE2_t: float) -> Any:
        if not runs_implicit(mbs):
            return exu.MatrixContainer(sp.csr_matrix((law.gaps.n,) * 2))
        if record.on:
            record.advance(mbs, t)
        evaluate(mbs)
        return exu.MatrixContainer(law.tangent(fODE2, fODE2_t))

    return force, jacobian


def _add_object(mbs: Any, name: str, nodes: list[Any], force: Any, jacobian: Callable[..., Any]) -> Any:
    """Massless object over nodes; a force of 0 is none."""
    items = require("exudyn.itemInterface")
    return mbs.AddObject(
        items.ObjectGenericODE2(
            name=name,
            nodeNumbers=nodes,
            forceUserFunction=force,
            jacobianUserFunction=jacobian,
            visualization=items.VObjectGenericODE2(show=False),
        )
    )


def _own_slices(contact: PartitionContact) -> list[tuple[slice, PartitionBody]]:
    """Where each body's coordinates are among the contact's."""
    ends = np.cumsum([0] + [item.body.n_dofs for item, _ in contact.sides])
    return [(slice(a, b), item) for a, b, (item, _) in zip(ends[:-1], ends[1:], contact.sides, strict=True)]
