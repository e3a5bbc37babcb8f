"""Review of a run: results are cut where they stop to mean anything, and warnings name limits that it went beyond.

`solve_dynamic` and `collect` both end with it.
"""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..errors import ContactPatchWarning, ModelLimitWarning, StoppedRunWarning, YieldWarning
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.partition_contact import PartitionContact, partition_items
from ..exudyn_contacts.plastic_results import SIDES
from ..reduction.buckling import compression, links
from ..support.arrays import Array
from ..support.foreign import MainSystem
from .result import Result, called, cut

_LARGEST_DEFORMATION = 0.1  # of a body's size: linear elasticity ends long before
_GROWTH = 1e3  # of a body's largest energy until then: what unstable steps pass, and large strain does not
_LARGEST_ROTATION = 0.1  # rad, of a body in an inertial frame
_LARGE = 0.1  # of the largest impulse: impacts below are not looked at
_STEPS_AN_IMPACT = 8  # implicit ones, fewer of which do not resolve an impact
_LARGEST_COMPRESSION = 0.1  # of the buckling load of a link
_FEW_ROWS = 2  # closed at the peak of a force, which do not resolve it
_RINGS_AT = 1.2  # of f_cut: where the mobility of what is kept vanishes
_MANY, _AT_ONCE = 4, 0.5  # rows, and of a contact's rows, that close at once on a flat patch
_RIPPLE = 0.2  # of the mean force, as a standard deviation
_LARGEST_TURN = 1.0  # rad, of a floating frame in a step: six steps a turn
_OVERLAP = 1e-2  # of the bodies' largest energy: what those that overlap at the start may store
_ASIDE = np.radians(30)  # of a patch's line of contact: a sphere's force is then 3 % too small, at 60 degrees 13 %
_ROUND_OFF = 1e-7  # of a facet's size: overlap that is none


@contextlib.contextmanager
def noted() -> Iterator[list[str]]:
    """Note the texts of all warnings within the block; they come after it, from where they came."""
    texts: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            yield texts
        finally:
            texts += [str(warning.message) for warning in caught]
    for warning in caught:
        warnings.warn_explicit(warning.message, warning.category, warning.filename, warning.lineno)


def reviewed(mbs: MainSystem, result: Result) -> Result:
    """Cut a result where it stops to mean anything, and say what needs saying."""
    bodies, contacts = partition_items(mbs)
    valid = np.ones(len(result.t), dtype=bool)
    for item in bodies:
        q = item.coordinates(result)
        finite = np.asarray(np.isfinite(q).all(axis=1))
        size = np.ptp(item.body.points, axis=0).max()
        share = item.deformation(np.where(finite[:, None], q, 0.0)) / size
        valid &= finite & ~_unbounded(item, result, finite & (share < _LARGEST_DEFORMATION))
    if not valid.all():
        result = cut(result, int(valid.argmin()))
        reason = result.message if result.status == "unstable" else "deformations have grown beyond all bounds"
        result = replace(result, status="unstable", message=reason)
    if result.status != "finished":
        last = f"results are kept up to t = {result.t[-1]:.6g} s" if len(result.t) else "nothing could be kept"
        result = replace(result, message=f"{result.message}; {last}")
        warnings.warn(result.message, StoppedRunWarning, stacklevel=3)
    if len(result.t):
        for item in bodies:
            if item.frame == "inertial":
                _warn_of_rotation(item, result)
            _warn_of_compression(item, result)
            _warn_of_strain(item, result)
        for contact in contacts:
            _warn_of_patch(contact, result)
            _warn_of_overlap(contact, result)
            _warn_of_steps(contact, result)
            _warn_of_few_rows(contact, result)
            _warn_of_direction(contact, result)
            _warn_of_ringing(contact, result)
            _warn_of_missing(contact, result)
            _warn_of_yield(contact, result)
            _warn_of_zone(contact, result)
    return result


def _unbounded(item: PartitionBody, result: Result, small: Array) -> Array:
    """Samples of large deformation whose energy grows without limit, (n,) bool, by those of a small one, (n,) bool.

    Unstable steps multiply it. Large strain alone does not: linear bodies may be run beyond what materials bear.
    """
    if small.all():
        return np.zeros(len(small), dtype=bool)
    with np.errstate(over="ignore", invalid="ignore"):
        energy = item.energy(result)
    first = int(small.argmin())
    grows = not (energy[~small] <= _GROWTH * energy[:first].max(initial=0.0)).all()
    return ~small & grows


def _warn_of_rotation(item: PartitionBody, result: Result) -> None:
    angle = np.linalg.norm(item.rigid_motion(item.coordinates(result))[:, 3:], axis=1)
    if angle.max() > _LARGEST_ROTATION:
        when = result.t[int((angle > _LARGEST_ROTATION).argmax())]
        warnings.warn(
            f"body {item.name!r} has rotated by more than {_LARGEST_ROTATION} rad at t = {when:.6g} s: "
            "frame='inertial' takes rotations as small, results from then on are wrong by their square. Take "
            "frame='floating'",
            ModelLimitWarning,
            stacklevel=4,
        )


