"""What rings in lasting contact, and keeps adaptive steps as short as in an impact."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ...exudyn_bodies.damping_work import has_all_steps
from ...exudyn_bodies.partition_body import PartitionBody
from ...exudyn_contacts.partition_contact import PartitionContact
from ...support.arrays import Array
from ...support.optional import require
from ..result import Result, called
from .reviewed_run import Finding, ReviewedRun

_LONG = 1000  # steps of an impact: what is closed for longer lasts
_MOST = 0.5  # share of the steps of a closed contact: it keeps them short if more are no longer than in an impact
_SAME = 1.01  # ratio of steps that are the same
_PERIODS = 10  # of the ringing, over which its energy is averaged


def lasting_ringing(run: ReviewedRun) -> Iterator[Finding]:
    """Contacts whose ringing kept most steps of an adaptive run short: frequency and share of the energy."""
    result = run.result
    if run.equal_steps or run.solver is not None or not has_all_steps(result) or result.method != "implicit":
        return
    largest = 0.0
    for history in run.contacts:
        for first, last in history.spans:
            t = result.t[first : last + 1]
            short = np.count_nonzero(np.diff(t) < _SAME * result.step)
            if t[-1] - t[0] < _LONG * result.step or short < _MOST * len(t):
                continue
            frequency = ringing_frequency(t, history.force[first : last + 1], result.step)
            if not largest:
                of_bodies = [body.energy for body in run.bodies]
                whole = np.sum([*of_bodies, *(each.energy(result) for each in result.contacts)], axis=0)
                largest = max(float(whole.max()), np.finfo(float).tiny)
            swings = _swinging(history.contact, result, max(t[0], t[-1] - _PERIODS / frequency), t[-1])
            yield Finding(
                f"{called(history.contact)}: rings at {1e-3 * frequency:.3g} kHz from t = {t[0]:.4g} to {t[-1]:.4g} s, "
                f"at the end with {swings / largest:.2g} of the largest energy, and keeps {short} steps as short as in "
                "an impact. If its parts have damping, say so by damping= of CreatePartitionBody: steps grow when the "
                "ringing is gone",
                category=None,
            )


def ringing_frequency(t: Array, force: Array, step: float) -> float:
    """Frequency at which a force at times t, (n,), varies most about its trend [Hz]; `step` is the shortest [s]."""
    equal = np.linspace(t[0], t[-1], max(16, round((t[-1] - t[0]) / step)))
    varying = require("scipy.signal").detrend(np.interp(equal, t, force)) * np.hanning(len(equal))
    spectrum = abs(np.fft.rfft(varying, 4 * len(equal)))
    frequencies = np.fft.rfftfreq(4 * len(equal), equal[1] - equal[0])
    above = frequencies > 2 / (t[-1] - t[0])  # slower changes are no ringing
    return float(frequencies[above][spectrum[above].argmax()])


def _swinging(contact: PartitionContact, result: Result, start: float, end: float) -> float:
    """Energy of the vibration of a contact's bodies [J]: twice the mean kinetic energy about their slow motion."""
    some = result.at(result.t[(result.t >= start) & (result.t <= end)])
    bodies: Sequence[PartitionBody] = [item for item, _ in contact.sides]
    detrend = require("scipy.signal").detrend
    return float(sum((detrend(b.coordinates_t(some), axis=0) ** 2).mean(axis=0) @ b.kinematics.mass for b in bodies))
