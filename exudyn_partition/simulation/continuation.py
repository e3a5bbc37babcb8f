"""The end of a run, and runs that go on from there as if both were one."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..contact.formulations.formulation import Method
from ..errors import InputError
from ..exudyn_bodies.model import latest_solver, method_of
from ..exudyn_contacts.model_run import runs_of
from ..exudyn_contacts.run_state import RunState
from ..support.arrays import Array
from ..support.foreign import MainSolver, MainSystem, SimulationSettings
from ..support.optional import require
from .step_control import Pace

_KEY = "exudynPartitionEnd"  # in mbs.sys
_SOLVERS = "dynamicSolver", "staticSolver"
_ROUND_OFF = 1e-12  # relative difference of times that are the same


@dataclass(frozen=True, eq=False)
class RunEnd:
    """The end of a run, as one value: another run goes on from it, also in another process.

    Parameters
    ----------
    t : float
        Time at the end [s].
    method : {"explicit", "implicit", "static"}
    step : float
        Time step [s].
    system : tuple of arrays
        State of the model, as Exudyn's `GetSystemState` returns it: coordinates and velocities come first.
    q_tt : (n,) array
        Accelerations.
    algorithmic : (n,) array
        Accelerations from which generalized-alpha goes on; for other solvers, `q_tt`.
    pace : Pace
        What the control of an adaptive run knows.
    contacts : RunState or None
        State of the contacts; None if the model has none.
    """

    t: float
    method: Method
    step: float
    system: tuple[Array, ...]
    q_tt: Array
    algorithmic: Array
    pace: Pace
    contacts: RunState | None

    @classmethod
    def of_last_run(cls, mbs: MainSystem, pace: Pace | None = None, *, stopped: bool = False) -> RunEnd:
        """End of the model's last run, if the model is still in that state.

        `stopped` is whether an error stopped the run in a step, and the model stands at the start of that step again.

        Raises
        ------
        InputError
            If there was none, or one that did not end with a whole step.
        """
        solver = latest_solver(mbs)
        if solver is None:
            raise InputError(
                "go_on: the model has not been run yet, or was changed since; run it first, or leave go_on out"
            )
        if not runs_of(mbs).is_whole(mbs):
            raise InputError(
                "go_on: an error stopped the last run within a step, whose multipliers of contacts or joints cannot be "
                "taken back; repeat that run without the error, and leave go_on out"
            )
        data, method = mbs.systemData, method_of(solver)
        q_tt = np.array(data.GetODE2Coordinates_tt())
        algorithmic = q_tt
        if method == "implicit":
            algorithmic = np.array(solver.GetStartOfStepStateAAlgorithmic() if stopped else solver.GetAAlgorithmic())
        return cls(
            t=float(data.GetTime()),
            method=method,
            step=float(solver.it.maxStepSize),
            system=tuple(map(np.array, data.GetSystemState())),
            q_tt=q_tt,
            algorithmic=algorithmic,
            pace=pace or Pace(),
            contacts=runs_of(mbs).end_state(mbs),
        )

    def is_start(self, mbs: MainSystem, start: float, method: Method) -> bool:
        """Whether a run with this method that begins at `start` [s] in the model's initial state goes on from here."""
        same_time = abs(start - self.t) <= _ROUND_OFF * abs(start)
        return method == self.method and same_time and self.is_initial(mbs)

    def is_initial(self, mbs: MainSystem) -> bool:
        """Whether it is the model's initial state."""
        initial = mbs.systemData.GetSystemState(require("exudyn").ConfigurationType.Initial)
        return all(np.array_equal(start, end) for start, end in zip(initial[:2], self.system[:2], strict=True))


class _Kept(NamedTuple):
    """Ends that a model keeps.

    Parameters
    ----------
    last : RunEnd or None
        End of the last run; None if that did not end with a whole step.
    origin : RunEnd or None
        End of an earlier run that is the model's initial state.
    solvers : tuple
        Identities of the model's solvers at the last end; a later run replaces the solvers.
    compiled : bool
        Whether the last run was compiled, see `compiled_run`.
    """

    last: RunEnd | None = None
    origin: RunEnd | None = None
    solvers: tuple[int, ...] = ()
    compiled: bool = False


def _kept(mbs: MainSystem) -> _Kept:
    kept: _Kept = mbs.sys.get(_KEY, _Kept())
    return kept


def keep_end(mbs: MainSystem, pace: Pace | None = None, *, stopped: bool = False) -> RunEnd | None:
    """Keep and return the end of a run, because later calls may change the model's state; None if it has no whole end.

    `pace` is that of the control of an adaptive run. `stopped` is whether an error stopped the run: it then ends with
    the last step that was made whole.
    """
    if (solver := latest_solver(mbs)) is None:
        return None
    if stopped:
        _step_back(mbs, solver)
    runs = runs_of(mbs)
    runs.end(mbs, stopped=stopped)
    end = RunEnd.of_last_run(mbs, pace, stopped=stopped) if runs.is_whole(mbs) else None
    mbs.sys[_KEY] = _Kept(end, _origin(mbs), _solvers(mbs))
    return end


