"""What `CreatePartitionBody` is asked for, checked and resolved; the model stays as it is."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ..contact.plasticity.zone_motion import ZoneMotion, deformed_at_rest
from ..errors import InputError, UnitsWarning
from ..fe.partition import number_of_patch
from ..frames.damping import Damping, ModeDamping, Ratios, Rayleigh, damping_of
from ..frames.floating import FloatingKinematics
from ..frames.inertia_forces import TERMS, InertiaTerm
from ..frames.inertial import InertialKinematics
from ..frames.kinematics import FRAMES, FrameChoice
from ..plasticity.flow import PlasticState, validate_state
from ..reduction.body import ReducedBody
from ..support.arrays import Array, Vector
from ..support.checks import listed, validate_array, validate_choice, validate_flag, validate_number, validate_vector
from ..support.foreign import MainSystem
from ..support.warn import warn
from .markers import EXUDYN_COLOUR
from .model import registered, validate_new_name

ORIGIN = (0.0, 0.0, 0.0)
_EARTH, _NEAR_EARTH = 9.81, 5e-3  # m/s2, and by how much less or more people take
_ORTHONORMAL = 1e-9  # defect of a rotation matrix that counts as round-off
# Exudyn composes rotation vectors with an error of 1e-16 over their size: 1e-8 rad near zero, where most bodies start.
# With this start, a rotation about a coordinate axis has an error of 1e-14 rad at every angle. With a larger one,
# Exudyn's static solver, which adds rotation vectors, would converge slowly.
_APART = (0.01, 0.01, 0.01)  # rad


@dataclass(frozen=True, eq=False)
class Drawing:
    """How superElement=True draws a body.

    Parameters
    ----------
    color : (4,) array
    offsets : (n, 3) array or None
        Of the markers of interfaces [m].
    markers : bool
        Whether these are drawn.
    """

    color: Array
    offsets: Array | None
    markers: bool


@dataclass(frozen=True, eq=False)
class BodyPlan:
    """A body that can be added to a model.

    Parameters
    ----------
    name : str
    kinematics : InertialKinematics or FloatingKinematics
        The body in its frame, where it begins.
    velocity, angular_velocity : (3,) array
        Of its centre of mass [m/s], and in global axes [rad/s].
    terms : tuple of str
        Inertia forces of a floating frame.
    ratios : Ratios or None
        Damping as it was asked for.
    damping : Damping or None
        That of the free body.
    weight : (n_dofs,) array or None
        Forces of gravity on the coordinates; None if there are none.
    plastic_states : dict of int to PlasticState
        Those that patches begin with, by their numbers.
    start : (n_dofs,) array
        Coordinates that these give the body at rest.
    drawing : Drawing or None
        With superElement=True.
    """

    name: str
    kinematics: InertialKinematics | FloatingKinematics
    velocity: Array
    angular_velocity: Array
    terms: tuple[InertiaTerm, ...]
    ratios: Ratios | None
    damping: Damping | None
    weight: Array | None
    plastic_states: Mapping[int, PlasticState]
    start: Array
    drawing: Drawing | None

    @property
    def body(self) -> ReducedBody:
        """The reduced body."""
        return self.kinematics.body


def plan_body(
    mbs: MainSystem,
    body: ReducedBody,
    *,
    name: str,
    frame: FrameChoice | None,
    referencePosition: Vector,
    positionRef: Vector | None,
    referenceRotationMatrix: Sequence[Vector] | Array | None,
    referenceRotation: Sequence[Vector] | Array | None,
    rotationMatrixRef: Sequence[Vector] | Array | None,
    initialVelocity: Vector,
    initialAngularVelocity: Vector,
    gravity: Vector,
    plasticStates: Mapping[int | str, PlasticState] | None,
    damping: Ratios | None,
    massProportionalDamping: float,
    stiffnessProportionalDamping: float,
    inertiaTerms: Collection[InertiaTerm],
    superElement: bool,
    color: Vector | None,
    superElementRigidMarkersOffsets: Sequence[Vector] | Array | None,
    showMarkers: bool,
) -> BodyPlan:
    """Check the arguments of `CreatePartitionBody` and return its plan.

    Raises
    ------
    InputError

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
    unmoved = positionRef is not None and referencePosition is ORIGIN
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
    terms = _terms(body, inertiaTerms)
    ratios = _ratios(damping, massProportionalDamping, stiffnessProportionalDamping)
    drawing = _drawing(body, superElement, color, superElementRigidMarkersOffsets, showMarkers)
    if frame == "auto":
        rotates = rotation is not None or angular_velocity.any()
        frame = "floating" if rotates else "inertial"
    validate_new_name(mbs, name, ("Object",) if frame == "inertial" else ("Object", "Node"))
    kinematics: InertialKinematics | FloatingKinematics
    if frame == "inertial":
        if rotation is not None:
            raise InputError(f"{turned}: an inertial frame keeps the axes of the mesh; take frame='floating'")
        kinematics = InertialKinematics(body, position)
    else:
        apart = None if superElement else np.array(_APART)
        kinematics = FloatingKinematics(
            body, position, np.zeros(3) if rotation is None else rotation, node_rotation=apart
        )
    losses = None if ratios is None else damping_of(kinematics, ratios)
    if ratios is not None:
        _warn_if_overdamped(body, ratios, losses)
    _warn_of_gravity(body, acceleration)
    states, start = _plastic_states(kinematics, plasticStates)
    weight = kinematics.weight(acceleration) if acceleration.any() else None
    return BodyPlan(name, kinematics, velocity, angular_velocity, terms, ratios, losses, weight, states, start, drawing)


