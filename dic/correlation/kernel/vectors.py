"""Explicit vectors for numba: groups of 8 or 16 float32 numbers that one processor instruction works on.

LLVM, the compiler behind numba, vectorises plain loops. LLVM cannot vectorise the correlation loop, because
the memory addresses from which this loop reads depend on the warp. With the vector types of this module, the
loop itself says which operations are parallel. The user's machine needs no compiler, and LLVM chooses the
widest instructions of the processor. The width of a vector is part of its type. So one function can be
compiled for each width, and also for single float32 numbers.

Compiled code calls `ramp16`, `ramp8`, `load`, `splat`, `fma`, `select`, `at_least` and `total`. The operators
+, - and * also work on vectors. The other public names of this module generate code for
`dic.correlation.kernel.unrolled`.
"""

import operator
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, lower_builtin, models, register_model, type_callable
from numpy.typing import NDArray

Vector = NDArray[np.float32]
"""The type of a vector for the type checker mypy."""

FAST = ("fast",)
INDEX = ir.IntType(32)
FLOAT = ir.FloatType()


class Float32Vector(types.Type):
    """The numba type of a vector of `width` float32 numbers."""

    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(name=f"float32x{width}")


class BoolVector(types.Type):
    """The numba type of a vector of `width` truth values."""

    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(name=f"boolx{width}")


@register_model(Float32Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Float32Vector) -> None:
        super().__init__(manager, kind, ir.VectorType(FLOAT, kind.width))


@register_model(BoolVector)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: BoolVector) -> None:
        super().__init__(manager, kind, ir.VectorType(ir.IntType(1), kind.width))


_VECTORS = {width: Float32Vector(width) for width in (8, 16)}
_MASKS = {width: BoolVector(width) for width in _VECTORS}


def width_of(kind: Any) -> int:
    """Return the number of elements of a value of this type, which is 1 for a single number."""
    return kind.width if isinstance(kind, Float32Vector) else 1


def broadcast(builder: Any, scalar: Any, width: int) -> Any:
    """Generate code for a vector whose elements are all equal to `scalar`."""
    if width == 1:
        return scalar
    kind = ir.VectorType(FLOAT, width)
    one = builder.insert_element(ir.Constant(kind, ir.Undefined), scalar, ir.Constant(INDEX, 0))
    zeros = ir.Constant(ir.VectorType(INDEX, width), [0] * width)
    return builder.shuffle_vector(one, ir.Constant(kind, ir.Undefined), zeros)


def load_elements(context: Any, builder: Any, array_type: Any, array: Any, index: Any, width: int) -> Any:
    """Generate code that loads `width` neighbouring elements of an array from `index` on."""
    data = context.make_array(array_type)(context, builder, array).data
    place = builder.gep(data, [index], inbounds=True)
    if width == 1:
        return builder.load(place)
    vector = builder.load(builder.bitcast(place, ir.VectorType(FLOAT, width).as_pointer()))
    vector.align = 4
    return vector


def _ramp(width: int) -> Any:
    @intrinsic
    def ramp(typing_context: Any, first: Any) -> Any:
        """Return the vector first, first + 1, first + 2 …"""

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            start = context.cast(builder, values[0], signature.args[0], types.float32)
            steps = ir.Constant(ir.VectorType(FLOAT, width), [float(k) for k in range(width)])
            return builder.fadd(broadcast(builder, start, width), steps)

        return _VECTORS[width](first), generate

    return ramp


ramp8, ramp16 = _ramp(8), _ramp(16)


@intrinsic
def load(typing_context: Any, like: Any, array: Any, index: Any) -> Any:
    """Return a vector, as wide as `like`, of neighbouring elements of `array` from `index` on."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        place = context.cast(builder, values[2], signature.args[2], types.intp)
        return load_elements(context, builder, signature.args[1], values[1], place, width_of(like))

    return like(like, array, index), generate


@intrinsic
def splat(typing_context: Any, like: Any, scalar: Any) -> Any:
    """Return a vector, as wide as `like`, whose elements are all `scalar`; return a float32 for width 1."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        number = context.cast(builder, values[1], scalar, types.float32)
        return broadcast(builder, number, width_of(like))

    return like(like, scalar), generate


@intrinsic
def fma(typing_context: Any, a: Any, b: Any, c: Any) -> Any:
    """Return a * b + c for the elements of three vectors."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.fadd(builder.fmul(values[0], values[1], flags=FAST), values[2], flags=FAST)

    return a(a, b, c), generate


@intrinsic
def select(typing_context: Any, mask: Any, a: Any, b: Any) -> Any:
    """Return a vector with the elements of `a` where `mask` is true, and the elements of `b` elsewhere."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.select(*values)

    return a(mask, a, b), generate


@intrinsic
def at_least(typing_context: Any, a: Any, b: Any) -> Any:
    """Return a mask that is true where an element of `a` is at least as large as the element of `b`."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.fcmp_ordered(">=", *values)

    return (_MASKS[a.width] if isinstance(a, Float32Vector) else types.boolean)(a, b), generate


def sum_elements(builder: Any, vector: Any, width: int) -> Any:
    """Generate code that sums a vector's elements by adding its halves until one element is left."""
    if width == 1:
        return vector
    while width > 1:
        width //= 2
        empty = ir.Constant(vector.type, ir.Undefined)
        halves = [
            builder.shuffle_vector(
                vector,
                empty,
                ir.Constant(ir.VectorType(INDEX, width), list(range(start, start + width))),
            )
            for start in (0, width)
        ]
        vector = builder.fadd(*halves, flags=FAST)
    return builder.extract_element(vector, ir.Constant(INDEX, 0))


@intrinsic
def total(typing_context: Any, a: Any) -> Any:
    """Return the sum of the elements of a vector."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return sum_elements(builder, values[0], width_of(a))

    return types.float32(a), generate


def _register(function: Any, instruction: str, vector: Float32Vector) -> None:
    @type_callable(function)
    def typer_of(context: Any) -> Any:
        def typer(a: Any, b: Any) -> Any:
            return vector if a is vector and b is vector else None

        return typer

    @lower_builtin(function, vector, vector)
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return getattr(builder, instruction)(*values, flags=FAST)


for _function, _instruction in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul")):
    for _kind in _VECTORS.values():
        _register(_function, _instruction, _kind)
