"""An explicit run as a function: a plan, a start and times give histories."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..support.arrays import Array
from .loops import Peaks, Samples, Stepper, Stop
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
    """

    q: Array
    v: Array
    a: Array | None = None


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
    stepper, between = stepper or Stepper(plan.contacts, len(plan.bodies.mass)), steps.between
    kept, made = [Samples.of(plan, 1, motion=motion, rows=rows)], 0
    stopped = stepper.begin(plan, start.q, start.v, start.a)
    began = _state(stepper)
    stepper.keep(kept[0], 0)
    lams = [sp.csr_matrix(kept[0].lam)] if rows else []
    chunk = min(_STEPS, max(_MOST // max(kept[0].lam.shape[1], 1), 1)) if rows else _STEPS
    while made < steps.count and not stopped:
        count = min(chunk, steps.count - made)
        phase = made % between
        samples = Samples.of(plan, (phase + count) // between, motion=motion, rows=rows)
        last, stopped = stepper.advance(steps.step, phase + 1, phase + count, between, samples)
        made += last - phase
        kept.append(Samples(*(part[: last // between] for part in samples)))
        if rows:
            lams.append(sp.csr_matrix(kept[-1].lam))
        if report is not None and not report(made):
            break
    q, v, values, stored = (np.concatenate(parts) for parts in [*zip(*kept, strict=True)][:4])
    return Histories(
        q, v, values, stored, sp.vstack(lams, format="csr") if rows else None,
        start=began, end=_state(stepper), end_stored=stepper.stored.copy(),
        peaks=Peaks(*(part.copy() for part in stepper.peaks)),
        iterations=stepper.iterations, made=made, stopped=stopped,
    )  # fmt: skip


def _state(stepper: Stepper) -> Start:
    """Present state."""
    m = stepper.motion
    return Start(m.q.copy(), m.v.copy(), m.a.copy())
