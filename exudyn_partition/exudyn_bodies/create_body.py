"""Exudyn adapter: partition bodies as nodes, objects, user functions and sensors of a model (paper, eq. 17)."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.spatial.transform import Rotation

from ..contact.plasticity.zone_run import ZoneMotion, deformed_at_rest
from ..errors import InputError, UnitsWarning
from ..fe.partition import number_of_patch
from ..frames.damping import Damping, ModeDamping, Ratios, Rayleigh, damping_of
from ..frames.floating import ActingMass, FloatingKinematics
from ..frames.inertia_forces import TERMS, InertiaForces, InertiaTerm
from ..frames.inertial import InertialKinematics
from ..frames.kinematics import FRAMES, FrameChoice
from ..plasticity.flow import PlasticState, validate_state
from ..reduction.body import ReducedBody
from ..support.arrays import Array, Vector
from ..support.checks import listed, validate_array, validate_choice, validate_flag, validate_number, validate_vector
from ..support.foreign import MainSystem, NodeIndex, ObjectIndex
from ..support.optional import require
from ..support.warn import warn
from .held_damping import add_damping_sensor
from .markers import EXUDYN_COLOUR
from .model import registered, registry, validate_new_name
from .partition_body import PartitionBody
from .stiffening_steps import SteppedStiffening
from .unchanged import made
from .user_functions import RIGID, Functions, coupling_functions, inertia_functions, stiffening_functions

_ORIGIN = (0.0, 0.0, 0.0)
_EARTH, _NEAR_EARTH = 9.81, 5e-3  # m/s2, and by how much less or more people take
_ORTHONORMAL = 1e-9  # defect of a rotation matrix that counts as round-off
# Exudyn composes rotation vectors with an error of 1e-16 over their size: 1e-8 rad near zero, where most bodies start.
# With this start, a rotation about a coordinate axis has an error of 1e-14 rad at every angle. With a larger one,
# Exudyn's static solver, which adds rotation vectors, would converge slowly.
_APART = (0.01, 0.01, 0.01)  # rad


def CreatePartitionBody(
    mbs: MainSystem,
    body: ReducedBody,
    *,
    name: str = "",
    frame: FrameChoice | None = None,
    referencePosition: Vector = _ORIGIN,
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
    registered(mbs)  # so that bodies from before a Reset are forgotten before their numbers are given again
    if not isinstance(body, ReducedBody):
        raise InputError(f"body: expected what reduce() or load_body() returns, got {type(body).__name__}")
    validate_flag("superElement", superElement)
    if frame is None:
        frame = "floating" if superElement else "inertial"
    validate_choice("frame", frame, FRAMES)
    for flag, value in (("showMarkers", showMarkers), ("verbose", verbose)):
        validate_flag(flag, value)
    unmoved = positionRef is not None and referencePosition is _ORIGIN
    position = validate_vector(
        *_one_of(referencePosition=None if unmoved else referencePosition, positionRef=positionRef)
    )
    turned, matrix = _one_of(
        referenceRotationMatrix=referenceRotationMatrix, referenceRotation=referenceRotation,
        rotationMatrixRef=None if isinstance(rotationMatrixRef, list) and not rotationMatrixRef else rotationMatrixRef,
    )  # fmt: skip
    rotation = None if matrix is None else _rotation_vector(turned, matrix)
    velocity = validate_vector("initialVelocity", initialVelocity)
    angular_velocity = validate_vector("initialAngularVelocity", initialAngularVelocity)
    acceleration = validate_vector("gravity", gravity)
    if (wanted := listed(inertiaTerms)) is None:
        raise InputError(f"inertiaTerms: expected a collection of {', '.join(TERMS)}, got {inertiaTerms!r}")
    terms = [validate_choice("inertiaTerms", term, TERMS) for term in wanted]
    damping = _damping(damping, massProportionalDamping, stiffnessProportionalDamping)
    color, offsets = _look(body, superElement, color, superElementRigidMarkersOffsets)
    if frame == "auto":
        rotates = rotation is not None or angular_velocity.any()
        frame = "floating" if rotates else "inertial"
    validate_new_name(mbs, name, ("Object",) if frame == "inertial" else ("Object", "Node"))
    if frame == "inertial":
        if rotation is not None:
            raise InputError(f"{turned}: an inertial frame keeps the axes of the mesh; take frame='floating'")
        kinematics = InertialKinematics(body, position)
        loss = None if damping is None else damping_of(kinematics, damping)
        item = _add_inertial(mbs, kinematics, name, body.rigid @ np.r_[velocity, angular_velocity], loss)
    else:
        rotation = np.zeros(3) if rotation is None else rotation
        floating = FloatingKinematics(
            body, position, rotation, node_rotation=None if superElement else np.array(_APART)
        )
        loss = None if damping is None else damping_of(floating, damping)
        item = _add_floating(mbs, floating, name, velocity, angular_velocity, terms, loss)
    item.damping, item.ratios = loss, damping
    if damping is not None:
        _warn_if_overdamped(body, damping, loss)
    _warn_of_gravity(body, acceleration)
    if plasticStates is not None:
        _set_plastic_states(mbs, item, plasticStates)
    if acceleration.any():
        item.weight = item.kinematics.weight(acceleration)
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
    registry(mbs).bodies[int(item["oGenericODE2"])] = item
    if loss is not None:
        item.dampings = ((-np.inf, loss),)
        add_damping_sensor(mbs)
    if superElement:
        item._super_element(mbs, color, offsets)
        for interface in body.partition.interfaces:
            marker = item.CreateInterfaceMarker(mbs, interface.name)
            if not showMarkers:
                mbs.SetMarkerParameter(marker, "Vshow", False)
    if verbose:
        print(f"{name or 'body'}: {body!r}, frame {frame!r}", *item.left_out, sep="\n  left out: ")
    return item


def _one_of(**names: object) -> tuple[str, Any]:
    """Name and value of an argument that has several names, of which one may be given; the first if none is."""
    given = [name for name, value in names.items() if value is not None] or [*names][:1]
    if len(given) > 1:
        raise InputError(f"{given[1]}: is another name of {given[0]}; give only one of them")
    return given[0], names[given[0]]


def _damping(damping: Ratios | None, of_mass: float, of_stiffness: float) -> Ratios | None:
    """Return the damping that is given in one of two ways."""
    expected = "a finite number, zero or above"
    of_mass = validate_number("massProportionalDamping", of_mass, expected)
    of_stiffness = validate_number("stiffnessProportionalDamping", of_stiffness, expected)
    given = {"massProportionalDamping": of_mass, "stiffnessProportionalDamping": of_stiffness}
    for name, value in given.items():
        if value < 0:
            raise InputError(f"{name}: expected {expected}, got {value!r}")
    named = [name for name, value in given.items() if value]
    if not named:
        return damping
    if damping is not None:
        raise InputError(f"damping: expected one kind of damping, got {damping!r} and {' and '.join(named)}")
    return Rayleigh(of_mass, of_stiffness)


def _warn_if_overdamped(body: ReducedBody, damping: Ratios, loss: Damping | None) -> None:
    """Warn of ratios above one, which no structure has; Rayleigh damping may damp high modes so, but not all."""
    omega = body.basis.omega[body.basis.omega > 0]
    if isinstance(damping, Rayleigh):
        ratios = damping.alpha / (2 * omega) + damping.beta * omega / 2
        ratio, said = ratios.min(initial=np.inf), "the ratios of all modes, from"
    else:
        ratios = loss.rates / (2 * loss.omega) if isinstance(loss, ModeDamping) else np.zeros(0)
        ratio, said = ratios.max(initial=0.0), "a ratio of"
    if 1 < ratio < np.inf:
        warn(
            f"damping: {said} {ratio:.4g}, above 1, lets nothing swing; structures have 0.001 to 0.1. Is it in per "
            "cent? 2 % are 0.02. Go on if that is meant",
            UnitsWarning,
        )


def _warn_of_gravity(body: ReducedBody, acceleration: Array) -> None:
    """Warn of the earth's gravity in m/s2 where the body is in mm, and the other way round."""
    if body.material is None:
        return
    in_mm = body.material.in_millimetres
    slip = _EARTH if in_mm else 1e3 * _EARTH
    if abs(np.linalg.norm(acceleration) / slip - 1) < _NEAR_EARTH:
        units = ("m", "millimetres") if in_mm else ("mm", "SI units")
        warn(
            f"gravity: {np.linalg.norm(acceleration):.6g} is that of the earth in {units[0]}/s2, and the material, rho="
            f"{body.material.rho:.6g}, is in {units[1]}; expected {_EARTH * (1e3 if in_mm else 1):g} there",
            UnitsWarning,
        )


