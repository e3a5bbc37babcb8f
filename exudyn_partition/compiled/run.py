"""An explicit run as a function: a plan, a start and times give histories."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..support.arrays import Array
from .loops import Peaks, Samples, Stepper, Stop
from .moving import Anchors
from .plan import StepPlan

_STEPS = 2000  # in one call; then progress is told, and the user may stop
_MOST = 1 << 22  # numbers of the forces on rows that a call keeps: 32 MB


@dataclass(frozen=True, eq=False)
class Start:
    """Where a run begins.

    Parameters
    ----------
    q, v : (nq,) arrays
        Coordinates and velocities.
    a : (nq,) array, optional
        Accelerations at the end of an earlier run, from which this one goes on. Default: those that forces give.
    turning : (nq,) array, optional
        Velocities by which bodies in floating frames grow at the start. Default: `v`.
    anchors : Anchors, optional
        Where moving contacts have found their flexibility. Default: nowhere.
    """

    q: Array
    v: Array
    a: Array | None = None
    turning: Array | None = None
    anchors: Anchors | None = None

    @property
    def parts(self) -> tuple[Array, Array, Array | None, Array | None, Anchors | None]:
        """All of it, as `Stepper.begin` takes it."""
        return self.q, self.v, self.a, self.turning, self.anchors


@dataclass(frozen=True)
class EqualSteps:
    """Steps of one length.

    Parameters
    ----------
    step : float
        [s]
    count : int
    between : int
        Steps from one sample to the next.
    """

    step: float
    count: int
    between: int = 1


@dataclass(frozen=True, eq=False)
class Histories:
    """What a run leaves.

    Parameters
    ----------
    q, v : (n, nq) arrays
        Samples of coordinates and velocities, with that of the start; n is 0 if they were not asked for.
    values : (n, nc, 6) array
        Samples of each contact, see `frozen.FrozenContacts`.
    stored : (n, nc) array
        Energy that each contact stores [J]; n is 0 if it was not asked for.
    lam : (n, nr) csr matrix or None
        Forces on all rows [N]; None if they were not asked for.
    start : Start
        State before the first step, with accelerations.
    end : Start
        State after the last whole step, with accelerations.
    end_stored : (nc,) array
        Energy that each contact stores there [J].
    peaks : Peaks
        Largest force of each contact.
    iterations : int
        Of the closed rows of all contacts.
    made : int
        Steps that were made.
    stopped : Stop or None
        What stopped the run before its end.
    """

    q: Array
    v: Array
    values: Array
    stored: Array
    lam: sp.csr_matrix | None
    start: Start
    end: Start
    end_stored: Array
    peaks: Peaks
    iterations: int
    made: int
    stopped: Stop | None


def run(
    plan: StepPlan,
    start: Start,
    steps: EqualSteps,
    *,
    motion: bool = True,
    rows: bool = True,
    report: Callable[[int], bool] | None = None,
    stepper: Stepper | None = None,
) -> Histories:
    """Run a plan. The same arguments give the same bits, whatever ran before.

    Parameters
    ----------
    plan : StepPlan
    start : Start
    steps : EqualSteps
    motion, rows : bool
        Whether samples of coordinates, and of forces on rows, are kept.
    report : callable, optional
        Called with the number of steps made, now and then; the run ends early if it returns False.
    stepper : Stepper, optional
        Room of an earlier run with the same contacts, to save time.

    Returns
    -------
    Histories
    """
    stepper, between, made = stepper or Stepper(plan.contacts, len(plan.bodies.mass)), steps.between, 0
    stopped = stepper.begin(plan, *start.parts)
    record = Record(plan, stepper, motion=motion, rows=rows)
    chunk = min(_STEPS, max(_MOST // max(len(plan.contacts.rows.start), 1), 1)) if rows else _STEPS
    while made < steps.count and not stopped:
        count, phase = min(chunk, steps.count - made), made % between
        samples = record.room((phase + count) // between)
        last, stopped = stepper.advance(steps.step, phase + 1, phase + count, between, samples)
        made += last - phase
        record.add(samples, last // between)
        if report is not None and not report(made):
            break
    return record.histories(made, stopped)


class Record:
    """Samples of a run that has begun, part by part.

    Parameters
    ----------
    plan : StepPlan
    stepper : Stepper
    motion, rows : bool
        See `run`.
    """

    def __init__(self, plan: StepPlan, stepper: Stepper, *, motion: bool = True, rows: bool = True) -> None:
        self._plan, self._stepper, self._motion, self._rows = plan, stepper, motion, rows
        self._start, self._kept, self._lams = stepper.state(), list[Samples](), list[sp.csr_matrix]()
        first = self.room(1)
        stepper.keep(first, 0)
        self.add(first, 1)

    def room(self, n: int) -> Samples:
        """Room for n samples."""
        return Samples.of(self._plan, n, motion=self._motion, rows=self._rows)

    def add(self, samples: Samples, n: int) -> None:
        """Add the first n samples."""
        self._kept.append(Samples(*(part[:n] for part in samples)))
        if self._rows:
            self._lams.append(sp.csr_matrix(self._kept[-1].lam))

    def histories(self, made: int, stopped: Stop | None) -> Histories:
        """All that was added; `made` is the number of steps, `stopped` what stopped them."""
        stepper = self._stepper
        q, v, values, stored = (np.concatenate(parts) for parts in [*zip(*self._kept, strict=True)][:4])
        return Histories(
            q, v, values, stored, sp.vstack(self._lams, format="csr") if self._rows else None,
            start=Start(*self._start), end=Start(*stepper.state(), *stepper.moving_state()),
            end_stored=stepper.stored.copy(), peaks=Peaks(*(part.copy() for part in stepper.peaks)),
            iterations=stepper.iterations, made=made, stopped=stopped,
        )  # fmt: skip
