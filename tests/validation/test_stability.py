"""The fast ones of the stiff and extreme cases of validation/stability, and what they found in the library."""

import pytest

from validation.stability.cases import CASES
from validation.stability.stability import evaluate

QUICK = [(case, method) for case in CASES if case.quick for method in case.methods]


@pytest.mark.parametrize(("case", "method"), QUICK, ids=[f"{case.name}, {method}" for case, method in QUICK])
def test_extreme_case(case, method):
    row = evaluate(case, method)
    assert row["passed"], (row["beyond"], row["checks"], row["message"])


def test_forces_of_a_plain_impact_are_checked_for_complementarity():
    plain = next(case for case in CASES if case.name == "ball on plane at 1 m/s")
    assert "complementarity" in evaluate(plain, "explicit")["checks"]
