"""Time of the next contact, and the steps: long ones in free flight and lasting contact, short ones in impacts."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..algebra.products import dense
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.contact_run import ContactRun
from ..exudyn_contacts.partition_contact import PartitionContact
from ..frames.floating import FloatingKinematics
from ..prediction.default_step import STEPS_A_PERIOD, resolving_step
from ..support.arrays import Array, consecutive
from ..support.checks import validate_array, validate_type
from .contact_work import ContactWork
from .velocity_error import BodyMotion, Judgement, VelocityError
from .vibration import Vibration

State = Callable[[], tuple[Array, Array, Array]]

LONGEST = 100  # contact steps: default of the longest step, because a model's other items are not known
GROWTH = 1.25  # from one step to the next; with twice the growth, generalized-alpha amplifies modes of high frequency
_WORTHWHILE = 1.1  # for less growth the step stays, and so do the factors of its Jacobian
UNRESOLVED = 1e-4  # share of the bodies' largest energy so far that steps need not resolve: 1 % of a velocity
_CAUTION = 0.9  # share of the time to contact that is used: the error grows with the square of the step
_FORESEEN = 4.0  # next steps: a contact that is further away than this in time is not predicted again
_SIGHT = 16.0, 100.0  # next steps and contact steps: no prediction holds longer than both, for forces change
_PATIENCE = 8  # most steps of the same length in free flight until vibration is looked at again
_SHORT = 2.0  # contact steps: longer implicit steps follow each look at vibration, for some of them may last long
_LANDING = 0.5  # share of the step at contact: time between the end of the last long step and contact
_LIFTED = 2.0  # contact steps: longer steps in which a contact opens are taken again
_LASTS = 3.0  # times from the closing of a contact to its largest force, after which it lasts
_FALLEN = 0.5  # share of its largest force below which an impact is about to end
_IN_IMPACTS = 5e-2  # share of the tolerance of velocities in impacts: there errors of all steps add up
_SAME = 1 + 1e-9  # ratio of steps that are the same


def first_root(gap: Array, rate: Array, acceleration: Array) -> Array:
    """First times at which gap + rate t + acceleration t^2 / 2 falls below zero, (k,) [s]; infinite if never.

    Only accelerations that close a gap count: a force that opens it may end.

    Parameters
    ----------
    gap, rate, acceleration : (k,) arrays
        [m], [m/s], [m/s2]; gaps below zero count as zero.
    """
    gap, a = np.maximum(gap, 0.0), np.minimum(acceleration, 0.0)
    root = np.sqrt(rate**2 - 2 * a * gap)
    # This form of the solution has no cancellation.
    above = np.where(rate >= 0, rate + root, 2 * gap)
    below = np.where(rate >= 0, -a, root - rate)
    value: Array = np.divide(above, below, out=np.full(len(gap), np.inf), where=below > 0)
    return value


def time_to_contact(contact: PartitionContact, q: Array, q_t: Array, q_tt: Array | None = None) -> float:
    """Time until the first row of a contact closes [s], from present gaps and rates; infinite if all gaps grow.

    It is exact for rigid bodies that fly freely onto a plane without rotation. Points may be too far away to be rows of
    a moving contact. They count as if they flew straight at each other, which gives a lower bound.

    Parameters
    ----------
    contact : PartitionContact
    q, q_t : (n,) arrays
        Coordinates of slave and master, one after the other, and their velocities.
    q_tt : (n,) array, optional
        Their accelerations by the rigid motion. Default: zero.

    Returns
    -------
    float
        Zero if the contact is closed.

    Raises
    ------
    InputError
        If an argument has a wrong type or length.
    """
    validate_type("contact", contact, PartitionContact, "CreatePartitionContact()")
    n = sum(item.body.n_dofs for item, _ in contact.sides)
    q, q_t = validate_array("q", q, (n,)), validate_array("q_t", q_t, (n,))
    q_tt = None if q_tt is None else validate_array("q_tt", q_tt, (n,))
    mechanics = contact.mechanics.for_run("explicit")
    if mechanics.gaps.at(q).min(initial=np.inf) < mechanics.reach:
        return 0.0
    return _first_touch(*mechanics.closing(q, q_t, np.zeros_like(q) if q_tt is None else q_tt))[0]


def _first_touch(gap: Array, rate: Array, acceleration: Array) -> tuple[float, float]:
    """Time to contact [s] and speed of approach then [m/s], see `PatchContact.closing`."""
    times = first_root(gap, rate, acceleration)
    first = int(times.argmin()) if len(times) else 0
    if not len(times) or not math.isfinite(times[first]):
        return math.inf, 0.0
    return float(times[first]), float(-rate[first] - min(acceleration[first], 0.0) * times[first])


def impact_step(contact: PartitionContact, q: Array, q_t: Array, q_tt: Array, limit: Callable[[], float]) -> float:
    """Step that resolves the next impact [s], from the present motion; infinite if no impact is predicted.

    `default_step.resolving_step` finds it from the gaps and rates at the time when the first row closes.

    Parameters
    ----------
    contact : PartitionContact
    q, q_t, q_tt : (n,) arrays
        Coordinates of slave and master, their velocities and accelerations.
    limit : callable
        Returns the stability limit [s].
    """
    law = contact.mechanics.law
    known = law.elastic or law.semi_axes(1.0) is not None  # friction at a point leaves the normal forces as they are
    if not contact.compliant or contact.mechanics.ahead or not known or contact.mechanics.reach:
        return math.inf  # the contact has no flexibility of its own, or no force at a depth tells of its energy
    if contact.mechanics.gaps.least_distance(q) > contact.mechanics.gaps.furthest:
        return math.inf
    mechanics = contact.mechanics.for_run("explicit")
    time, speed = _first_touch(*mechanics.closing(q, q_t, q_tt))
    if not math.isfinite(time) or speed <= 0 or mechanics.gaps.beside:
        return math.inf
    # Rows that follow the motion are few: forces need only these. A deep impact closes all rows that can touch next.
    gap = mechanics.gaps.widen(q)
    if not len(gap):  # patches are far apart, or face away from each other
        return math.inf
    H = dense(mechanics.gaps.jacobian(np.arange(len(gap))))
    rate = H @ (q_t + time * q_tt)
    touching = gap + time * (H @ q_t) + 0.5 * time**2 * (H @ q_tt)

    def mobility(rows: Array) -> float:
        weights = rows * mechanics.gaps.area if (rows @ mechanics.gaps.area) else rows  # single nodes may have no area
        return _mobility(contact, weights @ H / weights.sum())

    return resolving_step(touching, rate, mobility, mechanics.press, size=mechanics.gaps.size, limit=limit)


def _mobility(contact: PartitionContact, row: Array) -> float:
    """Acceleration of the bodies' rigid motion along a row, (n,), due to a unit force on it [1/kg]."""
    slices = consecutive([item.body.n_dofs for item, _ in contact.sides])
    total = 0.0
    for (item, _), place in zip(contact.sides, slices, strict=True):
        body = item.body
        of_rigid = row[place] @ (item.kinematics.from_basis @ body.rigid)
        total += float(of_rigid @ np.linalg.solve(body.rigid.T @ (body.mass @ body.rigid), of_rigid))
    return total


