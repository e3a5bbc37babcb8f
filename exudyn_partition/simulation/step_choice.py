"""The step of a run with equal steps, and of an adaptive one in impacts: chosen, or the user's own, checked."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..contact.formulations.formulation import Integrator
from ..errors import InputError, StepSizeError
from ..exudyn_bodies.model import dofs_of
from ..exudyn_contacts.partition_contact import partition_items
from ..prediction.default_step import SAFETY, STEPS_A_PERIOD
from ..support.checks import validate_positive
from ..support.optional import require
from .item_limits import shorter_steps
from .stability import StabilityLimits
from .step_control import impact_step


def chosen_step(limits: StabilityLimits, step: float | None, method: Integrator) -> float:
    """Return the step of a run [s], see `solve_dynamic`: the user's `step`, checked, or a default.

    `limits` are those of its model.

    Raises
    ------
    InputError
        If the model has no partition body to choose it from.
    StepSizeError
        If an explicit step is above the stability limit.
    """
    limit = limits.whole if method == "explicit" else float("inf")
    if step is None:
        bodies, _ = partition_items(limits.mbs)
        if not bodies:
            raise InputError("step: the model has no partition body to choose it from; give it [s]")
        by_modes = 1 / (STEPS_A_PERIOD * max(item.body.f_cut for item in bodies))
        return min(SAFETY * limit, by_modes, *_impact_steps(limits))
    step = validate_positive("step", step, "s")
    if step > limit:
        raise StepSizeError(
            f"step: {step:.4g} s is above the stability limit of explicit integration, {limit:.4g} s (all contact rows "
            f"closed). {shorter_steps(limits.items, limit)}, or method='implicit'"
        )
    return step


def _impact_steps(limits: StabilityLimits) -> Iterator[float]:
    """Steps that resolve each contact's next impact, from the model's initial state [s]."""
    exu, mbs, data = require("exudyn"), limits.mbs, limits.mbs.systemData
    initial = exu.ConfigurationType.Initial
    q, q_t = data.GetODE2Coordinates(initial), data.GetODE2Coordinates_t(initial)
    q_tt = np.zeros_like(q)
    bodies, contacts = partition_items(mbs)
    for item in bodies:
        weight = np.asarray(mbs.GetObjectParameter(item["oGenericODE2"], "forceVector"))
        if weight.any():
            dofs = dofs_of(mbs, item)
            q_tt[dofs] = weight / item.kinematics.mass

    for contact in contacts:
        place, rate, acceleration = (np.concatenate([x[s] for s in contact.slices(mbs)]) for x in (q, q_t, q_tt))
        yield impact_step(contact, place, rate, acceleration, lambda: limits.whole)
