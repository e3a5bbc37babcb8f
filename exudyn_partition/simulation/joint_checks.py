"""Exudyn adapter: joints that are open or violated at the start of a run, and their effect on it."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from types import FrameType

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg

from ..algebra.sparse.assembly import assembled
from ..errors import InputError, RunError
from ..exudyn_bodies.joints import is_timed, mass_and_rows
from ..exudyn_bodies.model import dofs_of, is_ours, user_function, validate_model
from ..exudyn_bodies.partition_body import PartitionBody, check_model, largest_way
from ..exudyn_bodies.user_functions import RIGID
from ..frames.floating import FloatingKinematics
from ..support.arrays import Array
from ..support.checks import validate_callable
from ..support.foreign import MainSolver, MainSystem, SimulationSettings
from ..support.optional import require
from ..support.progress import Progress
from .causes import cause
from .result import Result
from .sensor_checks import check_sensors

_SOLVERS = "exudyn.solver"  # Exudyn's module with the functions that run models
_APART = 0.05  # largest gap of a joint at the start, as a share of the smallest body's size
_VIOLATION = 1e-3  # largest violation of a constraint, relative to the largest initial velocity
_ROUND_OFF = 1e-13  # the same at rest, relative to the speed of one body size in a period of f_cut
_USUAL = 1e4  # m/s, the value of this speed if there are no bodies
_CLOSED = 1e-12  # gap of a joint closed to round-off: share of the smallest body's size, or rad
_SHARE = 1e-2  # energy that closing a joint may add, as a share of the bodies' largest energy
_ROUND_OFF = 1e-9  # of the size of bodies: motion that is none
_SLOW = 1e-3  # share of f_cut: motions as slow as that are rigid, and cost little where a joint closes at rest
_FIRST, _SPIKE = 50, 2.0  # steps in which a joint comes to rest; largest ratio of its force then to all later ones
_REGULAR = 1e-8, 1e-12  # share of a gap that stays open, and least mass: with these, redundant rows have one solution
_LOOK = 0.1, 1e-6  # time after the start in which speeds of drives show: share of 1 / omega_cut, or s without bodies
_OVERSHOOT = 2.0  # velocity after the first implicit step, in gaps per step: gamma / beta of Newmark's method


@dataclass(frozen=True)
class OpenJoint:
    """A joint that is open at the start; a run closes it within its first step.

    Parameters
    ----------
    number : int
        Exudyn's number of the object.
    label : str
        Name in messages.
    gap : float
        Largest gap of its rows [m or rad].
    rows : (k,) int array
        Numbers of its equations among the model's.
    sensors : tuple of (str, int)
        Names and numbers of the sensors of its reactions.
    """

    number: int
    label: str
    gap: float
    rows: Array
    sensors: tuple[tuple[str, int], ...]


class OpenJoints:
    """Joints that are slightly open at the start, and the effect of closing them in one step.

    Parameters
    ----------
    mbs : exudyn.MainSystem
        The model, at its initial coordinates.
    joints : sequence of OpenJoint
    gaps : (nAE,) array
        Gaps of all constraints.
    bodies : sequence of PartitionBody
    """

    def __init__(
        self, mbs: MainSystem, joints: Sequence[OpenJoint], gaps: Array, bodies: Sequence[PartitionBody]
    ) -> None:
        self.joints, self._gaps, self._bodies = joints, gaps, bodies
        if not joints:
            return
        self._mass, self._rows = mass_and_rows(mbs)
        self._stiffness = _placed_stiffness(mbs, bodies, self._mass.shape[0])
        self._places = [dofs_of(mbs, item) for item in bodies]
        q = mbs.systemData.GetODE2Coordinates(require("exudyn").ConfigurationType.Initial)
        self._start = [q[place] for place in self._places]

    def energy(self, joint: OpenJoint, step: float, method: str) -> float:
        """Energy of the first step, which closes the joint [J]: masses move by its gap within this step.

        In generalized-alpha each stiffness resists this motion, and the velocity stays for some steps at least.
        Explicit steps then correct velocities to those of the joints (RATTLE), and only deformation remains.
        """
        gaps = np.zeros(len(self._gaps))
        gaps[joint.rows] = self._gaps[joint.rows]
        implicit = method == "implicit"
        way = self._way(gaps, self._mass + self._stiffness * (step / 2) ** 2 * implicit)
        strain, kinetic = (0.5 * float(way @ (matrix @ way)) for matrix in (self._stiffness, self._mass))
        return strain + implicit * kinetic * (_OVERSHOOT / step) ** 2

    def _way(self, gaps: Array, inertia: sp.csr_matrix) -> Array:
        """Change of the coordinates, (n,), that closes the gaps with the least effect of `inertia`."""
        open_share, least = _REGULAR
        diagonal, rows = inertia.diagonal(), self._rows
        diagonal = np.maximum(diagonal, least * diagonal.max())
        yields = rows.multiply(rows) @ (1 / diagonal)
        stiff = np.where(yields > 0, 1 / (open_share * np.where(yields > 0, yields, 1.0)), 0.0)
        matrix = inertia + sp.diags(least * diagonal) + rows.T @ sp.diags(stiff) @ rows
        return np.asarray(scipy.sparse.linalg.splu(sp.csc_matrix(matrix)).solve(-(rows.T @ (stiff * gaps))))

    def shows(self, result: Result) -> Iterator[str]:
        """Sentences on the joints whose closing changes the run visibly."""
        if not self.joints or len(result.t) < 2:
            return
        if result.method == "static":
            yield from self._shows_at_rest(result)
            return
        largest = float(np.sum([item.energy(result) for item in self._bodies], axis=0).max(initial=0.0))
        for joint in self.joints:
            said = []
            energy = self.energy(joint, result.step, result.method)
            if energy > _SHARE * largest:
                said.append(f"brings {energy:.3g} J, {energy / largest:.2g} of the bodies' largest energy")
            for name, first, later in _spikes(joint, result):
                said.append(f"takes {first:.3g} N or N m in its sensor {name!r}, where later it has {later:.3g}")
            if said:
                yield (
                    f"{joint.label} is open by {joint.gap:.3g} (m or rad) at the start: closing it within the first "
                    f"step of {result.step:.3g} s {' and '.join(said)}. {REMEDY}"
                )

    def _shows_at_rest(self, result: Result) -> Iterator[str]:
        """Do the same as `shows` for load steps: nothing is thrown, but what stands beside a body may be pressed."""
        if not self._bodies:
            return
        slow = (_SLOW * 2 * np.pi * max(item.body.f_cut for item in self._bodies)) ** 2
        start = [*zip(self._bodies, self._start, strict=True)]  # `settle` takes several runs
        largest = max(largest_way(item, q, item.coordinates(result)[-1]) for item, q in start)
        least = _ROUND_OFF * max(float(np.ptp(item.body.points, axis=0).max()) for item in self._bodies)
        for joint in self.joints:
            gaps = np.zeros(len(self._gaps))
            gaps[joint.rows] = self._gaps[joint.rows]
            way = self._way(gaps, slow * self._mass + self._stiffness)  # bodies move rather than they bend
            closing = max(
                largest_way(item, q, item.kinematics.moved(q, way[place]))
                for (item, q), place in zip(start, self._places, strict=True)
            )
            if closing > max(_SHARE * largest, least):
                yield (
                    f"{joint.label} is open by {joint.gap:.3g} (m or rad) at the start: closing it within the first "
                    f"load step moves bodies by some {closing:.2g} m, where all load steps move them by {largest:.2g} "
                    f"m, and presses them on what is there. {REMEDY}"
                )

    def __str__(self) -> str:
        """Text on open joints that may have stopped a run."""
        named = "; ".join(f"{joint.label} is open by {joint.gap:.3g} (m or rad) at the start" for joint in self.joints)
        return f". {named}: {REMEDY}" if self.joints else ""


REMEDY = (
    "Put its markers where they meet: take the place of one from mbs.GetMarkerOutput, correct referencePosition, or "
    "give the interface's point by Partition.interface(..., position=...)"
)


def _spikes(joint: OpenJoint, result: Result) -> list[tuple[str, float, float]]:
    """Sensors of a joint's forces whose first samples are far above all later ones: name, first, later."""
    spikes = []
    first = result.t <= result.t[0] + (_FIRST + 0.5) * result.step
    for name, number in joint.sensors:
        size = np.linalg.norm(result.sensors.get(number, np.zeros((len(first), 1))), axis=1)
        if first.any() and not first.all() and size[first].max() > _SPIKE * size[~first].max():
            spikes.append((name, float(size[first].max()), float(size[~first].max())))
    return spikes


