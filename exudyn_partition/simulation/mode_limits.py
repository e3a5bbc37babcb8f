"""Natural modes that contacts make wrong: bodies that turn over single rows, or in frames that know no large turns.

A constant force f at X from a body's centre of mass moves by r x (r x X) / 2 as the body turns by r. The work on this
way is a stiffness, -N |X| against a tilt over the row below a body that weighs N. Frames that know small turns alone
lack it. Contacts by rows have it for each row, and the rows that close instead of others as a round body rolls come
too late: over one row it would fall like a pencil.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from ..errors import ModelLimitWarning
from ..exudyn_bodies.model import coordinate_slices
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.model_run import ModelRun
from ..exudyn_contacts.partition_contact import PartitionContact
from ..frames.inertial import InertialKinematics
from ..support.arrays import Array
from ..support.foreign import MainSystem
from ..support.warn import warn
from .result import called

_FALL = 0.05  # share of the frequency of a fall over one row below which an unstable motion may be round-off
_CHANGE = 0.1  # share of a squared frequency by which large turns may change it
_LEAST = 1e-3  # share of the squared rate of a fall: changes below it are round-off


class PressedBody(NamedTuple):
    """A body with a closed contact: its coordinates in the model, (n,) int, and what the contact's force does to turns.

    `lever`, (3,) [m], goes from its centre of mass to the middle of the patch. `force`, (3,) [N], is that of the
    contact along its first three rigid motions. `fall` is the frequency [Hz] by which the body would fall over, if the
    normal force acted on one row.
    """

    contact: PartitionContact
    item: PartitionBody
    dofs: Array
    lever: Array
    force: Array
    fall: float


def pressed_bodies(mbs: MainSystem, run: ModelRun, contacts: Iterable[PartitionContact]) -> Iterator[PressedBody]:
    """Bodies with contacts that are closed in the state that these were evaluated in."""
    for contact in contacts:
        member = run.contact_run(contact)
        normal, start = abs(member.normal_force), 0
        for item, number in contact.sides if normal else ():
            body = item.body
            dofs = np.concatenate([np.arange(s.start, s.stop) for s in coordinate_slices(mbs, item)])
            on_body = member.evaluation.generalised[start : start + len(dofs)]
            start += len(dofs)
            lever = body.points[body.partition.patches[number].nodes].mean(axis=0) - body.centre_of_mass
            least = np.linalg.eigvalsh(body.inertia.tensor)[0]
            fall = np.sqrt(normal * np.linalg.norm(lever) / least) / (2 * np.pi)
            yield PressedBody(contact, item, dofs, lever, body.rigid[:, :3].T @ on_body, float(fall))


def warn_of_turns(pressed: Iterable[PressedBody], frequencies: Array, modes: Array) -> None:
    """Warn of frequencies, (k,) [Hz], that turns of pressed bodies make wrong, with modes, (nq, k), of unit mass."""
    told = set()
    for found in pressed:
        fixed = isinstance(found.item.kinematics, InertialKinematics)
        text = _in_fixed_frame(found, frequencies, modes) if fixed else _over_rows(found, frequencies)
        if text and text not in told:
            told.add(text)
            warn(text, ModelLimitWarning)


def _over_rows(found: PressedBody, frequencies: Array) -> str:
    """What to tell of a body that falls over the rows of a contact; empty if it does not."""
    if found.contact.rows == "spot" or frequencies[0] > -_FALL * found.fall:
        return ""
    return (
        f"contact {found.contact.name!r}: a motion is unstable, at {frequencies[0]:.3g} Hz. A round body does that by "
        f"rows of facets where it would roll, {called(found.item)} down to some {-found.fall:.3g} Hz. Take "
        f"formulation='hertz', or use frequencies above {found.fall:.3g} Hz alone. Bodies on a tip or an edge do fall"
    )


def _in_fixed_frame(found: PressedBody, frequencies: Array, modes: Array) -> str:
    """What to tell of a body in an inertial frame whose modes need its true turns; empty if none does."""
    body, f, X = found.item.body, found.force, found.lever
    momenta = body.rigid[:, 3:].T @ (body.mass @ modes[found.dofs])
    turns = np.linalg.solve(body.inertia.tensor, momenta)
    change = abs((f @ turns) * (X @ turns) - (f @ X) * np.sum(turns**2, axis=0)) / (2 * np.pi) ** 2
    wrong = (change > _CHANGE * frequencies**2) & (change > _LEAST * found.fall**2)
    if not wrong.any():
        return ""
    some = ", ".join(f"{frequency:.3g}" for frequency in frequencies[wrong][:3])
    return (
        f"{called(found.item)} has an inertial frame, which knows small turns alone. The force of contact "
        f"{found.contact.name!r} acts on its turns so much that frequencies such as {some} Hz may be wrong. Take "
        "frame='floating'"
    )
