"""A partition body in an Exudyn model: its indices, markers and results."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import InputError
from ..fe.partition import interface_named
from ..fe.places import interpolation
from ..frames.damping import Damping, Ratios
from ..frames.floating import FloatingKinematics
from ..frames.inertia_forces import InertiaTerm
from ..frames.kinematics import Frame
from ..plasticity.flow import PlasticState
from ..reduction.body import ReducedBody
from ..reduction.matrices import BodyMatrices
from ..support.arrays import Array, Vector
from ..support.checks import validate_text, validate_vector
from ..support.foreign import ItemIndex, LoadIndex, MainSystem, MarkerIndex, ObjectIndex, UserFunction
from .attachments import add_guard, check_attachments
from .body_results import BodyResults, Kinematics
from .markers import add_interface_marker, add_point_marker, add_super_element, add_tied_marker
from .model import registered
from .surface_loads import loaded_area, surface_load
from .unchanged import check_unchanged, made


class PartitionBody(BodyResults):
    """Exudyn indices of a body by name, and its results; `CreatePartitionBody` returns it.

    Keys in an inertial frame: `nModal` if the basis has shapes, `nNodal` if it has nodal columns. Keys in a floating
    frame: `nRigid` and `nModal`; the rigid node has its own axes, `kinematics.node_axes` in the axes of the body. In
    both: `oGenericODE2`, and `sCoordinates` and `sCoordinates_t`, lists with a sensor for each node.

    The first marker, or superElement=True, adds the keys of Exudyn's own reduced bodies: `oFFRFreducedOrder`, to which
    superelement markers and sensors of FE nodes attach, and its nodes `nRigidBody` and `nGenericODE2`. A dict of these
    three is under `FFRFReducedOrderObjectDict`, and markers of interfaces are under `name:interface`.

    `point_markers` has the points of node and point markers outside of rigid interfaces, by the markers' numbers.
    `offset_markers` names the interfaces whose markers have offsets. `frame_markers` hold the rigid node of an inertial
    frame. `as_made` has what no run may find changed. `kinematics` is the motion of the body in space;
    `kinematics.at(nodes)` is that of nodes. `inertia_terms` are those that a floating frame keeps.
    """

    _inside = frozenset(
        {"as_made", "dampings", "frame_left_out", "frame_markers", "inertia_terms", "is_in", "kinematics", "mobility",
         "node_sizes", "offset_markers", "plastic_states", "point_markers", "ratios", "weight"}
    )  # fmt: skip

    def __init__(
        self,
        body: ReducedBody,
        name: str,
        kinematics: Kinematics,
        frame_left_out: tuple[str, ...],
        **indices: ItemIndex | list[ItemIndex],
    ) -> None:
        super().__init__(**indices)
        self.body, self.name, self.kinematics, self.frame_left_out = body, name, kinematics, frame_left_out
        self.point_markers: dict[int, Vector] = {}
        self.damping: Damping | None = None
        self.ratios: Ratios | None = None
        self.mobility: Array | None = None
        self.dampings: tuple[tuple[float, Damping], ...] = ()
        self.weight: Array | None = None
        self.inertia_terms: tuple[InertiaTerm, ...] = ()
        self.plastic_states: dict[int, PlasticState] = {}
        self.frame_markers: list[int] = []
        self.offset_markers: set[str] = set()
        self.as_made: dict[str, Any] = {}

    @property
    def frame(self) -> Frame:
        """The frame, "inertial" or "floating"."""
        return "floating" if isinstance(self.kinematics, FloatingKinematics) else "inertial"

    @property
    def position(self) -> Array:
        """Place of the origin of the body's mesh in space, (3,) [m]."""
        return self.kinematics.position

    @property
    def beta(self) -> float:
        """That of stiffness-proportional damping [s]; zero for other damping, and without any."""
        return 0.0 if self.damping is None else self.damping.beta

    @property
    def left_out(self) -> tuple[str, ...]:
        """What body and frame leave out, as a list of texts."""
        dents = ("the local dents of forces on node and point markers (an interface has their static answer)",)
        undamped = ("damping of the kept modes (damping= of CreatePartitionBody)",)
        said = self.body.left_out + self.frame_left_out
        return said + undamped * (self.damping is None) + dents * bool(self.point_markers)

    def matrices(self) -> BodyMatrices:
        """`ReducedBody.matrices` with the damping of this item.

        The damping is that of the body as joints held it in the last run, and of a free body before the first one.

        Raises
        ------
        InputError
            If the damping is that of a floating frame whose basis keeps nodes, which has coordinates of its own.
        """
        matrices = self.body.matrices()
        if self.damping is None:
            return matrices
        if self.frame == "floating" and len(self.body.basis.nodal):
            raise InputError(
                "body: its floating frame has coordinates of its own for the kept nodes; take those of the body, "
                "body.matrices(), or create it with frame='inertial'"
            )
        return replace(matrices, damping=self.damping.matrix())

    def CreateInterfaceMarker(self, mbs: MainSystem, interface: str) -> MarkerIndex:
        """Marker with the position and rotation of an interface, for any joint, spring-damper, load or sensor.

        Its place is the interface's `position`, its axes are those of the mesh at the start. If the basis keeps nodes,
        the marker is on a small rigid body that six constraints hold at the interface.

        Parameters
        ----------
        mbs : exudyn.MainSystem
        interface : str
            Name of the interface, as in `Partition.interface`.

        Returns
        -------
        exudyn.MarkerIndex
            The same in every call; also under the key "name:interface".

        Raises
        ------
        InputError
            If there is no such interface, or the body is not in this model.
        """
        interface_named(self.body.partition, interface, "interface")
        self._check_model(mbs)
        key = f"{self.name}:{interface}" if self.name else interface
        if key not in self:
            name = self.name and key
            if "nNodal" in self:
                self[key] = add_tied_marker(mbs, self.kinematics, self, interface, name)
            else:
                self[key] = add_interface_marker(mbs, self._super_element(mbs), self.kinematics, interface, name)
        return self[key]

    def CreateSurfaceLoad(
        self,
        mbs: MainSystem,
        interface: str,
        loadVector: Vector,
        *,
        bodyFixed: bool = False,
        loadVectorUserFunction: UserFunction | None = None,
        name: str = "",
    ) -> LoadIndex:
        """Uniform traction on the face of an averaged interface; the body's static answer to it is that of the FE mesh.

        A pressure p on a flat face with the outward normal n is loadVector=-p n with bodyFixed=True.

        Parameters
        ----------
        mbs : exudyn.MainSystem
        interface : str
            Name of an interface with kind="averaged" whose nodes are those of a face, and without `position`.
        loadVector : (3,)
            Force on each square metre [Pa], in global axes, or with `bodyFixed` in those of the interface.
        bodyFixed : bool
            Whether the traction turns with the interface.
        loadVectorUserFunction : callable, optional
            Function f(mbs, t, loadVector) that returns the traction at time t [Pa].
        name : str

        Returns
        -------
        exudyn.LoadIndex

        Raises
        ------
        InputError
            If an argument is wrong, there is no such interface, or its point is not the mean of its face.
        """
        joint = interface_named(self.body.partition, interface, "interface")
        area = loaded_area(self.body, joint)
        if interface in self.offset_markers:
            raise InputError(
                f"interface: the marker of {interface!r} has an offset, about which a traction has a moment; leave it "
                "out of superElementRigidMarkersOffsets"
            )
        load = surface_load(area, loadVector, bodyFixed, loadVectorUserFunction, validate_text("name", name))
        return load(mbs, self.CreateInterfaceMarker(mbs, interface))

    def CreateNodeMarker(self, mbs: MainSystem, point: Vector) -> MarkerIndex:
        """Position marker of the FE node nearest to `point`, (3,) in the body's own coordinates [m].

        It moves by the kept shapes. The static answer to forces of contacts and interfaces is exact, but the local dent
        of a force on this node is left out. For joints take an interface.

        Returns
        -------
        exudyn.MarkerIndex

        Raises
        ------
        InputError
            If the body is not in this model, or its basis keeps nodes and its frame is inertial.
        """
        point = validate_vector("point", point)
        return self._point_marker(mbs, point, np.array([self.body.nearest_node(point)]), np.ones(1))

    def CreatePointMarker(self, mbs: MainSystem, point: Vector) -> MarkerIndex:
        """Position marker of any point on or in the body, (3,) in the body's own coordinates [m].

        The point moves by the nodes around it, so that a force on it has its exact resultant and moment. Its local dent
        is left out, as with `CreateNodeMarker`.

        Returns
        -------
        exudyn.MarkerIndex

        Raises
        ------
        InputError
            If the point is outside the body, the body is not in this model, or its basis keeps nodes and its frame is
            inertial.
        """
        point = validate_vector("point", point)
        return self._point_marker(mbs, point, *interpolation(self.body.points, point))

    def _point_marker(self, mbs: MainSystem, point: Array, nodes: Array, weights: Array) -> MarkerIndex:
        self.body.check_nodes(nodes)
        marker = add_point_marker(mbs, self._super_element(mbs), nodes, weights)
        if not any(i.kind == "rigid" and np.isin(nodes, i.nodes).all() for i in self.body.partition.interfaces):
            self.point_markers[int(marker)] = point
        return marker

    def _super_element(self, mbs: MainSystem, color: Array | None = None, offsets: Array | None = None) -> ObjectIndex:
        """Add the object that carries markers, when it is first needed."""
        self._check_model(mbs)
        if "oFFRFreducedOrder" not in self:
            indices, self.frame_markers = add_super_element(
                mbs, self.kinematics, self, self.name, color=color, offsets=offsets
            )
            self.update(indices, FFRFReducedOrderObjectDict=indices)
            if offsets is not None:
                names = [interface.name for interface in self.body.partition.interfaces]
                self.offset_markers = {name for name, offset in zip(names, offsets, strict=True) if offset.any()}
            self.as_made = made(mbs, self)
            add_guard(mbs, self, check_model)
        return self["oFFRFreducedOrder"]

    def _check_model(self, mbs: MainSystem) -> None:
        if self not in registered(mbs).bodies.values():
            raise InputError(f"mbs: body {self.name!r} belongs to another model, or to this one before a Reset")


def check_model(mbs: MainSystem) -> None:
    """Raise if an item of the model would have no effect in a run, or was changed since it was made."""
    bodies = [*registered(mbs).bodies.values()]
    check_attachments(mbs, bodies)
    check_unchanged(mbs, bodies)


def largest_way(item: PartitionBody, start: Array, end: Array) -> float:
    """Largest way of a body's outermost nodes from one place to another, by its coordinates, (n,) each [m]."""
    points = item.body.points
    nodes = np.unique(np.concatenate([points.argmin(axis=0), points.argmax(axis=0)]))
    before, after = item.kinematics.at(nodes).place(np.array([start, end]))
    return float(np.linalg.norm(after - before, axis=1).max())
