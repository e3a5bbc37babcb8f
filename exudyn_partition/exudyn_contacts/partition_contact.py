"""A contact of partition bodies in an Exudyn model: its indices and sensors, and the list of what a model holds."""

from __future__ import annotations

from collections.abc import Sequence

from ..contact.formulations.formulation import Formulation, Law
from ..contact.rigid import RigidSurface
from ..errors import InputError
from ..exudyn_bodies.carriers import Carrier
from ..exudyn_bodies.model import registered
from ..exudyn_bodies.partition_body import PartitionBody
from ..support.arrays import Vector
from ..support.checks import validate_vector
from ..support.foreign import MainSystem, NodeIndex, SensorIndex
from ..support.optional import require
from .contact_results import ContactResults
from .model_run import runs_of


class PartitionContact(ContactResults):
    """What `CreatePartitionContact` returns: Exudyn indices by name, and the contact's results.

    Keys: `oContact`, the force element; `sForce`, a sensor of the total normal force [N], the number of closed rows,
    the force on the slave [N] and the smallest gap [m]; of multipliers also the impulses so far in an explicit run,
    total and on the slave [N s]. `sFriction` with friction: the tangential force on the slave in space [N], the number
    of rows that stick, of those that slip, the energy that friction has taken and what the contact stores [J].
    `sPlastic` with plastic zones: what the contact stores and the plastic work [J], the largest equivalent plastic
    strain, and the number of points that flow. `sMoment` after `AddMomentSensor`: the moment on the slave [N m].

    `slave` and `master` are the bodies as the rows have them: with passes="finer" they may have changed places.
    """

    def __init__(
        self,
        name: str,
        sides: Sequence[tuple[PartitionBody, int]],
        rigid: RigidSurface | None,
        formulation: Formulation,
        law: Law,
        carrier: Carrier | None,
    ) -> None:
        super().__init__()
        self.name, self.sides = name, tuple(sides)
        self.slave = sides[0][0]
        self.master = rigid if rigid is not None else sides[1][0]
        self.formulation, self.law, self.carrier = formulation, law, carrier
        self.group, self.together = [self], None
        self.moment_about = None

    @property
    def nodes(self) -> list[NodeIndex]:
        """Exudyn nodes of slave and master."""
        return [node for item, _ in self.sides for node in item.nodes]

    def AddMomentSensor(self, mbs: MainSystem, point: Vector = (0.0, 0.0, 0.0)) -> SensorIndex:
        """Add a sensor of the moment on the slave about a point in space, (3,) [m]; returns its number, also `sMoment`.

        Extra, for it costs the places of the patch's nodes in every sample.

        Raises
        ------
        InputError
            If the point is no vector of three numbers, or the contact is of another model.
        """
        place = validate_vector("point", point)
        if not any(contact is self for contact in registered(mbs).contacts.values()):
            raise InputError(f"mbs: contact {self.name!r} belongs to another model, or to this one before a Reset")
        runs = runs_of(mbs)

        def moment(mbs: MainSystem, t: float, *unused: object) -> list[float]:
            return [*map(float, runs.now(mbs).of(self).law.moment(place))]

        items = require("exudyn.itemInterface")
        self["sMoment"] = mbs.AddSensor(items.SensorUserFunction(sensorUserFunction=moment, storeInternal=True))
        self.moment_about = place
        return self["sMoment"]


def partition_items(mbs: MainSystem) -> tuple[list[PartitionBody], list[PartitionContact]]:
    """Partition bodies and contacts that a model holds; those from before an `mbs.Reset()` are forgotten."""
    held = registered(mbs)
    return [*held.bodies.values()], [*held.contacts.values()]
