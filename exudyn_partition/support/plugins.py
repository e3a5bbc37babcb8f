"""What other packages add by entry points: they are found by group and name, and imported when somebody asks."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from ..errors import InputError
from .checks import validate_choice

_GROUPS = "exudyn_partition."  # begins the name of each group


def plugin(group: str, name: str) -> Any:
    """Object that an installed package adds to a group, such as "bases", by this name; None if there is none.

    Raises
    ------
    InputError
        If it cannot be imported, or several packages add different ones.
    """
    points = list(entry_points(group=_GROUPS + group, name=name))
    if not points:
        return None
    if len({point.value for point in points}) > 1:
        raise InputError(f"{group}: expected one package with {name!r}, got {_listed(points)}; uninstall the others")
    try:
        return points[0].load()
    except (ImportError, AttributeError) as error:
        raise InputError(
            f"{group}: {name!r} of {_listed(points[:1])} cannot be imported ({error}); install or update that package"
        ) from error


def added_choice(name: str, value: object, choices: Iterable[str], group: str) -> Any:
    """Object that a package adds to a group by the name `value`; None if that is one of our own `choices`.

    Raises
    ------
    InputError
        If it is neither: the message has both.
    """
    known = list(choices)
    ours = isinstance(value, str) and value in known
    if isinstance(value, str) and not ours and (choice := plugin(group, value)) is not None:
        return choice
    added = [] if ours else sorted({point.name for point in entry_points(group=_GROUPS + group)})
    validate_choice(name, value, [*known, *added])
    return None


def _listed(points: list[EntryPoint]) -> str:
    """Packages and objects of entry points."""
    return ", ".join(f"{point.dist.name if point.dist else 'a package'} ({point.value})" for point in points)
