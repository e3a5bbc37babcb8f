"""STEP files: a trial in a process of its own, for the reader of damaged ones may crash and take its process along."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from ..errors import InputError

ENDINGS = (".step", ".stp")

_TRIAL = "import sys; from netgen.occ import OCCGeometry; OCCGeometry(sys.argv[1]).shape.solids"


def check_step(path: Path) -> None:
    """Refuse a STEP file that Netgen cannot read, whether it says so or crashes.

    The file is read in a child process, which takes a third of a second and the time to read it. What a damaged file
    does later, to Netgen's mesher, happens in this process.

    Raises
    ------
    InputError
    """
    if not sys.executable:  # an interpreter inside another program
        return
    call = [sys.executable, "-c", _TRIAL, str(path)]
    # Not the folder that the user works in: a file there may have the name of a package.
    run = subprocess.run(
        call, capture_output=True, text=True, errors="replace", env=os.environ | {"PYTHONSAFEPATH": "1"}, check=False
    )
    if run.returncode:
        said = run.stderr.strip().splitlines()
        crashed = not said or not said[-1].partition(":")[0].endswith(("Exception", "Error"))
        reason = f"its reader crashes, exit code {run.returncode}" if crashed else said[-1]
        raise InputError(f"path: {path} could not be read by Netgen ({reason}). Is it a complete STEP file?")
