"""Exudyn adapter: a super element that lends partition bodies Exudyn's markers, and what its mesh nodes are.

An ObjectFFRFreducedOrder without stiffness and inertia forces, on the body's own nodes, is a body to Exudyn's
superelement markers and sensors, and to a LoadMassProportional on its MarkerBodyMass: it has the integrals that gravity
takes. Module `attachments` refuses what else would reach it. Its mesh nodes are those of the FE model, with the same
numbers, followed by three for each interface, which move as the interface does: by its mean translation and rotation.

The super element needs a rigid body's node and one for modes. A floating body has both. An inertial body moves within a
node of its own that six coordinate constraints hold, which Exudyn's explicit solvers eliminate.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..errors import InputError
from ..fe.model import node_dofs
from ..frames.floating import FloatingKinematics
from ..frames.inertial import InertialKinematics
from ..support.arrays import Array
from ..support.checks import validate_vector
from ..support.foreign import ItemIndex, MainSystem, MarkerIndex, NodeIndex, ObjectIndex
from ..support.optional import require

Kinematics = InertialKinematics | FloatingKinematics

_TRIANGLE = np.eye(3) - 1 / 3  # three points around an interface: the fewest that turn
_SMALL = 1e-6  # mass of what constraints hold to an interface, of the body's
_NEAR = 12  # nodes of which a point's motion is interpolated: more than are in one plane of a tetrahedron or hexahedron


def add_super_element(
    mbs: MainSystem, kinematics: Kinematics, nodes: Mapping[str, ItemIndex], name: str
) -> tuple[dict[str, ItemIndex], list[int]]:
    """Add the super element of a body.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    kinematics : InertialKinematics or FloatingKinematics
    nodes : dict
        Exudyn nodes of the body, `nModal` if it has elastic coordinates, and `nRigid` of a floating frame.
    name : str

    Returns
    -------
    dict, list of int
        `oFFRFreducedOrder` and its nodes `nRigidBody` and `nGenericODE2`, and the markers that hold the former.

    Raises
    ------
    InputError
        If the body's basis has nodal columns, which have an Exudyn node of their own in an inertial frame.
    """
    exu, items = require("exudyn"), require("exudyn.itemInterface")
    body = kinematics.body
    if isinstance(kinematics, InertialKinematics) and len(body.basis.nodal):
        raise InputError(
            f"body: basis {body.basis.name!r} keeps nodes as coordinates, which Exudyn's superelement markers cannot "
            "follow. Take frame='floating', or reduce the body with basis='contact-adapted', 'residual' or "
            "'craig-bampton', or attach to rows of its coordinates: body.interface_rows() on a "
            "MarkerObjectODE2Coordinates of its 'oGenericODE2'"
        )
    rigid, held = (nodes["nRigid"], []) if "nRigid" in nodes else _add_held_node(mbs, kinematics, name)
    places, rows = mesh(kinematics)
    turn = kinematics.node_axes
    rows = (turn.T @ rows.reshape(len(places), 3, rows.shape[1])).reshape(rows.shape)
    if "nModal" in nodes:
        modal, integral = nodes["nModal"], kinematics.mass_integral
    else:
        modal, rows, integral = _add_idle_node(mbs), np.zeros((len(rows), 1)), np.zeros((3, 1))
    nothing = exu.MatrixContainer(np.zeros((rows.shape[1],) * 2))
    number = mbs.AddObject(
        items.ObjectFFRFreducedOrder(
            name=name and f"{name}:markers",
            nodeNumbers=[rigid, modal],
            massMatrixReduced=nothing,
            stiffnessMatrixReduced=nothing,
            computeFFRFterms=False,
            mass=body.total_mass,
            mPhitTPsi=integral,
            modeBasis=rows,
            referencePositions=(places @ turn).ravel(),
            visualization=items.VObjectFFRFreducedOrder(show=False),
        )
    )
    return {"nRigidBody": rigid, "nGenericODE2": modal, "oFFRFreducedOrder": number}, held


def _add_held_node(mbs: MainSystem, kinematics: Kinematics, name: str) -> tuple[NodeIndex, list[int]]:
    """Add a node at the centre of mass, held by six constraints, which are returned; explicit solvers want its mass."""
    items = require("exudyn.itemInterface")
    origin = kinematics.frame(np.zeros(kinematics.body.n_dofs))[0]
    node = mbs.AddNode(items.NodeRigidBodyRxyz(name=name and f"{name}:frame", referenceCoordinates=[*origin, 0, 0, 0]))
    mbs.AddObject(
        items.ObjectRigidBody(
            nodeNumber=node, mass=1.0, inertia=[1.0] * 3 + [0.0] * 3, visualization=items.VObjectRigidBody(show=False)
        )
    )
    ground = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(items.NodePointGround()), coordinate=0))
    held = []
    for coordinate in range(6):
        marker = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate))
        mbs.AddObject(items.ObjectConnectorCoordinate(markerNumbers=[ground, marker]))
        held.append(int(marker))
    return node, held


def _add_idle_node(mbs: MainSystem) -> NodeIndex:
    """Node of one coordinate that nothing moves, for a floating body without elastic coordinates."""
    exu, items = require("exudyn"), require("exudyn.itemInterface")
    node = mbs.AddNode(
        items.NodeGenericODE2(
            referenceCoordinates=[0.0], initialCoordinates=[0.0], initialCoordinates_t=[0.0], numberOfODE2Coordinates=1
        )
    )
    one = exu.MatrixContainer(np.eye(1))
    mbs.AddObject(
        items.ObjectGenericODE2(
            nodeNumbers=[node],
            massMatrix=one,
            stiffnessMatrix=one,
            visualization=items.VObjectGenericODE2(show=False),
        )
    )
    return node


def mesh(kinematics: Kinematics) -> tuple[Array, Array]:
    """Mesh nodes of the super element: places, (m, 3) [m], and displacements by the modes, (3m, n), in body's axes."""
    body = kinematics.body
    known = np.arange(len(body.points)) if body.basis.shape_nodes is None else body.basis.shape_nodes
    of_known = np.asarray(kinematics.at(known).rows)
    of_all = np.full((3 * len(body.points), of_known.shape[1]), np.nan)  # what is not known must not look like rest
    of_all[node_dofs(known)] = of_known
    places, rows = [body.points - body.centre_of_mass], [of_all]
    for interface in body.partition.interfaces:
        motion = interface.motion @ kinematics.at(interface.nodes).rows
        arms = np.ptp(body.points, axis=0).max() * _TRIANGLE  # small ones would turn round-off into moments
        places.append(interface.position - body.centre_of_mass + arms)
        turning = np.cross(motion[3:].T[None], arms[:, None])  # (3, n, 3)
        rows.append((motion[:3] + turning.swapaxes(1, 2)).reshape(-1, motion.shape[1]))
    return np.vstack(places), np.vstack(rows)


