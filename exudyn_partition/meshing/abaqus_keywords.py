"""Keywords of input decks of Abaqus and CalculiX, with comments anywhere, continued lines and included files."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from ..errors import InputError
from .deck_lines import OUTSIDE_QUOTES, Line

_INCLUDES = re.compile(r"\*\s*(INCLUDE|NODE|ELEMENT)\s*,.*\bINPUT\s*=", re.IGNORECASE)
_DEEPEST = 20  # files that include files


@dataclass
class Block:
    """A keyword, in capitals without its asterisk and blanks; its options; its line, and the lines of its data."""

    name: str
    options: dict[str, str]
    line: Line
    data: list[Line] = field(default_factory=list)

    def option(self, name: str) -> str:
        """Return an option's value; MeshError if it is not given."""
        if not self.options.get(name):
            raise self.line.refuse(f"*{self.name} needs {name}=")
        return self.options[name]


def blocks(path: Path) -> Iterator[Block]:
    """Keywords of a deck with their data, those of included files in their place.

    Raises
    ------
    InputError
        If it does not begin with a keyword.
    MeshError
        If a file that it includes is not there.
    """
    block = None
    for line in _lines(path):
        if line.text[0] == "*":
            if block is not None:
                yield block
            block = Block("".join(line.text[1:].partition(",")[0].split()).upper(), _options(line.text), line)
        elif block is None:
            raise InputError(f"source: {path}: expected keywords that begin with *, got {line.text[:40]!r}")
        elif not block.data and block.line.text.endswith(",") and not line.begins_with_number:
            block.line = block.line._replace(text=block.line.text + line.text)  # options continue in the next line
            block.options = _options(block.line.text)
        else:
            block.data.append(line)
    if block is not None:
        yield block


def _lines(path: Path, depth: int = 0) -> Iterator[Line]:
    """Lines that are no comments, with those of included files in their place."""
    texts = enumerate(path.read_text(encoding="utf-8-sig", errors="replace").splitlines(), 1)
    for number, text in texts:
        line = Line(text.strip(), path, number)
        if not line.text or line.text.startswith("**"):
            continue
        if line.text[0] != "*":
            yield line
            continue
        while line.text.upper().startswith("*INCLUDE") and line.text.endswith(","):
            line = line._replace(text=line.text + next(texts, (0, ""))[1].strip())
        if not line.text.upper().startswith("*INCLUDE"):
            yield line
        if _INCLUDES.match(line.text):
            yield from _included(line, depth)
        elif line.text.upper().startswith("*INCLUDE"):
            raise line.refuse("*INCLUDE needs INPUT=")


def _included(line: Line, depth: int) -> Iterator[Line]:
    """Lines of the file that an option names, beside the deck or at an absolute path."""
    other = line.path.parent / _options(line.text)["INPUT"].replace("\\", "/")
    if not other.is_file():
        raise line.refuse(f"expected a file to include, there is none at {other}")
    if depth == _DEEPEST:
        raise line.refuse("expected files that do not include each other")
    yield from _lines(other, depth + 1)


def _options(text: str) -> dict[str, str]:
    parts = (part.partition("=") for part in OUTSIDE_QUOTES.split(text)[1:])
    return {"".join(key.split()).upper(): value.strip().strip('"') for key, _, value in parts}
