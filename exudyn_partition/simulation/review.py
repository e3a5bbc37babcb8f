"""Review of a run: it cuts the result where samples lose their meaning, and warns of limits that the run exceeded.

`solve_dynamic` and `collect` both end with this review.
"""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ..errors import ModelLimitWarning, StoppedRunWarning
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.partition_contact import partition_items
from ..reduction.buckling import compression, links, squared_slope
from ..support.arrays import Array
from ..support.foreign import MainSystem
from .contact_review import warn_of_contacts
from .dent_review import warn_of_dents
from .result import Result, called, cut, when
from .spin_review import warn_of_growth, warn_of_spin
from .yield_review import warn_of_bending

_LARGEST_DEFORMATION = 0.1  # share of a body's size; linear elasticity is not valid far below it
_GROWTH = 1e3  # ratio to a body's largest energy so far, which unstable steps exceed and large strain does not
_LARGEST_ROTATION = 0.1  # rad, for a body in an inertial frame
_LARGEST_AXIAL = 0.1  # compression or tension of a link, by its buckling load
_LARGEST_LEFT = 0.02  # share of a link's bending that geometric stiffness leaves out
# That share by the mean square of slopes: a hinged column bears so much more than Euler's load when it has buckled
# (tests/exudyn_bodies/test_stiffening.py). An elastica bears a quarter.
_LEFT_BY_SLOPES = 2.0
_LASTING, _LARGEST_RINGING = 1000.0, 0.1  # rad, phase of a vibration that lasts; its share of the largest energy
_LOOKED_AT = 256  # largest number of samples of which energies are taken
_LARGEST_TURN = 1.0  # rad, for a floating frame in a step: six steps for a full turn


@contextlib.contextmanager
def noted() -> Iterator[list[str]]:
    """Collect the texts of all warnings within the block. The warnings appear after it, with their own source lines."""
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
    """Cut a result where its samples lose their meaning, and give the user all warnings."""
    bodies, contacts = partition_items(mbs)
    valid, shares = np.ones(len(result.t), dtype=bool), []
    for item in bodies:
        q = item.coordinates(result)
        finite = np.asarray(np.isfinite(q).all(axis=1))
        share = _deformed_share(item, np.where(finite[:, None], q, 0.0))
        shares.append(share)
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
        for item, share in zip(bodies, shares, strict=True):
            if item.frame == "inertial":
                _warn_of_rotation(item, result)
            warn_of_growth(item, result)
            if item.body.stiffening is None:
                _warn_of_axial_forces(item, result)
                warn_of_spin(mbs, item, result)
            else:
                _warn_of_slopes(item, result)
            _warn_of_strain(item, result, share[: len(result.t)])
            warn_of_bending(item, result)
            _warn_of_undamped(item, bodies, result)
        warn_of_contacts(contacts, result)
        warn_of_dents(mbs, bodies)
    return result


def _deformed_share(item: PartitionBody, q: Array) -> Array:
    """Largest elastic displacement on the patches over the body's size, (n,), or a bound on it, if that is small."""
    body, motion = item.body, abs(item.kinematics.deformed(q))
    size = np.ptp(body.points, axis=0).max()
    of_shapes = abs(body.shape_rows(body.partition.patch_nodes)).max(axis=0, initial=0.0)
    of_nodes = motion[:, body.n_shapes :].max(axis=1, initial=0.0)
    bound: Array = (motion[:, : body.n_shapes] @ of_shapes + of_nodes) / size
    return bound if bound.max(initial=0.0) < _LARGEST_DEFORMATION else item.deformation(q) / size


def _unbounded(item: PartitionBody, result: Result, small: Array) -> Array:
    """Samples of large deformation whose energy grows without limit, (n,) bool.

    `small`, (n,) bool, has the samples of small deformation. Unstable steps multiply the energy. Large strain alone
    does not: runs of linear bodies may exceed the strength of their material.
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
        turned = result.t[int((angle > _LARGEST_ROTATION).argmax())]
        warnings.warn(
            f"body {item.name!r} has rotated by more than {_LARGEST_ROTATION} rad at {when(result, turned)}: "
            "frame='inertial' takes rotations as small, results from then on are wrong by their square. Take "
            "frame='floating'",
            ModelLimitWarning,
            stacklevel=4,
        )


def _warn_of_strain(item: PartitionBody, result: Result, share: Array) -> None:
    """Warn of strain too large for a linear body; `share`, (n,), is the deformation over the body's size."""
    if share.max() >= _LARGEST_DEFORMATION:
        start = result.t[int((share >= _LARGEST_DEFORMATION).argmax())]
        warnings.warn(
            f"{called(item)}: its contact patch has deformed by {share.max():.2g} of the body's size, from "
            f"{when(result, start)} on by more than {_LARGEST_DEFORMATION}. The answer is that of linear elasticity, "
            "which no material follows there. Check speeds, forces, units and the material",
            ModelLimitWarning,
            stacklevel=4,
        )


