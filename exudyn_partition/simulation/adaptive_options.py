"""Options of adaptive runs, and the control of steps that follows from them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..contact.formulations.formulation import Integrator
from ..errors import InputError, ModelLimitWarning
from ..exudyn_bodies.model import coordinate_slices
from ..exudyn_contacts.model_run import runs_of
from ..exudyn_contacts.partition_contact import partition_items
from ..prediction.default_step import SAFETY
from ..support.arrays import Array, joined_slices
from ..support.checks import validate_positive
from ..support.foreign import MainSystem
from ..support.warn import warn
from .contact_work import ContactWork
from .stability import StabilityLimits
from .step_control import LONGEST, UNRESOLVED, State, StepControl
from .velocity_error import TOLERANCE

_MANY_STEPS = 200_000  # number of steps of an adaptive run in free flight that take minutes


@dataclass(frozen=True)
class AdaptiveOptions:
    """Options of `solve_dynamic` that equal steps do not have; None is a default.

    Parameters
    ----------
    free_step : float or None
        [s]
    gap_tolerance : float or None
        [m]
    unresolved, velocity_tolerance : float or None
    """

    free_step: float | None = None
    gap_tolerance: float | None = None
    unresolved: float | None = None
    velocity_tolerance: float | None = None

    def refuse_all(self) -> None:
        """Raise an error if any of them is given: the run has equal steps."""
        for name, value in vars(self).items():
            if value is not None:
                raise InputError(f"{name}: equal steps have none, it is taken only with adaptive=True")

    def control(
        self, limits: StabilityLimits, step: float, method: Integrator, sample_period: float | None, duration: float
    ) -> StepControl:
        """Return the control of a run.

        Parameters
        ----------
        limits : StabilityLimits
            Of the model, assembled.
        step : float
            Step in an impact [s].
        method : {"explicit", "implicit"}
        sample_period : float or None
            Longest time between samples [s].
        duration : float
            Of the run [s].

        Raises
        ------
        InputError
            If an option is out of range, or would have no effect.

        Warns
        -----
        ModelLimitWarning
            If the run takes very many steps even in free flight.
        """
        mbs, (bodies, contacts) = limits.mbs, partition_items(limits.mbs)
        longest = LONGEST * step if self.free_step is None else validate_positive("free_step", self.free_step, "s")
        if longest < step * (1 - 1e-9):
            raise InputError(f"free_step: expected at least the step in contact, {step:.4g} s, got {longest:.4g} s")
        gap_tolerance, unresolved = self.gap_tolerance, self.unresolved
        if gap_tolerance is not None:
            gap_tolerance = validate_positive("gap_tolerance", gap_tolerance, "m")
        unresolved = UNRESOLVED if unresolved is None else validate_positive("unresolved", unresolved, "")
        tolerance = self._velocity_tolerance(method)
        if method == "explicit":
            longest = min(longest, SAFETY * limits.with_contacts([]))
        longest = max(step, min(longest, sample_period or math.inf))
        _warn_of_many_steps(duration, longest, method)
        return StepControl(
            contacts,
            bodies,
            _state_of_bodies(mbs),
            runs_of(mbs).at_work,
            step=step,
            longest=longest,
            gap_tolerance=gap_tolerance,
            unresolved=unresolved,
            velocity_tolerance=tolerance,
            work=None if method == "explicit" else ContactWork.if_known(mbs, contacts),
        )

    def _velocity_tolerance(self, method: Integrator) -> float | None:
        """Error of velocities that an implicit step in lasting contact may have; None for explicit steps."""
        value = self.velocity_tolerance
        if method == "explicit":
            if value is not None:
                raise InputError(
                    "velocity_tolerance: explicit steps in contact keep to the stability limit; take method='implicit'"
                )
            return None
        value = TOLERANCE if value is None else validate_positive("velocity_tolerance", value, "")
        if value > TOLERANCE:
            raise InputError(
                f"velocity_tolerance: expected at most {TOLERANCE:g}, got {value:.4g}; with larger errors bodies that "
                "chatter in contact never come to rest, and nothing else would show it"
            )
        return value


def _state_of_bodies(mbs: MainSystem) -> State:
    """Return what a control asks for the present coordinates, velocities and accelerations of all bodies."""
    places = joined_slices([place for item in partition_items(mbs)[0] for place in coordinate_slices(mbs, item)])

    def state() -> tuple[Array, Array, Array]:
        data = mbs.systemData
        views = data.GetODE2Coordinates, data.GetODE2Coordinates_t, data.GetODE2Coordinates_tt
        if len(places) == 1:
            q, q_t, q_tt = [get(copy=False)[places[0]].copy() for get in views]
        else:
            q, q_t, q_tt = [np.concatenate([[], *(get(copy=False)[place] for place in places)]) for get in views]
        return q, q_t, q_tt

    return state


def _warn_of_many_steps(duration: float, longest: float, method: Integrator) -> None:
    if duration / longest > _MANY_STEPS:
        remedy = "method='implicit', whose steps stability does not limit" if method == "explicit" else "free_step="
        warn(
            f"adaptive: {duration:.4g} s take at least {duration / longest:.2g} steps, for those in free flight are at "
            f"most {longest:.4g} s, even if the bodies never touch. Take {remedy}, or a shorter end_time",
            ModelLimitWarning,
        )
