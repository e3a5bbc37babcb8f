"""Results of runs that Exudyn's solvers made directly."""

from __future__ import annotations

import contextlib
from dataclasses import replace

from ..errors import InputError, RunError
from ..exudyn_bodies.model import validate_model
from ..exudyn_bodies.partition_body import check_model
from ..exudyn_contacts.run_record import Solver
from ..support.foreign import MainSystem
from .continuation import last_end, last_was_compiled
from .result import Result, samples
from .reviews.review import reviewed
from .reviews.reviewed_run import ReviewedRun


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
        If no sensor stored anything, as in a compiled run.

    Warns
    -----
    StoppedRunWarning, ModelLimitWarning, ContactPatchWarning
        As `solve_dynamic`. Also if explicit steps were above the stability limit, or if there were too many steps for
        contacts to keep.
    """
    validate_model(mbs)
    check_model(mbs)
    if last_was_compiled(mbs):
        raise RunError(
            "mbs: the last run was compiled, and Exudyn's sensors have nothing of it; solve_dynamic returned it"
        )
    result, solver = samples(mbs), Solver.last(mbs)
    with contextlib.suppress(InputError):  # the model may not have been run to a whole end
        result = replace(result, end=last_end(mbs))
    if solver is None:
        return reviewed(ReviewedRun(mbs, result))
    result = replace(result, method=solver.method, step=solver.step, steps=solver.steps)
    if not solver.finished:
        message = f"the solver stopped at t = {solver.time:.6g} s, before the end of the run"
        result = replace(result, status="interrupted", message=message)
    return reviewed(ReviewedRun(mbs, result, equal_steps=solver.equal, solver=solver))
