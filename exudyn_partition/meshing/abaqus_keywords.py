"""Keywords of input decks of Abaqus and CalculiX, with comments anywhere, continued lines and included files."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from ..errors import InputError
from .deck_lines import OUTSIDE_QUOTES, Line, included

_LOG = logging.getLogger(__name__)

_INCLUDE = re.compile(r"\*\s*INCLUDE\b\s*,?", re.IGNORECASE)
_OF_A_FILE = re.compile(r"\*\s*(NODE|ELEMENT)\s*,", re.IGNORECASE)  # whose data may be in one
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
        else:
            block.data.append(line)
    if block is None:
        raise InputError(f"source: {path}: expected keywords that begin with *, got none")
    if before:
        _LOG.info("%s: left out %d lines before the first keyword", path, before)
    yield block


def _lines(path: Path, depth: int = 0, home: Path | None = None) -> Iterator[Line]:
    """Lines that are no comments, with those of included files in their place; `home` is the first file's folder.

    Lines of keywords are whole.
    """
    texts = enumerate(path.read_text(encoding="utf-8-sig", errors="replace").splitlines(), 1)
    lines = (Line(text, path, number) for number, row in texts if (text := row.strip()) and not text.startswith("**"))
    following = next(lines, None)
    while following is not None:
        line, following = following, next(lines, None)
        while following is not None and line.text[0] == "*" and _goes_on(line.text, following):
            line, following = line._replace(text=line.text + following.text), next(lines, None)
        is_include = _INCLUDE.match(line.text)
        if not is_include:
            yield line
        name = _file(line.text) if is_include or _OF_A_FILE.match(line.text) else ""
        if name:
            places = (path.parent, home or path.parent)  # codes look beside the file that includes, or the first one
            file = included(line, name, places)
            if depth == _DEEPEST:
                raise line.refuse("expected files that do not include each other")
            yield from _lines(file, depth + 1, places[1])
        elif is_include:
            raise line.refuse("*INCLUDE needs INPUT=")


def _goes_on(text: str, following: Line) -> bool:
    """Whether the line of a keyword continues in the following one."""
    if following.text[0] == "*":
        return False
    if _INCLUDE.match(text):
        return not _file(text) or text.count('"') % 2 == 1
    return text.endswith(",") and not following.begins_with_number


def _file(text: str) -> str:
    """File that a keyword names, blank if none."""
    return _options(_INCLUDE.sub("*INCLUDE,", text)).get("INPUT", "")


def _options(text: str) -> dict[str, str]:
    parts = (part.partition("=") for part in OUTSIDE_QUOTES.split(text)[1:])
    return {"".join(key.split()).upper(): value.strip().strip('"') for key, _, value in parts}
