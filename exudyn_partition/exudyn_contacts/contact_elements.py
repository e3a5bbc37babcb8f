"""Exudyn adapter: force elements of contacts, and the stiffness that contacts have across elements."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import scipy.sparse as sp

from ..exudyn_bodies.joints import mass_and_rows
from ..exudyn_bodies.model import coordinate_slices, latest_solver, registered, user_function
from ..frames.floating import FloatingKinematics
from ..frames.inertial import InertialKinematics
from ..support.arrays import Array, consecutive
from ..support.foreign import Coordinates, ItemIndex, MainSystem, MatrixContainer, NodeIndex, ObjectIndex
from ..support.optional import require
from .contact_run import ContactRun
from .model_run import Runs
from .partition_contact import PartitionContact

_TOUCHING = 1e-3  # of a facet's size: gaps of rows that touch


def add_element(mbs: MainSystem, contact: PartitionContact, runs: Runs) -> ObjectIndex:
    """Add the massless object over the nodes of both bodies that is the contact; returns its number."""
    exu = require("exudyn")
    slices = consecutive([item.body.n_dofs for item, _ in contact.sides])
    floating = [
        (own, item.kinematics)
        for own, (item, _) in zip(slices, contact.sides, strict=True)
        if isinstance(item.kinematics, FloatingKinematics)
    ]

    def force(mbs: MainSystem, t: float, i: ItemIndex, q: Coordinates, q_t: Coordinates) -> Array:
        begin = time.perf_counter()
        run = runs.advanced(mbs, t, contact)
        f = run.evaluate(mbs, t, q)
        if run.place_told is not None:
            run.tell(mbs.systemData.GetDataCoordinates(copy=False))
        if floating and f.any():
            f, now = f.copy(), np.asarray(q)
            for own, kinematics in floating:
                f[own] = kinematics.on_constant_mass(now[own], f[own])
        run.time_s += time.perf_counter() - begin
        return f

    def jacobian(
        mbs: MainSystem, t: float, i: ItemIndex, q: Coordinates, q_t: Coordinates, fODE2: float, fODE2_t: float
    ) -> MatrixContainer:
        run = runs.advanced(mbs, t, contact)
        run.update(mbs, t, q)
        if (touching := _touching_stiffness(mbs, run)) is not None:
            return exu.MatrixContainer(sp.csr_matrix(fODE2 * touching))
        if run.together is None:
            return exu.MatrixContainer(sp.csr_matrix(run.law.tangent_matrix(fODE2, fODE2_t)))
        H, yielding = run.row_jacobian(), run.law.yielding
        stiffness = H.T @ _between(run, run) @ H
        if yielding is not None:
            stiffness = yielding.tangent(stiffness)
        return exu.MatrixContainer(sp.csr_matrix(fODE2 * stiffness))

    return _add_object(mbs, contact.name, contact.nodes, force, jacobian)


def _touching_stiffness(mbs: MainSystem, run: ContactRun) -> Array | None:
    """Stiffness, (n, n), of an open contact whose rows just touch, in the first iteration of a load step, or None.

    An open contact has none, and a block that only stands on another one would have no equilibrium under its load.
    """
    law, solver = run.law, mbs.sys.get("staticSolver")
    if law.index.size or solver is None or solver.it.newtonSteps != 1 or latest_solver(mbs) is not solver:
        return None
    return law.closed_stiffness() if law.least_gap < _TOUCHING * law.gaps.size else None


def add_common_element(
    mbs: MainSystem, contact: PartitionContact, others: Sequence[PartitionContact], runs: Runs
) -> None:
    """Let one object over the nodes of many bodies apply the forces of the contact too, in runs by `all_at_once`.

    The model has one such object, and no other run has its forces. Exudyn calls Python for it once, and for the
    contacts' own elements once each. Contacts that are solved alone keep their own. In all runs the object has the
    stiffness between its contacts, see `add_links`.
    """
    if contact.together is None or not all(member.elastic for member in contact.group):
        return
    exu = require("exudyn")
    common = next((other["oCommon"] for other in others if "oCommon" in other), None)
    nodes = {} if common is None else {int(node): node for node in mbs.GetObjectParameter(common, "nodeNumbers")}
    new = [member for member in contact.group if "oCommon" not in member]
    nodes |= {int(node): node for member in new for node in _moved_nodes(member)}

    def jacobian(
        mbs: MainSystem, t: float, i: ItemIndex, q: Coordinates, q_t: Coordinates, fODE2: float, fODE2_t: float
    ) -> MatrixContainer:
        coupled = [contact for contact in registered(mbs).contacts.values() if "oCommon" in contact]
        pairs = [(one, other) for one in coupled for other in one.linked if "oCommon" in other]
        K = _stiffness_between(mbs, runs, pairs, mbs.GetObjectParameter(i, "nodeNumbers"), t)
        return exu.MatrixContainer(fODE2 * K)

    if common is None:
        common = _add_object(mbs, "", [*nodes.values()], 0, jacobian)
    else:
        mbs.SetObjectParameter(common, "nodeNumbers", [*nodes.values()])
    for member in new:
        member["oCommon"] = common


@contextlib.contextmanager
def all_at_once(mbs: MainSystem, contacts: Sequence[PartitionContact], runs: Runs, *, explicit: bool) -> Iterator[None]:
    """Apply the forces of contacts on common bodies together in runs that begin meanwhile; their own elements are off.

    In explicit runs of bodies whose frames stand still they push themselves. Else the common element applies them.
    """
    common = [contact for contact in contacts if all("oCommon" in member for member in contact.group)]
    if not common:
        yield
        return
    if explicit and (inverse_mass := _inverse_mass(mbs, common)) is not None:
        with runs.at_once(common), switched_off(mbs, common), _pushed(mbs, inverse_mass, runs):
            yield
        return
    element = common[0]["oCommon"]
    dofs = np.array(_dofs(mbs, mbs.GetObjectParameter(element, "nodeNumbers")))

    bodies = {id(item): item for contact in common for item, _ in contact.sides}.values()
    floating = [
        (np.concatenate([np.r_[s] for s in coordinate_slices(mbs, item)]), item.kinematics)
        for item in bodies
        if isinstance(item.kinematics, FloatingKinematics)
    ]

    nothing = [0.0] * len(dofs)

    def force(mbs: MainSystem, t: float, i: ItemIndex, q: Coordinates, q_t: Coordinates) -> list[float]:
        f = runs.now(mbs).force_at_once(mbs, t)
        if f is None:
            return nothing
        if floating:
            f, now = f.copy(), mbs.systemData.GetODE2Coordinates(copy=False)
        for own, kinematics in floating:
            if f[own].any():
                f[own] = kinematics.on_constant_mass(now[own], f[own])
        value: list[float] = f[dofs].tolist()  # Exudyn takes twice as long to read an array
        return value

    mbs.SetObjectParameter(element, "forceUserFunction", force)
    try:
        with runs.at_once(common), switched_off(mbs, common):
            yield
    finally:
        mbs.SetObjectParameter(element, "forceUserFunction", 0)


@contextlib.contextmanager
def _pushed(mbs: MainSystem, inverse_mass: Array, runs: Runs) -> Iterator[None]:
    """Let contacts push the coordinates of an explicit run themselves, at the end of each step.

    Exudyn hands all coordinates of the common element over as lists in each step, which takes long.
    `inverse_mass`, (nq,), is that of all coordinates [1/kg].
    """
    own_function, last = user_function(mbs.GetPostStepUserFunction()), math.nan

    def after_step(mbs: MainSystem, t: float) -> bool:
        nonlocal last
        f = runs.now(mbs).force_at_once(mbs, t)
        if f is not None:
            acceleration, data = inverse_mass * f, mbs.systemData
            data.GetODE2Coordinates_tt(copy=False)[:] += acceleration
            if t > last:  # not before the first step
                data.GetODE2Coordinates_t(copy=False)[:] += 0.5 * (t - last) * acceleration
        last = t
        return own_function is None or own_function(mbs, t)

    mbs.SetPostStepUserFunction(after_step)
    try:
        yield
    finally:
        mbs.SetPostStepUserFunction(own_function or 0)


def _inverse_mass(mbs: MainSystem, contacts: Sequence[PartitionContact]) -> Array | None:
    """Inverse of the mass of all coordinates, (nq,), zero where no contact pushes; None if forces do more than push.

    They do where a frame moves, where joints hold a body, or where another item adds its mass to one. Loads on what
    carries a rigid surface need the forces within the step.
    """
    items = {id(item): item for contact in contacts for item, _ in contact.sides}.values()
    standing = all(isinstance(item.kinematics, InertialKinematics) for item in items)
    if mbs.systemData.AEsize() or not standing or any(contact.carrier is not None for contact in contacts):
        return None
    M, _ = mass_and_rows(mbs)
    own = np.concatenate([np.r_[s] for item in items for s in coordinate_slices(mbs, item)])
    if M[own].nnz > len(own):  # not diagonal
        return None
    result = np.zeros(M.shape[0])
    result[own] = 1 / M.diagonal()[own]
    return result


@contextlib.contextmanager
def switched_off(mbs: MainSystem, contacts: Sequence[PartitionContact]) -> Iterator[None]:
    """Let no elements of their own apply the forces of these contacts meanwhile: a run only pays for calls."""
    functions = [mbs.GetObjectParameter(contact["oContact"], "forceUserFunction") for contact in contacts]
    for contact in contacts:
        mbs.SetObjectParameter(contact["oContact"], "forceUserFunction", 0)
    try:
        yield
    finally:
        for contact, function in zip(contacts, functions, strict=True):
            mbs.SetObjectParameter(contact["oContact"], "forceUserFunction", user_function(function) or 0)


def add_links(mbs: MainSystem, contact: PartitionContact, runs: Runs) -> None:
    """Add the stiffness of a contact across elements: with what carries a surface, and with contacts on its bodies.

    These objects have no force, which the contacts' own elements and loads have. Without them Newton's method does not
    converge where nothing else holds a carrier, or bodies between two contacts. A common element does without them.
    """
    if not contact.law.compliant:
        return
    if contact.carrier is not None and contact.carrier.nodes:
        _add_link(mbs, (contact, contact), runs)
    for other in contact.linked:
        if "oCommon" not in contact or "oCommon" not in other:
            _add_link(mbs, (contact, other), runs)


def _add_link(mbs: MainSystem, pair: tuple[PartitionContact, PartitionContact], runs: Runs) -> None:
    """Add an object with the stiffness between two contacts of a group, or between a contact and its own carrier."""
    exu = require("exudyn")
    nodes = [*{int(node): node for contact in pair for node in _moved_nodes(contact)}.values()]

    def jacobian(
        mbs: MainSystem, t: float, i: ItemIndex, q: Coordinates, q_t: Coordinates, fODE2: float, fODE2_t: float
    ) -> MatrixContainer:
        return exu.MatrixContainer(fODE2 * _stiffness_between(mbs, runs, [pair], nodes, t))

    _add_object(mbs, "", nodes, 0, jacobian)


def _moved_nodes(contact: PartitionContact) -> list[NodeIndex]:
    """Nodes of the bodies, and of what carries the rigid surface."""
    return contact.nodes + ([] if contact.carrier is None else contact.carrier.nodes)


def _stiffness_between(
    mbs: MainSystem,
    runs: Runs,
    pairs: Sequence[tuple[PartitionContact, PartitionContact]],
    nodes: Sequence[NodeIndex],
    t: float,
) -> sp.csr_matrix:
    """Stiffness of the closed rows of contacts by those of others, csr (n, n), on the coordinates of these nodes."""
    dofs = _dofs(mbs, nodes)
    place = {dof: k for k, dof in enumerate(dofs)}
    parts: list[tuple[Array, Array, Array]] = [(np.empty((0, 0)), *np.empty((2, 0), dtype=np.int64))]
    at_work = {id(contact): runs.advanced(mbs, t, contact) for pair in pairs for contact in pair}
    for run in at_work.values():
        run.update(mbs, t)
    for contact, other in pairs:
        first, last = at_work[id(contact)], at_work[id(other)]
        if not first.law.index.size or not last.law.index.size:
            continue
        (H, own), (H_last, others) = (_closed_rows(mbs, *end, place) for end in ((first, contact), (last, other)))
        K = H.T @ _between(first, last) @ H_last
        if first is last:  # its own element has that of the bodies
            K[: first.law.gaps.n, : first.law.gaps.n] = 0.0
        else:
            parts.append((H_last.T @ _between(last, first) @ H, others, own))
        parts.append((K, own, others))
    values = np.concatenate([K.ravel() for K, _, _ in parts])
    rows = np.concatenate([np.repeat(own, len(others)) for _, own, others in parts])
    columns = np.concatenate([np.tile(others, len(own)) for _, own, others in parts])
    return sp.csr_matrix((values, (rows, columns)), shape=(len(dofs),) * 2)


def _between(run: ContactRun, other: ContactRun) -> Array:
    """Forces on the closed rows of one contact by gaps of those of another, (na, nb) [N/m]."""
    if run.together is None:
        return run.law.row_stiffness()
    return run.together.stiffness(run.law, other.law)


def _closed_rows(
    mbs: MainSystem, run: ContactRun, contact: PartitionContact, place: dict[int, int]
) -> tuple[Array, Array]:
    """Closed rows on the coordinates of bodies and carrier, (na, m), and the place of each of these, (m,)."""
    law, carrier = run.law, contact.carrier
    H = run.row_jacobian()
    dofs = run.dofs.tolist()
    if carrier is not None and carrier.nodes:
        H = np.hstack([H, law.row_carrier() @ carrier.by_coordinates(mbs)])
        dofs += _dofs(mbs, carrier.nodes)
    return H, np.array([place[dof] for dof in dofs])


def _dofs(mbs: MainSystem, nodes: Sequence[NodeIndex]) -> list[int]:
    """Numbers of the nodes' coordinates in the model."""
    kind = require("exudyn").OutputVariableType.Coordinates
    starts = [(mbs.GetNodeODE2Index(node), np.size(mbs.GetNodeOutput(node, kind))) for node in nodes]
    return [dof for start, size in starts for dof in range(start, start + size)]


def _add_object(
    mbs: MainSystem,
    name: str,
    nodes: list[NodeIndex],
    force: Callable[..., Array | list[float]] | int,
    jacobian: Callable[..., MatrixContainer],
) -> ObjectIndex:
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