def add_interface_marker(
    mbs: MainSystem, super_element: ObjectIndex, kinematics: Kinematics, interface: str, name: str
) -> MarkerIndex:
    """Add a MarkerSuperElementRigid that moves as an interface, with the body's axes; returns its number."""
    items, body = require("exudyn.itemInterface"), kinematics.body
    names = [joint.name for joint in body.partition.interfaces]
    first = len(body.points) + 3 * names.index(interface)
    frame = np.eye(4)
    frame[:3, :3] = kinematics.node_axes.T
    return mbs.AddMarker(
        items.MarkerSuperElementRigid(
            name=name,
            bodyNumber=super_element,
            meshNodeNumbers=list(range(first, first + 3)),
            weightingFactors=[1 / 3] * 3,
            localHT=frame,
            visualization=items.VMarkerSuperElementRigid(showMarkerNodes=False),
        )
    )


def add_tied_marker(
    mbs: MainSystem, kinematics: Kinematics, nodes: Mapping[str, ItemIndex], interface: str, name: str
) -> MarkerIndex:
    """Add a small rigid body that six constraints hold to an interface, for bases with nodal columns.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    kinematics : InertialKinematics
    nodes : dict
        The body's `oGenericODE2` and its nodes, `nModal` and `nNodal`.
    interface, name : str
        Of the body, and for Exudyn.

    Returns
    -------
    exudyn.MarkerIndex
    """
    items, body = require("exudyn.itemInterface"), kinematics.body
    rows = body.interface_rows(interface)
    place = kinematics.position + body.partition.find_interface(interface).position
    parts = [nodes[key] for key in ("nModal", "nNodal") if key in nodes]
    coordinates_t = np.concatenate([mbs.GetNodeParameter(node, "initialCoordinates_t") for node in parts])
    node = mbs.AddNode(
        items.NodeRigidBodyRxyz(
            name=name, referenceCoordinates=[*place, 0, 0, 0], initialVelocities=rows @ coordinates_t
        )
    )
    mass = _SMALL * body.total_mass
    foot = mbs.AddObject(
        items.ObjectRigidBody(
            name=name,
            nodeNumber=node,
            mass=mass,
            inertia=[mass * np.ptp(body.points, axis=0).max() ** 2] * 3 + [0.0] * 3,
            visualization=items.VObjectRigidBody(show=False),
        )
    )
    mbs.AddObject(
        items.ObjectConnectorCoordinateVector(
            name=name and f"{name}:tie",
            markerNumbers=[
                mbs.AddMarker(items.MarkerNodeCoordinates(nodeNumber=node)),
                mbs.AddMarker(items.MarkerObjectODE2Coordinates(objectNumber=nodes["oGenericODE2"])),
            ],
            scalingMarker0=np.eye(6),
            scalingMarker1=rows,
            offset=[*(-place), 0, 0, 0],  # of the node's reference coordinates
        )
    )
    return mbs.AddMarker(items.MarkerBodyRigid(name=name, bodyNumber=foot))


