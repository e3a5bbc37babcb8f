"""Contacts that steps, samples or facets do not resolve, and those that lack the damping of their bodies."""

from __future__ import annotations

from collections.abc import Iterator
from typing import cast

import numpy as np

from ...contact.formulations.hertz import WIDEST
from ...contact.rigid import RigidSurface
from ...contact.spot_gaps import SpotGaps
from ...contact.touching import touching
from ...errors import InputError
from ...exudyn_contacts.partition_contact import PartitionContact
from ...prediction.point_contact import PointContact
from ..result import Result, called, when
from .reviewed_run import Finding, ReviewedContact, ReviewedRun

_LARGE = 0.1  # share of the largest impulse: smaller impacts are not checked
_STEPS_AN_IMPACT = 8  # fewer implicit steps do not resolve an impact
_SAMPLES_AN_IMPACT = 4  # with fewer samples, the force of the impact is not known
FEW_ROWS = 2  # so few closed rows at the peak of a force do not resolve it
SOME_ROWS = 3  # as many may close at a point on facets as long as its diameter, with a force that is off by a tenth
COARSE = 1.8  # size of facets by the radius of a contact at a point, above which that is so


def short_impacts(run: ReviewedRun) -> Iterator[Finding]:
    """Contact forces that last only a few implicit steps: they produce energy, even in stable runs."""
    result = run.result
    t = result.t
    if result.method != "implicit" or len(t) < 2 or np.diff(t).min() >= 1.5 * result.step:
        return
    for history in run.contacts:
        if not history.contact.compliant:
            continue
        force, spans = history.force, history.spans
        impulses = [float(np.trapezoid(force[first : last + 1], t[first : last + 1])) for first, last in spans]
        for (first, last), impulse in zip(spans, impulses, strict=True):
            steps = round((t[last] - t[first]) / result.step) + 1
            if impulse >= _LARGE * max(impulses) and steps < _STEPS_AN_IMPACT and last < len(t) - 1:
                yield Finding(
                    f"{called(history.contact)} at t = {t[first]:.6g} s: the impact is over within {steps} steps of "
                    f"{result.step:.4g} s, which do not resolve its force; implicit steps that long give bodies "
                    "energy. Take a twentieth of the impact's duration or less, see ep.hertz.impact; without `step` "
                    "the library chooses"
                )
                break


def rare_samples(run: ReviewedRun) -> Iterator[Finding]:
    """Samples further apart than steps: they may miss an impact or its peak. The motion has all steps."""
    result = run.result
    if result.method == "static" or len(result.t) < 2 or np.diff(result.t).min() < 1.5 * result.step:
        return
    spans = [(history.contact, *span) for history in run.contacts for span in history.spans]
    within = [span for span in spans if span[1] > 0 and span[2] < len(result.t) - 1]
    short = [span for span in within if span[2] - span[1] + 1 < _SAMPLES_AN_IMPACT]
    if short:
        contact, first, last = short[0]
        said = f"{called(contact)} has {last - first + 1} samples with a force at t = {result.t[first]:.6g} s"
    elif not spans and result.work.active_set_iterations:
        said = "contacts were closed, but in no sample"
    else:
        return
    yield Finding(
        f"{said}. The samples are too far apart to tell forces, impulses and yield of such an impact; the motion is "
        "right. Take one in a twentieth of the impact's duration or more often, see ep.hertz.impact, by sample_period= "
        "or settings.solution.sensors.writePeriod"
    )


def few_rows(run: ReviewedRun) -> Iterator[Finding]:
    """Contacts smaller than the facets around them: they have a few rows, whatever their true area is."""
    for history in run.contacts:
        top = int(history.force.argmax())
        if not _has_few_rows(history, top, run.result):
            continue
        contact, force, closed = history.contact, float(history.force[top]), int(history.closed_rows[top])
        point, size = point_of(contact), contact.slave_facet_size
        if closed > FEW_ROWS and (point is None or size < COARSE * point.mean_axis(force)):
            continue
        nodes, forces = history.rows.at_sample(top)
        peak = f"{called(contact)} at {when(run.result, run.result.t[top])}"
        if np.isin(nodes[forces != 0], contact.mechanics.gaps.slave.surface.sharp).all():
            yield Finding(
                f"{peak}: only a sharp corner or edge touches at the peak of the force, {force:.4g} N. The stress "
                "there has no limit, so that no mesh resolves it: with finer facets the corner is softer. Impulse and "
                f"motion are right; peak and duration are those of facets of {size:.3g} m. Where they matter, round "
                "the corner, by a radius that facets resolve"
            )
            continue
        yield Finding(
            f"{peak}: {closed} of {contact.n_rows} rows {'is' if closed == 1 else 'are'} closed at the peak of the "
            f"force, {force:.4g} N. {_sunk_before(run.result, history, top)}{_why_few(point, force)}efine "
            f"{'both meshes' if len(contact.sides) > 1 else 'the mesh'} there, from facets of {size:.3g} m to a third "
            "of the contact's radius, see ep.hertz.contact_radius"
        )