def _look(
    body: ReducedBody, drawn: bool, color: Vector | None, offsets: Sequence[Vector] | Array | None
) -> tuple[Array, Array | None]:
    """Return colour, (4,), and offsets of markers, (n, 3) [m], if they are given; both need superElement=True."""
    for name, value, instead in (
        ("color", color, "; CreatePartitionView draws fields"),
        ("superElementRigidMarkersOffsets", offsets, ", or position= of Partition.interface"),
    ):
        if value is not None and not drawn:
            raise InputError(f"{name}: has no effect without superElement=True; take that{instead}")
    n = len(body.partition.interfaces)
    if offsets is not None:
        offsets = validate_array("superElementRigidMarkersOffsets", offsets, (n, 3))
    if color is not None:
        color = validate_array("color", color, (4,))
        if not ((color >= 0) & (color <= 1)).all():
            raise InputError(f"color: expected red, green, blue and opacity from 0 to 1, got {color.tolist()}")
    return np.array(EXUDYN_COLOUR) if color is None else color, offsets


def _rotation_vector(name: str, matrix: object) -> Array:
    """Rotation vector, (3,) [rad], of the rotation matrix from the user."""
    A = validate_array(name, matrix, (3, 3))
    defect = abs(A @ A.T - np.eye(3)).max()
    if defect > _ORTHONORMAL or np.linalg.det(A) < 0:
        raise InputError(
            f"{name}: expected a rotation matrix, got one with determinant {np.linalg.det(A):.6g} whose "
            f"product with its transpose differs from the identity by {defect:.3g}"
        )
    value: Array = Rotation.from_matrix(np.array(A)).as_rotvec()  # SciPy 1.13 needs a writable array
    return value


