"""Base of the types of objects with several arrays, which compiled loops take as one argument."""

from __future__ import annotations

from numba import types


class StructType(types.StructRef):
    """Type of such an object; `structref.register` it."""

    def preprocess_fields(self, fields):  # type: ignore[no-untyped-def]
        """See numba."""
        return tuple((name, types.unliteral(kind)) for name, kind in fields)  # type: ignore[no-untyped-call]
