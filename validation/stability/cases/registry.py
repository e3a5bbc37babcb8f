"""The list of cases, and how a function becomes one."""

from collections.abc import Callable
from dataclasses import dataclass

BOTH = ("explicit", "implicit")
QUIET = {"progress": lambda share: None}
CASES = []


@dataclass(frozen=True)
class Case:
    """One line of the table, for each integrator in `methods`; those in tests are `quick`."""

    name: str
    must: str
    function: Callable
    methods: tuple = BOTH
    raises: str = ""
    warns: tuple = ()
    quick: bool = False


def case(name, must, **options):
    def register(function):
        CASES.append(Case(name, must, function, **options))
        return function

    return register
