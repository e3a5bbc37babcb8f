"""Balances of a run: momenta of free bodies against all impulses, and energy against all known causes of change."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from ...contact.formulations.choices import Compliance, Hertz, Lagrange, Penalty
from ...errors import InputError
from ...exudyn_bodies.damping_work import damping_work, has_all_steps
from ...exudyn_bodies.item_work import Others
from ...exudyn_bodies.joints import Joints
from ...exudyn_bodies.model import is_ours, user_function
from ...exudyn_bodies.partition_body import PartitionBody
from ...exudyn_contacts.balance import STEPS, Balance, doubt, given, taken
from ...exudyn_contacts.partition_contact import PartitionContact
from ...frames.damping import ModeDamping
from ...frames.floating import FloatingKinematics
from ...support.arrays import Array
from ...support.foreign import MainSystem
from ..result import Result, called
from .reviewed_run import Finding, ReviewedBody, ReviewedRun, lengths, size_of

OFF = 1e-2  # share of the bodies' largest energy, or largest change of momentum, that may be missing
_TAKEN = 2e-2  # share of the largest energy that damping of steps, and strong damping of modes, may take
_AT_REST = 1e-3  # share of the largest energy: a run that ends with less kinetic energy has reached a state at rest
_STRONG = 0.2  # damping ratio of a mode above which its damping is strong
_MANY_TIMES = 10  # ratio to the expected value above which a share in percent is not useful
_LOOKED_AT = 256  # largest number of samples that are checked
_ROUND_OFF = 1e-11  # share of the speed of one body size in a period of f_cut: slower motion is round-off
_SLIGHT = 1e-6  # share of a body's momentum: a smaller change may be what Newton's method has left


def balance(run: ReviewedRun) -> Iterator[Finding]:
    """Energy or momentum that a run lost or produced, as far as its samples show it."""
    result = run.result
    if result.method == "static" or result.status == "unstable" or len(result.t) < 3 or not result.bodies:
        return
    if run.closings:  # no balance includes the energy that closes joints
        return
    free = _free(run)
    some = np.arange(len(free))
    if len(free) > _LOOKED_AT:
        some = np.unique(np.concatenate([_some(some), _some(np.flatnonzero(free)), some[-1:]]))
    energies = Balance(
        bodies=np.sum([body.energy[some] for body in run.bodies], axis=0),
        contacts=np.sum([np.zeros(len(some)), *(contact.energy(result)[some] for contact in result.contacts)], axis=0),
        taken={what: work[some] for what, work in taken(result).items()},
        given={what: work[some] for what, work in given(result).items()},
    )
    others, exchanges = Others.of(run.mbs, told=result.item_work is not None), any(map(_exchanges, result.contacts))
    if not others.driven and not exchanges:  # otherwise energy that was taken may come back
        yield from _damping(run, energies)
    functions = run.mbs.GetPreStepUserFunction(), run.mbs.GetPostStepUserFunction()
    if any(user_function(entry) is not None and not is_ours(entry) for entry in functions):
        return  # a user function may have changed anything
    yield from _momenta(run, [body for body in run.bodies if id(body.item) not in others.bodies], np.flatnonzero(free))
    if not others.not_told and not exchanges and not any(map(_lacks_inertia, result.bodies)):
        yield from _energy(run, energies, some, free)


def _lacks_inertia(item: PartitionBody) -> bool:
    """Whether inertia forces are left out. Energy is not conserved without them."""
    return any("(inertiaTerms)" in said for said in item.frame_left_out)


def _exchanges(contact: PartitionContact) -> bool:
    """Whether a contact gives energy to a carrier."""
    return contact.carrier is not None and bool(contact.carrier.nodes)


def _free(run: ReviewedRun) -> Array:
    """Samples on which the judgement is based, (n,) bool: those with all contacts open, and the last one.

    While rows close and open, energy varies by some thousandths.
    """
    rows = np.zeros(len(run.result.t), dtype=bool)
    for history in run.contacts:
        rows |= history.closed_rows > 0
    closed = rows.copy()
    closed[:-1] |= rows[1:]
    closed[1:] |= rows[:-1]
    closed[-1] = False
    return np.asarray(~closed)


def _some(samples: Array) -> Array:
    """Some of many samples, (n,) -> (m,): not each step of a long run needs a check."""
    return samples[:: len(samples) // _LOOKED_AT + 1]


def _largest(run: ReviewedRun, energies: Balance, rest: Array | float = 0.0) -> float:
    """Largest energy of bodies and contacts without `rest`, (n,) [J]; at least one just above round-off.

    That of contacts that pull is negative. It counts from its least value.
    """
    least = 0.0
    for item in run.result.bodies:
        least += 0.5 * item.body.total_mass * (_ROUND_OFF * size_of(item.body) * 2 * np.pi * item.body.f_cut) ** 2
    return max(float((energies.total - rest).max() - energies.contacts.min(initial=0.0)), least)


def _damping(run: ReviewedRun, energies: Balance) -> Iterator[Finding]:
    """Energy that damping of steps and strong damping of modes took: it should only smooth forces."""
    largest, said, remedies = _largest(run, energies), [], []
    if sum(float(body.kinetic_energy[-1]) for body in run.bodies) < _AT_REST * largest:
        return  # the purpose of damping was to find this state
    by_steps = float(energies.taken.get(STEPS, np.zeros(1))[-1])
    if by_steps > _TAKEN * largest:
        said.append(
            f"that of generalized-alpha, with steps of {run.result.step:.3g} s, {by_steps:.3g} J, "
            f"{by_steps / largest:.1%}"
        )
        remedies.append("shorter steps or a spectral_radius nearer to 1")
    by_modes = sum(_by_strong_damping(body, run.result) for body in run.bodies)
    if by_modes > _TAKEN * largest:
        said.append(f"that of modes with ratios of {_STRONG} and more {by_modes:.3g} J, {by_modes / largest:.1%}")
        remedies.append("less damping of modes")
    if said:
        yield Finding(
            f"damping took energy from the bodies, by their largest energy: {'; '.join(said)}. If the real bodies do "
            f"not lose that much, speeds after impacts are too small. Take {' and '.join(remedies)}, and means of "
            "forces where these ring"
        )


def _by_strong_damping(body: ReviewedBody, result: Result) -> float:
    """Energy that strong damping of modes took from a body [J]."""
    dampings = [
        (since, damping) for since, damping in result.dampings_of(body.item) if isinstance(damping, ModeDamping)
    ]

    def power(damping: ModeDamping, q_t: Array) -> Array:
        strong = (damping.rates >= 2 * _STRONG * damping.omega) & (damping.rates > 0)
        value: Array = damping.power(q_t)[:, strong].sum(axis=1)
        return value

    return float(damping_work(result, body.q, body.q_t, dampings, power)[-1])


def _momenta(run: ReviewedRun, bodies: Sequence[ReviewedBody], judged: Array) -> Iterator[Finding]:
    """Momenta of bodies that do not match contacts and gravity, where nothing else acts on them."""
    if not has_all_steps(run.result):
        return  # the forces between samples are not known
    t = run.result.t
    forces: dict[PartitionBody, list[Array]] = {body.item: [] for body in bodies}
    for history in run.contacts:
        for (item, _), sign in zip(history.contact.sides, (1, -1), strict=False):
            if item in forces and history.force.any():
                forces[item].append(sign * history.force_on_slave)
    for body in bodies:
        item = body.item
        momentum = item.kinematics.momentum(body.q_t)
        gained, given, force_at_end = momentum - momentum[0], np.zeros(momentum.shape), 0.0
        for force in forces[item]:
            given[1:] += np.cumsum((force[1:] + force[:-1]) / 2 * np.diff(t)[:, None], axis=0)
            force_at_end += math.hypot(*force[-1])
        if item.weight is not None:
            given += np.outer(t - t[0], item.kinematics.momentum(item.weight / item.kinematics.mass))
        speed = size_of(item.body) * 2 * np.pi * item.body.f_cut
        largest = max(
            lengths(given).max(),
            lengths(gained).max(),
            _ROUND_OFF / OFF * item.body.total_mass * speed,
            _SLIGHT / OFF * lengths(momentum).max(),
        )
        missing = lengths(gained - given)
        missing[-1] = max(missing[-1] - (t[-1] - t[-2]) * force_at_end, 0.0)  # this force acts within a step
        worst = int(judged[missing[judged].argmax()])
        if missing[worst] > OFF * largest:
            yield Finding(
                f"{called(item)}: at t = {t[worst]:.6g} s its momentum has changed by {gained[worst]} N s, while "
                f"contacts and gravity have given it {given[worst]} N s: {missing[worst] / largest:.1%} of the largest "
                "change is missing. The forces that the run tells are not those that moved the body. Take shorter "
                "steps; if that does not help, another formulation"
            )


def _energy(run: ReviewedRun, energies: Balance, samples: Array, free: Array) -> Iterator[Finding]:
    """Change of energy without a known cause: the error of the steps."""
    result, rest = run.result, energies.rest
    unsure = doubt(result)[samples]
    largest = _largest(run, energies, rest)
    lost_in_steps = result.method == "implicit" and STEPS not in energies.taken
    if lost_in_steps and (result.newmark is None or result.newmark.damps):
        unsure = unsure + np.maximum(-rest, 0.0)  # damping of the steps may have taken it
    off = np.maximum(abs(rest) - unsure, 0.0) * free[samples]
    if off.max() > OFF * largest and result.method == "explicit":
        swing = _swing(run, samples)
        off = np.minimum(off, np.maximum(abs(rest - swing + swing[0]) - unsure, 0.0))
    worst = int(off.argmax())
    if off.max() > OFF * largest:
        made = "gained" if rest[worst] > 0 else "lost"
        share = abs(rest[worst]) / largest
        of_it = f"{share:.1%} of what" if share < _MANY_TIMES else f"more than {_MANY_TIMES} times what"
        said = "".join(f", {work[worst]:.3g} J was taken by {what}" for what, work in energies.taken.items())
        said += "".join(f", {work[worst]:.3g} J was given by {what}" for what, work in energies.given.items())
        yield Finding(
            f"the bodies have {made} {abs(rest[worst]):.3g} J of energy until t = {result.t[samples[worst]]:.6g} s, "
            f"{of_it} they should have, for which nothing in the model accounts: that of bodies and contacts went "
            f"from {energies.total[0]:.4g} to {energies.total[worst]:.4g} J{said}. "
            f"{_by_steps_or_impacts(run.mbs, result, lost=rest[worst] < 0)}"
        )


def _by_steps_or_impacts(mbs: MainSystem, result: Result, *, lost: bool) -> str:
    """Sentence on the cause of energy gained, or `lost`, without a known cause, and on the remedy."""
    steps = f"the error of the steps, of {result.step:.3g} s, or of what another warning of this run tells"
    if lost and any(contact.mechanics.ahead for contact in result.contacts):
        return (
            "It is what nodes with mass lose when multipliers stop them, as in plastic impacts: a mesh that is finer "
            "where bodies touch loses less, and a basis with residual flexibility and formulation='compliance' "
            f"nothing. Or it is {steps}, and shorter ones help"
        )
    remedies = ["shorter ones"]
    if result.method == "implicit" and _runs_explicitly(mbs):
        remedies.append("method='explicit'")
    library, foreign = (Compliance, Hertz, Lagrange, Penalty), ""
    others = [contact for contact in result.contacts if not isinstance(contact.formulation, Compliance)]
    if laws := {
        type(contact.mechanics.law).__name__ for contact in others if not isinstance(contact.formulation, library)
    }:
        foreign = (
            f", or of the law {' or '.join(sorted(laws))}: check that its stored energy and its power belong to its "
            "forces, and that it keeps nothing from earlier steps"
        )
    if others:
        bases = [{item.body.basis.flexibility is not None for item, _ in contact.sides} for contact in others]
        basis = "" if all(True in flexible for flexible in bases) else "a basis with residual flexibility and "
        remedies.append(f"{basis}formulation='compliance'")
    return f"It is {steps}{foreign}. Take {', or '.join(remedies)}"


def _runs_explicitly(mbs: MainSystem) -> bool:
    """Whether explicit steps take all algebraic equations of a model."""
    if mbs.systemData.AEsize() == 0:
        return True
    try:
        Joints(mbs)
    except InputError:
        return False
    return True


def _swing(run: ReviewedRun, samples: Array) -> Array:
    """Difference of the energy of free vibration and the energy that explicit steps conserve, at samples, (m,) [J].

    Central differences conserve T + U - h^2 a M a / 8 of linear bodies.
    """
    value = np.zeros(len(samples))
    for body in run.bodies:
        q, kinematics = body.q[samples], body.item.kinematics
        if isinstance(kinematics, FloatingKinematics):
            force, mass = kinematics.elastic_force(q[:, 6:]), kinematics.mass[6:]
        else:
            force, mass = (body.item.body.stiffness @ q.T).T, kinematics.mass
        value += run.result.step**2 / 8 * np.sum(force**2 / mass, axis=1)
    return value
