"""Machine code of compiled functions: loaded with llvmlite, and called without numba.

Importing numba and loading a function from numba's own cache take longer than the correlation of a small
image. But compiled machine code needs no numba. A function that numba compiled takes numbers only (the layout
that numba calls its calling convention): a place for its result and one for its error, and then the parts of
its arguments. The parts of an array are two unused pointers, the number and size of the elements, the address
of the first element, the shape and the strides. The parts of a tuple are the parts of its elements.
"""

import ctypes
from functools import cache
from itertools import count
from typing import Any

import llvmlite.binding as llvm
import numpy as np

Kind = tuple[Any, ...]
"""The types of a function's arguments. There is machine code of its own for each."""

_WORD = ctypes.c_ssize_t
_TYPES = {bool: ctypes.c_bool, int: ctypes.c_int64, float: ctypes.c_double, np.float32: ctypes.c_float}
_NUMBERS: dict[type, type] = {np.bool_: bool, np.int64: int, np.float64: float}

# Bits of `numpy.ndarray.flags.num`
_ROWS_FIRST, _COLUMNS_FIRST, _ALIGNED, _WRITABLE = 0x1, 0x2, 0x100, 0x400
_FLAGS = _ROWS_FIRST | _COLUMNS_FIRST | _ALIGNED | _WRITABLE

_names = count()


class MachineCode:
    """A compiled function in this process.

    `symbol`: its name in the object file `image`. `kind`: the types of its arguments.
    """

    def __init__(self, symbol: str, image: bytes, kind: Kind) -> None:
        library = llvm.JITLibraryBuilder().add_object_img(image).export_symbol(symbol).add_current_process()
        # The code is unloaded with its library.
        self._library = library.link(_linker(), f"offaxis-{next(_names)}")
        types = ctypes.c_void_p, ctypes.c_void_p, *_types_of(kind)
        self._call = ctypes.CFUNCTYPE(ctypes.c_int32, *types)(self._library[symbol])

    def __call__(self, parts: list[Any]) -> None:
        """Call the function, without Python's global lock, with the parts of its arguments."""
        result, error = ctypes.c_void_p(), ctypes.c_void_p()
        status = self._call(ctypes.addressof(result), ctypes.addressof(error), *parts)
        if status:
            raise RuntimeError(f"compiled code ended with status {status}")


def take_apart(arguments: tuple[Any, ...]) -> tuple[Kind, list[Any]]:
    """Return the types of a function's arguments, and their parts for `MachineCode`."""
    kind: list[Any] = []
    parts: list[Any] = []
    for argument in arguments:
        _take(argument, kind, parts)
    return tuple(kind), parts


def name_of(kind: Kind) -> str:
    """Return the types of arguments as text that is the same in every process."""
    return " ".join(f"{x.__module__}.{x.__qualname__}" if isinstance(x, type) else str(x) for x in kind)


def _take(value: Any, kind: list[Any], parts: list[Any]) -> None:
    """Append the type and the parts of one argument."""
    own = type(value)
    if own is np.ndarray:
        flags = value.flags.num & _FLAGS
        if flags & _ROWS_FIRST:
            flags &= ~_COLUMNS_FIRST  # Both are true of an array with one row.
        kind += np.ndarray, value.dtype.str, value.ndim, flags
        address = value.__array_interface__["data"][0]
        parts += 0, 0, value.size, value.itemsize, address, *value.shape, *value.strides
    elif isinstance(value, tuple):
        kind += own, len(value)
        for each in value:
            _take(each, kind, parts)
    else:
        number = _NUMBERS.get(own, own)
        if number not in _TYPES:
            raise TypeError(f"compiled code takes arrays, tuples and numbers, not {own.__name__}")
        kind.append(number)
        parts.append(number(value))


def _types_of(kind: Kind) -> list[type]:
    """Return the type in C of each part of the arguments."""
    types: list[type] = []
    at = 0
    while at < len(kind):
        if kind[at] is np.ndarray:
            types += [_WORD] * (5 + 2 * kind[at + 2])
            at += 4
        elif kind[at] in _TYPES:
            types.append(_TYPES[kind[at]])
            at += 1
        else:
            at += 2
    return types


@cache
def _linker() -> Any:
    """Return LLVM's linker for this process."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.create_lljit_compiler()


@cache
def processor() -> str:
    """Return the processor for which numba compiles: system, model and instructions."""
    features = llvm.get_host_cpu_features().flatten()
    return " ".join([llvm.get_process_triple(), llvm.get_host_cpu_name(), features])
