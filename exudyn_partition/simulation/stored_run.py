"""Results of runs as files: what the sensors told, and of which model, so that another process can go on with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..errors import InputError
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.contact_results import ContactResults
from ..support.archive import Format, digest
from ..support.arrays import Array
from ..support.checks import read_only
from .work import Work


@dataclass(frozen=True, eq=False)
class StoredRun:
    """Fields of a `Result` that are no items of a model.

    Parameters
    ----------
    t : (n,) array
        [s]
    status, message : str
    step : float
        [s]
    steps : int
    method : str
    time_s : float
        [s]
    work : Work
    numbers, seldom : (k,) int arrays
        Of the sensors.
    samples : tuple of (n, m) arrays
        Of each sensor in `numbers`.
    items : tuple of str
        What each body and contact of the model was, see `described`.

    Raises
    ------
    InputError
        If the samples do not fit the times or the sensors.
    """

    t: Array
    status: str
    message: str
    step: float
    steps: int
    method: str
    time_s: float
    work: Work
    numbers: Array
    seldom: Array
    samples: tuple[Array, ...]
    items: tuple[str, ...]

    def __post_init__(self) -> None:
        read_only(self.t, self.numbers, self.seldom, *self.samples)
        if len(self.numbers) != len(self.samples) or any(len(data) != len(self.t) for data in self.samples):
            raise InputError(f"samples: expected {len(self.numbers)} sensors with {len(self.t)} times each")


FILE = Format(
    name="result",
    version=2,
    units="SI (m, kg, s, N, rad), or the consistent units that the model was made in",
    classes=(StoredRun, Work),
)


def described(bodies: Sequence[PartitionBody], contacts: Sequence[ContactResults]) -> tuple[str, ...]:
    """What the items of a model are: names, frames, contents of the reduced bodies, laws, and numbers of sensors.

    A run knows nothing of the inside of bodies: one of bodies that were saved without it can be read with whole ones.
    Nor does it know what they bear before they yield.
    """
    said = [
        f"body {item.name!r}, {item.frame} frame at {item.position.tolist()}, sensors "
        f"{[*map(int, item['sCoordinates']), *map(int, item['sCoordinates_t'])]}, "
        f"content {digest(replace(item.body.without_inside(), material=None, fingerprint=None))}"
        for item in bodies
    ]
    said += [
        f"contact {contact.name!r} of {[(item.name, patch) for item, patch in contact.sides]}, "
        f"{type(contact.law).__name__}, sensor {int(contact['sForce'])}"
        for contact in contacts
    ]
    return tuple(said)


def check_items(stored: Sequence[str], found: Sequence[str]) -> None:
    """Refuse a model that is not the one of a stored run.

    Raises
    ------
    InputError
        Naming the first item that differs.
    """
    for i in range(max(len(stored), len(found))):
        was, is_now = (items[i] if i < len(items) else "nothing" for items in (stored, found))
        if was != is_now:
            raise InputError(
                f"mbs: expected the model that was run, built by the same calls in the same order, with {was}; this "
                f"one has {is_now}"
            )
