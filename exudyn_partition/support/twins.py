"""A second state that goes on from where a first one stands, which stays as it is."""

from __future__ import annotations

import copy
import dataclasses
from typing import TypeVar

import numpy as np

State = TypeVar("State")
Known = dict[int, tuple[object, object]]  # what has a twin already, by identity, with the twin

_PACKAGES = tuple(f"{__package__.partition('.')[0]}.{name}." for name in ("algebra", "contact", "surfaces"))


def twin(state: State, known: Known) -> State:
    """Return a state that is equal, and shares nothing with the first one that may change.

    What refers to one object in two places does so in the twin. Values that do not change are shared: dataclasses,
    arrays that cannot be written, matrices, functions, and all that is of no class of a state. A class of which that
    would be wrong has a method `twin(known)`.

    Parameters
    ----------
    state : object
        An object with attributes.
    known : dict
        Twins so far. The same dict for states that refer to each other.
    """
    if id(state) not in known:
        own = getattr(state, "twin", None)
        known[id(state)] = state, copied(state, known) if own is None else own(known)
    found: State = known[id(state)][1]  # type: ignore[assignment]
    return found


def copied(state: State, known: Known) -> State:
    """Return the twin of an object by those of its attributes."""
    result = copy.copy(state)
    known[id(state)] = state, result
    for name, value in vars(state).items():
        object.__setattr__(result, name, _value(value, known))
    return result


def _value(value: object, known: Known) -> object:
    """Twin of a value, or the value itself if it does not change."""
    if id(value) in known:
        return known[id(value)][1]
    made: object = value
    match value:
        case np.ndarray():
            made = value.copy(order="K") if value.flags.writeable else value
        case list():
            made = [_value(item, known) for item in value]
        case dict():
            made = {key: _value(item, known) for key, item in value.items()}
        case tuple():
            items = [_value(item, known) for item in value]
            made = type(value)._make(items) if hasattr(value, "_make") else tuple(items)
        case _ if _is_state(value):
            return twin(value, known)
        case _:
            return value
    known[id(value)] = value, made
    return made


def _is_state(value: object) -> bool:
    """Whether it is of a class of states; dataclasses do not change, and compiled structures have a twin elsewhere."""
    kind = type(value)
    constant = dataclasses.is_dataclass(kind) or hasattr(kind, "_numba_type_") or isinstance(value, type)
    of_package = any(base.__module__.startswith(_PACKAGES) for base in kind.__mro__)  # or derived, as own laws
    return of_package and hasattr(value, "__dict__") and not constant
