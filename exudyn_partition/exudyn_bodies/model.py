"""Items of this library in an Exudyn model: bodies and contacts, their coordinates, and the present step."""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from itertools import chain, islice
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp

from ..contact.formulations.formulation import Method
from ..contact.step_mean import GeneralizedAlpha
from ..errors import InputError, RunError
from ..frames.damping import Damping
from ..plasticity.strain_history import StrainHistory
from ..reduction.body import ReducedBody
from ..support.arrays import Array
from ..support.checks import validate_text
from ..support.foreign import (
    Exudyn,
    ItemEntry,
    ItemIndex,
    MainSolver,
    MainSystem,
    NodeIndex,
    SensorIndex,
    UserFunction,
)
from ..support.optional import require

REGISTRY = "exudynPartition"  # key in mbs.sys
_PACKAGE = f"{__name__.partition('.')[0]}."
WORK = "work of items"  # name of the sensor of `CreateWorkSensor`
OBJECTS = "oGenericODE2", "oFFRFreducedOrder"  # keys of a body's objects
DAMPING = "damping of held bodies"  # name of the sensor that finds the joints which hold damped bodies


_RENUMBERED = (
    "than it was given: an item was deleted, which gives others new numbers. Delete no items of a model with partition "
    "bodies; make it anew"
)


class BodyItem(Protocol):
    """A body in a model: what this module needs to know of it."""

    name: str
    body: ReducedBody

    @property
    def nodes(self) -> list[NodeIndex]:
        """Exudyn nodes of the body, in the order of its coordinates."""

    @property
    def node_sizes(self) -> list[int]:
        """Number of coordinates of each node."""

    def is_in(self, mbs: MainSystem, number: int | None = None) -> bool:
        """Whether the model still holds the body, as the object of this number; default: the one that it had."""

    def __getitem__(self, key: str, /) -> ItemIndex:
        """Exudyn's indices by name."""


class PlasticItem(Protocol):
    """Plastic zones of a contact in a model: what bodies need to know of them."""

    def work(self, result: Any) -> Array:
        """Plastic work since the start of the run, (n,) [J]."""

    def strain_histories(self, result: Any) -> list[StrainHistory | None]:
        """Plastic strain in the run beneath the patch of each side; None where none can yield."""


class ContactItem(Protocol):
    """A contact in a model: what bodies need to know of it."""

    @property
    def sides(self) -> Sequence[tuple[BodyItem, int]]:
        """Slave, and master if it is a partition body; each with the number of its patch."""

    @property
    def compliant(self) -> bool:
        """Whether rows yield by a flexibility of the contact, so that forces are known at every node."""

    def force(self, result: Any) -> Array:
        """Sum of the normal forces, (n,) [N]."""

    def nodal_forces(self, result: Any) -> list[Array]:
        """Forces on the nodes of each side's patch, in axes of space, (n, np, 3) [N]."""

    @property
    def plastic(self) -> PlasticItem:
        """Plastic zones beneath its patches."""


class Samples(Protocol):
    """Results of a run, as bodies and contacts read them."""

    @property
    def t(self) -> Array:
        """Times of the samples, (n,) [s]."""

    @property
    def method(self) -> str:
        """Solver: "explicit", "implicit", "static", or "" if it is not known."""

    @property
    def steps(self) -> int:
        """Steps taken."""

    @property
    def contacts(self) -> Sequence[ContactItem]:
        """Contacts of the model."""

    def dampings_of(self, item: Any) -> tuple[tuple[float, Damping], ...]:
        """Damping of a body in the run, as joints held it, each with the time from which it acted [s]."""

    def sensor_of(self, item: object, number: SensorIndex) -> Array:
        """Samples of sensor `number`, which belongs to `item`, (n, k)."""


