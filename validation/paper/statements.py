"""What the paper says, and what is measured here: rows of the report."""

HEAD = ("what", "paper", "here", "deviation", "agrees", "why")


def statement(what, paper, got, deviation=None, limit=None, *, agrees=None, known=False, why=""):
    """One row. It agrees if `deviation` is within `limit`, or as `agrees` says; with neither it is not judged.

    `known` marks a disagreement that is understood, and `why` explains it. It is no failure.
    """
    if limit is not None:
        agrees = abs(deviation) <= limit
    return {
        "what": what,
        "paper": str(paper),
        "got": got if isinstance(got, str) else f"{got:.4g}",
        "deviation": None if deviation is None else float(deviation),
        "limit": limit,
        "agrees": None if agrees is None else bool(agrees),
        "known": known,
        "why": why,
    }


def cells(row):
    """The row as text, below `HEAD`."""
    deviation = "" if row["deviation"] is None else f"{row['deviation']:+.1%}"
    answer = {None: "", True: "yes", False: "NO"}[row["agrees"]]
    return row["what"], row["paper"], row["got"], deviation, answer, row["why"]


def failures(rows):
    """What disagrees and is not understood."""
    return [row["what"] for row in rows if row["agrees"] is False and not row["known"]]
