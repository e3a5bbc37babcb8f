"""What the experiments share: their data, figures beside the scripts, and the table that they print."""

import argparse
import json
import shutil
from pathlib import Path

from rich.console import Console
from rich.table import Table

from validation.contact import scenes

DATA = Path(__file__).resolve().parent / "data"


def data(name):
    """Contents of data/NAME.json."""
    return json.loads((DATA / f"{name}.json").read_text())


def options(doc, what):
    """Arguments of a script: `--quick`, which does `what`, and `--out`, where the JSON goes then."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help=what)
    parser.add_argument("--out", type=Path, metavar="JSON", help="default: beside the script, unless --quick")
    return parser.parse_args()


def show(title, rows):
    """Print rows, dicts of the same names, as a table."""
    table = Table(*rows[0], title=title)
    for row in rows:
        table.add_row(*(f"{value:.4g}" if isinstance(value, float) else str(value) for value in row.values()))
    Console(width=180).print(table)


def finish(script, result, found, limits, given, draw):
    """Draw, write the JSON, and end with an error if a limit is missed.

    Parameters
    ----------
    script : str
        `__file__` of the script.
    result : dict
        What is stored beside found and limits.
    found, limits : dict of str to float
        Largest errors and their limits.
    given : Namespace
        Of `options`.
    draw : callable
        Takes the path of the figure. Full runs keep it beside the script.
    """
    import matplotlib as mpl

    mpl.use("Agg")
    path = scenes.ROOT / "out" / f"experiments_{Path(script).stem}.png"
    path.parent.mkdir(exist_ok=True)
    draw(path)
    print(path)
    if not given.quick:
        shutil.copy(path, Path(script).with_suffix(".png"))
    failed = [f"{name} {found[name]:.3g}" for name, limit in limits.items() if not abs(found[name]) <= limit]
    out = given.out or (path.with_suffix(".json") if given.quick else None)
    scenes.finish(script, {"found": found, "limits": limits, **result}, failed, out)
