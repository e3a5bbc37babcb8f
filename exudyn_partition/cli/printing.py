"""Results of a command as a table on the terminal."""

from __future__ import annotations

from collections.abc import Iterator

from ..support.optional import require


def show(found: dict[str, object]) -> None:
    """Print what a command found as a table."""
    table = require("rich.table").Table(show_header=False, box=None, pad_edge=False)
    for key, value in _flat(found):
        table.add_row(*map(require("rich.markup").escape, (key, value)))
    require("rich.console").Console(soft_wrap=False).print(table)


def _flat(found: dict[str, object]) -> Iterator[tuple[str, str]]:
    """Rows of a table, one for each entry, nested ones included; names are written in words."""
    for key, value in found.items():
        name, _, unit = key.rpartition("_")
        known = unit in ("Hz", "kg", "m", "s", "N")
        label = f"{name} [{unit}]".replace("_", " ") if known else key.replace("_", " ")
        if isinstance(value, dict):
            yield from ((f"{label}: {inner}", text) for inner, text in _flat(value))
        elif isinstance(value, list) and value and not isinstance(value[0], float):
            for i, entry in enumerate(value):
                said = ", ".join(f"{k} {v}" for k, v in _flat(entry)) if isinstance(entry, dict) else str(entry)
                yield (label if i == 0 else "", said)
        else:
            yield label, _text(value)


def _text(value: object) -> str:
    if isinstance(value, list):
        return "(" + ", ".join(_text(x) for x in value) + ")" if value else "none"
    if value is None:
        return "without end"
    return f"{value:.5g}" if isinstance(value, float) else str(value)