def _placed_stiffness(mbs: MainSystem, bodies: Sequence[PartitionBody], n: int) -> sp.csr_matrix:
    """Stiffness of the bodies on the model's n coordinates."""
    parts = []
    for item in bodies:
        K = item.body.stiffness
        if isinstance(item.kinematics, FloatingKinematics):
            K = sp.block_diag([sp.csr_matrix((RIGID, RIGID)), item.kinematics.elastic_stiffness], format="csr")
        parts.append((dofs_of(mbs, item), K))
    return assembled(parts, n)


def check_start(
    mbs: MainSystem,
    settings: SimulationSettings,
    progress: Progress | None,
    start: Callable[[], float],
    *,
    judges_velocities: bool,
) -> OpenJoints:
    """Raise an error for invalid options, for models that are not ready, and for violated joints; see `check_joints`.

    `start` returns the time at which the run begins [s]; it is called when the settings are known to be some.
    `judges_velocities` says whether initial velocities must fit joints and drives. They need not in statics, and not
    where a run goes on, with velocities that joints and drives have given.

    Raises
    ------
    InputError, RunError
    """
    exu = require("exudyn")
    if settings is not None and not isinstance(settings, exu.SimulationSettings):
        raise InputError(f"settings: expected an exudyn.SimulationSettings, got {type(settings).__name__}")
    if progress is not None:
        validate_callable("progress", progress, "a function of the share done, 0 to 1")
    validate_model(mbs)
    _refuse_within_a_run(mbs)
    if mbs.systemData.ODE2Size() == 0:
        raise RunError("mbs: the model has no coordinates yet; call mbs.Assemble() before solving")
    check_model(mbs)
    items = check_sensors(mbs)
    if not mbs.systemIsConsistent:  # Exudyn would assemble it within the run, which begins from other values then
        raise RunError(
            "mbs: an item was added or deleted since mbs.Assemble(); call it again before solving. Assemble sets "
            "initial values back to those of the nodes: find a preload again, or take go_on=True"
        )
    if items.damping is not None:
        items.damping.begin(mbs)
    return check_joints(mbs, [*items.bodies.values()], start(), judges_velocities=judges_velocities)


