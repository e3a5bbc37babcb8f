"""A contact of partition bodies in an Exudyn model: its items, and its results of a run."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..contact.formulations.formulation import Together
from ..errors import InputError
from ..exudyn_bodies.model import coordinate_slices, registered
from ..exudyn_bodies.partition_body import PartitionBody
from ..fe.material import Material
from ..prediction.contact_ellipse import semi_axes
from ..prediction.yielding import Stress
from ..results.impacts import (
    Ringing,
    SubImpact,
    at_border,
    closed_spans,
    crossing,
    joined,
    ringing,
    running_mean,
)
from ..support.arrays import Array, Vector
from ..support.checks import validate_number, validate_positive, validate_result, validate_vector
from ..support.foreign import MainSystem, NodeIndex, SensorIndex
from ..support.items import Item
from ..support.optional import require
from ..surfaces.facing import PENETRATION_TOLERANCE
from .contact_group import ContactGroup
from .contact_plan import ContactPlan
from .contact_replay import force_centres, nodal_forces, stored_energy, viscous_work
from .contact_samples import RunSamples, growing_at, mean_forces
from .friction_results import FrictionResults
from .model_run import runs_of
from .plastic_results import PlasticResults, dent_motion
from .row_samples import RowSamples

_LARGE = 0.8  # share of the largest force above which stresses are computed
_AT_ONCE = 1_000_000  # rows of samples that are looked at together
_WHOLE = 0.9  # share of a patch's area: a larger contact is no Hertz contact


class PartitionContact(Item[Any]):
    """A contact that `CreatePartitionContact` made: its Exudyn indices by name, and its results.

    Its keys are items of the Exudyn model:

    - `oContact`: the object that holds the forces and the stiffness of all contacts of the model, the same for all.
    - `sForce`: sensor of the total normal force [N], the number of closed rows, the force on the slave [N] and the
      smallest gap of the rows [m]. The gap does not include the contact's own flexibility: in contact it is negative.
      With multipliers it is zero. Multipliers add their impulses so far, total and on the slave [N s].
    - `sFriction`, with friction: the tangential force on the slave in space [N], the numbers of rows that stick and
      that slip, the energy that friction has taken and the energy that the contact stores [J]. Multipliers add the
      tangential impulse so far [N s].
    - `sPlastic`, with plastic zones: the energy that the contact stores and the plastic work [J], the largest
      equivalent plastic strain, and the number of points that flow.
    - `sMoment`, after `AddMomentSensor`: the moment on the slave [N m].
    - `nGenericData`, for all contacts except the first: the node whose data `sForce` reads.
    - `nFrictionData`, for contacts of skins in a list of bodies: the node whose data `sFriction` reads.

    Results of friction and of plastic zones are in views: `contact.friction.work(result)`,
    `contact.plastic.dents(result)`. The state in a run is in `contact_run.ContactRun`.

    Attributes
    ----------
    name : str
    slave, master : PartitionBody or rigid surface
        With passes="finer" they may have changed places.
    sides : tuple of (PartitionBody, int)
        Slave, and master if that is a partition body too, each with the number of its patch.
    rows : {"integrated", "node-to-segment", "edges"}
    formulation : Formulation
    mechanics : PatchContact
        State at the start; each run has its own.
    carrier : Carrier or None
        The body of another kind that carries the rigid surface.
    joined : ContactGroup
        Contacts that are solved together in every run.
    moment_about : (3,) array or None
        Point of the moment sensor [m].
    """

    _inside = frozenset(
        {"beside", "carrier", "compliant", "elastic", "elastic_materials", "group", "mechanics", "moment_about",
         "joined", "nodes", "side_names", "slave_facet_size", "slices", "together"}
    )  # fmt: skip
    joined: ContactGroup
    moment_about: Array | None

    def __init__(self, plan: ContactPlan) -> None:
        super().__init__()
        self.name, self.sides = plan.name, plan.sides
        self.slave = plan.sides[0][0]
        self.master = plan.sides[1][0] if plan.rigid is None else plan.rigid
        self.rows = plan.rows
        self.formulation, self.mechanics, self.carrier = plan.formulation, plan.mechanics, plan.carrier
        self.joined = ContactGroup(self)
        self.moment_about = None

    @property
    def group(self) -> list[PartitionContact]:
        """Contacts that are solved together in every run, the same list for all of them."""
        return self.joined.members

    @property
    def together(self) -> Together:
        """Finds the forces of this group; each run has its own."""
        return self.joined.together

    @property
    def beside(self) -> PartitionContact | None:
        """The contact of the same patches with rows="edges", or that beside which these are; None if there is none."""
        contacts = (
            contact for contact in self.group if contact.sides == self.sides[::-1] and contact.rows != self.rows
        )
        return next(contacts, None) if len(self.sides) > 1 else None

    @property
    def nodes(self) -> list[NodeIndex]:
        """Exudyn nodes of slave and master."""
        return [node for item, _ in self.sides for node in item.nodes]

    def AddMomentSensor(self, mbs: MainSystem, point: Vector = (0.0, 0.0, 0.0)) -> SensorIndex:
        """Add a sensor of the moment on the slave about a point in space, (3,) [m]; returns its number, also `sMoment`.

        Contacts do not have it by default, because every sample computes the places of the patch's nodes. Add it before
        the run: results of earlier runs have no moments.

        Raises
        ------
        InputError
            If the point is no vector of three numbers, or the contact is of another model.
        """
        place = validate_vector("point", point)
        if self not in registered(mbs).contacts.values():
            raise InputError(f"mbs: contact {self.name!r} belongs to another model, or to this one before a Reset")
        runs = runs_of(mbs)

        def moment(mbs: MainSystem, t: float, *unused: object) -> list[float]:
            return [*map(float, runs.now(mbs).contact_run(self).evaluation.moment(place))]

        items = require("exudyn.itemInterface")
        self["sMoment"] = mbs.AddSensor(items.SensorUserFunction(sensorUserFunction=moment, storeInternal=True))
        self.moment_about = place
        return self["sMoment"]

    @property
    def friction(self) -> FrictionResults:
        """Results of friction in a run; false without friction."""
        return FrictionResults(self)

    @property
    def plastic(self) -> PlasticResults:
        """Results of the plastic zones beneath the patches in a run; false without zones."""
        return PlasticResults(self)

    def slices(self, mbs: MainSystem) -> list[slice]:
        """Places of the coordinates of slave and master among the model's."""
        return [s for item, _ in self.sides for s in coordinate_slices(mbs, item)]

    @property
    def elastic(self) -> bool:
        """Whether the coordinates alone determine the forces, so that they can be computed again at each sample."""
        return self.mechanics.elastic

    @property
    def compliant(self) -> bool:
        """Whether the contact has a flexibility or layer of its own that yields at closed rows."""
        return self.mechanics.compliant

    @property
    def n_rows(self) -> int:
        """Number of rows that the contact starts with."""
        gaps = self.mechanics.gaps
        return len(gaps.row_nodes) if not gaps.moving else len(gaps.all_points.row_nodes)

    @property
    def slave_facet_size(self) -> float:
        """Mean edge length of the slave's facets [m]."""
        return float(self.mechanics.gaps.slave.surface.facet_size)

    def force(self, result: RunSamples) -> Array:
        """Sum of the normal forces, (n,) [N], at the times of `result`; below zero only if a law pulls."""
        return mean_forces(self, result, "sForce", slice(0, 1), slice(6, 7))[:, 0]

    def force_on_slave(self, result: RunSamples) -> Array:
        """Resultant force on the slave, (n, 3) [N]; the force on the master is its opposite.

        Normals of curved patches have different directions, so that its size may be less than `force`.
        """
        return mean_forces(self, result, "sForce", slice(2, 5), slice(7, 10))

    def moment_on_slave(self, result: RunSamples) -> Array:
        """Moment on the slave about the point of `AddMomentSensor`, (n, 3) [N m].

        Raises
        ------
        InputError
            If there was no such sensor in the run.
        """
        if "sMoment" not in self:
            raise InputError(
                "contact: it has no moment sensor; call AddMomentSensor(mbs) before mbs.Assemble(). Without another "
                "run, nodal_forces(result) has the forces whose moment it is, if they are no multipliers"
            )
        validate_result(result)
        return result.sensor_of(self, self["sMoment"])

    def closed_rows(self, result: RunSamples) -> Array:
        """Number of closed contact rows, (n,); those within the reach of a law that pulls count.

        Raises
        ------
        InputError
            If `result` is no result, or is of another model.
        """
        validate_result(result)
        return result.sensor_of(self, self["sForce"])[:, 1].astype(int)

    def gap(self, result: RunSamples) -> Array:
        """Smallest gap of the surfaces, (n,) [m]; negative if they lie within each other.

        It is the gap of the lowest point. Coordinates and dents move the surfaces; the contact's own flexibility or
        layer does not. So in contact the gap is minus the depth to which the surfaces are pressed. Multipliers hold
        gaps at zero, up to the tolerance of meshes. The gap is infinite if no point faces the master.

        It is the smallest gap of the rows, from the sensor `sForce`, if no point faces the master or the surfaces are
        not known after the run. They are not known if another body carries the rigid surface, or if the result was read
        without its model. Integrated rows have mean gaps around nodes. A convex tip closes the first row later than its
        lowest point touches, by the order of a facet's size squared over the radius.

        Raises
        ------
        InputError
            If `result` is no result, or is of another model.
        """
        validate_result(result)
        gap = result.sensor_of(self, self["sForce"])[:, 5].copy()
        if (surface := self._gap_of_surface(result)) is None:
            return gap
        of_surface = np.array([surface(sample) for sample in range(len(gap))])
        is_known = np.isfinite(of_surface)
        if not self.compliant:  # in contact it is zero, up to the tolerance
            is_known &= (gap != 0.0) | (of_surface < -PENETRATION_TOLERANCE * self.mechanics.gaps.size)
        return np.where(is_known, of_surface, gap)

    def depth(self, result: RunSamples) -> float:
        """Largest depth to which the surfaces lie within each other in the run [m]; zero if they do not. See `gap`.

        Raises
        ------
        InputError
            If `result` is no result, or is of another model.
        """
        return float(max(-self.gap(result).min(initial=0.0), 0.0))

    def _gap_of_surface(self, result: RunSamples) -> Callable[[int], float] | None:
        """Return a function of the sample: gap of the surface's lowest point [m]; None if it is not known."""
        gaps = self.mechanics.gaps.for_run()
        if gaps.carried or (gaps.placement.pressed and result.method == "static"):  # load steps move the surfaces apart
            return None
        try:
            dents = dent_motion(self, result)
        except InputError:  # a result from a file, or one with too many states of the zones to keep
            return None
        q, growing = np.hstack([item.coordinates(result) for item, _ in self.sides]), growing_at(self.sides, result)

        def gap(sample: int) -> float:
            gaps.grow(growing(sample))
            return gaps.surface_gap(q[sample], dents(sample))

        return functools.cache(gap)

    def row_forces(self, result: RunSamples) -> sp.csr_matrix:
        """Force of the row of each of the slave's patch nodes, (n, np) [N], in the order of the patch's nodes.

        Raises
        ------
        InputError
            If `result` is no result, is of another model, or nothing was kept of its run.
        """
        validate_result(result)
        return self._row_forces(result, result.t)

    def _row_forces(self, result: RunSamples, times: Array) -> sp.csr_matrix:
        """See `row_forces`, here at some times of the result, (k,) [s]."""
        return RowSamples(result.kept(self), times).matrix()

    def pressure(self, result: RunSamples) -> sp.csr_matrix:
        """Contact pressure around the slave's patch nodes, (n, np) [Pa], columns as those of `row_forces`.

        It is a mean over hat functions. With integrated rows each node has one. With node-to-segment rows only corners
        of facets have one, and columns of mid-side nodes are empty. With formulation "hertz" it is Hertz's largest
        pressure, at the node that was nearest to the contact at the start.
        """
        if (axes := self.mechanics.law.semi_axes(1.0)) is not None:
            pressure = self.row_forces(result)
            pressure.data = 1.5 / (np.pi * math.prod(axes)) * np.cbrt(pressure.data)
            return pressure
        return sp.csr_matrix(self.row_forces(result) @ self.mechanics.node_pressures.T)

    def area(self, result: RunSamples) -> Array:
        """Contact area, the sum of the areas of rows that press, (n,) [m2].

        Rows that pull do not count, unlike in `closed_rows`. Rows that lie partly outside of the contact may be open.
        So part of the rim is missing if the pressure does not fall to zero there, as in plastic flow. With formulation
        "hertz" it is the area of Hertz's ellipse.
        """
        if (axes := self.mechanics.law.semi_axes(1.0)) is not None:
            return np.pi * math.prod(axes) * self.force(result) ** (2 / 3)
        closed = self.row_forces(result)
        closed.data[:] = closed.data > 0
        value: Array = closed @ self.mechanics.node_areas
        return value

    def radius(self, result: RunSamples) -> Array:
        """Radius of a circle of the contact area, (n,) [m]."""
        return np.sqrt(self.area(result) / np.pi)

    @property
    def side_names(self) -> tuple[str, ...]:
        """Names of slave and master for use in sentences."""
        roles = zip(self.sides, ("the slave", "the master"), strict=False)
        return tuple(f"body {item.name!r}" if item.name else role for (item, _), role in roles)

    def largest_stress(self, result: RunSamples) -> Stress | None:
        """Largest Hertz-equivalent pressure of the run, and the von Mises stress beneath it; None if nothing touched.

        The equivalent Hertz contact has the same force, and the same second moments of the pressure on the rows
        (`contact_ellipse`). Only samples with a force above 0.8 of its largest value count. A contact that closes a
        whole patch is no Hertz contact. There the mean pressure counts as the stress in a bar, if it is larger.
        Friction, other loads of the bodies, and stress at the edges of flat patches are not included. Bodies whose
        patch yields plastically are not judged. With formulation "hertz" it is Hertz's contact under the largest force.

        Raises
        ------
        InputError
            If `result` is no result, is of another model, or nothing was kept of its run.
        """
        return largest_stresses([(self, self.force(result), RowSamples(result.kept(self), result.t))])[0]

    @property
    def elastic_materials(self) -> list[Material | None]:
        """Materials of the sides; without a yield stress where the patch yields itself."""
        materials = []
        for (item, patch), side in zip(self.sides, self.mechanics.gaps.sides, strict=False):
            material = item.body.partition.patches[patch].material or item.body.material
            if side.zone is not None and material is not None:
                material = replace(material, yield_stress=None, hardening=None, kinematic_hardening=0.0)
            materials.append(material)
        return materials

    def edge_reached(self, result: RunSamples) -> tuple[float, Array] | None:
        """Time [s] and place, (3,) [m], at which the contact first reached the edge of its patch; None if it did not.

        Raises
        ------
        InputError
            If `result` is no result, is of another model, or nothing was kept of its run.
        """
        validate_result(result)
        return result.kept(self).edge

    def energy(self, result: RunSamples) -> Array:
        """Energy stored in the contact's own flexibility, (n,) [J]; multipliers store none.

        The run kept it. If it did not, elastic contacts are evaluated again at the coordinates of the samples, in
        their order.

        Raises
        ------
        InputError
            If `result` is no result or is of another model, or comes from a file and another body carries the surface.
        """
        validate_result(result)
        if self.friction:
            return result.sensor_of(self, self["sFriction"])[:, 6]
        if self.plastic:
            return result.sensor_of(self, self["sPlastic"])[:, 0]
        known = self.elastic or self.mechanics.damped
        return stored_energy(self, result) if known else np.zeros(len(result.t))

    def dissipated_energy(self, result: RunSamples) -> Array:
        """Energy that friction, plastic flow and damping of the contact itself have taken so far, (n,) [J].

        It counts from the start of the run. The damping of the bodies' modes is in `PartitionBody.dissipated_energy`.

        Raises
        ------
        InputError
            If `result` is no result, or is of another model.
        """
        return self.friction.work(result) + self.plastic.work(result) + viscous_work(self, result)

    def nodal_forces(self, result: RunSamples) -> list[Array]:
        """Forces on the nodes of each side's patch, (n, np, 3) in space [N], in the order of `sides`.

        The contact is evaluated again at the stored coordinates, in their order. The forces are those that the run kept
        if there is friction or a plastic zone, or if a body of another kind carries the rigid surface.

        Raises
        ------
        InputError
            If the forces are multipliers.
        """
        return nodal_forces(self, result)

    @property
    def _flexible_sides(self) -> list[tuple[PartitionBody, int]]:
        """Those of `sides` whose bodies have a residual flexibility."""
        return [side for side in self.sides if side[0].body.basis.flexibility is not None]

    @property
    def undamped(self) -> bool:
        """Whether the contact yields without the stiffness-proportional damping that its bodies have."""
        delayed = any(item.beta for item, _ in self._flexible_sides)
        return delayed and self.compliant and not self.mechanics.viscous

    @property
    def left_out(self) -> list[str]:
        """Sentences on the effects that the contact leaves out."""
        unpaired = self.mechanics.gaps.stage.rows.unpaired
        said = [] if self.friction else ["tangential rows: the contact is frictionless"]
        said += self.mechanics.law.left_out
        if self.undamped:
            said.append("damping of the contact's layer, in which bodies with a residual flexibility yield")
        elif any(item.damping is not None and not item.beta for item, _ in self._flexible_sides):
            said.append(
                "damping of the contact's flexibility, what the modes lack of the static answer: only damping in "
                "proportion to the stiffness has a time for it (beta of ep.Rayleigh)"
            )
        if self.plastic:
            said.append("plastic flow outside the plastic zones, and the change of gaps' normals by dents")
            if self.mechanics.viscous:
                said.append("damping of what plastic strain moves: dents follow at once, and flow sees the whole force")
            said.append(
                "plastic strain in stresses and static answers that `recovery` and `output` compute: these are elastic"
            )
        if not self.mechanics.gaps.placement.faced:
            said.append("pairs at the start: the patches do not face each other yet, pairs are found when they do")
        elif unpaired and not any(side.surface.wanders for side in self.mechanics.gaps.sides):
            slave = self.slave.name or "the slave"
            said.append(f"{unpaired} contact points of {slave} that face no facet of the master patch")
        return said

    def impacts(self, result: RunSamples, *, merge: float = 0.0) -> list[SubImpact]:
        """Times of contact, with impulse, peak and mean of the force, and relative speeds before and after.

        Contact starts when the first point of the surface closes, and ends when the last one opens. Between samples
        these times are interpolated linearly. The surface of a body that yields includes its dent. Mean gaps of
        integrated rows, which determine the force, close later. With multipliers, or if a body of another kind carries
        the rigid surface, the surface is not known. Then contact lasts from the last sample without a force before it
        to the first one after it.

        Speeds are those of rigid bodies with the momenta and angular momenta of the bodies. They hold at the centre of
        the contact force, along the contact's normal: the direction of the impulse of the normal forces. So vibration
        and distance from the centre of mass count alike in both frames. Where bodies slide or roll, the centre goes
        with the contact: its places at start and end are those of a steady motion through its places between.

        `speed_before` is the speed at `start`, positive if the bodies approach. `speed_after` is the speed at `end`,
        positive if they separate. Their ratio is Newton's coefficient of restitution, with friction too. It does not
        include the energy that friction takes from sliding: see `dissipated_energy` and the momenta of the bodies. A
        body of another kind that carries the rigid surface has the speed of its own point there, from two of the places
        that the run kept of it. A speed is None if the run begins or ends in this contact, if a body touches itself, or
        if no such places are known.

        Parameters
        ----------
        result : Result
        merge : float
            Times of contact that are at most this long apart count as one impact [s]: flat faces open and close several
            times in a bounce. Default: 0, each counts alone.

        Raises
        ------
        InputError
            If `result` is no result, is of another model or static; if `merge` is negative.
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
        sub_impacts = []
        for group in joined(times, merge):
            first, last = spans[group[0]][0], spans[group[-1]][1]
            around = slice(max(first - 1, 0), min(last + 2, len(t)))
            impulse, peak = float(np.trapezoid(force[around], t[around])), float(force[around].max())
            start, end = times[group[0]][0], times[group[-1]][1]
            speeds = self._speeds(result, force, (first, last), (start, end))
            sub_impacts.append(SubImpact(start, end, impulse, peak, len(group), *speeds))
        return sub_impacts

    def _speeds(
        self, result: RunSamples, force: Array, span: tuple[int, int], times: tuple[float, float]
    ) -> tuple[float | None, float | None]:
        """Approach at the start and separation at the end of a contact [m/s], see `impacts`.

        `force`, (n,) [N], has all samples. `span` is the first and last sample of the contact, `times` its start and
        end [s].
        """
        t, (first, last) = result.t, span
        around = slice(max(first - 1, 0), last + 2)
        impulse = np.trapezoid(self._normal_force(result)[around], t[around], axis=0)
        if self.slave == self.master or not (size := np.linalg.norm(impulse)):
            return None, None
        normal = impulse / size
        peak = first + int(force[first : last + 1].argmax())
        if (centres := force_centres(self, result, force, (first, peak, last), times, normal)) is None:
            return None, None

        def separation(centre: Array, sample: int) -> float:
            now, speeds = result.at(t[sample : sample + 1]), []
            for item, _ in self.sides:
                q, q_t = item.coordinates(now)[0], item.coordinates_t(now)[0]
                speeds.append(float(item.kinematics.mean_velocity(q, q_t, centre) @ normal))
            return speeds[0] - sum(speeds[1:])

        at_start, at_end = (functools.partial(separation, centre) for centre in centres)
        before = at_border(t, force == 0, at_start, times[0], -1) if first > 0 else None
        after = at_border(t, force == 0, at_end, times[1], 1) if last < len(t) - 1 else None
        carrier_before, carrier_after = self._carrier_speeds(result, force, span, centres, normal)
        approach = None if before is None or carrier_before is None else carrier_before - before
        return approach, None if after is None or carrier_after is None else after - carrier_after

    def _carrier_speeds(
        self, result: RunSamples, force: Array, span: tuple[int, int], centres: Array, normal: Array
    ) -> tuple[float | None, float | None]:
        """Speeds along `normal` of the rigid surface's points at `centres`, (2, 3), before and after a contact [m/s].

        They are zero if nothing carries it, and None where the run kept fewer than two places of the carrier between
        this contact and the next one.
        """
        if self.carrier is None:
            return 0.0, 0.0
        number, t = int(self.carrier.body), result.t
        body = next((candidate for candidate in result.others if candidate.number == number), None)
        if body is None:
            return None, None
        closed = np.flatnonzero(force)
        earlier, later = closed[closed < span[0]], closed[closed > span[1]]
        begin = t[earlier[-1] + 1] if earlier.size else -np.inf
        end = t[later[0] - 1] if later.size else np.inf
        before = body.velocity_within(begin, t[span[0] - 1], centres[0], late=True) if span[0] else None
        after = body.velocity_within(t[min(span[1] + 1, len(t) - 1)], end, centres[1], late=False)
        return None if before is None else float(before @ normal), None if after is None else float(after @ normal)

    def _normal_force(self, result: RunSamples) -> Array:
        """Resultant of the normal forces on the slave, (n, 3) [N]."""
        whole = self.force_on_slave(result)
        return whole - self.friction.tangential_force(result) if self.friction else whole

    def ringing(self, result: RunSamples) -> Ringing | None:
        """Ringing of the force: the impact in which it is strongest, its period and means; None if there is none.

        It is measured in the history of the force, see `results.impacts.ringing`. It is None for statics, for
        multipliers of explicit steps, which jump from step to step, and if a period of `f_cut` has fewer than four
        samples.

        Raises
        ------
        InputError
            If `result` is no result, or is of another model.
        """
        force = self.force(result)
        if result.method == "static" or not (self.compliant or result.method == "implicit"):
            return None
        return ringing(result.t, force, 1 / min(item.body.f_cut for item, _ in self.sides))

    def mean_force(self, result: RunSamples, window: float | None = None) -> Array:
        """Mean of the force over a window around each time, (n,) [N]. If the force rings, only its means are right.

        Parameters
        ----------
        result : Result
        window : float, optional
            Length of the window [s]. Default: two periods of the ringing, see `ringing`. If the force does not ring,
            the result is the force itself.

        Raises
        ------
        InputError
            If `result` is no result, or is of another model; if the window is not above zero.
        """
        force = self.force(result)
        if window is not None:
            window = validate_positive("window", window, "s")
        elif (rings := self.ringing(result)) is not None:
            window = rings.window
        return force if window is None else running_mean(result.t, force, window)

    def closed_samples(self, result: RunSamples) -> list[tuple[int, int]]:
        """First and last sample with a force, for each time of uninterrupted contact."""
        return closed_spans(self.force(result))


@dataclass(frozen=True, eq=False)
class _Pressed:
    """Rows of a contact that are pressed in samples with a large force.

    Parameters
    ----------
    contact : PartitionContact
    force : (n,) array
        Sums of the normal forces at all samples [N].
    rows : RowSamples
    samples : (m,) int array
        These samples.
    starts : (m,) int array
        Where the rows of each begin in `nodes` and `forces`.
    nodes, forces : (k,) arrays
        Patch nodes of the rows, and the forces on them [N].
    """

    contact: PartitionContact
    force: Array
    rows: RowSamples
    samples: Array
    starts: Array
    nodes: Array
    forces: Array

    @classmethod
    def of(cls, contact: PartitionContact, force: Array, rows: RowSamples) -> _Pressed | None:
        """Find the pressed rows; None where no row has an area, so that stress has no limit."""
        n, large = len(contact.mechanics.gaps.slave.surface.points), force >= _LARGE * force.max(initial=0.0)
        large = np.flatnonzero(large & (force > 0))
        nodes, forces, bounds = rows.joined(large)
        pushes = (forces > 0) & (nodes < n)  # no pull is a pressure, and rows of edges alone have no area
        if not pushes.any() or not rows.run.areas[:n].any():
            return None
        samples = np.repeat(large, np.diff(bounds))[pushes]
        starts = np.flatnonzero(np.diff(samples, prepend=-1))
        return cls(contact, force, rows, samples[starts], starts, nodes[pushes], forces[pushes])

    @property
    def areas(self) -> Array:
        """Areas of the rows of the slave's patch nodes, (np,) [m2]."""
        return self.rows.run.areas[: len(self.contact.mechanics.gaps.slave.surface.points)]

    @property
    def patch(self) -> tuple[object, ...]:
        """Key that contacts with equal rows on the same patch of equal bodies share."""
        gaps = self.contact.mechanics.gaps
        return self.contact.slave.body, gaps.slave.surface.nodes.tobytes(), self.areas.tobytes(), gaps.all_points.nodal

    def stress(self, axes: Array) -> Stress:
        """Largest stress, by the semi-axes of each sample, (m, 2) [m]."""
        load, areas = self.force[self.samples], self.areas
        peak = int((load / axes.prod(axis=1)).argmax())
        closed = self.nodes[slice(*[*self.starts, len(self.nodes)][peak : peak + 2])]
        whole = self.rows.run.edge is None and areas[closed].sum() >= _WHOLE * areas.sum()
        a, b = map(float, axes[peak])
        return Stress.beneath(
            float(load[peak]),
            (a, b),
            self.contact.elastic_materials,
            mean=float(load[peak]) / areas.sum() if whole else 0.0,
            time=float(self.rows.times[self.samples[peak]]),
        )


