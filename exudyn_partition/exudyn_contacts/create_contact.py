"""Contact between partition bodies, or between one and a rigid surface, as items of an Exudyn model."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Literal, overload

from ..algebra.coulomb import Coulomb
from ..contact.formulations.choices import FormulationName, Hertz, formulation_of
from ..contact.formulations.formulation import Formulation
from ..contact.rigid import RigidSurface
from ..contact.smooth_faces import SmoothFace
from ..errors import InputError
from ..exudyn_bodies.carriers import load_carrier
from ..exudyn_bodies.model import registered, user_function
from ..exudyn_bodies.partition_body import PartitionBody
from ..support.checks import validate_text
from ..support.foreign import MainSystem, NodeIndex, ObjectIndex, SensorIndex
from ..support.optional import require
from ..support.spelling import spelled
from ..surfaces.points import RowKind
from .contact_object import add_to_object
from .contact_pairs import FoundPair, pairs_of
from .contact_plan import ContactPlan, Passes, SideOf, needs_edges, plan_contact, side_at_start
from .contact_run import N_FRICTION, N_VALUES, N_VALUES_AHEAD, ContactRun
from .coupling import groups_to_join
from .model_run import Runs, runs_of
from .partition_contact import PartitionContact
from .point_pairs import point_pairs

_log = logging.getLogger(__name__)


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
    interference: float | Literal["placed"] | None = ...,
    name: str = ...,
) -> PartitionContact: ...
@overload
def CreatePartitionContact(
    mbs: MainSystem,
    slave: Sequence[PartitionBody | RigidSurface | tuple[RigidSurface, ObjectIndex]],
    *,
    within: float | None = ...,
    formulation: FormulationName | Formulation = ...,
    rows: RowKind | None = ...,
    passes: Passes = ...,
    stiffness: float | None = ...,
    friction: float | Coulomb | None = ...,
    interference: float | Literal["placed"] | None = ...,
    name: str = ...,
) -> list[PartitionContact]: ...
@spelled
def CreatePartitionContact(
    mbs: MainSystem,
    slave: PartitionBody | Sequence[PartitionBody | RigidSurface | tuple[RigidSurface, ObjectIndex]],
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
    interference: float | Literal["placed"] | None = None,
    within: float | None = None,
    name: str = "",
) -> PartitionContact | list[PartitionContact]:
    """Add contact between the patches of two partition bodies, of one body and a rigid surface, or of many bodies.

    The slave's patch is kept out of the master. Pairs are found at the start, along the line of contact. They stay
    until the patches slide along each other. Then they follow the motion (`contact.patch_gaps`).

    Slave and master may be one body with the formulation "compliance". Either two of its patches face each other, as
    the ends of a clip, or one patch of `Partition.surface` folds.

    Many bodies are given as one sequence: `CreatePartitionContact(mbs, bodies)`. Rigid surfaces may be among them, such
    as a floor and walls; one that a body carries is a pair, `(surface, body)`, as the shell of a drum. Any two of
    their patches that are near and face each other at the start get a contact. Bodies with a skin, see
    `reduce(fem, skin=True)`, get contacts with all others, wherever they are: nobody needs to know where they will
    meet. Contacts of bodies that are far apart cost next to nothing in a step; those with a carried surface never
    sleep.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    slave : PartitionBody, or sequence of bodies and rigid surfaces
        In a sequence, a surface that another body of Exudyn carries is a pair, `(surface, body)`.
    master : PartitionBody, RigidPlane, RigidSphere, RigidCylinder, RigidProfile or RigidMesh
        Rigid surfaces are fixed in space, or to `masterBody`. Left out if a sequence is given.
    formulation : {"compliance", "lagrange", "penalty", "hertz"} or Formulation
        "compliance" needs a basis with residual flexibility. "lagrange" needs a basis whose patch has mass: the
        paper's and Craig-Bampton's. It works in VelocityVerlet (`explicit_multipliers`) and in generalized-alpha
        (`implicit_multipliers`). "penalty" works with any basis: an elastic layer on the slave's patch. "hertz" is for
        a ball, a rounded corner or a cylinder across another one that touches at a point, also with contacts smaller
        than the facets: Hertz's law in place of rows, see `contact.formulations.hertz`. For one of your own, see
        `contact.formulations.formulation`.
    rows : {"integrated", "node-to-segment", "edges", "spot"}, optional
        Gaps that may not become negative, see `contact.points`. "integrated": the mean gap around each node of the
        slave's patch. Uniform pressure then passes through meshes that do not match. "node-to-segment": the gap of
        each node (paper, section 3). A mean over a convex tip closes later than the tip's lowest point, by the order of
        a facet's size squared over the radius. Default: "integrated", but "node-to-segment" with "lagrange", as in the
        paper: its implicit steps converge better. "edges": beside a contact of the same two patches by "compliance",
        the gaps of the nodes at sharp edges of its master, which is the slave here. These rows have no area.
        "spot": the one row of formulation "hertz".
    passes : {"finer", "given"}
        Which body is the slave: the one with the smaller facets, or the one given as the slave. With "finer", a body
        whose sharp edge meets a face of the other comes first, because the master's edges have no rows.
    slavePatch, masterPatch : int or str, optional
        Number or name of the contact patch, for bodies that have several.
    masterBody : optional
        Exudyn body that carries the rigid surface. The surface is then given in the axes of that body.
    stiffness : float, optional
        Stiffness of the penalty's layer [N/m3]. Default: under uniform pressure the layer yields as much as the
        residual flexibility. Where patches have mass, it adds at most a tenth to their highest squared frequency.
    friction : float or Coulomb, optional
        Coefficient of friction, or `Coulomb(static, kinetic, decay)`. Patches with residual flexibility need
        axes="xyz". For how rows stick, see `compliance`, `penalty`, `explicit_multipliers` and `implicit_multipliers`
        in `contact.formulations`. Default: frictionless.
    interference : float or "placed", optional
        Press fit: how far the surfaces overlap before they are pressed onto each other, as the radius of a shaft minus
        that of its bore [m]. The slave's surface is moved along its normals until the deepest overlap is that, so
        that bodies may be drawn touching or overlapping. "placed" takes the overlap as the bodies are placed.
        `solve_static` closes the overlap in its load steps; with `update_initial=True`, further runs begin pressed.
        Default: bodies that overlap are refused.
    within : float, optional
        For a sequence of bodies: distance up to which two patches get a contact [m]. Default: the radius of the smaller
        patch, from its centre to its farthest node; for skins any distance.
    name : str
        For a sequence of bodies, the number of the contact is added to it, from one. Default: that of the bodies, as
        "ball on plate". A body without a name is "body 0" by its number, a rigid surface "plane" by its kind.

    Returns
    -------
    PartitionContact
        For a sequence of bodies, a list of contacts. Skins with sharp edges have two with each other: one with rows all
        over the slave, and one with rows="edges". Of formulation "hertz" there is one for each two smooth faces that
        can touch at a point; a warning tells of faces that cannot, and are left out.

    Raises
    ------
    EmptyRegionError, PenetrationError, InputError, IndefiniteMatrixError
    """
    if master is None and not isinstance(slave, PartitionBody):
        if any(choice is not None for choice in (slavePatch, masterPatch, masterBody)):
            raise InputError(
                "slavePatch, masterPatch, masterBody: of a sequence of bodies, all patches are looked at; a surface "
                "that a body carries is a pair in the sequence, (surface, body)"
            )
        if isinstance(rows, str) and rows == "edges":
            raise InputError("rows: 'edges' are made of two bodies at a time, beside their contact")
        side_of = cache(side_at_start)
        plan_pair = partial(
            plan_contact, mbs, formulation=formulation, stiffness=stiffness, friction=friction, side_of=side_of
        )
        of_whole = partial(plan_pair, rows=rows, passes=passes, interference=interference)
        found = pairs_of(mbs, slave, within, side_of)
        pairs = [(pair, faces) for pair in found for faces in _faces_of(pair, formulation, side_of)]
        return _contacts_of(mbs, pairs, name, of_whole, partial(plan_pair, rows="edges"))
    if within is not None:
        raise InputError("within: only for a sequence of bodies, whose pairs are looked for")
    plan = plan_contact(
        mbs,
        slave,
        master,
        formulation=formulation,
        rows=rows,
        passes=passes,
        slavePatch=slavePatch,
        masterPatch=masterPatch,
        masterBody=masterBody,
        stiffness=stiffness,
        friction=friction,
        interference=interference,
        name=name,
    )
    return _build(mbs, plan)


def _contacts_of(
    mbs: MainSystem,
    pairs: Sequence[tuple[FoundPair, Sequence[SmoothFace] | None]],
    name: str,
    plan_whole: Callable[..., ContactPlan],
    plan_edges: Callable[..., ContactPlan],
) -> list[PartitionContact]:
    """Add contacts of pairs that were found; skins also have contacts of the rows at the master's edges."""
    validate_text("name", name)
    contacts = list[PartitionContact]()
    for i, (((slave, patch), master, anywhere, carrier), faces) in enumerate(pairs, 1):
        named, body = name and f"{name} {i}", isinstance(master, tuple)
        partner, of_partner = master if isinstance(master, tuple) else (master, None)
        sides = {"slavePatch": patch, "masterPatch": of_partner, "anywhere": anywhere}
        plan = plan_whole(slave, partner, **sides, masterBody=carrier, name=named, faces=faces)
        contacts.append(_build(mbs, plan))
        if anywhere and body and needs_edges(plan):
            contacts.append(_build(mbs, plan_edges(slave, partner, **sides, name=f"{plan.name} edges")))
    return contacts


