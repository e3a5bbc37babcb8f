"""Why a run ended: what the errors of Exudyn's solvers and of user functions mean."""

from __future__ import annotations

import re
from pathlib import Path

from ..errors import PartitionError
from ..exudyn_contacts.partition_contact import partition_items
from ..support.foreign import MainSystem

_FUNCTION = re.compile(r"\w+::\w*[uU]serFunction\b")  # name of a user function in a report of Exudyn
_RETURNED = re.compile(r"Unable to cast Python instance of type <class '(?:\w+\.)*(\w+)'>")
_LINE = re.compile(r"^At:\n +(.+)\((\d+)\): ", re.MULTILINE)  # where the error of a user function was raised
_TERMINATED = "SolveDynamic terminated"  # Exudyn's only message if steps do not converge
_SINGULAR = (
    "Its Jacobian is singular, perhaps because joints hold the same motion twice: let one of them go, as by a "
    "GenericJoint with fewer constrainedAxes; or give settings with linearSolver.solverType EigenDense and "
    "linearSolver.ignoreSingularJacobian = True"
)


def unsettled(mbs: MainSystem, said: str) -> str:
    """Text for a stop without a cause in Exudyn's message, as when Newton's method of implicit steps fails."""
    if _TERMINATED not in said:
        return ""
    ahead = [contact for contact in partition_items(mbs)[1] if contact.mechanics.ahead]
    names = ", ".join(repr(contact.name) for contact in ahead)
    of_contacts = f" with the multipliers of contact {names}" if ahead else ""
    jump = any(contact.rows == "node-to-segment" and len(contact.sides) > 1 for contact in ahead)
    rows = ", rows='integrated' (their normals jump less)" if jump else ""
    return (
        f": Newton's iteration{of_contacts} does not converge, not even in the shortest step that it may take. Take a "
        f"shorter step{rows}, a finer mesh of the patches, or settings whose newton.maxIterations is larger"
    )


def cause(error: BaseException) -> str:
    """Cause of the end of a run, as text: the library's own error beneath Exudyn's report, or a user function's error.

    Raises
    ------
    SystemExit
        If a user function asked for the end of the program.
    """
    report, chain = str(error), [error]
    while (behind := chain[-1].__cause__) is not None:
        chain.append(behind)
    root = chain[-1]
    if isinstance(root, SystemExit):
        raise root
    if ours := [str(error) for error in chain if isinstance(error, PartitionError)]:
        return ours[0]
    named = _FUNCTION.search(report)
    function = f"the user function {named[0]}" if named else "a user function"
    if returned := _RETURNED.search(report):
        return f"{function} returned a {returned[1]} of another kind or length than Exudyn takes there"
    if len(chain) > 1 or named:
        kind, text = (type(root).__name__, str(root)) if len(chain) > 1 else ("", _lines(report)[-1])
        return f"{': '.join(filter(None, (kind, text)))}, in {function}{_line_of(report)}"
    lines = _lines(report)
    said = next((line for line in lines if "Error: " in line), lines[0] if lines else type(error).__name__)
    said = " ".join(lines) if said.endswith(":") else said
    return f"{said} {_SINGULAR}" if "matrix is not factorized" in said else said


def _line_of(report: str) -> str:
    """Line that raised the error of a user function, in brackets; empty if the report of Exudyn does not tell."""
    place = _LINE.search(report)
    return f" ({Path(place[1]).name}, line {place[2]})" if place else ""


def _lines(report: str) -> list[str]:
    return [line.strip() for line in report.splitlines() if line.strip()]
