"""A partition body in an Exudyn model: its indices, markers and results, and the list of what a model holds."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import scipy.sparse as sp
from scipy.integrate import cumulative_trapezoid

from ..errors import InputError, ModelLimitWarning
from ..fe.facets import nodal_area
from ..fe.model import FEModel, node_dofs
from ..frames.damping import Damping
from ..frames.floating import FloatingKinematics
from ..frames.inertial import InertialKinematics
from ..reduction.body import ReducedBody
from ..reduction.static_answer import StaticAnswer
from ..support.arrays import Array
from ..support.checks import validate_result, validate_type, validate_vector
from ..support.foreign import ItemIndex, MainSystem, MarkerIndex, NodeIndex, ObjectIndex
from .attachments import add_guard, check_attachments
from .markers import add_interface_marker, add_point_marker, add_super_element, add_tied_marker, interpolation
from .model import Samples, registered

Kinematics = InertialKinematics | FloatingKinematics
Static = FEModel | StaticAnswer

RIGID = 6  # coordinates of a NodeRigidBodyRotVecLG, rotation included
_LACKING = 0.02  # of a history: what it may lack by an estimate that holds within some factor of two
_BLOCK = 1000  # samples whose patches are recovered at a time


class PartitionBody(dict[str, ItemIndex]):
    """What `CreatePartitionBody` returns: Exudyn indices by name, and the body's results.

    Keys: `nModal` and `nNodal`, where the basis has shapes and nodal columns, or `nRigid` and `nModal` of a floating
    frame, whose rigid node has axes of its own, `kinematics.node_axes` in those of the body; `oGenericODE2`;
    `sCoordinates` and `sCoordinates_t`, lists with a sensor for each node.

    With the first marker, or by superElement=True, come the keys of Exudyn's own reduced bodies: `oFFRFreducedOrder`,
    to which superelement markers and sensors of FE nodes attach, its nodes `nRigidBody` and `nGenericODE2`, all three
    again as `FFRFReducedOrderObjectDict`, and the markers of interfaces, as `name:interface`.

    `point_markers` are the points of node and point markers beside rigid interfaces, by the markers' numbers;
    `frame_markers` are those by which the rigid node of an inertial frame is held.

    `kinematics` is the motion of the body in space, without nodes; `kinematics.at(nodes)` is that of nodes.
    """

    def __init__(
        self,
        body: ReducedBody,
        name: str,
        kinematics: Kinematics,
        frame_left_out: tuple[str, ...],
        **indices: ItemIndex | list[ItemIndex],
    ) -> None:
        super().__init__(**indices)
        self.body, self.name, self.kinematics, self._frame_left_out = body, name, kinematics, frame_left_out
        self.point_markers: dict[int, Sequence[float]] = {}
        self.damping: Damping | None = None
        self.frame_markers: list[int] = []

    @property
    def frame(self) -> str:
        """The frame, "inertial" or "floating"."""
        return "floating" if isinstance(self.kinematics, FloatingKinematics) else "inertial"

    @property
    def position(self) -> Array:
        """Where the origin of the body's mesh was put, (3,) [m]."""
        return self.kinematics.position

    @property
    def left_out(self) -> tuple[str, ...]:
        """What body and frame leave out, in sentences."""
        dents = ("the local dents of forces on node and point markers (an interface has their static answer)",)
        undamped = ("damping of the kept modes (damping= of CreatePartitionBody)",)
        said = self.body.left_out + self._frame_left_out
        return said + undamped * (self.damping is None) + dents * bool(self.point_markers)

    @property
    def nodes(self) -> list[NodeIndex]:
        """Exudyn nodes of the body, in the order of its coordinates."""
        return [self[key] for key in ("nRigid", "nModal", "nNodal") if key in self]

    @property
    def node_sizes(self) -> list[int]:
        """Number of coordinates of each node."""
        first = RIGID if "nRigid" in self else self.body.n_shapes
        return [size for size in (first, self.body.n_dofs - first) if size]

    def is_in(self, mbs: MainSystem) -> bool:
        """Whether the model still holds this body's object on its nodes, of its size."""
        nodes = mbs.GetObject(self["oGenericODE2"]).get("nodeNumbers", [])
        if [*map(int, nodes)] != [*map(int, self.nodes)]:
            return False
        held = [mbs.GetNode(node).get("numberOfODE2Coordinates", RIGID) for node in nodes]
        return bool(sum(held) == self.body.n_dofs)

    def CreateInterfaceMarker(self, mbs: MainSystem, interface: str) -> MarkerIndex:
        """Marker of position and orientation that moves as an interface, for any joint, spring-damper, load or sensor.

        Its place is the interface's `position`, its axes are those of the mesh at the start. Of a basis that keeps
        nodes it is the marker of a small rigid body which six constraints hold to the interface.

        Parameters
        ----------
        mbs : exudyn.MainSystem
        interface : str
            Name, as in `Partition.interface`.

        Returns
        -------
        exudyn.MarkerIndex
            The same in every call; also under the key "name:interface".

        Raises
        ------
        InputError
            If there is no such interface, or the body is not in this model.
        """
        self.body.partition.find_interface(interface)
        self._check_model(mbs)
        key = f"{self.name}:{interface}" if self.name else interface
        if key not in self:
            name = self.name and key
            if "nNodal" in self:
                self[key] = add_tied_marker(mbs, self.kinematics, self, interface, name)
            else:
                self[key] = add_interface_marker(mbs, self._super_element(mbs), self.kinematics, interface, name)
        return self[key]

    def CreateNodeMarker(self, mbs: MainSystem, point: Sequence[float]) -> MarkerIndex:
        """Position marker of the FE node nearest to `point`, (3,) in the body's own coordinates [m].

        It moves as the kept shapes let it: the body answers forces of its contacts and interfaces exactly, but lacks
        the local dent that a force on this node alone would make. For joints take an interface.

        Returns
        -------
        exudyn.MarkerIndex

        Raises
        ------
        InputError
            If the body is not in this model, or its basis keeps nodes and its frame is inertial.
        """
        node = self.body.nearest_node(validate_vector("point", point))
        return self._point_marker(mbs, point, np.array([node]), np.ones(1))

    def CreatePointMarker(self, mbs: MainSystem, point: Sequence[float]) -> MarkerIndex:
        """Position marker of any point on or in the body, (3,) in the body's own coordinates [m].

        The point moves by the nodes around it, so that a force on it has its resultant and moment exactly; it lacks the
        same dent as `CreateNodeMarker`.

        Returns
        -------
        exudyn.MarkerIndex

        Raises
        ------
        InputError
            If the point is outside the body, the body is not in this model, or its basis keeps nodes and its frame is
            inertial.
        """
        return self._point_marker(mbs, point, *interpolation(self.body.points, validate_vector("point", point)))

    def _point_marker(self, mbs: MainSystem, point: Sequence[float], nodes: Array, weights: Array) -> MarkerIndex:
        self.body.check_nodes(nodes)
        marker = add_point_marker(mbs, self._super_element(mbs), nodes, weights)
        if not any(i.kind == "rigid" and np.isin(nodes, i.nodes).all() for i in self.body.partition.interfaces):
            self.point_markers[int(marker)] = point
        return marker

    def _super_element(self, mbs: MainSystem) -> ObjectIndex:
        """Object that carries markers, made when first asked for."""
        self._check_model(mbs)
        if "oFFRFreducedOrder" not in self:
            indices, self.frame_markers = add_super_element(mbs, self.kinematics, self, self.name)
            self.update(indices, FFRFReducedOrderObjectDict=indices)
            add_guard(mbs, self, check_model)
        return self["oFFRFreducedOrder"]

    def _check_model(self, mbs: MainSystem) -> None:
        if not any(item is self for item in registered(mbs).bodies.values()):
            raise InputError(f"mbs: body {self.name!r} belongs to another model, or to this one before a Reset")

    def coordinates(self, result: Samples) -> Array:
        """Coordinates q, (n, n_dofs), at the times of `result`.

        Raises
        ------
        InputError
            If the result is none, or of another model.
        """
        validate_result(result)
        return np.hstack([result.sensor_of(self, s) for s in self["sCoordinates"]])

    def coordinates_t(self, result: Samples) -> Array:
        """Velocities of the coordinates, (n, n_dofs), at the times of `result`.

        Raises
        ------
        InputError
            If the result is none, or of another model.
        """
        validate_result(result)
        return np.hstack([result.sensor_of(self, s) for s in self["sCoordinates_t"]])

    def displacement(self, result: Samples, point: Array, *, fem: Static | None = None) -> Array:
        """Displacement of the node nearest to `point`, (n, 3) [m].

        Parameters
        ----------
        result : Result
        point : (3,) array
            In the body's own coordinates [m].
        fem : FEModel or recovery.StaticAnswer, optional
            The body's FE model, to add what the kept shapes lack of the static answer to contact forces (mode
            acceleration): it counts near a contact, such as on the far side of a plate. A StaticAnswer is factorised
            once for many points.

        Raises
        ------
        InputError
            If the point is far from the body, or the FE model is of another one.

        Warns
        -----
        ModelLimitWarning
            If there is no `fem`, and what is lacking is estimated to be more than 2 % of the history.
        """
        q = self.coordinates(result)
        kept = self._node(point).displacements(q)[:, 0]
        if fem is not None:
            return kept + self._lacking(result, point, fem)
        self._warn_near_contact(result, point, kept, "displacement", lambda force: force)
        return kept

    def velocity(self, result: Samples, point: Array, *, fem: Static | None = None) -> Array:
        """Velocity of the node nearest to `point`, (n, 3) [m/s]; see `displacement`.

        The part that `fem` adds is the rate of change of the contact forces' static answer from sample to sample.
        """
        q, q_t = self.coordinates(result), self.coordinates_t(result)
        kept = self._node(point).velocities(q, q_t)[:, 0]
        if len(result.t) < 2:
            return kept
        rate = partial(np.gradient, axis=0)
        if fem is not None:
            value: Array = kept + rate(self._lacking(result, point, fem), result.t)
            return value
        self._warn_near_contact(result, point, kept, "velocity", lambda force: rate(force, result.t))
        return kept

    def recover(self, result: Samples, rows: sp.csr_matrix, *, fem: Static | None = None) -> Array:
        """History of `rows` on the nodal displacements, (n, k): strains, stresses, as module `recovery` makes them.

        It is that of the kept shapes, and with `fem` (see `displacement`) of what they lack. Displacements are those
        within the frame, in its axes.

        Parameters
        ----------
        result : Result
        rows : (k, 3 nodes) csr matrix
        fem : FEModel or recovery.StaticAnswer, optional
        """
        kept = self.kinematics.elastic(self.coordinates(result)) @ self.body.reduced_rows(rows).T
        return kept if fem is None else kept + self._static_part(result, rows, fem)

    def momentum(self, result: Samples) -> Array:
        """Linear momentum of the body, (n, 3) [N s]."""
        return self.kinematics.momentum(self.coordinates_t(result))

    def angular_momentum(self, result: Samples, point: Sequence[float] = (0.0, 0.0, 0.0)) -> Array:
        """Angular momentum of the body about `point`, (3,) in space [m], (n, 3) [N m s].

        Raises
        ------
        InputError
            If the point is no vector of three numbers.
        """
        q, q_t = self.coordinates(result), self.coordinates_t(result)
        return self.kinematics.angular_momentum(q, q_t, validate_vector("point", point))

    def energy(self, result: Samples) -> Array:
        """Kinetic and strain energy, (n,) [J]."""
        q = self.coordinates(result)
        elastic = self.kinematics.elastic(q)
        strain = np.einsum("ij,ij->i", elastic, (self.body.stiffness @ elastic.T).T) / 2
        value: Array = self.kinematics.kinetic_energy(q, self.coordinates_t(result)) + strain
        return value

    def dissipated_energy(self, result: Samples) -> Array:
        """Energy that damping has taken from the body since the start of the result, (n,) [J].

        By the trapezoidal rule between samples, which must resolve the vibration.
        """
        q_t = self.coordinates_t(result)
        if self.damping is None:
            return np.zeros(len(result.t))
        value: Array = cumulative_trapezoid(np.sum(q_t * self.damping.force(q_t), axis=1), result.t, initial=0.0)
        return value

    def rigid_motion(self, q: Array) -> Array:
        """Rigid motion in coordinates q, (n, n_dofs): (n, 6), translation [m] and rotation [rad] of the whole body.

        Raises
        ------
        InputError
            If q has another shape.
        """
        return self.kinematics.rigid_motion(self._coordinates(q))

    def deformation(self, q: Array) -> Array:
        """Largest elastic displacement on the contact patch in coordinates q, (n, n_dofs): (n,) [m].

        Raises
        ------
        InputError
            If q has another shape.
        """
        q = self._coordinates(q)
        patches = self.kinematics.at(self.body.partition.patch_nodes)
        blocks = np.array_split(q, len(q) // _BLOCK + 1)  # a long run has more samples than memory holds patches
        return np.concatenate([abs(patches.deformation(block)).max(axis=(1, 2), initial=0.0) for block in blocks])

    def _lacking(self, result: Samples, point: Array, fem: Static) -> Array:
        """What the kept shapes lack of the displacement of a node, (n, 3) [m]."""
        own = node_dofs(np.array([self.body.nearest_node(point)]))
        select = sp.csr_matrix((np.ones(3), (np.arange(3), own)), shape=(3, self.body.fe_dofs))
        axes = self.kinematics.frame(self.coordinates(result))[1]
        value: Array = np.einsum("tab,tb->ta", axes, self._static_part(result, select, fem))
        return value

    def _warn_near_contact(
        self, result: Samples, point: Array, kept: Array, what: str, of_force: Callable[[Array], Array]
    ) -> None:
        """Warn if the static answer that `kept`, (n, 3), lacks may show at a point.

        A force on a patch of radius a yields the residual flexibility there, and at a distance d some a / (a + d) of
        it, as the surface of a half-space does (Boussinesq).
        """
        lacking = 0.0
        for contact in result.contacts:
            for item, number in contact.sides:
                if item is self and self.body.basis.flexibility is not None and contact.elastic:
                    patch = self.body.partition.patches[number]
                    area = nodal_area(self.body.points, patch.facets)[patch.nodes]
                    load = np.kron(area / area.sum(), patch.direction if patch.axes == "xyz" else 1.0)
                    radius = np.sqrt(area.sum() / np.pi)
                    away = np.linalg.norm(self.body.points[patch.nodes] - point, axis=1).min()
                    compliance = load @ self.body.flexibility(number) @ load * radius / (radius + away)
                    lacking += compliance * float(np.linalg.norm(of_force(contact.force(result))))
        size = float(np.linalg.norm(kept - kept[0])) if len(kept) else 0.0
        if lacking > _LACKING * size > 0:
            warnings.warn(
                f"body {self.name!r}: near a contact the {what} of a point lacks its static answer to the contact's "
                f"force; at {point} that is some {lacking / size:.2g} of it. Give the FE model, {what}(result, "
                "point, fem=fem)",
                ModelLimitWarning,
                stacklevel=3,
            )

    def _static_part(self, result: Samples, rows: sp.csr_matrix, fem: Static) -> Array:
        """Rows, (k, 3 nodes), on what the kept shapes lack of the static answer to the contacts' forces, (n, k)."""
        if not isinstance(fem, StaticAnswer):
            validate_type("fem", fem, FEModel, "fe_model()")
        total = np.zeros((len(result.t), rows.shape[0]))
        own = [c for c in result.contacts if c.elastic and any(item is self for item, _ in c.sides)]
        if self.body.basis.flexibility is None or not own:
            return total
        answer = fem if isinstance(fem, StaticAnswer) else StaticAnswer(fem, self.body)
        answer.check(self.body)
        # The flexibility is symmetric: answers to the rows as loads, at the nodes with forces.
        loaded = self.body.partition.patch_nodes
        fields = np.array([answer(row.toarray().reshape(-1, 3), loaded) for row in rows])
        axes = self.kinematics.frame(self.coordinates(result))[1]
        for contact in own:
            for (item, patch), forces in zip(contact.sides, contact.nodal_forces(result), strict=True):
                if item is self:
                    at_patch = fields[:, np.searchsorted(loaded, self.body.partition.patches[patch].nodes)]
                    total += np.einsum("tna,tab,knb->tk", forces, axes, at_patch, optimize=True)
        return total

    def _coordinates(self, q: Array) -> Array:
        """Coordinates that may be without end, of a run that became unstable."""
        if not isinstance(q, np.ndarray) or q.dtype.kind != "f" or q.ndim != 2 or q.shape[1] != self.body.n_dofs:
            got = f"one of {q.dtype} {q.shape}" if isinstance(q, np.ndarray) else type(q).__name__
            raise InputError(f"q: expected an array of floats of shape (n, {self.body.n_dofs}), got {got}")
        return q

    def _node(self, point: Array) -> Kinematics:
        return self.kinematics.at(np.array([self.body.nearest_node(point)]))


def check_model(mbs: MainSystem) -> None:
    """Refuse what would silently have no effect in a run of the model."""
    check_attachments(mbs, [*registered(mbs).bodies.values()])