def _refuse_within_a_run(mbs: MainSystem) -> None:
    """Raise an error if a user function of a run starts another solver: it would change the state of that run."""
    frame: FrameType | None = sys._getframe()
    while frame is not None:
        if frame.f_globals.get("__name__") == _SOLVERS and frame.f_locals.get("mbs") is mbs:
            raise RunError(
                "mbs: a run of this model is under way, and one of its user functions starts another one, which would "
                "change its state. Let the first one end, or make a model of its own by AddSystem()"
            )
        frame = frame.f_back


def check_joints(
    mbs: MainSystem, bodies: Sequence[PartitionBody], start: float, *, judges_velocities: bool
) -> OpenJoints:
    """Raise an error for joints on nodes that were reduced away, for idle drives, and for a start that violates joints.

    Parameters
    ----------
    mbs : exudyn.MainSystem
        The model, assembled.
    bodies : sequence of PartitionBody
        All bodies of the model.
    start : float
        Time at which the run begins [s]: drives are functions of it.
    judges_velocities : bool
        Whether initial velocities must fit joints and drives.

    Returns
    -------
    OpenJoints
        Joints that are open by more than round-off.

    Raises
    ------
    InputError
    """
    if mbs.systemData.AEsize() == 0:
        return OpenJoints(mbs, [], np.zeros(0), bodies)
    exu = require("exudyn")
    point_markers = {marker: point for item in bodies for marker, point in item.point_markers.items()}
    size = min((float(np.ptp(item.body.points, axis=0).max()) for item in bodies), default=np.inf)
    constraints = [i for i in range(mbs.systemData.NumberOfObjects()) if len(mbs.systemData.GetObjectLTGAE(i))]
    switched = _may_be_switched(mbs)
    for number in constraints:
        _refuse_idle_drive(mbs, number)
        entry = mbs.GetObject(number)
        acts = switched or entry.get("activeConnector", True)
        for marker in entry.get("markerNumbers", []):
            if acts and int(marker) in point_markers:
                raise InputError(
                    f"{_object(mbs, number)} is attached to the body's point {point_markers[int(marker)]}, which was "
                    "reduced away: the body lacks its static answer to forces there and would be too stiff. Join "
                    "Partition.interface(fem, name, nodes) to the partition before reduce(), and take "
                    "CreateInterfaceMarker"
                )
    solver, settings = exu.MainSolverStatic(), exu.SimulationSettings()
    settings.staticSolver.verboseMode, settings.solution.file.write = 0, False
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.staticSolver.loadStepStart = start
    with _raise_run_errors():
        solver.InitializeSolver(mbs, settings)
        # the equation of what is switched off is its own force, which it may keep from a preload or an earlier run
        mbs.systemData.SetAECoordinates(np.zeros(mbs.systemData.AEsize()))
        gaps = _violations(mbs, solver)
    apart = abs(gaps)
    for number in constraints:
        rows = list(mbs.systemData.GetObjectLTGAE(number))
        if apart[rows].max() > _APART * size:
            raise InputError(
                f"{_object(mbs, number)} is open by {apart[rows].max():.4g} (m or rad) at the start, where bodies are "
                f"{size:.3g} m long: its markers do not meet. Check referencePosition and referenceRotation of the "
                "bodies and the markers' places"
            )
    if judges_velocities:
        _refuse_violating_velocities(mbs, solver, bodies, constraints, size)
    open_joints = []
    for number in constraints:
        equations = np.array(mbs.systemData.GetObjectLTGAE(number))
        if apart[equations].max() > _CLOSED * min(size, 1.0):
            label, gap = _object(mbs, number).rstrip(","), float(apart[equations].max())
            open_joints.append(OpenJoint(number, label, gap, equations, _force_sensors(mbs, number)))
    return OpenJoints(mbs, open_joints, gaps, bodies)


