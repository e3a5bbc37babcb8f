"""Record of a run that contacts keep themselves, independent of the period of Exudyn's sensors.

By default `mbs.SolveDynamic` writes sensors every hundredth of a second. An impact is shorter. The solver asks contacts
for forces in every step. Then they record the state in which the step before ended.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..exudyn_bodies.model import coordinate_slices, latest_solver, method_of, registered, start_of_step
from ..results.newmark import Newmark
from ..support.arrays import Array
from ..support.foreign import MainSystem
from ..support.optional import require

MOST = 1 << 26  # largest count of numbers that a record keeps: half a gigabyte
# From a time and the model's coordinates: values of the contacts' sensors, with the sensors' numbers as keys.
Recorded = Callable[[float, Array], dict[int, list[float]]]

_ROUND_OFF = 1e-9  # share of a step, in comparisons of periods


@dataclass(frozen=True)
class Solver:
    """Data that a solver of Exudyn records of a run.

    Parameters
    ----------
    method : {"explicit", "implicit", "static"}
    step : float
        Longest step [s]; for the static solver, a step of static time.
    steps : int
        Steps taken.
    equal : bool
        Whether all steps have one length, apart from steps that failed and were repeated.
    verlet : bool
        Whether the solver is VelocityVerlet.
    finished : bool
        Whether the run came to its end.
    time : float
        Time that the run has reached [s].
    rejected_steps, jacobians, newton_iterations : int
        Steps that were taken again, and the work of Newton's method.
    spectral_radius : float
        The option of generalized-alpha; for other solvers it means nothing.
    newmark : Newmark or None
        Parameters of an implicit solver.
    """

    method: str
    step: float
    steps: int
    equal: bool
    verlet: bool
    finished: bool
    time: float
    rejected_steps: int
    jacobians: int
    newton_iterations: int
    spectral_radius: float
    newmark: Newmark | None

    @classmethod
    def last(cls, mbs: MainSystem) -> Solver | None:
        """Data of the last run; None if `storeSolver=False` kept no solver."""
        solver = latest_solver(mbs)
        if solver is None:
            return None
        it, settings, newmark = solver.it, mbs.sys["simulationSettings"], None
        if hasattr(solver, "newmarkGamma"):
            newmark = Newmark(solver.alphaM, solver.alphaF, solver.newmarkBeta, solver.newmarkGamma)
        return cls(
            method=method_of(solver),
            step=it.maxStepSize,
            steps=it.currentStepIndex - 1,
            equal=not it.automaticStepSize,
            verlet="VelocityVerlet" in solver.GetSolverName(),
            finished=it.currentTime > it.endTime - 0.5 * it.maxStepSize,
            time=it.currentTime,
            rejected_steps=it.rejectedAutomaticStepSizeSteps,
            jacobians=it.newtonJacobiCount,
            newton_iterations=it.newtonStepsCount,
            spectral_radius=settings.timeIntegration.generalizedAlpha.spectralRadius,
            newmark=newmark,
        )


class RunRecord:
    """Times, coordinates and contact forces at the ends of the steps of a run.

    The state at the end of a step is the state at the start of the next one. The forces are those of the last
    evaluation: explicit solvers evaluate once in each step, and Newton's method ends with an evaluation. So the record
    is made when the next step first asks a contact for forces. Exudyn's sensors always have the last step of a run.

    Parameters
    ----------
    t : float
        Time at which the run begins [s].
    on : bool
        Whether steps are kept. It is false if Exudyn's sensors keep every step.

    Attributes
    ----------
    overflowed : bool
        Whether the run had too many steps for the memory. Then none is kept.
    """

    def __init__(self, t: float, on: bool) -> None:
        self.on, self.overflowed = on, False
        self._began = self._asked_at = t
        self._start = -math.inf
        self._clear()

    def _clear(self) -> None:
        self._times: list[float] = []
        self._coordinates: list[tuple[Array, Array]] = []
        self._values: dict[int, list[list[float]]] = {}

    def advance(self, mbs: MainSystem, t: float, recorded: Recorded) -> None:
        """Keep the state at the end of the last step. Call it, while `on`, before contacts are evaluated at time t.

        A step that failed is repeated from the same start, and is not kept.

        Parameters
        ----------
        mbs : exudyn.MainSystem
        t : float
            Time [s].
        recorded : callable
            Returns the values of the contacts' sensors, with the sensors' numbers as keys.
        """
        if t == self._asked_at:
            return
        self._asked_at = t
        if t <= self._began:
            return
        start = start_of_step(mbs)
        if start > self._start:
            self._start = start
            self._keep_step(mbs, start, recorded)

    def _keep_step(self, mbs: MainSystem, t: float, recorded: Recorded) -> None:
        data, configuration = mbs.systemData, require("exudyn").ConfigurationType.StartOfStep
        both = data.GetODE2Coordinates(configuration), data.GetODE2Coordinates_t(configuration)
        self._times.append(t)
        self._coordinates.append(both)
        for number, values in recorded(t, both[0]).items():
            self._values.setdefault(number, []).append(values)
        if 2 * len(self._times) * len(both[0]) > MOST:
            self._clear()
            self.on, self.overflowed = False, True

    @property
    def times(self) -> Array:
        """Ends of the steps that were kept, (n,) [s]."""
        return np.array(self._times)

    def sensors(self, mbs: MainSystem) -> dict[int, Array]:
        """Values of the sensors of bodies and contacts at `times`, (n, k), with the sensors' numbers as keys."""
        kept = {number: np.array(values) for number, values in self._values.items()}
        q, q_t = (np.array(coordinates) for coordinates in zip(*self._coordinates, strict=True))
        for item in registered(mbs).bodies.values():
            slices = coordinate_slices(mbs, item)
            for key, values in (("sCoordinates", q), ("sCoordinates_t", q_t)):
                kept |= {int(number): values[:, place] for number, place in zip(item[key], slices, strict=True)}
        return kept


def sensors_keep_all(mbs: MainSystem) -> bool:
    """Whether Exudyn's sensors store every step of the present run."""
    settings = mbs.sys.get("simulationSettings")
    if settings is None or mbs.sys.get("dynamicSolver") is None:
        return False
    if mbs.sys["dynamicSolver"].it.automaticStepSize:  # Exudyn chooses the steps
        return False
    integration = settings.timeIntegration
    step = (integration.endTime - integration.startTime) / max(integration.numberOfSteps, 1)
    return bool(settings.solution.sensors.writePeriod <= step * (1 + _ROUND_OFF))
