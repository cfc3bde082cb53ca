"""Numba's compiler, with the types of the decorated function kept."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Compile `function` to machine code at its first call, without the interpreter's lock, cached on disk.

    Division by zero gives infinity or NaN as in NumPy, and sums keep their written order.
    """
    return cast(Function, numba.njit(cache=True, nogil=True, error_model="numpy")(function))
