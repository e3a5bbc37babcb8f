"""Contact forces that ring faster than the bases resolve, or as facets slide by."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...results.impacts import rings_by_facets
from ..result import Result, called
from .reviewed_run import Finding, ReviewedContact, ReviewedRun

_TO_DAMP, _DAMPS = 0.3, 0.35  # spectral radius that damps unresolved ringing, and one from which on it need be smaller
_LISTED = 5  # largest number of contacts that a finding lists
_LOOKED_AT = 64  # largest number of samples at which velocities are checked


def ringing(run: ReviewedRun) -> Iterator[Finding]:
    """Passing facets that excite a body near its frequency on the contact, and flat ends that meet at once.

    Flat ends excite frequencies above all modes of the bodies (`bars.py`).
    """
    by_faces = {}
    for i, history in enumerate(run.contacts):
        if (by_facets := _by_facets(run, history)) is not None:
            yield by_facets
        elif (rings := history.ringing) is not None:
            by_faces[repr(history.contact.name) if history.contact.name else str(i)] = rings
    if not by_faces:
        return
    said = [
        f"contact {name} at t = {r.start:.6g} s with {1e-3 / r.period:.3g} kHz, peak {r.peak:.4g} N, means over "
        f"{r.window:.3g} s at most {r.mean:.4g} N"
        for name, r in [*by_faces.items()][:_LISTED]
    ]
    more = len(by_faces) - len(said)
    f_cut = min(body.item.body.f_cut for body in run.bodies)
    yield Finding(
        f"the force rings near or above f_cut, {1e-3 * f_cut:.4g} kHz, where the bases end, as it does when flat faces "
        f"meet at once: {'; '.join(said)}{f'; and {more} contacts more' if more else ''}. Read means, mean_force of "
        "the contact, not peaks. A finer mesh with a higher f_cut makes the ringing shorter, and an end that is a "
        "little round closes its rows one after the other. Damping would smooth the force, but take energy of the "
        "motion too: see the page 'Contact' of the documentation"
    )


def _by_facets(run: ReviewedRun, history: ReviewedContact) -> Finding | None:
    """Finding on passing facets that excite a body near its frequency on the contact; None if none do."""
    contact, result = history.contact, run.result
    sides = contact.mechanics.gaps.sides
    if result.method == "static" or not any(side.surface.wanders for side in sides):
        return None
    if (speed := _sliding_speed(run, history)) is None:
        return None
    for (item, _), side in zip(contact.sides, sides, strict=True):
        rate = speed / side.surface.facet_size
        if (frequency := rings_by_facets(result.t, history.force, rate)) is not None:
            spans = history.spans
            opens = f" and opens {len(spans) - 1} times for a short while" if len(spans) > 1 else ""
            return Finding(
                f"{called(contact)}: its force rings with {1e-3 * frequency:.3g} kHz{opens}, and {1e-3 * rate:.3g} "
                f"thousand facets of {called(item)} slide by each second: probably the mesh excites the bodies on "
                "their contact, so that they part though real ones would not. Take finer facets there"
                f"{damping_steps(result, frequency)}. The page 'Contact' of the documentation has a section on ringing"
            )
    return None


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


def _sliding_speed(run: ReviewedRun, history: ReviewedContact) -> float | None:
    """Median speed at which two bodies slide along each other at the contact [m/s]; None if it is not known."""
    contact, on_slave = history.contact, history.force_on_slave
    pressed = np.flatnonzero(on_slave.any(axis=1))
    if len(contact.sides) < 2 or not pressed.size:
        return None
    some = pressed[np.unique(np.linspace(0, len(pressed) - 1, _LOOKED_AT).astype(int))]
    nodes = contact.mechanics.gaps.slave.surface.nodes
    weights = history.rows.matrix(some).toarray()[:, : len(nodes)]
    places = contact.slave.kinematics.at(nodes).place(run.body(contact.slave).q[some])
    centres = np.einsum("mk,mkd->md", weights, places) / weights.sum(axis=1)[:, None]
    of_slave, of_master = (
        item.kinematics.mean_velocity(run.body(item).q[some], run.body(item).q_t[some], centres)
        for item, _ in contact.sides
    )
    normals = on_slave[some] / np.linalg.norm(on_slave[some], axis=1)[:, None]
    relative = of_slave - of_master
    along = relative - np.sum(relative * normals, axis=1)[:, None] * normals
    return float(np.median(np.linalg.norm(along, axis=1)))
