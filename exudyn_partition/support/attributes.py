"""Attributes that a thing does not have, in an error that leads to those that are meant."""

from __future__ import annotations

import difflib
from collections.abc import Mapping


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
