"""Exudyn adapter: partition bodies and their contacts as nodes, objects and sensors of an existing model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp

from ._checks import validate_choice, validate_vector
from ._optional import require
from .body import ReducedBody
from .contact.compliance import ComplianceContact
from .contact.lagrange import LagrangeContact
from .contact.rows import node_to_segment
from .errors import InputError

if TYPE_CHECKING:
    from .solve import Result

Array = np.ndarray

_REGISTRY = "exudynPartition"  # key in mbs.sys


class PartitionBody(dict):
    """What `CreatePartitionBody` returns: Exudyn indices by name, and the body's results.

    Keys: `nModal`, and `nNodal` where the basis has nodal columns; `oGenericODE2`; `sCoordinates` and
    `sCoordinates_t`, lists with a sensor for each node.
    """

    def __init__(self, body: ReducedBody, name: str, position: Array, **indices: Any) -> None:
        super().__init__(**indices)
        self.body, self.name, self.position = body, name, position

    @property
    def nodes(self) -> list[Any]:
        """Exudyn nodes of the body, in the order of its coordinates."""
        return [self[key] for key in ("nModal", "nNodal") if key in self]

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

    def _row(self, point: Array) -> Any:
        return self.body.rows(np.array([self.body.nearest_node(point)]))


class PartitionContact(dict):
    """What `CreatePartitionContact` returns: Exudyn indices by name, and the contact's results.

    Keys: `oContact` with compliance, `sForce` (total normal force [N] and number of closed rows).
    """

    def __init__(self, name: str, slave: PartitionBody, master: PartitionBody, law: Any, **indices: Any) -> None:
        super().__init__(**indices)
        self.name, self.slave, self.master, self.law = name, slave, master, law
        self.reached_edge_at: float | None = None

    def force(self, result: Result) -> Array:
        """Total normal force, (n,) [N], >= 0, at the times of `result`."""
        return result.sensor(self["sForce"])[:, 0]

    def closed_rows(self, result: Result) -> Array:
        """Number of closed contact rows, (n,)."""
        return result.sensor(self["sForce"])[:, 1].astype(int)

    def energy(self, result: Result) -> Array:
        """Energy stored in the contact's own flexibility, (n,) [J]; multipliers store none."""
        if self.explicit_only:
            return np.zeros(len(result.t))
        q = np.hstack([self.slave.coordinates(result), self.master.coordinates(result)])
        return np.array([self.law.potential(x) for x in q])

    @property
    def explicit_only(self) -> bool:
        """Whether the contact runs in explicit solvers only."""
        return isinstance(self.law, LagrangeContact)

    def largest_slide(self, result: Result) -> tuple[float, float]:
        """Largest tangential displacement between the patches while closed [m], of some 50 samples, and when [s]."""
        closed = np.flatnonzero(self.force(result) > 0)
        if not len(closed):
            return 0.0, 0.0
        samples = closed[:: max(1, len(closed) // 50)]
        means = []
        for item in (self.slave, self.master):
            nodes = item.body.partition.patch_nodes
            u = item.body.rows(nodes) @ item.coordinates(result)[samples].T
            means.append(u.reshape(len(nodes), 3, -1).mean(axis=0))
        normal = self.law.rows.normal.mean(axis=0)
        between = means[0] - means[1]
        slide = np.linalg.norm(between - np.outer(normal, normal @ between), axis=0)
        return float(slide.max()), float(result.t[samples[slide.argmax()]])

    @property
    def left_out(self) -> list[str]:
        """What the contact leaves out, in sentences."""
        unpaired = self.law.rows.unpaired
        said = ["tangential rows: the contact is frictionless"]
        if unpaired:
            said.append(f"{unpaired} nodes of {self.slave.name or 'the slave'} that face no facet of the master patch")
        return said


def partition_items(mbs: Any) -> tuple[list[PartitionBody], list[PartitionContact]]:
    """Partition bodies and contacts of a model."""
    found = mbs.sys.setdefault(_REGISTRY, ([], []))
    return found


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

    indices = {"nModal": add_node(q_t[: body.n_shapes])}
    if body.n_dofs > body.n_shapes:
        indices["nNodal"] = add_node(q_t[body.n_shapes :])
    nodes = list(indices.values())

    diagonal = sp.diags(np.r_[body.basis.omega**2, np.zeros(body.n_dofs - body.n_shapes)], format="csr")
    functions = {}
    if len(nodes) > 1:
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
    partition_items(mbs)[0].append(item)
    return item


def _coupling_functions(exu: Any, nodes: list[Any], stiffness: sp.csr_matrix) -> dict[str, Any]:
    """Force and Jacobian of what is not diagonal. The force reads Exudyn's coordinates in place: the list that a user
    function receives takes ten times as long to convert as the product itself."""  # noqa: D205, D209
    stiffness = sp.csr_matrix(stiffness)
    stiffness.eliminate_zeros()

    def force(mbs: Any, t: float, i: Any, q: Any, q_t: Any) -> Array:
        coordinates = mbs.systemData.GetODE2Coordinates(copy=False)
        return -(stiffness @ np.concatenate([coordinates[s] for s in _slices(mbs, nodes)]))

    def jacobian(mbs: Any, t: float, i: Any, q: Any, q_t: Any, fODE2: float, fODE2_t: float) -> Any:
        return exu.MatrixContainer(sp.csr_matrix(fODE2 * stiffness))

    return {"forceUserFunction": force, "jacobianUserFunction": jacobian}


def _slices(mbs: Any, nodes: list[Any]) -> list[slice]:
    """Places of the nodes' coordinates in the system vector, asked anew: a model may be assembled again."""
    starts = [mbs.GetNodeODE2Index(node) for node in nodes]
    return [
        slice(a, a + mbs.GetNodeParameter(n, "numberOfODE2Coordinates")) for a, n in zip(starts, nodes, strict=True)
    ]


def CreatePartitionContact(
    mbs: Any,
    slave: PartitionBody,
    master: PartitionBody,
    *,
    formulation: str = "compliance",
    name: str = "",
) -> PartitionContact:
    """Add frictionless contact between the patches of two partition bodies.

    Each patch node of the slave faces the closest point of the master's facets (node-to-segment, paper section 3).
    Pairs are frozen in the reference configuration.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    slave, master : PartitionBody
        Take the body with the finer or the curved patch as slave.
    formulation : {"compliance", "lagrange"}
        "compliance" for bases with a residual flexibility, explicit and implicit; "lagrange" for nodal coordinates, the
        paper's, in Exudyn's explicit VelocityVerlet.
    name : str

    Returns
    -------
    PartitionContact

    Raises
    ------
    EmptyRegionError, PenetrationError, InputError, IndefiniteMatrixError
    """
    for role, item in (("slave", slave), ("master", master)):
        if not isinstance(item, PartitionBody):
            raise InputError(f"{role}: expected what CreatePartitionBody returns, got {type(item).__name__}")
    if slave is master:
        raise InputError("slave, master: expected two bodies, got the same twice")
    validate_choice("formulation", formulation, ("compliance", "lagrange"))
    rows = node_to_segment(slave.body.surface(slave.position), master.body.surface(master.position))
    law = (ComplianceContact if formulation == "compliance" else LagrangeContact)(rows, slave.body, master.body)
    contact = PartitionContact(name, slave, master, law)
    if formulation == "compliance":
        _add_compliance(mbs, contact)
    else:
        _add_lagrange(mbs, contact)
    partition_items(mbs)[1].append(contact)
    return contact


def _add_force_sensor(mbs: Any, contact: PartitionContact) -> None:
    items = require("exudyn.itemInterface")
    law, edge = contact.law, contact.law.rows.at_edge

    def force(mbs: Any, t: float, sensors: Any, factors: Any, configuration: Any) -> list[float]:
        index = law.problem.index
        if contact.reached_edge_at is None and index.size and edge[index].any():
            contact.reached_edge_at = t
        return [float(law.lam.sum()), float(index.size)]

    contact["sForce"] = mbs.AddSensor(
        items.SensorUserFunction(name=contact.name, sensorUserFunction=force, storeInternal=True)
    )


def _add_compliance(mbs: Any, contact: PartitionContact) -> None:
    exu, items = require("exudyn"), require("exudyn.itemInterface")
    law: ComplianceContact = contact.law
    nodes = contact.slave.nodes + contact.master.nodes

    def force(mbs: Any, t: float, i: Any, q: Any, q_t: Any) -> Array:
        return law.force(np.asarray(q))

    def jacobian(mbs: Any, t: float, i: Any, q: Any, q_t: Any, fODE2: float, fODE2_t: float) -> Any:
        law.force(np.asarray(q))
        return exu.MatrixContainer(sp.csr_matrix(fODE2 * law.tangent()))

    contact["oContact"] = mbs.AddObject(
        items.ObjectGenericODE2(
            name=contact.name,
            nodeNumbers=nodes,
            forceUserFunction=force,
            jacobianUserFunction=jacobian,
            visualization=items.VObjectGenericODE2(show=False),
        )
    )
    _add_force_sensor(mbs, contact)


def _add_lagrange(mbs: Any, contact: PartitionContact) -> None:
    """Multipliers before each step of VelocityVerlet, behind the model's own PreStep function.

    Verlet takes q += h v + h^2/2 a, v += h/2 (a + a'), so that v += h/2 c and a += c ahead of it make the velocity at
    mid-step v + h/2 a + h c: central differences (paper, eq. 29) with the contact acceleration c.
    """
    exu = require("exudyn")
    law: LagrangeContact = contact.law
    nodes = contact.slave.nodes + contact.master.nodes
    own = mbs.GetPreStepUserFunction()
    own_function = own["function"] if isinstance(own, dict) else None

    def before_step(mbs: Any, t: float) -> bool:
        if own_function is not None and not own_function(mbs, t):
            return False
        data = mbs.systemData
        start_of_step = data.GetTime(exu.ConfigurationType.StartOfStep)
        if start_of_step == 0.0:
            law.reset()
        step = t - start_of_step
        slices = _slices(mbs, nodes)
        q_t, q_tt = data.GetODE2Coordinates_t(copy=False), data.GetODE2Coordinates_tt(copy=False)
        views = (data.GetODE2Coordinates(copy=False), q_t, q_tt)
        q_now, q_t_now, q_tt_now = (np.concatenate([view[s] for s in slices]) for view in views)
        increment = law.increment(q_now, q_t_now, q_tt_now, step)
        if increment is not None:
            start = 0
            for s in slices:
                part = increment[start : start + s.stop - s.start]
                q_t[s] += 0.5 * step * part
                q_tt[s] += part
                start += len(part)
        return True

    mbs.SetPreStepUserFunction(before_step)
    _add_force_sensor(mbs, contact)
