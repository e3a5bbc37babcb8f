"""Calls between compiled loops: of code that stays apart, and of code that is put where it is called.

numba puts the code of a loop into each loop that calls it, and compiles it there again, and again in the loops above.
For loops that are called a few times a step this costs half of the time of the compiler, and saves nothing.
It also compiles a loop anew for each number that stands in a call, as True or 6; here all numbers of a type are one.
"""

from __future__ import annotations

import hashlib
import importlib
import inspect
from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar, cast

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

F = TypeVar("F", bound=Callable[..., object])


def called(function: F) -> F:
    """Return what other loops call a compiled function by, so that its code does not become part of theirs.

    It compiles for the types of the arguments. Either the function or what is returned has to be found by the
    function's name in its module.
    """

    def call(context: Any, builder: Any, kinds: tuple[Any, ...], values: list[Any]) -> Any:
        overload, symbol = _linked(cast(Any, function), kinds)
        # what is read from disk in another process looks for the function first
        again = partial(_link_again, function.__module__, function.__name__, kinds, symbol)
        context.active_code_library._reload_init.add(again)
        convention, result = context.call_conv, overload.signature.return_type
        kind = convention.get_function_type(result, kinds)
        code = cgutils.get_or_insert_function(builder.module, kind, symbol)  # type: ignore[no-untyped-call]
        status, value = convention.call_function(builder, code, result, kinds, values)
        with cgutils.if_unlikely(builder, status.is_error):  # type: ignore[no-untyped-call]
            convention.return_status_propagate(builder, status)
        return value

    return _call(function, call)


def put_in(function: F) -> F:
    """Return what other loops call a compiled function by, so that its code becomes part of theirs."""

    def call(context: Any, builder: Any, kinds: tuple[Any, ...], values: list[Any]) -> Any:
        overload = cast(Any, function).overloads[kinds]
        context.add_linking_libs([overload.library])
        # its code looks for functions too; where it was read from disk, numba does not hand on that it does
        context.active_code_library._reload_init.update(overload.reload_init)
        return context.call_internal(builder, overload.fndesc, overload.signature, values)

    return _call(function, call)


def _call(function: F, call: Callable[..., Any]) -> F:
    """Return what other loops call a function by; `call` writes the code."""
    dispatcher = cast(Any, function)

    def define(typing: Any, *given: Any) -> Any:
        kinds = tuple(map(types.unliteral, given))
        dispatcher.compile(kinds)

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            values = [context.cast(builder, *each) for each in zip(values, given, kinds, strict=True)]
            return call(context, builder, kinds, values)

        return dispatcher.overloads[kinds].signature.return_type(*given), generate

    # numba reads the names of the arguments, and how many there are
    own = inspect.signature(dispatcher.py_func)
    first = inspect.Parameter("typing", inspect.Parameter.POSITIONAL_OR_KEYWORD)
    define.__signature__ = own.replace(parameters=[first, *own.parameters.values()])  # type: ignore[attr-defined]
    define.__name__ = function.__name__
    result: Any = intrinsic(define)
    result.dispatcher = dispatcher
    return cast(F, result)


def _linked(dispatcher: Any, kinds: tuple[Any, ...]) -> tuple[Any, str]:
    """Compiled code of a function for some types, and a name by which other code finds it in each process."""
    dispatcher.compile(kinds)
    overload, function = dispatcher.overloads[kinds], dispatcher.py_func
    key = hashlib.sha256(f"{kinds} {overload.signature.return_type}".encode()).hexdigest()
    symbol = f"{function.__module__}.{function.__qualname__}.{key[:32]}"
    importlib.import_module("llvmlite.binding").add_symbol(
        symbol, overload.library.get_pointer_to_function(overload.fndesc.llvm_func_name)
    )
    return overload, symbol


def _link_again(module: str, name: str, kinds: tuple[Any, ...], symbol: str) -> None:
    """Find the code that a loop calls which is read from disk."""
    function = getattr(importlib.import_module(module), name)
    if _linked(getattr(function, "dispatcher", function), kinds)[1] != symbol:
        raise ImportError(f"compiled loops on disk expect another {module}.{name}; empty the folder NUMBA_CACHE_DIR")
