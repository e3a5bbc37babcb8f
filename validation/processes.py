"""Cases in processes of their own, with their own peaks of memory, and by other versions of the library."""

import contextlib
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
_WHERE = "import exudyn_partition as ep; print(ep.__file__)"


def in_a_process(script, *arguments, checkout=ROOT, **environment):
    """Run a script with other arguments, and return what its last line says, as JSON.

    Parameters
    ----------
    script : path
        Usually `__file__` of the one that calls.
    *arguments : str
    checkout : path
        Folder whose library is imported.
    **environment : str
        More variables. OMP_NUM_THREADS is 1.
    """
    path = os.pathsep.join([str(checkout), os.environ.get("PYTHONPATH", "")])
    options = {
        "env": os.environ | {"PYTHONPATH": path, "OMP_NUM_THREADS": "1"} | environment,
        "cwd": checkout, "stdout": subprocess.PIPE, "text": True, "check": True,
    }  # fmt: skip
    found = Path(subprocess.run([sys.executable, "-c", _WHERE], **options).stdout.strip())
    if found.parents[1] != Path(checkout).resolve():
        raise RuntimeError(f"expected the library in {checkout}, got {found}")
    process = subprocess.run([sys.executable, str(Path(script).resolve()), *map(str, arguments)], **options)
    return json.loads(process.stdout.splitlines()[-1])


@contextlib.contextmanager
def checkout_of(revision):
    """Folder of a revision that git knows, which goes after the block."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch).resolve() / "checkout"
        git = ["git", "-C", ROOT, "worktree"]
        subprocess.run([*git, "add", "--detach", folder, revision], check=True, capture_output=True)
        try:
            yield folder
        finally:
            subprocess.run([*git, "remove", "--force", folder], check=True)
