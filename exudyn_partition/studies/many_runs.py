"""Many runs of one model with other velocities, places, loads, damping and materials, by compiled steps."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..algebra.blas_threads import one_blas_thread
from ..compiled.loops import Stepper
from ..compiled.run import EqualSteps, Histories, run
from ..errors import InputError, MemoryLimitError
from ..exudyn_bodies.model import validate_model
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.partition_contact import PartitionContact, partition_items
from ..simulation.compiled_limits import check_held
from ..support.arrays import Array
from ..support.checks import read_only, validate_integer, validate_path
from ..support.foreign import MainSystem
from ..support.interrupt import Interrupt, interruptible
from ..support.machine import available_memory
from ..support.progress import LONG, Progress
from ..support.progress import progress as progress_bar
from ..support.spelling import spelled
from .entry_file import EntryFile
from .entry_notes import Moments, Note, Notes, tell
from .measures import Measures, flies_on
from .run_records import Record
from .variations import Variations, Vary
from .varied_model import VariedModel

HISTORIES = ("force", "coordinates")
OF_CONTACTS = "peak", "impulse", "duration", "counts", "restitution", "stored", "dissipated"
_MOST = 0.5  # share of the free memory that histories may take


@dataclass(frozen=True, eq=False)
class ManyRuns:
    """Results of `run_many`: B entries of nc contacts and nb bodies. Values of entries that failed are nan.

    Parameters
    ----------
    t : (n,) array
        Times of all entries [s].
    contacts : tuple of PartitionContact
    bodies : tuple of PartitionBody
    ends : (B,) array
        Time at which each entry ended [s]. It is less than that of the others if pairs began to slide while bodies flew
        apart after contact: what follows is free flight, or a later contact, which is not computed. Histories are nan
        then.
    peak : (B, nc) array
        Largest sum of the normal forces [N].
    impulse : (B, nc) array
        Its integral over time [N s].
    duration : (B, nc) array
        Time in contact: while the smallest gap of the rows is negative, by a line between steps [s].
    counts : (B, nc) array
        Number of times of contact.
    restitution : (B, nc) array
        Speed of separation at the end of the entry over that of approach at its start, of rigid bodies with the same
        momenta, along the impulse of the normal forces, at the centre of the largest force. The arm from there to a
        body's centre of mass is that at the largest force. It is nan without contact.
    energy : (B, 2, nb) array
        Kinetic and strain energy of each body at start and end [J].
    stored : (B, nc) array
        Energy that contacts store at the end [J].
    dissipated : (B, nc) array
        Energy that friction has taken by then [J].
    momentum : (B, 2, nb, 3) array
        Linear momentum of each body at start and end [N s].
    force : (B, nc, n) array or None
        Sum of the normal forces at all times [N], if it was asked for.
    q, q_t : (B, n, nq) arrays or None
        Coordinates of the model and their velocities, if they were asked for.
    failures : dict of int to str
        Causes, by the numbers of the entries.
    warnings : dict of int to tuple of str
        What was found after runs, by the numbers of the entries, see `run_many`.
    """

    t: Array
    contacts: tuple[PartitionContact, ...]
    bodies: tuple[PartitionBody, ...]
    ends: Array
    peak: Array
    impulse: Array
    duration: Array
    counts: Array
    restitution: Array
    energy: Array
    stored: Array
    dissipated: Array
    momentum: Array
    force: Array | None
    q: Array | None
    q_t: Array | None
    failures: Mapping[int, str]
    warnings: Mapping[int, tuple[str, ...]]

    def __post_init__(self) -> None:
        read_only(*(value for value in vars(self).values() if isinstance(value, np.ndarray)))

    def __len__(self) -> int:
        return len(self.peak)

    def __repr__(self) -> str:
        failed = f", {len(self.failures)} failed" if self.failures else ""
        return f"ManyRuns({len(self)} runs of {len(self.t) - 1} steps{failed})"


@spelled
def run_many(
    mbs: MainSystem,
    *,
    end_time: float,
    vary: Vary,
    step: float | None = None,
    histories: Collection[str] = (),
    file: str | Path | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> ManyRuns:
    """Run an assembled model many times by compiled steps, each time with other values.

    The steps are those of `solve_dynamic(..., solver="compiled")`, and hold the same models. An entry has the same bits
    whatever the other entries are, and however many threads there are. The model and its last run do not change.

    Parameters
    ----------
    mbs : exudyn.MainSystem
        The model, assembled.
    end_time : float
        Time at which all runs end [s]; they begin at zero.
    vary : dict of PartitionBody or PartitionContact to dict of str to array
        For each body, arrays of B values by name; what is not there is as in the model:

        - "initialVelocity", "initialAngularVelocity", (B, 3) [m/s, rad/s]: as of `CreatePartitionBody`;
        - "referencePosition", (B, 3) [m]: the body is moved there as a rigid one; pairs stay those of the model;
        - "gravity", (B, 3) [m/s2];
        - "damping", (B,) or (B, k): ratio of all modes, or of each of the k elastic modes;
        - "E", "rho", (B,) [Pa, kg/m3]: of the body's one material, without a new reduction. Shapes stay, stiffness goes
          with E, mass with rho, the contact's flexibility with 1 / E, and ratios of damping stay. Not of bodies in
          floating frames, or whose rows follow facets of another body.

        For a contact that has friction, "friction", (B,): the coefficient, the same in stick and slip.
    step : float, optional
        Time step of all runs [s]. Default: that of `solve_dynamic` for the model as it is, or 0.9 of the smallest
        stability limit of the entries, if that is less.
    histories : collection of {"force", "coordinates"}
        What is kept of all steps.
    file : path, optional
        Of JSON lines, as of `study`. Entries are added as they end, and those that it holds are not run again, also
        after the process was killed; failures are. It must be of the same model, end and step, and has no histories.
    workers : int
        Number of threads.
    progress : callable, optional
        Called with the share done, 0 to 1. Default: a bar on the terminal, if it takes long.

    Returns
    -------
    ManyRuns
        At Ctrl-C with the entries so far; the others have failed.

    Raises
    ------
    CompiledRunError
        If compiled runs cannot hold the model; the message lists all reasons.
    InputError
        If an argument is wrong, or `file` is of another model, or in use.
    OutputError
        If `file` cannot be written.
    StepSizeError
        If the step is above the stability limit of an entry.
    MemoryLimitError
        If the histories would take more than half of the free memory.

    Warns
    -----
    ContactPatchWarning, ModelLimitWarning, YieldWarning
        Once for each finding, with how many runs have it. Of contacts: edge of a patch, overlap at the start, depth,
        few closed rows, a force off the line of contact, and yield, unless E varies. Of bodies: rotation, also before
        they hit, turns in a step, and deformation, as they are at the start, after each 2000 steps, at the largest
        forces, and at the end. And energy that comes from nothing. What else `solve_dynamic` looks for is not asked:
        run an entry by itself.
        A contact that never closes has `counts` of zero.
    """
    validate_model(mbs)
    check_held(mbs)
    kept = _validated(histories)
    workers = validate_integer("workers", workers, least=1)
    bodies, contacts = partition_items(mbs)
    model = VariedModel.of(mbs, end_time, step, Variations.checked(vary, bodies, contacts), progress)
    room = _Room.of(model.variations.count, model, bodies, contacts, kept)
    measures = Measures(model.places, model.contacts, model.gaps, model.variations, room.t)
    with contextlib.ExitStack() as stack:
        lines = None
        if file is not None:
            lines = EntryFile(_for_entries(file, kept), model, end_time)
            stack.callback(lines.close)
        bar = progress_bar("many runs", after=LONG) if progress is None else contextlib.nullcontext(progress)
        interrupt, report = stack.enter_context(interruptible()), stack.enter_context(bar)
        stack.enter_context(one_blas_thread())
        _run_all(model, room, measures, lines, workers, report, interrupt)
    tell(room.notes, len(room.ends))
    return room.result(bodies, contacts)


def _for_entries(file: str | Path, histories: Collection[str]) -> Path:
    """Path of a file of entries."""
    if histories:
        raise InputError(f"histories: expected none with file=, which holds no histories, got {', '.join(histories)}")
    return validate_path("file", file)


def _validated(histories: object) -> tuple[str, ...]:
    if isinstance(histories, str) or not isinstance(histories, Collection) or not {*histories} <= {*HISTORIES}:
        raise InputError(f"histories: expected a collection of {', '.join(map(repr, HISTORIES))}, got {histories!r}")
    return tuple(histories)


@dataclass(frozen=True, eq=False)
class _Room:
    """Room for all results; nan until an entry has run."""

    t: Array
    of_contacts: dict[str, Array]
    ends: Array
    energy: Array
    momentum: Array
    force: Array | None
    q: Array | None
    q_t: Array | None
    failures: dict[int, str]
    notes: dict[int, list[Note]]

    order: Sequence[int]

    @classmethod
    def of(
        cls,
        count: int,
        model: VariedModel,
        bodies: Sequence[PartitionBody],
        contacts: Sequence[PartitionContact],
        kept: Collection[str],
    ) -> _Room:
        """Room for the results of `count` runs, all nan; `kept` names histories that are kept too.

        Raises
        ------
        MemoryLimitError
            If these take more than a part of the free memory.
        """
        times, nq = model.times, model.entries.size
        n, nc, nb = times.steps + 1, len(contacts), len(bodies)
        needed = 8 * count * n * (nc * ("force" in kept) + 2 * nq * ("coordinates" in kept))
        if needed > _MOST * available_memory()[0]:
            raise MemoryLimitError(
                f"histories: {count} runs of {n} times take {needed / 2**30:.3g} GiB, more than half of the free "
                "memory; run fewer entries at a time, or keep less"
            )

        def empty(*shape: int) -> Array:
            return np.full((count, *shape), np.nan)

        return cls(
            t=np.cumsum(np.r_[0.0, np.full(times.steps, times.step)]),
            of_contacts={name: empty(nc) for name in OF_CONTACTS},
            ends=empty(),
            energy=empty(2, nb),
            momentum=empty(2, nb, 3),
            force=empty(nc, n) if "force" in kept else None,
            q=empty(n, nq) if "coordinates" in kept else None,
            q_t=empty(n, nq) if "coordinates" in kept else None,
            failures={},
            notes={},
            order=[model.contacts.index(contact) for contact in contacts],
        )

    def write(self, entry: int, made: Histories, measured: tuple[dict[str, Array], Array, Array]) -> None:
        """Write the results of an entry, with what `Measures` has found."""
        n = made.made + 1
        self.ends[entry] = self.t[n - 1]
        of_contacts, self.energy[entry], self.momentum[entry] = measured
        for name, values in of_contacts.items():
            self.of_contacts[name][entry] = values[self.order]
        if self.force is not None:
            self.force[entry, :, :n] = made.values[:, self.order, 0].T
        if self.q is not None and self.q_t is not None:
            self.q[entry, :n], self.q_t[entry, :n] = made.q, made.v

    def outcome(self, entry: int) -> Record:
        """Results of an entry as plain values, or its failure; see `write_plain`."""
        if entry in self.failures:
            return {"error": "StoppedRun", "message": self.failures[entry], "traceback": "", "warnings": []}
        arrays = {"ends": self.ends, **self.of_contacts, "energy": self.energy, "momentum": self.momentum}
        values = {name: array[entry].tolist() for name, array in arrays.items()}
        return {"values": values, "warnings": self.notes.get(entry, [])}

    def write_plain(self, entry: int, record: Record) -> None:
        """Write results of an entry that were plain values."""
        values = record["values"]
        if record["warnings"]:
            self.notes[entry] = [Note(*note) for note in record["warnings"]]
        self.ends[entry], self.energy[entry], self.momentum[entry] = (values[k] for k in ("ends", "energy", "momentum"))
        for name, array in self.of_contacts.items():
            array[entry] = values[name]

    def result(self, bodies: Sequence[PartitionBody], contacts: Sequence[PartitionContact]) -> ManyRuns:
        """What the user gets."""
        return ManyRuns(
            t=self.t, contacts=tuple(contacts), bodies=tuple(bodies), ends=self.ends, energy=self.energy,
            momentum=self.momentum, force=self.force, q=self.q, q_t=self.q_t,
            failures=dict(sorted(self.failures.items())),
            warnings={entry: tuple(note.text for note in notes) for entry, notes in sorted(self.notes.items())},
            **self.of_contacts,
        )  # fmt: skip


def _run_all(
    model: VariedModel,
    room: _Room,
    measures: Measures,
    lines: EntryFile | None,
    workers: int,
    report: Progress,
    interrupt: Interrupt,
) -> None:
    """Run all entries that are not in the file, and write their results."""
    entries, count = model.entries, model.variations.count
    steps = EqualSteps(model.times.step, model.times.steps)
    known = {} if lines is None else lines.known()
    for entry, record in known.items():
        room.write_plain(entry, record)
    missing, done = [entry for entry in range(count) if entry not in known], len(known)
    known.clear()
    notes = Notes(model.places, model.contacts, model.gaps, measures.rows, model.variations, model.times.step)
    looking = threading.Lock()  # bodies and contacts keep what they have found

    def run_some(some: Sequence[int]) -> None:
        nonlocal done
        key, stepper = None, None
        for entry in some:
            if interrupt.asked:
                room.failures[entry] = "interrupted by the user"
                continue
            begin = time.perf_counter()
            if stepper is None or entries.flexibility_key(entry) != key:
                key, contacts = entries.flexibility_key(entry), entries.contacts(entry)
                stepper = Stepper(contacts, entries.size)
            plan, start = entries.plan(entry, stepper.contacts), entries.start(entry)
            moments, kept = Moments(stepper.motion), {"motion": room.q is not None, "rows": False}
            made = run(plan, start, steps, **kept, stepper=stepper, report=moments.look)
            if made.stopped and not flies_on(made):
                room.failures[entry] = f"stopped after {made.made} steps: {made.stopped.text}"
            else:
                peaks = measures.at_peaks(made)
                room.write(entry, made, measures.of(entry, plan.bodies, made, peaks))
                with looking:
                    found = notes.of(plan, made, moments, peaks, room.energy[entry])
                if found:
                    room.notes[entry] = found
            if lines is not None:
                lines.add(entry, room.outcome(entry), time.perf_counter() - begin)
            done += 1
            report(min(done / count, 1.0))

    if workers == 1:
        run_some(missing)
        return
    parts = [part.tolist() for part in np.array_split(np.array(missing, dtype=int), max(min(workers, len(missing)), 1))]
    with ThreadPoolExecutor(workers) as pool:
        for _ in pool.map(run_some, parts):
            pass