def _warn_of_strain(item: PartitionBody, result: Result) -> None:
    """Strain so large that no linear answer holds for it."""
    share = item.deformation(item.coordinates(result)) / np.ptp(item.body.points, axis=0).max()
    if share.max() >= _LARGEST_DEFORMATION:
        when = result.t[int((share >= _LARGEST_DEFORMATION).argmax())]
        warnings.warn(
            f"{called(item)}: its contact patch has deformed by {share.max():.2g} of the body's size, from "
            f"t = {when:.6g} s on by more than {_LARGEST_DEFORMATION}. The answer is that of linear elasticity, which "
            "no material follows there. Check speeds, forces, units and the material",
            ModelLimitWarning,
            stacklevel=4,
        )


def _warn_of_compression(item: PartitionBody, result: Result) -> None:
    for link in links(item.body):
        force = compression(link, result.t, item.kinematics.elastic(item.coordinates(result)))
        share = force.max() / link.buckling_load
        if share > _LARGEST_COMPRESSION:
            when = result.t[int((force > _LARGEST_COMPRESSION * link.buckling_load).argmax())]
            between = " and ".join(map(repr, link.ends))
            warnings.warn(
                f"{called(item)} is compressed between its interfaces {between}, from t = {when:.6g} s on by up to "
                f"{force.max():.4g} N, {share:.2g} of the {link.buckling_load:.4g} N at which it buckles, hinged at "
                "both ends (a quarter of them, if one end is clamped and the other free). Its bending is linear; in "
                "truth it is softer by that share, so that frequencies and deflections are off. Divide the link into "
                "several bodies, or keep the force below a tenth",
                ModelLimitWarning,
                stacklevel=4,
            )


def _warn_of_overlap(contact: PartitionContact, result: Result) -> None:
    """What placing tolerates as round-off of meshes is much energy for slow bodies; in statics nothing moves."""
    placed = all(not item.coordinates(result)[0].any() for item, _ in contact.sides)
    if not contact.elastic or contact.law.gaps.carried or not placed or not contact.closed_rows(result)[0]:
        return
    if result.method == "static":
        return
    first = result.at(result.t[:1])
    stored, depth = contact.energy(first)[0], contact.depth(first)
    largest = max(item.energy(result).max() for item, _ in contact.sides)
    if depth > _ROUND_OFF * contact.slave.body.surface(np.zeros(3)).facet_size and stored > _OVERLAP * largest:
        warnings.warn(
            f"{called(contact)} starts with an overlap of {depth:.3g} m, within the tolerance of meshes, but "
            f"the {stored:.3g} J that it stores are {stored / largest:.2g} of the bodies' largest energy: it throws "
            "them apart. Move one by that much (referencePosition)",
            ModelLimitWarning,
            stacklevel=4,
        )


def _warn_of_steps(contact: PartitionContact, result: Result) -> None:
    """Implicit steps over a contact force that comes and goes within a few of them make energy, however stable."""
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
                stacklevel=4,
            )
            return


def _warn_of_few_rows(contact: PartitionContact, result: Result) -> None:
    """A contact smaller than the facets around it is that of one row, whatever its true area."""
    force, closed = contact.force(result), contact.closed_rows(result)
    top = int(force.argmax())
    if not contact.compliant or not 0 < closed[top] <= _FEW_ROWS or contact.n_rows <= closed[top]:
        return
    if top == len(force) - 1 and result.method != "static":
        return  # a contact that still grows begins with one row
    warnings.warn(
        f"{called(contact)} at t = {result.t[top]:.6g} s: {closed[top]} of {contact.n_rows} rows "
        f"{'is' if closed[top] == 1 else 'are'} closed at the peak of the force, {force[top]:.4g} N. The contact is "
        "smaller than the facets that should resolve it, and the force is too large, by a quarter and more. Refine "
        f"both meshes there, from facets of {contact.slave_facet_size:.3g} m to a third of the contact's radius, see "
        "ep.hertz.contact_radius",
        ModelLimitWarning,
        stacklevel=4,
    )


def _warn_of_direction(contact: PartitionContact, result: Result) -> None:
    """A patch with one axis yields along its line of contact only, whatever the direction of the force on it."""
    top = int(contact.force(result).argmax())
    force = contact.force_on_slave(result)[top]
    if not force.any():
        return
    for (item, number), name, sign in zip(contact.sides, contact.side_names, (-1, 1), strict=False):
        patch = item.body.partition.patches[number]
        if item.body.basis.flexibility is None or patch.wanders or patch.axes != "normal":
            continue
        line = item.kinematics.frame(item.coordinates(result)[top])[1] @ patch.direction
        aside = np.arccos(np.clip(sign * force @ line / np.linalg.norm(force), -1, 1))
        if aside > _ASIDE:
            warnings.warn(
                f"{called(contact)} at t = {result.t[top]:.6g} s: the force on {name} is {np.degrees(aside):.0f} "
                f"degrees off the line of contact of its patch, {patch.direction} in the body's axes. The patch yields "
                "along that line only, so that the contact is too soft and the force too small. Give the partition "
                'axes="xyz", or the direction of this force, or take Partition.surface',
                ModelLimitWarning,
                stacklevel=4,
            )


