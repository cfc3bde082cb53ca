"""Machine code of compiled functions: loaded with llvmlite, and called without numba.

Importing numba and loading a function from numba's own cache take longer than the correlation of a small
image. But machine code needs no numba. `entry` describes what is called here.
"""

import ctypes
from collections.abc import Iterable
from functools import cache
from itertools import count
from typing import Any

import llvmlite.binding as llvm
import numpy as np

ENTRY = "offaxis_entry"
"""Name of the function that is called in the object files."""

Kind = tuple[Any, ...]
"""The types of a function's arguments; there is machine code of its own for each.

The types are flat: of a tuple, its class and its number of elements, and then the types of the elements. An
array has a tuple of data type, number of dimensions, and flags.
"""

NUMBERS = {bool: ctypes.c_bool, int: ctypes.c_int64, float: ctypes.c_double}
_PLAIN: dict[type, type] = {np.bool_: bool, np.int64: int, np.float64: float}

# Bits of `numpy.ndarray.flags.num`: order of the elements, and whether they are aligned and can be written
_BY_ROW, _BY_COLUMN = 0x1, 0x2
_FLAGS = _BY_ROW | _BY_COLUMN | 0x100 | 0x400


class MachineCode:
    """A compiled function in this process.

    `images`: the object files, one of which has the function `ENTRY`. `kind`: the types of its arguments.
    """

    def __init__(self, images: Iterable[bytes], kind: Kind) -> None:
        builder = llvm.JITLibraryBuilder().export_symbol(ENTRY).add_current_process()
        for image in images:
            builder.add_object_img(image)
        # The code is unloaded with its library.
        self._library = builder.link(_linker(), f"offaxis-{next(_names)}")
        types: list[Any] = [ctypes.py_object if is_array(x) else NUMBERS[x] for x in leaves(kind)]
        # A call releases Python's global lock.
        self._call = ctypes.CFUNCTYPE(ctypes.c_int32, *types)(self._library[ENTRY])

    def __call__(self, parts: list[Any]) -> None:
        """Call the function with the arrays and numbers in its arguments."""
        if status := self._call(*parts):
            raise RuntimeError(f"compiled code ended with status {status}")


def take_apart(arguments: tuple[Any, ...]) -> tuple[Kind, list[Any]]:
    """Return the types of a function's arguments, and the arrays and numbers in them."""
    kind: list[Any] = []
    parts: list[Any] = []
    _take(arguments, kind, parts)
    return tuple(kind), parts


def _take(values: tuple[Any, ...], kind: list[Any], parts: list[Any]) -> None:
    for value in values:
        own = type(value)
        if own is np.ndarray:
            kind.append((value.dtype, value.ndim, value.flags.num & _FLAGS))
            parts.append(value)
        elif own in NUMBERS:
            kind.append(own)
            parts.append(value)
        elif isinstance(value, tuple):
            kind += own, len(value)
            _take(value, kind, parts)
        elif own in _PLAIN:
            kind.append(_PLAIN[own])
            parts.append(value.item())
        else:
            raise TypeError(f"compiled code takes arrays, tuples and numbers, not {own.__name__}")


def leaves(kind: Kind) -> list[Any]:
    """Return the types of the arrays and numbers only."""
    return [x for x in kind if is_array(x) or x in NUMBERS]


def is_array(kind: Any) -> bool:
    """Return whether this is the type of an array."""
    return type(kind) is tuple


def name_of(kind: Kind) -> str:
    """Return the types of arguments as text that is the same in every process."""
    words = []
    for each in kind:
        if is_array(each):
            dtype, dimensions, flags = each
            # An array with one row has both orders. Numba takes the first.
            words.append(f"{dtype.str}{dimensions}:{flags & ~_BY_COLUMN if flags & _BY_ROW else flags}")
        else:
            words.append(f"{each.__module__}.{each.__qualname__}" if isinstance(each, type) else str(each))
    return " ".join(words)


_names = count()


@cache
def _linker() -> Any:
    """Return LLVM's linker for this process."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.create_lljit_compiler(suppress_errors=True)


@cache
def processor() -> str:
    """Return the processor for which numba compiles: system, model and instructions."""
    features = llvm.get_host_cpu_features().flatten()
    return " ".join([llvm.get_process_triple(), llvm.get_host_cpu_name(), features])
