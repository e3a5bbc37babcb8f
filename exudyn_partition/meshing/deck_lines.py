"""A line of an input deck: where it stands, and its data."""

from __future__ import annotations

import logging
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from ..errors import MeshError

_LOG = logging.getLogger(__name__)

LARGEST = 2**53  # whole number; those above are not exact as floats
OUTSIDE_QUOTES = re.compile(r',(?=(?:[^"]*"[^"]*")*[^"]*$)')


class Line(NamedTuple):
    """A line, and where it stands; its data are separated by commas."""

    text: str
    path: Path
    number: int

    @property
    def where(self) -> str:
        """Place of the line for messages."""
        return f"{self.path}, line {self.number}"

    def refuse(self, said: str) -> MeshError:
        """Return the error that names the line."""
        return MeshError(f"{self.where}: {said}")

    @property
    def fields(self) -> list[str]:
        """Its data that are not blank."""
        return [part for part in (part.strip().strip('"') for part in OUTSIDE_QUOTES.split(self.text)) if part]

    @property
    def numbers(self) -> list[float]:
        """Its data as numbers; blank ones are zero, and exponents may have the D of Fortran."""
        parts = self.text.removesuffix(",").split(",")
        try:
            try:
                return list(map(float, parts))  # as most lines are
            except ValueError:
                return [_number(part) for part in parts]
        except ValueError as error:
            raise self.refuse(f"expected numbers, separated by commas, got {self.text[:60]!r}") from error

    @property
    def begins_with_number(self) -> bool:
        """Whether its first data are a number."""
        try:
            _number(self.text.partition(",")[0])
        except ValueError:
            return False
        return True

    @property
    def integers(self) -> list[int]:
        """Its data as whole numbers, without blank ones."""
        try:
            try:
                numbers = list(map(int, self.text.removesuffix(",").split(",")))
            except ValueError:
                numbers = [int(part) for part in self.fields]
        except ValueError as error:
            raise self.refuse(f"expected whole numbers, separated by commas, got {self.text[:60]!r}") from error
        if max(map(abs, numbers), default=0) > LARGEST:
            raise self.refuse(f"expected whole numbers up to {LARGEST}, got {self.text[:60]!r}")
        return numbers


def _number(text: str) -> float:
    text = text.strip()
    return float(text.replace("D", "e").replace("d", "e")) if text else 0.0


def included(line: Line, name: str, folders: Sequence[Path]) -> Path:
    """File that a line includes, beside one of some folders or at an absolute path; capitals matter only if they must.

    A path of another computer leads to the file of its name in one of the folders.

    Raises
    ------
    MeshError
        If it is not there.
    """
    name = name.strip(" ,'\"").replace("\\", "/")
    places = [folder / name for folder in folders]
    beside = [folder / re.split("[/:]", name)[-1] for folder in folders]
    for place in [*places, *map(_whatever_capitals, places), *beside, *map(_whatever_capitals, beside)]:
        if name and place.is_file():
            if place in beside and place not in places:
                _LOG.info("%s: there is no %s, so that %s is included", line.where, name, place)
            return place
    raise line.refuse(f"expected a file to include, there is none at {places[0]}")


def _whatever_capitals(path: Path) -> Path:
    """Path of what is there, whose name differs in capitals alone, as decks from Windows have them."""
    if path.exists() or path == path.parent:
        return path
    folder = _whatever_capitals(path.parent)
    same = [file for file in folder.iterdir() if file.name.lower() == path.name.lower()] if folder.is_dir() else []
    return same[0] if len(same) == 1 else folder / path.name
