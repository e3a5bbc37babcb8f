"""Results of runs that Exudyn's solvers made directly."""

from __future__ import annotations

import contextlib
import warnings
from dataclasses import replace

from ..errors import InputError, ModelLimitWarning
from ..exudyn_bodies.model import validate_model
from ..exudyn_bodies.partition_body import check_model
from ..exudyn_contacts.model_run import runs_of
from ..exudyn_contacts.run_record import Solver
from ..support.foreign import MainSystem
from .balance_review import warn_of_balance
from .continuation import last_end
from .result import Result, samples
from .review import noted, reviewed, warn_of_turns
from .stability import stability_limit


def collect(mbs: MainSystem) -> Result:
    """Results of the last run of a model, also if `mbs.SolveDynamic` was called directly.

    Exudyn reads its sensors each hundredth of a second unless `settings.solution.sensors.writePeriod` says otherwise.
    Contacts then keep the ends of all steps themselves, with the coordinates of all partition bodies. The result has
    the times of these steps.

    Parameters
    ----------
    mbs : exudyn.MainSystem

    Returns
    -------
    Result
        It ends where coordinates are no longer finite, or deformations no longer small.

    Raises
    ------
    InputError
        If `mbs` is no model of Exudyn.
    RunError
        If no sensor stored anything.

    Warns
    -----
    StoppedRunWarning, ModelLimitWarning, ContactPatchWarning
        As `solve_dynamic`. Also if explicit steps were above the stability limit, or if there were too many steps for
        contacts to keep.
    """
    validate_model(mbs)
    check_model(mbs)
    result, solver = samples(mbs), Solver.last(mbs)
    with contextlib.suppress(InputError):  # the model may not have been run to a whole end
        result = replace(result, end=last_end(mbs))
    if (run := runs_of(mbs).last(mbs)) is not None and run.record.overflowed:
        warnings.warn(
            "the run took more steps than contacts keep beside Exudyn's sensors, so that the result has the times of "
            "these alone: impacts between them are missing. Set settings.solution.sensors.writePeriod to the period "
            "that you need, or take solve_dynamic(mbs, ..., sample_period=...)",
            ModelLimitWarning,
            stacklevel=2,
        )
    if solver is not None:
        result = replace(result, method=solver.method, step=solver.step, steps=solver.steps)
        if not solver.finished:
            message = f"the solver stopped at t = {solver.time:.6g} s, before the end of the run"
            result = replace(result, status="interrupted", message=message)
        _warn_of_stability(mbs, solver)
    with noted() as warned:
        result = reviewed(mbs, result)
        warn_of_balance(mbs, result)
        if solver is not None and solver.equal:
            warn_of_turns(result)
    return replace(result, warnings=tuple(warned))


def _warn_of_stability(mbs: MainSystem, solver: Solver) -> None:
    if solver.verlet and solver.step > (limit := stability_limit(mbs)):
        warnings.warn(
            f"the explicit steps of {solver.step:.4g} s are above the stability limit, {limit:.4g} s (all contact rows "
            f"closed): the bodies may gain energy without bound. Take at most {limit:.3g} s, or an implicit solver",
            ModelLimitWarning,
            stacklevel=3,
        )