def _add_inertial(
    mbs: MainSystem, kinematics: InertialKinematics, name: str, q_t: Array, damping: Damping | None
) -> PartitionBody:
    body = kinematics.body
    parts = {"nModal": q_t[: body.n_shapes], "nNodal": q_t[body.n_shapes :]}
    indices = {key: _add_node(mbs, part) for key, part in parts.items() if len(part)}
    said = ("large rotation, and the inertia forces of a rotating frame (frame='floating')",)
    item = PartitionBody(body, name, kinematics, said, **indices)
    diagonal = sp.diags(np.r_[body.basis.omega**2, np.zeros(body.n_dofs - body.n_shapes)], format="csr")
    functions: Functions = {}
    stiffening = None if body.stiffening is None else SteppedStiffening(body.stiffening, body)
    if "nNodal" in indices:
        functions = coupling_functions(item, body.stiffness - diagonal, _present(item, damping), stiffening)
    elif stiffening is not None:
        functions = stiffening_functions(stiffening)
    item["oGenericODE2"] = _add_object(mbs, item, body.mass, diagonal, functions, damping)
    return item


def _add_floating(
    mbs: MainSystem,
    kinematics: FloatingKinematics,
    name: str,
    velocity: Array,
    angular_velocity: Array,
    terms: Collection[InertiaTerm],
    damping: Damping | None,
) -> PartitionBody:
    exu, items = require("exudyn"), require("exudyn.itemInterface")
    body, inertia = kinematics.body, kinematics.inertia
    stiffening = None if kinematics.stiffening is None else SteppedStiffening(kinematics.stiffening, body)
    if body.stiffening is not None:
        terms = [term for term in terms if term != "coupling"]  # see FloatingKinematics.on_constant_mass
    elif "coupling" not in terms:
        kinematics.acting = ActingMass(constant=True, settled=True)
    axes = kinematics.frame(np.zeros(body.n_dofs))[1] @ kinematics.node_axes
    indices = {
        "nRigid": mbs.AddNode(
            items.NodeRigidBodyRotVecLG(
                name=name,
                referenceCoordinates=[*kinematics.origin, *kinematics.rotation],
                initialVelocities=[*velocity, *(angular_velocity @ axes)],
            )
        )
    }
    if body.n_dofs > RIGID:  # a compact body may have no elastic coordinates
        indices["nModal"] = _add_node(mbs, np.zeros(body.n_dofs - RIGID))
    said = [
        sentence + " (inertiaTerms)" * (body.stiffening is None or term != "coupling")
        for term, sentence in TERMS.items()
        if term not in terms
    ]
    if "coupling" in terms:
        said.append("where joints, springs or loads act: the change of the body's inertia by its deformation")
    item = PartitionBody(body, name, kinematics, tuple(said), **indices)
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
            _present(item, damping),
            stiffening,
        )
        stiffness = sp.csr_matrix((body.n_dofs,) * 2)
    else:
        omega_squared = body.basis.omega**2
        forces = InertiaForces(inertia, omega_squared[RIGID:].__mul__, terms)
        functions = inertia_functions(exu, item, kinematics.acting, forces, stiffening=stiffening)
        stiffness = sp.diags(omega_squared, format="csr")
    item["oGenericODE2"] = _add_object(mbs, item, mass, stiffness, functions, damping)
    return item


