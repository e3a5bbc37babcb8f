"""What is in an Exudyn model: its indices by name."""

from __future__ import annotations

from collections.abc import Collection
from typing import ClassVar, TypeVar

from .attributes import for_users

V = TypeVar("V")


class Item(dict[str, V]):
    """Indices by name. An item equals itself alone, for items of two models may well have the same indices.

    So `==` and `in` ask which item is meant, and items may be keys. `dir` leaves out what would change the indices.
    """

    _inside: ClassVar[Collection[str]] = ()  # public names that only the library needs

    __eq__ = object.__eq__
    __ne__ = object.__ne__
    __hash__ = object.__hash__  # type: ignore[assignment]  # dicts have none

    def __dir__(self) -> list[str]:
        changing = {"clear", "copy", "fromkeys", "pop", "popitem", "setdefault", "update"}
        return for_users(self, changing | {*self._inside})
