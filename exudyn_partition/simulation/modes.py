"""Natural modes about the initial state, with closed contacts."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator

import numpy as np
import scipy.linalg

from ..algebra.blas_threads import one_blas_thread
from ..errors import ModelLimitWarning, RunError
from ..exudyn_bodies.model import coordinate_slices, validate_model
from ..exudyn_bodies.reactions import Reactions
from ..exudyn_contacts.model_run import runs_of
from ..exudyn_contacts.partition_contact import partition_items
from ..exudyn_contacts.turning_rows import stiffness_of_turning_rows
from ..frames.floating import FloatingKinematics
from ..support.arrays import Array
from ..support.checks import validate_flag
from ..support.foreign import MainSolver, MainSystem
from ..support.optional import require
from ..support.warn import warn
from .hooks import silence
from .mode_limits import pressed_bodies, warn_of_turns
from .result import called

_SPIN = 0.01  # rate of rotation by a frequency above which this changes noticeably
_RIGID = 1e-6  # share of the highest frequency below which a mode is rigid motion
_LEAST_MASS = 1e-12  # share of the mean on the diagonal
_NEUTRAL = 1e-12  # share of the largest stiffness: what has less is free to move, and gives no answer to forces


def natural_modes(mbs: MainSystem, *, slipping: bool = False) -> tuple[Array, Array]:
    """Find natural frequencies and modes of small vibration about the initial state, such as that of a preload.

    Rows that are closed there stay closed. With friction, all of them stick, also those that slipped under the preload:
    the least vibration lets them stick, as far as it does not reach the limit of friction again. Joints hold what they
    hold, and their reactions keep their directions in space where bodies turn, as loads do: a link that hangs swings.
    Forces of contacts follow their rows, to other levers and directions: a ball that lies in a bore swings, too.
    Damping is left out. Call it after `solve_static(mbs, update_initial=True)`. Otherwise reactions are those that
    balance the forces of the initial state, after a linear answer of what joints allow.

    Parameters
    ----------
    mbs : exudyn.MainSystem
        The model, assembled.
    slipping : bool
        Whether rows that slipped in the last load step go on slipping. Their stiffness is not symmetric; then the modes
        are those of its symmetric part.

    Returns
    -------
    frequencies : (k,) array
        All of them, ascending [Hz]; a negative one, beyond round-off, is that of an unstable motion.
    modes : (nq, k) array
        Coordinates of the model, in columns; of unit modal mass.

    Raises
    ------
    InputError
        If an argument has the wrong type.
    RunError
        If the model is not assembled, if contacts have multipliers, which have no stiffness, if coordinates have no
        mass or are of first order, or if `slipping` does not follow a run of `solve_static` with `update_initial=True`.

    Warns
    -----
    ModelLimitWarning
        If a body turns in the initial state, at more than a hundredth of an elastic frequency. If a motion is unstable
        with a contact by rows, which a round body has where it would roll. If forces of contacts act on turns of a body
        in an inertial frame, so that frequencies of these are wrong by more than 5 %.
    """
    validate_model(mbs)
    validate_flag("slipping", slipping)
    if not mbs.systemIsConsistent:
        raise RunError("mbs: it is not assembled; call mbs.Assemble() before natural_modes")
    contacts = partition_items(mbs)[1]
    ahead = ", ".join(repr(contact.name) for contact in contacts if contact.mechanics.ahead)
    if ahead:
        raise RunError(
            f"contact {ahead}: multipliers have no stiffness, so that natural_modes has no modes with them. Take "
            "formulation='compliance'"
        )
    exu, runs, last = require("exudyn"), runs_of(mbs), mbs.sys.get("staticSolver")
    initial, settings = mbs.systemData.GetODE2Coordinates(exu.ConfigurationType.Initial), exu.SimulationSettings()
    settings.solution.file.write = settings.solution.sensors.active = False
    if slipping:
        run = runs.now(mbs)
        if not (run.method == "static" and run.has_steps and run.ended_in(initial)):
            raise RunError("slipping: which rows slip is known only after solve_static(mbs, update_initial=True)")
    solver = exu.MainSolverStatic()
    with one_blas_thread(), silence(True), ignore_slips() if slipping else runs.linearise_aside(mbs):
        for contact in () if slipping else contacts:
            runs.at_work(contact).mechanics.sticks = True
        mbs.sys["staticSolver"] = solver
        try:
            solver.InitializeSolver(mbs, settings)
            M, K, allowed = linearised(mbs, solver)
            pressed = [*pressed_bodies(mbs, runs.now(mbs), contacts)]
            K += allowed.T @ stiffness_of_turning_rows(mbs, runs.now(mbs)) @ allowed
            solver.FinalizeSolver(mbs, settings)
        finally:
            mbs.sys["staticSolver"] = last
            if last is None:
                del mbs.sys["staticSolver"]
    try:
        squares, modes = scipy.linalg.eigh((K + K.T) / 2, M)
    except scipy.linalg.LinAlgError as error:
        raise RunError("mbs: coordinates have no mass, so that natural_modes finds no frequencies") from error
    frequencies = np.sign(squares) * np.sqrt(abs(squares)) / (2 * np.pi)
    modes = allowed @ modes
    _warn_of_spin(mbs, frequencies)
    warn_of_turns(pressed, frequencies, modes)
    return frequencies, modes


def _warn_of_spin(mbs: MainSystem, frequencies: Array) -> None:
    """Warn if a body turns in the initial state at a rate that changes frequencies, (k,)."""
    q_t = mbs.systemData.GetODE2Coordinates_t(require("exudyn").ConfigurationType.Initial)
    for item in partition_items(mbs)[0]:
        if isinstance(item.kinematics, FloatingKinematics):
            rate = float(np.linalg.norm(q_t[next(iter(coordinate_slices(mbs, item)))][3:6]))
            elastic = frequencies[frequencies > _RIGID * frequencies.max(initial=0.0)]
            if rate > _SPIN * 2 * np.pi * elastic.min(initial=np.inf):
                warn(
                    f"{called(item)} turns at {rate:.3g} rad/s in the initial state, and these are modes of a body "
                    f"at rest, from {elastic.min():.3g} Hz on: gyroscopic and centrifugal forces change them",
                    ModelLimitWarning,
                )


@contextlib.contextmanager
def ignore_slips() -> Iterator[None]:
    """Within the block, the stiffness of rows that slip is asked for on purpose, and no warning tells of it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelLimitWarning)
        yield


