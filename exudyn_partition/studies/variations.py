"""What `run_many` varies: values of all entries, checked, and the plan and start of each entry."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ..algebra.coulomb import Coulomb
from ..compiled.moving import Moves, anchors_at, pairs_at
from ..compiled.plan import Bodies, FrozenPlan, StepPlan
from ..compiled.start import Start
from ..errors import InputError
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.partition_contact import PartitionContact
from ..frames.damping import Ratios, Rayleigh, damping_of
from ..frames.floating import FloatingKinematics
from ..simulation.compiled_plan import Groups, softened
from ..support.arrays import Array
from ..support.checks import validate_array

VECTORS = ("initialVelocity", "initialAngularVelocity", "referencePosition", "gravity")
POSITIVE = ("E", "rho")
QUANTITIES = (*VECTORS, "damping", *POSITIVE)

Vary = Mapping[PartitionBody | PartitionContact, Mapping[str, Array]]


@dataclass(frozen=True, eq=False)
class Variations:
    """Values of all entries.

    Parameters
    ----------
    count : int
        Number of entries, B.
    values : dict of PartitionBody to dict of str to (B,) or (B, 3) array
        By body and name, see `run_many`; damping of each mode is (B, k).
    friction : dict of PartitionContact to (B,) array
        Coefficients of friction of some contacts.
    """

    count: int
    values: Mapping[PartitionBody, Mapping[str, Array]]
    friction: Mapping[PartitionContact, Array] = field(default_factory=dict)

    @classmethod
    def checked(
        cls,
        vary: object,
        bodies: Sequence[PartitionBody],
        contacts: Sequence[PartitionContact] = (),
        argument: str = "vary",
    ) -> Variations:
        """Check what the user gives as an argument.

        Raises
        ------
        InputError
            If it is no dict of bodies of the model to dicts of arrays, or lengths differ.
        """
        expected = f"{argument}: expected a dict of body: dict of name: array, with bodies from CreatePartitionBody()"
        if not isinstance(vary, Mapping) or not vary:
            raise InputError(f"{expected}, got {'an empty one' if vary == {} else type(vary).__name__}")
        checked: dict[PartitionBody, dict[str, Array]] = {}
        friction: dict[PartitionContact, Array] = {}
        count = None
        for item, of_body in vary.items():
            if item in contacts:
                friction[item] = _checked_friction(item, of_body, argument, count)
                count = len(friction[item])
                continue
            if item not in bodies:
                raise InputError(f"{expected}, got the key {item!r:.60}, which is no body of this model")
            if not isinstance(of_body, Mapping) or not of_body:
                raise InputError(f"{expected}, got {type(of_body).__name__} for body {item.name!r}")
            checked[item] = {}
            for name, value in of_body.items():
                if name not in QUANTITIES:
                    raise InputError(f"{argument}: expected names among {', '.join(QUANTITIES)}, got {name!r}")
                array = validate_array(f"{argument}: {name}", value, _shape(item, name, value, count))
                if not len(array):
                    raise InputError(f"{argument}: {name} has no entries; expected at least one")
                if (name in POSITIVE and array.min() <= 0) or (name == "damping" and array.min() < 0):
                    least = "above zero" if name in POSITIVE else "of at least zero"
                    raise InputError(f"{argument}: {name}: expected values {least}, got {array.min():.6g}")
                checked[item][name], count = array, len(array)
            _check_material(item, checked[item], argument)
        assert count is not None
        return cls(count, checked, friction)

    def of(self, item: PartitionBody, name: str, entry: int) -> Array | None:
        """Value of an entry, (3,), (k,) or (); None if it does not vary."""
        values = self.values.get(item, {}).get(name)
        return None if values is None else np.asarray(values[entry])

    def varies(self, item: PartitionBody, name: str) -> bool:
        """Whether a value of a body varies."""
        return name in self.values.get(item, {})

    def factor(self, item: PartitionBody, name: str, entry: int) -> float:
        """E or rho of an entry over that of the body."""
        value = self.of(item, name, entry)
        if value is None or item.body.material is None:
            return 1.0
        return float(value / getattr(item.body.material, name))


def _checked_friction(contact: PartitionContact, given: object, argument: str, count: int | None) -> Array:
    """Coefficients of friction of a contact, (B,)."""
    if not isinstance(given, Mapping) or [*given] != ["friction"]:
        raise InputError(f"{argument}: for contact {contact.name!r} expected {{'friction': array}}, got {given!r:.60}")
    if contact.mechanics.friction is None:
        raise InputError(
            f"{argument}: contact {contact.name!r} has no friction in the model; create it with friction=, whose "
            "coefficient then varies"
        )
    coefficients = validate_array(f"{argument}: friction", given["friction"], (count,))
    if not len(coefficients):
        raise InputError(f"{argument}: friction has no entries; expected at least one")
    for coefficient in (coefficients.min(), coefficients.max()):
        Coulomb(float(coefficient))  # which checks it
    return coefficients


def _shape(item: PartitionBody, name: str, value: object, count: int | None) -> tuple[int | None, ...]:
    """Shape of the values of a quantity; damping may have one for each elastic mode."""
    if name == "damping" and isinstance(value, Sequence | np.ndarray) and len(value) and np.ndim(value[0]):
        return count, len(item.body.basis.omega) - 6
    return (count, 3) if name in VECTORS else (count,)


def _check_material(item: PartitionBody, given: Mapping[str, Array], argument: str) -> None:
    """Raise an error if a body's E or rho cannot vary."""
    named = [name for name in POSITIVE if name in given]
    if named and item.body.material is None:
        raise InputError(f"{argument}: {named[0]} of body {item.name!r}, which is from matrices that tell no material")
    if named and callable(item.ratios) and "damping" not in given:
        raise InputError(
            f"{argument}: {named[0]} of body {item.name!r}, whose damping is a function of frequency; vary its damping "
            "too"
        )


