"""Exudyn adapter: partition bodies as nodes, objects and sensors of a model, and the list of what it holds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp

from ._checks import validate_choice, validate_vector
from ._optional import require
from .body import ReducedBody
from .errors import InputError

if TYPE_CHECKING:
    from .contact_items import PartitionContact
    from .solve import Result

Array = np.ndarray

REGISTRY = "exudynPartition"  # key in mbs.sys


class PartitionBody(dict):
    """What `CreatePartitionBody` returns: Exudyn indices by name, and the body's results.

    Keys: `nModal` and `nNodal`, where the basis has shapes and nodal columns; `oGenericODE2`; `sCoordinates` and
    `sCoordinates_t`, lists with a sensor for each node.
    """

    def __init__(self, body: ReducedBody, name: str, position: Array, **indices: Any) -> None:
        super().__init__(**indices)
        self.body, self.name, self.position = body, name, position

    @property
    def nodes(self) -> list[Any]:
        """Exudyn nodes of the body, in the order of its coordinates."""
        return [self[key] for key in ("nModal", "nNodal") if key in self]

    def is_in(self, mbs: Any) -> bool:
        """Whether the model still holds this body's object on its nodes, of its size."""
        nodes = mbs.GetObject(self["oGenericODE2"]).get("nodeNumbers", [])
        if [*map(int, nodes)] != [*map(int, self.nodes)]:
            return False
        held = [mbs.GetNode(node).get("numberOfODE2Coordinates", 0) for node in nodes]
        return sum(held) == self.body.n_dofs

    def coordinates(self, result: Result) -> Array:
        """Coordinates q, (n, n_dofs), at the times of `result`."""
        return np.hstack([result.sensor(s) for s in self["sCoordinates"]])

    def coordinates_t(self, result: Result) -> Array:
        """Velocities of the coordinates, (n, n_dofs), at the times of `result`."""
        return np.hstack([result.sensor(s) for s in self["sCoordinates_t"]])

    def displacement(self, result: Result, point: Array) -> Array:
        """Displacement of the node nearest to `point`, (n, 3) [m]; point (3,) in the body's own coordinates [m]."""
        return np.asarray((self._row(point) @ self.coordinates(result).T).T)

    def velocity(self, result: Result, point: Array) -> Array:
        """Velocity of the node nearest to `point`, (n, 3) [m/s]; point (3,) in the body's own coordinates [m]."""
        return np.asarray((self._row(point) @ self.coordinates_t(result).T).T)

    def recover(self, result: Result, rows: sp.csr_matrix) -> Array:
        """History of `rows` on the nodal displacements, (n, k): strains, stresses, as module `recovery` makes them.

        It is that of the kept shapes; see `recovery.static_correction` for what they lack.

        Parameters
        ----------
        result : Result
        rows : (k, 3 nodes) csr matrix
        """
        return self.coordinates(result) @ self.body.reduced_rows(rows).T

    def momentum(self, result: Result) -> Array:
        """Linear momentum of the body, (n, 3) [N s]."""
        weights = self.body.mass @ self.body.rigid[:, :3]
        return self.coordinates_t(result) @ weights

    def energy(self, result: Result) -> Array:
        """Kinetic and strain energy, (n,) [J]."""
        q, v = self.coordinates(result), self.coordinates_t(result)
        kinetic = np.einsum("ij,ij->i", v, (self.body.mass @ v.T).T)
        return 0.5 * (kinetic + np.einsum("ij,ij->i", q, (self.body.stiffness @ q.T).T))

    def rigid_motion(self, q: Array) -> Array:
        """Rigid motion in coordinates q, (n, n_dofs): (n, 6), translation [m] and rotation [rad] of the whole body."""
        M_rigid = self.body.mass @ self.body.rigid
        return np.linalg.solve(self.body.rigid.T @ M_rigid, M_rigid.T @ q.T).T

    def deformation(self, q: Array) -> Array:
        """Largest elastic displacement on the contact patch in coordinates q, (n, n_dofs): (n,) [m]."""
        elastic = q - self.rigid_motion(q) @ self.body.rigid.T
        u = self.body.rows(self.body.partition.patch_nodes) @ elastic.T
        return abs(u).max(axis=0)

    def _row(self, point: Array) -> Any:
        return self.body.rows(np.array([self.body.nearest_node(point)]))


def partition_items(mbs: Any) -> tuple[list[PartitionBody], list[PartitionContact]]:
    """Partition bodies and contacts that a model holds; those from before an `mbs.Reset()` are forgotten."""
    bodies, contacts = mbs.sys.setdefault(REGISTRY, ({}, {}))
    objects, sensors = mbs.systemData.NumberOfObjects(), mbs.systemData.NumberOfSensors()
    for number, item in list(bodies.items()):
        if number >= objects or not item.is_in(mbs):
            del bodies[number]
    for number, contact in list(contacts.items()):
        both_there = all(any(item is body for body in bodies.values()) for item in (contact.slave, contact.master))
        if number >= sensors or not both_there:
            del contacts[number]
    return list(bodies.values()), list(contacts.values())


