"""The plan of a contact: its sides and mechanics, checked before anything is added to the Exudyn model."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol, get_args

import numpy as np

from ..algebra.coulomb import Coulomb, friction_of
from ..contact.formulations.choices import Compliance, FormulationName, Hertz, formulation_of
from ..contact.formulations.formulation import Formulation
from ..contact.gaps import Gaps
from ..contact.pairings import Pairing
from ..contact.patch_contact import PatchContact
from ..contact.patch_gaps import PatchGaps
from ..contact.press_fit import fitted
from ..contact.profile import RigidProfile
from ..contact.rigid import RigidCylinder, RigidGaps, RigidPlane, RigidSphere, RigidSurface
from ..contact.rigid_mesh import RigidMesh
from ..contact.side import Side
from ..contact.smooth_faces import SmoothFace
from ..contact.spot_gaps import SpotGaps
from ..contact.wandering import WanderingGaps, WanderingRigidGaps
from ..errors import InputError, PenetrationError
from ..exudyn_bodies.carriers import Carrier, motion, pose, validate_carrier
from ..exudyn_bodies.model import is_taken, registered, validate_new_name
from ..exudyn_bodies.partition_body import PartitionBody
from ..fe.partition import number_of_patch
from ..support.checks import validate_choice, validate_positive
from ..support.foreign import MainSystem, ObjectIndex
from ..surfaces.facing import PENETRATION_TOLERANCE
from ..surfaces.near import edge_meets, opposite_parts
from ..surfaces.points import ROW_KINDS, RowKind
from ..surfaces.surface import Surface
from .point_pairs import only_pair

Passes = Literal["finer", "given"]
PASSES: tuple[Passes, ...] = get_args(Passes)
BodyPatch = tuple[PartitionBody, int]  # a body and the number of one of its patches
SideOf = Callable[[PartitionBody, int], Side]

RIGID = (RigidPlane, RigidSphere, RigidCylinder, RigidProfile, RigidMesh)
_NAMED = ("Object", "Sensor")  # items of Exudyn that a contact has
_DIGITS = 1e-5  # share of a facet's size: round-off of places in space above which gaps are not known
_MEANT = "Or, if the overlap is meant, as that of a press fit, give interference=, which solve_static closes"
_FINER = 0.9  # slave and master change places if the master's facets are smaller than this share of the slave's


def side_at_start(item: PartitionBody, patch: int) -> Side:
    """Patch of a body in the model, by its number, at the start."""
    return Side.of(item.kinematics, patch, item.plastic_states.get(patch), item.beta)


class PlannedContact(Protocol):
    """The part of a contact in the model that the plan of another one needs."""

    sides: tuple[BodyPatch, ...]
    rows: RowKind
    master: PartitionBody | RigidSurface


@dataclass(frozen=True, eq=False)
class ContactPlan:
    """A contact that can be added to a model.

    Parameters
    ----------
    name : str
    sides : tuple of (PartitionBody, int)
        Slave, and master if that is a partition body too, each with the number of its patch.
    rigid : RigidSurface or None
        The master, if it is a rigid surface.
    rows : {"integrated", "node-to-segment", "edges"}
    formulation : Formulation
        It includes friction, if the contact has any.
    mechanics : PatchContact
        At the start, with the gaps between the sides.
    carrier : Carrier or None
        The body of another kind that carries the rigid surface.
    carried_by : exudyn.ObjectIndex or None
        Its number.
    """

    name: str
    sides: tuple[BodyPatch, ...]
    rigid: RigidSurface | None
    rows: RowKind
    formulation: Formulation
    mechanics: PatchContact
    carrier: Carrier | None
    carried_by: ObjectIndex | None


def plan_contact(
    mbs: MainSystem,
    slave: object,
    master: object,
    *,
    formulation: FormulationName | Formulation = "compliance",
    rows: RowKind | None = None,
    passes: Passes = "finer",
    slavePatch: int | str | None = None,
    masterPatch: int | str | None = None,
    masterBody: ObjectIndex | None = None,
    stiffness: float | None = None,
    friction: float | Coulomb | None = None,
    interference: float | Literal["placed"] | None = None,
    name: str = "",
    anywhere: bool = False,
    faces: Sequence[SmoothFace] | None = None,
    side_of: SideOf = side_at_start,
) -> ContactPlan:
    """Check the options of a contact, see `CreatePartitionContact`, and return its plan; the model stays as it is.

    With `anywhere`, the sides may be far from each other, and touch at any place later: pairs are those near each other
    as the sides are placed, if there are any. `faces` of slave and master, as they are given, are those of a contact at
    a point, see `point_pairs`; by default, there is one point. Contacts that are planned together may have the sides
    in common that `side_of` finds.

    Raises
    ------
    EmptyRegionError, PenetrationError, InputError, IndefiniteMatrixError
    """
    bodies = [*registered(mbs).bodies.values()]
    first, second, rigid = _partners(bodies, slave, master)
    validate_new_name(mbs, name, _NAMED)
    chosen = formulation_of(formulation, stiffness)
    kind = validate_choice("rows", chosen.rows if rows is None else rows, ROW_KINDS)
    validate_choice("passes", passes, PASSES)
    coulomb = friction_of(friction)
    if coulomb is not None and not chosen.friction:
        raise InputError(
            f"friction: formulation {type(chosen).__name__} has none; take formulation='compliance', 'lagrange' or "
            "'penalty', or leave friction out. One of your own has friction = True if its law has"
        )
    if (kind == "spot") != (chosen.rows == "spot") or (kind == "spot" and interference is not None):
        raise InputError(
            "rows, formulation: formulation 'hertz' has rows='spot', and no other has; with them there is no "
            "interference. Leave rows and interference out, or take formulation='compliance'"
        )
    _check_master(mbs, rigid, masterPatch, masterBody)
    given = [(first, number_of_patch(first.body.partition, slavePatch, "slavePatch"))]
    if second is not None:
        given.append((second, number_of_patch(second.body.partition, masterPatch, "masterPatch")))
    if first == second:
        _check_itself(first, [patch for _, patch in given], chosen)
    if anywhere:
        _check_anywhere(chosen, interference)
    ordered: Sequence[BodyPatch] = given
    if kind == "edges":
        if interference is not None:
            raise InputError("interference: give it to the contact beside which rows='edges' are")
        ordered, passes = _of_master(registered(mbs).contacts.values(), given, chosen), "given"
    sides, placed = _placed(ordered, [side_of(*each) for each in ordered], passes, chosen, anywhere=anywhere)
    chosen.check([item.body for item, _ in sides])
    for side in placed:
        _check_wandering(side)

    def gaps_of(placed: Sequence[Side], pressed: bool) -> Gaps:
        if kind == "spot":
            moving = () if masterBody is None else (pose(mbs, masterBody), motion(mbs, masterBody))
            patches = [patch for _, patch in sides]
            if faces is None:
                of_sides: Sequence[SmoothFace] = only_pair(placed, patches, rigid, carried=masterBody is not None)
            else:
                of_sides = faces if sides[0] == given[0] else faces[::-1]
            return SpotGaps(placed, patches, rigid, *moving, faces=of_sides)
        if rigid is None:
            return _between(bodies, sides, placed, kind, pressed, anywhere)
        return _to_rigid(mbs, placed[0], rigid, kind, masterBody, pressed)

    if interference is None:
        gaps = gaps_of(placed, False)
    else:
        gaps = _pressed(gaps_of, placed, interference)
    gaps.anywhere = anywhere
    mechanics = PatchContact(gaps, chosen, coulomb)
    if interference is not None and mechanics.ahead:
        raise InputError(
            "interference: load steps of solve_static close it, and multipliers have no statics. Take "
            "formulation='compliance' or 'penalty'"
        )
    carrier = None if masterBody is None else Carrier(mbs, masterBody)
    name = name or _name_of(mbs, first, second, rigid, kind)
    return ContactPlan(name, tuple(sides), rigid, kind, chosen, mechanics, carrier, masterBody)


def needs_edges(plan: ContactPlan) -> bool:
    """Whether a contact of two skins needs another one of the rows at the master's sharp edges."""
    edges = plan.formulation.edges and isinstance(plan.formulation, Compliance) and plan.rows == "integrated"
    return edges and len(plan.mechanics.gaps.sides[1].surface.sharp) > 0


