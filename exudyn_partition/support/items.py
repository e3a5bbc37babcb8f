"""What is in an Exudyn model: its indices by name."""

from __future__ import annotations

from typing import TypeVar

V = TypeVar("V")


class Item(dict[str, V]):
    """Indices by name. An item equals itself alone, for items of two models may well have the same indices.

    So `==` and `in` ask which item is meant, and items may be keys.
    """

    __eq__ = object.__eq__
    __ne__ = object.__ne__
    __hash__ = object.__hash__  # type: ignore[assignment]  # dicts have none
