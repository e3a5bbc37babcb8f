"""A model and the plans of its entries: what `run_many` and `sensitivity` compute with."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from ..contact.gaps import Gaps
from ..errors import StepSizeError
from ..exudyn_bodies.held_damping import hold_damping
from ..exudyn_bodies.model import dofs_of
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.partition_contact import PartitionContact, partition_items
from ..prediction.default_step import SAFETY
from ..simulation.compiled_plan import (
    at_start,
    contacts_by_group,
    initial_start,
    moving_contacts,
    read_plan,
    with_anchors,
)
from ..simulation.run_plan import RunOptions, RunTimes, plan_run
from ..simulation.stability import stability_limit
from ..support.arrays import Array
from ..support.foreign import MainSystem
from ..support.progress import Progress
from .variations import Entries, Variations


@dataclass(frozen=True, eq=False)
class VariedModel:
    """A model that `check_held` has passed, and the plans of its entries.

    Parameters
    ----------
    places : dict of PartitionBody to (n_dofs,) int array
        Numbers of the coordinates of each body.
    contacts : list of PartitionContact
        In the order of the plans.
    gaps : list of Gaps
        Of these contacts at the start.
    variations : Variations
    times : RunTimes
        Of all entries.
    entries : Entries
    """

    places: Mapping[PartitionBody, Array]
    contacts: Sequence[PartitionContact]
    gaps: Sequence[Gaps]
    variations: Variations
    times: RunTimes
    entries: Entries

    @classmethod
    def of(
        cls, mbs: MainSystem, end_time: float, step: float | None, variations: Variations, progress: Progress | None
    ) -> VariedModel:
        """Read a model.

        Raises
        ------
        StepSizeError
            If the step is above the stability limit of an entry.
        """
        bodies, contacts = partition_items(mbs)
        times = _times(mbs, end_time, step, bodies, variations, progress)
        hold_damping(mbs)
        groups, planned = at_start(contacts), [contact for group in contacts_by_group(contacts) for contact in group]
        places, gaps = {item: dofs_of(mbs, item) for item in bodies}, [one.gaps for _, some in groups for one in some]
        following = moving_contacts(mbs, groups)
        start = with_anchors(initial_start(mbs), following)
        entries = Entries(read_plan(mbs, groups), start, places, planned, groups, variations, following)
        return cls(places, planned, gaps, variations, times, entries)


def _times(
    mbs: MainSystem,
    end_time: float,
    step: float | None,
    bodies: Sequence[PartitionBody],
    variations: Variations,
    progress: Progress | None,
) -> RunTimes:
    """Times of all runs; they have the same steps."""
    plan = plan_run(mbs, RunOptions(end_time, start_time=0.0, step=step), None, progress)
    least, entry = min(zip(_limits(mbs, bodies, variations), range(variations.count), strict=True))
    if plan.times.step <= least:
        return plan.times
    if step is not None:
        raise StepSizeError(
            f"step: {step:.4g} s is above the stability limit of entry {entry}, {least:.4g} s (all contact rows "
            f"closed). Take at most {least:.3g} s, or leave it out"
        )
    return plan_run(mbs, RunOptions(end_time, start_time=0.0, step=SAFETY * least), None, progress).times


def _limits(mbs: MainSystem, bodies: Sequence[PartitionBody], variations: Variations) -> Iterator[float]:
    """A bound on the stability limit of each entry [s], from that of the model as it is, see `stability_limit`."""
    limit = stability_limit(mbs)
    if math.isinf(limit):
        yield from [limit] * variations.count
        return
    inverse = 4 / limit
    rate = max((0.0 if item.damping is None else item.damping.largest_rate(math.inf) for item in bodies), default=0.0)
    omega = math.sqrt(max(inverse * (inverse - 2 * rate), 0.0)) / 2
    for entry in range(variations.count):
        stiff = max(variations.factor(item, "E", entry) for item in bodies)
        light = min(variations.factor(item, "rho", entry) for item in bodies)
        faster = math.sqrt(stiff / light)
        rates = [max(1.0, faster) * rate]
        for item in bodies:
            if (ratio := variations.of(item, "damping", entry)) is not None:
                rates.append(faster * 2 * float((ratio * item.body.basis.omega[6:]).max(initial=0.0)))
        yield 4 / (max(rates) + math.hypot(max(rates), 2 * faster * omega))
