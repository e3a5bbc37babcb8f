"""Values that are found once for each object, and kept as long as it lives."""

from __future__ import annotations

import functools
from collections.abc import Callable, Hashable
from typing import TypeVar, cast
from weakref import WeakKeyDictionary

Find = TypeVar("Find", bound=Callable[..., object])


def once(find: Find) -> Find:
    """Keep what a function finds of an object, and of hashable further arguments, as long as the object lives.

    The object must not change, and the value must not hold it. Values may be lost at any time: they are found again.
    """
    kept: WeakKeyDictionary[object, dict[tuple[Hashable, ...], object]] = WeakKeyDictionary()

    @functools.wraps(find)
    def kept_or_found(of: object, *others: Hashable) -> object:
        values = kept.setdefault(of, {})
        if others not in values:
            values[others] = find(of, *others)
        return values[others]

    return cast(Find, kept_or_found)
