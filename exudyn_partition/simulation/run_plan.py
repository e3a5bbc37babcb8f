"""What a dynamic run is to be, found before its first step: times, steps, samples, settings, and where it begins."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, field, replace
from functools import partial

from ..contact.formulations.formulation import INTEGRATORS, Integrator
from ..errors import InputError
from ..support.checks import validate_choice, validate_flag, validate_number, validate_positive
from ..support.foreign import MainSystem, SimulationSettings
from ..support.optional import require
from ..support.progress import Progress
from .adaptive_options import AdaptiveOptions
from .continuation import RunEnd, origin_of
from .joint_checks import OpenJoints, check_start, refuse_drives_by_rates
from .newton_goal import newton_goal
from .stability import StabilityLimits
from .step_choice import chosen_step
from .step_control import StepControl

_ABOVE = 8  # of the residual that rounding leaves: where implicit steps end, which keep their Jacobian
_RELATIVE = 1e-9  # share of the first residual at which implicit steps with joints end
_CONTRACTIVITY = 0.02  # contractivity of Newton's iterations above which the Jacobian is computed again
_EARLY = 2e-10  # s; Exudyn's solvers stop ahead of their end time by less than this, for all steps
_SHORTER = 100  # an adaptive run may lose a last step that is shorter by more than this factor
_MOST_STEPS = 2**31 - 1  # largest number of steps that Exudyn counts
_SHORTEST = 1e-6  # share of the step in contact; Exudyn makes no shorter steps


@dataclass(frozen=True, eq=False)
class RunOptions:
    """What the user of `solve_dynamic` asks for; None is a default, see there.

    Parameters
    ----------
    end_time : float
        [s]
    start_time, step, sample_period : float or None
        [s]
    method : {"explicit", "implicit"}
    spectral_radius : float
    adaptive : bool
    of_adaptive : AdaptiveOptions
        Options that equal steps do not have.
    settings : exudyn.SimulationSettings or None
    """

    end_time: float
    start_time: float | None = None
    step: float | None = None
    method: Integrator = "explicit"
    sample_period: float | None = None
    spectral_radius: float = 0.9
    adaptive: bool = False
    of_adaptive: AdaptiveOptions = field(default_factory=AdaptiveOptions)
    settings: SimulationSettings = None

    def checked(self) -> RunOptions:
        """Return the options as plain numbers, or raise an InputError if one is out of range or has no effect."""
        validate_choice("method", self.method, INTEGRATORS)
        validate_flag("adaptive", self.adaptive)
        spectral_radius = validate_number("spectral_radius", self.spectral_radius)
        if not 0 <= spectral_radius <= 1:
            raise InputError(f"spectral_radius: expected 0 to 1, got {spectral_radius!r}")
        end_time, sample_period = validate_positive("end_time", self.end_time, "s"), self.sample_period
        if not self.adaptive:
            self.of_adaptive.refuse_all()
        if sample_period is not None:
            sample_period = validate_positive("sample_period", sample_period, "s")
        return replace(self, end_time=end_time, spectral_radius=spectral_radius, sample_period=sample_period)

    def start(self, last: RunEnd | None) -> float:
        """Return the time at which the run begins [s]; `last` is the end from which it goes on.

        Raises
        ------
        InputError
            If the run would end before.
        """
        begins, settings = "timeIntegration.startTime", self.settings
        start = 0.0 if settings is None else float(settings.timeIntegration.startTime)
        given = self.start_time if last is None or last.method == "static" else last.t
        if given is not None:
            begins, start = "start_time", validate_number("start_time", given, "a finite number in s")
        if not start < self.end_time:
            raise InputError(f"end_time: expected more than {begins}, {start:.6g} s, got {self.end_time:.6g} s")
        return start


@dataclass(frozen=True)
class RunTimes:
    """Times of a run.

    Parameters
    ----------
    start, end : float
        [s]
    step : float
        Length of a step; of an adaptive run, in an impact [s].
    steps : int
        Number of steps of this length.
    between : int
        Number of steps from one sample to the next.
    beyond : int
        Steps after the end, which Exudyn is told and does not make: a hook ends the run before.
    """

    start: float
    end: float
    step: float
    steps: int
    between: int
    beyond: int

    @classmethod
    def of_steps(cls, start: float, end: float, step: float, sample_period: float | None, least: float) -> RunTimes:
        """Times of steps that are not longer than `step` [s], so that the run ends after a whole number of them.

        `least` is the shortest last step [s]: Exudyn may lose steps that are shorter, for it stops early. So there are
        more of them.

        Raises
        ------
        InputError
            If there are more steps than Exudyn counts.
        """
        steps, between = _counts(end - start, step, sample_period)
        step = (end - start) / steps
        beyond = math.ceil(_EARLY / step) if step < least else 0
        if steps + beyond > _MOST_STEPS:
            raise InputError(
                f"end_time: a run of {end - start:.4g} s is too short for Exudyn, whose solvers stop 1e-10 s before "
                f"the end; expected at least {_EARLY / _MOST_STEPS:.2g} s"
            )
        return cls(start, end, step, steps, between, beyond)


@dataclass(frozen=True, eq=False)
class RunPlan:
    """A dynamic run before its first step.

    Parameters
    ----------
    method : {"explicit", "implicit"}
    times : RunTimes
    settings : exudyn.SimulationSettings
        Exudyn's settings, of this run alone.
    control : StepControl or None
        Chooses the steps of an adaptive run.
    origin : RunEnd or None
        End from which the run goes on as if both were one.
    open_joints : OpenJoints
        Joints that are open at the start.
    renews : bool
        Whether Newton's method gets new Jacobians where that saves time, see `renewals`.
    """

    method: Integrator
    times: RunTimes
    settings: SimulationSettings
    control: StepControl | None
    origin: RunEnd | None
    open_joints: OpenJoints
    renews: bool


def plan_run(mbs: MainSystem, options: RunOptions, last: RunEnd | None, progress: Progress | None) -> RunPlan:
    """Check a model and what is asked of it, and plan the run.

    Parameters
    ----------
    mbs : exudyn.MainSystem
        The model, in its initial state.
    options : RunOptions
    last : RunEnd or None
        End from which the run goes on, if the user chose that.
    progress : callable or None
        To be checked.

    Raises
    ------
    InputError, StepSizeError, RunError
        See `solve_dynamic`.
    """
    options = options.checked()
    method, adaptive = options.method, options.adaptive
    begins = partial(options.start, last)
    open_joints = check_start(mbs, options.settings, progress, begins, judges_velocities=last is None)
    if method == "implicit":
        refuse_drives_by_rates(mbs, options.settings)
    start, asked, limits = begins(), options.step, StabilityLimits(mbs)
    if asked is None and last is not None and last.method == method:
        asked = last.step
    # The last step of an adaptive run has only the time that is left, and may be very short.
    times = RunTimes.of_steps(
        start,
        options.end_time,
        chosen_step(limits, asked, method),
        None if adaptive else options.sample_period,
        _EARLY * (_SHORTER if adaptive else 1),
    )
    control = None
    if adaptive:
        duration = times.end - times.start
        control = options.of_adaptive.control(limits, times.step, method, options.sample_period, duration)
    origin = origin_of(mbs, start, method, last)
    renews = method == "implicit" and options.settings is None  # the user's settings are kept as they are
    return RunPlan(method, times, _settings(mbs, options, times), control, origin, open_joints, renews)


def _count(duration: float, step: float) -> int:
    """Number of equal steps that are not longer than `step` [s]."""
    if not duration / step < _MOST_STEPS:
        raise InputError(
            f"step: {duration:.4g} s in steps of {step:.4g} s are {duration / step:.3g} steps; Exudyn counts to "
            f"{_MOST_STEPS:.3g}. Take longer steps or a shorter end_time"
        )
    return math.ceil(duration / step * (1 - 1e-9))


def _counts(duration: float, step: float, sample_period: float | None) -> tuple[int, int]:
    """Number of equal steps that are not longer than `step` [s], and how many lie between samples, a whole part."""
    if sample_period is None or sample_period <= step:
        return _count(duration, step), 1
    intervals = max(1, round(duration / sample_period))
    between = _count(duration / intervals, step)
    return _count(duration, duration / (intervals * between)), between


def _settings(mbs: MainSystem, options: RunOptions, times: RunTimes) -> SimulationSettings:
    """Exudyn's settings of a run: a copy of the user's, or our own, with the times and samples of this run."""
    if options.settings is None:
        settings = _default_settings(mbs, options.method, times.end - (options.start_time or 0.0))
    else:
        settings = copy.copy(options.settings)
    integration, step = settings.timeIntegration, times.step
    integration.startTime, integration.endTime = times.start, times.end + times.beyond * step
    integration.numberOfSteps = times.steps + times.beyond
    integration.generalizedAlpha.spectralRadius = options.spectral_radius
    integration.explicit.eliminateConstraints = False  # MultiplierStep closes joints
    settings.solution.sensors.writePeriod = times.between * step
    if options.adaptive:
        settings.solution.sensors.writePeriod = options.sample_period or 0.0
        integration.adaptiveStep, integration.minimumStepSize = True, _SHORTEST * step
        # The control makes steps longer; Exudyn only makes failed steps shorter.
        integration.adaptiveStepRecoverySteps = times.steps
    return settings


def _default_settings(mbs: MainSystem, method: Integrator, duration: float) -> SimulationSettings:
    """Settings for a user who gave none, and a run of some duration [s]."""
    exu = require("exudyn")
    settings = exu.SimulationSettings()
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.solution.file.write = False
    integration = settings.timeIntegration
    integration.verboseMode = 0
    # Stiff springs on light bodies have round-off above Exudyn's 1e-10, which Newton's method would never reach. Near
    # round-off, a step with an old Jacobian gains little, so that Exudyn would ask for new ones in vain.
    if method == "implicit":
        # With a new Jacobian, one iteration reaches Exudyn's 1e-8. Reactions are distances in joints over the square of
        # a step, and need smaller ones: they alternate with an error that grows.
        if len(mbs.systemData.GetAECoordinates()):
            integration.newton.relativeTolerance = _RELATIVE
        integration.newton.absoluteTolerance = _ABOVE * newton_goal(mbs, duration)
        # Exudyn finds this small part of the Jacobian of a spring on an interface by differences of all coordinates.
        integration.newton.numericalDifferentiation.jacobianConnectorDerivative = False
    # Where rows open or close, a new Jacobian costs less than the iterations that an old one takes.
    integration.newton.modifiedNewtonContractivity = _CONTRACTIVITY
    # Verlet's accelerations at the end of a step are those of the next one. This option would compute them twice.
    integration.explicit.computeEndOfStepAccelerations = False
    return settings