def _warn_of_ringing(contact: PartitionContact, result: Result) -> None:
    """Flat ends that meet at once excite the frequency above all modes that residual flexibility has (`bars.py`)."""
    every_step = len(result.t) > 1 and np.diff(result.t).max() < 1.5 * result.step
    if not contact.compliant or not every_step or result.method == "static":
        return
    period = 1 / (_RINGS_AT * min(item.body.f_cut for item, _ in contact.sides))
    window = max(3, round(period / result.step))
    force, closed = contact.force(result), contact.closed_rows(result)
    for first, last in contact.closed_samples(result):
        soon = closed[first : first + max(2, window // 8)].max()
        if soon < max(_MANY, _AT_ONCE * contact.n_rows) or last - first < 3 * window:
            continue
        part = force[first : last + 1]
        mean = np.convolve(part, np.full(window, 1 / window), mode="valid")
        ripple = part[window // 2 : window // 2 + len(mean)] - mean
        share = float(np.sqrt(np.mean(ripple**2)) / mean.mean())
        numerical = f" method='implicit', spectral_radius=0.3, step={0.12 * period:.2g}; or "
        if result.method == "implicit":
            numerical = " spectral_radius=0.3, if the run has another one; or "
        if share > _RIPPLE:
            warnings.warn(
                f"{called(contact)} at t = {result.t[first]:.6g} s: {soon} of {contact.n_rows} rows close at once, "
                f"and the force rings by {share:.0%} about its mean, at 1.2 f_cut whatever f_cut is, for nothing damps "
                f"the last mode. Read means over {period:.3g} s or more, not peaks. What helps: "
                "basis='craig-bampton' with formulation='lagrange' and method='implicit'; or"
                f"{numerical}a damping ratio of 0.3 for modes above 0.7 f_cut, "
                "damping= of CreatePartitionBody. The page 'Contact' of the documentation tells what each takes",
                ModelLimitWarning,
                stacklevel=4,
            )
            return


def _warn_of_missing(contact: PartitionContact, result: Result) -> None:
    """Bodies that turn may face each other later; those that never do may have been placed wrongly."""
    gaps = contact.law.gaps
    if not gaps.faced and not contact.force(result).any():
        patch = gaps.slave.surface
        warnings.warn(
            f"{called(contact)} never closed, and at the start the slave's patch, at {patch.points.mean(axis=0)} m "
            f"with outward normal {patch.direction}, did not face what it is to meet. Check referencePosition, "
            "referenceRotation and the partitions, or run longer",
            ContactPatchWarning,
            stacklevel=4,
        )


def warn_of_turns(result: Result) -> None:
    """Warn of floating frames that turn far in a step, of equal steps."""
    for item in result.bodies:
        if item.frame == "floating" and len(result.t):
            turn = result.step * np.linalg.norm(item.coordinates_t(result)[:, 3:6], axis=1).max()
            if turn > _LARGEST_TURN:
                warnings.warn(
                    f"body {item.name!r} turns by {turn:.3g} rad in a step of {result.step:.4g} s: no integrator "
                    f"follows that. Take steps of at most {0.25 * result.step / turn:.2g} s, 25 a turn, or "
                    "adaptive=True",
                    ModelLimitWarning,
                    stacklevel=3,
                )


def _warn_of_yield(contact: PartitionContact, result: Result) -> None:
    stress = contact.largest_stress(result)
    if stress is not None and (stress.yield_ratio or 0.0) > 1.0:
        warnings.warn(
            f"{called(contact)} at t = {stress.time:.6g} s: {stress.advice(contact.side_names)}",
            YieldWarning,
            stacklevel=4,
        )


def _warn_of_zone(contact: PartitionContact, result: Result) -> None:
    """Plastic flow that reached the edge of its zone."""
    if contact.yielding is None or (reached := contact.flow_at_border(result)) is None:
        return
    side, place = reached
    name = contact.side_names[SIDES.index(side)]
    warnings.warn(
        f"{called(contact)}: the plastic flow of {name} reached the edge of its plastic zone, at {place} m. Beyond, "
        "the body stays elastic, so that the force is too large, the dent too small. Enlarge plastic_radius= of it",
        YieldWarning,
        stacklevel=4,
    )


def _warn_of_patch(contact: PartitionContact, result: Result) -> None:
    if (reached := contact.edge_reached(result)) is not None:
        time, place = reached
        partitions = "both partitions" if len(contact.sides) > 1 else "the partition"
        what = "contact radius" if not contact.slave.body.partition.patches[contact.sides[0][1]].wanders else "faces"
        warnings.warn(
            f"{called(contact)} reached the edge of its patch at t = {time:.6g} s, "
            f"{place} m; the force is too small from then on. Enlarge the {what} of {partitions}",
            ContactPatchWarning,
            stacklevel=4,
        )
