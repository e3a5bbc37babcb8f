"""Warnings about the contacts of a run: edges, overlap, steps, rows, ringing, yield."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Sequence

import numpy as np
from scipy.spatial import KDTree

from ..errors import ContactPatchWarning, ModelLimitWarning, UnitsWarning, YieldWarning
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.partition_contact import PartitionContact
from ..exudyn_contacts.plastic_results import SIDES
from ..results.impacts import Ringing, rings_by_facets
from .passing_review import warn_of_passing
from .penetration_review import warn_of_penetration
from .result import Result, called, when

_LARGE = 0.1  # share of the largest impulse: smaller impacts are not checked
_STEPS_AN_IMPACT = 8  # fewer implicit steps do not resolve an impact
_SAMPLES_AN_IMPACT = 4  # with fewer samples, the force of the impact is not known
_FEW_ROWS = 2  # so few closed rows at the peak of a force do not resolve it
_ASIDE = np.radians(30)  # angle from a patch's line of contact, or from the normals of its nodes
_SHARE_ASIDE = 0.1  # of the force that may be beyond this angle from the normals
_FAR, _NEARER = 20.0, 0.01  # distance over the bodies' size that may be a wrong unit; share of it travelled
_LARGE_STRAIN = 0.1  # equivalent plastic strain
_PRESSED = 2.8  # mean pressure of a plastic contact by the yield stress
_COARSE = 0.6  # distance of nodes by the radius of the contact from which on flow is not resolved
_TO_DAMP, _DAMPS = 0.3, 0.35  # spectral radius that damps unresolved ringing, and one from which on it need be smaller
_LISTED = 5  # largest number of contacts that a warning lists
_LOOKED_AT = 64  # largest number of samples at which velocities are checked


def warn_of_contacts(contacts: Sequence[PartitionContact], result: Result) -> None:
    """Give the warnings about each contact, and one warning for all where it concerns several."""
    for contact in contacts:
        _warn_of_patch(contact, result)
        warn_of_penetration(contact, result)
        _warn_of_steps(contact, result)
        _warn_of_few_rows(contact, result)
        _warn_of_direction(contact, result)
        _warn_of_missing(contact, result)
        warn_of_passing(contact, contacts, result)
        _warn_of_undamped_layer(contact, result)
        _warn_of_zone(contact, result)
        _warn_of_coarse_zone(contact, result)
        _warn_of_plastic_strain(contact, result)
    rings = {i: found for i, contact in enumerate(contacts) if (found := contact.ringing(result)) is not None}
    by_faces = {}
    for i, contact in enumerate(contacts):
        if not _warn_of_facets(contact, result) and i in rings:
            by_faces[repr(contact.name) if contact.name else str(i)] = rings[i]
    _warn_of_samples(contacts, result)
    _warn_of_ringing(by_faces, result)
    _warn_of_yield(contacts, rings, result)
    _warn_of_near_zones(contacts, result)
    _warn_of_open_statics(contacts, result)


def _warn_of_patch(contact: PartitionContact, result: Result) -> None:
    """Warn of contact at the edge of the slave's patch or, if it is not there, of the master's."""
    if (reached := contact.edge_reached(result)) is None:
        return
    time, place = reached
    item, number = contact.sides[0]
    patch, now = item.body.partition.patches[number], result.at([min(time, result.t[-1])])  # a cut one ends before
    distance = item.kinematics.at(patch.nodes).place(item.coordinates(now))[0] - place
    nearest = patch.nodes[int(np.linalg.norm(distance, axis=1).argmin())]
    if len(contact.sides) > 1 and nearest not in patch.rim:
        item, number = contact.sides[1]
        patch = item.body.partition.patches[number]
    partitions = "both partitions" if len(contact.sides) > 1 else "the partition"
    remedy = "Give it more faces" if patch.wanders else f"Enlarge the contact radius of {partitions}"
    warnings.warn(
        f"{called(contact)} reached the edge of its patch {repr(patch.name) if patch.name else number} of "
        f"{called(item)} at {when(result, time)}, {place} m; the force is too small from then on. {remedy}",
        ContactPatchWarning,
        stacklevel=5,
    )


def _warn_of_steps(contact: PartitionContact, result: Result) -> None:
    """Warn of contact forces that last only a few implicit steps: they produce energy, even in stable runs."""
    every_step = len(result.t) > 1 and np.diff(result.t).min() < 1.5 * result.step
    if result.method != "implicit" or not contact.compliant or not every_step:
        return
    force, spans = contact.force(result), contact.closed_samples(result)
    impulses = [float(np.trapezoid(force[first : last + 1], result.t[first : last + 1])) for first, last in spans]
    for (first, last), impulse in zip(spans, impulses, strict=True):
        steps = round((result.t[last] - result.t[first]) / result.step) + 1
        if impulse >= _LARGE * max(impulses) and steps < _STEPS_AN_IMPACT and last < len(result.t) - 1:
            warnings.warn(
                f"{called(contact)} at t = {result.t[first]:.6g} s: the impact is over within {steps} steps of "
                f"{result.step:.4g} s, which do not resolve its force; implicit steps that long give bodies energy. "
                "Take a twentieth of the impact's duration or less, see ep.hertz.impact; without `step` the library "
                "chooses",
                ModelLimitWarning,
                stacklevel=5,
            )
            return


def _warn_of_samples(contacts: Sequence[PartitionContact], result: Result) -> None:
    """Warn of samples further apart than steps: they may miss an impact or its peak. The motion has all steps."""
    if result.method == "static" or len(result.t) < 2 or np.diff(result.t).min() < 1.5 * result.step:
        return
    spans = [(contact, *span) for contact in contacts for span in contact.closed_samples(result)]
    within = [span for span in spans if span[1] > 0 and span[2] < len(result.t) - 1]
    short = [span for span in within if span[2] - span[1] + 1 < _SAMPLES_AN_IMPACT]
    if short:
        contact, first, last = short[0]
        said = f"{called(contact)} has {last - first + 1} samples with a force at t = {result.t[first]:.6g} s"
    elif not spans and result.work.active_set_iterations:
        said = "contacts were closed, but in no sample"
    else:
        return
    warnings.warn(
        f"{said}. The samples are too far apart to tell forces, impulses and yield of such an impact; the motion is "
        "right. Take one in a twentieth of the impact's duration or more often, see ep.hertz.impact, by sample_period= "
        "or settings.solution.sensors.writePeriod",
        ModelLimitWarning,
        stacklevel=5,
    )


def _warn_of_few_rows(contact: PartitionContact, result: Result) -> None:
    """Warn of a contact smaller than the facets around it: it has a row or two, whatever its true area is."""
    force, closed = contact.force(result), contact.closed_rows(result)
    top = int(force.argmax())
    if not contact.compliant or not 0 < closed[top] <= _FEW_ROWS or contact.n_rows <= closed[top]:
        return
    if top == len(force) - 1 and result.method != "static":
        return  # a growing contact begins with one row
    nodes = contact.row_forces(result.at(result.t[[top]])).nonzero()[1]
    if contact.beside is not None and contact.beside.force(result)[top] > force[top]:
        return
    if np.isin(nodes, contact.mechanics.gaps.slave.surface.sharp).all():
        warnings.warn(
            f"{called(contact)} at {when(result, result.t[top])}: only a sharp corner or edge touches at the peak of "
            f"the force, {force[top]:.4g} N. The stress there has no limit, so that no mesh resolves it: with finer "
            f"facets the corner is softer. Impulse and motion are right; peak and duration are those of facets of "
            f"{contact.slave_facet_size:.3g} m. Where they matter, round the corner, by a radius that facets resolve",
            ModelLimitWarning,
            stacklevel=5,
        )
        return
    warnings.warn(
        f"{called(contact)} at {when(result, result.t[top])}: {closed[top]} of {contact.n_rows} rows "
        f"{'is' if closed[top] == 1 else 'are'} closed at the peak of the force, {force[top]:.4g} N. The contact is "
        "smaller than the facets that should resolve it, so that it is too stiff. The force of an impact is too large "
        "then, by a quarter and more; one that a spring or a load prescribes is right in the mean. Refine "
        f"{'both meshes' if len(contact.sides) > 1 else 'the mesh'} "
        f"there, from facets of {contact.slave_facet_size:.3g} m to a third of the contact's radius, see "
        "ep.hertz.contact_radius",
        ModelLimitWarning,
        stacklevel=5,
    )


def _warn_of_direction(contact: PartitionContact, result: Result) -> None:
    """Warn of forces aside from the line of contact: a patch with one axis yields along this line only."""
    top = int(contact.force(result).argmax())
    force = contact.force_on_slave(result)[top]
    if not force.any():
        return
    for side, ((item, number), name, sign) in enumerate(zip(contact.sides, contact.side_names, (-1, 1), strict=False)):
        patch = item.body.partition.patches[number]
        if item.body.basis.flexibility is None or patch.axes != "normal":
            continue
        if patch.wanders:
            _warn_of_normals(contact, side, result, top)
            continue
        line = item.kinematics.frame(item.coordinates(result)[top])[1] @ patch.direction
        aside = np.arccos(np.clip(sign * force @ line / np.linalg.norm(force), -1, 1))
        if aside > _ASIDE:
            warnings.warn(
                f"{called(contact)} at {when(result, result.t[top])}: the force on {name} is {np.degrees(aside):.0f} "
                f"degrees off the line of contact of its patch, {patch.direction} in the body's axes. The patch yields "
                "along that line only, so that the contact is too soft and the force too small. Give the partition "
                'axes="xyz", or the direction of this force, or take Partition.surface',
                ModelLimitWarning,
                stacklevel=5,
            )


def _warn_of_normals(contact: PartitionContact, side: int, result: Result, top: int) -> None:
    """Warn of forces aside from the normals of their nodes, at the sample `top`: at sharp edges these are means."""
    now, (item, number) = result.at(result.t[[top]]), contact.sides[side]
    forces = contact.nodal_forces(now)[side][0]
    normals = item.body.partition.patches[number].node_normals @ item.kinematics.frame(item.coordinates(now)[0])[1].T
    sizes = np.linalg.norm(forces, axis=1)
    # An even pressure pulls at corners of some quadratic facets.
    aside = sizes[abs(np.einsum("kd,kd->k", forces, normals)) < np.cos(_ASIDE) * sizes].sum() / sizes.sum()
    if aside > _SHARE_ASIDE:
        edges = item.body.surface(np.zeros(3), number)
        chosen = 'Leave axes= out of Partition.surface, which takes "xyz" for a patch with sharp edges'
        if not np.setdiff1d(edges.sharp, edges.ends).size:
            chosen = 'Give its partition axes="xyz"'
        warnings.warn(
            f"{called(contact)} at {when(result, result.t[top])}: {aside:.0%} of the force on "
            f"{contact.side_names[side]} is more than 30 degrees off the normals of its nodes, as at edges between "
            f"faces. The patch yields along these normals only, so that forces and pressures there are wrong. {chosen}",
            ModelLimitWarning,
            stacklevel=6,
        )


def _warn_of_far(contact: PartitionContact, result: Result) -> bool:
    """Warn of a surface that is far away, compared with the size of the bodies, and stays there: its unit may be wrong.

    Returns whether there was a warning.
    """
    if contact.mechanics.gaps.carried or contact.force(result).any():
        return False
    ends = result.at(result.t[[0, -1]])
    places = [
        item.kinematics.at(nodes).place(item.coordinates(ends))
        for item, nodes in ((item, item.body.partition.patches[number].nodes) for item, number in contact.sides)
    ]
    if isinstance(contact.master, PartitionBody):
        away = [float(KDTree(theirs).query(own)[0].min()) for own, theirs in zip(*places, strict=True)]
    else:
        away = [float(contact.master.project(own)[0].min()) for own in places[0]]
    size = max(float(np.ptp(item.body.points, axis=0).max()) for item, _ in contact.sides)
    if away[-1] < _FAR * size or away[-1] < (1 - _NEARER) * away[0]:
        return False
    warnings.warn(
        f"{called(contact)} never closed: its slave's patch was {away[0]:.4g} m away from what it is to meet, "
        f"{away[0] / size:.3g} times the size of the bodies, and came {max(away[0] - away[-1], 0.0):.3g} m nearer. Is "
        "a place or a radius in millimetres? Give it in metres, as the bodies are, or leave this contact out",
        UnitsWarning,
        stacklevel=6,
    )
    return True


def _warn_of_missing(contact: PartitionContact, result: Result) -> None:
    """Warn of bodies that never face each other: they may have the wrong place. Bodies that turn may do so later."""
    gaps = contact.mechanics.gaps
    if _warn_of_far(contact, result):
        return
    if not gaps.faced and not contact.force(result).any():
        patch = gaps.slave.surface
        warnings.warn(
            f"{called(contact)} never closed, and at the start the slave's patch, at {patch.points.mean(axis=0)} m "
            f"with outward normal {patch.direction}, did not face what it is to meet. Check referencePosition, "
            "referenceRotation and the partitions, or run longer",
            ContactPatchWarning,
            stacklevel=5,
        )


def _warn_of_undamped_layer(contact: PartitionContact, result: Result) -> None:
    """Warn of contacts that yield without the damping of their bodies: impacts lose too little."""
    if result.method != "static" and contact.undamped and contact.force(result).any():
        warnings.warn(
            f"{called(contact)} has no damping, though its bodies have one in proportion to their stiffness: most of "
            "the energy that this takes from an impact is lost in the contact itself. Take formulation='compliance', "
            "whose flexibility has the damping of its bodies",
            ModelLimitWarning,
            stacklevel=5,
        )


def _warn_of_zone(contact: PartitionContact, result: Result) -> None:
    """Warn of plastic flow that reached the edge of its zone."""
    if not contact.plastic or (reached := contact.plastic.flow_at_border(result)) is None:
        return
    side, place = reached
    name = contact.side_names[SIDES.index(side)]
    warnings.warn(
        f"{called(contact)}: the plastic flow of {name} reached the edge of its plastic zone, at {place} m. Beyond, "
        "the body stays elastic, so that the force is too large, the dent too small. Enlarge plastic_radius= of it by "
        "half, which costs little where the mesh gets coarser outwards; hertz.impact(...).plastic_radius estimates "
        "how far flow reaches",
        YieldWarning,
        stacklevel=5,
    )


def _warn_of_coarse_zone(contact: PartitionContact, result: Result) -> None:
    """Warn of flow in elements that are too large for the contact, of whatever kind they are."""
    force = contact.force(result)
    top = int(force.argmax())
    if not contact.plastic or force[top] <= 0 or (top == len(force) - 1 and result.method != "static"):
        return  # a growing contact begins small
    if contact.closed_rows(result)[top] == contact.n_rows:
        return  # flow beneath whole faces is even
    closed, states = contact.radius(result.at(result.t[[top]]))[0], contact.plastic.states(result)
    for side, run in contact.plastic.zones:
        zone = run.zone
        flow = states[SIDES[side]].equivalent * zone.weight
        # The mean pressure hardly exceeds 2.8 times the yield stress. On coarse meshes closed rows tell less than that.
        radius = max(closed, np.sqrt(force[top] / (_PRESSED * np.pi * zone.flow.yield_stress)))
        if flow.any() and (spacing := flow @ zone.spacing / flow.sum()) > _COARSE * radius:
            warnings.warn(
                f"{called(contact)}: where {contact.side_names[side]} has yielded, the nodes of its elements are "
                f"{spacing:.3g} m apart, but the contact has a radius of some {radius:.3g} m. That does not resolve "
                "the flow: the force, and more so the dent and the plastic work, are off by a tenth or more. Refine "
                f"the mesh in the zone to nodes {radius / 4:.2g} m apart, so quadratic elements of {radius / 2:.2g} m",
                ModelLimitWarning,
                stacklevel=5,
            )
            return


def _warn_of_plastic_strain(contact: PartitionContact, result: Result) -> None:
    """Warn of plastic strain at which the theory of small strain does not hold."""
    for side, run in contact.plastic.zones:
        reached = contact.plastic.states(result)[SIDES[side]].equivalent
        if reached.max(initial=0.0) > _LARGE_STRAIN:
            place = run.zone.place(reached == reached.max())[0]
            warnings.warn(
                f"{called(contact)}: the equivalent plastic strain of {contact.side_names[side]} has reached "
                f"{reached.max():.2g}, at {place} m of its mesh. Above {_LARGE_STRAIN:g} the theory of small strain, "
                "by which it flows, is off by shares of that size. Check speed and material, or take the numbers as "
                "rough",
                YieldWarning,
                stacklevel=5,
            )
            return


def _warn_of_near_zones(contacts: Sequence[PartitionContact], result: Result) -> None:
    """Warn of plastic flow beneath two contacts of a body whose distance is less than the width of the flow.

    Zones do not influence each other. The stress outside of a zone due to its plastic strain falls with the third power
    of the distance.
    """
    flowed = []
    for contact in contacts:
        for side, run in contact.plastic.zones:
            item, state = contact.sides[side][0], contact.plastic.states(result)[SIDES[side]]
            if state.equivalent.any() and not len(item.body.basis.nodal):
                flowed.append((contact, item, run.zone.place(state.equivalent > 0)))
    for (one, item, places), (other, of, there) in itertools.combinations(flowed, 2):
        apart = float(KDTree(places).query(there)[0].min())
        width = float(max(np.ptp(places, axis=0).max(), np.ptp(there, axis=0).max()))
        if of == item and apart < width:
            warnings.warn(
                f"{called(item)} has flowed beneath {called(one)} and {called(other)}, {apart:.3g} m apart over a "
                f"width of {width:.3g} m. Zones of two patches do not feel each other's plastic strain, which matters "
                "so near. Take patches further apart, or basis='free', in which they do",
                ModelLimitWarning,
                stacklevel=5,
            )
            return


def _warn_of_ringing(rings: dict[str, Ringing], result: Result) -> None:
    """Warn of flat ends that meet at once: they excite frequencies above all modes of the bodies (`bars.py`)."""
    if not rings:
        return
    said = [
        f"contact {name} at t = {r.start:.6g} s with {1e-3 / r.period:.3g} kHz, peak {r.peak:.4g} N, means over "
        f"{r.window:.3g} s at most {r.mean:.4g} N"
        for name, r in [*rings.items()][:_LISTED]
    ]
    more = len(rings) - len(said)
    f_cut = min(item.body.f_cut for item in result.bodies)
    warnings.warn(
        f"the force rings near or above f_cut, {1e-3 * f_cut:.4g} kHz, where the bases end, as it does when flat faces "
        f"meet at once: {'; '.join(said)}{f'; and {more} contacts more' if more else ''}. Read means, mean_force of "
        "the contact, not peaks. A finer mesh with a higher f_cut makes the ringing shorter, and an end that is a "
        "little round closes its rows one after the other. Damping would smooth the force, but take energy of the "
        "motion too: see the page 'Contact' of the documentation",
        ModelLimitWarning,
        stacklevel=5,
    )


def _warn_of_facets(contact: PartitionContact, result: Result) -> bool:
    """Warn of passing facets that excite a body near its frequency on the contact; returns whether they do."""
    if result.method == "static" or not any(side.surface.wanders for side in contact.mechanics.gaps.sides):
        return False
    if (speed := _sliding_speed(contact, result)) is None:
        return False
    force = contact.force(result)
    for (item, _), side in zip(contact.sides, contact.mechanics.gaps.sides, strict=True):
        rate = speed / side.surface.facet_size
        if (frequency := rings_by_facets(result.t, force, rate)) is not None:
            spans = contact.closed_samples(result)
            opens = f" and opens {len(spans) - 1} times for a short while" if len(spans) > 1 else ""
            warnings.warn(
                f"{called(contact)}: its force rings with {1e-3 * frequency:.3g} kHz{opens}, and {1e-3 * rate:.3g} "
                f"thousand facets of {called(item)} slide by each second: probably the mesh excites the bodies on "
                "their contact, so that they part though real ones would not. Take finer facets there"
                f"{damping_steps(result, frequency)}. The page 'Contact' of the documentation has a section on ringing",
                ModelLimitWarning,
                stacklevel=5,
            )
            return True
    return False


def damping_steps(result: Result, frequency: float) -> str:
    """Advice of implicit steps that damp a frequency [Hz], as they do not resolve it; empty if the run has these."""
    radius = 1.0 if result.newmark is None else result.newmark.spectral_radius
    damps = [] if result.method == "implicit" and radius < _DAMPS else [f"spectral_radius={_TO_DAMP}"]
    if result.step < 1 / frequency:
        long = f"steps of {1 / frequency:.2g} s or longer, which do not resolve this frequency (these are "
        damps.append(f"{long}{result.step:.2g} s)")
    if not damps:
        return ""
    implicit = "" if result.method == "implicit" else "method='implicit' with "
    return f", or {implicit}{' and '.join(damps)}, which take energy, as the report tells"


def _sliding_speed(contact: PartitionContact, result: Result) -> float | None:
    """Median speed at which two bodies slide along each other at the contact [m/s]; None if it is not known."""
    on_slave = contact.force_on_slave(result)
    pressed = np.flatnonzero(on_slave.any(axis=1))
    if len(contact.sides) < 2 or not pressed.size:
        return None
    some = pressed[np.unique(np.linspace(0, len(pressed) - 1, _LOOKED_AT).astype(int))]
    now = result.at(result.t[some])
    nodes = contact.mechanics.gaps.slave.surface.nodes
    weights = contact.row_forces(now).toarray()[:, : len(nodes)]
    places = contact.slave.kinematics.at(nodes).place(contact.slave.coordinates(now))
    centres = np.einsum("mk,mkd->md", weights, places) / weights.sum(axis=1)[:, None]
    one, other = (
        item.kinematics.mean_velocity(item.coordinates(now), item.coordinates_t(now), centres)
        for item, _ in contact.sides
    )
    normals = on_slave[some] / np.linalg.norm(on_slave[some], axis=1)[:, None]
    relative = one - other
    along = relative - np.sum(relative * normals, axis=1)[:, None] * normals
    return float(np.median(np.linalg.norm(along, axis=1)))


def _warn_of_yield(contacts: Sequence[PartitionContact], rings: dict[int, Ringing], result: Result) -> None:
    """One warning for all contacts, with the worst of them."""
    found = []
    for i, contact in enumerate(contacts):
        stress = contact.largest_stress(result)
        if stress is not None and (ratio := stress.yield_ratio or 0.0) > 1.0:
            found.append((ratio, i, stress))
    if not found:
        return
    _, worst, stress = max(found, key=lambda entry: entry[0])
    contact = contacts[worst]
    others = f". It is the worst of {len(found)} contacts beyond first yield" if len(found) > 1 else ""
    peak = f". {rings[worst].beside(stress.yield_force)}" if worst in rings and stress.yield_force else ""
    warnings.warn(
        f"{called(contact)} at {when(result, stress.time or 0.0)}: {stress.advice(contact.side_names)}{others}{peak}",
        YieldWarning,
        stacklevel=5,
    )


def _warn_of_open_statics(contacts: Sequence[PartitionContact], result: Result) -> None:
    """Warn of an equilibrium without contact: mostly a spring or load has the wrong sign."""
    if result.method == "static" and result.status == "finished" and contacts:
        if not any(contact.force(result).any() for contact in contacts):
            gaps = ", ".join(f"{called(contact)} by {contact.gap(result)[-1]:.3g} m" for contact in contacts[:_LISTED])
            warnings.warn(
                f"no contact closed in any load step; open are {gaps}. If they should press, check signs of loads "
                "and of springs' offsets, and where bodies are placed",
                ContactPatchWarning,
                stacklevel=5,
            )
