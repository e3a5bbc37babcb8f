"""Warnings at the line of the user's code that called this package."""

from __future__ import annotations

import sys
import warnings

_PACKAGE = __name__.partition(".")[0]
# Calls pass through these where a user's line calls this package by a context manager, a pool or Exudyn's solvers.
_BETWEEN = frozenset({_PACKAGE, "exudyn", "contextlib", "functools", "concurrent", "threading"})


def warn(text: str, category: type[Warning]) -> None:
    """Warn at the first line outside this package and outside Exudyn, of those that led here.

    Parameters
    ----------
    text : str
    category : type
        A warning of `errors`.
    """
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and _root(frame.f_globals) in _BETWEEN:
        frame, level = frame.f_back, level + 1
    warnings.warn(text, category, stacklevel=level)


def _root(names: dict[str, object]) -> str:
    """Name of the outermost package of a module with these names."""
    return str(names.get("__name__", "")).partition(".")[0]
