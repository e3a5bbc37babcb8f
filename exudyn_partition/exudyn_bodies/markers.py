"""Exudyn adapter: a super element to which Exudyn's markers of a partition body attach, and its mesh nodes.

The super element is an ObjectFFRFreducedOrder on the body's own nodes, without stiffness and inertia forces. Exudyn's
superelement markers and sensors take it as a body. So does a LoadMassProportional on its MarkerBodyMass, because it has
the mass integrals that gravity needs. Module `attachments` raises for all other items on it. Its mesh nodes are those
of the FE model, with the same numbers. Three more follow for each interface; they move by its mean translation and
rotation.

The super element needs a node of a rigid body and a node for modes. A floating body has both. An inertial body gets a
rigid node of its own, which six coordinate constraints hold; Exudyn's explicit solvers eliminate them.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..errors import InputError
from ..fe.facets import flat_triangles
from ..fe.model import node_dofs
from ..fe.partition import interface_named
from ..frames.floating import FloatingKinematics
from ..frames.inertial import InertialKinematics
from ..support.arrays import Array
from ..support.foreign import ItemIndex, MainSystem, MarkerIndex, NodeIndex, ObjectIndex
from ..support.optional import require

Kinematics = InertialKinematics | FloatingKinematics

EXUDYN_COLOUR = (-1.0,) * 4  # which Exudyn takes for the colour of its visualization settings

_TRIANGLE = np.eye(3) - 1 / 3  # three points around an interface: the least number that has a rotation
_SMALL = 1e-6  # mass of the small body at an interface, relative to the body's mass


def add_super_element(
    mbs: MainSystem,
    kinematics: Kinematics,
    nodes: Mapping[str, ItemIndex],
    name: str,
    *,
    color: Array | None = None,
    offsets: Array | None = None,
) -> tuple[dict[str, ItemIndex], list[int]]:
    """Add the super element of a body.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    kinematics : InertialKinematics or FloatingKinematics
    nodes : dict
        Exudyn nodes of the body: `nModal` if it has elastic coordinates, `nRigid` if its frame is floating.
    name : str
    color : (4,) array, optional
        Red, green, blue and opacity of the surface; below zero for that of Exudyn's settings. Default: not drawn.
    offsets : (n, 3) array, optional
        Of the markers from the points of the n interfaces [m].

    Returns
    -------
    dict, list of int
        `oFFRFreducedOrder` and its nodes `nRigidBody` and `nGenericODE2`; and the markers that hold `nRigidBody`.

    Raises
    ------
    InputError
        If the frame is inertial and the body's basis has nodal columns, which then have an Exudyn node of their own.
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
    rigid, carrier_markers = (nodes["nRigid"], []) if "nRigid" in nodes else _add_held_node(mbs, kinematics, name)
    places, rows = mesh(kinematics, offsets)
    turn = kinematics.node_axes
    rows = (turn.T @ rows.reshape(len(places), 3, rows.shape[1])).reshape(rows.shape)
    if "nModal" in nodes:
        modal, integral = nodes["nModal"], kinematics.mass_integral
    else:
        modal, rows, integral = _add_idle_node(mbs, body.f_cut), np.zeros((len(rows), 1)), np.zeros((3, 1))
    triangles = flat_triangles(body.facets)[0]
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
            visualization=items.VObjectFFRFreducedOrder(
                show=color is not None, triangleMesh=triangles, color=EXUDYN_COLOUR if color is None else color
            ),
        )
    )
    return {"nRigidBody": rigid, "nGenericODE2": modal, "oFFRFreducedOrder": number}, carrier_markers


def _add_held_node(mbs: MainSystem, kinematics: Kinematics, name: str) -> tuple[NodeIndex, list[int]]:
    """Add a node at the centre of mass, and six constraints that hold it; return it with the constrained markers.

    Explicit solvers need a mass at the node; it is the body's, so that joints are as well conditioned in any units.
    """
    items, body = require("exudyn.itemInterface"), kinematics.body
    origin = kinematics.frame(np.zeros(body.n_dofs))[0]
    node = mbs.AddNode(items.NodeRigidBodyRxyz(name=name and f"{name}:frame", referenceCoordinates=[*origin, 0, 0, 0]))
    mbs.AddObject(
        items.ObjectRigidBody(
            nodeNumber=node,
            mass=body.total_mass,
            inertia=[body.total_mass * np.ptp(body.points, axis=0).max() ** 2] * 3 + [0.0] * 3,
            visualization=items.VObjectRigidBody(show=False),
        )
    )
    ground = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(items.NodePointGround()), coordinate=0))
    markers = []
    for coordinate in range(6):
        marker = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate))
        mbs.AddObject(items.ObjectConnectorCoordinate(markerNumbers=[ground, marker]))
        markers.append(int(marker))
    return node, markers