def _may_be_switched(mbs: MainSystem) -> bool:
    """Whether a function of the user's may switch joints on in a run."""
    functions = mbs.GetPreStepUserFunction(), mbs.GetPostStepUserFunction()
    return any(user_function(entry) is not None and not is_ours(entry) for entry in functions)


def _largest_velocity(mbs: MainSystem, bodies: Sequence[PartitionBody]) -> float:
    """Largest initial velocity [m/s or rad/s]: of bodies, as means over their mass, and of other items' coordinates."""
    initial = require("exudyn").ConfigurationType.Initial
    q, q_t = mbs.systemData.GetODE2Coordinates(initial), mbs.systemData.GetODE2Coordinates_t(initial)
    others, speeds = np.ones(len(q_t), dtype=bool), [0.0]
    for item in bodies:
        dofs = dofs_of(mbs, item)
        others[dofs] = False
        speeds.append(float(np.sqrt(2 * item.kinematics.kinetic_energy(q[dofs], q_t[dofs]) / item.body.total_mass)))
    return float(max(*speeds, abs(q_t[others]).max(initial=0.0)))


def _force_sensors(mbs: MainSystem, number: int) -> tuple[tuple[str, int], ...]:
    """Names and numbers of the sensors of an object's reactions."""
    kind = require("exudyn").OutputVariableType
    forces = (kind.Force, kind.ForceLocal, kind.Torque, kind.TorqueLocal)
    sensors = []
    for sensor in range(mbs.systemData.NumberOfSensors()):
        about = mbs.GetSensor(sensor)
        if about["sensorType"] == "Object" and int(about["objectNumber"]) == number:
            if about["outputVariableType"] in forces:
                sensors.append((about["name"], sensor))
    return tuple(sensors)


@contextlib.contextmanager
def _raise_run_errors() -> Iterator[None]:
    """Turn Exudyn's errors, and those of a user's functions that it calls, into a RunError."""
    try:
        yield
    except Exception as error:  # Exudyn wraps errors of user functions in its own types
        raise RunError(f"mbs: Exudyn cannot run the model: {cause(error)}") from error


def _violations(mbs: MainSystem, solver: MainSolver, *, velocity_level: bool = False) -> Array:
    """Values of the constraints at the start, (number of constraints,), or of their rates."""
    solver.ComputeAlgebraicEquations(mbs, velocityLevel=velocity_level)
    return np.array(solver.GetSystemResidual())[-mbs.systemData.AEsize() :]


def _refuse_idle_drive(mbs: MainSystem, number: int) -> None:
    """Raise an error if a joint has only that user function of its offset which Exudyn does not read."""
    about, names = mbs.GetObject(number), ("offsetUserFunction", "offsetUserFunction_t")
    given = {name for name in names if isinstance(about.get(name), dict)}
    level = int(bool(about.get("velocityLevel")))
    if given and names[level] not in given:
        raise InputError(
            f"{_object(mbs, number)} has an {names[1 - level]} and no {names[level]}: nothing would drive it, because "
            f"it constrains {('positions', 'velocities')[level]}. Give {names[level]}, the "
            f"{('offset', 'rate of the offset')[level]} as a function of time"
        )


