"""Results of all examples at full size, for the site's gallery: figures, what each prints, its time and its memory.

    python -m validation.gallery [NAME ...]

Runs each example of `examples/` in a process of its own, one after the other, which takes half an hour. It writes
gallery.json beside this file, the figures, curves with fewer colours, into `examples/site/full/`, and what some of them
cost into README. The site's build reads the first two, and runs the examples with `--quick` alone.
"""

import argparse
import datetime
import json
import os
import platform
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import PIL.Image

import exudyn_partition as ep
from validation.tables import README, write_between

HERE = Path(__file__).resolve().parent
EXAMPLES = HERE.parent / "examples"
NAMES = re.findall(r"^\d+\. \[`(\w+)\.py`\]", (EXAMPLES / "README.md").read_text(encoding="utf-8"), re.M)
RESULTS, FIGURES = HERE / "gallery.json", EXAMPLES / "site" / "full"
WIDTH, COLOURS = 1000, 128  # of a figure in the gallery: its pixels, and the colours of its palette
COSTS = ("two_spheres", "rod_on_plate", "crank_slider", "gear_pair", "cam_follower")  # impacts, then mechanisms


def full_size(name, folder):
    """Run an example; returns what it printed, its time [s], and where the system tells, processor time and memory."""
    command = [sys.executable, str(EXAMPLES / f"{name}.py"), "--out", str(folder)]
    environment = {**os.environ, "MPLBACKEND": "Agg", "OMP_NUM_THREADS": "1"}
    begin = time.perf_counter()
    with tempfile.TemporaryFile("w+") as printed:
        process = subprocess.Popen(command, stdout=printed, stderr=subprocess.PIPE, env=environment, text=True)
        said = process.stderr.read()
        used = {"processor_s": None, "memory_GB": None}
        if hasattr(os, "wait4"):
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            used = {"processor_s": usage.ru_utime + usage.ru_stime, "memory_GB": usage.ru_maxrss / 2**20}
        if process.wait():
            raise RuntimeError(f"examples/{name}.py failed:\n{said[-2000:]}")
        seconds = time.perf_counter() - begin
        printed.seek(0)
        lines = [line.rstrip() for line in printed if str(folder) not in line]
    return {"printed": "\n".join(lines).strip(), "seconds": seconds, **used}


def keep_figures(name, folder):
    """Put the figures of a run into the site, with fewer pixels and colours; returns their names, bodies first."""
    for old in FIGURES.glob(f"{name}-*.png"):
        old.unlink()
    found = sorted(folder.glob("*.png"), key=lambda path: (path.stem != "bodies", path.stem))
    for path in found:
        picture = PIL.Image.open(path).convert("RGB")
        picture.thumbnail((WIDTH, WIDTH))
        if path.stem != "bodies":  # a palette makes bands of its colours
            picture = picture.quantize(COLOURS)
        picture.save(FIGURES / f"{name}-{path.stem}.png", optimize=True)
    return [f"{name}-{path.stem}.png" for path in found]


def costs(known):
    """Sentence on the processor time of whole examples, for README."""
    times = ", ".join(f"{name} {known[name]['processor_s']:.0f} s" for name in COSTS)
    return f"Whole programs take, of a processor, with mesh and reduction: {times}.\nThe last three are mechanisms.\n"


def main(argv=None):
    """Run the examples that are named, by default all; returns what gallery.json holds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", choices=[*NAMES, []], help="default: all")
    options = parser.parse_args(argv)
    FIGURES.mkdir(exist_ok=True)
    known = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    for name in options.names or NAMES:
        with tempfile.TemporaryDirectory() as folder:
            run = full_size(name, Path(folder))
            figures = keep_figures(name, Path(folder))
        known[name] = {
            **run,
            "figures": figures,
            "date": datetime.date.today().isoformat(),
            "version": ep.__version__,
            "python": platform.python_version(),
            "cores": os.cpu_count(),
        }
        known = {name: known[name] for name in NAMES if name in known}
        RESULTS.write_text(json.dumps(known, indent=1) + "\n")
        print(f"{name}: {run['seconds']:.0f} s", flush=True)
    write_between(README, "gallery.py, costs", costs(known))
    return known


if __name__ == "__main__":
    main()