def largest_stresses(histories: Sequence[tuple[PartitionContact, Array, RowSamples]]) -> list[Stress | None]:
    """See `PartitionContact.largest_stress`, of contacts with sums of normal forces, (n,) [N], and forces of rows.

    Those on equal patches are looked at together, which takes little longer than one of them.
    """
    stresses, alike, size = list[Stress | None](), dict[object, list[tuple[int, _Pressed]]](), 0
    for contact, force, rows in histories:
        top = int(force.argmax()) if len(force) else 0
        ellipse = contact.mechanics.law.semi_axes(float(force[top])) if len(force) and force[top] > 0 else None
        if ellipse is not None:
            time = float(rows.times[top])
            stresses.append(Stress.beneath(float(force[top]), ellipse, contact.elastic_materials, time=time))
            continue
        if (pressed := _Pressed.of(contact, force, rows)) is not None:
            size += len(pressed.nodes)
            alike.setdefault((pressed.patch, size // _AT_ONCE), []).append((len(stresses), pressed))
        stresses.append(None)
    for members in alike.values():
        every = [pressed for _, pressed in members]
        begins = np.cumsum([0, *(len(pressed.nodes) for pressed in every)])
        starts = [begin + pressed.starts for begin, pressed in zip(begins, every, strict=False)]
        gaps, nodes = every[0].contact.mechanics.gaps, np.concatenate([pressed.nodes for pressed in every])
        forces, places = np.concatenate([pressed.forces for pressed in every]), gaps.slave.surface.nodes
        axes = semi_axes(
            nodes,
            forces,
            np.concatenate(starts),
            every[0].contact.slave.body.points[places],
            every[0].areas,
            not gaps.all_points.nodal,
        )
        of_each = np.split(axes, np.cumsum([*map(len, starts)]))
        for (place, pressed), ellipse_axes in zip(members, of_each, strict=False):
            stresses[place] = pressed.stress(ellipse_axes)
    return stresses


def partition_items(mbs: MainSystem) -> tuple[list[PartitionBody], list[PartitionContact]]:
    """Partition bodies and contacts that a model holds. `mbs.Reset()` removes earlier ones."""
    items = registered(mbs)
    return [*items.bodies.values()], [*items.contacts.values()]
