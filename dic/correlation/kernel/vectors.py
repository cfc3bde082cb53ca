"""Explicit vectors for numba: values of 8 or 16 float32 on which one instruction works at once.

LLVM vectorises plain loops, but not the correlation loop, whose loads depend on the warp. These types let the
loop state what is parallel. They need no compiler on the user's machine, and LLVM chooses the widest
instructions that the processor has. The width of a vector is part of its type, so a function that is written
once compiles for each width, and for single numbers (float32) too.

Public names are functions for compiled code only: `ramp16`, `ramp8`, `load`, `splat`, `fma`, `select`,
`at_least`, `total`, `zeros`, `add_powers`, `add_moments`, `interpolate`; vectors also take +, - and * with
one another. Loops over tuples are unrolled here, while the code is generated: numba would compile every
repetition as an operation of its own, which takes longer at the first use.
"""

import operator
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, lower_builtin, models, register_model, type_callable
from numpy.typing import NDArray

Vector = NDArray[np.float32]
"""What a vector is to mypy: several numbers at once."""

_FAST = ("fast",)
_INDEX = ir.IntType(32)
_FLOAT = ir.FloatType()


class _Vector(types.Type):
    """The type of `width` float32."""

    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(name=f"float32x{width}")


class _Mask(types.Type):
    """The type of `width` truth values."""

    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(name=f"boolx{width}")


@register_model(_Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: _Vector) -> None:
        super().__init__(manager, kind, ir.VectorType(_FLOAT, kind.width))


@register_model(_Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: _Mask) -> None:
        super().__init__(manager, kind, ir.VectorType(ir.IntType(1), kind.width))


_VECTORS = {width: _Vector(width) for width in (8, 16)}
_MASKS = {width: _Mask(width) for width in _VECTORS}


def _width(kind: Any) -> int:
    """Return how many numbers a value of this type holds."""
    return kind.width if isinstance(kind, _Vector) else 1


def _broadcast(builder: Any, scalar: Any, width: int) -> Any:
    if width == 1:
        return scalar
    kind = ir.VectorType(_FLOAT, width)
    one = builder.insert_element(ir.Constant(kind, ir.Undefined), scalar, ir.Constant(_INDEX, 0))
    zeros = ir.Constant(ir.VectorType(_INDEX, width), [0] * width)
    return builder.shuffle_vector(one, ir.Constant(kind, ir.Undefined), zeros)


def _load(context: Any, builder: Any, array_type: Any, array: Any, index: Any, width: int) -> Any:
    data = context.make_array(array_type)(context, builder, array).data
    place = builder.gep(data, [index], inbounds=True)
    if width == 1:
        return builder.load(place)
    vector = builder.load(builder.bitcast(place, ir.VectorType(_FLOAT, width).as_pointer()))
    vector.align = 4
    return vector


def _ramp(width: int) -> Any:
    @intrinsic
    def ramp(typing_context: Any, first: Any) -> Any:
        """Return the vector first, first + 1, first + 2 …"""

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            start = context.cast(builder, values[0], signature.args[0], types.float32)
            steps = ir.Constant(ir.VectorType(_FLOAT, width), [float(k) for k in range(width)])
            return builder.fadd(_broadcast(builder, start, width), steps)

        return _VECTORS[width](first), generate

    return ramp


ramp8, ramp16 = _ramp(8), _ramp(16)


@intrinsic
def load(typing_context: Any, like: Any, array: Any, index: Any) -> Any:
    """Return as many neighbouring elements of `array` from `index` on as `like` has."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        place = context.cast(builder, values[2], signature.args[2], types.intp)
        return _load(context, builder, signature.args[1], values[1], place, _width(like))

    return like(like, array, index), generate


@intrinsic
def splat(typing_context: Any, like: Any, scalar: Any) -> Any:
    """Return a vector, as wide as `like`, of one number; the number as float32 if `like` is one."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        number = context.cast(builder, values[1], scalar, types.float32)
        return _broadcast(builder, number, _width(like))

    return like(like, scalar), generate


@intrinsic
def fma(typing_context: Any, a: Any, b: Any, c: Any) -> Any:
    """Return a * b + c."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.fadd(builder.fmul(values[0], values[1], flags=_FAST), values[2], flags=_FAST)

    return a(a, b, c), generate


@intrinsic
def select(typing_context: Any, mask: Any, a: Any, b: Any) -> Any:
    """Return a where the mask is true and b elsewhere."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.select(*values)

    return a(mask, a, b), generate


@intrinsic
def at_least(typing_context: Any, a: Any, b: Any) -> Any:
    """Return the mask of a >= b."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.fcmp_ordered(">=", *values)

    return (_MASKS[a.width] if isinstance(a, _Vector) else types.boolean)(a, b), generate


def _sum(builder: Any, vector: Any, width: int) -> Any:
    """Add one half of the vector to the other until one element is left."""
    if width == 1:
        return vector
    while width > 1:
        width //= 2
        empty = ir.Constant(vector.type, ir.Undefined)
        halves = [
            builder.shuffle_vector(
                vector,
                empty,
                ir.Constant(ir.VectorType(_INDEX, width), list(range(start, start + width))),
            )
            for start in (0, width)
        ]
        vector = builder.fadd(*halves, flags=_FAST)
    return builder.extract_element(vector, ir.Constant(_INDEX, 0))


@intrinsic
def total(typing_context: Any, a: Any) -> Any:
    """Return the sum of the elements."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return _sum(builder, values[0], _width(a))

    return types.float32(a), generate


