"""Results of a command as a table on the terminal."""

from __future__ import annotations

from collections.abc import Iterator

from ..support.optional import require

_UNITS = {"_m_s": "m/s", "_Hz": "Hz", "_kg": "kg", "_m": "m", "_s": "s", "_N": "N", "_Pa": "Pa"}  # by ends of keys


def show(answer: dict[str, object]) -> None:
    """Print what a command found as a table."""
    table = require("rich.table").Table(show_header=False, box=None, pad_edge=False)
    for key, value in _flat(answer):
        table.add_row(*map(require("rich.markup").escape, (key, value)))
    require("rich.console").Console(soft_wrap=False).print(table)


def _flat(answer: dict[str, object]) -> Iterator[tuple[str, str]]:
    """Rows of a table, one for each entry, nested ones included; names are written in words."""
    for key, value in answer.items():
        suffix = next((suffix for suffix in _UNITS if key.endswith(suffix)), "")
        label = key.removesuffix(suffix).replace("_", " ") + (f" [{_UNITS[suffix]}]" if suffix else "")
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
    if value == "":
        return "none"
    return f"{value:.5g}" if isinstance(value, float) else str(value)
