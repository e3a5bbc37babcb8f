"""Contacts beyond first yield, and plastic flow that its zone does not resolve or hold."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
from scipy.spatial import KDTree

from ...errors import YieldWarning
from ...exudyn_contacts.partition_contact import largest_stresses
from ...exudyn_contacts.plastic_results import SIDES
from ..result import called, when
from .reviewed_run import Finding, ReviewedRun

_LARGE_STRAIN = 0.1  # equivalent plastic strain
_PRESSED = 2.8  # mean pressure of a plastic contact by the yield stress
_COARSE = 0.6  # distance of nodes by the radius of the contact from which on flow is not resolved


def first_yield(run: ReviewedRun) -> Iterator[Finding]:
    """Contacts beyond first yield: one finding for all of them, with the worst."""
    beyond = []
    stresses = largest_stresses([(history.contact, history.force, history.rows) for history in run.contacts])
    for history, stress in zip(run.contacts, stresses, strict=True):
        if stress is not None and (ratio := stress.yield_ratio or 0.0) > 1.0:
            beyond.append((ratio, history, stress))
    if not beyond:
        return
    _, worst, stress = max(beyond, key=lambda entry: entry[0])
    rings = worst.ringing
    others = f". It is the worst of {len(beyond)} contacts beyond first yield" if len(beyond) > 1 else ""
    peak = f". {rings.beside(stress.yield_force)}" if rings is not None and stress.yield_force else ""
    at = when(run.result, stress.time or 0.0)
    yield Finding(
        f"{called(worst.contact)} at {at}: {stress.advice(worst.contact.side_names)}{others}{peak}", YieldWarning
    )


def flow_at_border(run: ReviewedRun) -> Iterator[Finding]:
    """Plastic flow that reached the edge of its zone."""
    for contact in run.result.contacts:
        if not contact.plastic or (reached := contact.plastic.flow_at_border(run.result)) is None:
            continue
        side, place = reached
        name = contact.side_names[SIDES.index(side)]
        yield Finding(
            f"{called(contact)}: the plastic flow of {name} reached the edge of its plastic zone, at {place} m. "
            "Beyond, the body stays elastic, so that the force is too large, the dent too small. Enlarge "
            "plastic_radius= of it by half, which costs little where the mesh gets coarser outwards; "
            "hertz.impact(...).plastic_radius estimates how far flow reaches",
            YieldWarning,
        )


def coarse_zones(run: ReviewedRun) -> Iterator[Finding]:
    """Flow in elements that are too large for the contact, of whatever kind they are."""
    result = run.result
    for history in run.contacts:
        contact, force = history.contact, history.force
        top = int(force.argmax())
        if not contact.plastic or force[top] <= 0 or (top == len(force) - 1 and result.method != "static"):
            continue  # a growing contact begins small
        if history.closed_rows[top] == contact.n_rows:
            continue  # flow beneath whole faces is even
        closed, states = history.radius_at(top), contact.plastic.states(result)
        for side, zone_run in contact.plastic.zones:
            zone = zone_run.zone
            flow = states[SIDES[side]].equivalent * zone.weight
            # The mean pressure hardly exceeds 2.8 times the yield stress. On coarse meshes closed rows tell less.
            radius = max(closed, np.sqrt(force[top] / (_PRESSED * np.pi * zone.flow.yield_stress)))
            if flow.any() and (spacing := flow @ zone.spacing / flow.sum()) > _COARSE * radius:
                yield Finding(
                    f"{called(contact)}: where {contact.side_names[side]} has yielded, the nodes of its elements are "
                    f"{spacing:.3g} m apart, but the contact has a radius of some {radius:.3g} m. That does not "
                    "resolve the flow: the force, and more so the dent and the plastic work, are off by a tenth or "
                    f"more. Refine the mesh in the zone to nodes {radius / 4:.2g} m apart, so quadratic elements of "
                    f"{radius / 2:.2g} m"
                )
                break


def large_plastic_strain(run: ReviewedRun) -> Iterator[Finding]:
    """Plastic strain at which the theory of small strain does not hold."""
    for contact in run.result.contacts:
        for side, zone_run in contact.plastic.zones:
            reached = contact.plastic.states(run.result)[SIDES[side]].equivalent
            if reached.max(initial=0.0) > _LARGE_STRAIN:
                place = zone_run.zone.place(reached == reached.max())[0]
                yield Finding(
                    f"{called(contact)}: the equivalent plastic strain of {contact.side_names[side]} has reached "
                    f"{reached.max():.2g}, at {place} m of its mesh. Above {_LARGE_STRAIN:g} the theory of small "
                    "strain, by which it flows, is off by shares of that size. Check speed and material, or take the "
                    "numbers as rough",
                    YieldWarning,
                )
                break


def near_zones(run: ReviewedRun) -> Iterator[Finding]:
    """Plastic flow beneath two contacts of a body whose distance is less than the width of the flow.

    Zones do not influence each other. The stress outside of a zone due to its plastic strain falls with the third power
    of the distance.
    """
    flowed = []
    for contact in run.result.contacts:
        for side, zone_run in contact.plastic.zones:
            item, state = contact.sides[side][0], contact.plastic.states(run.result)[SIDES[side]]
            if state.equivalent.any() and not len(item.body.basis.nodal):
                flowed.append((contact, item, zone_run.zone.place(state.equivalent > 0)))
    for (first, item, places), (second, its_item, there) in itertools.combinations(flowed, 2):
        if its_item != item:
            continue
        apart = float(KDTree(places).query(there)[0].min())
        width = float(max(np.ptp(places, axis=0).max(), np.ptp(there, axis=0).max()))
        if apart < width:
            yield Finding(
                f"{called(item)} has flowed beneath {called(first)} and {called(second)}, {apart:.3g} m apart over a "
                f"width of {width:.3g} m. Zones of two patches do not feel each other's plastic strain, which matters "
                "so near. Take patches further apart, or basis='free', in which they do"
            )
            return
