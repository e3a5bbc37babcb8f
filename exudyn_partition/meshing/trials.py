"""Work of Netgen that is first tried in a child process, because it may crash."""

from __future__ import annotations

import os
import subprocess
import sys


def failure(program: str, *arguments: str, given: bytes = b"") -> str:
    """Return why a program fails in a child process, blank if it does not.

    Parameters
    ----------
    program : str
        In Python.
    arguments : str
        In its `sys.argv`.
    given : bytes
        What it reads from `sys.stdin`.
    """
    if not sys.executable:  # an interpreter inside another program
        return ""
    call = [sys.executable, "-c", program, *arguments]
    # PYTHONSAFEPATH: a file in the working directory may have the name of a package.
    run = subprocess.run(call, input=given, capture_output=True, env=os.environ | {"PYTHONSAFEPATH": "1"}, check=False)
    if not run.returncode:
        return ""
    said = run.stderr.decode(errors="replace").strip().splitlines()
    crashed = not said or not said[-1].partition(":")[0].endswith(("Exception", "Error"))
    return f"it crashes, exit code {run.returncode}" if crashed else said[-1]
