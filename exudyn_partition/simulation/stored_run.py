"""Results of runs as files: data of sensors and contacts, and marks by which their model is known again.

Without the model that was run, `StoredContact` and `StoredBody` replace its items.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NoReturn

import numpy as np
import scipy.sparse as sp

from ..algebra.coulomb import Coulomb
from ..errors import InputError
from ..exudyn_bodies.model import Samples
from ..exudyn_bodies.other_bodies import OtherBody
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.kept_run import KEPT, KeptRun
from ..exudyn_contacts.partition_contact import PartitionContact
from ..exudyn_contacts.run_state import STATES
from ..support.archive import Format, sketch
from ..support.arrays import Array, consecutive
from ..support.checks import read_only, validate_result
from .continuation import RunEnd
from .step_control import Closing, Pace
from .velocity_error import VelocityError
from .work import Work

_PLAIN = bool, int, float, str, np.ndarray
_OF_MODEL = ("slave", "master", "sides", "formulation", "carrier", "group", "together", "moment_about")
_CHOSEN = frozenset(  # parts of marks that users choose; all else comes of the mesh and the partition
    {"damping", "weight", "plastic states", "friction", "surface", "interference", "formulation", "point of the moment"}
)
_SAME = 1e-7  # share of the norm of an array that rounding may change if a body is reduced again


@dataclass(frozen=True, eq=False)
class ItemMark:
    """Mark by which a body or a contact of a model is known again.

    Parameters
    ----------
    said : str
        The item in words.
    parts : tuple of str
        Names of what the item consists of.
    exact : tuple of str
        For each part, a digest of what rounding does not change.
    names : tuple of str
        Names of the sketches of what rounding changes, see `archive.sketch`.
    sizes : tuple of int
        Length of each sketch.
    sketches : (n,) array
        All of them, one behind the other.
    """

    said: str
    parts: tuple[str, ...]
    exact: tuple[str, ...]
    names: tuple[str, ...]
    sizes: tuple[int, ...]
    sketches: Array

    @classmethod
    def of_item(cls, said: str, content: Mapping[str, object]) -> ItemMark:
        """Mark of an item with this content, by the names of its parts."""
        exact, sketches = [], dict[str, Array]()
        for part, value in content.items():
            digest, numbers = sketch(value)
            exact.append(digest)
            sketches |= {f"{part}.{name}" if name else part: values for name, values in numbers.items() if values.size}
        sizes = tuple(map(len, sketches.values()))
        return cls(said, tuple(content), tuple(exact), tuple(sketches), sizes, np.concatenate([[], *sketches.values()]))

    def difference(self, other: ItemMark) -> str:
        """Difference from another mark, in words; empty if there is none."""
        if self.said != other.said:
            return f"{self.said}; this one has {other.said}"
        for part, mine, others in zip(self.parts, self.exact, other.exact, strict=True):
            if mine != others:
                return f"{self.said}, " + (
                    f"with other {part}" if part in _CHOSEN else "of another mesh, partition or size"
                )
        for name, place in zip(self.names, consecutive(self.sizes), strict=True):
            first, second = self.sketches[place], other.sketches[place]
            scale = abs(first) if name in self.parts else first[:1]
            if not (abs(first - second) <= _SAME * scale).all():
                return f"{self.said}, with other {name if name in _CHOSEN else f'numbers in {name}'}"
        return ""


@dataclass(frozen=True, eq=False)
class StoredBodyRun:
    """Data of a run for a body.

    Parameters
    ----------
    name, frame : str
    coordinates, coordinates_t : (k,) int arrays
        Numbers of the sensors.
    mass : float
        [kg]
    energy : (n,) array
        Kinetic and elastic energy [J].
    momentum : (n, 3) array
        [N s]
    """

    name: str
    frame: str
    coordinates: Array
    coordinates_t: Array
    mass: float
    energy: Array
    momentum: Array

    def __post_init__(self) -> None:
        read_only(self.energy, self.momentum)


@dataclass(frozen=True, eq=False)
class StoredContactRun:
    """Data of a run for a contact.

    Parameters
    ----------
    name : str
    sensors : dict of str to int
        Numbers of its sensors; keys are those of the contact.
    ahead, elastic, compliant, viscous : bool
        See `PatchContact`.
    yields : bool
        Whether the contact has plastic zones.
    friction : Coulomb or None
    kept : KeptRun or None
        Data that the contact kept; None if it kept none.
    damped : bool
        See `PatchContact`.
    semi_axes : tuple of float
        Semi-axes under a force of one newton of a contact at a point [m]; empty if rows tell where a contact is.
    """

    name: str
    sensors: dict[str, int]
    ahead: bool
    elastic: bool
    compliant: bool
    yields: bool
    friction: Coulomb | None
    kept: KeptRun | None
    damped: bool = False
    semi_axes: tuple[float, ...] = ()

    @classmethod
    def of_contact(cls, contact: PartitionContact, kept: KeptRun | None) -> StoredContactRun:
        """Data of a contact of a model, or of one that was stored."""
        mechanics = contact.mechanics
        return cls(
            name=contact.name,
            sensors={key: int(number) for key, number in contact.items() if key.startswith("s")},
            ahead=mechanics.ahead,
            elastic=contact.elastic,
            compliant=contact.compliant,
            yields=bool(contact.plastic),
            friction=contact.friction.coulomb,
            kept=kept,
            damped=mechanics.damped,
            semi_axes=tuple(map(float, mechanics.law.semi_axes(1.0) or ())),
        )


@dataclass(frozen=True, eq=False)
class StoredRun:
    """Fields of a `Result`, without the items of a model.

    Parameters
    ----------
    t : (n,) array
        [s]
    status, message : str
    step : float
        [s]
    steps : int
    method : str
    time_s : float
        [s]
    work : Work
    numbers, seldom : (k,) int arrays
        Of the sensors.
    samples : tuple of (n, m) arrays
        Samples of each sensor in `numbers`.
    items : tuple of ItemMark
        Marks of each body and contact of the model, see `described`.
    bodies : tuple of StoredBodyRun
    contacts : tuple of StoredContactRun
    warnings : tuple of str or None
    others : tuple of OtherBody
    end : RunEnd or None

    Raises
    ------
    InputError
        If the samples do not fit the times or the sensors.
    """

    t: Array
    status: str
    message: str
    step: float
    steps: int
    method: str
    time_s: float
    work: Work
    numbers: Array
    seldom: Array
    samples: tuple[Array, ...]
    items: tuple[ItemMark, ...]
    bodies: tuple[StoredBodyRun, ...]
    contacts: tuple[StoredContactRun, ...]
    warnings: tuple[str, ...] | None
    others: tuple[OtherBody, ...]
    end: RunEnd | None

    def __post_init__(self) -> None:
        read_only(self.t, self.numbers, self.seldom, *self.samples)
        if len(self.numbers) != len(self.samples) or any(len(data) != len(self.t) for data in self.samples):
            raise InputError(f"samples: expected {len(self.numbers)} sensors with {len(self.t)} times each")


FILE = Format(
    name="result",
    version=1,
    units="SI (m, kg, s, N, rad), or the consistent units that the model was made in",
    classes=(
        *(StoredRun, Work, ItemMark, StoredBodyRun, StoredContactRun, Coulomb, OtherBody, *KEPT),
        *(RunEnd, Pace, Closing, VelocityError, *STATES),
    ),
)


class _StoredPoint:
    """Law of a stored contact, as far as it is stored."""

    def __init__(self, axes: tuple[float, ...]) -> None:
        self._axes = axes

    def semi_axes(self, force: float) -> tuple[float, float] | None:
        """See `Law`."""
        if not self._axes:
            return None
        first, second = (axis * float(np.cbrt(force)) for axis in self._axes)
        return first, second


class StoredLaw:
    """Mechanics of a stored contact, as far as they are stored; all else needs the model."""

    def __init__(self, run: StoredContactRun) -> None:
        self.ahead, self.elastic, self.compliant, self.friction = run.ahead, run.elastic, run.compliant, run.friction
        self.zones = _StoredZones(run.name) if run.yields else None
        self.damped, self.law = run.damped, _StoredPoint(run.semi_axes)
        self._name, self._kept = run.name, run.kept

    @property
    def node_areas(self) -> Array:
        """See `PatchContact`."""
        return self._known.areas

    @property
    def node_pressures(self) -> sp.csr_matrix:
        """See `PatchContact`."""
        return self._known.pressures

    @property
    def _known(self) -> KeptRun:
        if self._kept is None:
            raise InputError(f"contact {self._name!r}: the file has no forces of rows")
        return self._kept

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        raise _needs_model(f"contact {self.__dict__.get('_name', '')!r}", name)


class _StoredZones:
    """Plastic zones of a stored contact: only their existence is stored, and all else needs the model."""

    def __init__(self, name: str) -> None:
        self._name = name

    @property
    def motions(self) -> NoReturn:
        """See `Zones`."""
        raise _needs_model(f"contact {self._name!r}", "zones")


class StoredContact(PartitionContact):
    """A contact of a result that was read without its model.

    It has forces, gaps, rows, pressures, areas, friction, plastic work and energies of the run, as `PartitionContact`
    has them. Results that need bodies raise an error.

    Parameters
    ----------
    run : StoredContactRun
    """

    def __init__(self, run: StoredContactRun) -> None:
        dict.__init__(self, run.sensors)  # there are no sides, nor attributes that need them
        self.name, self.mechanics = run.name, StoredLaw(run)  # type: ignore[assignment]

    def _gap_of_surface(self, result: Any) -> None:
        """None, because surfaces are not known: gaps are then those of rows."""

    def __getattr__(self, name: str) -> Any:
        if name in _OF_MODEL:
            raise _needs_model(f"contact {self.__dict__.get('name', '')!r}", name)
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}", name=name, obj=self)


class StoredBody:
    """A body of a result that was read without its model: its coordinates, energy and momentum.

    Parameters
    ----------
    run : StoredBodyRun
    """

    def __init__(self, run: StoredBodyRun) -> None:
        self.name, self.frame, self.run = run.name, run.frame, run

    @property
    def mass(self) -> float:
        """Mass of the body [kg]."""
        return self.run.mass

    def coordinates(self, result: Samples) -> Array:
        """Coordinates, (n, n_dofs), at the times of `result`."""
        return self._sampled(result, self.run.coordinates)

    def coordinates_t(self, result: Samples) -> Array:
        """Their velocities, (n, n_dofs)."""
        return self._sampled(result, self.run.coordinates_t)

    def energy(self, result: Samples) -> Array:
        """Kinetic and elastic energy, (n,) [J]."""
        return self._of_all(result, self.run.energy)

    def momentum(self, result: Samples) -> Array:
        """Momentum, (n, 3) [N s]."""
        return self._of_all(result, self.run.momentum)

    def _sampled(self, result: Samples, numbers: Array) -> Array:
        validate_result(result)
        return np.hstack([result.sensor_of(self, int(number)) for number in numbers])

    def _of_all(self, result: Samples, values: Array) -> Array:
        self.coordinates(result)
        if len(values) != len(result.t):
            raise InputError(
                f"result: the file has energy and momentum of body {self.name!r} at all {len(values)} times together; "
                "ask for them before result.at()"
            )
        return values

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        raise _needs_model(f"body {self.__dict__.get('name', '')!r}", name)


def _needs_model(item: str, name: str) -> InputError:
    return InputError(
        f"{item}: {name!r} needs the model, and this result was read without it. Build the model by the same calls, "
        "and read the result by Result.load(path, mbs)"
    )


def described(bodies: Sequence[PartitionBody], contacts: Sequence[PartitionContact]) -> tuple[ItemMark, ...]:
    """Marks of the items of a model: all that changes what a result answers, and numbers of sensors.

    The inside of bodies is not in the marks: a run of bodies that were saved without it can be read with whole ones.
    Nor are the yield stress, the time of the reduction, and `left_out`. Of joints, what they do to damping is known.
    """
    marks = []
    for item in bodies:
        body = item.body.without_inside()
        content = {
            "basis": replace(body.basis, left_out=(), labels=("",) * len(body.basis.labels)),
            "patches": tuple(replace(patch, material=None) for patch in body.partition.patches),
            "interfaces": body.partition.interfaces,
            "matrices": (body.points, body.facets, body.mass, body.stiffness, body.centre_of_mass),
            "its options": (float(body.total_mass), float(body.f_cut)),
            "position": np.asarray(item.position, dtype=float),
            "rotation": np.asarray(item.kinematics.rotation, dtype=float),
            "geometric stiffness": body.stiffening,
            "damping": None if item.damping is None else item.damping.force(np.cos(np.arange(body.n_dofs))),
            "weight": item.weight,
            "plastic states": {str(patch): vars(state) for patch, state in item.plastic_states.items()},
        }
        sensors = [*map(int, item["sCoordinates"]), *map(int, item["sCoordinates_t"])]
        marks.append(ItemMark.of_item(f"body {item.name!r}, {item.frame} frame, sensors {sensors}", content))
    for contact in contacts:
        of = [(item.name, patch) for item, patch in contact.sides]
        rigid = None if isinstance(contact.master, PartitionBody) else contact.master
        master = "" if rigid is None else f" with a {type(rigid).__name__}"
        master += "" if contact.carrier is None else f" on the body with number {int(contact.carrier.body)}"
        law = type(contact.mechanics.law).__name__
        options = {name: value for name, value in vars(contact.formulation).items() if isinstance(value, _PLAIN)}
        content = {
            "friction": contact.friction.coulomb,
            "surface": rigid,
            "interference": float(contact.mechanics.gaps.placement.overlap),
            "formulation": (type(contact.formulation).__name__, options),
            "point of the moment": contact.moment_about,
            "areas": np.array(contact.mechanics.node_areas),
        }
        said = f"contact {contact.name!r} of {of}{master}, {law}, {contact.rows} rows, sensor {int(contact['sForce'])}"
        marks.append(ItemMark.of_item(said, content))
    return tuple(marks)


def check_items(stored: Sequence[ItemMark], present: Sequence[ItemMark]) -> None:
    """Raise an error if a model is not the one of a stored run.

    Raises
    ------
    InputError
        The message has the first item that differs, and the difference.
    """
    for i in range(max(len(stored), len(present))):
        if i < len(stored) and i < len(present):
            differs = stored[i].difference(present[i])
        else:
            was, is_now = (items[i].said if i < len(items) else "nothing" for items in (stored, present))
            differs = f"{was}; this one has {is_now}"
        if differs:
            raise InputError(
                f"mbs: expected the model that was run, built by the same calls in the same order, with {differs}"
            )
