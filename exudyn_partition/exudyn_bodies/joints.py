"""Joints and other constraints of an Exudyn model as rows on the coordinates that they act on, in explicit steps.

These are the rows G_J of the paper (eq. 10, 18, 28). In place of gamma_J, `central_differences` closes the joints at
the end of each step. In implicit steps Exudyn has its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import compress

import numpy as np
import scipy.sparse as sp
import scipy.sparse.csgraph
import scipy.sparse.linalg
from scipy.linalg import lapack

from ..algebra.complementarity import regularised
from ..algebra.products import hold_rows
from ..algebra.sparse.assembly import assembled
from ..errors import InputError
from ..frames.rotations import turned
from ..support.arrays import Array
from ..support.foreign import Exudyn, ItemEntry, MainSystem, ObjectIndex
from ..support.optional import require
from .model import registered
from .rotation_vectors import rotation_vectors

HOLONOMIC = (
    "ConnectorCoordinate", "ConnectorCoordinateVector", "ConnectorDistance", "JointGeneric", "JointPrismatic2D",
    "JointPrismaticX", "JointRevolute2D", "JointRevoluteZ", "JointSpherical",
)  # fmt: skip
_LINEAR = ("ConnectorCoordinate", "ConnectorCoordinateVector")  # unless they have user functions or quadratic terms
_TIMED = ("offsetUserFunction", "constraintUserFunction")


class Joints:
    """Algebraic equations g(q, t) = 0 of a model. Their rows C give the rates C q_t + dg/dt.

    The coordinates here are those that joints act on, and those that mass couples with them. Velocities of a
    NodeRigidBodyRotVecLG are Exudyn's: the angular velocity in the body's axes.

    Parameters
    ----------
    mbs : exudyn.MainSystem
        An assembled model.

    Attributes
    ----------
    n : int
        Number of equations.
    dofs : (k,) int array
        Numbers of these coordinates among the model's.
    linear : bool
        Whether the rows are constant and g is linear in the coordinates.
    constant : bool
        Whether g does not depend on time either; a user may still switch joints, or set their offsets.
    C, push : (n, k), (k, n) arrays
        Present rows, and the accelerations M^-1 C' that unit multipliers cause.
    scale : (n,) array
        Square roots of the masses of the rows, 1 / sqrt(diagonal of C M^-1 C'); zero for inactive rows.
    reach : float
        Size of the numbers that rows are differences of: the farthest place of a body [m], or 1 rad if that is more.

    Raises
    ------
    InputError
        If the model has a constraint that explicit steps cannot take.
    """

    def __init__(self, mbs: MainSystem) -> None:
        exu, data = require("exudyn"), mbs.systemData
        self._mbs, self.n = mbs, data.AEsize()
        self._kind = exu.ComputeItemType
        self._objects: list[tuple[ObjectIndex, Array, Array, bool]] = []  # number, rows, coordinates, whether linear
        self._timed = []
        for number in map(exu.ObjectIndex, range(data.NumberOfObjects())):
            rows, columns = np.array(data.GetObjectLTGAE(number), int), np.array(data.GetObjectLTGODE2(number), int)
            if rows.size:
                entry = mbs.GetObject(number)
                _validate(number, entry)
                self._objects.append((number, rows, columns, _is_linear(entry)))
                if is_timed(entry):
                    self._timed.append(int(number))
        if sum(len(rows) for _, rows, *_ in self._objects) < self.n:
            raise InputError(
                "method: explicit steps take only algebraic equations of joints and constraints. The model has "
                "others (NodeGenericAE); use method='implicit'"
            )
        self.linear = all(linear for *_, linear in self._objects)
        self.constant = self.linear and not self._timed
        self._find_masses()
        self._find_rotation_vectors(exu)
        self._constant: dict[int, Array] = {}
        self._were_active: list[bool] | None = None
        self.C = np.full((self.n, len(self.dofs)), np.nan)
        self.reach = _reach(mbs)
        self._rest: Array | None = None
        self._offsets: list[bytes] = []
        none, nothing = np.zeros((0, 0)), np.zeros(0)  # so that the loop is compiled before a run begins
        hold_rows(none, nothing, 0.0, none, none, nothing, (0.0, 0.0, 0.0), (nothing,) * 3, 0.0, self.dofs[:0])

    def _find_masses(self) -> None:
        """Find the coordinates that joints act on, constant masses, and bodies whose mass depends on coordinates."""
        n = self._mbs.systemData.ODE2Size()
        varying, constant, linked = [], [], []
        for number, columns, mass in _masses(self._mbs):
            if mass is None:
                varying.append((number, columns))
                linked.append((columns, np.ones((len(columns),) * 2)))
            else:
                constant.append((columns, mass))
        M = assembled(constant, n)
        groups = scipy.sparse.csgraph.connected_components(M + assembled(linked, n), directed=False)[1]
        touched = groups[np.concatenate([columns for *_, columns, _ in self._objects])]
        self.dofs = np.flatnonzero(np.isin(groups, touched))
        self._place = np.zeros(n, dtype=int)
        self._place[self.dofs] = np.arange(len(self.dofs))
        self._varying = [(number, self._place[c]) for number, c in varying if groups[c[0]] in touched]
        of_varying = np.isin(groups[self.dofs], [groups[self.dofs[c[0]]] for _, c in self._varying])
        self._varies, self._fixed = np.flatnonzero(of_varying), np.flatnonzero(~of_varying)
        M = M[self.dofs][:, self.dofs]
        self._solve_fixed = scipy.sparse.linalg.splu(sp.csc_matrix(M[self._fixed][:, self._fixed])).solve
        self._other_mass = M[self._varies][:, self._varies].toarray()
        self._blocks: list[Array] = []

    def _mass_changed(self) -> bool:
        """Update the masses of the bodies whose mass varies; return whether they have changed."""
        blocks = [self._mbs.ComputeItem(number, self._kind.MassMatrix) for number, _ in self._varying]
        if self._blocks and all(map(np.array_equal, blocks, self._blocks)):
            return False
        self._blocks, self._varying_mass = blocks, self._other_mass.copy()
        for (_, columns), block in zip(self._varying, blocks, strict=True):
            at = np.searchsorted(self._varies, columns)
            self._varying_mass[np.ix_(at, at)] += block
        return bool(blocks)

    def _find_rotation_vectors(self, exu: Exudyn) -> None:
        """Find the rotation vectors among the coordinates, and their reference values."""
        first = np.intersect1d([*rotation_vectors(self._mbs)], self.dofs).astype(int)
        self._turns = self._place[first][:, None] + np.arange(3)
        references = self._mbs.systemData.GetODE2Coordinates(exu.ConfigurationType.Reference)
        self._references = references[first[:, None] + np.arange(3)]

    def update(self) -> bool:
        """Compute rows and masses at the present coordinates; return whether they have changed."""
        active = [bool(self._mbs.GetObjectParameter(joint[0], "activeConnector")) for joint in self._objects]
        if self.linear and not self._varying and active == self._were_active:
            return False
        self._were_active, self._active = active, [*compress(self._objects, active)]
        C = np.zeros_like(self.C)
        for number, rows, columns, linear in self._active:
            J = self._constant.get(int(number)) if linear else None
            if J is None:
                J = np.asarray(self._mbs.ComputeItem(number, self._kind.ConstraintJacobian))
                if linear:
                    self._constant[int(number)] = J
            np.add.at(C, (rows[:, None], self._place[columns]), J)  # a joint may name a coordinate twice
        if not self._mass_changed() and np.array_equal(C, self.C):
            return False
        self.C, self.push, self._rest = C, np.empty(C.shape[::-1]), None
        if self._fixed.size:
            self.push[self._fixed] = self._solve_fixed(np.ascontiguousarray(C[:, self._fixed].T))
        if self._varies.size:
            self.push[self._varies] = np.linalg.solve(self._varying_mass, C[:, self._varies].T)
        W = C @ self.push
        used = C.any(axis=1)
        self.scale = np.where(used, 1 / np.sqrt(np.where(used, W.diagonal(), 1.0)), 0.0)
        W = self.scale[:, None] * W * self.scale + np.diag(np.where(used, 0.0, 1.0))
        self._factor = lapack.dpotrf(regularised(W), lower=1)[0]  # joints may be redundant
        return True

    def solve(self, rhs: Array) -> Array:
        """Multipliers, (n,) or (n, m), that give the rows the accelerations rhs, of the same shape."""
        scale = self.scale if rhs.ndim == 1 else self.scale[:, None]
        value: Array = scale * lapack.dpotrs(self._factor, scale * rhs, lower=1)[0]
        return value

    def rest(self) -> Array:
        """Return g - C q, (n,), if it is `constant`; joints are asked again when one has another offset."""
        offsets = [np.asarray(self._mbs.GetObjectParameter(joint[0], "offset")).tobytes() for joint in self._active]
        if self._rest is None or offsets != self._offsets:
            q = self._mbs.systemData.GetODE2Coordinates(copy=False)[self.dofs]
            self._rest, self._offsets = self.residual(q, np.zeros(len(q))) - self.C @ q, offsets
        return self._rest

    def hold(
        self, rest: Array, shares: tuple[float, float, float], by: float, step: float, state: tuple[Array, Array, Array]
    ) -> tuple[Array, Array]:
        """Push velocities and accelerations by multipliers that answer to the rows.

        Parameters
        ----------
        rest : (n,) array
        shares : three floats
            Of coordinates, velocities and accelerations in x, whose rest + C x is answered.
        by : float
            Multipliers give the rows this times that as accelerations.
        step : float
            [s]
        state : three (nq,) arrays
            The model's coordinates, velocities and accelerations; the last two are changed.

        Returns
        -------
        (n,) array, (k,) array
            Multipliers, and the accelerations by them.
        """
        return hold_rows(self.C, rest, by, self.push, self._factor, self.scale, shares, state, step, self.dofs)

    def residual(self, start: Array, way: Array) -> Array:
        """g, (n,), at the present time, after a step of `way`, (k,), from the coordinates `start`, (k,).

        Exudyn evaluates it, so the model has the coordinates after the step meanwhile; in the end it has `start`.
        """
        q = self._mbs.systemData.GetODE2Coordinates(copy=False)
        end = start + way
        for place, reference in zip(self._turns, self._references, strict=True):
            end[place] = turned(reference + start[place], way[place]) - reference
        q[self.dofs] = end
        g = np.zeros(self.n)
        for number, rows, *_ in self._active:
            g[rows] = self._mbs.ComputeItem(number, self._kind.AlgebraicEquations)
        q[self.dofs] = start
        return g

    def drift(self, step: float) -> Array:
        """dg/dt, (n,), of equations that depend on time, as the mean over a step centred at the present time."""
        rate = np.zeros(self.n)
        if self._timed:
            data = self._mbs.systemData
            t = data.GetTime()
            for side in (-1, 1):
                data.SetTime(t + side * step / 2)
                for number, rows, *_ in self._active:
                    if int(number) in self._timed:
                        rate[rows] += side / step * self._mbs.ComputeItem(number, self._kind.AlgebraicEquations)
            data.SetTime(t)
        return rate


def is_timed(entry: ItemEntry) -> bool:
    """Whether a user function of time drives a joint on position level; see `mbs.GetObject` for its entry."""
    return not entry.get("velocityLevel") and any(isinstance(entry.get(name), dict) for name in _TIMED)


def _reach(mbs: MainSystem) -> float:
    """Farthest place of the bodies at the start [m], or 1 rad."""
    places = [np.ones(1)]
    for item in registered(mbs).bodies.values():
        places.append(abs(item.kinematics.position) + abs(item.body.points).max(axis=0))
    for number in range(mbs.systemData.NumberOfNodes()):
        places.append(np.abs(mbs.GetNode(number).get("referenceCoordinates", [])))
    return float(np.concatenate(places).max())


def mass_and_rows(mbs: MainSystem) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Mass matrix, (n, n), and rows of all algebraic equations, (nAE, n), of a model at its present coordinates.

    Joints that are switched off have rows of zeros.
    """
    data, kind = mbs.systemData, require("exudyn").ComputeItemType
    n = data.ODE2Size()
    masses = ((at, mbs.ComputeItem(i, kind.MassMatrix) if mass is None else mass) for i, at, mass in _masses(mbs))
    M = assembled(masses, n)
    places: list[tuple[Array, Array, Array]] = [(np.zeros(0, dtype=int), np.zeros(0, dtype=int), np.zeros(0))]
    for number, rows, columns, _ in constraints(mbs):
        J = np.asarray(mbs.ComputeItem(number, kind.ConstraintJacobian))
        places.append((np.repeat(rows, len(columns)), np.tile(columns, len(rows)), J.ravel()))
    rows, columns, values = (np.concatenate(part) for part in zip(*places, strict=True))
    C = sp.csr_matrix((values, (rows, columns)), shape=(data.AEsize(), n))  # a joint may name a coordinate twice
    C.eliminate_zeros()
    return M, C


def constraints(mbs: MainSystem) -> Iterator[tuple[ObjectIndex, Array, Array, ItemEntry]]:
    """Number, rows, (m,), coordinates, (k,), and entry of each object with algebraic equations that is switched on."""
    exu, data = require("exudyn"), mbs.systemData
    for number in map(exu.ObjectIndex, range(data.NumberOfObjects())):
        rows = np.array(data.GetObjectLTGAE(number), dtype=int)
        entry = mbs.GetObject(number) if rows.size else {}
        active = rows.size and entry.get("activeConnector", True)
        if active and exu.ComputeItemType.ConstraintJacobian in mbs.ComputeItem(number):
            yield number, rows, np.array(data.GetObjectLTGODE2(number), dtype=int), entry


def _masses(mbs: MainSystem) -> Iterator[tuple[ObjectIndex, Array, Array | sp.coo_matrix | None]]:
    """Number, coordinates and mass matrix of each object with mass; None in place of a mass that may vary."""
    exu, data = require("exudyn"), mbs.systemData
    for number in map(exu.ObjectIndex, range(data.NumberOfObjects())):
        columns = np.array(data.GetObjectLTGODE2(number), int)
        if columns.size and exu.ComputeItemType.MassMatrix in mbs.ComputeItem(number):
            yield number, columns, _constant_mass(mbs.GetObject(number), len(columns))


def _validate(number: ObjectIndex, entry: ItemEntry) -> None:
    """Raise InputError if explicit steps cannot take the algebraic equations of an object."""
    kind, name = entry["objectType"], f"object {int(number)} {entry['name']!r}"
    if kind == "RigidBody":
        raise InputError(
            f"method: {name} rotates by Euler parameters. Their mass matrix is singular; for explicit steps create it "
            "with nodeType=exu.NodeType.RotationRotationVector, or use method='implicit'"
        )
    if kind not in HOLONOMIC or entry.get("velocityLevel"):
        what = "constrains velocities" if entry.get("velocityLevel") else f"is of type {kind}"
        raise InputError(
            f"method: {name} {what}. Explicit steps take only {', '.join(HOLONOMIC)} on position level; use "
            "method='implicit'"
        )


def _is_linear(entry: ItemEntry) -> bool:
    quadratic = any(np.size(entry.get(f"quadraticTermMarker{i}", [])) for i in (0, 1))
    return entry["objectType"] in _LINEAR and not quadratic and not isinstance(entry.get(_TIMED[1]), dict)


def _constant_mass(entry: ItemEntry, n: int) -> Array | sp.coo_matrix | None:
    """Mass matrix, (n, n), from GetObject, because ComputeItem returns no sparse matrices; None if it may vary."""
    kind = entry["objectType"]
    if kind in ("Mass1D", "MassPoint", "MassPoint2D"):
        return np.asarray(entry["mass"] * np.eye(n))
    if kind == "RotationalMass1D":
        return np.asarray(entry["inertia"] * np.eye(n))
    if kind == "FFRFreducedOrder" and is_massless(entry):
        return sp.coo_matrix((n, n))
    if kind == "RigidBody2D" and not np.any(entry.get("centerOfMass", 0.0)):
        return np.diag([entry["mass"], entry["mass"], entry["inertia"]])
    if kind != "GenericODE2" or isinstance(entry["massMatrixUserFunction"], dict):
        return None
    matrix = entry["massMatrix"].GetPythonObject()
    if isinstance(matrix, dict):
        rows, columns, values = np.reshape(matrix["triplets"], (-1, 3)).T
        return sp.coo_matrix((values, (rows.astype(int), columns.astype(int))), shape=(n, n))
    return sp.coo_matrix(matrix) if np.size(matrix) else sp.coo_matrix((n, n))


def is_massless(entry: ItemEntry) -> bool:
    """Whether an `ObjectFFRFreducedOrder` never has a mass: our bodies' markers hang on such objects."""
    if entry["computeFFRFterms"] or isinstance(entry["massMatrixUserFunction"], dict):
        return False
    matrix = entry["massMatrixReduced"].GetPythonObject()
    return not isinstance(matrix, dict) and not np.any(matrix)