class Entries:
    """Plans and starts of all entries.

    Parameters
    ----------
    plan : StepPlan
        Of the model as it is.
    start : Start
        Its initial state.
    places : dict of PartitionBody to (n_dofs,) int array
        Numbers of the coordinates of each body.
    contacts : sequence of PartitionContact
        In the order of the plan.
    groups : Groups
        These contacts at the start, as they are solved together.
    variations : Variations
    following : Moves, optional
        Contacts whose rows follow the motion. Default: none.
    """

    def __init__(
        self,
        plan: StepPlan,
        start: Start,
        places: Mapping[PartitionBody, Array],
        contacts: Sequence[PartitionContact],
        groups: Groups,
        variations: Variations,
        following: Moves | None = None,
    ) -> None:
        self._plan, self._start, self._places, self._contacts = plan, start, places, contacts
        self._groups, self._variations, self._following = groups, variations, following or Moves.none()
        self._check_turning()

    def _check_turning(self) -> None:
        """Raise an error if E or rho varies of a body whose inertia forces or moving rows go with them."""
        moving = self._plan.contacts.moving
        first = len(self._plan.contacts.names)  # of contacts with friction
        numbers = () if moving is None else (
            *(pair.contact for pair in moving.pairs), *(first + pair.contact for pair in moving.rubbing_pairs)
        )  # fmt: skip
        contacts = [self._contacts[number] for number in numbers]
        follow = [item for contact in contacts for item, _ in contact.sides]
        for item in self._places:
            named = [name for name in POSITIVE if self._variations.varies(item, name)]
            if named and (item.frame == "floating" or item in follow):
                raise InputError(
                    f"vary: {named[0]} of body {item.name!r}, which has a floating frame, or rows that follow facets "
                    "of another body: compiled runs have no factor for its growth and these rows. Reduce a body of "
                    "each material, or take frame='inertial' and pairs that stay where they are"
                )

    @property
    def size(self) -> int:
        """Number of coordinates of the model."""
        return len(self._start.q)

    @property
    def model(self) -> tuple[StepPlan, Start]:
        """Plan and start of the model as it is."""
        return self._plan, self._start

    def flexibility_key(self, entry: int) -> tuple[float, ...]:
        """What the flexibility of rows depends on: factors of E of all bodies."""
        return tuple(self._variations.factor(item, "E", entry) for item in self._places)

    def contacts(self, entry: int) -> FrozenPlan:
        """Contacts of an entry, whose flexibility goes with 1 / E of each body."""
        contacts, key = self._plan.contacts, self.flexibility_key(entry)
        if all(factor == 1.0 for factor in key):
            return contacts
        return self._softened({item: 1.0 / factor for item, factor in zip(self._places, key, strict=True)})

    def part(self, item: PartitionBody, entry: int) -> FrozenPlan:
        """Contacts of an entry in which no body but one yields."""
        return self._softened({item: 1.0 / self._variations.factor(item, "E", entry)})

    def touching(self, item: PartitionBody) -> list[int]:
        """Numbers of the contacts of a body."""
        return [j for j, contact in enumerate(self._contacts) if any(side == item for side, _ in contact.sides)]

    def _softened(self, shares: Mapping[PartitionBody, float]) -> FrozenPlan:
        """Contacts in which shares of the flexibilities of some bodies yield."""
        of_sides = [[shares.get(item, 0.0) for item, _ in contact.sides] for contact in self._contacts]
        return softened(self._plan.contacts, self._groups, of_sides)

    @cached_property
    def of_ratio_one(self) -> dict[PartitionBody, Array]:
        """Diagonal of each body's damping with a ratio of one, (n_dofs,); its elastic modes come last."""
        return {item: damping_of(item.kinematics, 1.0).matrix().diagonal() for item in self._places}

    def plan(self, entry: int, contacts: FrozenPlan) -> StepPlan:
        """Plan of an entry with its contacts.

        Shapes stay as they are: mass goes with rho, stiffness with E, and damping so that ratios stay.
        """
        values, bodies = self._variations, Bodies(*(part.copy() for part in self._plan.bodies))
        for item, dofs in self._places.items():
            E, rho = (values.factor(item, name, entry) for name in POSITIVE)
            gravity, ratio = values.of(item, "gravity", entry), values.of(item, "damping", entry)
            bodies.mass[dofs] *= rho
            bodies.stiffness[dofs] *= E
            if ratio is None:
                by_E, by_rho = damping_power(item.ratios)
                bodies.damping[dofs] *= E**by_E * rho**by_rho
            else:
                of_modes = np.r_[np.zeros(6), np.broadcast_to(ratio, len(dofs) - 6)]
                bodies.damping[dofs] = math.sqrt(E * rho) * of_modes * self.of_ratio_one[item]
            before = np.zeros(len(dofs)) if item.weight is None else item.weight
            after = before if gravity is None else item.kinematics.weight(gravity)
            bodies.load[dofs] += rho * after - before
        return StepPlan(bodies, self._with_friction(entry, contacts))

    def _with_friction(self, entry: int, contacts: FrozenPlan) -> FrozenPlan:
        """Contacts with the coefficients of an entry."""
        coefficients = self._variations.friction
        if contacts.friction is None or not coefficients:
            return contacts
        with_friction = self._contacts[len(contacts.names) :]
        mu = [float(coefficients[contact][entry]) if contact in coefficients else None for contact in with_friction]
        return replace(contacts, friction=contacts.friction.with_coefficients(mu))

    def start(self, entry: int) -> Start:
        """Start of an entry."""
        values, q, v = self._variations, self._start.q.copy(), self._start.v.copy()
        for item, dofs in self._places.items():
            place = values.of(item, "referencePosition", entry)
            if place is not None:
                q[dofs] += _moved(item, place - item.position)
            velocity, turning = (values.of(item, name, entry) for name in VECTORS[:2])
            if velocity is not None or turning is not None:
                v[dofs] = _thrown(item, q[dofs], v[dofs], velocity, turning)
        placed = any("referencePosition" in given for given in values.values.values())
        start, moves = replace(self._start, q=q, v=v), self._following
        if not placed:
            return start
        rubs = start.rubbing
        if rubs is not None:  # with friction, a placed contact has no anchor before its rows first push
            rubs = replace(anchors_at(moves.rubbing, q), anchored=rubs.anchored)
        return replace(
            start, anchors=anchors_at(moves.rigid, q), pairs=pairs_at(moves.pairs, q), rubbing=rubs,
            rubbing_pairs=pairs_at(moves.rubbing_pairs, q),
        )  # fmt: skip