def _warn_of_axial_forces(item: PartitionBody, result: Result) -> None:
    """Warn of compression and tension that should change the bending of a body without geometric stiffness."""
    for link in links(item.body):
        elastic = item.kinematics.elastic(item.coordinates(result))
        # The time of statics is no time in which a pulse ends before the link bends.
        force = -link.tension(elastic) if result.method == "static" else compression(link, result.t, elastic)
        between = " and ".join(map(repr, link.ends))
        for own, how, changed in ((force, "compressed", "softer"), (-force, "pulled", "stiffer")):
            share = own.max() / link.buckling_load
            if share > _LARGEST_AXIAL:
                start = result.t[int((own > _LARGEST_AXIAL * link.buckling_load).argmax())]
                warnings.warn(
                    f"{called(item)} is {how} between its interfaces {between}, from {when(result, start)} on by up to "
                    f"{own.max():.4g} N, {share:.2g} of the {link.buckling_load:.4g} N at which it buckles, hinged at "
                    "both ends (a quarter of them, if one end is clamped and the other free). Its bending is linear; "
                    f"in truth it is {changed} by that share, so that frequencies and deflections are off. Reduce it "
                    "with geometric_stiffness=True, or keep the force below a tenth",
                    ModelLimitWarning,
                    stacklevel=4,
                )


def _warn_of_slopes(item: PartitionBody, result: Result) -> None:
    """Warn of links that bend so far that geometric stiffness does not suffice."""
    for link in links(item.body):
        deformed = item.kinematics.deformed(item.coordinates(result))
        left = _LEFT_BY_SLOPES * squared_slope(item.body, link, deformed)
        if left.max() > _LARGEST_LEFT:
            start = result.t[int((left > _LARGEST_LEFT).argmax())]
            between = " and ".join(map(repr, link.ends))
            warnings.warn(
                f"{called(item)} bends between its interfaces {between}, from {when(result, start)} on by slopes of up "
                f"to {np.sqrt(left.max() / _LEFT_BY_SLOPES):.2g} rad, root mean square. Geometric stiffness is linear "
                f"in loads and right for small slopes: its resistance to bending is wrong by about {left.max():.2g}. "
                "Has it buckled? Divide it into several bodies, or lower the load",
                ModelLimitWarning,
                stacklevel=4,
            )


def _warn_of_undamped(item: PartitionBody, bodies: Sequence[PartitionBody], result: Result) -> None:
    """Warn of vibration that lasts so long that damping of structures would have ended it.

    Twice the mean kinetic energy of a mode is that of its vibration.
    """
    half, omega = (result.t[-1] - result.t[0]) / 2, item.body.basis.omega[6:]
    if item.damping is not None or len(item.body.basis.nodal) or result.method == "static":
        return
    last = omega * half > _LASTING
    parts = [(result.t > end - half / 2) & (result.t <= end) for end in (result.t[-1] - half, result.t[-1])]
    if not last.any() or not all(part.any() for part in parts):
        return
    squares = item.coordinates_t(result)[:, 6:][:, last] ** 2
    energy = min(float(squares[part].mean(axis=0).sum()) for part in parts)
    some = result.at(result.t[:: len(result.t) // _LOOKED_AT + 1])
    largest = float(np.sum([each.energy(some) for each in bodies], axis=0).max())
    if energy > _LARGEST_RINGING * largest:
        warnings.warn(
            f"{called(item)} vibrates without damping: in the second half of the run, {energy / largest:.2g} of the "
            f"bodies' largest energy is in modes from {omega[last].min() / (2 * np.pi):.4g} Hz on, which have swung "
            f"{_LASTING / (2 * np.pi):.0f} times and more. A damping ratio of 0.001, which is little for a structure, "
            "would have ended that. Give damping= to CreatePartitionBody, see the page 'Damping' of the documentation",
            ModelLimitWarning,
            stacklevel=4,
        )


def warn_of_turns(result: Result) -> None:
    """Warn of floating frames that turn far in a step, in runs with equal steps."""
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
