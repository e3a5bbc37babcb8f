"""Damping of bodies as the joints of a model hold them.

Exudyn knows the joints when it has assembled the model. A sensor finds them at the start of each run, before Exudyn
asks for the first force. Damping matrices are constant then, and cost nothing more.

Theory: examples/site/theory.md, "Damping".
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.csgraph

from ..frames.damping import Damping, ModeDamping, Ratios, damping_of
from ..frames.floating import FloatingKinematics
from ..frames.inertial import InertialKinematics
from ..support.arrays import Array
from ..support.foreign import MainSystem, ObjectIndex, SensorIndex
from ..support.optional import require
from .joints import is_massless, mass_and_rows
from .model import DAMPING, dofs_of, registered, registry
from .unchanged import MadeBody, check_unchanged, made
from .user_functions import RIGID

_REDUNDANT = 1e-11  # least eigenvalue of the scaled rows of joints; those of redundant rows are round-off


class DampedBody(MadeBody, Protocol):
    """A body with damping, which depends on the joints that hold it.

    Attributes
    ----------
    kinematics : InertialKinematics or FloatingKinematics
    damping : Damping
    ratios : Ratios
        What the user gave.
    mobility : (n_dofs, n_dofs) array or None
        That of the joints which `damping` is for.
    dampings : tuple of (float, Damping)
        Those of the last run, each with the time from which it acted [s].
    """

    kinematics: InertialKinematics | FloatingKinematics
    damping: Damping
    ratios: Ratios
    mobility: Array | None
    dampings: tuple[tuple[float, Damping], ...]


class DampingSensor:
    """Sensor that finds what holds damped bodies, at the start of a run and if joints are switched; it stores nothing.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    """

    def __init__(self, mbs: MainSystem) -> None:
        latest = math.inf

        def value(mbs: MainSystem, t: float, *unused: object) -> list[float]:
            nonlocal latest
            if t <= latest:
                self.begin(mbs)
            self.update(mbs, t)
            latest = t
            return [0.0]

        items = require("exudyn.itemInterface")
        self._switches: list[ObjectIndex] = []
        self._active: list[bool] = []
        self.number: SensorIndex = mbs.AddSensor(
            items.SensorUserFunction(name=DAMPING, sensorUserFunction=value, writeToFile=False, storeInternal=False)
        )

    def begin(self, mbs: MainSystem) -> None:
        """Find the damping for a run."""
        hold_damping(mbs)
        for item in registered(mbs).bodies.values():
            item.dampings = item.dampings[-1:] and ((-math.inf, item.damping),)
        self._switches = _switches(mbs)
        self._active = self._now(mbs)

    def update(self, mbs: MainSystem, t: float) -> None:
        """Find the damping from time t [s] on, if joints were switched in the run."""
        active = self._now(mbs)
        if active != self._active:
            self._active = active
            hold_damping(mbs, t)

    def _now(self, mbs: MainSystem) -> list[bool]:
        return [mbs.GetObjectParameter(number, "activeConnector") for number in self._switches]


def add_damping_sensor(mbs: MainSystem) -> None:
    """Add a `DampingSensor` to a model that has none."""
    if registered(mbs).damping is None:
        registry(mbs).damping = DampingSensor(mbs)


def _switches(mbs: MainSystem) -> list[ObjectIndex]:
    """Joints that can be switched."""
    numbers = map(require("exudyn").ObjectIndex, range(mbs.systemData.NumberOfObjects()))
    joints = (number for number in numbers if len(mbs.systemData.GetObjectLTGAE(number)))
    return [number for number in joints if "activeConnector" in mbs.GetObject(number)]


def hold_damping(mbs: MainSystem, since: float = -math.inf) -> None:
    """Give each damped body the damping of its modes as the joints of the model hold it.

    It is that of the model at its reference coordinates, so that it does not depend on the state. Joints hold what
    their rows hold; springs and contacts hold nothing. A body that is held by another body moves with its mass: other
    bodies count as rigid.

    Parameters
    ----------
    mbs : exudyn.MainSystem
        It is not changed before it is assembled.
    since : float
        Time in a run from which the joints hold so [s]. Default: the whole run.

    Raises
    ------
    InputError
        If a damping matrix was changed since the body was made.
    """
    items: list[DampedBody] = [item for item in registered(mbs).bodies.values() if item.ratios is not None]
    if not items or not mbs.systemData.ODE2Size():
        return
    joints = _Joints.of(mbs) if mbs.systemData.AEsize() else None
    mobilities = [(item, None if joints is None else joints.mobility(item)) for item in items]
    changed = [(item, mobility) for item, mobility in mobilities if not _same(mobility, item.mobility)]
    if not changed:
        return
    check_unchanged(mbs, [item for item, _ in changed])
    for item, mobility in changed:
        item.mobility, item.damping = mobility, damping_of(item.kinematics, item.ratios, mobility)
        item.dampings = (*(past for past in item.dampings if past[0] < since), (since, item.damping))
        if not len(item.body.basis.nodal):  # user functions apply the damping of nodal coordinates
            matrix = require("exudyn").MatrixContainer(item.damping.matrix())
            mbs.SetObjectParameter(item["oGenericODE2"], "dampingMatrix", matrix)
            item.as_made = item.as_made | {"dampingMatrix": made(mbs, item)["dampingMatrix"]}
    of_modes = [item for item in items if isinstance(item.damping, ModeDamping)]
    if joints is not None and of_modes:
        fastest = joints.largest_rate(of_modes)
        for item in of_modes:
            if isinstance(item.damping, ModeDamping) and item.mobility is not None:
                item.damping = replace(item.damping, fastest=fastest)


def _same(first: Array | None, second: Array | None) -> bool:
    if first is None or second is None:
        return first is None and second is None
    return np.array_equal(first, second)


@dataclass(frozen=True, eq=False)
class _Joints:
    """Rows of the active joints of a model, and inverse masses, at its reference coordinates.

    Parameters
    ----------
    rows : (k, n) csr matrix
    inverse_mass : (n, n) csr matrix
        Zero for coordinates without mass.
    places : dict of int to (m,) int array
        Coordinates of each partition body, by the number of its object.
    own : dict of int to (k, k) array
        Accelerations of the rows by unit multipliers on each partition body, if it is rigid.
    yields : (k, k) array
        The same of all bodies.
    """

    rows: sp.csr_matrix
    inverse_mass: sp.csr_matrix
    places: Mapping[int, Array]
    own: Mapping[int, Array]
    yields: Array

    @classmethod
    def of(cls, mbs: MainSystem) -> _Joints:
        """Rows and masses of an assembled model."""
        q = mbs.systemData.GetODE2Coordinates(copy=False)
        present = q.copy()
        q[:] = 0.0
        try:
            mass, rows = mass_and_rows(mbs)
        finally:
            q[:] = present
        bodies = registered(mbs).bodies
        places = {number: dofs_of(mbs, item) for number, item in bodies.items()}
        inverse = _inverse(mass, np.unique(np.concatenate([rows.nonzero()[1], *places.values()])))
        of_bodies, others = {}, np.ones(rows.shape[1])
        for number, item in bodies.items():
            at = places[number]
            rigid = item.body.rigid if item.kinematics.linear else np.eye(item.body.n_dofs, RIGID)
            on_rigid = rows[:, at] @ rigid
            of_bodies[number] = on_rigid @ np.linalg.solve(rigid.T @ (mass[at][:, at] @ rigid), on_rigid.T)
            others[at] = 0.0
        yields = np.sum([np.zeros((rows.shape[0],) * 2), *of_bodies.values()], axis=0)
        for columns, size in _flexible(mbs):
            at = columns[:size]
            on_frame = rows[:, at].toarray()
            yields += on_frame @ scipy.linalg.pinvh(mass[at][:, at].toarray()) @ on_frame.T
            others[columns] = 0.0
        rest = sp.csr_matrix(rows @ sp.diags(others))
        return cls(rows, inverse, places, of_bodies, yields + (rest @ inverse @ rest.T).toarray())

    def mobility(self, item: DampedBody) -> Array | None:
        """Velocities of a body's coordinates by unit impulses on them, (n_dofs, n_dofs); None if no joint holds it."""
        number = int(item["oGenericODE2"])
        at = self.places[number]
        rows = self.rows[:, at]
        if not rows.nnz:
            return None
        inverse = self.inverse_mass[at][:, at].toarray()
        push = rows @ inverse
        mobility: Array = inverse - push.T @ _solve(self.yields - self.own[number] + push @ rows.T, push)
        return mobility

    def largest_rate(self, items: Sequence[DampedBody]) -> float:
        """Largest eigenvalue of M^-1 D [1/s] of bodies that are flexible, all of them with `ModeDamping`."""
        rows = []
        for item in items:
            damping: Any = item.damping
            of_body = sp.csr_matrix(sp.diags(np.sqrt(damping.rates)) @ damping.rows).tocoo()
            columns = self.places[int(item["oGenericODE2"])][of_body.col]
            rows.append(sp.csr_matrix((of_body.data, (of_body.row, columns)), (of_body.shape[0], self.rows.shape[1])))
        damped = sp.vstack(rows, format="csr")
        push = (self.rows @ self.inverse_mass @ damped.T).toarray()
        yields = (self.rows @ self.inverse_mass @ self.rows.T).toarray()
        free = (damped @ self.inverse_mass @ damped.T).toarray()
        return float(np.linalg.eigvalsh(free - push.T @ _solve(yields, push)).max(initial=0.0))


