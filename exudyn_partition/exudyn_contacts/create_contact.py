"""Contact between partition bodies, or of one and a rigid surface, as objects and sensors of an Exudyn model."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal, get_args, overload

import numpy as np

from ..algebra.coulomb import Coulomb, friction_of
from ..contact.formulations.choices import Compliance, FormulationName, formulation_of
from ..contact.formulations.formulation import Formulation
from ..contact.gaps import Gaps
from ..contact.patch_gaps import PatchGaps
from ..contact.profile import RigidProfile
from ..contact.rigid import RigidCylinder, RigidGaps, RigidPlane, RigidSphere, RigidSurface
from ..contact.rigid_mesh import RigidMesh
from ..contact.side import Side
from ..contact.wandering import WanderingGaps, WanderingRigidGaps
from ..errors import EmptyRegionError, InputError, PenetrationError
from ..exudyn_bodies.carriers import Carrier, load_carrier, motion, pose, validate_carrier
from ..exudyn_bodies.model import registry, user_function, validate_new_name
from ..exudyn_bodies.partition_body import PartitionBody
from ..fe.partition import number_of_patch
from ..support.checks import validate_choice, validate_items, validate_positive, validate_text
from ..support.foreign import MainSystem, ObjectIndex, SensorIndex
from ..support.optional import require
from ..surfaces.near import near_patches, opposite_parts
from ..surfaces.points import ROWS, RowKind
from .contact_object import add_to_object
from .contact_run import N_VALUES, N_VALUES_AHEAD, ContactRun
from .coupling import solve_together
from .model_run import Runs, runs_of
from .partition_contact import PartitionContact, partition_items

_log = logging.getLogger(__name__)

Passes = Literal["finer", "given"]
PASSES: tuple[Passes, ...] = get_args(Passes)

_RIGID = (RigidPlane, RigidSphere, RigidCylinder, RigidProfile, RigidMesh)

_DIGITS = 1e-5  # of a facet's size: round-off of places in space from which gaps are no longer known
_FINER = 0.9  # facets of the master smaller than this share of the slave's make the two change places


@overload
def CreatePartitionContact(
    mbs: MainSystem,
    slave: PartitionBody,
    master: PartitionBody | RigidSurface,
    *,
    formulation: FormulationName | Formulation = ...,
    rows: RowKind | None = ...,
    passes: Passes = ...,
    slavePatch: int | str | None = ...,
    masterPatch: int | str | None = ...,
    masterBody: ObjectIndex | None = ...,
    stiffness: float | None = ...,
    friction: float | Coulomb | None = ...,
    name: str = ...,
) -> PartitionContact: ...
@overload
def CreatePartitionContact(
    mbs: MainSystem,
    slave: Sequence[PartitionBody],
    *,
    within: float | None = ...,
    formulation: FormulationName | Formulation = ...,
    rows: RowKind | None = ...,
    passes: Passes = ...,
    stiffness: float | None = ...,
    friction: float | Coulomb | None = ...,
    name: str = ...,
) -> list[PartitionContact]: ...
def CreatePartitionContact(
    mbs: MainSystem,
    slave: PartitionBody | Sequence[PartitionBody],
    master: PartitionBody | RigidSurface | None = None,
    *,
    formulation: FormulationName | Formulation = "compliance",
    rows: RowKind | None = None,
    passes: Passes = "finer",
    slavePatch: int | str | None = None,
    masterPatch: int | str | None = None,
    masterBody: ObjectIndex | None = None,
    stiffness: float | None = None,
    friction: float | Coulomb | None = None,
    within: float | None = None,
    name: str = "",
) -> PartitionContact | list[PartitionContact]:
    """Add contact between the patches of two partition bodies, of one and a rigid surface, or of many bodies.

    The slave's patch is kept out of the master. Pairs stay as they are found at the start, along the line of
    contact, until the patches slide along each other; then they follow (`contact.patch_gaps`).

    Slave and master may be one body, with two patches that face each other, as the ends of a clip, or with one patch
    of `Partition.surface` that folds: by "compliance".

    Many bodies are given as one sequence: `CreatePartitionContact(mbs, bodies)`. Each two of their patches that face
    each other nearby at the start get a contact.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    slave : PartitionBody, or sequence of them
    master : PartitionBody, RigidPlane, RigidSphere, RigidCylinder, RigidProfile or RigidMesh
        Rigid surfaces are fixed in space, or to `masterBody`. Left out if a sequence is given.
    formulation : {"compliance", "lagrange", "penalty"} or Formulation
        "compliance" where a basis carries a residual flexibility; "lagrange" for bases whose patch has mass, the
        paper's and Craig-Bampton's, in VelocityVerlet (`contact.lagrange`) and generalized-alpha
        (`contact.stabilised`); "penalty" for any basis, an elastic layer on the slave's patch; or one of your own, see
        `contact.formulations.formulation`.
    rows : {"integrated", "node-to-segment"}, optional
        What is kept out: the mean gap around each node of the slave's patch, which passes uniform pressure through
        meshes that do not match, or each node by itself (paper, section 3); see `contact.points`. A mean over a convex
        tip closes later than the tip's lowest point, by the order of a facet's size squared over the radius. Default:
        "integrated", but with "lagrange" the paper's "node-to-segment", whose implicit steps converge better.
    passes : {"finer", "given"}
        Which body is the slave: the one with the smaller facets, or the one given as such.
    slavePatch, masterPatch : int or str, optional
        Number or name of the contact patch, for bodies that have several.
    masterBody : optional
        Exudyn body that carries the rigid surface, which is then given in that body's axes.
    stiffness : float, optional
        Of the penalty's layer [N/m3]. Default: what makes it yield under uniform pressure as the residual flexibility
        does; where patches have mass, what adds a tenth to their highest squared frequency at most.
    friction : float or Coulomb, optional
        Coefficient of friction, or `Coulomb(static, kinetic, decay)`. Residual flexibilities must be those of patches
        with axes="xyz". How rows stick: `frictional_compliance`, `penalty`, `lagrange` and `stabilised` in
        `contact.formulations`. Default: frictionless.
    within : float, optional
        Of a sequence of bodies: distance up to which two patches get a contact [m]. Default: the radius of the smaller
        one, from its centre to its farthest node.
    name : str
        Of a sequence of bodies, the contacts are numbered from one behind it.

    Returns
    -------
    PartitionContact
        Of a sequence of bodies, a list of them.

    Raises
    ------
    EmptyRegionError, PenetrationError, InputError, IndefiniteMatrixError
    """
    if master is None and not isinstance(slave, PartitionBody):
        if any(choice is not None for choice in (slavePatch, masterPatch, masterBody)):
            raise InputError("slavePatch, masterPatch, masterBody: of a sequence of bodies, all patches are looked at")
        found = _facing_each_other(mbs, slave, within)
        validate_text("name", name)
        return [
            CreatePartitionContact(
                mbs, body, other, formulation=formulation, rows=rows, passes=passes, slavePatch=patch,
                masterPatch=other_patch, stiffness=stiffness, friction=friction, name=name and f"{name} {i}",
            )
            for i, ((body, patch), (other, other_patch)) in enumerate(found, 1)
        ]  # fmt: skip
    if within is not None:
        raise InputError("within: only for a sequence of bodies, whose pairs are looked for")
    bodies, contacts = partition_items(mbs)
    other = master if isinstance(master, PartitionBody) else None
    rigid = None if isinstance(master, PartitionBody) else master
    if other is None and not isinstance(rigid, _RIGID):
        raise InputError(
            "master: expected what CreatePartitionBody returns, or a RigidPlane, RigidSphere, RigidCylinder, "
            f"RigidProfile or RigidMesh, got {type(master).__name__}"
        )
    if not isinstance(slave, PartitionBody):
        raise InputError(f"slave: expected what CreatePartitionBody returns, got {type(slave).__name__}")
    for role, item in (("slave", slave), ("master", other)):
        if item is not None and not any(item is body for body in bodies):
            raise InputError(f"{role}: body {item.name!r} belongs to another model, or to this one before a Reset")
    validate_new_name(mbs, name, ("Object", "Sensor"))
    chosen = formulation_of(formulation, stiffness)
    rows = validate_choice("rows", chosen.rows if rows is None else rows, ROWS)
    _check_passes(passes)
    coulomb = friction_of(friction)
    if coulomb is not None:
        chosen = _with_friction(chosen, coulomb)
    if masterBody is not None and rigid is None:
        raise InputError("masterBody: only a rigid surface is carried by a body")
    if masterBody is not None:
        validate_carrier("masterBody", mbs, masterBody)
    if masterPatch is not None and rigid is not None:
        raise InputError(f"masterPatch: a {type(rigid).__name__} has no patches, leave it out")
    sides = [(slave, number_of_patch(slave.body.partition, slavePatch, "slavePatch"))]
    if other is not None:
        sides.append((other, number_of_patch(other.body.partition, masterPatch, "masterPatch")))
    if slave is other:
        _check_itself(slave, [patch for _, patch in sides], chosen)
    placed = [Side.of(item.kinematics, patch, item.plastic_states.get(patch)) for item, patch in sides]
    if slave is other and sides[0][1] == sides[1][1]:
        parts = opposite_parts(placed[0].surface)
        placed = [replace(side, surface=part) for side, part in zip(placed, parts, strict=True)]
    for side in placed:
        _check_digits(side)
    if passes == "finer" and rigid is None and placed[1].surface.facet_size < _FINER * placed[0].surface.facet_size:
        sides, placed = sides[::-1], placed[::-1]
    chosen.check([item.body for item, _ in sides])
    for side in placed:
        if side.surface.wanders and side.flexibility is None:
            raise InputError(
                "formulation: contact that wanders over a patch of Partition.surface goes through its residual "
                f"flexibility, which basis {side.kinematics.body.basis.name!r} does not have. Take "
                "basis='contact-adapted' or 'residual'"
            )
    gaps: Gaps
    carrier = None
    if rigid is None:
        wanders = any(side.surface.wanders for side in placed)
        try:
            between = slave.body.flexibility(*(patch for _, patch in sides)) if slave is other else None
            gaps = (WanderingGaps if wanders else PatchGaps)(placed[0], placed[1], rows, between)
        except PenetrationError as error:
            first, second = (repr(item.name) if item.name else str(bodies.index(item)) for item, _ in sides)
            raise PenetrationError(f"the slave is body {first}, the master body {second}; {error}") from error
    else:
        to_rigid = WanderingRigidGaps if placed[0].surface.wanders else RigidGaps
        if masterBody is None:
            gaps = to_rigid(placed[0], rigid, rows)
        else:
            gaps = to_rigid(placed[0], rigid, rows, pose(mbs, masterBody), motion(mbs, masterBody))
            carrier = Carrier(mbs, masterBody)
    law = chosen.law(gaps)
    if any(side.zone is not None for side in gaps.sides) and law.yielding is None:
        raise InputError(
            f"formulation: {type(law).__name__} knows no plastic zones, and the material of a body has hardening. Take "
            "formulation='compliance', 'lagrange' with basis 'free', or a material without it"
        )
    contact = PartitionContact(name, sides, rigid, chosen, law, carrier)
    solve_together(contact, contacts)
    kind = type(law).__name__
    _log.info("contact %r: %s with %s rows, in a group of %s", name, kind, contact.n_rows, len(contact.group))
    runs = runs_of(mbs)
    if contact.law.ahead:
        _chain_steps(mbs, runs)
    contact["oContact"] = add_to_object(mbs, contact, contacts, runs)
    if masterBody is not None:
        load_carrier(mbs, lambda: runs.at_work(contact).law, masterBody)
    _add_force_sensor(mbs, runs, contact, first=not contacts)
    if coulomb is not None:
        contact["sFriction"] = _add_sensor(mbs, runs, contact, ContactRun.friction_values)
    if law.yielding is not None:
        contact["sPlastic"] = _add_sensor(mbs, runs, contact, ContactRun.plastic_values)
    registry(mbs).contacts[int(contact["sForce"])] = contact
    return contact


def _check_passes(passes: object) -> None:
    """The slave is one body; half of the contact with each as slave, which "two" was, is no more."""
    if isinstance(passes, str) and passes == "two":
        raise InputError(
            "passes: expected one of 'finer', 'given', got 'two'. Contact in two passes is no more; leave passes out, "
            "with rows='integrated' where pressures of meshes that do not match should be even"
        )
    validate_choice("passes", passes, PASSES)


def _facing_each_other(
    mbs: MainSystem, bodies: Sequence[PartitionBody], within: float | None
) -> list[tuple[tuple[PartitionBody, int], tuple[PartitionBody, int]]]:
    """Bodies and patches that get a contact."""
    bodies = validate_items("slave", bodies, PartitionBody, "CreatePartitionBody returns")
    if len(bodies) < 2 or len(set(map(id, bodies))) < len(bodies):
        raise InputError(f"slave: expected at least two bodies, each of them once, got {len(bodies)}")
    if within is not None:
        within = validate_positive("within", within, "m")
    sides = [(item, patch) for item in bodies for patch in range(len(item.body.partition.patches))]
    surfaces = [Side.of(item.kinematics, patch).surface for item, patch in sides]
    owners = [place for place, item in enumerate(bodies) for _ in item.body.partition.patches]
    pairs = near_patches(surfaces, owners, within)
    if not pairs:
        raise EmptyRegionError(
            f"slave: no two patches of these {len(bodies)} bodies face each other nearby. Give a larger distance by "
            "within=, or name the pairs in a call each"
        )
    return [(sides[i], sides[j]) for i, j in pairs]


def _check_itself(item: PartitionBody, patches: Sequence[int], formulation: Formulation) -> None:
    """Two patches of one body may touch each other; the residual flexibility between them belongs to the contact."""
    patches_of = item.body.partition.patches
    if patches[0] == patches[1] and not patches_of[patches[0]].wanders:
        raise InputError(
            "slave, master: expected two bodies, or two patches of one by slavePatch= and masterPatch=, got patch "
            f"{patches[0]} of one body twice. A patch that folds may touch itself: choose it by Partition.surface"
        )
    if type(formulation) is not Compliance:
        raise InputError("formulation: a body touches itself by formulation='compliance' alone")
    if any(patches_of[patch].plastic for patch in patches):
        raise InputError(
            "slave, master: patches of one body that touch each other must be of a material without hardening"
        )


def _with_friction(formulation: Formulation, friction: Coulomb) -> Formulation:
    """Return the formulation with friction; one of a user need not know of it."""
    if not hasattr(formulation, "with_friction"):
        return Formulation.with_friction(formulation, friction)  # which refuses
    return formulation.with_friction(friction)


def _add_force_sensor(mbs: MainSystem, runs: Runs, contact: PartitionContact, *, first: bool) -> None:
    """Add `sForce`. That of the `first` contact samples all contacts; the others read, which needs no Python."""
    items = require("exudyn.itemInterface")

    def sample(mbs: MainSystem, t: float, *unused: object) -> list[float]:
        return runs.sample(mbs, t).of(contact).force_values()

    if first:
        sensor = items.SensorUserFunction(name=contact.name, sensorUserFunction=sample, storeInternal=True)
    else:
        values = [0.0] * (N_VALUES_AHEAD if contact.law.ahead else N_VALUES)
        contact["nGenericData"] = mbs.AddNode(
            items.NodeGenericData(initialCoordinates=values, numberOfDataCoordinates=len(values))
        )
        kind = require("exudyn").OutputVariableType.Coordinates
        sensor = items.SensorNode(
            name=contact.name, nodeNumber=contact["nGenericData"], outputVariableType=kind, storeInternal=True
        )
    contact["sForce"] = mbs.AddSensor(sensor)


def _add_sensor(
    mbs: MainSystem, runs: Runs, contact: PartitionContact, values: Callable[[ContactRun], list[float]]
) -> SensorIndex:
    def sample(mbs: MainSystem, t: float, *unused: object) -> list[float]:
        return values(runs.now(mbs).of(contact))

    items = require("exudyn.itemInterface")
    return mbs.AddSensor(items.SensorUserFunction(sensorUserFunction=sample, storeInternal=True))


def _check_digits(side: Side) -> None:
    """Gaps are differences of places: far from the origin they have no digits left."""
    reach, size = float(abs(side.surface.points).max()), side.surface.facet_size
    if np.finfo(float).eps * reach > _DIGITS * size:
        raise InputError(
            f"referencePosition: the patch is {reach:.3g} m from the origin, where numbers stand "
            f"{np.finfo(float).eps * reach:.2g} m apart, expected at most {_DIGITS:g} of its facets' size, {size:.3g} "
            "m. Move the origin near to the contact"
        )


def _chain_steps(mbs: MainSystem, runs: Runs) -> None:
    """Put what contacts do around each step in front of the model's own PreStep function, and behind its PostStep."""
    own_before, own_after = map(user_function, (mbs.GetPreStepUserFunction(), mbs.GetPostStepUserFunction()))

    def before_step(mbs: MainSystem, t: float) -> bool:
        runs.before_step(mbs, t)
        return own_before is None or own_before(mbs, t)

    def after_step(mbs: MainSystem, t: float) -> bool:
        go_on = own_after is None or own_after(mbs, t)
        runs.now(mbs).look_ahead(mbs, t)
        return go_on

    mbs.SetPreStepUserFunction(before_step)
    mbs.SetPostStepUserFunction(after_step)
