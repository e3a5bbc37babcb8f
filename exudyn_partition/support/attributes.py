"""Attributes: those that are found once, that `dir` shows, and that are meant instead of one that is not there."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Collection, Mapping
from typing import Any, Generic, TypeVar

T = TypeVar("T")


class FoundOnce(Generic[T]):
    """Property whose value is found when somebody asks first, and kept.

    It is that of `functools.cached_property` without its lock, which takes half a microsecond up to Python 3.11.
    """

    def __init__(self, find: Callable[[Any], T]) -> None:
        self._find, self.__doc__ = find, find.__doc__

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, thing: Any, owner: type | None = None) -> T:
        if thing is None:
            return self  # type: ignore[return-value]
        value = vars(thing)[self._name] = self._find(thing)
        return value


def copied(thing: T) -> T:
    """Copy of an object that has the same attributes; `copy.copy` takes several times as long."""
    result: T = object.__new__(type(thing))
    vars(result).update(vars(thing))
    return result


def no_attribute(thing: object, name: str, meant: Mapping[str, str]) -> AttributeError:
    """Error of an attribute that is not there.

    Parameters
    ----------
    thing : object
    name : str
    meant : mapping of str to str
        What to take instead of names that are tried often.
    """
    said = f"{type(thing).__name__} has no attribute {name!r}"
    public = [known for known in dir(thing) if not known.startswith("_")]
    near = meant.get(name) or ", ".join(difflib.get_close_matches(name, public)[:2])
    return AttributeError(f"{said}. Take {near}" if near else f"{said}; it has {', '.join(public)}")


def for_users(thing: object, inside: Collection[str]) -> list[str]:
    """Names that `dir` shows of a thing: those that its users may take, without the ones that only the library needs.

    Parameters
    ----------
    thing : object
    inside : collection of str
        Public names that only the library needs.
    """
    names = object.__dir__(thing)
    return sorted(name for name in names if name not in inside and (name[0] != "_" or name.startswith("__")))