def refuse_drives_by_rates(mbs: MainSystem, settings: SimulationSettings) -> None:
    """Raise an error if a run's settings let Exudyn solve rates of constraints, and those of a joint lack its drive.

    Raises
    ------
    InputError
    """
    if settings is None or not settings.timeIntegration.generalizedAlpha.useIndex2Constraints:
        return
    for number in range(mbs.systemData.NumberOfObjects()):
        about = mbs.GetObject(number)
        told = "constraintUserFunction" in about or isinstance(about.get("offsetUserFunction_t"), dict)
        if is_timed(about) and (about["objectType"] == "JointGeneric" or not told):
            raise InputError(
                f"settings: with timeIntegration.generalizedAlpha.useIndex2Constraints Exudyn solves rates of "
                f"constraints, and those of {_object(mbs, number).removeprefix('mbs: ')} lack its drive. Leave it False"
            )


def _refuse_violating_velocities(
    mbs: MainSystem, solver: MainSolver, bodies: Sequence[PartitionBody], constraints: Sequence[int], size: float
) -> None:
    """Raise an error if initial velocities violate a joint, or differ from the speed of its drive."""
    largest = _largest_velocity(mbs, bodies)
    round_off = _ROUND_OFF * min((size * 2 * np.pi * item.body.f_cut for item in bodies), default=_USUAL)
    share, look = _LOOK
    look = share / (2 * np.pi * max(item.body.f_cut for item in bodies)) if bodies else look
    driven = [number for number in constraints if is_timed(entry := mbs.GetObject(number)) and entry["activeConnector"]]
    with _raise_run_errors():
        residual = abs(_rates(mbs, solver, driven))
        speeds = {number: _drive(mbs, number, look) for number in driven}
    for number in constraints:
        rows, drive = mbs.systemData.GetObjectLTGAE(number), ""
        excess = residual[list(rows)].max()
        if number in speeds:
            speed, unsure = speeds[number]
            excess = (abs(_row_rates(mbs, number) + speed) - unsure).max()
            drive = f"Its drive begins with {abs(speed).max():.4g}. "
        if excess > max(_VIOLATION * largest, round_off):
            raise InputError(
                f"{_object(mbs, number)} is violated by the initial velocities, by {excess:.4g} (m/s or rad/s): Exudyn "
                f"would begin with an impulse. {drive}Give all bodies of the mechanism initialVelocity, of their "
                "centres of mass, and initialAngularVelocity that fit the joints and drives"
            )


def _rates(mbs: MainSystem, solver: MainSolver, driven: Sequence[int]) -> Array:
    """Rates of the constraints at the start, (number of constraints,); those of driven joints are none.

    Exudyn leaves the speed of a drive on position level out of them, or cannot compute them.
    """
    switch = "activeConnector"
    were_on = {number: mbs.GetObjectParameter(number, switch) for number in driven}
    try:
        for number in driven:
            mbs.SetObjectParameter(number, switch, False)
        return _violations(mbs, solver, velocity_level=True)
    finally:
        for number, on in were_on.items():
            mbs.SetObjectParameter(number, switch, on)


def _row_rates(mbs: MainSystem, number: int) -> Array:
    """Rates of a joint's equations by the initial velocities, (k,), without that of its drive."""
    exu, data = require("exudyn"), mbs.systemData
    J = np.asarray(mbs.ComputeItem(exu.ObjectIndex(number), exu.ComputeItemType.ConstraintJacobian))
    velocities: Array = data.GetODE2Coordinates_t(exu.ConfigurationType.Initial)[data.GetObjectLTGODE2(number)]
    return J @ velocities


def _drive(mbs: MainSystem, number: int, look: float) -> tuple[Array, Array]:
    """Speed with which the drive of a joint begins, (k,), and a bound on its error, from the time `look` on [s]."""
    exu, data = require("exudyn"), mbs.systemData
    start, values, kind = data.GetTime(), [], exu.ComputeItemType.AlgebraicEquations
    try:
        for share in (0, 1 / 4, 1 / 2, 1):
            data.SetTime(start + share * look)
            values.append(np.array(mbs.ComputeItem(exu.ObjectIndex(number), kind)))
    finally:
        data.SetTime(start)
    first, early, middle, late = values
    rough, fine = (4 * middle - 3 * first - late) / look, (4 * early - 3 * first - middle) / (look / 2)
    return fine, abs(fine - rough)


def _object(mbs: MainSystem, number: int) -> str:
    about = mbs.GetObject(number)
    return f"mbs: {about['objectType']} {about['name']!r}, object {number},"
