"""Keywords of input decks of Abaqus and CalculiX, with comments anywhere, continued lines and included files."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from ..errors import InputError
from .deck_lines import OUTSIDE_QUOTES, Line

_LOG = logging.getLogger(__name__)

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

    Lines of text before the first keyword are left out, as CalculiX does.

    Raises
    ------
    InputError
        If it has no keyword, or begins with data whose keyword is missing.
    MeshError
        If a file that it includes is not there.
    """
    block, before = None, 0
    for line in _lines(path):
        if line.text[0] == "*":
            if block is not None:
                yield block
            block = Block("".join(line.text[1:].partition(",")[0].split()).upper(), _options(line.text), line)
        elif block is None and (line.begins_with_number or line.text[0] in "/!"):  # as decks of Ansys begin
            raise InputError(f"source: {line.where}: expected keywords that begin with *, got {line.text[:40]!r}")
        elif block is None:
            before += 1
        elif not block.data and block.line.text.endswith(",") and not line.begins_with_number:
            block.line = block.line._replace(text=block.line.text + line.text)  # options continue in the next line
            block.options = _options(block.line.text)
        else:
            block.data.append(line)
    if block is None:
        raise InputError(f"source: {path}: expected keywords that begin with *, got none")
    if before:
        _LOG.info("%s: left out %d lines before the first keyword", path, before)
    yield block


def _lines(path: Path, depth: int = 0, home: Path | None = None) -> Iterator[Line]:
    """Lines that are no comments, with those of included files in their place; `home` is the first file's folder."""
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
            yield from _included(line, depth, home or path.parent)
        elif line.text.upper().startswith("*INCLUDE"):
            raise line.refuse("*INCLUDE needs INPUT=")


def _included(line: Line, depth: int, home: Path) -> Iterator[Line]:
    """Lines of the file that an option names, beside the file that names it, beside the deck or at an absolute path."""
    name = _options(line.text)["INPUT"].replace("\\", "/")
    places = (line.path.parent / name, home / name)
    other = next((place for place in places if place.is_file()), None)
    if other is None:
        raise line.refuse(f"expected a file to include, there is none at {places[0]}")
    if depth == _DEEPEST:
        raise line.refuse("expected files that do not include each other")
    yield from _lines(other, depth + 1, home)


def _options(text: str) -> dict[str, str]:
    parts = (part.partition("=") for part in OUTSIDE_QUOTES.split(text)[1:])
    return {"".join(key.split()).upper(): value.strip().strip('"') for key, _, value in parts}