def keep_compiled_end(mbs: MainSystem, step: float, pace: Pace) -> RunEnd:
    """Keep and return the end of a run that no solver of Exudyn has made. The model is in its state.

    `step` is its time step [s], `pace` what the control of adaptive steps knows.
    """
    data, runs = mbs.systemData, runs_of(mbs)
    runs.end(mbs)
    q_tt = np.array(data.GetODE2Coordinates_tt())
    end = RunEnd(
        t=float(data.GetTime()),
        method="explicit",
        step=step,
        system=tuple(map(np.array, data.GetSystemState())),
        q_tt=q_tt,
        algorithmic=q_tt,
        pace=pace,
        contacts=runs.end_state(mbs),
    )
    mbs.sys[_KEY] = _Kept(end, _origin(mbs), _solvers(mbs), compiled=True)
    return end


def last_was_compiled(mbs: MainSystem) -> bool:
    """Whether no solver of Exudyn has made the last run, so that its sensors stored nothing."""
    kept = _kept(mbs)
    return kept.compiled and kept.solvers == _solvers(mbs)


def _step_back(mbs: MainSystem, solver: MainSolver) -> None:
    """Return to the start of the step that an error has stopped, where Exudyn has left no more than a part of it."""
    data, start = mbs.systemData, require("exudyn").ConfigurationType.StartOfStep
    t = data.GetTime(start)
    data.SetSystemState(data.GetSystemState(start))
    data.SetODE2Coordinates_tt(data.GetODE2Coordinates_tt(start))
    data.SetTime(t)
    solver.it.currentTime = t  # by which the latest solver is known


def _origin(mbs: MainSystem) -> RunEnd | None:
    """End of an earlier run that is the model's initial state: each run from there goes on from it."""
    ends = (end for end in _kept(mbs)[:2] if end is not None)
    return next((end for end in ends if end.is_initial(mbs)), None)


@contextlib.contextmanager
def undo_if_refused(mbs: MainSystem) -> Iterator[None]:
    """Leave the model as it was if the block raises an error: no run goes on from one that was not made."""
    data, keys = mbs.systemData, (*_SOLVERS, "simulationSettings")
    entries, state = {key: mbs.sys[key] for key in keys if key in mbs.sys}, data.GetSystemState()
    q_tt, t = data.GetODE2Coordinates_tt(), data.GetTime()
    try:
        with runs_of(mbs).undo_if_refused():
            yield
    except BaseException:
        for key in keys:
            mbs.sys.pop(key, None)
        mbs.sys.update(entries)
        data.SetSystemState(state)
        data.SetODE2Coordinates_tt(q_tt)
        data.SetTime(t)
        raise


def last_end(mbs: MainSystem) -> RunEnd:
    """End of the last run.

    Raises
    ------
    InputError
        If there was none.
    """
    kept = _kept(mbs)
    return kept.last if kept.last is not None and kept.solvers == _solvers(mbs) else RunEnd.of_last_run(mbs)


def origin_of(mbs: MainSystem, start: float, method: Method, last: RunEnd | None) -> RunEnd | None:
    """End from which a run goes on that begins at `start` [s] in the model's initial state; None if there is none.

    `last` is the end of the last run, if it is known.
    """
    ends = last, *_kept(mbs)[:2]
    return next((end for end in ends if end is not None and end.is_start(mbs, start, method)), None)


def _solvers(mbs: MainSystem) -> tuple[int, ...]:
    return tuple(id(mbs.sys.get(key)) for key in _SOLVERS)


@contextlib.contextmanager
def start_from(mbs: MainSystem, end: RunEnd | None) -> Iterator[None]:
    """Let the model start where a run ended, and restore its initial state after the block. None changes nothing."""
    if end is None:
        yield
        return
    data, initial = mbs.systemData, require("exudyn").ConfigurationType.Initial
    former, origin = data.GetSystemState(initial), _origin(mbs)
    if [len(part) for part in former] != [len(part) for part in end.system]:
        raise InputError("go_on: the model has other coordinates than in its last run; run it from the start")
    with runs_of(mbs).go_on_from(mbs, end.contacts):
        data.SetSystemState([*end.system], initial)
        try:
            yield
        finally:
            data.SetSystemState(former, initial)
            mbs.sys[_KEY] = _kept(mbs)._replace(origin=origin)


@contextlib.contextmanager
def set_accelerations(mbs: MainSystem, end: RunEnd | None, settings: SimulationSettings) -> Iterator[Array | None]:
    """Let a run go on with the accelerations at the end of the last one; None changes nothing.

    Exudyn begins each run with accelerations of its own. For explicit steps it takes velocities at the end of the step
    before, not those at its middle. For generalized-alpha it drops the memory of the filter.

    Yields
    ------
    (n,) array or None
        Accelerations that must be set before the first step.
    """
    if end is None:
        yield None
        return
    data, initial = mbs.systemData, require("exudyn").ConfigurationType.Initial
    alpha, former = settings.timeIntegration.generalizedAlpha, np.array(data.GetODE2Coordinates_tt(initial))
    flags = alpha.computeInitialAccelerations, alpha.resetAccelerations
    data.SetODE2Coordinates_tt(end.algorithmic, initial)  # generalized-alpha reads them there
    alpha.computeInitialAccelerations = alpha.resetAccelerations = False
    try:
        yield end.q_tt
    finally:
        alpha.computeInitialAccelerations, alpha.resetAccelerations = flags
        data.SetODE2Coordinates_tt(former, initial)
