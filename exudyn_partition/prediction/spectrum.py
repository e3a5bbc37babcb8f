"""Frequency content of a signal, and the truncation frequency that it asks for (paper, section 5.2).

Theory: examples/site/theory.md, "Hertz's impact and first yield".
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from ..errors import FrequencyRangeError, InputError
from ..support.arrays import Array
from ..support.checks import validate_array, validate_choice, validate_positive

Window = Literal["none", "hann"]
_WINDOWS: tuple[Window, ...] = get_args(Window)
_LARGEST = 1e150  # the transform of larger numbers may not be finite
_FINE = 2**19  # least number of samples with added zeros, which make the bins of the spectrum narrow


def truncation_frequency(t: Array, x: Array, *, tolerance: float = 0.01, window: Window = "none") -> float:
    """Twice the highest frequency of a signal, up to which a body's modes are to be kept (paper, section 5.2).

    The highest frequency is the lowest f_h at which an ideal low-pass changes the signal by `tolerance` in the L2 norm,
    the measure of `compare`. By Parseval's theorem, the energy above it is tolerance^2 of the whole,

        int_{f_h}^inf abs(X(f))^2 df = tolerance^2 int_0^inf abs(X(f))^2 df.

    For the force on a wave impedance, or the velocity behind one, this is the share of the energy that leaves as waves.
    The integral depends neither on single bins of the spectrum nor on the sampling, if that is fine enough. For a pulse
    it does not depend on the length of the record.

    Parameters
    ----------
    t : (n,) array
        Times, equally spaced [s].
    x : (n,) array
        Signal, such as a contact force [N] or one component of a velocity [m/s].
    tolerance : float
        Relative L2 error of the signal without its content above the highest frequency, in (0, 1).
    window : {"none", "hann"}
        "none" for pulses that begin and end at rest, such as a contact force: the signal is zero outside its record.
        "hann" for a vibration that continues after its record, such as a velocity after the impact. The mean is removed
        and the ends are faded out, since an abrupt end would count as high frequencies. Lines are then wider by two
        over the length of the record, and events near its ends hardly count.

    Returns
    -------
    float
        2 f_h [Hz], for `f_cut` of `reduce`.

    Raises
    ------
    InputError
        If the times are not equally spaced, the signal does not change, or it does not end at rest without a window.
    FrequencyRangeError
        If 2 f_h lies above half the sampling rate, so that the record does not show where its content ends.
    """
    tolerance = validate_positive("tolerance", tolerance)
    if tolerance >= 1:
        raise InputError(f"tolerance: expected a relative error in (0, 1), got {tolerance!r}")
    t, x = _validate_signal(t, x)
    if np.ptp(x) == 0:
        raise InputError(f"x: expected a signal that changes, got {x[0]:.4g} throughout")
    if validate_choice("window", window, _WINDOWS) == "none" and max(abs(x[0]), abs(x[-1])) > tolerance * abs(x).max():
        raise InputError(
            f"x: expected a pulse that begins and ends at rest, got {x[0]:.4g} and {x[-1]:.4g} at the ends, "
            f'with a largest value of {abs(x).max():.4g}; record the whole pulse, or use window="hann" for a vibration'
        )
    f, amplitude = amplitude_spectrum(t, x / abs(x).max(), window=window)
    energy = (amplitude / amplitude.max()) ** 2
    bins = (energy[1:] + energy[:-1]) / 2
    above = np.append(np.cumsum(bins[::-1])[::-1], 0)
    highest = np.interp(tolerance**2 * above[0], above[::-1], f[::-1])
    if 2 * highest > f[-1]:
        raise FrequencyRangeError(
            f"x: holds frequencies up to {highest:.4g} Hz, too near to half its sampling rate, {f[-1]:.4g} Hz, to tell "
            "where its content ends; sample finer, filter its noise, or set a larger tolerance"
        )
    return float(2 * highest)


def amplitude_spectrum(t: Array, x: Array, *, window: Window = "none") -> tuple[Array, Array]:
    """Magnitude of the Fourier integral of a signal, abs(X(f)) = abs(int x(t) exp(-2 pi i f t) dt).

    Parameters
    ----------
    t : (n,) array
        Times, equally spaced [s].
    x : (n,) array
        Signal.
    window : {"none", "hann"}
        As for `truncation_frequency`.

    Returns
    -------
    (m,) array
        Frequencies, from 0 to half the sampling rate [Hz].
    (m,) array
        abs(X) in the signal's unit times seconds: at f = 0 of a force, its impulse.

    Raises
    ------
    InputError
        If the times are not equally spaced.
    """
    t, x = _validate_signal(t, x)
    if validate_choice("window", window, _WINDOWS) == "hann":
        weight = np.hanning(len(x))
        x = weight * (x - np.average(x, weights=weight))
    step = (t[-1] - t[0]) / (len(t) - 1)
    padded = max(8 << len(x).bit_length(), _FINE)
    return np.fft.rfftfreq(padded, step), step * np.abs(np.fft.rfft(x, padded))


def _validate_signal(t: Array, x: Array) -> tuple[Array, Array]:
    t = validate_array("t", t, (None,))
    x = validate_array("x", x, (len(t),))
    if abs(x).max(initial=0.0) > _LARGEST:
        raise InputError(f"x: expected numbers up to {_LARGEST:g}, got {abs(x).max():.4g}")
    step = np.diff(t)
    if len(t) < 3 or step.min() <= 0 or np.ptp(step) > 1e-3 * step.mean():
        raise InputError("t: expected at least three times, ascending and equally spaced; resample, as by numpy.interp")
    return t, x
