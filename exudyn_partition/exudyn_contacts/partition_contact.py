"""A contact of partition bodies in an Exudyn model: its indices, sensors and impacts; and what a model holds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..contact.formulations.formulation import Formulation, Law
from ..contact.rigid import RigidSurface
from ..errors import InputError
from ..exudyn_bodies.carriers import Carrier
from ..exudyn_bodies.model import registered
from ..exudyn_bodies.partition_body import PartitionBody
from ..results.impacts import Ringing, SubImpact, at_border, closed_spans, crossing, joined, ringing, running_mean
from ..support.arrays import Array, Vector
from ..support.checks import validate_number, validate_positive, validate_vector
from ..support.foreign import MainSystem, NodeIndex, SensorIndex
from ..support.optional import require
from .contact_results import ContactResults
from .friction_results import RunSamples
from .model_run import runs_of


class PartitionContact(ContactResults):
    """What `CreatePartitionContact` returns: Exudyn indices by name, and the contact's results.

    Keys: `oContact`, the force element; `oCommon`, where contacts are coupled, the element that applies the forces of
    all of them in runs by `solve_dynamic` and `solve_static`; `sForce`, a sensor of the total normal force [N], the
    number of closed rows, the force on the slave [N] and the smallest gap of the rows [m], without the contact's own
    flexibility, so that it is negative in contact, or zero of multipliers; of multipliers also the impulses so far
    in an explicit run, total and on the slave [N s]. `sFriction` with friction: the tangential force on the slave in
    space [N], the number of rows that stick, of those that slip, the energy that friction has taken and what the
    contact stores [J]. `sPlastic` with plastic zones: what the contact stores and the plastic work [J], the largest
    equivalent plastic strain, and the number of points that flow. `sMoment` after `AddMomentSensor`: the moment on the
    slave [N m]. `nGenericData`, of all contacts but the first: the node whose data `sForce` reads.

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
        self.group, self.together, self.linked = [self], None, []
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

    def impacts(self, result: RunSamples, *, merge: float = 0.0) -> list[SubImpact]:
        """Times of contact, with impulse, peak and mean of the force, and relative speeds before and after.

        Contact starts and ends when the first point of the surface closes and the last one opens, between samples by
        linear interpolation; the surface of a body that yields has its dent. Mean gaps of integrated rows, which make
        the force, close later. Where the surface is not known, contact lasts from the last sample without a force
        before it to the first one after it: with multipliers, and where a body of another kind carries the rigid
        surface.

        A speed is that of rigid bodies with the momenta and angular momenta of the bodies, at the centre of the contact
        force when it is largest, along the contact's normal, the direction of the impulse of the normal forces.
        Vibration and distance from the centre of mass are so treated alike in both frames. `speed_before` is that at
        `start`, positive if they approach, `speed_after` that at `end`, positive if they separate; their ratio is
        Newton's coefficient of restitution, with friction too. What friction takes from the sliding is not in it: see
        `dissipated_energy` and the momenta of the bodies. A speed is None if the run begins or ends in this contact, or
        if a body touches itself or one of another kind carries the rigid surface.

        Parameters
        ----------
        result : Result
        merge : float
            Times of contact with at most this time between them are one impact [s]: flat faces open and close several
            times in a bounce. Default: 0, each by itself.

        Raises
        ------
        InputError
            If the result is none, of another model, or static; if `merge` is negative.
        """
        merge = validate_number("merge", merge, "a time in s, zero or above")
        if merge < 0:
            raise InputError(f"merge: expected a time in s, zero or above, got {merge!r}")
        force, t = self.force(result), result.t
        if result.method == "static":
            raise InputError("result: expected one of dynamics; a static answer has no impacts")
        spans, gap, times = closed_spans(force), self._gap_of_surface(result) if self.compliant else None, []
        for k, (first, last) in enumerate(spans):
            start = crossing(t, gap, first, spans[k - 1][1] if k else -1)
            times.append((start, crossing(t, gap, last, spans[k + 1][0] if k + 1 < len(spans) else len(t))))
        found = []
        for group in joined(times, merge):
            first, last = spans[group[0]][0], spans[group[-1]][1]
            around = slice(max(first - 1, 0), min(last + 2, len(t)))
            impulse, peak = float(np.trapezoid(force[around], t[around])), float(force[around].max())
            start, end = times[group[0]][0], times[group[-1]][1]
            speeds = self._speeds(result, force, (first, last), (start, end))
            found.append(SubImpact(start, end, impulse, peak, len(group), *speeds))
        return found

    def _speeds(
        self, result: RunSamples, force: Array, span: tuple[int, int], times: tuple[float, float]
    ) -> tuple[float | None, float | None]:
        """Approach at the start and separation at the end of a contact [m/s], see `impacts`.

        `force`, (n,) [N], is that of all samples, `span` the first and last sample of the contact, `times` its start
        and end [s].
        """
        t, (first, last) = result.t, span
        around = slice(max(first - 1, 0), last + 2)
        impulse = np.trapezoid(self._normal_force(result)[around], t[around], axis=0)
        if self.law.gaps.carried or self.slave is self.master or not (size := np.linalg.norm(impulse)):
            return None, None
        normal = impulse / size
        peak = first + int(force[first : last + 1].argmax())
        if (centre := self._force_centre(result, t[first : last + 1], peak, normal)) is None:
            return None, None

        def separation(sample: int) -> float:
            now, speeds = result.at(t[sample : sample + 1]), []
            for item, _ in self.sides:
                q, q_t = item.coordinates(now)[0], item.coordinates_t(now)[0]
                speeds.append(float(item.kinematics.mean_velocity(q, q_t, centre) @ normal))
            return speeds[0] - sum(speeds[1:])

        before = -at_border(t, force == 0, separation, times[0], -1) if first > 0 else None
        return before, at_border(t, force == 0, separation, times[1], 1) if last < len(t) - 1 else None

    def _normal_force(self, result: RunSamples) -> Array:
        """Resultant of the normal forces on the slave, (n, 3) [N]."""
        whole = self.force_on_slave(result)
        return whole if self.friction is None else whole - self.tangential_force(result)

    def _force_centre(self, result: RunSamples, times: Array, sample: int, along: Array) -> Array | None:
        """Centre of the contact force in space at a sample, (3,) [m]; None if forces of rows are not known.

        Multipliers come and go from step to step: theirs is the mean over the times of the contact.
        """
        now, item = result.at(result.t[sample : sample + 1]), self.slave
        nodes = self.law.gaps.slave.surface.nodes
        try:
            if self.elastic or self.friction is not None or self.yielding is not None:
                weights = self.nodal_forces(now)[0][0] @ along
            else:
                weights = np.asarray(self._row_forces(result, times).sum(axis=0))[0, : len(nodes)]
        except InputError:  # of a file
            return None
        places = item.kinematics.at(nodes).place(item.coordinates(now)[0])
        return np.asarray(weights @ places / weights.sum()) if weights.any() else None

    def ringing(self, result: RunSamples) -> Ringing | None:
        """How the force rings: the impact where it does most, period and means; None where it does not.

        It is measured from the history of the force, see `results.impacts.ringing`. None of statics, of multipliers,
        and where fewer than four samples stand in a period of `f_cut`.

        Raises
        ------
        InputError
            If the result is none, or of another model.
        """
        force = self.force(result)
        if not self.compliant or result.method == "static":
            return None
        return ringing(result.t, force, 1 / min(item.body.f_cut for item, _ in self.sides))

    def mean_force(self, result: RunSamples, window: float | None = None) -> Array:
        """Mean of the force over a window around each time, (n,) [N]; where the force rings, its means hold.

        Parameters
        ----------
        result : Result
        window : float, optional
            [s]. Default: two periods of the ringing, see `ringing`; if the force does not ring, the force itself.

        Raises
        ------
        InputError
            If the result is none, or of another model; if the window is not above zero.
        """
        force = self.force(result)
        if window is not None:
            window = validate_positive("window", window, "s")
        elif (rings := self.ringing(result)) is not None:
            window = rings.window
        return force if window is None else running_mean(result.t, force, window)

    def closed_samples(self, result: RunSamples) -> list[tuple[int, int]]:
        """First and last sample with a force, of each time of uninterrupted contact."""
        return closed_spans(self.force(result))


def partition_items(mbs: MainSystem) -> tuple[list[PartitionBody], list[PartitionContact]]:
    """Partition bodies and contacts that a model holds; those from before an `mbs.Reset()` are forgotten."""
    held = registered(mbs)
    return [*held.bodies.values()], [*held.contacts.values()]
