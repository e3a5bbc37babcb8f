"""Checks of each run: momenta of free bodies against all impulses, and energy against all known causes of change."""

from __future__ import annotations

import warnings

import numpy as np
from scipy.integrate import cumulative_trapezoid

from ..contact.formulations.choices import Compliance
from ..errors import InputError, ModelLimitWarning
from ..exudyn_bodies.item_work import Others
from ..exudyn_bodies.joints import Joints
from ..exudyn_bodies.model import is_ours, user_function
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.balance import STEPS, Balance, doubt, has_all_steps
from ..exudyn_contacts.partition_contact import PartitionContact
from ..frames.damping import ModeDamping
from ..frames.floating import FloatingKinematics
from ..support.arrays import Array
from ..support.foreign import MainSystem
from .result import Result, called

_OFF = 1e-2  # share of the bodies' largest energy, or largest change of momentum, that may be missing
_TAKEN = 2e-2  # share of the largest energy that damping of steps, and strong damping of modes, may take
_AT_REST = 1e-3  # share of the largest energy: a run that ends with less kinetic energy has reached a state at rest
_STRONG = 0.2  # damping ratio of a mode above which its damping is strong
_MANY_TIMES = 10  # ratio to the expected value above which a share in percent is not useful
_OFF_IN_CONTACT = 1e-3  # share of the energy of the largest velocities that long steps may make or lose in contact
_LOOKED_AT = 256  # largest number of samples that are checked
_ROUND_OFF = 1e-11  # share of the speed of one body size in a period of f_cut: slower motion is round-off
_SLIGHT = 1e-6  # share of a body's momentum: a smaller change may be what Newton's method has left
_PACKAGE = __name__.partition(".")[0]


def warn_of_balance(mbs: MainSystem, result: Result) -> None:
    """Warn of energy or momentum that a run lost or produced, as far as its samples show it."""
    if result.method == "static" or result.status == "unstable" or len(result.t) < 3 or not result.bodies:
        return
    free = _free(result)
    some = np.unique(np.r_[0, _some(np.arange(len(free))), _some(np.flatnonzero(free)), len(free) - 1])
    balance = Balance.of(result, some)
    others, exchanges = Others.of(mbs, told=result.item_work is not None), any(map(_exchanges, result.contacts))
    if not others.driven and not exchanges:  # otherwise energy that was taken may come back
        _warn_of_damping(result, balance)
    functions = mbs.GetPreStepUserFunction(), mbs.GetPostStepUserFunction()
    if any(user_function(entry) is not None and not is_ours(entry) for entry in functions):
        return  # a user function may have changed anything
    for item in result.bodies:
        if id(item) not in others.bodies:
            _warn_of_momentum(item, result, np.flatnonzero(free))
    if not others.not_told and not exchanges and not any(map(_lacks_inertia, result.bodies)):
        _warn_of_energy(mbs, result, balance, some, free)


def warn_of_long_steps(share: float) -> None:
    """Warn if steps that grew in lasting contact made or lost a share of the energy of the largest velocities."""
    if abs(share) > _OFF_IN_CONTACT:
        warnings.warn(
            f"steps that grew in lasting contact have {'made' if share > 0 else 'lost'} {abs(share):.2%} of the energy "
            "of the largest velocities: the work of the contact forces in them differs from what contacts store and "
            "dissipate. Take a smaller velocity_tolerance",
            ModelLimitWarning,
            stacklevel=3,
        )


def _lacks_inertia(item: PartitionBody) -> bool:
    """Whether inertia forces are left out. Energy is not conserved without them."""
    return any("(inertiaTerms)" in said for said in item.left_out)


def _exchanges(contact: PartitionContact) -> bool:
    """Whether a contact gives energy to a carrier, or has a user's formulation with an energy of its own."""
    of_user = not type(contact.mechanics).__module__.startswith(f"{_PACKAGE}.")
    return bool(contact.carrier is not None and contact.carrier.nodes) or (of_user and not contact.elastic)


