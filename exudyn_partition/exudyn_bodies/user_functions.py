"""Forces of a partition body that Exudyn calls in each step: inertia, elastic coupling and damping."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
import scipy.sparse as sp

from ..errors import RunError
from ..frames.damping import Damping
from ..frames.floating import ActingMass
from ..frames.inertia_forces import InertiaForces, StepStart
from ..frames.kinematics import Rows
from ..support.arrays import Array
from ..support.foreign import Coordinates, Exudyn, ItemIndex, MainSystem, MatrixContainer, UserFunction
from ..support.optional import require
from .item_work import acts_on_constant_mass
from .model import BodyItem, coordinate_slices
from .stiffening_steps import SteppedStiffening

Functions = dict[str, UserFunction]  # by their parameter names in ObjectGenericODE2

_BOUND = 1e90  # of the length of coordinates and velocities: products of three of them are numbers
RIGID = 6  # coordinates of a NodeRigidBodyRotVecLG, rotation included


@lru_cache
def _velocities_at(places: tuple[int, ...], n: int) -> Array | slice:
    """Places of rotation and n elastic coordinates among the model's, from those of the body's nodes."""
    rigid, *modal = places
    if modal == [rigid + RIGID]:
        return slice(rigid + 3, rigid + RIGID + n)  # is read where it lies
    return np.concatenate([np.arange(rigid + 3, rigid + RIGID), *(np.arange(n) + at for at in modal)])


def _runs_verlet(mbs: MainSystem, t: float) -> bool:
    """Whether the solver that asks for forces at t is VelocityVerlet."""
    solver = mbs.sys.get("dynamicSolver")
    if solver is None:
        raise RunError(
            "mbs: a body with frame='floating' that moves needs to know Exudyn's solver; leave storeSolver=True in "
            "mbs.SolveDynamic, or put a solver of your own into mbs.sys['dynamicSolver']. For statics take "
            "ep.solve_static, in which bodies are at rest"
        )
    return "VelocityVerlet" in solver.GetSolverName() and solver.it.currentTime == t


def inertia_functions(
    exu: Exudyn,
    item: BodyItem,
    acting: ActingMass,
    forces: InertiaForces,
    stiffness: Callable[[], Array] | None = None,
    damping: Callable[[], Damping] | None = None,
    stiffening: SteppedStiffening | None = None,
) -> Functions:
    """User functions for inertia forces of a floating frame; with the other forces of the body that are given."""
    start_of_step, nodes = exu.ConfigurationType.StartOfStep, item.nodes

    @lru_cache(maxsize=1)
    def of_damping(damping: Damping) -> Array:  # another one where joints are others
        value: Array = damping.matrix().toarray()
        return value

    def verlet_start(mbs: MainSystem, t: float, n: int) -> StepStart:
        """Start of a step of VelocityVerlet, which gives velocities in its middle; for n elastic coordinates."""
        data, columns = mbs.systemData, _velocities_at(tuple([mbs.GetNodeODE2Index(node) for node in nodes]), n)
        q = data.GetODE2Coordinates(start_of_step, copy=False)[columns]
        q_t = data.GetODE2Coordinates_t(start_of_step, copy=False)[columns]
        q_tt = data.GetODE2Coordinates_tt(start_of_step, copy=False)[columns]
        return StepStart((t - data.GetTime(start_of_step)) / 2, q[3:], q_t, q_tt)

    def force(mbs: MainSystem, t: float, i: ItemIndex, q: Coordinates, q_t: Coordinates) -> list[float]:
        now, v = np.asarray(q), np.asarray(q_t)
        if np.count_nonzero(v[3:]):  # none in a static solution
            start = None
            if _runs_verlet(mbs, t):
                if not np.vdot(now, now) + np.vdot(v, v) < _BOUND**2:  # NaN is not; dot warns
                    raise RunError(
                        "coordinates of a body with frame='floating' are beyond all bounds: the run is unstable"
                    )
                start = verlet_start(mbs, t, len(now) - RIGID)
            result = forces.on_body(now, v, start, constant_mass=acts_on_constant_mass(mbs, item, acting))
            if damping is not None:
                result -= damping().force(v)
        else:
            result = np.zeros(len(now))
        if stiffness is not None:
            result[RIGID:] -= forces.elastic(now[RIGID:])
        if stiffening is not None:
            result[RIGID:] -= stiffening.force(mbs, t, now[RIGID:])
        return _listed(result)

    def jacobian(
        mbs: MainSystem, t: float, i: ItemIndex, q: Coordinates, q_t: Coordinates, fODE2: float, fODE2_t: float
    ) -> MatrixContainer:
        z, v = np.asarray(q)[RIGID:], np.asarray(q_t)[3:]
        by_z, by_velocity = forces.derivatives(v[:3], z, v[3:])
        result = np.zeros((RIGID + len(z),) * 2)
        result[3:, 3:] = -fODE2_t * by_velocity
        result[3:, RIGID:] -= fODE2 * by_z
        if stiffness is not None:
            result[RIGID:, RIGID:] += fODE2 * stiffness()
        if stiffening is not None:
            result[RIGID:, RIGID:] += fODE2 * stiffening.tangent(mbs, z, fODE2_t)
        if damping is not None:
            result += fODE2_t * of_damping(damping())
        return sparse_container(*terms(result), len(result))

    return {"forceUserFunction": force, "jacobianUserFunction": jacobian}


def _listed(force: Array) -> list[float]:
    """Force as a list, which Exudyn takes faster than an array."""
    values: list[float] = force.tolist()
    return values


def terms(matrix: Rows) -> tuple[Array, Array, Array]:
    """Rows, columns and values of the terms of a matrix that are not zero."""
    if sp.issparse(matrix):
        entries = sp.coo_matrix(matrix)
        return entries.row, entries.col, entries.data
    rows, columns = np.nonzero(matrix)
    return rows, columns, matrix[rows, columns]


def sparse_container(rows: Array, columns: Array, values: Array, n: int) -> MatrixContainer:
    """Exudyn's sparse form of an (n, n) matrix from its terms, which are summed; SciPy's would take much longer."""
    container = require("exudyn").MatrixContainer()
    container.SetWithSparseMatrix(np.column_stack([rows, columns, values]), n, n)
    return container


def stiffening_functions(stiffening: SteppedStiffening) -> Functions:
    """User functions for the geometric stiffness of a body of few coordinates in an inertial frame."""

    def force(mbs: MainSystem, t: float, i: ItemIndex, q: Coordinates, q_t: Coordinates) -> list[float]:
        return _listed(-stiffening.force(mbs, t, np.asarray(q)))

    def jacobian(
        mbs: MainSystem, t: float, i: ItemIndex, q: Coordinates, q_t: Coordinates, fODE2: float, fODE2_t: float
    ) -> MatrixContainer:
        return sparse_container(*terms(fODE2 * stiffening.tangent(mbs, np.asarray(q), fODE2_t)), len(q))

    return {"forceUserFunction": force, "jacobianUserFunction": jacobian}


def coupling_functions(
    item: BodyItem,
    stiffness: sp.csr_matrix,
    damping: Callable[[], Damping] | None,
    stiffening: SteppedStiffening | None,
) -> Functions:
    """User functions for the part of stiffness and damping that is not diagonal, and for geometric stiffness.

    The force reads Exudyn's coordinates in place, because converting the list that a user function receives costs more
    than the product itself.
    """
    stiffness = sp.csr_matrix(stiffness)
    stiffness.eliminate_zeros()
    constant = terms(stiffness)

    @lru_cache(maxsize=1)
    def of_damping(damping: Damping) -> tuple[Array, Array, Array]:  # another one where joints are others
        return terms(damping.matrix())

    def force(mbs: MainSystem, t: float, i: ItemIndex, q: Coordinates, q_t: Coordinates) -> list[float]:
        slices = coordinate_slices(mbs, item)
        coordinates = mbs.systemData.GetODE2Coordinates(copy=False)
        of_body = np.concatenate([coordinates[s] for s in slices])
        result = -(stiffness @ of_body)
        if stiffening is not None:
            result -= stiffening.force(mbs, t, of_body)
        if damping is not None:
            velocities = mbs.systemData.GetODE2Coordinates_t(copy=False)
            result -= damping().force(np.concatenate([velocities[s] for s in slices]))
        return _listed(result)

    def jacobian(
        mbs: MainSystem, t: float, i: ItemIndex, q: Coordinates, q_t: Coordinates, fODE2: float, fODE2_t: float
    ) -> MatrixContainer:
        parts = [(fODE2, constant)]
        if stiffening is not None:
            parts.append((fODE2, terms(stiffening.tangent(mbs, np.asarray(q), fODE2_t))))
        if damping is not None:
            parts.append((fODE2_t, of_damping(damping())))
        rows, columns = (np.concatenate([part[axis] for _, part in parts]) for axis in (0, 1))
        values = np.concatenate([factor * part[2] for factor, part in parts])
        return sparse_container(rows, columns, values, stiffness.shape[0])

    return {"forceUserFunction": force, "jacobianUserFunction": jacobian}