def linearised(mbs: MainSystem, solver: MainSolver, reactions: bool = True) -> tuple[Array, Array, Array]:
    """Mass and stiffness in the solver's present state, (k, k), of motions that joints allow, (n, k), its last value.

    The stiffness has that of loads, and with `reactions` that of joints, see `Reactions`.

    Raises
    ------
    RunError
        If the model has coordinates of first order.
    """
    n, joints = mbs.systemData.ODE2Size(), mbs.systemData.AEsize()
    if mbs.systemData.ODE1Size():
        raise RunError("mbs: coordinates of first order have no natural modes; remove nodes such as NodeGenericODE1")
    solver.ComputeMassMatrix(mbs)
    M = np.array(solver.GetSystemMassMatrix())
    solver.ComputeJacobianODE2RHS(
        mbs, scalarFactor_ODE2=-1, scalarFactor_ODE2_t=0, scalarFactor_ODE1=0, computeLoadsJacobian=1
    )
    if not joints:
        return M, np.array(solver.GetSystemJacobian()), np.eye(n)
    solver.ComputeJacobianAE(
        mbs, scalarFactor_ODE2=1.0, scalarFactor_ODE2_t=0.0, scalarFactor_ODE1=0.0, velocityLevel=False
    )
    system = np.array(solver.GetSystemJacobian())
    K, C = system[:n, :n], system[len(system) - joints :, :n]
    mass = np.diag(M)
    unit = 1 / np.sqrt(np.maximum(mass, _LEAST_MASS * mass.mean()))  # of coordinates, so that units of length drop out
    allowed = unit[:, None] * scipy.linalg.null_space(C * unit)
    if reactions:
        forces = _forces_at_rest(mbs, solver)
        # Without the linear answer of motions that joints allow, reactions would be those of a fall.
        answer = allowed @ np.linalg.lstsq(allowed.T @ K @ allowed, allowed.T @ forces, rcond=_NEUTRAL)[0]
        multipliers = np.linalg.lstsq((C * unit).T, unit * (forces - K @ answer))[0]
        K = K + Reactions.of(mbs).stiffness(multipliers)
    return allowed.T @ M @ allowed, allowed.T @ K @ allowed, allowed


def _forces_at_rest(mbs: MainSystem, solver: MainSolver) -> Array:
    """Forces on the coordinates in the present state without velocities, (n,); joints have none in it."""
    data = mbs.systemData
    speeds = data.GetODE2Coordinates_t()
    data.SetODE2Coordinates_t(np.zeros_like(speeds))
    try:
        solver.ComputeODE2RHS(mbs)
    finally:
        data.SetODE2Coordinates_t(speeds)
    return np.array(solver.GetSystemResidual())[: len(speeds)]
