"""Checks that Exudyn's items of a partition body are as they were made: contacts and results know of no change."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp

from ..errors import InputError
from ..support.arrays import Array
from ..support.foreign import MainSystem, MatrixContainer
from ..support.optional import require
from .model import BodyItem, coordinate_slices, registry, user_function

# What is compared, and what to do instead of a change.
_MATRICES = {
    "massMatrix": "reduce the FE model that has this mass",
    "stiffnessMatrix": "reduce the FE model that has this stiffness, or add springs to markers",
    "dampingMatrix": "give damping= to CreatePartitionBody, or add dampers to markers",
}
_FUNCTIONS = {
    "forceUserFunction": "add loads to markers, or take CreateDistributedLoad",
    "massMatrixUserFunction": "reduce the FE model that has this mass",
}
_NODES = ("nRigid", "nModal", "nNodal", "nRigidBody", "nGenericODE2")  # first those that have the coordinates
_PLACE = "give referencePosition= and referenceRotationMatrix= to CreatePartitionBody, or move it by initialCoordinates"


class MadeBody(BodyItem, Protocol):
    """A body that knows how its items were made."""

    as_made: dict[str, Any]

    def __contains__(self, key: object) -> bool:
        """Whether the body has an Exudyn index with this name."""


@dataclass(frozen=True, eq=False)
class HeldMatrix:
    """A matrix as Exudyn holds it.

    Parameters
    ----------
    entries : (n, n) or (k, 3) array
        All entries, or rows, columns and values of some.
    size : int
    """

    entries: Array
    size: int

    @classmethod
    def of(cls, matrix: MatrixContainer) -> HeldMatrix:
        """Matrix in one of Exudyn's containers."""
        value = matrix.GetPythonObject()
        if isinstance(value, dict):
            return cls(np.array(value["triplets"], dtype=float).reshape(-1, 3), int(value["numberOfRows"]))
        entries = np.array(value, dtype=float, ndmin=2)
        return cls(entries, len(entries))

    @cached_property
    def csr(self) -> sp.csr_matrix:
        """The matrix, (size, size)."""
        if self.entries.shape == (self.size, self.size):
            return sp.csr_matrix(self.entries)
        rows, columns = self.entries[:, :2].astype(np.int64).T
        return sp.csr_matrix((self.entries[:, 2], (rows, columns)), shape=(self.size, self.size))

    def is_same(self, other: HeldMatrix, more: sp.csr_matrix | None = None) -> bool:
        """Whether it equals another one, plus `more`."""
        if more is None and np.array_equal(self.entries, other.entries):
            return True
        expected = other.csr if more is None else other.csr + more
        return self.size == other.size and not (self.csr != expected).nnz


def made(mbs: MainSystem, item: MadeBody) -> dict[str, Any]:
    """Matrices and user functions of a body's object, and reference coordinates of its nodes, by their names."""
    number = item["oGenericODE2"]
    parameters: dict[str, Any] = {name: HeldMatrix.of(mbs.GetObjectParameter(number, name)) for name in _MATRICES}
    parameters |= {name: user_function(mbs.GetObjectParameter(number, name)) for name in _FUNCTIONS}
    nodes = [key for key in _NODES if key in item]
    return parameters | {key: np.array(mbs.GetNodeParameter(item[key], "referenceCoordinates")) for key in nodes}


def check_unchanged(mbs: MainSystem, bodies: Iterable[MadeBody]) -> None:
    """Raise if the items of a body were changed since they were made.

    Parameters
    ----------
    mbs : exudyn.MainSystem
        Assembled.
    bodies : iterable of MadeBody

    Raises
    ------
    InputError
        Its message names body and item, and what to do instead. A force function may be added where there was none.
    """
    reference = mbs.systemData.GetODE2Coordinates(require("exudyn").ConfigurationType.Reference)
    springs = registry(mbs).springs
    for item in bodies:
        expected, held_by = item.as_made, springs.get(int(item["oGenericODE2"]))
        for name, now in made(mbs, item).items():
            if isinstance(now, HeldMatrix):
                same = now.is_same(expected[name], held_by if name == "stiffnessMatrix" else None)
            else:
                same = _same(expected[name], now) or (name == "forceUserFunction" and expected[name] is None)
            if not same:
                what, instead = f"{name} of its ObjectGenericODE2", (_MATRICES | _FUNCTIONS).get(name)
                if instead is None:
                    what, instead = f"referenceCoordinates of its node {name!r}", _PLACE
                _refuse(item, what, instead)
        keys = [key for key in _NODES[:3] if key in item]
        for key, place in zip(keys, coordinate_slices(mbs, item), strict=True):
            if not np.array_equal(item.as_made[key], reference[place]):
                _refuse(item, f"the model's reference coordinates of its node {key!r}", _PLACE)


def _refuse(item: MadeBody, what: str, instead: str) -> None:
    raise InputError(
        f"mbs: a change of {what} after CreatePartitionBody made body {item.name!r}: contacts, stability limit and "
        f"results do not know of it. Restore what was there, and {instead}. Or an item was deleted, which gives others "
        "new numbers: delete none of a model with partition bodies, make it anew without it"
    )


def _same(before: Any, now: Any) -> bool:
    """Whether two user functions, or two arrays of coordinates, are equal."""
    if isinstance(before, np.ndarray):
        return np.array_equal(before, now)
    return bool(before == now)