class Registry:
    """Items of this library in a model.

    Attributes
    ----------
    bodies, contacts : dict
        By number of their object, and of their sensor.
    work : WorkSensor or None
    damping : DampingSensor or None
    springs : dict of int to (n, n) csr matrix
        What holds bodies in the present run, beside the stiffness that their objects were made with; by object number.
    nodes_in_contact : dict of int to NodeIndex
        Nodes of the object of all contacts, by their numbers; empty if they have to be read from it.
    """

    def __init__(self) -> None:
        self.work: Any = None
        self.damping: Any = None
        self.springs: dict[int, sp.csr_matrix] = {}
        self.hold({}, {})

    def hold(self, bodies: Mapping[int, Any], contacts: Mapping[int, Any]) -> None:
        """Hold these bodies and contacts alone, see `bodies` and `contacts`."""
        self.bodies: dict[int, Any] = {}
        self.contacts: dict[int, Any] = {}
        self.nodes_in_contact: dict[int, NodeIndex] = {}
        self._places: dict[BodyItem, int] = {}
        self._on_body: dict[BodyItem, list[Any]] = {}
        self._surfaces: dict[type, dict[int, int]] = {}  # by their identity: surfaces of users may have no hash
        for number, item in bodies.items():
            self.enter_body(number, item)
        for number, contact in contacts.items():
            self.enter_contact(number, contact)

    def enter_body(self, number: int, item: BodyItem) -> None:
        """Enter a new body with the number of its object."""
        self.bodies[number] = item
        self._places[item] = len(self._places)

    def enter_contact(self, number: int, contact: Any) -> None:
        """Enter a new contact with the number of its sensor."""
        self.contacts[number] = contact
        for item in {item for item, _ in contact.sides}:
            self._on_body.setdefault(item, []).append(contact)
        if len(contact.sides) == 1:
            surface = contact.master
            self._surfaces.setdefault(type(surface), {})[id(surface)] = self.surface_number(surface)

    @property
    def objects(self) -> set[int]:
        """Numbers of the objects of all bodies, and of that of all contacts."""
        ours = {int(item[key]) for item in self.bodies.values() for key in OBJECTS if key in item}
        return ours | {int(contact["oContact"]) for contact in islice(self.contacts.values(), 1)}

    def place(self, item: BodyItem) -> int:
        """How many bodies were entered before this one."""
        return self._places[item]

    def surface_number(self, surface: object) -> int:
        """Which of the model's rigid surfaces of its kind this is, from one, or would be if it is new."""
        alike = self._surfaces.get(type(surface), {})
        return alike.get(id(surface), len(alike) + 1)

    def contacts_on(self, items: Iterable[BodyItem]) -> list[Any]:
        """Contacts of some bodies, each once."""
        return [*dict.fromkeys(chain.from_iterable(self._on_body.get(item, ()) for item in items))]


def validate_model(mbs: MainSystem) -> None:
    """Raise unless `mbs` is a model of Exudyn."""
    exu = require("exudyn")
    if not isinstance(mbs, exu.MainSystem):
        hint = "; make one by its AddSystem()" if isinstance(mbs, exu.SystemContainer) else ""
        raise InputError(f"mbs: expected a model of Exudyn, a MainSystem, got {type(mbs).__name__}{hint}")


def validate_new_name(mbs: MainSystem, name: object, kinds: Collection[str]) -> str:
    """Return `name`, or raise if an item of the model of one of these kinds, such as "Object", already has it."""
    validate_text("name", name)
    for kind in kinds:
        if name and is_taken(mbs, str(name), kind):
            raise InputError(
                f"name: the model already has the {kind.lower()} {name!r}, and Exudyn takes each name once. Choose "
                "another name. A notebook cell that is run again must first make a new model with AddSystem()"
            )
    return str(name)


def is_taken(mbs: MainSystem, name: str, kind: str) -> bool:
    """Whether an item of the model, of a kind such as "Object", has a name."""
    return int(getattr(mbs, f"Get{kind}Number")(name)) >= 0


def registered(mbs: MainSystem) -> Registry:
    """Return bodies and contacts of a model; those from before an `mbs.Reset()` are removed.

    Exudyn is asked about the newest body alone. A Reset removes it, and a deletion of an older item changes its number.

    Raises
    ------
    InputError
        If `mbs` is no model.
    RunError
        If the newest body has another number.
    """
    validate_model(mbs)
    held = registry(mbs)
    objects, sensors = mbs.systemData.NumberOfObjects(), mbs.systemData.NumberOfSensors()

    def holds(number: int) -> bool:
        return number < objects and bool(held.bodies[number].is_in(mbs))

    if held.bodies and not holds(next(reversed(held.bodies))):
        newest = next(reversed(held.bodies.values()))
        if any(newest.is_in(mbs, number) for number in range(objects)):
            raise RunError(f"mbs: body {newest.name!r} has another number {_RENUMBERED}")
        bodies = {number: item for number, item in held.bodies.items() if holds(number)}
        there, contacts = {*bodies.values()}, held.contacts.items()
        held.hold(bodies, {n: contact for n, contact in contacts if all(item in there for item, _ in contact.sides)})

    def is_there(number: SensorIndex, name: str) -> bool:
        return int(number) < sensors and bool(mbs.GetSensor(number)["name"] == name)

    if held.work is not None and not is_there(held.work.number, WORK):
        held.work = None
    if held.damping is not None and not is_there(held.damping.number, DAMPING):
        held.damping = None
    return held


def check_objects(mbs: MainSystem, held: Registry) -> None:
    """Raise if the object of a body, of its markers, or of all contacts has another number than it was given.

    Raises
    ------
    RunError
    """
    for place, item in enumerate(held.bodies.values()):
        carrier = [item["nRigidBody"], item["nGenericODE2"]] if OBJECTS[1] in item else []
        for key, nodes in zip(OBJECTS, (item.nodes, carrier), strict=True):
            if nodes and not _has_nodes(mbs, item[key], nodes):
                raise RunError(f"mbs: an object of body {item.name or place!r} has another number {_RENUMBERED}")
    check_contact_object(mbs, held)


