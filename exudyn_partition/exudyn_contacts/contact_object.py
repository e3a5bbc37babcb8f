"""Exudyn adapter: the one object of a model that holds the forces and the stiffness of all its contacts."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence

import numpy as np
import scipy.sparse as sp

from ..algebra.friction import SLIP
from ..algebra.products import dense
from ..errors import ModelLimitWarning
from ..exudyn_bodies.model import check_contact_object, latest_solver, method_of, registered, user_function
from ..exudyn_bodies.rotation_vectors import turns
from ..exudyn_bodies.user_functions import sparse_container, terms
from ..frames.kinematics import Rows
from ..support.arrays import Array
from ..support.foreign import Coordinates, ItemIndex, MainSystem, MatrixContainer, NodeIndex, ObjectIndex
from ..support.optional import require
from ..support.warn import warn
from .contact_group import groups_of
from .contact_run import ContactRun
from .contact_samples import ModelContact
from .model_run import ModelRun, Runs
from .partition_contact import PartitionContact

_TOUCHING = 1e-3  # share of a facet's size: rows with smaller gaps touch
_ROUNDING = 1e-11  # share of a facet's size: rows that are no deeper are closed by rounding

Block = tuple[Rows, Array, Array]  # a part of a matrix, (k, l), and its rows, (k,), and columns, (l,)


def add_to_object(mbs: MainSystem, contact: PartitionContact, runs: Runs) -> ObjectIndex:
    """Add a new contact to the model's one object of contacts; returns the object's number.

    The object has no mass. Its nodes are those of all bodies in contact and of bodies that carry rigid surfaces. So
    Exudyn calls Python once for all forces, and the Jacobian has the stiffness between contacts on common bodies.
    Without this stiffness Newton's method does not converge where only contacts hold a carrier or a body.
    """
    runs.add_contact()
    registry = registered(mbs)
    nodes = {int(node): node for node in contact.nodes + carrying_nodes(contact)}
    earlier = next(iter(registry.contacts.values()), None)
    if earlier is None:
        registry.nodes_in_contact = nodes
        return _add_object(mbs, [*nodes.values()], runs)
    check_contact_object(mbs, registry)
    number: ObjectIndex = earlier["oContact"]
    if not registry.nodes_in_contact:
        registry.nodes_in_contact = {int(node): node for node in mbs.GetObjectParameter(number, "nodeNumbers")}
    if not nodes.keys() <= registry.nodes_in_contact.keys():
        registry.nodes_in_contact |= nodes
        mbs.SetObjectParameter(number, "nodeNumbers", [*registry.nodes_in_contact.values()])
    return number


def _add_object(mbs: MainSystem, nodes: list[NodeIndex], runs: Runs) -> ObjectIndex:
    """Add the object, whose user functions ask the present run for force and stiffness of all contacts."""
    items = require("exudyn.itemInterface")

    # Exudyn passes coordinates as lists. Reading the model's own array is quicker. Returning a list is quicker, too.
    def force(mbs: MainSystem, t: float, i: ItemIndex, q: Coordinates, q_t: Coordinates) -> list[float]:
        run = runs.now(mbs)
        total = run.settled_force(mbs, t)
        if total is None:
            return [0.0] * len(q)
        values: list[float] = total[run.of_object].tolist()
        return values

    def jacobian(
        mbs: MainSystem, t: float, i: ItemIndex, q: Coordinates, q_t: Coordinates, fODE2: float, fODE2_t: float
    ) -> MatrixContainer:
        run = runs.now(mbs)
        # At the end of a run rows slip as they did there.
        if not (run.over and run.ended_in(mbs.systemData.GetODE2Coordinates(copy=False))) and not run.knows(mbs, t):
            run.settled_force(mbs, t)
        contacts, given_up = run.contacts, run.unsettled is not None
        stuck = [contact for contact in contacts if given_up or _sticks(mbs, run.contact_run(contact))]
        blocks = [*_of_stuck(run, stuck, fODE2), *_of_groups(mbs, run, contacts, stuck, fODE2)]
        blocks += _of_damping(mbs, run, contacts, fODE2_t)
        if run.over:
            _warn_of_slips(run, contacts)
        if run.slip_secants is not None:
            blocks += _of_slips(mbs, run, contacts, run.slip_secants.share(mbs.sys["staticSolver"]) * fODE2)
        triplets = _assembled(blocks, run.dofs)
        if run.vectors and not run.over:
            n, turned = len(run.dofs), turns(mbs, run.vectors)[run.dofs][:, run.dofs]
            triplets = terms(sp.csr_matrix((triplets[2], triplets[:2]), shape=(n, n)) @ turned)
        return sparse_container(*triplets, len(run.dofs))

    return mbs.AddObject(
        items.ObjectGenericODE2(
            nodeNumbers=nodes,
            forceUserFunction=force,
            jacobianUserFunction=jacobian,
            visualization=items.VObjectGenericODE2(show=False),
        )
    )


@contextlib.contextmanager
def skip_needless_calls(mbs: MainSystem, run: ModelRun) -> Iterator[None]:
    """Keep Exudyn from calling the object in a run whose contacts all act ahead of steps.

    A call takes long, because Exudyn passes all coordinates.
    """
    contacts = run.contacts
    if run.acts_within or not contacts:
        yield
        return
    number, name = contacts[0]["oContact"], "forceUserFunction"
    function = user_function(mbs.GetObjectParameter(number, name))
    mbs.SetObjectParameter(number, name, 0)
    try:
        yield
    finally:
        mbs.SetObjectParameter(number, name, function)


def _assembled(blocks: Sequence[Block], dofs: Array) -> tuple[Array, Array, Array]:
    """Rows, columns and values of the sum of blocks on some coordinates; `dofs`, (n,), are their numbers."""
    place = np.zeros(dofs.max() + 1, dtype=np.int64)
    place[dofs] = np.arange(len(dofs))
    entries = [(np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64), np.empty(0))]
    for K, of_rows, of_columns in blocks:
        rows, columns, values = terms(K)
        entries.append((place[of_rows[rows]], place[of_columns[columns]], values))
    rows, columns, values = map(np.concatenate, zip(*entries, strict=True))
    return rows, columns, values


def _of_stuck(model: ModelRun, stuck: Sequence[ModelContact], by_q: float) -> Iterator[Block]:
    """Stiffness with all rows closed of contacts that stick, see `_sticks`, and between those solved together.

    Without the stiffness between them, a load on one would seem to open others of its bodies by a little.
    """
    for group in groups_of(stuck):
        runs = [model.contact_run(contact) for contact in group]
        places = [place for place, contact in enumerate(group) if contact in stuck]
        for (j, k), K in model.group_run(group[0]).closed_stiffness(places).items():
            yield by_q * K, runs[j].dofs, runs[k].dofs


def _sticks(mbs: MainSystem, run: ContactRun) -> bool:
    """Whether all rows count as closed: those of a contact that just touches, in the first iteration of a load step.

    An open contact has no stiffness, and one in which rounding has closed some rows has too little. Then a block that
    only stands on another one would have no equilibrium under its load.
    """
    mechanics = run.mechanics
    size = mechanics.gaps.size
    gap = run.evaluation.least_gap - mechanics.reach
    if not (mechanics.compliant and -_ROUNDING * size <= gap < _TOUCHING * size):
        return False
    solver = latest_solver(mbs)
    return solver is not None and method_of(solver) == "static" and solver.it.newtonSteps == 1


def _of_groups(
    mbs: MainSystem,
    model: ModelRun,
    contacts: Sequence[ModelContact],
    stuck: Sequence[ModelContact],
    by_q: float,
) -> Iterator[Block]:
    """Stiffness of contacts, between those that are solved together, and between contacts and carriers of surfaces.

    Those that are `stuck` are left out.
    """
    for group in groups_of(contacts):
        runs = [model.contact_run(contact) for contact in group]
        acting = [place for place, contact in enumerate(group) if contact not in stuck]
        closed = {
            place: _closed_rows(mbs, runs[place], group[place])
            for place in acting
            if group[place].mechanics.compliant and runs[place].evaluation.index.size
        }
        for place in acting:
            mechanics, dofs = runs[place].mechanics, runs[place].dofs
            if mechanics.zones is not None and place not in closed:
                yield by_q * mechanics.corrected(np.zeros((len(dofs),) * 2)), dofs, dofs
        for (j, k), K in model.group_run(group[0]).stiffness({j: H for j, (H, _) in closed.items()}).items():
            if j == k:
                of_bodies = np.s_[: len(runs[j].dofs)]
                K[of_bodies, of_bodies] = runs[j].mechanics.corrected(K[of_bodies, of_bodies])
            yield by_q * K, closed[j][1], closed[k][1]


def _of_damping(mbs: MainSystem, model: ModelRun, contacts: Sequence[ModelContact], by_q_t: float) -> Iterator[Block]:
    """Damping of contacts whose laws depend on rates, on the coordinates of bodies and carrier."""
    for contact in contacts if by_q_t else ():  # zero in statics
        run = model.contact_run(contact)
        if run.mechanics.law.elastic or (C := run.evaluation.damping()) is None:
            continue
        H, dofs = _closed_rows(mbs, run, contact)
        yield by_q_t * (H.T @ C @ H), dofs, dofs


def _warn_of_slips(model: ModelRun, contacts: Sequence[ModelContact]) -> None:
    """Warn that rows slip, so that the stiffness that is asked for after a run is not symmetric."""
    answers = {
        contact.name: model.contact_run(contact).evaluation for contact in contacts if contact.mechanics.friction
    }
    slip = [name for name, answer in answers.items() if (answer.status == SLIP).any()]
    if slip:
        warn(
            f"contact {', '.join(map(repr, slip))}: rows slip, so that the stiffness is not symmetric. Exudyn's "
            "ComputeODE2Eigenvalues reads half of it: its frequencies are wrong. Take natural_modes(mbs), or "
            "computeComplexEigenvalues=True",
            ModelLimitWarning,
        )


def _of_slips(mbs: MainSystem, model: ModelRun, contacts: Sequence[ModelContact], by_q: float) -> Iterator[Block]:
    """Stiffness along slips, see `SlipSecants`."""
    for contact in contacts:
        run = model.contact_run(contact)
        if run.mechanics.friction is not None and run.evaluation.index.size:
            H, dofs = _closed_rows(mbs, run, contact)
            yield by_q * run.evaluation.slip_secants(H), dofs, dofs


def _closed_rows(mbs: MainSystem, run: ContactRun, contact: ModelContact) -> tuple[Array, Array]:
    """Closed rows on the coordinates of bodies and carrier, (na, m), and numbers of these in the model, (m,)."""
    H, nodes = dense(run.evaluation.row_jacobian()), carrying_nodes(contact)
    if contact.carrier is None or not nodes:
        return H, run.dofs
    H = np.hstack([H, run.evaluation.row_carrier() @ contact.carrier.by_coordinates(mbs)])
    return H, np.concatenate([run.dofs, *(mbs.systemData.GetNodeLTGODE2(node) for node in nodes)])


def carrying_nodes(contact: ModelContact) -> list[NodeIndex]:
    """Nodes of the body that carries the rigid surface."""
    return [] if contact.carrier is None else contact.carrier.nodes
