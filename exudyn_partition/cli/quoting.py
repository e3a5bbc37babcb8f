"""Names of files as they stand in programs that commands write."""

from __future__ import annotations


def quoted(name: str, ending: str = "") -> str:
    """Name as a text in a program."""
    return repr(name + ending)


def escaped(text: str) -> str:
    """Text as it stands within the triple double quotes of a docstring."""
    return repr(text)[1:-1].replace('"', '\\"')