def _present(item: PartitionBody, damping: Damping | None) -> Callable[[], Any] | None:
    """Function that returns the body's damping as joints hold it; None if there is none."""
    return None if damping is None else lambda: item.damping


def _add_node(mbs: MainSystem, velocities: Array) -> NodeIndex:
    zeros = [0.0] * len(velocities)
    return mbs.AddNode(
        require("exudyn.itemInterface").NodeGenericODE2(
            referenceCoordinates=zeros,
            initialCoordinates=zeros,
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


def _set_plastic_states(mbs: MainSystem, item: PartitionBody, states: Mapping[int | str, PlasticState]) -> None:
    """Let the plastic zones of a body begin with these states, and the body with the shape that they give it at rest.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    item : PartitionBody
    states : dict of int or str to PlasticState
        By the number or name of the patch.

    Raises
    ------
    InputError
        If a patch has no plastic zone, or the state is of another one.
    """
    if not isinstance(states, Mapping):
        raise InputError(f"plasticStates: expected a dict of patch: PlasticState, got {type(states).__name__}")
    forces = []
    for key, state in states.items():
        patch = number_of_patch(item.body.partition, key, "plasticStates")
        motion = ZoneMotion.of(item.kinematics, patch)
        if motion is None:
            raise InputError(
                f"plasticStates: patch {patch} of the body has no plastic zone. Give hardening= to its material"
            )
        item.plastic_states[patch] = validate_state("plasticStates", state, len(motion.zone))
        forces.append(item.body.rows(motion.zone.nodes).T @ motion.zone.pseudo_forces(state.strain))
    if not forces:
        return
    start = item.kinematics.from_basis @ deformed_at_rest(item.body, np.sum(forces, axis=0))
    ends = len(start)
    for key in ("nNodal", "nModal"):  # the last coordinates are those of nodes, if the body has any
        if key in item:
            size = np.size(mbs.GetNode(item[key])["initialCoordinates"])
            mbs.SetNodeParameter(item[key], "initialCoordinates", start[ends - size : ends])
            ends -= size
