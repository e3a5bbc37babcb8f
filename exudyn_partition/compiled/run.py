"""An explicit run as a function: a plan, a start and times give histories."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from ..support.arrays import Array
from .loops import Peaks, Samples, Stepper, Stop
from .plan import StepPlan
from .start import Start

_STEPS = 2000  # in one call; then progress is told, and the user may stop
_MOST = 1 << 22  # numbers of the forces on rows that a call keeps: 32 MB


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
    q, v, a : (n, nq) arrays
        Samples of coordinates, velocities and accelerations, with that of the start; n is 0 if they were not asked for.
    values : (n, nc, 6) array
        Samples of each contact, see `frozen.FrozenContacts`.
    stored : (n, nc) array
        Energy that each contact stores [J]; n is 0 if it was not asked for.
    lam : (n, nr) csr matrix or None
        Normal forces on all rows [N]; None if they were not asked for.
    friction : (n, nf, 7) array
        Samples of each contact with friction, see `loops.Samples`.
    traction, status : (n, 3 k), (n, k) csr matrices or None
        Tangential forces on the rows of these contacts, and states, see there; None if they were not asked for.
    fresh : (n, ns) bool array
        See `loops.Samples`.
    start : Start
        State before the first step, with accelerations.
    end : Start
        State after the last whole step, with accelerations.
    start_stored : (nc,) array
        Energy that each contact stores at the start [J].
    end_values, end_stored : (nc, 6), (nc,) arrays
        Values of each contact at the end, and the energy that it stores [J].
    peaks : Peaks
        Largest force of each contact.
    left : dict of int to (nq,) array
        Coordinates of the first sample in which closed rows leave their patch, by the numbers of contacts of two bodies
        whose rows follow facets.
    iterations : int
        Of the closed rows of all contacts.
    made : int
        Steps that were made.
    stopped : Stop or None
        What stopped the run before its end.
    """

    q: Array
    v: Array
    a: Array
    values: Array
    stored: Array
    lam: sp.csr_matrix | None
    friction: Array
    traction: sp.csr_matrix | None
    status: sp.csr_matrix | None
    fresh: Array
    start: Start
    end: Start
    start_stored: Array
    end_values: Array
    end_stored: Array
    peaks: Peaks
    left: dict[int, Array]
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
    earlier: int = 0,
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
    earlier : int
        Steps of `steps` that were made before the start, by another plan.

    Returns
    -------
    Histories
    """
    stepper, between, made = stepper or Stepper(plan.contacts, len(plan.bodies.mass)), steps.between, earlier
    stopped = stepper.begin(plan, start)
    record = Record(plan, stepper, motion=motion, rows=rows)
    chunk = min(_STEPS, max(_MOST // max(plan.contacts.n_rows, 1), 1)) if rows else _STEPS
    while made < steps.count and not stopped:
        count, phase = min(chunk, steps.count - made), made % between
        samples = record.room((phase + count) // between)
        last, stopped = stepper.advance(steps.step, phase + 1, phase + count, between, samples)
        made += last - phase
        record.add(samples, last // between)
        if report is not None and not report(made):
            break
    return record.histories(made - earlier, stopped)


def without_start(made: Histories) -> Histories:
    """Return a run without the sample of its start, for it goes on from another one."""
    lam, traction, status = (None if part is None else part[1:] for part in (made.lam, made.traction, made.status))
    return replace(
        made, q=made.q[1:], v=made.v[1:], a=made.a[1:], values=made.values[1:], stored=made.stored[1:],
        friction=made.friction[1:], lam=lam, traction=traction, status=status, fresh=made.fresh[1:],
    )  # fmt: skip


def joined(first: Histories, later: Histories) -> Histories:
    """One run of two, the second `without_start`. It has nothing of rows: their plans may have others."""
    names = "q", "v", "a", "values", "stored", "friction"
    q, v, a, values, stored, friction = (
        np.concatenate([getattr(part, name) for part in (first, later)]) for name in names
    )
    return replace(
        later, q=q, v=v, a=a, values=values, stored=stored, friction=friction, start=first.start,
        start_stored=first.start_stored, lam=None,
        traction=None, status=None, fresh=np.zeros((len(q), 0), dtype=bool), made=first.made + later.made,
        iterations=first.iterations + later.iterations,
    )  # fmt: skip


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
        self._start, self._start_stored, self._kept = stepper.state(), stepper.stored.copy(), list[Samples]()
        self._on_rows: tuple[list[sp.csr_matrix], ...] = [], [], []
        first = self.room(1)
        stepper.keep(first, 0)
        self.add(first, 1)

    def room(self, n: int) -> Samples:
        """Room for n samples."""
        return Samples.of(self._plan, n, motion=self._motion, rows=self._rows)

    def add(self, samples: Samples, n: int) -> None:
        """Add the first n samples."""
        some, none = Samples(*(part[:n] for part in samples)), np.empty((0, 0))
        self._kept.append(some._replace(lam=none, traction=none, status=none))
        if self._rows:
            for kept, of_rows in zip(self._on_rows, (some.lam, some.traction, some.status), strict=True):
                kept.append(sp.csr_matrix(of_rows))

    def histories(self, made: int, stopped: Stop | None) -> Histories:
        """All that was added; `made` is the number of steps, `stopped` what stopped them."""
        stepper = self._stepper
        q, v, a, values, stored, _, friction, _, _, fresh = (
            np.concatenate(parts) for parts in zip(*self._kept, strict=True)
        )
        lam, traction, status = (sp.vstack(parts, format="csr") if self._rows else None for parts in self._on_rows)
        return Histories(
            q, v, a, values, stored, lam, friction, traction, status, fresh,
            start=self._start, end=stepper.state(), start_stored=self._start_stored,
            end_values=stepper.values.copy(), end_stored=stepper.stored.copy(),
            peaks=Peaks(*(part.copy() for part in stepper.peaks)),
            left=stepper.left, iterations=stepper.iterations, made=made, stopped=stopped,
        )  # fmt: skip