def add_point_marker(mbs: MainSystem, super_element: ObjectIndex, nodes: Array, weights: Array) -> MarkerIndex:
    """Add a MarkerSuperElementPosition at the weighted mean of nodes, (k,); returns its number."""
    return mbs.AddMarker(
        require("exudyn.itemInterface").MarkerSuperElementPosition(
            bodyNumber=super_element, meshNodeNumbers=[*map(int, nodes)], weightingFactors=weights
        )
    )


def interpolation(points: Array, point: Array) -> tuple[Array, Array]:
    """Nodes around a point, (k,), and weights, (k,), that reproduce every linear field there.

    So a force at the point has its resultant and moment exactly. Of all such weights, those with the smallest sum of
    squares of distance times weight: a node at the point alone counts.

    Parameters
    ----------
    points : (n, 3) array
        Nodes [m].
    point : (3,) array
        [m]

    Raises
    ------
    InputError
        If the point is further from the nearest nodes than they are from each other.
    """
    point = validate_vector("point", point)
    distance = np.linalg.norm(points - point, axis=1)
    near = np.argsort(distance, kind="stable")[:_NEAR]
    arms, size = points[near] - point, distance[near[-1]]
    if distance[near[0]] > np.linalg.norm(points[near[1:]] - points[near[0]], axis=1).max():
        raise InputError(
            f"point: expected a point on or in the body, got {point}, {distance[near[0]]:.4g} m away from its nearest "
            f"node at {points[near[0]]}; points are given in the body's own coordinates, those of its mesh"
        )
    if distance[near[0]] < 1e-9 * size:
        return near[:1], np.ones(1)
    closeness = size / distance[near]
    linear = np.vstack([np.ones(len(near)), arms.T / size])
    return near, closeness * np.linalg.lstsq(linear * closeness, np.array([1.0, 0, 0, 0]), rcond=None)[0]