def _partners(
    bodies: Sequence[PartitionBody], slave: object, master: object
) -> tuple[PartitionBody, PartitionBody | None, RigidSurface | None]:
    """The slave, and the master as a body or as a rigid surface."""
    body = master if isinstance(master, PartitionBody) else None
    rigid = master if isinstance(master, RIGID) else None
    if body is None and rigid is None:
        raise InputError(
            "master: expected what CreatePartitionBody returns, or a RigidPlane, RigidSphere, RigidCylinder, "
            f"RigidProfile or RigidMesh, got {type(master).__name__}"
        )
    if not isinstance(slave, PartitionBody):
        raise InputError(f"slave: expected what CreatePartitionBody returns, got {type(slave).__name__}")
    for role, item in (("slave", slave), ("master", body)):
        if item is not None and item not in bodies:
            raise InputError(f"{role}: body {item.name!r} belongs to another model, or to this one before a Reset")
    return slave, body, rigid


def _name_of(
    mbs: MainSystem, slave: PartitionBody, master: PartitionBody | None, rigid: RigidSurface | None, rows: RowKind
) -> str:
    """Name of a contact that was given none, as "ball on plate"; no other contact of the model has it."""
    registry = registered(mbs)
    of_slave, of_master = (item and (item.name or f"body {registry.place(item)}") for item in (slave, master))
    if master == slave:
        of_master = "itself"
    elif rigid is not None:
        of_master = _name_of_surface(rigid, registry.surface_number(rigid))
    name = f"{of_slave} on {of_master}{' edges' if rows == 'edges' else ''}"
    more = (name if i == 1 else f"{name} ({i})" for i in itertools.count(1))
    ours = {contact.name for contact in registry.contacts.values()}  # Exudyn takes longer to tell
    free = (one for one in more if one not in ours)
    return next(one for one in free if not any(is_taken(mbs, one, kind) for kind in _NAMED))