def _faces_of(
    pair: FoundPair, formulation: FormulationName | Formulation, side_of: SideOf
) -> Sequence[Sequence[SmoothFace] | None]:
    """Faces of each point at which a pair may touch; a contact by rows has none."""
    if not isinstance(formulation_of(formulation), Hertz):
        return [None]
    sides = [pair.slave]
    if isinstance(pair.master, tuple):
        sides.append(pair.master)
    placed = [side_of(*side) for side in sides]
    rigid = None if isinstance(pair.master, tuple) else pair.master
    return point_pairs(placed, [patch for _, patch in sides], rigid, carried=pair.carrier is not None)


def _build(mbs: MainSystem, plan: ContactPlan) -> PartitionContact:
    """Add a planned contact to the model, with its sensors, and join it to others of its bodies.

    It joins last: others stay as they are if the contact is refused, or Exudyn refuses one of its items.
    """
    held, runs = registered(mbs), runs_of(mbs)
    contact, mechanics = PartitionContact(plan), plan.mechanics
    groups = groups_to_join(contact, held.contacts_on(item for item, _ in contact.sides))
    if not groups:  # its loops are compiled now, and not in the first run
        contact.joined.together  # noqa: B018 - the property keeps its value
    if mechanics.ahead:
        _chain_steps(mbs, runs)
    contact["oContact"] = add_to_object(mbs, contact, runs)
    if plan.carried_by is not None:
        load_carrier(mbs, lambda: runs.at_work(contact), plan.carried_by)
    _add_force_sensor(mbs, runs, contact, first=not held.contacts)
    if mechanics.friction is not None:
        if mechanics.gaps.anywhere:  # most of many contacts are far apart: Python would be called for each of them
            contact["nFrictionData"], contact["sFriction"] = _add_data(mbs, "", N_FRICTION)
        else:
            contact["sFriction"] = _add_sensor(mbs, runs, contact, ContactRun.friction_values)
    if mechanics.zones is not None:
        contact["sPlastic"] = _add_sensor(mbs, runs, contact, ContactRun.plastic_values)
    if groups:
        contact.joined.join(groups)
    held.enter_contact(int(contact["sForce"]), contact)
    kind = type(mechanics.law).__name__
    _log.info("contact %r: %s with %s rows, in a group of %s", plan.name, kind, contact.n_rows, len(contact.group))
    return contact


