"""The full FE model under the same contact rows: the reference that errors are measured against."""

from .full_body import FullBody
from .two_bodies import simulate

__all__ = ["FullBody", "simulate"]


def __dir__() -> list[str]:
    return __all__