def _flexible(mbs: MainSystem) -> Iterator[tuple[Array, int]]:
    """Coordinates of each of Exudyn's own flexible bodies with a frame, which stands first, and how many it has."""
    for number in map(require("exudyn").ObjectIndex, range(mbs.systemData.NumberOfObjects())):
        entry = mbs.GetObject(number)
        if entry["objectType"].startswith("FFRF") and not is_massless(entry):
            turns_by_euler = "EP" in mbs.GetNode(entry["nodeNumbers"][0])["nodeType"]
            yield np.array(mbs.systemData.GetObjectLTGODE2(number), dtype=int), RIGID + turns_by_euler


def _inverse(mass: sp.csr_matrix, needed: Array) -> sp.csr_matrix:
    """Inverse of a mass matrix, (n, n), with the blocks that have `needed` coordinates, (k,) int array.

    It is zero where there is no mass, as along Euler parameters.
    """
    return _by_blocks(mass, needed, np.reciprocal, scipy.linalg.pinvh)


def root_of_inverse(mass: sp.csr_matrix, needed: Array) -> sp.csr_matrix:
    """Matrix R with R R' = `_inverse`, (n, n)."""

    def root(block: Array) -> Array:
        values, vectors = scipy.linalg.eigh(scipy.linalg.pinvh(block))
        value: Array = vectors * np.sqrt(np.maximum(values, 0.0))
        return value

    return _by_blocks(mass, needed, lambda diagonal: 1 / np.sqrt(diagonal), root)