def _has_few_rows(history: ReviewedContact, top: int, result: Result) -> bool:
    """Whether a contact has few closed rows at its peak, of more, and does not just begin."""
    contact, closed = history.contact, history.closed_rows[top]
    if history.force[top] <= 0.0 or not 0 < closed <= SOME_ROWS:
        return False
    if not contact.compliant or contact.n_rows <= closed:
        return False
    if top == len(history.force) - 1 and result.method != "static":
        return False  # a growing contact begins with one row
    return contact.beside is None or bool(contact.beside.force(result)[top] <= history.force[top])


def _sunk_before(result: Result, history: ReviewedContact, top: int) -> str:
    """Sentence on how deep surfaces lay within each other before a row closed, if deeper than at the peak it presses.

    Integrated rows are means around nodes, and a narrow tip sinks between them.
    """
    first = next(first for first, last in history.spans if first <= top <= last)
    sunk, pressed = history.contact.depth(result.at(result.t[first : first + 1])), float(history.pressed[top])
    if sunk <= max(pressed, 0.0):
        return ""
    return (
        f"Its surfaces lay {sunk:.3g} m within each other when the first row closed, more than the {pressed:.3g} m "
        "by which rows are pressed at the peak: contact comes too late by that way. "
    )


def _why_few(point: PointContact | None, force: float) -> str:
    """What a few rows mean under a force [N], and how to go on, up to the first letter of 'Refine'."""
    if point is None:
        return (
            "The contact is smaller than the facets that should resolve it, so that it is too stiff. The force of an "
            "impact is too large then, by a quarter and more; one that a spring or a load prescribes is right in the "
            "mean. R"
        )
    return (
        f"By Hertz's law the contact has a radius of {point.mean_axis(force):.3g} m, which the facets do not resolve, "
        "so that the force of an impact depends on where in a facet it is. Take formulation='hertz', which needs no "
        "finer mesh, or r"
    )


def point_of(contact: PartitionContact) -> PointContact | None:
    """Hertz's contact of the true surfaces; None if they do not touch at a point."""
    gaps, surface = contact.mechanics.gaps, None if len(contact.sides) > 1 else cast(RigidSurface, contact.master)
    try:
        return touching(gaps.sides, [patch for _, patch in contact.sides], surface).round
    except InputError:
        return None


def wide_points(run: ReviewedRun) -> Iterator[Finding]:
    """Contacts at a point, by formulation "hertz", that are not small beside the curvature of their surfaces."""
    for history in run.contacts:
        gaps, force = history.contact.mechanics.gaps, history.force
        if not isinstance(gaps, SpotGaps) or not force.any():
            continue
        top = int(force.argmax())
        radius = history.radius_at(top)
        if radius > WIDEST * gaps.contact.radius:
            yield Finding(
                f"{called(history.contact)} at {when(run.result, run.result.t[top])}: the contact has a radius of "
                f"{radius:.3g} m, more than {WIDEST:g} of the radius of its surfaces, {gaps.contact.radius:.3g} m. "
                "Hertz's law is for smaller ones; beyond, its stiffness is kept. Check speed and units, or take "
                "formulation='compliance' with facets that resolve the contact"
            )


def undamped_layers(run: ReviewedRun) -> Iterator[Finding]:
    """Contacts that yield without the damping of their bodies: impacts lose too little."""
    for history in run.contacts if run.result.method != "static" else ():
        if history.contact.undamped and history.force.any():
            yield Finding(
                f"{called(history.contact)} has no damping, though its bodies have one in proportion to their "
                "stiffness: most of the energy that this takes from an impact is lost in the contact itself. Take "
                "formulation='compliance', whose flexibility has the damping of its bodies"
            )