def _add_idle_node(mbs: MainSystem, frequency: float) -> NodeIndex:
    """Add a node with one coordinate that stays at rest, for a floating body without elastic coordinates.

    At the frequency [Hz] of the body's highest modes it changes no step, and is no motion that nothing holds.
    """
    exu, items = require("exudyn"), require("exudyn.itemInterface")
    node = mbs.AddNode(
        items.NodeGenericODE2(
            referenceCoordinates=[0.0], initialCoordinates=[0.0], initialCoordinates_t=[0.0], numberOfODE2Coordinates=1
        )
    )
    mass, stiffness = (exu.MatrixContainer(value * np.eye(1)) for value in (1.0, (2 * np.pi * frequency) ** 2))
    mbs.AddObject(
        items.ObjectGenericODE2(
            nodeNumbers=[node],
            massMatrix=mass,
            stiffnessMatrix=stiffness,
            visualization=items.VObjectGenericODE2(show=False),
        )
    )
    return node


def mesh(kinematics: Kinematics, offsets: Array | None = None) -> tuple[Array, Array]:
    """Places of the super element's mesh nodes, (m, 3) [m], and their modes, (3m, n), in the body's axes.

    `offsets`, (k, 3) [m], are those of the markers from the points of the k interfaces.
    """
    body = kinematics.body
    known = np.arange(len(body.points)) if body.basis.shape_nodes is None else body.basis.shape_nodes
    of_known = np.asarray(kinematics.at(known).rows)
    of_all = np.full((3 * len(body.points), of_known.shape[1]), np.nan)  # unknown displacements must not look like zero
    of_all[node_dofs(known)] = of_known
    places, rows = [body.points - body.centre_of_mass], [of_all]
    interfaces = body.partition.interfaces
    offsets = np.zeros((len(interfaces), 3)) if offsets is None else offsets
    for interface, offset in zip(interfaces, offsets, strict=True):
        motion = interface.motion @ kinematics.at(interface.nodes).rows
        arms = offset + np.ptp(body.points, axis=0).max() * _TRIANGLE  # short arms would turn round-off into moments
        places.append(interface.position - body.centre_of_mass + arms)
        turning = np.cross(motion[3:].T[None], arms[:, None])  # (3, n, 3)
        rows.append((motion[:3] + turning.swapaxes(1, 2)).reshape(-1, motion.shape[1]))
    return np.vstack(places), np.vstack(rows)


def add_interface_marker(
    mbs: MainSystem, super_element: ObjectIndex, kinematics: Kinematics, interface: str, name: str
) -> MarkerIndex:
    """Add a MarkerSuperElementRigid that moves like an interface, with the body's axes; return its number."""
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
    """Add a marker on a small rigid body that six constraints hold at an interface, for bases with nodal columns.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    kinematics : InertialKinematics
    nodes : dict
        The body's `oGenericODE2` and its nodes, `nModal` and `nNodal`.
    interface, name : str
        Name of the body's interface, and name of the new items in Exudyn.

    Returns
    -------
    exudyn.MarkerIndex
    """
    items, body = require("exudyn.itemInterface"), kinematics.body
    rows = body.interface_rows(interface)
    place = kinematics.position + interface_named(body.partition, interface, "interface").position
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
            offset=[*(-place), 0, 0, 0],  # for the node's reference coordinates
        )
    )
    return mbs.AddMarker(items.MarkerBodyRigid(name=name, bodyNumber=foot))


def add_point_marker(mbs: MainSystem, super_element: ObjectIndex, nodes: Array, weights: Array) -> MarkerIndex:
    """Add a MarkerSuperElementPosition at the weighted mean of nodes, (k,); return its number."""
    return mbs.AddMarker(
        require("exudyn.itemInterface").MarkerSuperElementPosition(
            bodyNumber=super_element, meshNodeNumbers=[*map(int, nodes)], weightingFactors=weights
        )
    )
