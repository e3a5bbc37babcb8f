"""Nodes of Exudyn whose coordinates are a rotation vector, and whose velocities are the angular velocity in their axes.

Exudyn's static solver adds its steps to the rotation vectors v. Angular velocities are w = T(v) v_t, so that columns of
a Jacobian by turns about the node's axes become columns by v if they are multiplied by T.
"""

from __future__ import annotations

from collections.abc import Iterator

import scipy.sparse as sp

from ..support.foreign import MainSystem
from ..support.optional import require


def rotation_vectors(mbs: MainSystem) -> Iterator[int]:
    """First coordinates of all rotation vectors in a model, among the model's coordinates."""
    for number in map(require("exudyn").NodeIndex, range(mbs.systemData.NumberOfNodes())):
        if mbs.GetNode(number)["nodeType"] == "RigidBodyRotVecLG":
            yield int(mbs.GetNodeODE2Index(number)) + 3


def turns(mbs: MainSystem, vectors: tuple[int, ...]) -> sp.csr_matrix:
    """Turns by changes of the present coordinates, (nq, nq): T for rotation vectors, 1 for all other coordinates.

    `vectors` are the first coordinates of rotation vectors.
    """
    tangent = require("exudyn.lieGroupBasics").TExpSO3
    kinds, data = require("exudyn").ConfigurationType, mbs.systemData
    v = data.GetODE2Coordinates(kinds.Reference) + data.GetODE2Coordinates()
    result = sp.identity(len(v), format="lil")
    for first in vectors:
        result[first : first + 3, first : first + 3] = tangent(v[first : first + 3])
    return result.tocsr()
