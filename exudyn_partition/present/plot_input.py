"""Arguments of module `plot`, checked, and labels for matplotlib."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from ..errors import InputError
from ..exudyn_bodies.partition_body import PartitionBody
from ..exudyn_contacts.partition_contact import PartitionContact
from ..exudyn_contacts.run_result import RunResult as Result
from ..results.compare import Comparison
from ..results.history import History
from ..support.checks import validate_choice, validate_items, validate_result, validate_type, validate_vector
from ..support.foreign import Axes
from ..support.optional import require

_SIZE = (6.0, 3.4)  # inches: one and a half columns of a page
_LONGEST_LABEL = 50  # characters


def plain(text: object) -> str:
    """Text for matplotlib: dollars, which begin mathematics there, are escaped, and long names are cut."""
    said = str(text)
    if len(said) > _LONGEST_LABEL:
        said = said[: _LONGEST_LABEL - 3] + "..."
    return said.replace("$", r"\$")


def validate_bodies(bodies: Sequence[PartitionBody]) -> list[PartitionBody]:
    """Return bodies as a list, or raise `InputError`."""
    return validate_items("bodies", bodies, PartitionBody, "CreatePartitionBody()")


def axes_of(axes: Axes) -> Axes:
    """Return the axes; for None, those of a new figure."""
    if axes is None:
        return require("matplotlib.figure").Figure(figsize=_SIZE, layout="constrained").subplots()
    if not isinstance(axes, require("matplotlib.axes").Axes):
        raise InputError(f"axes: expected those of matplotlib, or None for a new figure, got {type(axes).__name__}")
    return axes


def check_samples(result: Result, name: str = "result") -> None:
    """Raise unless it is a Result with samples."""
    validate_result(result, name)
    if not len(result.t):
        raise InputError(f"{name}: the run kept no samples ({result.message})")


def contact_of(result: Result, contact: PartitionContact | None, name: str = "result") -> PartitionContact:
    """Return the contact; for None, the only one of the run."""
    check_samples(result, name)
    if contact is not None:
        validate_type("contact", contact, PartitionContact, "CreatePartitionContact()")
        return contact
    if len(result.contacts) != 1:
        raise InputError(
            f"contact: expected one of the run's {len(result.contacts)} contacts{_names(result.contacts)}, as "
            "CreatePartitionContact returned it, got none"
        )
    return result.contacts[0]


def _names(things: Sequence[PartitionBody | PartitionContact]) -> str:
    return f" ({', '.join(repr(one.name) if one.name else 'one without a name' for one in things)})" if things else ""


def history_of(run: History | Result, contact: PartitionContact | None) -> History:
    """Return the history itself, or that of a contact of a Result."""
    if not isinstance(run, History):
        chosen = contact_of(run, contact, "run")
        return run.history(chosen)
    if contact is not None:
        raise InputError("contact: a History has one force; name a contact of a Result")
    return run


def history_of_point(run: History | Result, point: object, body: PartitionBody | None) -> tuple[History, str]:
    """Return a history with the velocity of a point, and the name of the point in it."""
    if isinstance(run, History):
        if body is not None:
            raise InputError("body: a History has points by their names; name a body of a Result")
        return run, validate_choice("point", point, run.velocity)
    check_samples(run, "run")
    if isinstance(point, str):
        raise InputError(f"point: a Result has no named points; give a point of a body, (3,) [m], instead of {point!r}")
    place = validate_vector("point", point)
    if body is None:
        if len(run.bodies) != 1:
            raise InputError(
                f"body: expected one of the run's {len(run.bodies)} bodies{_names(run.bodies)}, as "
                "CreatePartitionBody returned it, got none"
            )
        body = run.bodies[0]
    validate_type("body", body, PartitionBody, "CreatePartitionBody()")
    name = "(" + ", ".join(f"{1e3 * x:.4g}" for x in place) + ") mm"
    return History(run.t, np.zeros(len(run.t)), {name: body.velocity(run, place)}, {"label": body.name}), name


def label_of(history: History) -> str | None:
    """Label of a history in the legend."""
    label = history.info.get("label")
    return None if label is None else plain(label)


def labelled(runs: Mapping[str, Comparison] | Iterable[tuple[str, Comparison]]) -> dict[str, Comparison]:
    """Return a dict of comparisons by label."""
    try:
        return dict(runs)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"runs: expected a dict of labels and comparisons, or pairs of them, got {type(runs).__name__}"
        ) from error


def name_of(item: PartitionBody | PartitionContact, otherwise: str) -> str:
    """Name of a body or contact; `otherwise` if it has none."""
    return item.name or otherwise
