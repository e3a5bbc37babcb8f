"""Cards of Nastran's bulk data: free, small and large fields, continuations of all forms, included files."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError, MeshError
from .deck_lines import Line, included

_MARK = re.compile(r"[+*]([A-Za-z]\w*)?$")  # of a continuation at the end of a line in free fields; no number
_WHOLE = re.compile(r"[+-]?\d{1,15}", re.ASCII)
_BEGIN = re.compile(r"\s*BEGIN\s*,?\s*BULK", re.IGNORECASE)
_INCLUDE = re.compile(r"\s*INCLUDE\b", re.IGNORECASE)
_EXPONENT = re.compile(r"(?<=[\d.])([+-]\d+)$")  # without its E
_STARTS = {4: range(8, 72, 16), 8: range(8, 72, 8)}  # of fixed fields, by their number
_TIMES = re.compile(r"=\(?(\d{1,6})\)?", re.ASCII)  # how often the card before repeats once more
_ADDED = re.compile(r"\*\(?([^*()]+)\)?")  # to a field of the card before
_DEEPEST = 20  # files that include files


@dataclass
class Card:
    """A card: its name in capitals, without the asterisk of large fields; its fields after the name; its first line."""

    name: str
    fields: list[str]
    line: Line
    mark: str = ""  # the last field of its last line, which names the continuation

    def field(self, i: int) -> str:
        """Return field i, counted from 1 after the name; blank if the card is shorter."""
        return self.fields[i - 1] if i <= len(self.fields) else ""

    def integer(self, i: int, default: int | None = None) -> int:
        """Return field i as a whole number; `default` if it is blank."""
        text = self.field(i)
        if text.isdecimal() and text.isascii() and len(text) < 16:  # as most are
            return int(text)
        if not text and default is not None:
            return default
        if not _WHOLE.fullmatch(text):
            raise self.line.refuse(f"expected a whole number in field {i + 1} of {self.name}, got {text!r}")
        return int(text)

    def real(self, i: int) -> float:
        """Return field i as a number; zero if it is blank."""
        text = self.field(i)
        try:
            return float(text)  # as most are
        except ValueError:
            text = text.upper().replace("D", "E") or "0"
        try:
            return float(text if "E" in text else _EXPONENT.sub(r"E\1", text))
        except ValueError as error:
            raise self.line.refuse(f"expected a number in field {i + 1} of {self.name}, got {text!r}") from error


def cards(path: Path) -> list[Card]:
    """Cards between BEGIN BULK, or the begin of a file without it, and ENDDATA, those of included files in their place.

    Those that repeat the card before, by =, are written out.

    Raises
    ------
    InputError
        If there are none.
    MeshError
        If a file that it includes is not there, a line continues no card, or a card with continuations is repeated.
    """
    split = [(line, *_split(line)) for line in _bulk(path)]
    known = {text for _, _, _, mark in split for text in _marks(mark)} - {""}
    found: list[Card] = []
    loose: list[tuple[str, Card]] = []  # continuations that stand elsewhere, by their mark
    for line, name, fields, mark in split:
        if name and name[0] not in "+*":
            # meshio writes CTETRA_ for ten nodes
            found.append(Card(name.rstrip("*_").upper(), fields, line, mark))
            continue
        if not found:
            raise line.refuse("expected a card, got a continuation")
        own_mark = name[1:].strip().upper()
        if own_mark and own_mark not in _marks(found[-1].mark) and (own_mark in known or found[-1].mark):
            loose.append((own_mark, Card("", fields, line, mark)))
        else:
            found[-1].fields.extend(fields)
            found[-1].mark = mark
    if not found:
        raise InputError(f"source: {path}: expected bulk data of Nastran, got no cards")
    _join(found, loose)
    return _in_full(found) if any(card.name[:1] == "=" for card in found) else found


def _in_full(found: list[Card]) -> list[Card]:
    """Cards with those in full that repeat the one before: "=" with changes, and "=n" for n more with the same ones."""
    full: list[Card] = []
    changes = None
    for card in found:
        if card.name[:1] != "=":
            full.append(card)
            changes = None
            continue
        times = _TIMES.fullmatch(card.name)
        if card.name == "=":
            changes = card
        if not full or changes is None or not (card is changes or times):
            raise _not_in_full(card)
        for _ in range(int(times[1]) if times else 1):
            full.append(_changed(full[-1], changes, card.line))
    return full


def _changed(before: Card, changes: Card, line: Line) -> Card:
    """Card with the fields of the one before: "=" keeps one, "==" all that follow, and "*x" adds x."""
    if any(before.fields[8:]) or any(changes.fields[8:]) or changes.mark:  # whose continuations would be meant
        raise _not_in_full(changes)
    fields = []
    for i, text in enumerate(changes.fields, 1):
        if text == "==":
            fields += before.fields[i - 1 :]
            break
        added = _ADDED.fullmatch(text)
        if added:
            old, new = (Card(before.name, [""] * (i - 1) + [written], line) for written in (before.field(i), added[1]))
            whole = all(_WHOLE.fullmatch(written) for written in (before.field(i) or "0", added[1]))
            text = str(old.integer(i, 0) + new.integer(i)) if whole else repr(old.real(i) + new.real(i))
        fields.append(before.field(i) if text == "=" else text)
    return Card(before.name, fields, line)


def _not_in_full(card: Card) -> MeshError:
    return card.line.refuse(
        "expected each card in full, got one that repeats the one before, by =. It is read where both have no "
        "continuation, with =, ==, *(x) and =(n)"
    )


def _marks(mark: str) -> tuple[str, str]:
    """What may follow the + of a continuation: the mark, or all but its first character, which does not count."""
    return mark, mark[1:].strip()


def _join(found: list[Card], loose: list[tuple[str, Card]]) -> None:
    """Append continuations to the cards whose marks they have."""
    by_mark = {mark: card for card in found for mark in _marks(card.mark) if mark}
    while loose:
        left = []
        for mark, part in loose:
            card = by_mark.pop(mark, None)
            if card is None:
                left.append((mark, part))
                continue
            card.fields.extend(part.fields)
            card.mark = part.mark
            by_mark.update({mark: card for mark in _marks(part.mark) if mark})
        if len(left) == len(loose):
            raise left[0][1].line.refuse(f"the continuation {left[0][0]!r} belongs to no card")
        loose = left


def _bulk(path: Path) -> Iterator[Line]:
    """Lines of the bulk data."""
    lines = list(_lines(path))
    begins = [i for i, line in enumerate(lines) if _BEGIN.match(line.text)]
    for line in lines[begins[0] + 1 if begins else 0 :]:
        if line.text.upper().startswith("ENDDATA"):
            return
        yield line


def _lines(path: Path, depth: int = 0, home: Path | None = None) -> Iterator[Line]:
    """Lines without comments, with those of included files in their place; `home` is the folder of the first file."""
    texts = enumerate(path.read_text(encoding="utf-8-sig", errors="replace").splitlines(), 1)
    for number, text in texts:
        line = Line(text.partition("$")[0].rstrip(), path, number)
        if not line.text.strip():
            continue
        if not _INCLUDE.match(line.text):
            yield line
            continue
        name = _INCLUDE.sub("", line.text).strip(" ,=")
        while not name or (name[0] in "'\"" and name.count(name[0]) == 1):  # it continues in the next line
            following = next(texts, None)
            if following is None:
                break
            name += following[1].partition("$")[0].strip()
        folders = (path.parent, home or path.parent)  # codes look from the file that includes, or from the first one
        inner = included(line, name, folders)
        if depth == _DEEPEST:
            raise line.refuse("expected files that do not include each other")
        yield from _lines(inner, depth + 1, folders[1])


def _split(line: Line) -> tuple[str, list[str], str]:
    """Name, or mark of a continuation; fields, four large or eight others, or more; mark of what continues the line."""
    text = line.text
    if "," in text[:10]:
        head, *fields = (part.strip() for part in text.split(","))
        width = 4 if "*" in head else 8
        mark = fields[width] if len(fields) > width else ""
        if any(fields[width + 1 :]):  # a long line in free fields goes on as if it were continued
            mark = fields.pop() if _MARK.match(fields[-1]) else ""
            if width == 4 or not fields[8] or any(map(_MARK.match, fields)):
                raise line.refuse(f"expected at most {width} fields after the name, got {len(fields)}")
            return head, fields + [""] * (-len(fields) % width), mark.upper()
        if len(fields) <= width and fields and _MARK.match(fields[-1]):
            mark = fields.pop()
        fields = fields[:width]
    else:
        text = text.expandtabs(8) if "\t" in text else text
        head = text[:8].strip()
        width = 4 if "*" in head else 8
        size = 64 // width
        fields = [text[i : i + size].strip() for i in _STARTS[width]]
        mark = text[72:80].strip()
    return head, fields + [""] * (width - len(fields)), mark.upper()