def _moved(item: PartitionBody, way: Array) -> Array:
    """Change of a body's coordinates, (n_dofs,), that moves it by a way, (3,) [m]."""
    if item.frame == "floating":
        return np.concatenate([way, np.zeros(item.body.n_dofs - 3)])
    return np.asarray(item.body.rigid[:, :3] @ way)


def _thrown(item: PartitionBody, q: Array, v: Array, velocity: Array | None, turning: Array | None) -> Array:
    """Velocities of a body, (n_dofs,), with another velocity [m/s] or angular velocity [rad/s], if any."""
    kinematics = item.kinematics
    if isinstance(kinematics, FloatingKinematics):
        thrown = v.copy()
        if velocity is not None:
            thrown[:3] = velocity
        if turning is not None:
            thrown[3:6] = turning @ (kinematics.frame(q)[1] @ kinematics.node_axes)
        return thrown
    motion = kinematics.rigid_motion(v)
    parts = (motion[:3] if velocity is None else velocity), (motion[3:] if turning is None else turning)
    return np.asarray(item.body.rigid @ np.concatenate(parts))


def damping_power(ratios: Ratios | None) -> tuple[float, float]:
    """Powers of E and rho with which damping goes that has the same ratios, or the same coefficient of the mass."""
    return (0.0, 1.0) if isinstance(ratios, Rayleigh) else (0.5, 0.5)
