"""Tables of README and of the site's page of validation: each stands between two marks that name its script."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
README = ROOT / "README.md"
PAGE = ROOT / "examples" / "site" / "validation.md"


def write_between(path, script, text):
    """Put `text`, whose last line ends, between the marks of `script` in the file `path`."""
    begin, end = (f"<!-- validation/{script}: {mark} -->\n" for mark in ("begin", "end"))
    before, rest = path.read_text().split(begin)
    path.write_text(before + begin + text + end + rest.split(end)[1])
