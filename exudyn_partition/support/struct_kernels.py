"""Base of the types of objects with several arrays, which compiled loops take as one argument."""

from __future__ import annotations

from typing import Any

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic


class StructType(types.StructRef):
    """Type of such an object; `structref.register` it."""

    def preprocess_fields(self, fields):  # type: ignore[no-untyped-def]
        """See numba."""
        return tuple((name, types.unliteral(kind)) for name, kind in fields)  # type: ignore[no-untyped-call]


@intrinsic
def address_of(typing: Any, struct: Any) -> Any:
    """Address of such an object, with which `struct_at` finds it as long as somebody holds it."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = signature.args[0]
        proxy = cgutils.create_struct_proxy(kind)(context, builder, arguments[0])  # type: ignore[no-untyped-call]
        return builder.ptrtoint(proxy.meminfo, cgutils.intp_t)

    return types.intp(struct), generate


@intrinsic
def struct_at(typing: Any, address: Any, example: Any) -> Any:
    """The object at an address, of the same type as an example.

    A loop takes any number of objects so; lists and tuples of them would be compiled anew in each process, or for each
    number.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = signature.return_type
        proxy = cgutils.create_struct_proxy(kind)(context, builder)  # type: ignore[no-untyped-call]
        proxy.meminfo = builder.inttoptr(arguments[0], proxy.meminfo.type)
        context.nrt.incref(builder, kind, proxy._getvalue())
        return proxy._getvalue()

    return example(types.intp, example), generate
