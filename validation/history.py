"""The site's page on the history of benchmarks: what each kept result of `validation/benchmarks` was, commit by commit.

    python -m validation.history

Git has each result as JSON beside its script. Of each, the page has the numbers that have a limit today.
"""

import ast
import json
import subprocess
from pathlib import Path

from validation.tables import write_between

ROOT = Path(__file__).resolve().parents[1]
FOLDER, PAGE = ROOT / "validation" / "benchmarks", ROOT / "examples" / "site" / "history.md"


def git(*arguments):
    return subprocess.run(["git", "-C", ROOT, *arguments], capture_output=True, text=True, check=True).stdout


def versions(path):
    """Date, commit and content of a file of JSON at each commit that changed it, the first one first."""
    name = path.relative_to(ROOT).as_posix()
    lines = git("log", "--reverse", "--diff-filter=AM", "--format=%cs %h", "--", name).splitlines()
    for date, commit in map(str.split, lines):
        yield date, commit, json.loads(git("show", f"{commit}:{name}"))


def numbers(result, names):
    """Numbers of a result by these names, as far as it has them."""
    found = result.get("found", result)
    return {name: found[name] for name in names if isinstance(found.get(name), int | float)}


def table(path):
    """Table of a benchmark: a row for each result that differs from the one before."""
    limits = json.loads(path.read_text()).get("limits", {})
    names = [name for name, limit in limits.items() if isinstance(limit, int | float)]
    rows, last = [], None
    for date, commit, result in versions(path):
        if (found := numbers(result, names)) and found != last:
            cells = [f"{found[name]:.3g}" if name in found else "" for name in names]
            rows.append([date, commit, *cells])
            last = found
    if not rows:
        return ""
    head = ["date", "commit", *names]
    rows.append(["", "limit", *(f"{limits[name]:.3g}" for name in names)])
    return "\n".join(f"| {' | '.join(row)} |" for row in [head, ["---"] * len(head), *rows]) + "\n"


def section(path):
    """Heading, first sentence of the script, and table."""
    said = ast.get_docstring(ast.parse(path.with_suffix(".py").read_text())).split("\n\n")[0]
    return f"## {path.stem}\n\n{said}\n\n{table(path)}\n"


def main():
    paths = sorted(FOLDER.glob("*.json"))
    write_between(PAGE, "history.py", "\n" + "".join(section(path) for path in paths if table(path)))


if __name__ == "__main__":
    main()
