"""Run the tutorials of the site, and put what they print and draw into their pages.

    python -m validation.tutorials [PAGE ...]

The programs of a page run one after the other in a folder of their own. What program i prints goes between the marks
of `tutorials.py, PAGE i`, where the page has them; pictures go to `examples/site/tutorials/`. Quantities are what the
pages say; their limits are the assertions in the programs.
"""

import argparse
import contextlib
import io
import os
import re
import tempfile
import warnings
from pathlib import Path

import matplotlib as mpl
import PIL.Image

from exudyn_partition.errors import YieldWarning
from validation.tables import write_between

SITE = Path(__file__).resolve().parents[1] / "examples" / "site"
PAGES = ("first-impact", "joint-and-stop", "my-cad-assembly", "measurement-to-trust")
COLOURS = 128  # of a picture's palette


def run(page):
    """What each program of a page prints; pictures are kept."""
    programs = re.findall(r"^```python\n(.*?)^```", (SITE / f"{page}.md").read_text(), re.M | re.S)
    names, printed = {}, []
    for i, program in enumerate(programs):
        with contextlib.redirect_stdout(io.StringIO()) as text:
            exec(compile(program, f"{page}.md, program {i + 1}", "exec"), names)
        printed.append(text.getvalue())
    return printed


def main(argv=None):
    """Run the pages that are named, by default all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pages", nargs="*", metavar="PAGE", choices=[*PAGES, []], help="default: all")
    pictures = SITE / "tutorials"
    pictures.mkdir(exist_ok=True)
    mpl.use("Agg")
    warnings.simplefilter("ignore", YieldWarning)  # which the pages explain
    for page in parser.parse_args(argv).pages or PAGES:
        before = Path.cwd()
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            try:
                printed = run(page)
            finally:
                os.chdir(before)
            for path in Path(folder).glob(f"{page}*.png"):
                picture = PIL.Image.open(path).convert("RGB").quantize(COLOURS)
                picture.save(pictures / path.name, optimize=True)
        source = SITE / f"{page}.md"
        for number in map(int, re.findall(rf"tutorials\.py, {page} (\d+): begin", source.read_text())):
            text = "\n".join(line for line in printed[number - 1].splitlines() if "WARNING" not in line)
            write_between(source, f"tutorials.py, {page} {number}", f"```text\n{text}\n```\n")
        print(f"{page}: {len(printed)} programs", flush=True)


if __name__ == "__main__":
    main()
