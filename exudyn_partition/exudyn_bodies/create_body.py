"""Exudyn adapter: partition bodies as nodes, objects, user functions and sensors of a model (paper, eq. 17)."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..frames.damping import Damping, ModeDamping, Ratios
from ..frames.floating import ActingMass, FloatingKinematics
from ..frames.inertia_forces import TERMS, InertiaForces, InertiaTerm
from ..frames.kinematics import FrameChoice
from ..plasticity.flow import PlasticState
from ..reduction.body import ReducedBody
from ..support.arrays import Array, Vector
from ..support.checks import validate_flag
from ..support.foreign import MainSystem, NodeIndex, ObjectIndex
from ..support.optional import require
from ..support.spelling import spelled
from .body_plan import ORIGIN, BodyPlan, Drawing, plan_body
from .held_damping import add_damping_sensor
from .model import registry
from .partition_body import PartitionBody
from .stiffening_steps import SteppedStiffening
from .unchanged import made
from .user_functions import RIGID, Functions, coupling_functions, inertia_functions, stiffening_functions


@spelled
def CreatePartitionBody(
    mbs: MainSystem,
    body: ReducedBody,
    *,
    name: str = "",
    frame: FrameChoice | None = None,
    referencePosition: Vector = ORIGIN,
    referenceRotationMatrix: Sequence[Vector] | Array | None = None,
    initialVelocity: Vector = (0.0, 0.0, 0.0),
    initialAngularVelocity: Vector = (0.0, 0.0, 0.0),
    gravity: Vector = (0.0, 0.0, 0.0),
    plasticStates: Mapping[int | str, PlasticState] | None = None,
    damping: Ratios | None = None,
    massProportionalDamping: float = 0.0,
    stiffnessProportionalDamping: float = 0.0,
    inertiaTerms: Collection[InertiaTerm] = tuple(TERMS),
    superElement: bool = False,
    color: Vector | None = None,
    superElementRigidMarkersOffsets: Sequence[Vector] | Array | None = None,
    showMarkers: bool = True,
    verbose: bool = False,
    referenceRotation: Sequence[Vector] | Array | None = None,
    positionRef: Vector | None = None,
    rotationMatrixRef: Sequence[Vector] | Array | None = None,
) -> PartitionBody:
    """Add a reduced body to a model.

    Inertial frame: a NodeGenericODE2 holds the coordinates of the shapes. A second one holds the nodal coordinates of
    the paper's basis. An ObjectGenericODE2 has the matrices: identity mass and diagonal stiffness go to Exudyn
    unchanged. The coupling of shapes and nodes is applied as a sparse product on Exudyn's own coordinates.

    Floating frame: a NodeRigidBodyRotVecLG at the centre of mass replaces the six rigid shapes. A NodeGenericODE2 holds
    the elastic coordinates, if there are any. With the paper's basis, these are shapes and nodal columns without their
    rigid motion (module `mean_axes`), and a user function applies their stiffness. The mass is constant, and a user
    function applies the inertia forces (module `inertia_forces`). There are no algebraic equations, so every solver of
    Exudyn can run the body. The axes of the rigid node differ from those of the body by one degree, because rotation
    vectors lose digits near zero. Markers of interfaces have the axes of the body.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    body : ReducedBody
    name : str
    frame : {"inertial", "floating", "auto"}, optional
        "inertial": rotations of the body are small, translations may be large. "floating": the axes rotate with the
        body, by any angle. "auto": floating if an initial angular velocity or a reference rotation is given, inertial
        otherwise. A body that other bodies will turn needs "floating". Default: "floating" with superElement=True, as
        Exudyn's own reduced bodies have it, and "inertial" otherwise.
    referencePosition : (3,)
        Place of the origin of the body's mesh in space [m].
    referenceRotationMatrix : (3, 3), optional
        Rotation matrix from the axes of the body's mesh to the global axes; needs a floating frame.
    initialVelocity : (3,)
        Velocity of the centre of mass [m/s].
    initialAngularVelocity : (3,)
        Angular velocity in global axes [rad/s].
    inertiaTerms : collection of str
        Inertia forces of a floating frame to keep, from `TERMS`: "gyroscopic", "coriolis", "centrifugal" and
        "coupling". Default: all. "coupling" is left out where joints, springs or loads act, and of bodies with
        geometric stiffness: see `FloatingKinematics.on_constant_mass`. `left_out` of the returned body says what is
        missing.
    gravity : (3,)
        Acceleration of gravity [m/s2], applied as a constant force.
    plasticStates : dict of int or str to PlasticState, optional
        What an earlier impact has left in the plastic zones of patches, by their number or name: see
        `PlasticResults.states`. The body begins with the shape that they give it. Default: it never yielded.
    damping : float, sequence, callable or Rayleigh, optional
        Damping of vibration: one ratio for all modes, one ratio for each elastic mode in order of frequency, a function
        from frequencies [Hz] to ratios, or `Rayleigh(alpha, beta)`. The modes are those of the body as joints, clamps
        and drives of the model hold it, with other bodies rigid. A body that only contacts or springs support has the
        ratios of its free modes. Deformations that joints prevent come last in a sequence. Bases that keep nodes need
        Rayleigh. Rigid motion is not damped. Default: none. Damping lowers the explicit stability limit.
    massProportionalDamping, stiffnessProportionalDamping : float
        Exudyn's names for `damping=Rayleigh(alpha, beta)` [1/s], [s]; instead of `damping`.
    superElement : bool
        Whether to add at once the object for Exudyn's superelement markers and sensors, `oFFRFreducedOrder`, and a
        marker for each interface. The result then has the keys of `mbs.CreateFFRFReducedOrderObject` and of
        `ObjectFFRFreducedOrderInterface.AddObjectFFRFreducedOrder`. If False, they are added when first asked for.
        Exudyn then draws the body's surface, until a `CreatePartitionView` does.
        With superElement=True the rigid node has the axes of the mesh, so that markers that a model itself attaches to
        FE nodes have them too. But near zero rotation Exudyn keeps only 8 digits of it, and forces of stiff joints are
        noisy with steps of microseconds.
    color : (4,), optional
        Red, green, blue and opacity of the body that superElement=True draws, each 0 to 1. Default: Exudyn's.
    superElementRigidMarkersOffsets : (n, 3), optional
        Offsets of the markers from the points of the n interfaces, in the axes of the mesh [m]; needs
        superElement=True. Each marker is fixed to its interface, and turns with it.
    showMarkers : bool
        Whether Exudyn draws the markers of interfaces that superElement=True adds.
    verbose : bool
        Whether to print what the body is, and what it leaves out.
    positionRef, referenceRotation, rotationMatrixRef :
        Other names of `referencePosition` and `referenceRotationMatrix`, as in Exudyn's `AddObjectFFRFreducedOrder`.

    Returns
    -------
    PartitionBody

    Raises
    ------
    InputError
        If `mbs` is no model, an argument is out of range, or the model has an item of that name. Also if the frame is
        floating and the body has no inertia about some axis; if something is given by two names; or if an argument has
        no effect.

    Warns
    -----
    UnitsWarning
        If a damping ratio is above 1, or gravity is that of the earth in other units than the material's.
    """
    validate_flag("verbose", verbose)
    plan = plan_body(
        mbs, body, name=name, frame=frame, referencePosition=referencePosition, positionRef=positionRef,
        referenceRotationMatrix=referenceRotationMatrix, referenceRotation=referenceRotation,
        rotationMatrixRef=rotationMatrixRef, initialVelocity=initialVelocity,
        initialAngularVelocity=initialAngularVelocity, gravity=gravity, plasticStates=plasticStates, damping=damping,
        massProportionalDamping=massProportionalDamping, stiffnessProportionalDamping=stiffnessProportionalDamping,
        inertiaTerms=inertiaTerms, superElement=superElement, color=color,
        superElementRigidMarkersOffsets=superElementRigidMarkersOffsets, showMarkers=showMarkers,
    )  # fmt: skip
    item = _add_body(mbs, plan)
    if verbose:
        print(f"{name or 'body'}: {body!r}, frame {item.frame!r}", *item.left_out, sep="\n  left out: ")
    return item


def _add_body(mbs: MainSystem, plan: BodyPlan) -> PartitionBody:
    """Add a planned body to a model, with its weight, sensors, and what draws it."""
    if isinstance(plan.kinematics, FloatingKinematics):
        item = _add_floating(mbs, plan, plan.kinematics)
    else:
        item = _add_inertial(mbs, plan)
    item.damping, item.ratios = plan.damping, plan.ratios
    item.plastic_states.update(plan.plastic_states)
    if plan.weight is not None:
        item.weight = plan.weight
        mbs.SetObjectParameter(item["oGenericODE2"], "forceVector", item.weight)
    exu, items = require("exudyn"), require("exudyn.itemInterface")
    for key, kind in (
        ("sCoordinates", exu.OutputVariableType.Coordinates),
        ("sCoordinates_t", exu.OutputVariableType.Coordinates_t),
    ):
        item[key] = [
            mbs.AddSensor(items.SensorNode(nodeNumber=n, outputVariableType=kind, storeInternal=True))
            for n in item.nodes
        ]
    item.as_made = made(mbs, item)
    registry(mbs).enter_body(int(item["oGenericODE2"]), item)
    if plan.damping is not None:
        item.dampings = ((-np.inf, plan.damping),)
        add_damping_sensor(mbs)
    if plan.drawing is not None:
        _draw(mbs, item, plan.drawing)
    return item


def _draw(mbs: MainSystem, item: PartitionBody, drawing: Drawing) -> None:
    """Add the object that draws a body, and a marker for each interface."""
    item._super_element(mbs, drawing.color, drawing.offsets)
    for interface in item.body.partition.interfaces:
        marker = item.CreateInterfaceMarker(mbs, interface.name)
        if not drawing.markers:
            mbs.SetMarkerParameter(marker, "Vshow", False)


def _add_inertial(mbs: MainSystem, plan: BodyPlan) -> PartitionBody:
    """Add the nodes and the object of a body in an inertial frame."""
    body = plan.body
    velocities = body.rigid @ np.r_[plan.velocity, plan.angular_velocity]
    parts = {"nModal": slice(body.n_shapes), "nNodal": slice(body.n_shapes, None)}
    indices = {
        key: _add_node(mbs, plan.start[part], velocities[part]) for key, part in parts.items() if len(velocities[part])
    }
    said = ("large rotation, and the inertia forces of a rotating frame (frame='floating')",)
    item = PartitionBody(body, plan.name, plan.kinematics, said, **indices)
    diagonal = sp.diags(np.r_[body.basis.omega**2, np.zeros(body.n_dofs - body.n_shapes)], format="csr")
    functions: Functions = {}
    stiffening = None if body.stiffening is None else SteppedStiffening(body.stiffening, body)
    if "nNodal" in indices:
        functions = coupling_functions(item, body.stiffness - diagonal, _present(item, plan.damping), stiffening)
    elif stiffening is not None:
        functions = stiffening_functions(stiffening)
    item["oGenericODE2"] = _add_object(mbs, item, body.mass, diagonal, functions, plan.damping)
    return item


def _add_floating(mbs: MainSystem, plan: BodyPlan, kinematics: FloatingKinematics) -> PartitionBody:
    """Add the nodes and the object of a body in a floating frame."""
    exu, items = require("exudyn"), require("exudyn.itemInterface")
    body, inertia, terms = plan.body, kinematics.inertia, plan.terms
    stiffening = None if kinematics.stiffening is None else SteppedStiffening(kinematics.stiffening, body)
    if body.stiffening is None and "coupling" not in terms:
        kinematics.acting = ActingMass(constant=True, settled=True)
    axes = kinematics.frame(np.zeros(body.n_dofs))[1] @ kinematics.node_axes
    indices = {
        "nRigid": mbs.AddNode(
            items.NodeRigidBodyRotVecLG(
                name=plan.name,
                referenceCoordinates=[*kinematics.origin, *kinematics.rotation],
                initialVelocities=[*plan.velocity, *(plan.angular_velocity @ axes)],
            )
        )
    }
    if body.n_dofs > RIGID:  # a compact body may have no elastic coordinates
        indices["nModal"] = _add_node(mbs, plan.start[RIGID:], np.zeros(body.n_dofs - RIGID))
    said = [
        sentence + " (inertiaTerms)" * (body.stiffening is None or term != "coupling")
        for term, sentence in TERMS.items()
        if term not in terms
    ]
    if "coupling" in terms:
        said.append("where joints, springs or loads act: the change of the body's inertia by its deformation")
    item = PartitionBody(body, plan.name, kinematics, tuple(said), **indices)
    item.inertia_terms = terms
    mass = sp.block_diag(
        [body.total_mass * sp.identity(3), inertia.tensor, sp.identity(body.n_dofs - RIGID)], format="csr"
    )
    if len(body.basis.nodal):
        forces = InertiaForces(inertia, kinematics.elastic_force, terms)
        functions = inertia_functions(
            exu,
            item,
            kinematics.acting,
            forces,
            lambda: kinematics.elastic_stiffness,
            _present(item, plan.damping),
            stiffening,
        )
        stiffness = sp.csr_matrix((body.n_dofs,) * 2)
    else:
        omega_squared = body.basis.omega**2
        forces = InertiaForces(inertia, omega_squared[RIGID:].__mul__, terms)
        functions = inertia_functions(exu, item, kinematics.acting, forces, stiffening=stiffening)
        stiffness = sp.diags(omega_squared, format="csr")
    item["oGenericODE2"] = _add_object(mbs, item, mass, stiffness, functions, plan.damping)
    return item


def _present(item: PartitionBody, damping: Damping | None) -> Callable[[], Any] | None:
    """Function that returns the body's damping as joints hold it; None if there is none."""
    return None if damping is None else lambda: item.damping


