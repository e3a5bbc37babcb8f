"""STEP files: a trial in a child process, because a damaged file may crash its reader, and a count of its solids."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

from ..errors import InputError

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
    if not sys.executable:  # an interpreter inside another program
        return
    call = [sys.executable, "-c", TRIAL, str(path)]
    # PYTHONSAFEPATH: a file in the working directory may have the name of a package.
    run = subprocess.run(
        call, capture_output=True, text=True, errors="replace", env=os.environ | {"PYTHONSAFEPATH": "1"}, check=False
    )
    if run.returncode:
        said = run.stderr.strip().splitlines()
        crashed = not said or not said[-1].partition(":")[0].endswith(("Exception", "Error"))
        reason = f"its reader crashes, exit code {run.returncode}" if crashed else said[-1]
        raise InputError(f"{name}: {path} could not be read by Netgen ({reason}). Is it a complete STEP file?")


def solids_said(path: Path) -> int:
    """Number of solids that a STEP file defines; an assembly may place each of them several times."""
    text = path.read_text(encoding="latin-1")
    return sum(_SOLID.search(entity) is not None for entity in _TEXTS.sub("''", text).split(";"))
