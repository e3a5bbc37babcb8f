"""Entries of `run_many` in the file of a study: a line for each, from which an interrupted call goes on."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from ..algebra.products import dense
from ..compiled.plan import StepPlan
from ..compiled.start import Start
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.partition_contact import PartitionContact
from ..support.archive import digest
from .points import Parameters, key_of
from .run_records import Record, RecordFile
from .varied_model import VariedModel

T = TypeVar("T", PartitionBody, PartitionContact)


class EntryFile:
    """A file that grows by an entry a line, see `RecordFile`.

    Parameters
    ----------
    path : Path
    model : VariedModel
    end_time : float
        [s]
    """

    def __init__(self, path: Path, model: VariedModel, end_time: float) -> None:
        self._model = model
        self._names = _names_of([*model.places], "body")
        self._contacts = _names_of(model.contacts, "contact")
        fixed = {"model": _digest(*model.entries.model), "end_time": end_time, "step": model.times.step}
        self._file = RecordFile(path, {"function": "exudyn_partition.run_many", "fixed": fixed})
        self._lock = threading.Lock()

    def known(self) -> dict[int, Record]:
        """Records of entries whose values the file holds; asked for once, before others are added."""
        records, self._file.known = self._file.known, {}  # what is not of these entries takes memory for nothing
        keys = (key_of(self._parameters(entry)) for entry in range(self._model.variations.count))
        return {entry: records[key] for entry, key in enumerate(keys) if "values" in records.get(key, {})}

    def add(self, entry: int, outcome: Record, wall_s: float) -> None:
        """Write an entry: its values or failure, and warnings."""
        record = {"parameters": self._parameters(entry), **outcome, "wall_s": wall_s}
        with self._lock:
            self._file.add([record])

    def close(self) -> None:
        """Let others write into it."""
        self._file.close()

    def _parameters(self, entry: int) -> Parameters:
        """What varies, by "body.name"."""
        return {
            f"{self._names[item]}.{name}": np.asarray(values[entry]).tolist()
            for item, of_body in self._model.variations.values.items()
            for name, values in of_body.items()
        } | {
            f"{self._contacts[contact]}.friction": float(values[entry])
            for contact, values in self._model.variations.friction.items()
        }


def _names_of(items: Sequence[T], kind: str) -> dict[T, str]:
    """Names of bodies or contacts; those that have none of their own are told by their place."""
    counts = Counter(item.name for item in items)
    return {
        item: item.name if item.name and counts[item.name] == 1 else f"{kind} {place}"
        for place, item in enumerate(items)
    }


def _digest(plan: StepPlan, start: Start) -> str:
    """Digest of a model as it is."""
    contacts = plan.contacts
    blocks = [*contacts.own, *contacts.fields, *contacts.core.values(), start.q, start.v]
    if (friction := contacts.friction) is not None:
        laws = [0.0 if law is None else (law.static, law.kinetic, law.decay or 0.0) for law in friction.laws]
        blocks += [*friction.rows, *friction.ways, friction.tangents, *friction.flexibilities, *map(np.array, laws)]
    if (moving := contacts.moving) is not None:
        blocks += [*moving.frames, *moving.surfaces]
        sides = [side for pair in (*moving.pairs, *moving.rubbing_pairs) for side in pair.gaps.sides]
        for side in sides:
            blocks += [side.surface.points, dense(side.kinematics.rows), np.asarray(side.flexibility)]
    whole = np.concatenate([np.ravel(part) for part in (*plan.bodies, *contacts.rows, *blocks)])
    return digest({"numbers": whole, "contacts": contacts.all_names})