@intrinsic(prefer_literal=True)
def zeros(typing_context: Any, like: Any, count: Any) -> Any:
    """Return a tuple of `count` zeros, each as wide as `like`: the sums that `add_powers` adds to."""
    sums = types.UniTuple(like, count.literal_value)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        zero = ir.Constant(context.get_value_type(like), None)
        return context.make_tuple(builder, sums, [zero] * count.literal_value)

    return sums(like, count), generate


@intrinsic
def add_powers(typing_context: Any, sums: Any, value: Any, y: Any) -> Any:
    """Return the sums with value, value y, value y² … added to the first, second, third …"""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        before, term, y = values
        after = []
        for k in range(len(sums)):
            term = builder.fmul(term, y, flags=_FAST) if k else term
            after.append(builder.fadd(builder.extract_value(before, k), term, flags=_FAST))
        return context.make_tuple(builder, sums, after)

    return sums(sums, value, y), generate


@intrinsic
def add_moments(typing_context: Any, moments: Any, first: Any, sums: Any, x: Any, inside: Any) -> Any:
    """Add a strip's moments with the monomials 1; x, y; x², xy, y²; … to `moments`, from place `first` on.

    `sums` are what `add_powers` has summed over the strip's rows. `x` holds the offsets of its columns;
    `inside` is 1 for columns of the subset and 0 for columns beyond its edge.
    """

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        target, at, source, x_values, counted = values
        data = context.make_array(moments)(context, builder, target).data
        at = context.cast(builder, at, first, types.intp)
        by_power = [
            builder.fmul(builder.extract_value(source, k), counted, flags=_FAST) for k in range(len(sums))
        ]
        for degree in range(len(sums)):
            for power in range(degree + 1):
                place = builder.gep(data, [at], inbounds=True)
                added = _sum(builder, by_power[power], _width(x))
                builder.store(builder.fadd(builder.load(place), added, flags=_FAST), place)
                at = builder.add(at, ir.Constant(at.type, 1))
            # The next degree has everything so far times x, and a higher power of y.
            for power in range(degree + 1):
                by_power[power] = builder.fmul(by_power[power], x_values, flags=_FAST)
        return context.get_dummy_value()

    return types.void(moments, first, sums, x, inside), generate


@intrinsic
def interpolate(typing_context: Any, array: Any, first: Any, pitch: Any, across: Any, down: Any) -> Any:
    """Return ∑_j down[j] ∑_i across[i] array[first + j pitch + i], for neighbouring pixels at once.

    `across` and `down` are tuples of vectors, the weights of the taps. Element k of the result uses the taps
    that begin at first + k, so one tap of all pixels is one load of neighbouring elements. If the weights are
    single numbers, for one pixel, one load takes the taps of a row instead.
    """
    alone = not isinstance(across[0], _Vector)
    width = (4 if len(across) <= 4 else 8) if alone else across[0].width

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        source, place, step, weights_across, weights_down = values
        place = context.cast(builder, place, first, types.intp)
        step = context.cast(builder, step, pitch, types.intp)

        def load_at(offset: int) -> Any:
            at = builder.add(place, ir.Constant(place.type, offset))
            return _load(context, builder, array, source, at, width)

        weights = [builder.extract_value(weights_across, i) for i in range(len(across))]
        result = None
        for j in range(len(down)):
            weight = builder.extract_value(weights_down, j)
            if alone:
                row = load_at(0)
                weight = _broadcast(builder, weight, width)
            else:
                row = _weighted_sum(builder, weights, [load_at(i) for i in range(len(across))])
            weighted = builder.fmul(weight, row, flags=_FAST)
            result = weighted if result is None else builder.fadd(weighted, result, flags=_FAST)
            place = builder.add(place, step)
        if not alone:
            return result
        in_one = ir.Constant(ir.VectorType(_FLOAT, width), [0.0] * width)
        for i, weight in enumerate(weights):
            in_one = builder.insert_element(in_one, weight, ir.Constant(_INDEX, i))
        return _sum(builder, builder.fmul(in_one, result, flags=_FAST), width)

    return across[0](array, first, pitch, across, down), generate


def _weighted_sum(builder: Any, weights: list[Any], terms: list[Any]) -> Any:
    result = None
    for weight, term in zip(weights, terms, strict=True):
        weighted = builder.fmul(weight, term, flags=_FAST)
        result = weighted if result is None else builder.fadd(weighted, result, flags=_FAST)
    return result


def _register(function: Any, instruction: str, vector: _Vector) -> None:
    @type_callable(function)
    def typer_of(context: Any) -> Any:
        def typer(a: Any, b: Any) -> Any:
            return vector if a is vector and b is vector else None

        return typer

    @lower_builtin(function, vector, vector)
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return getattr(builder, instruction)(*values, flags=_FAST)


for _function, _instruction in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul")):
    for _kind in _VECTORS.values():
        _register(_function, _instruction, _kind)