@dataclass(frozen=True)
class Closing:
    """A contact since it closed: an impact as long as it may open again.

    Parameters
    ----------
    time : float
        Time since it closed [s].
    peak : float
        Largest force so far [N].
    peak_time : float
        Time of this force since it closed [s].
    least : float
        Least force since then [N].
    risen : float
        Largest force until the force last rose again to half of it, after it had fallen below [N].
    """

    time: float
    peak: float
    peak_time: float
    least: float
    risen: float = 0.0

    def after(self, step: float, force: float) -> Closing:
        """Return the contact after a step [s], at whose end it has this force [N]."""
        time, least = self.time + step, min(self.least, force)
        risen = self.peak if least < _FALLEN * self.peak < force else self.risen
        if force > self.peak:
            return Closing(time, force, time, force, risen)
        return Closing(time, self.peak, self.peak_time, least, risen)

    @property
    def lasts(self) -> bool:
        """Whether the contact lasts.

        An impact would have ended, for bodies part as fast as they met, or faster. Or it was about to end, but the
        force has risen again.
        """
        return self.time > _LASTS * self.peak_time or self.risen > _FALLEN * self.peak


@dataclass(frozen=True, eq=False)
class Pace:
    """What a step control knows at the end of a run; the next run goes on with it.

    Parameters
    ----------
    step : float
        The next step [s].
    largest_energy : float
        Largest kinetic energy of the bodies in free flight so far [J].
    errors : VelocityError or None
        Errors of velocities in contact; None before there was any.
    closings : sequence of Closing or None
        Each contact since it closed; None if it is open, or was closed at the start.
    """

    step: float = 0.0
    largest_energy: float = 0.0
    errors: VelocityError | None = None
    closings: Sequence[Closing | None] = ()