def _one_of(**names: object) -> tuple[str, Any]:
    """Name and value of an argument that has several names, of which one may be given; the first if none is."""
    given = [name for name, value in names.items() if value is not None] or [*names][:1]
    if len(given) > 1:
        raise InputError(f"{given[1]}: is another name of {given[0]}; give only one of them")
    return given[0], names[given[0]]


def _terms(body: ReducedBody, wanted: Collection[InertiaTerm]) -> tuple[InertiaTerm, ...]:
    """Inertia forces that a floating frame has."""
    names = listed(wanted)
    if names is None:
        raise InputError(f"inertiaTerms: expected a collection of {', '.join(TERMS)}, got {wanted!r}")
    terms = tuple(validate_choice("inertiaTerms", term, TERMS) for term in names)
    if body.stiffening is not None:  # see FloatingKinematics.on_constant_mass
        return tuple(term for term in terms if term != "coupling")
    return terms


def _ratios(damping: Ratios | None, of_mass: float, of_stiffness: float) -> Ratios | None:
    """Return the ratios of damping, which are given in one of two ways."""
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


def _drawing(
    body: ReducedBody,
    drawn: bool,
    color: Vector | None,
    offsets: Sequence[Vector] | Array | None,
    markers: bool,
) -> Drawing | None:
    """How a body is drawn; None without superElement=True.

    Raises
    ------
    InputError
        If colour or offsets are given without it, or are of another shape.
    """
    validate_flag("showMarkers", markers)
    for name, value, instead in (
        ("color", color, "; CreatePartitionView draws fields"),
        ("superElementRigidMarkersOffsets", offsets, ", or position= of Partition.interface"),
    ):
        if value is not None and not drawn:
            raise InputError(f"{name}: has no effect without superElement=True; take that{instead}")
    if not drawn:
        return None
    n = len(body.partition.interfaces)
    if offsets is not None:
        offsets = validate_array("superElementRigidMarkersOffsets", offsets, (n, 3))
    if color is not None:
        color = validate_array("color", color, (4,))
        if not ((color >= 0) & (color <= 1)).all():
            raise InputError(f"color: expected red, green, blue and opacity from 0 to 1, got {color.tolist()}")
    return Drawing(np.array(EXUDYN_COLOUR) if color is None else color, offsets, markers)


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


def _plastic_states(
    kinematics: InertialKinematics | FloatingKinematics, given: Mapping[int | str, PlasticState] | None
) -> tuple[dict[int, PlasticState], Array]:
    """Plastic states by the numbers of their patches, and the coordinates that they give the body at rest, (n_dofs,).

    Raises
    ------
    InputError
        If a patch has no plastic zone, or the state is of another one.
    """
    body = kinematics.body
    if given is not None and not isinstance(given, Mapping):
        raise InputError(f"plasticStates: expected a dict of patch: PlasticState, got {type(given).__name__}")
    states: dict[int, PlasticState] = {}
    forces = []
    for key, state in (given or {}).items():
        patch = number_of_patch(body.partition, key, "plasticStates")
        motion = ZoneMotion.of(kinematics, patch)
        if motion is None:
            raise InputError(
                f"plasticStates: patch {patch} of the body has no plastic zone. Give hardening= to its material"
            )
        states[patch] = validate_state("plasticStates", state, len(motion.zone))
        forces.append(body.rows(motion.zone.nodes).T @ motion.zone.pseudo_forces(state.strain))
    if not forces:
        return states, np.zeros(body.n_dofs)
    return states, kinematics.from_basis @ deformed_at_rest(body, np.sum(forces, axis=0))