def _by_blocks(
    mass: sp.csr_matrix, needed: Array, of_diagonal: Callable[[Array], Array], of_block: Callable[[Array], Array]
) -> sp.csr_matrix:
    """Matrix, (n, n), that consists of functions of the blocks of a mass matrix, as its inverse does.

    Parameters
    ----------
    mass : (n, n) csr matrix
        Coordinates that no entry connects are blocks of their own.
    needed : int array
        Larger blocks without one of these coordinates are left out.
    of_diagonal : callable
        Function of all blocks of one coordinate at once, (k,).
    of_block : callable
        Function of a larger block, (m, m).
    """
    labels = scipy.sparse.csgraph.connected_components(mass)[1]
    groups = np.split(np.argsort(labels, kind="stable"), np.cumsum(np.bincount(labels))[:-1])
    diagonal = mass.diagonal()
    alone = np.array([group[0] for group in groups if len(group) == 1], dtype=int)
    alone = alone[diagonal[alone] > 0]
    parts = [(alone, alone, of_diagonal(diagonal[alone]))]
    for group in groups:
        if len(group) > 1 and np.isin(group, needed).any():
            block = of_block(mass[group][:, group].toarray())
            parts.append((np.repeat(group, len(group)), np.tile(group, len(group)), block.ravel()))
    rows, columns, values = (np.concatenate(each) for each in zip(*parts, strict=True))
    return sp.csr_matrix((values, (rows, columns)), shape=mass.shape)


def _solve(yields: Array, rhs: Array) -> Array:
    """Multipliers, (k, m), that give the rows the accelerations rhs, (k, m); rows may be redundant."""
    values, vectors = independent(yields)
    multipliers: Array = vectors / values @ (vectors.T @ rhs)
    return multipliers


def independent(yields: Array) -> tuple[Array, Array]:
    """Values v, (m,), and vectors V, (k, m), of rows that yield by unit multipliers as (k, k): V' yields V = diag(v).

    Redundant rows have none.
    """
    diagonal = yields.diagonal()
    scale = np.where(diagonal > 0, 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0)), 0.0)
    values, vectors = np.linalg.eigh(scale[:, None] * yields * scale)
    kept = values > _REDUNDANT
    return values[kept], scale[:, None] * vectors[:, kept]
