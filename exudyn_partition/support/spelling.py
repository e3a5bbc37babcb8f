"""Arguments in another spelling: errors that name the one that is meant."""

from __future__ import annotations

import difflib
import functools
import inspect
from collections.abc import Callable
from typing import Any, TypeVar, cast

F = TypeVar("F", bound=Callable[..., Any])


def spelled(function: F) -> F:
    """Let calls with an argument that the function does not have end in an error that names the one that is meant.

    Two spellings stand side by side in a script: Exudyn's `initialVelocity` and Python's `end_time`.
    """
    known = [*inspect.signature(function).parameters]

    @functools.wraps(function)
    def called(*args: Any, **options: Any) -> Any:
        for name in options:
            if name not in known:
                raise TypeError(f"{function.__name__}() has no argument {name!r}. {_meant(name, known)}")
        return function(*args, **options)

    return cast(F, called)


def _meant(name: str, known: list[str]) -> str:
    """Which of the known arguments is meant by a name, or which there are."""
    plain = {option.replace("_", "").lower(): option for option in reversed(known)}
    near = difflib.get_close_matches(name.replace("_", "").lower(), plain, n=2, cutoff=0.7)
    return f"Take {' or '.join(plain[one] for one in near)}" if near else f"It has {', '.join(known)}"