def _name_of_surface(rigid: RigidSurface, number: int) -> str:
    """Kind of a rigid surface, as "plane", with its number from the second one of a model on."""
    return type(rigid).__name__.removeprefix("Rigid").lower() + (f" {number}" if number > 1 else "")


def _check_master(mbs: MainSystem, rigid: RigidSurface | None, patch: object, body: ObjectIndex | None) -> None:
    """A rigid surface has no patches. Another body may carry it."""
    if body is not None:
        if rigid is None:
            raise InputError("masterBody: only a rigid surface is carried by a body")
        validate_carrier("masterBody", mbs, body)
    if patch is not None and rigid is not None:
        raise InputError(f"masterPatch: a {type(rigid).__name__} has no patches, leave it out")


def _check_itself(item: PartitionBody, patches: Sequence[int], formulation: Formulation) -> None:
    """Raise InputError if a body cannot touch itself so; contact includes the flexibility between its patches."""
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


def _check_anywhere(formulation: Formulation, interference: float | Literal["placed"] | None) -> None:
    """Raise InputError unless forces of bodies that meet anywhere follow from flexibility, and they begin apart."""
    if not isinstance(formulation, Compliance | Hertz):
        raise InputError(
            f"formulation: skins that meet anywhere go through their flexibility, got {type(formulation).__name__}. "
            "Take formulation='compliance' or 'hertz', or name each pair in a call of its own"
        )
    if interference is not None:
        raise InputError("interference: skins in a list of bodies begin apart; name a press fit in a call of its own")


def _of_master(
    contacts: Collection[PlannedContact], given: Sequence[BodyPatch], formulation: Formulation
) -> Sequence[BodyPatch]:
    """Slave and master of rows "edges": those of the contact between the same patches, exchanged."""
    if len(given) < 2 or given[0][0] == given[1][0]:
        raise InputError("rows: 'edges' are those of a master that is another partition body; take 'integrated' rows")
    if type(formulation) is not Compliance:
        raise InputError("rows: 'edges' need formulation='compliance', because patches then have two contacts")
    for contact in contacts:
        if {*contact.sides} == {*given} and contact.rows != "edges":
            item, patch = contact.sides[1]
            if not len(item.body.surface(np.zeros(3), patch).sharp):
                raise InputError(f"rows: patch {patch} of the master, body {item.name!r}, has no sharp edges")
            return contact.sides[::-1]
    raise InputError(
        "rows: 'edges' are those of the master of a contact between the same patches, and these have none; call "
        "CreatePartitionContact without rows='edges' first"
    )


def _placed(
    given: Sequence[BodyPatch], placed: list[Side], passes: Passes, formulation: Formulation, *, anywhere: bool
) -> tuple[Sequence[BodyPatch], list[Side]]:
    """Slave and master, and their sides, in the order and with the parts that the contact takes."""
    if not formulation.edges:
        placed = [replace(side, surface=side.surface.without_edges) for side in placed]
    if len(given) > 1 and given[0] == given[1]:
        parts = opposite_parts(placed[0].surface)
        placed = [replace(side, surface=part) for side, part in zip(placed, parts, strict=True)]
    for side in placed:
        _check_digits(side)
    if (
        passes == "finer"
        and len(placed) > 1
        and _are_better_turned(*(side.surface for side in placed), anywhere=anywhere)
    ):
        return given[::-1], placed[::-1]
    return given, placed