def _free(result: Result) -> Array:
    """Samples on which the judgement is based, (n,) bool: those with all contacts open, and the last one.

    While rows close and open, energy varies by some thousandths.
    """
    closed = np.zeros(len(result.t), dtype=bool)
    for contact in result.contacts:
        rows = contact.closed_rows(result) > 0
        closed |= rows | np.r_[rows[1:], False] | np.r_[False, rows[:-1]]
    closed[-1] = False
    return ~closed


def _some(samples: Array) -> Array:
    """Some of many samples, (n,) -> (m,): not each step of a long run needs a check."""
    return samples[:: len(samples) // _LOOKED_AT + 1]


def _largest(result: Result, energy: Array) -> float:
    """Largest energy of bodies and contacts [J], from all samples, (n,) [J]; at least one just above round-off."""
    least = 0.0
    for item in result.bodies:
        size = np.ptp(item.body.points, axis=0).max()
        least += 0.5 * item.body.total_mass * float(_ROUND_OFF * size * 2 * np.pi * item.body.f_cut) ** 2
    return max(float(energy.max()), least)


def _warn_of_damping(result: Result, balance: Balance) -> None:
    """Warn of energy that damping of steps and strong damping of modes took: it should only smooth forces."""
    largest, said, remedies = _largest(result, balance.total), [], []
    if _kinetic_at_end(result) < _AT_REST * largest:
        return  # the purpose of damping was to find this state
    by_steps = float(balance.taken.get(STEPS, np.zeros(1))[-1])
    if by_steps > _TAKEN * largest:
        said.append(
            f"that of generalized-alpha, with steps of {result.step:.3g} s, {by_steps:.3g} J, {by_steps / largest:.1%}"
        )
        remedies.append("shorter steps or a spectral_radius nearer to 1")
    by_modes = sum(_by_strong_damping(item, result) for item in result.bodies)
    if by_modes > _TAKEN * largest:
        said.append(f"that of modes with ratios of {_STRONG} and more {by_modes:.3g} J, {by_modes / largest:.1%}")
        remedies.append("less damping of modes")
    if said:
        warnings.warn(
            f"damping took energy from the bodies, by their largest energy: {'; '.join(said)}. If the real bodies do "
            f"not lose that much, speeds after impacts are too small. Take {' and '.join(remedies)}, and means of "
            "forces where these ring",
            ModelLimitWarning,
            stacklevel=4,
        )


def _kinetic_at_end(result: Result) -> float:
    """Kinetic energy of the bodies at the end [J]."""
    last = result.at(result.t[-1:])
    energies = [
        item.kinematics.kinetic_energy(item.coordinates(last), item.coordinates_t(last))[0] for item in result.bodies
    ]
    return float(sum(energies))


def _by_strong_damping(item: PartitionBody, result: Result) -> float:
    """Energy that strong damping of modes took from a body [J]."""
    q_t, power = item.coordinates_t(result), np.zeros(len(result.t))
    for since, damping in result.dampings_of(item):
        if isinstance(damping, ModeDamping):
            then = result.t >= since
            strong = (damping.rates >= 2 * _STRONG * damping.omega) & (damping.rates > 0)
            power[then] = damping.power(q_t[then])[:, strong].sum(axis=1)
    return float(np.trapezoid(power, result.t))


def _warn_of_momentum(item: PartitionBody, result: Result, judged: Array) -> None:
    """Warn if the momentum of a body does not match contacts and gravity, where nothing else acts on it."""
    if not has_all_steps(result):
        return  # the forces between samples are not known
    t = result.t
    gained = item.momentum(result) - item.momentum(result)[0]
    given, force_at_end = np.zeros_like(gained), 0.0
    for contact in result.contacts:
        for (side, _), sign in zip(contact.sides, (1, -1), strict=False):
            if side == item:
                force = contact.force_on_slave(result)
                given += sign * cumulative_trapezoid(force, t, axis=0, initial=0.0)
                force_at_end += float(np.linalg.norm(force[-1]))
    if item.weight is not None:
        given += np.outer(t - t[0], item.kinematics.momentum(item.weight / item.kinematics.mass))
    size = np.ptp(item.body.points, axis=0).max() * 2 * np.pi * item.body.f_cut
    largest = max(
        float(np.linalg.norm(given, axis=1).max()),
        float(np.linalg.norm(gained, axis=1).max()),
        _ROUND_OFF / _OFF * item.body.total_mass * size,
        _SLIGHT / _OFF * float(np.linalg.norm(item.momentum(result), axis=1).max()),
    )
    missing = np.linalg.norm(gained - given, axis=1)
    missing[-1] = max(missing[-1] - (t[-1] - t[-2]) * force_at_end, 0.0)  # this force acts within a step
    worst = int(judged[missing[judged].argmax()])
    if missing[worst] > _OFF * largest:
        warnings.warn(
            f"{called(item)}: at t = {t[worst]:.6g} s its momentum has changed by {gained[worst]} N s, while contacts "
            f"and gravity have given it {given[worst]} N s: {missing[worst] / largest:.1%} of the largest change is "
            "missing. The forces that the run tells are not those that moved the body. Take shorter steps; if that "
            "does not help, another formulation",
            ModelLimitWarning,
            stacklevel=4,
        )


def _warn_of_energy(mbs: MainSystem, result: Result, balance: Balance, samples: Array, free: Array) -> None:
    """Warn of a change of energy without a known cause: the error of the steps."""
    rest, unsure = balance.rest, doubt(result)[samples]
    largest = _largest(result, balance.total - rest)
    lost_in_steps = result.method == "implicit" and STEPS not in balance.taken
    if lost_in_steps and (result.newmark is None or result.newmark.damps):
        unsure = unsure + np.maximum(-rest, 0.0)  # damping of the steps may have taken it
    off = np.maximum(abs(rest) - unsure, 0.0) * free[samples]
    if off.max() > _OFF * largest and result.method == "explicit":
        swing = _swing(result, samples)
        off = np.minimum(off, np.maximum(abs(rest - swing + swing[0]) - unsure, 0.0))
    worst = int(off.argmax())
    if off.max() > _OFF * largest:
        made = "gained" if rest[worst] > 0 else "lost"
        share = abs(rest[worst]) / largest
        of_it = f"{share:.1%} of what" if share < _MANY_TIMES else f"more than {_MANY_TIMES} times what"
        said = "".join(f", {work[worst]:.3g} J was taken by {what}" for what, work in balance.taken.items())
        said += "".join(f", {work[worst]:.3g} J was given by {what}" for what, work in balance.given.items())
        warnings.warn(
            f"the bodies have {made} {abs(rest[worst]):.3g} J of energy until t = {result.t[samples[worst]]:.6g} s, "
            f"{of_it} they should have, for which nothing in the model accounts: that of bodies and contacts went "
            f"from {balance.total[0]:.4g} to {balance.total[worst]:.4g} J{said}. "
            f"{_by_steps_or_impacts(mbs, result, lost=rest[worst] < 0)}",
            ModelLimitWarning,
            stacklevel=4,
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
    others = [contact for contact in result.contacts if not isinstance(contact.formulation, Compliance)]
    if others:
        bases = [{item.body.basis.flexibility is not None for item, _ in contact.sides} for contact in others]
        basis = "" if all(True in flexible for flexible in bases) else "a basis with residual flexibility and "
        remedies.append(f"{basis}formulation='compliance'")
    return f"It is {steps}. Take {', or '.join(remedies)}"


def _runs_explicitly(mbs: MainSystem) -> bool:
    """Whether explicit steps take all algebraic equations of a model."""
    if mbs.systemData.AEsize() == 0:
        return True
    try:
        Joints(mbs)
    except InputError:
        return False
    return True


def _swing(result: Result, samples: Array) -> Array:
    """Difference of the energy of free vibration and the energy that explicit steps conserve, at samples, (m,) [J].

    Central differences conserve T + U - h^2 a M a / 8 of linear bodies.
    """
    value = np.zeros(len(samples))
    for item in result.bodies:
        q, kinematics = item.coordinates(result)[samples], item.kinematics
        if isinstance(kinematics, FloatingKinematics):
            force, mass = kinematics.elastic_force(q[:, 6:]), kinematics.mass[6:]
        else:
            force, mass = (item.body.stiffness @ q.T).T, kinematics.mass
        value += result.step**2 / 8 * np.sum(force**2 / mass, axis=1)
    return value
