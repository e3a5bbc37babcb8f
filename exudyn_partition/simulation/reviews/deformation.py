"""Bodies that move or deform further than their model allows: rotation, strain, compression, vibration that lasts."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...exudyn_bodies.partition_body import PartitionBody
from ...reduction.body import ReducedBody
from ...reduction.buckling import Link, compression, links, squared_slope
from ...support.arrays import Array
from ...support.once import once
from ..result import called, when
from .reviewed_run import LARGEST_DEFORMATION, Finding, ReviewedBody, ReviewedContact, ReviewedRun, lengths, size_of

_GROWTH = 1e3  # ratio to a body's largest energy so far, which unstable steps exceed and large strain does not
LARGEST_ROTATION = 0.1  # rad, for a body in an inertial frame
_LARGEST_AXIAL = 0.1  # compression or tension of a link, by its buckling load
_LARGEST_LEFT = 0.02  # share of a link's bending that geometric stiffness leaves out
# That share by the mean square of slopes: a hinged column bears so much more than Euler's load when it has buckled
# (tests/exudyn_bodies/test_stiffening.py). An elastica bears a quarter.
_LEFT_BY_SLOPES = 2.0
LARGEST_OFF = 0.02  # speed of a surface that is wrong because its body has turned, by the speed of approach
_SLOW = 0.1  # of the largest speed of approach of a contact: slower ones are of bodies that come to rest
_LASTING, _LARGEST_RINGING = 1000.0, 0.1  # rad, phase of a vibration that lasts; its share of the largest energy
_LOOKED_AT = 256  # largest number of samples of which energies are taken


def unbounded(body: ReviewedBody) -> Array:
    """Samples that have lost their meaning, (n,) bool.

    Coordinates are not finite, or deformation is large and the energy grows without limit. Unstable steps multiply the
    energy. Large strain alone does not: runs of linear bodies may exceed the strength of their material.
    """
    small = body.finite & (body.deformed_share < LARGEST_DEFORMATION)
    if small.all():
        return np.zeros(len(small), dtype=bool)
    with np.errstate(over="ignore", invalid="ignore"):
        energy = body.energy
    first = int(small.argmin())
    grows = not (energy[~small] <= _GROWTH * energy[:first].max(initial=0.0)).all()
    return np.asarray(~body.finite | (~small & grows))


def rotation(run: ReviewedRun) -> Iterator[Finding]:
    """Rotations of bodies in an inertial frame, which takes them as small."""
    for body in run.bodies:
        item = body.item
        if item.frame != "inertial":
            continue
        angle = lengths(body.rigid_motion[:, 3:])
        if angle.max() > LARGEST_ROTATION:
            turned = run.result.t[int((angle > LARGEST_ROTATION).argmax())]
            yield Finding(
                f"body {item.name!r} has rotated by more than {LARGEST_ROTATION} rad at {when(run.result, turned)}: "
                "frame='inertial' takes rotations as small, results from then on are wrong by their square. Take "
                "frame='floating'"
            )


def turned_surfaces(run: ReviewedRun) -> Iterator[Finding]:
    """Bodies in an inertial frame that have turned before a contact closes, so that speeds of approach are wrong."""
    for history in run.contacts:
        firsts = np.array([first for first, _ in history.spans if first], dtype=int)
        times = run.result.t[firsts] - run.result.t[firsts - 1]
        speeds = (history.pressed[firsts] - history.pressed[firsts - 1]) / times
        speeds[~np.isfinite(speeds)] = 0.0  # no row was there a sample before
        some = speeds > _SLOW * speeds.max(initial=0.0)
        for item, _ in history.contact.sides if some.any() else ():
            if item.frame == "inertial":
                yield from _turned(run, history, item, firsts[some], speeds[some])


def _turned(
    run: ReviewedRun, history: ReviewedContact, item: PartitionBody, firsts: Array, speeds: Array
) -> Iterator[Finding]:
    """What a body makes wrong where a contact closes: samples `firsts`, (k,), and speeds of approach, (k,) [m/s]."""
    q, rates = run.body(item).q[firsts], item.rigid_motion(run.body(item).q_t[firsts])[:, 3:]
    angles = lengths(run.body(item).rigid_motion[firsts, 3:])
    bounds = angles * lengths(rates) * size_of(item.body) / speeds
    worst = int(bounds.argmax())
    first = int(firsts[worst])
    place = history.place_at(first) if bounds[worst] > LARGEST_OFF else None
    if place is None:
        return
    off = wrong_speed(item, q[worst], rates[worst], place, history.force_on_slave[first] / history.force[first])
    if off > LARGEST_OFF * speeds[worst]:
        yield Finding(
            f"{called(history.contact)} closes at {when(run.result, run.result.t[first])} with {speeds[worst]:.3g} "
            f"m/s, of which {off:.2g} m/s are wrong: {called(item)} has turned by {angles[worst]:.2g} rad until then, "
            "and frame='inertial' takes rotations as small. Forces are off by about that share. Take frame='floating'"
        )


def wrong_speed(item: PartitionBody, q: Array, rate: Array, place: Array, normal: Array) -> float:
    """Speed of a place on a body in an inertial frame that is wrong because it has turned [m/s].

    To take a rotation phi as small moves a point at r from the centre of mass by -phi x (phi x r) / 2 too much.

    Parameters
    ----------
    item : PartitionBody
    q : (n_dofs,) array
        Its coordinates.
    rate : (3,) array
        Rate of its rotation [rad/s].
    place : (3,) array
        [m]
    normal : (3,) array
        Direction of the speed.
    """
    motion = item.kinematics.rigid_motion(q)
    phi, r = motion[3:], place - item.kinematics.frame(q)[0] - motion[:3]
    return float(abs(normal @ (np.cross(rate, np.cross(phi, r)) + np.cross(phi, np.cross(rate, r)))) / 2)


def strain(run: ReviewedRun) -> Iterator[Finding]:
    """Strain too large for a linear body."""
    for body in run.bodies:
        share = body.deformed_share
        if share.max() >= LARGEST_DEFORMATION:
            start = run.result.t[int((share >= LARGEST_DEFORMATION).argmax())]
            yield Finding(
                f"{called(body.item)}: its contact patch has deformed by {share.max():.2g} of the body's size, from "
                f"{when(run.result, start)} on by more than {LARGEST_DEFORMATION}. The answer is that of linear "
                "elasticity, which no material follows there. Check speeds, forces, units and the material"
            )


def axial_forces(run: ReviewedRun) -> Iterator[Finding]:
    """Compression and tension that should change the bending of a body without geometric stiffness."""
    result = run.result
    for body in run.bodies:
        item = body.item
        for link in _links(item.body) if item.body.stiffening is None else ():
            elastic = item.kinematics.elastic(body.q)
            # The time of statics is no time in which a pulse ends before the link bends.
            force = -link.tension(elastic) if result.method == "static" else compression(link, result.t, elastic)
            between = " and ".join(map(repr, link.ends))
            for push, how, changed in ((force, "compressed", "softer"), (-force, "pulled", "stiffer")):
                share = push.max() / link.buckling_load
                if share > _LARGEST_AXIAL:
                    start = result.t[int((push > _LARGEST_AXIAL * link.buckling_load).argmax())]
                    yield Finding(
                        f"{called(item)} is {how} between its interfaces {between}, from {when(result, start)} on by "
                        f"up to {push.max():.4g} N, {share:.2g} of the {link.buckling_load:.4g} N at which it buckles, "
                        "hinged at both ends (a quarter of them, if one end is clamped and the other free). Its "
                        f"bending is linear; in truth it is {changed} by that share, so that frequencies and "
                        "deflections are off. Reduce it with geometric_stiffness=True, or keep the force below a tenth"
                    )


def slopes(run: ReviewedRun) -> Iterator[Finding]:
    """Links that bend so far that geometric stiffness does not suffice."""
    for body in run.bodies:
        item = body.item
        for link in _links(item.body) if item.body.stiffening is not None else ():
            left = _LEFT_BY_SLOPES * squared_slope(item.body, link, body.deformed)
            if left.max() > _LARGEST_LEFT:
                start = run.result.t[int((left > _LARGEST_LEFT).argmax())]
                between = " and ".join(map(repr, link.ends))
                yield Finding(
                    f"{called(item)} bends between its interfaces {between}, from {when(run.result, start)} on by "
                    f"slopes of up to {np.sqrt(left.max() / _LEFT_BY_SLOPES):.2g} rad, root mean square. Geometric "
                    "stiffness is linear in loads and right for small slopes: its resistance to bending is wrong by "
                    f"about {left.max():.2g}. Has it buckled? Divide it into several bodies, or lower the load"
                )


@once
def _links(body: ReducedBody) -> list[Link]:
    return links(body)


def undamped_vibration(run: ReviewedRun) -> Iterator[Finding]:
    """Vibration that lasts so long that damping of structures would have ended it.

    Twice the mean kinetic energy of a mode is that of its vibration.
    """
    result = run.result
    half = (result.t[-1] - result.t[0]) / 2
    if result.method == "static":
        return
    for body in run.bodies:
        item, omega = body.item, body.item.body.basis.omega[6:]
        last = omega * half > _LASTING
        if item.damping is not None or len(item.body.basis.nodal) or not last.any():
            continue
        parts = [(result.t > end - half / 2) & (result.t <= end) for end in (result.t[-1] - half, result.t[-1])]
        if not all(part.any() for part in parts):
            continue
        squares = body.q_t[:, 6:][:, last] ** 2
        energy = min(float(squares[part].mean(axis=0).sum()) for part in parts)
        some = slice(None, None, len(result.t) // _LOOKED_AT + 1)
        largest = float(np.sum([each.energy[some] for each in run.bodies], axis=0).max())
        if energy > _LARGEST_RINGING * largest:
            yield Finding(
                f"{called(item)} vibrates without damping: in the second half of the run, {energy / largest:.2g} of "
                f"the bodies' largest energy is in modes from {omega[last].min() / (2 * np.pi):.4g} Hz on, which have "
                f"swung {_LASTING / (2 * np.pi):.0f} times and more. A damping ratio of 0.001, which is little for a "
                "structure, would have ended that. Give damping= to CreatePartitionBody, see the page 'Damping' of the "
                "documentation"
            )
