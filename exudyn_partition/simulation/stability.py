"""The largest stable step of explicit runs.

Theory: examples/site/theory.md, "The default step".
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ..contact.landings import stiffest_landing
from ..exudyn_bodies.held_damping import hold_damping
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.contact_pairs import is_skin
from ..exudyn_contacts.partition_contact import PartitionContact, partition_items
from ..reduction.body import ReducedBody
from ..support.arrays import Array, as_slice, consecutive
from ..support.foreign import MainSystem
from ..support.once import once
from .item_limits import DENSE, Group, HeldByItems, held_by_items, largest_eigenvalue, longest_step

_TRIES = 10  # of the limit of viscous contacts and dampers
_CLOSE = 1e-2  # relative change of the limit with which it is known


def stability_limit(mbs: MainSystem) -> float:
    """Largest stable step of central differences for the partition bodies with all contact rows closed [s].

    It is 2 / omega_max of K + H' F^-1 H and M, with the pairs and normals at the start. Contact through the residual
    flexibility of a skin may be anywhere: then each body lies on each of its six sides, see `contact.landings`. Damping
    of the bodies lowers the limit. This is computed by a bound that is exact if the highest mode has the largest
    damping. Springs, dampers and other items of Exudyn have their stiffness and damping of the initial state, if the
    model is assembled, see `item_limits`; bodies then move as joints allow. Multipliers of the lagrange formulation do
    not lower the limit. Viscous flexibilities of contacts do, see `contact.viscosity`. The mass of a body that carries
    a rigid surface is not included.

    Parameters
    ----------
    mbs : exudyn.MainSystem

    Returns
    -------
    float
        `math.inf` for a model without partition bodies, or if its bodies neither vibrate nor touch.
    """
    return StabilityLimits(mbs).whole


@dataclass(frozen=True, eq=False)
class StabilityLimits:
    """Largest stable steps of a model as it is, see `stability_limit`. What they have in common is found once.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    """

    mbs: MainSystem

    @cached_property
    def items(self) -> HeldByItems | None:
        """Motions of the model with the items of Exudyn that hold or damp it; None if there are none."""
        return held_by_items(self.mbs)

    @cached_property
    def _items_of_model(self) -> tuple[list[PartitionBody], list[PartitionContact]]:
        """Bodies and contacts of the model."""
        return partition_items(self.mbs)

    @cached_property
    def whole(self) -> float:
        """Limit with all contacts [s]."""
        hold_damping(self.mbs)
        return self.with_contacts(self._items_of_model[1])

    def with_contacts(self, contacts: list[PartitionContact]) -> float:
        """Return the limit with some of the model's contacts [s]."""
        bodies, _ = self._items_of_model
        if not bodies:
            return float("inf")
        items = self.items
        anywhere = [contact for contact in contacts if _may_be_anywhere(contact)]
        alone: list[Group] = []
        among_items: list[Group] = []
        for group in _joined(bodies, [contact for contact in contacts if contact not in anywhere]):
            (among_items if items is not None and items.hold(group[0]) else alone).append(group)

        def largest(step: float) -> float:
            squares = [0.0, *(_landing(contact, step) for contact in anywhere)]
            if items is not None:
                squares.append(items.largest_square(among_items, step))
            return max(*squares, *_largest_squares(alone, step))

        square = max(largest(math.inf), 0.0)
        omega = math.sqrt(square)
        rate = max((item.damping.largest_rate(omega) for item in bodies if item.damping is not None), default=0.0)
        limit = longest_step(omega, rate)
        if not any(contact.mechanics.viscous for contact in contacts) and not (items is not None and items.damped):
            return limit
        # Viscous contacts and dampers have omega^2 + 2 d / h instead of omega^2, where d hardly depends on h.
        for _ in range(_TRIES):
            tried = limit if math.isfinite(limit) else 1.0  # s: any step has the same d without a stiffness
            late = max(tried * (largest(tried) - square) / 2, 0.0)
            shorter = longest_step(omega, rate + late)
            if shorter > (1 - _CLOSE) * limit:
                break
            limit = shorter
        return min(limit, shorter)


def _largest_squares(groups: list[Group], step: float) -> Iterator[float]:
    """Largest squared circular frequency of each group of bodies and contacts; equal ones are found once."""
    equal = {}  # many bodies often have equal contacts
    for group in groups:
        if sum(item.body.n_dofs for item in group[0]) <= DENSE:
            matrix = _matrix(*group, step)
            equal[matrix.tobytes()] = matrix
        else:
            yield _by_iteration(*group, step)
    for matrix in equal.values():
        yield float(np.linalg.eigvalsh(matrix)[-1])


def _may_be_anywhere(contact: PartitionContact) -> bool:
    """Whether nobody knows which rows will close: a side is a skin, or both sides may meet anywhere."""
    mechanics = contact.mechanics
    skins = (is_skin(item.body, patch) for item, patch in contact.sides)
    return mechanics.gaps.anywhere or (mechanics.law.residual and any(skins))


