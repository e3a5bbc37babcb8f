"""Checks that Exudyn's items of a partition body are as they were made: contacts and results know of no change."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp

from ..errors import InputError
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


def made(mbs: MainSystem, item: MadeBody) -> dict[str, Any]:
    """Matrices and user functions of a body's object, and reference coordinates of its nodes, by their names."""
    number = item["oGenericODE2"]
    found: dict[str, Any] = {name: _plain(mbs.GetObjectParameter(number, name)) for name in _MATRICES}
    found |= {name: user_function(mbs.GetObjectParameter(number, name)) for name in _FUNCTIONS}
    nodes = [key for key in _NODES if key in item]
    return found | {key: np.array(mbs.GetNodeParameter(item[key], "referenceCoordinates")) for key in nodes}


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
        expected = dict(item.as_made)
        if (number := int(item["oGenericODE2"])) in springs:
            expected["stiffnessMatrix"] = expected["stiffnessMatrix"] + springs[number]
        for name, now in made(mbs, item).items():
            if not _same(expected[name], now) and not (name == "forceUserFunction" and expected[name] is None):
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
        f"results do not know of it. Restore what was there, and {instead}"
    )


def _plain(matrix: MatrixContainer) -> sp.csr_matrix:
    """Matrix in one of Exudyn's containers."""
    held = matrix.GetPythonObject()
    if not isinstance(held, dict):
        return sp.csr_matrix(np.atleast_2d(held))
    triplets = np.reshape(held["triplets"], (-1, 3))
    rows, columns = triplets[:, :2].astype(np.int64).T
    shape = held["numberOfRows"], held["numberOfColumns"]
    return sp.csr_matrix((triplets[:, 2], (rows, columns)), shape=shape)


def _same(before: Any, now: Any) -> bool:
    """Whether two values of `made` are equal."""
    if sp.issparse(before):
        return before.shape == now.shape and not (before != now).nnz
    if isinstance(before, np.ndarray):
        return np.array_equal(before, now)
    return bool(before == now)