def _add_node(mbs: MainSystem, coordinates: Array, velocities: Array) -> NodeIndex:
    """Add the node of a body's coordinates, with their initial values."""
    return mbs.AddNode(
        require("exudyn.itemInterface").NodeGenericODE2(
            referenceCoordinates=[0.0] * len(coordinates),
            initialCoordinates=list(coordinates),
            initialCoordinates_t=list(velocities),
            numberOfODE2Coordinates=len(velocities),
        )
    )


def _add_object(
    mbs: MainSystem,
    item: PartitionBody,
    mass: sp.csr_matrix,
    stiffness: sp.csr_matrix,
    functions: Functions,
    damping: Damping | None,
) -> ObjectIndex:
    """Add the object of a body, with its matrices, (n, n), and user functions, on the nodes that it has."""
    exu, items = require("exudyn"), require("exudyn.itemInterface")
    if isinstance(damping, ModeDamping):  # the functions apply other damping
        functions = {"dampingMatrix": exu.MatrixContainer(damping.matrix()), **functions}
    return mbs.AddObject(
        items.ObjectGenericODE2(
            name=item.name,
            nodeNumbers=item.nodes,
            massMatrix=exu.MatrixContainer(sp.csr_matrix(mass)),
            stiffnessMatrix=exu.MatrixContainer(stiffness),
            visualization=items.VObjectGenericODE2(show=False),
            **functions,
        )
    )
