"""Review of a run: it cuts the result where samples lose their meaning, and tells what all reviews find.

`solve_dynamic`, `solve_static` and `collect` end with this review.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ...errors import StoppedRunWarning
from ...support.warn import warn
from ..result import Result, cut
from .balance import balance
from .bending import bending
from .crossing_edges import crossing_edges
from .deformation import axial_forces, rotation, slopes, strain, turned_surfaces, unbounded, undamped_vibration
from .dents import missing_dents
from .lasting import lasting_ringing
from .passing import passing
from .patches import directions, missed, open_statics, patch_edges
from .penetration import depth, overlap, sinking
from .pushed_shut import pushed_shut
from .resolution import few_rows, rare_samples, short_impacts, undamped_layers, wide_points
from .reviewed_run import Finding, Review, ReviewedRun
from .ringing import ringing
from .spin import missing_growth, spin
from .steps import long_steps, missing_steps, turns, unstable_steps
from .through_walls import through_walls
from .yielding import coarse_zones, first_yield, flow_at_border, large_plastic_strain, near_zones

_log = logging.getLogger(__name__)


def stopped(run: ReviewedRun) -> Iterator[Finding]:
    """Runs that ended early."""
    if run.result.status != "finished":
        yield Finding(run.result.message, StoppedRunWarning)


def open_joints(run: ReviewedRun) -> Sequence[Finding]:
    """Joints that were open at the start, and whose closing shows."""
    return run.closings


WITHOUT_SAMPLES: tuple[Review, ...] = (stopped, missing_steps, unstable_steps)
OF_SAMPLES: tuple[Review, ...] = (
    rotation, turned_surfaces, missing_growth, axial_forces, spin, slopes, strain, bending, undamped_vibration,
    patch_edges, overlap, depth, sinking, crossing_edges, short_impacts, few_rows, wide_points, directions, missed,
    pushed_shut, passing, through_walls, undamped_layers, flow_at_border, coarse_zones, large_plastic_strain, ringing,
    rare_samples, first_yield, near_zones, open_statics, missing_dents, open_joints, balance, long_steps,
    lasting_ringing, turns,
)  # fmt: skip


def reviewed(run: ReviewedRun, *others: Review) -> Result:
    """Cut the result of a run where its samples lose their meaning, and tell the findings of all reviews.

    Parameters
    ----------
    run : ReviewedRun
    *others : callable
        More reviews, of runs of this kind.
    """
    run = bounded(run)
    reviews = (*WITHOUT_SAMPLES, *OF_SAMPLES, *others) if len(run.result.t) else WITHOUT_SAMPLES
    findings = [finding for review in reviews for finding in review(run)]
    for finding in findings:
        tell(finding)
    return replace(run.result, warnings=tuple(finding.text for finding in findings if finding.category is not None))


def tell(finding: Finding) -> None:
    """Warn of a finding at the user's line, or log it."""
    if finding.category is None:
        _log.info("%s", finding.text)
    else:
        warn(finding.text, finding.category)


def bounded(run: ReviewedRun) -> ReviewedRun:
    """Return the run until deformations grow beyond all bounds, with a message that says so, and where it ends."""
    result, lost = run.result, np.zeros(len(run.result.t), dtype=bool)
    for body in run.bodies:
        lost |= unbounded(body)
    if lost.any():
        reason = result.message if result.status == "unstable" else "deformations have grown beyond all bounds"
        result = replace(cut(result, int(lost.argmax())), status="unstable", message=reason)
    if result.status == "finished":
        return run
    last = f"results are kept up to t = {result.t[-1]:.6g} s" if len(result.t) else "nothing could be kept"
    return replace(run, result=replace(result, message=f"{result.message}; {last}"))