def _add_force_sensor(mbs: MainSystem, runs: Runs, contact: PartitionContact, *, first: bool) -> None:
    """Add `sForce`. The sensor of the `first` contact samples all contacts. The others read data, without Python."""
    items = require("exudyn.itemInterface")

    def sample(mbs: MainSystem, t: float, *unused: object) -> list[float]:
        return runs.sample(mbs, t).contact_run(contact).force_values()

    if first:
        sensor = items.SensorUserFunction(name=contact.name, sensorUserFunction=sample, storeInternal=True)
    else:
        n_values = N_VALUES_AHEAD if contact.mechanics.ahead else N_VALUES
        contact["nGenericData"], contact["sForce"] = _add_data(mbs, contact.name, n_values)
        return
    contact["sForce"] = mbs.AddSensor(sensor)


def _add_data(mbs: MainSystem, name: str, n_values: int) -> tuple[NodeIndex, SensorIndex]:
    """Add a node of data, and the sensor that reads it; return both numbers."""
    items, kind = require("exudyn.itemInterface"), require("exudyn").OutputVariableType.Coordinates
    node = mbs.AddNode(items.NodeGenericData(initialCoordinates=[0.0] * n_values, numberOfDataCoordinates=n_values))
    sensor = items.SensorNode(name=name, nodeNumber=node, outputVariableType=kind, storeInternal=True)
    return node, mbs.AddSensor(sensor)


def _add_sensor(
    mbs: MainSystem, runs: Runs, contact: PartitionContact, values: Callable[[ContactRun], list[float]]
) -> SensorIndex:
    def sample(mbs: MainSystem, t: float, *unused: object) -> list[float]:
        return values(runs.now(mbs).contact_run(contact))

    items = require("exudyn.itemInterface")
    return mbs.AddSensor(items.SensorUserFunction(sensorUserFunction=sample, storeInternal=True))


def _chain_steps(mbs: MainSystem, runs: Runs) -> None:
    """Let contacts act before the model's own PreStep function, and after its PostStep function."""
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
