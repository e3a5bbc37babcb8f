"""Warnings at the line of the user's code that called this package."""

from __future__ import annotations

import sys
import warnings

# Exudyn's solvers call functions of this package, and `with` enters its contexts through contextlib.
_PASSED = frozenset({__name__.partition(".")[0], "exudyn", "contextlib"})


def warn(text: str, category: type[Warning]) -> None:
    """Warn at the innermost line outside this package and Exudyn, among those that led here.

    Parameters
    ----------
    text : str
    category : type
        A class of `errors`.
    """
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and str(frame.f_globals.get("__name__")).partition(".")[0] in _PASSED:
        frame, level = frame.f_back, level + 1
    warnings.warn(text, category, stacklevel=level)