def CreatePartitionBody(
    mbs: Any,
    body: ReducedBody,
    *,
    name: str = "",
    frame: str = "inertial",
    referencePosition: Sequence[float] = (0.0, 0.0, 0.0),
    initialVelocity: Sequence[float] = (0.0, 0.0, 0.0),
    initialAngularVelocity: Sequence[float] = (0.0, 0.0, 0.0),
) -> PartitionBody:
    """Add a reduced body to a model.

    A NodeGenericODE2 holds the shape coordinates, a second one the nodal coordinates of the paper's basis, an
    ObjectGenericODE2 the matrices: identity mass and diagonal stiffness go to Exudyn as they are; the coupling of
    shapes and nodes is applied as a sparse product on Exudyn's own coordinates.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    body : ReducedBody
    name : str
    frame : {"inertial"}
        The body moves by small rotations about its place; translations may be large.
    referencePosition : (3,)
        Where the origin of the body's mesh is put [m].
    initialVelocity : (3,)
        Of the centre of mass [m/s].
    initialAngularVelocity : (3,)
        About the centre of mass [rad/s].

    Returns
    -------
    PartitionBody

    Raises
    ------
    InputError
    """
    exu, items = require("exudyn"), require("exudyn.itemInterface")
    if not isinstance(body, ReducedBody):
        raise InputError(f"body: expected what reduce() returns, got {type(body).__name__}")
    validate_choice("frame", frame, ("inertial",))
    position = validate_vector("referencePosition", referencePosition)
    rigid_velocity = np.r_[
        validate_vector("initialVelocity", initialVelocity),
        validate_vector("initialAngularVelocity", initialAngularVelocity),
    ]
    q_t = body.rigid @ rigid_velocity

    def add_node(velocities: Array) -> Any:
        zeros = [0.0] * len(velocities)
        return mbs.AddNode(
            items.NodeGenericODE2(
                referenceCoordinates=zeros,
                initialCoordinates=zeros,
                initialCoordinates_t=list(velocities),
                numberOfODE2Coordinates=len(velocities),
            )
        )

    parts = {"nModal": q_t[: body.n_shapes], "nNodal": q_t[body.n_shapes :]}
    indices = {key: add_node(part) for key, part in parts.items() if len(part)}
    nodes = list(indices.values())

    diagonal = sp.diags(np.r_[body.basis.omega**2, np.zeros(body.n_dofs - body.n_shapes)], format="csr")
    functions = {}
    if "nNodal" in indices:
        functions = _coupling_functions(exu, nodes, body.stiffness - diagonal)
    indices["oGenericODE2"] = mbs.AddObject(
        items.ObjectGenericODE2(
            name=name,
            nodeNumbers=nodes,
            massMatrix=exu.MatrixContainer(sp.csr_matrix(body.mass)),
            stiffnessMatrix=exu.MatrixContainer(diagonal),
            visualization=items.VObjectGenericODE2(show=False),
            **functions,
        )
    )
    for key, kind in (
        ("sCoordinates", exu.OutputVariableType.Coordinates),
        ("sCoordinates_t", exu.OutputVariableType.Coordinates_t),
    ):
        indices[key] = [
            mbs.AddSensor(items.SensorNode(nodeNumber=n, outputVariableType=kind, storeInternal=True)) for n in nodes
        ]
    item = PartitionBody(body, name, position, **indices)
    mbs.sys.setdefault(REGISTRY, ({}, {}))[0][int(item["oGenericODE2"])] = item
    return item


def _coupling_functions(exu: Any, nodes: list[Any], stiffness: sp.csr_matrix) -> dict[str, Any]:
    """Force and Jacobian of what is not diagonal.

    The force reads Exudyn's coordinates in place: converting the list that a user function receives costs more than the
    product itself.
    """
    stiffness = sp.csr_matrix(stiffness)
    stiffness.eliminate_zeros()

    def force(mbs: Any, t: float, i: Any, q: Any, q_t: Any) -> Array:
        coordinates = mbs.systemData.GetODE2Coordinates(copy=False)
        return -(stiffness @ np.concatenate([coordinates[s] for s in coordinate_slices(mbs, nodes)]))

    def jacobian(mbs: Any, t: float, i: Any, q: Any, q_t: Any, fODE2: float, fODE2_t: float) -> Any:
        return exu.MatrixContainer(sp.csr_matrix(fODE2 * stiffness))

    return {"forceUserFunction": force, "jacobianUserFunction": jacobian}


def coordinate_slices(mbs: Any, nodes: list[Any]) -> list[slice]:
    """Places of the nodes' coordinates in the system vector, asked anew: a model may be assembled again."""
    starts = [mbs.GetNodeODE2Index(node) for node in nodes]
    return [
        slice(a, a + mbs.GetNodeParameter(n, "numberOfODE2Coordinates")) for a, n in zip(starts, nodes, strict=True)
    ]