def check_contact_object(mbs: MainSystem, held: Registry) -> None:
    """Raise if the object of all contacts has another number than it was given.

    Raises
    ------
    RunError
    """
    for contact in islice(held.contacts.values(), 1):
        if not _has_nodes(mbs, contact["oContact"], contact.nodes):
            raise RunError(f"mbs: the object of all contacts has another number {_RENUMBERED}")


def _has_nodes(mbs: MainSystem, number: ItemIndex, nodes: Sequence[ItemIndex]) -> bool:
    """Whether the object of a number is there, and has these nodes."""
    try:
        return {*map(int, nodes)} <= {*map(int, mbs.GetObjectParameter(number, "nodeNumbers"))}
    except (IndexError, ValueError):  # no such object, or one without nodes
        return False


def registry(mbs: MainSystem) -> Registry:
    """Return where new bodies and contacts of a model are entered; `registered` is to be read."""
    held: Registry | None = mbs.sys.get(REGISTRY)
    if held is None:
        held = mbs.sys[REGISTRY] = Registry()
    return held


def coordinate_slices(mbs: MainSystem, item: BodyItem) -> list[slice]:
    """Places of a body's coordinates in the system vector; they may change when a model is assembled again."""
    starts = [mbs.GetNodeODE2Index(node) for node in item.nodes]
    return [slice(a, a + size) for a, size in zip(starts, item.node_sizes, strict=True)]


def dofs_of(mbs: MainSystem, item: BodyItem) -> Array:
    """Numbers of a body's coordinates in the system vector, (n_dofs,)."""
    return np.concatenate([np.arange(place.start, place.stop) for place in coordinate_slices(mbs, item)])


def user_function(entry: ItemEntry | None) -> UserFunction | None:
    """User function that Exudyn's Get...UserFunction or GetObjectParameter returns, if there is one."""
    return entry["function"] if isinstance(entry, dict) else None


def is_ours(entry: ItemEntry | None) -> bool:
    """Whether such a user function is there and is one of this library."""
    function = user_function(entry)
    return function is not None and str(getattr(function, "__module__", "")).startswith(_PACKAGE)


def start_of_step(mbs: MainSystem) -> float:
    """Time at the start of the present step [s]."""
    return float(mbs.systemData.GetTime(_start_configuration()))


@functools.cache  # it is asked for in every step
def _start_configuration() -> Exudyn:
    return require("exudyn").ConfigurationType.StartOfStep


def latest_solver(mbs: MainSystem) -> MainSolver | None:
    """Exudyn's solver that runs now or ran last; None if there was none, or `storeSolver=False` kept none.

    The model keeps a dynamic and a static one. The other one of them stands at another time.
    """
    solvers = [mbs.sys[key] for key in ("dynamicSolver", "staticSolver") if key in mbs.sys]
    return next((solver for solver in solvers if solver.it.currentTime == mbs.systemData.GetTime()), None)


def method_of(solver: MainSolver) -> Method:
    """Return the method of a solver of Exudyn."""
    name = solver.GetSolverName()
    return "static" if "static" in name else "implicit" if "implicit" in name else "explicit"


class SolverMotion:
    """What a law may ask of Exudyn's solver, see `formulation.Motion`.

    It lives for one evaluation. An object that lives longer must not hold the model: the model holds its user
    functions, and these would hold the model, so that neither is ever freed.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    of : callable
        Returns the coordinates of a contact, (n,), of those of the model.
    """

    __slots__ = ("_mbs", "_of")

    def __init__(self, mbs: MainSystem, of: Callable[[Array], Array]) -> None:
        self._mbs, self._of = mbs, of

    @property
    def q(self) -> Array:
        """See `formulation.Motion`."""
        return self._of(self._mbs.systemData.GetODE2Coordinates(copy=False))

    @property
    def q_t(self) -> Array:
        """See `formulation.Motion`. Exudyn's explicit solver gives velocities in the middle of the step.

        Forces by them would be of first order.
        """
        data, solver = self._mbs.systemData, self._mbs.sys.get("dynamicSolver")
        q_t = self._of(data.GetODE2Coordinates_t(copy=False))
        if solver is None or "VelocityVerlet" not in solver.GetSolverName():
            return q_t
        half_step = 0.5 * (data.GetTime() - start_of_step(self._mbs))
        value: Array = q_t + half_step * self._of(data.GetODE2Coordinates_tt(copy=False))
        return value

    @property
    def step(self) -> float:
        """See `formulation.Motion`."""
        return float(self._mbs.sys["dynamicSolver"].it.currentStepSize)

    @property
    def start(self) -> float:
        """See `formulation.Motion`."""
        return start_of_step(self._mbs)

    @property
    def weights(self) -> GeneralizedAlpha:
        """See `formulation.Motion`."""
        solver = self._mbs.sys["dynamicSolver"]
        return GeneralizedAlpha(solver.alphaM, solver.alphaF, solver.newmarkBeta, solver.newmarkGamma)
