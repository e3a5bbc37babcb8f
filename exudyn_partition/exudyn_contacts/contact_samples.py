"""Protocols of what results read: a contact, the samples of its sensors in a run, and its own data of the run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np

from ..algebra.friction import SLIP
from ..contact.formulations.formulation import Together
from ..contact.patch_contact import PatchContact
from ..exudyn_bodies.carriers import Carrier
from ..exudyn_bodies.model import Samples
from ..exudyn_bodies.other_bodies import OtherBody
from ..exudyn_bodies.partition_body import PartitionBody
from ..frames.kinematics import STILL
from ..results.history import at_times
from ..support.arrays import Array
from ..support.checks import validate_result
from ..support.foreign import MainSystem
from .contact_record import ContactRecord
from .kept_run import KeptRun


class RunSamples(Samples, Protocol):
    """Data of a run that a contact reads: samples of sensors, and the contacts' own data."""

    @property
    def runs(self) -> Sequence[ContactRecord | KeptRun]:
        """Data of the run that each contact kept; empty if nothing was kept."""

    @property
    def others(self) -> tuple[OtherBody, ...]:
        """Motion of Exudyn's own bodies that have a shape, or carry the rigid surface of a contact."""

    def kept(self, contact: Any) -> ContactRecord | KeptRun:
        """Data of the run that a contact kept."""

    def at(self, times: Array) -> RunSamples:
        """Return the samples nearest to some times, each sample once."""


class ModelContact(Protocol):
    """A contact of a model, as runs and results use it: `partition_contact.PartitionContact`.

    Attributes
    ----------
    name : str
    mechanics : PatchContact
        State at the start; each run has its own.
    sides : tuple of (PartitionBody, int)
        Slave, and master if that is a partition body too, each with the number of its patch.
    moment_about : (3,) array or None
        Point of the moment sensor [m].
    carrier : Carrier or None
        The body of another kind that carries the rigid surface.
    """

    name: str
    mechanics: PatchContact
    sides: tuple[tuple[PartitionBody, int], ...]
    moment_about: Array | None
    carrier: Carrier | None

    @property
    def group(self) -> Sequence[Any]:
        """Contacts that are solved together in every run, the same list for all of them."""

    @property
    def together(self) -> Together:
        """Finds the forces of this group; each run has its own."""

    def slices(self, mbs: MainSystem) -> list[slice]:
        """Places of the coordinates of slave and master among the model's."""

    def __getitem__(self, key: str, /) -> Any:
        """Exudyn's index of an item of the contact."""

    def __contains__(self, key: object, /) -> bool:
        """Whether the contact has such an item."""


def growing_at(sides: Sequence[tuple[PartitionBody, int]], result: Samples) -> Callable[[int], list[Array]]:
    """Return a function of a sample's number: by what products each side grows there, as for `Gaps.grow`."""
    rates = [item.coordinates_t(result) if item.frame == "floating" else None for item, _ in sides]

    def growing(sample: int) -> list[Array]:
        both = zip(sides, rates, strict=True)
        return [STILL if q_t is None else item.kinematics.growing(q_t[sample]) for (item, _), q_t in both]

    return growing


def mean_forces(contact: ModelContact, result: RunSamples, sensor: str, forces: slice, impulses: slice) -> Array:
    """Forces at the times of `result`, (n, k) [N], from columns of a sensor.

    Forces that are multipliers are means within steps. They are computed from the columns of the impulses so far.
    """
    validate_result(result)
    samples = result.sensor_of(contact, contact[sensor])
    if not contact.mechanics.ahead or len(result.t) < 2:
        return samples[:, forces]
    impulse = samples[:, impulses]
    means = np.diff(impulse, axis=0, prepend=impulse[:1]) / np.diff(result.t, prepend=-1.0)[:, None]
    return at_times(result.t, means)


def kept_rows(contact: ModelContact, result: RunSamples) -> list[tuple[int, Array, Array, Array, Array]]:
    """For each sample with closed rows: its number, nodes of the rows, normal and tangential forces, and states."""
    run, place = result.kept(contact), {t: i for i, t in enumerate(result.t)}
    by_sample = []
    for t, nodes, lam in run.samples:
        if t in place:
            none = np.zeros((len(nodes), 3)), np.full(len(nodes), SLIP, dtype=np.int8)
            by_sample.append((place[t], nodes, lam, *run.tangential.get(t, none)))
    return by_sample