def _are_better_turned(slave: Surface, master: Surface, *, anywhere: bool) -> bool:
    """Whether slave and master should change places: rows are at the sharp edges, and at the finer facets of the slave.

    The master's edges have no rows. So the slave is the body whose edge meets a face of the other, or whose patch goes
    around sharp edges, if that is true of one alone. If bodies may meet `anywhere`, it does not count what meets now.
    """
    meets = (False, False) if anywhere else (edge_meets(slave, master), edge_meets(master, slave))
    for of_slave, of_master in (
        meets,
        (len(slave.sharp) > len(slave.ends), len(master.sharp) > len(master.ends)),
    ):
        if of_slave != of_master:
            return of_master
    return bool(master.facet_size < _FINER * slave.facet_size)


def _check_digits(side: Side) -> None:
    """Raise InputError far from the origin: gaps are differences of places there, and lose all digits."""
    reach, size = float(abs(side.surface.points).max()), side.surface.facet_size
    if np.finfo(float).eps * reach > _DIGITS * size:
        raise InputError(
            f"referencePosition: the patch is {reach:.3g} m from the origin, where numbers stand "
            f"{np.finfo(float).eps * reach:.2g} m apart, expected at most {_DIGITS:g} of its facets' size, {size:.3g} "
            "m. Move the origin near to the contact"
        )


def _check_wandering(side: Side) -> None:
    """Contact that wanders needs the residual flexibility of its patch."""
    if side.surface.wanders and side.flexibility is None:
        raise InputError(
            "formulation: contact that wanders over a patch of Partition.surface goes through its residual "
            f"flexibility, which basis {side.kinematics.body.basis.name!r} does not have. Take "
            "basis='contact-adapted' or 'residual'"
        )


def _pressed(
    gaps_of: Callable[[Sequence[Side], bool], Gaps], placed: Sequence[Side], interference: float | Literal["placed"]
) -> Gaps:
    """Gaps of a press fit, see `CreatePartitionContact`; `gaps_of` returns those of sides that may overlap."""
    by_place = isinstance(interference, str) and interference == "placed"
    overlap = 0.0 if by_place else validate_positive("interference", interference, "m")
    as_placed = gaps_of(placed, True)
    if by_place:
        if as_placed.placement.overlap <= PENETRATION_TOLERANCE * as_placed.size:
            raise InputError(
                f"interference: expected bodies that overlap as they are placed, but their gap is "
                f"{as_placed.placement.clearance:.3g} m. Give the interference as a length in m"
            )
        return as_placed
    slave = fitted(as_placed, overlap)
    return gaps_of([slave, *placed[1:]], True)


def _between(
    bodies: Sequence[PartitionBody],
    sides: Sequence[BodyPatch],
    placed: Sequence[Side],
    rows: RowKind,
    pressed: bool,
    anywhere: bool,
) -> Gaps:
    """Gaps between two patches."""
    (slave, patch), (master, master_patch) = sides
    between = slave.body.flexibility(patch, master_patch) if slave == master else None
    kind = WanderingGaps if any(side.surface.wanders for side in placed) else PatchGaps
    try:
        pairing = Pairing.as_placed(placed[0], placed[1], rows) if anywhere else None
        return kind(placed[0], placed[1], rows, between, pressed=pressed, pairing=pairing)
    except PenetrationError as error:
        first, second = (repr(item.name) if item.name else str(bodies.index(item)) for item in (slave, master))
        raise PenetrationError(f"the slave is body {first}, the master body {second}; {error}. {_MEANT}") from error


def _to_rigid(
    mbs: MainSystem, slave: Side, rigid: RigidSurface, rows: RowKind, carried_by: ObjectIndex | None, pressed: bool
) -> Gaps:
    """Gaps between a patch and a rigid surface."""
    kind = WanderingRigidGaps if slave.surface.wanders else RigidGaps
    moving = () if carried_by is None else (pose(mbs, carried_by), motion(mbs, carried_by))
    try:
        return kind(slave, rigid, rows, *moving, pressed=pressed)
    except PenetrationError as error:
        raise PenetrationError(f"{error}. {_MEANT}") from error
