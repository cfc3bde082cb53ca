"""Operations on tuples of vectors, for compiled code: `zeros`, `add_powers`, `add_moments`, `interpolate`.

The loops over the tuples are unrolled when this module generates the code. If numba unrolled the loops, the
first use would take longer, because numba would compile every repetition separately.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from dic.correlation.kernel.vectors import (
    FAST,
    FLOAT,
    INDEX,
    Float32Vector,
    broadcast,
    load_elements,
    sum_elements,
    width_of,
)


@intrinsic(prefer_literal=True)
def zeros(typing_context: Any, like: Any, count: Any) -> Any:
    """Return a tuple of `count` vectors of zeros, each as wide as `like`, as start values of sums."""
    sums = types.UniTuple(like, count.literal_value)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        zero = ir.Constant(context.get_value_type(like), None)
        return context.make_tuple(builder, sums, [zero] * count.literal_value)

    return sums(like, count), generate


@intrinsic
def add_powers(typing_context: Any, sums: Any, value: Any, y: Any) -> Any:
    """Return the tuple of sums with value, value·y, value·y², … added to its elements, in this order."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        before, term, y = values
        after = []
        for k in range(len(sums)):
            term = builder.fmul(term, y, flags=FAST) if k else term
            after.append(builder.fadd(builder.extract_value(before, k), term, flags=FAST))
        return context.make_tuple(builder, sums, after)

    return sums(sums, value, y), generate


@intrinsic
def add_moments(typing_context: Any, moments: Any, first: Any, sums: Any, x: Any, inside: Any) -> Any:
    """Add the moments of a strip of columns, in the order 1; x, y; x², xy, y²; …, to `moments[first:]`.

    `sums` are the sums over the rows of the strip, from `add_powers`. `x` holds the offsets of the strip's
    columns. `inside` is 1 for columns of the subset and 0 for columns beyond the subset's edge.
    """

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        target, at, source, x_values, counted = values
        data = context.make_array(moments)(context, builder, target).data
        at = context.cast(builder, at, first, types.intp)
        by_power = [
            builder.fmul(builder.extract_value(source, k), counted, flags=FAST) for k in range(len(sums))
        ]
        for degree in range(len(sums)):
            for power in range(degree + 1):
                place = builder.gep(data, [at], inbounds=True)
                added = sum_elements(builder, by_power[power], width_of(x))
                builder.store(builder.fadd(builder.load(place), added, flags=FAST), place)
                at = builder.add(at, ir.Constant(at.type, 1))
            # The monomials of the next degree are the monomials of this degree times x, and one more power of
            # y.
            for power in range(degree + 1):
                by_power[power] = builder.fmul(by_power[power], x_values, flags=FAST)
        return context.get_dummy_value()

    return types.void(moments, first, sums, x, inside), generate


@intrinsic
def interpolate(typing_context: Any, array: Any, first: Any, pitch: Any, across: Any, down: Any) -> Any:
    """Return ∑_j down[j] ∑_i across[i] array[first + j pitch + i] for a vector of neighbouring pixels.

    `across` and `down` are tuples of vectors with the weights of the spline coefficients (taps). Element k of
    the result belongs to pixel k, whose taps begin at first + k. So the taps with index i of all pixels are
    neighbouring elements, and one load instruction reads them. If the weights are single numbers, there is
    only one pixel, and one load instruction reads the taps of a row.
    """
    single = not isinstance(across[0], Float32Vector)
    width = (4 if len(across) <= 4 else 8) if single else across[0].width

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        source, place, step, weights_across, weights_down = values
        place = context.cast(builder, place, first, types.intp)
        step = context.cast(builder, step, pitch, types.intp)

        def load_at(offset: int) -> Any:
            at = builder.add(place, ir.Constant(place.type, offset))
            return load_elements(context, builder, array, source, at, width)

        weights = [builder.extract_value(weights_across, i) for i in range(len(across))]
        result = None
        for j in range(len(down)):
            weight = builder.extract_value(weights_down, j)
            if single:
                row = load_at(0)
                weight = broadcast(builder, weight, width)
            else:
                row = _weighted_sum(builder, weights, [load_at(i) for i in range(len(across))])
            weighted = builder.fmul(weight, row, flags=FAST)
            result = weighted if result is None else builder.fadd(weighted, result, flags=FAST)
            place = builder.add(place, step)
        if not single:
            return result
        packed = ir.Constant(ir.VectorType(FLOAT, width), [0.0] * width)
        for i, weight in enumerate(weights):
            packed = builder.insert_element(packed, weight, ir.Constant(INDEX, i))
        return sum_elements(builder, builder.fmul(packed, result, flags=FAST), width)

    return across[0](array, first, pitch, across, down), generate


def _weighted_sum(builder: Any, weights: list[Any], terms: list[Any]) -> Any:
    """Generate code for the sum of the products of weights and terms."""
    result = None
    for weight, term in zip(weights, terms, strict=True):
        weighted = builder.fmul(weight, term, flags=FAST)
        result = weighted if result is None else builder.fadd(weighted, result, flags=FAST)
    return result
