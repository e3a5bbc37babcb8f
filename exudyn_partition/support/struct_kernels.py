"""Base of the types of objects with several arrays, which compiled loops take as one argument."""

from __future__ import annotations

from collections.abc import Iterable
from inspect import Parameter, Signature
from typing import Any

from numba import types
from numba.core import cgutils
from numba.experimental import structref
from numba.experimental.jitclass.base import imp_dtor
from numba.extending import intrinsic, lower_builtin, type_callable


class StructType(types.StructRef):
    """Type of such an object; `structref.register` it."""

    def preprocess_fields(self, fields):  # type: ignore[no-untyped-def]
        """See numba."""
        return tuple((name, types.unliteral(kind)) for name, kind in fields)  # type: ignore[no-untyped-call]


def define_struct(proxy: type, kind: type[StructType], fields: Iterable[str]) -> None:
    """Let loops make objects of a class by its fields in their order, and hand them to Python.

    `structref.define_proxy` does the same by a function that sets the fields one by one. It is compiled for each class,
    and again for the loop that makes the object.
    """
    names = [*fields]

    @type_callable(proxy)
    def define(context: Any) -> Any:
        def find(*kinds: Any) -> Any:
            return kind([*zip(names, kinds, strict=True)])

        # numba reads how many arguments there are
        find.__signature__ = Signature(  # type: ignore[attr-defined]
            [Parameter(name, Parameter.POSITIONAL_OR_KEYWORD) for name in names]
        )
        return find

    @lower_builtin(proxy, types.VarArg(types.Any))  # type: ignore[no-untyped-call, untyped-decorator]
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        made = signature.return_type
        inside = cgutils.create_struct_proxy(made.get_data_type())(context, builder)  # type: ignore[no-untyped-call]
        for name, given, value in zip(names, signature.args, arguments, strict=True):
            field = made.field_dict[name]
            setattr(inside, name, context.cast(builder, value, given, field))
            context.nrt.incref(builder, field, getattr(inside, name))
        values = inside._getvalue()
        size = context.get_constant(types.uintp, context.get_abi_sizeof(values.type))
        free = imp_dtor(context, builder.module, made)  # type: ignore[no-untyped-call]
        room = context.nrt.meminfo_alloc_dtor(builder, size, free)
        builder.store(values, builder.bitcast(context.nrt.meminfo_data(builder, room), values.type.as_pointer()))
        struct = cgutils.create_struct_proxy(made)(context, builder)  # type: ignore[no-untyped-call]
        struct.meminfo = room
        return struct._getvalue()

    structref.define_boxing(kind, proxy)  # type: ignore[no-untyped-call]


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
