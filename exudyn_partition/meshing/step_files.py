"""STEP files: a trial in a child process, because a damaged file may crash its reader, and a count of its solids."""

from __future__ import annotations

import re
from pathlib import Path

from ..errors import InputError
from .trials import failure

ENDINGS = (".step", ".stp")

_SOLID = re.compile(r"\b(MANIFOLD_SOLID_BREP|BREP_WITH_VOIDS|FACETED_BREP(?:_AND_BREP_WITH_VOIDS)?)\s*\(")
_TEXTS = re.compile(r"'(?:[^']|'')*'|/\*.*?\*/", re.DOTALL)

TRIAL = "import sys; from netgen.occ import OCCGeometry; OCCGeometry(sys.argv[1]).shape.solids"


def check_step(path: Path, name: str) -> None:
    """Refuse a STEP file that Netgen cannot read, whether its reader raises an error or crashes.

    The file is read in a child process. That takes a third of a second and the time to read it. A damaged file that
    passes this test may still crash the mesher, in this process.

    Raises
    ------
    InputError
    """
    reason = failure(TRIAL, str(path))
    if reason:
        raise InputError(f"{name}: {path} could not be read by Netgen ({reason}). Is it a complete STEP file?")


def solids_said(path: Path) -> int:
    """Number of solids that a STEP file defines; an assembly may place each of them several times."""
    text = path.read_text(encoding="latin-1")
    return sum(_SOLID.search(entity) is not None for entity in _TEXTS.sub("''", text).split(";"))
