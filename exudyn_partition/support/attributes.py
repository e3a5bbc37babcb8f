"""Attributes: those that `dir` shows, and in an error those that are meant instead of one that is not there."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Mapping


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
