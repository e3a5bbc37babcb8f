"""Steps of a run: too long for stability, for turns and for what contacts store, or too many to keep."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...exudyn_contacts.model_run import runs_of
from ..item_limits import shorter_steps
from ..stability import StabilityLimits
from .reviewed_run import Finding, ReviewedRun

LARGEST_TURN = 1.0  # rad, for a floating frame in a step: six steps for a full turn
_OFF_IN_CONTACT = 1e-3  # share of the energy of the largest velocities that long steps may make or lose in contact


def missing_steps(run: ReviewedRun) -> Iterator[Finding]:
    """Steps that contacts could not keep beside sensors that Exudyn read seldom."""
    if (last := runs_of(run.mbs).last(run.mbs)) is not None and last.record.overflowed:
        yield Finding(
            "the run took more steps than contacts keep beside Exudyn's sensors, so that the result has the times of "
            "these alone: impacts between them are missing. Set settings.solution.sensors.writePeriod to the period "
            "that you need, or take solve_dynamic(mbs, ..., sample_period=...)"
        )


def unstable_steps(run: ReviewedRun) -> Iterator[Finding]:
    """Explicit steps above the stability limit, of runs that nothing checked, or in which an item began to act."""
    step, limits = 0.0, StabilityLimits(run.mbs)
    if run.solver is not None:
        step = run.solver.step if run.solver.verlet else 0.0
    elif run.result.method == "explicit" and run.result.status == "unstable" and limits.items is not None:
        step = run.result.step
    if step and step > (limit := limits.whole):
        yield Finding(
            f"the explicit steps of {step:.4g} s are above the stability limit, {limit:.4g} s (all contact rows "
            f"closed): the bodies may gain energy without bound. {shorter_steps(limits.items, limit)}, or an implicit "
            "solver"
        )


def turns(run: ReviewedRun) -> Iterator[Finding]:
    """Floating frames that turn far in a step, in runs with equal steps."""
    step = run.result.step
    for body in run.bodies if run.equal_steps else ():
        if body.item.frame == "floating":
            turn = step * np.linalg.norm(body.q_t[:, 3:6], axis=1).max()
            if turn > LARGEST_TURN:
                yield Finding(
                    f"body {body.item.name!r} turns by {turn:.3g} rad in a step of {step:.4g} s: no integrator "
                    f"follows that. Take steps of at most {0.25 * step / turn:.2g} s, 25 a turn, or adaptive=True"
                )


def long_steps(run: ReviewedRun) -> Iterator[Finding]:
    """Steps that grew in lasting contact, and made or lost a share of the energy of the largest velocities."""
    share = run.share_made
    if abs(share) > _OFF_IN_CONTACT:
        yield Finding(
            f"steps that grew in lasting contact have {'made' if share > 0 else 'lost'} {abs(share):.2%} of the energy "
            "of the largest velocities: the work of the contact forces in them differs from what contacts store and "
            "dissipate. Take a smaller velocity_tolerance"
        )