def _landing(contact: PartitionContact, step: float) -> float:
    """Bound of the squared circular frequency of a body of a contact that may be anywhere, when it lies on a side.

    Viscous flexibilities are stiffer in short steps, see `PatchContact.closed_stiffness`.
    """
    sticks = contact.mechanics.friction is not None
    both = zip(contact.sides, contact.mechanics.gaps.sides, strict=False)
    return max(
        stiffest_landing(item.body, patch, sticks=sticks) * (1.0 + 2.0 * side.beta / step)
        for (item, patch), side in both
        if item.body.basis.flexibility is not None
    )


def _joined(
    bodies: list[PartitionBody], contacts: list[PartitionContact]
) -> list[tuple[list[PartitionBody], list[PartitionContact]]]:
    """Bodies that contacts join, directly or through others, with these contacts."""
    group: dict[PartitionBody, tuple[list[PartitionBody], list[PartitionContact]]] = {
        item: ([item], []) for item in bodies
    }
    for contact in contacts:
        small, large = sorted(
            (group[item] for item, _ in (contact.sides[0], contact.sides[-1])), key=lambda g: len(g[0])
        )
        if small[0][0] != large[0][0]:
            large[0].extend(small[0])
            large[1].extend(small[1])
            group |= dict.fromkeys(small[0], large)
        large[1].append(contact)
    return [*{id(each): each for each in group.values()}.values()]


def _closed(
    bodies: list[PartitionBody], contacts: list[PartitionContact], step: float
) -> Iterator[tuple[Array, Array]]:
    """Numbers of the coordinates that each contact joins, and its stiffness there, with all rows closed.

    In steps of this length [s], viscous flexibilities are stiff.
    """
    slices = consecutive([item.body.n_dofs for item in bodies])
    place = {item: np.arange(dofs.start, dofs.stop) for item, dofs in zip(bodies, slices, strict=True)}
    for contact in contacts:
        if (stiffness := contact.mechanics.closed_stiffness(step)) is not None:
            yield _on_coordinates(contact, stiffness, place)


@once
def _scale(body: ReducedBody) -> Array:
    """Factors by which coordinates have unit mass, (n,)."""
    return np.asarray(1 / np.sqrt(body.mass.diagonal()))


@once
def _stiffness(body: ReducedBody) -> Array:
    """Stiffness of a body, (n, n)."""
    return np.asarray(body.stiffness.toarray())


def _matrix(bodies: list[PartitionBody], contacts: list[PartitionContact], step: float) -> Array:
    """Stiffness of bodies with all rows closed, with the pairs at the start, on coordinates of unit mass, (n, n)."""
    scale = np.concatenate([_scale(item.body) for item in bodies])
    matrix = np.zeros((len(scale),) * 2)
    for item, place in zip(bodies, consecutive([item.body.n_dofs for item in bodies]), strict=True):
        matrix[place, place] = _stiffness(item.body)
    for dofs, stiffness in _closed(bodies, contacts, step):
        matrix[dofs[:, None], dofs] += stiffness
    value: Array = scale[:, None] * matrix * scale
    return value


def _by_iteration(bodies: list[PartitionBody], contacts: list[PartitionContact], step: float) -> float:
    """Largest squared frequency of many coordinates [rad2/s2], see `_matrix`."""
    scale = np.concatenate([_scale(item.body) for item in bodies])
    K = sp.block_diag([item.body.stiffness for item in bodies], format="csr")
    parts = [(as_slice(dofs), stiffness) for dofs, stiffness in _closed(bodies, contacts, step)]

    def apply(x: Array) -> Array:
        x = scale * x.ravel()
        y = K @ x
        for dofs, stiffness in parts:
            y[dofs] += stiffness @ x[dofs]
        value: Array = scale * y
        return value

    return largest_eigenvalue(apply, len(scale))


def _on_coordinates(
    contact: PartitionContact, stiffness: Array, place: Mapping[PartitionBody, Array]
) -> tuple[Array, Array]:
    """Numbers of the coordinates that a contact joins, each once, and its stiffness on the bodies' bases there.

    `stiffness`, (n, n), is that on the coordinates of its sides, one after the other. `place` has the numbers of each
    body's coordinates.
    """
    items = [item for item, _ in contact.sides]
    if not all(item.kinematics.linear for item in items):
        begins = np.cumsum([item.body.n_dofs for item in items])[:-1]

        def on_bases(rows: Array) -> Array:
            parts = zip(items, np.split(rows, begins), strict=True)
            return np.concatenate([item.kinematics.from_basis.T @ part for item, part in parts])

        stiffness = on_bases(on_bases(stiffness).T)  # symmetric
    if len({*map(id, items)}) < len(items):  # a body that touches itself has its numbers twice
        n = items[0].body.n_dofs
        stiffness = stiffness.reshape(2, n, 2, n).sum(axis=(0, 2))
        items = items[:1]
    return np.concatenate([place[item] for item in items]), stiffness
