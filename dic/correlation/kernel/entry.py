"""The way from Python into compiled code: a small function in machine code, called with `ctypes`.

A function that numba compiled takes numbers only (numba's calling convention). The first two are addresses
for its result and for an error. Then follow the parts of its arguments: of an array, two unused pointers,
number and size of the elements, address of the first one, shape and strides. The function that this module
generates takes the arrays as they are, and reads these numbers from NumPy's structure for arrays
(`PyArrayObject`), whose beginning is part of NumPy's binary interface.
"""

import ctypes
from collections.abc import Iterator

import llvmlite.binding as llvm

from dic.correlation.kernel.machine_code import ENTRY, Kind, is_array, leaves

_POINTER = ctypes.sizeof(ctypes.c_void_p)
_WORD = f"i{8 * _POINTER}"
_NUMBERS = {bool: "i8", int: "i64", float: "double"}

# Offsets of fields of `PyArrayObject`
_DATA = object.__basicsize__
_SHAPE, _STRIDES = _DATA + 2 * _POINTER, _DATA + 3 * _POINTER


def entry_of(symbol: str, kind: Kind) -> bytes:
    """Return the object file of the function `ENTRY`, which calls the function `symbol` compiled by numba."""
    types = leaves(kind)
    lines: list[str] = []
    given = [f"{'ptr' if is_array(x) else _NUMBERS[x]} %a{k}" for k, x in enumerate(types)]
    passed = ["ptr %result", "ptr %error"]
    for k, x in enumerate(types):
        passed += _parts_of(f"%a{k}", x, lines) if is_array(x) else [given[k]]
    taken = ", ".join(each.split()[0] for each in passed)
    code = "\n".join(
        [
            f'declare i32 @"{symbol}"({taken})',
            f"define i32 @{ENTRY}({', '.join(given)}) {{",
            "%result = alloca ptr",
            "%error = alloca ptr",
            *lines,
            f'%status = call i32 @"{symbol}"({", ".join(passed)})',
            "ret i32 %status",
            "}",
        ]
    )
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_triple(llvm.get_process_triple())
    machine = target.create_target_machine(opt=2, reloc="static", codemodel="large", jit=True)
    image: bytes = machine.emit_object(llvm.parse_assembly(code))
    return image


def _parts_of(array: str, kind: Kind, lines: list[str]) -> Iterator[str]:
    """Yield the parts of an array, and append the code that reads them to `lines`."""

    def read(name: str, kind: str, address: str, offset: int) -> str:
        name = f"{array}.{name}"
        lines.append(f"{name}.at = getelementptr i8, ptr {address}, i64 {offset}")
        lines.append(f"{name} = load {kind}, ptr {name}.at")
        return name

    dtype, dimensions, _ = kind
    data, shape, strides = (
        read(name, "ptr", array, offset)
        for name, offset in (("data", _DATA), ("shape", _SHAPE), ("strides", _STRIDES))
    )
    extents = [read(f"n{k}", _WORD, shape, k * _POINTER) for k in range(dimensions)]
    steps = [read(f"s{k}", _WORD, strides, k * _POINTER) for k in range(dimensions)]
    size = "1"
    for k, extent in enumerate(extents):
        lines.append(f"{array}.size{k} = mul {_WORD} {size}, {extent}")
        size = f"{array}.size{k}"
    yield from ("ptr null", "ptr null", f"{_WORD} {size}", f"{_WORD} {dtype.itemsize}", f"ptr {data}")
    yield from (f"{_WORD} {each}" for each in (*extents, *steps))
