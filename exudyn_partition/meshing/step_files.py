"""Files of shapes: a trial in a child process, because a damaged one may crash its reader; solids that STEP defines."""

from __future__ import annotations

import re
from pathlib import Path

from ..errors import InputError
from .trials import failure

_KINDS = {".step": "STEP", ".stp": "STEP", ".iges": "IGES", ".igs": "IGES", ".brep": "BREP"}
ENDINGS = (*_KINDS,)

_SOLID = re.compile(r"\b(MANIFOLD_SOLID_BREP|BREP_WITH_VOIDS|FACETED_BREP(?:_AND_BREP_WITH_VOIDS)?)\s*\(")
_TEXTS = re.compile(r"'(?:[^']|'')*'|/\*.*?\*/", re.DOTALL)

TRIAL = "import sys; from netgen.occ import OCCGeometry; OCCGeometry(sys.argv[1]).shape.solids"


def check_readable(path: Path, name: str) -> None:
    """Refuse a file of a shape that Netgen cannot read, whether its reader raises an error or crashes.

    The file is read in a child process. That takes a third of a second and the time to read it. A damaged file that
    passes this test may still crash the mesher, in this process.

    Raises
    ------
    InputError
    """
    reason = failure(TRIAL, str(path))
    if reason:
        raise InputError(
            f"{name}: {path} could not be read by Netgen ({reason}). Is it a complete {kind_of(path)} file?"
        )


def kind_of(path: Path) -> str:
    """Format of a file by its ending."""
    return _KINDS[path.suffix.lower()]


def solids_said(path: Path) -> int:
    """Number of solids that a STEP file defines; an assembly may place each of them several times. Others tell none."""
    if kind_of(path) != "STEP":
        return 0
    text = path.read_text(encoding="latin-1")
    return sum(_SOLID.search(entity) is not None for entity in _TEXTS.sub("''", text).split(";"))