class Pacing(NamedTuple):
    """What a step control knows between two steps, as one value: nothing else changes from step to step.

    Parameters
    ----------
    step : float
        The next step [s].
    largest_energy : float
        See `Pace`.
    errors : VelocityError or None
    closings : tuple of Closing or None
    at_least : float
        Next step of the run from which this one goes on, until its first step is chosen [s].
    is_open : tuple of bool
        Whether each contact is open.
    foreseen : tuple of float
        Time for which each contact certainly stays open [s].
    calm, waits : int
        Number of looks in a row after which the step stayed, and of steps until the next look.
    judged : Judgement or None
        End of the step that was taken, if it was judged before it was accepted.
    """

    step: float
    largest_energy: float
    errors: VelocityError | None
    closings: tuple[Closing | None, ...]
    at_least: float
    is_open: tuple[bool, ...]
    foreseen: tuple[float, ...]
    calm: int = 0
    waits: int = 0
    judged: Judgement | None = None

    @property
    def at_end(self) -> Pace:
        """What the next run goes on with: it looks at the motion anew."""
        return Pace(self.step, self.largest_energy, self.errors, self.closings)


class StepControl:
    """Control of the step size of a run; it returns the next step at the end of each step.

    Nothing of it changes in a run: what it knows is a `Pacing`, which its methods take and return.

    In an impact the step is the contact's own. In free flight it grows up to `longest`, as far as vibration and spin
    allow: 25 steps in a period of the fastest rotation and of the highest mode that must be resolved. This mode, with
    all modes above it, has more than `unresolved` of the energy. Long steps end before the next impact, so that a row
    closes within a short step.

    Implicit steps also grow in lasting contact, as far as the error of velocities allows, see `velocity_error`. A long
    step is taken again, shorter, if this error is too large, or if a contact closes or opens in it.

    Parameters
    ----------
    contacts : sequence of PartitionContact
    bodies : sequence of PartitionBody
    state : callable
        Returns the present coordinates of all bodies, one body after the other, their velocities and accelerations,
        (n,) each.
    run_of : callable
        Contact -> its state in the present run.
    step : float
        Step in an impact [s].
    longest : float
        Longest step [s].
    gap_tolerance : float, optional
        Depth to which a step may close a gap that was open before [m]. Default: the approach in a contact's own step.
    unresolved : float
        Share of the bodies' largest kinetic energy so far: vibration with less energy need not be resolved.
    velocity_tolerance : float, optional
        Error of velocities that a step in lasting contact may have. Default: steps do not grow in contact.
    work : ContactWork, optional
        Sums the work of contacts in the steps that are longer than in an impact. Default: nothing does.
    """

    def __init__(
        self,
        contacts: Sequence[PartitionContact],
        bodies: Sequence[PartitionBody],
        state: State,
        run_of: Callable[[PartitionContact], ContactRun],
        *,
        step: float,
        longest: float,
        gap_tolerance: float | None = None,
        unresolved: float = UNRESOLVED,
        velocity_tolerance: float | None = None,
        work: ContactWork | None = None,
    ) -> None:
        self.contacts, self.bodies, self._state, self._run_of = contacts, bodies, state, run_of
        self.step, self.longest, self.gap_tolerance = step, longest, gap_tolerance
        self.unresolved, self._tolerance, self._work = unresolved, velocity_tolerance, work
        self._places = dict(zip(bodies, consecutive([item.body.n_dofs for item in bodies]), strict=True))
        floating = [item for item in bodies if isinstance(item.kinematics, FloatingKinematics)]
        self._spins = [slice(self._places[item].start + 3, self._places[item].start + 6) for item in floating]
        self._vibration = Vibration(bodies)
        self._explicit = velocity_tolerance is None
        may_change = gap_tolerance is not None or longest > _WORTHWHILE * step
        self._constant = self._explicit and not may_change  # whether all steps have the same length

    def begin(self, earlier: Pace | None = None) -> Pacing:
        """Return what is known at the start of a run; it goes on with the pace of an `earlier` one, if there is one."""
        n, earlier = len(self.contacts), earlier or Pace()
        errors: VelocityError | None = None
        closings: tuple[Closing | None, ...] = (None,) * n
        if earlier.errors is not None and self._tolerance is not None:
            errors, closings = replace(earlier.errors, tolerance=self._tolerance), tuple(earlier.closings)
        return Pacing(0.0, earlier.largest_energy, errors, closings, earlier.step, (False,) * n, (0.0,) * n)

    def share_made(self, pace: Pacing) -> float:
        """Energy that long steps made in contact, by that of the largest changes of velocity; below zero if lost."""
        return self._work.made / pace.errors.energy if self._work and pace.errors and self._work.made else 0.0

    def after_step(self, pace: Pacing, last: float) -> Pacing:
        """Return the pace after a step of length `last` [s], with the next step, from the state at its end.

        Call it once for each step: the work of the contacts is counted meanwhile.
        """
        if self._constant and last == pace.step:
            return pace
        was_open, is_open = pace.is_open, tuple(run.is_open for run in self._runs)
        changed = was_open != is_open
        same, foreseen = last == pace.step and not changed, tuple([0.0 if changed else t - last for t in pace.foreseen])
        pace = pace._replace(is_open=is_open, foreseen=foreseen, waits=pace.waits - (same and all(is_open)))
        if same and self._stays(pace, last):
            return pace
        if self._tolerance is not None and not (pace.at_least and pace.errors):  # a run that goes on has judged it
            pace = self._judge(pace, was_open, last, self._tolerance)
        last = max(last, pace.at_least / GROWTH)
        step, largest_energy, foreseen = self._next_step(pace, last)
        calm = min(max(1, 2 * pace.calm), _PATIENCE) if step == last and not changed else 0
        if self._work is not None and step > _SAME * self.step and not all(is_open):
            self._work.begin_step()
        pace = pace._replace(step=step, largest_energy=largest_energy, foreseen=foreseen)
        return pace._replace(at_least=0.0, calm=calm, waits=calm, judged=None)

    @cached_property
    def _runs(self) -> list[ContactRun]:
        """State of each contact in the present run, which has begun."""
        return [self._run_of(contact) for contact in self.contacts]

    def _stays(self, pace: Pacing, last: float) -> bool:
        """Whether a step follows one of the same length without a look at the bodies' motion.

        Explicit steps in contact are those of an impact. In free flight vibration changes slowly. If it does not after
        all, the shortest steps resolve it, and explicit ones, which stability limits, nearly so.
        """
        shortest = last == self.step and self.gap_tolerance is None  # no contact that closes makes it shorter
        if not all(pace.is_open):
            return shortest and self._explicit
        short = self._explicit or last <= _SHORT * self.step
        return pace.waits >= 0 and short and (shortest or min(pace.foreseen, default=math.inf) >= _FORESEEN * last)

    def _judge(self, pace: Pacing, was_open: tuple[bool, ...], last: float, tolerance: float) -> Pacing:
        """Take the error of a step into account, and which contacts have opened or closed in it."""
        closings = [self._closing(pace, i, last, was_open=was) for i, was in enumerate(was_open)]
        pace = pace._replace(closings=tuple(closings))
        if not all(pace.is_open):
            changed = was_open != pace.is_open
            pace = pace._replace(errors=self._errors_after(pace, last, tolerance, changed=changed))
        if self._work is not None:
            self._work.end_step(last)
        return pace

    def _errors_after(self, pace: Pacing, last: float, tolerance: float, *, changed: bool) -> VelocityError:
        """Errors after a step in contact; `changed` is whether contacts have opened or closed in it."""
        now, errors = pace.judged.now if pace.judged else self._motion(), pace.errors
        if begins := errors is None:
            errors = VelocityError.at_start(tolerance, [item.kinematics.mass for item in self.bodies], now)
        if begins or changed:
            return errors.jumped(self.step, now, self._stored())
        return errors.after(last, pace.judged or errors.judged(last, now))

    def _closing(self, pace: Pacing, i: int, last: float, *, was_open: bool) -> Closing | None:
        """Contact number i since it closed, after a step [s]; None if it is open, or was closed at the start."""
        before = pace.closings[i]
        if pace.is_open[i] or (before is None and not was_open):
            return None
        force = self._runs[i].normal_force
        return Closing(0.0, force, 0.0, force) if before is None else before.after(last, force)

    @staticmethod
    def _share(pace: Pacing) -> float:
        """Share of the tolerance of velocities that holds now."""
        impacts = any(closing is not None and not closing.lasts for closing in pace.closings)
        return _IN_IMPACTS if impacts else 1.0

    def _next_step(self, pace: Pacing, last: float) -> tuple[float, float, tuple[float, ...]]:
        """Step that follows one of length `last` [s], and what `Pacing` calls largest_energy and foreseen."""
        in_contact, resolving, growth = not all(pace.is_open), math.inf, GROWTH
        largest_energy = pace.largest_energy
        if in_contact and pace.errors:
            resolving = min(pace.errors.next_step(last, self._share(pace)), self._turning_step(self._state()[1]))
            growth = math.inf
        elif in_contact:
            resolving = self.step
        limit = max(self.step, min(self.longest, resolving))
        if limit > self.step and not in_contact:
            resolving, largest_energy = self._resolving_step(largest_energy)
            limit = max(self.step, min(limit, resolving))
        if last == self.step and limit <= _WORTHWHILE * last and self.gap_tolerance is None:
            return last, largest_energy, pace.foreseen  # whenever the next contact closes
        until_contact, foreseen = self._until_contact(pace, min(limit, growth * last))
        limit = min(limit, until_contact)
        stays = last < limit <= _WORTHWHILE * last and limit != self.step
        return last if stays else min(limit, growth * last), largest_energy, foreseen

    def shorter_step(self, pace: Pacing, taken: float) -> tuple[float | None, Pacing]:
        """Return a shorter step [s] to replace one that was too long; None if the one taken is short enough.

        The pace that is returned too knows how a step that stays was judged. Explicit multipliers never close a gap too
        far: gaps are zero at the end of a step of any length.
        """
        is_long, opened, tolerance = taken > self.step * _SAME, False, self.gap_tolerance
        if pace.judged is not None:  # an earlier try of this step
            pace = pace._replace(judged=None)
        if not is_long and tolerance is None:
            return None, pace
        for was_open, run in zip(pace.is_open, self._runs, strict=True):
            is_open = run.is_open
            if was_open and not is_open and run.forward is None:
                if is_long or (tolerance is not None and run.mechanics.reach - run.evaluation.least_gap > tolerance):
                    return 0.5 * taken, pace
            opened |= is_open and not was_open
        if pace.errors is None or not is_long or all(pace.is_open):
            return None, pace
        if opened and taken > _LIFTED * self.step:
            return max(0.5 * taken, self.step), pace
        judged = pace.errors.judged(taken, self._motion())
        shorter = pace.errors.shorter_step(taken, judged.error, self._share(pace))
        if shorter is None:
            return None, pace._replace(judged=judged)
        return max(shorter, self.step), pace

    def _motion(self) -> BodyMotion:
        """Present motion of all bodies."""
        return BodyMotion(*self._state()[1:])

    def _stored(self) -> float:
        """Energy that bodies and contacts store at present [J]."""
        stored = sum(run.evaluation.stored for run in self._runs)
        q = self._state()[0]
        for item, place in self._places.items():
            stored += float(item.body.strain_energy(item.kinematics.elastic(q[place])))
        return stored

    def _until_contact(self, pace: Pacing, step: float) -> tuple[float, tuple[float, ...]]:
        """Longest step up to the next contact [s], where the next step is at most `step` [s], and what is foreseen.

        Predictions take long: so none is made where it would change nothing, or where an earlier one still holds.
        """
        limit, foreseen = math.inf, [*pace.foreseen]
        if step <= self.step and self.gap_tolerance is None:
            return limit, pace.foreseen
        for i, contact in enumerate(self.contacts):
            if pace.is_open[i] and foreseen[i] < _FORESEEN * step:
                time, speed = self._predicted(contact, self._runs[i])
                foreseen[i] = min(time, max(_SIGHT[0] * step, _SIGHT[1] * self.step))
                touching = self.step
                if self.gap_tolerance is not None and speed > 0:
                    touching = min(touching, self.gap_tolerance / speed)
                limit = min(limit, max(touching, min(_CAUTION * time, time - _LANDING * touching)))
        return limit, tuple(foreseen)

    def _predicted(self, contact: PartitionContact, run: ContactRun) -> tuple[float, float]:
        """Time to contact [s] and speed of approach then [m/s], from the present state."""
        q, q_t, q_tt = self._state()
        sides = [(item, self._places[item]) for item, _ in contact.sides]
        # Accelerations of vibration change sign too soon: those of the rigid motion count alone.
        motion = [(q[place], q_t[place], item.kinematics.rigid_part(q_tt[place])) for item, place in sides]
        return _first_touch(*run.closing(*map(np.concatenate, zip(*motion, strict=True))))

    def _turning_step(self, q_t: Array) -> float:
        """Step that resolves rotation at velocities q_t, (n,) [s]."""
        fastest = max((math.hypot(*q_t[spin].tolist()) for spin in self._spins), default=0.0)
        return 2 * np.pi / (STEPS_A_PERIOD * fastest) if fastest else math.inf

    def _resolving_step(self, largest_energy: float) -> tuple[float, float]:
        """Step that resolves vibration and rotation [s], and the largest kinetic energy [J], by that so far."""
        q, q_t, _ = self._state()
        largest_energy = max(largest_energy, self._vibration.kinetic_energy(q_t))
        fastest = self._vibration.fastest(q, q_t, self.unresolved * largest_energy)
        step = min(self._turning_step(q_t), 1 / (STEPS_A_PERIOD * fastest) if fastest else math.inf)
        return step, largest_energy
