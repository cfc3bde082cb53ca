import math

import pytest

from drivers.registers import Block, Register

# -118.625 is C2ED4000 in IEEE 754 single precision: sign, exponent 133, mantissa 1.853515625.
WORDS = {
    "ABCD": [0xC2ED, 0x4000],
    "CDAB": [0x4000, 0xC2ED],
    "BADC": [0xEDC2, 0x0040],
    "DCBA": [0x0040, 0xEDC2],
}


def register(**values: object) -> Register:
    return Register.model_validate({"address": 0, "type": "f32"} | values)


@pytest.mark.parametrize("order", WORDS)
def test_a_float_stands_in_all_four_word_orders(order):
    assert register().decode(WORDS[order], order) == -118.625
    assert register().encode(-118.625, order) == WORDS[order]


@pytest.mark.parametrize("order", WORDS)
@pytest.mark.parametrize(
    ("type_", "value"), [("u32", 0xDEADBEEF), ("i32", -2), ("u16", 65535), ("i16", -32768)]
)
def test_whole_numbers_come_back_in_every_order(type_, value, order):
    each = register(type=type_)
    assert each.decode(each.encode(value, order), order) == value


def test_a_single_register_is_big_endian_on_the_wire():
    assert register(type="i16").encode(-2, "ABCD") == [0xFFFE]


def test_scaled_whole_numbers():
    load = register(type="i32", scale=0.1, unit="N")
    assert load.encode(-1234.5, "CDAB") == [(-12345 & 0xFFFFFFFF) & 0xFFFF, (-12345 & 0xFFFFFFFF) >> 16]
    assert load.decode(load.encode(-1234.5, "CDAB"), "CDAB") == pytest.approx(-1234.5)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_floats_that_are_no_numbers_are_refused(value):
    with pytest.raises(ValueError, match="no valid value"):
        register().decode(register().encode(value, "ABCD"), "ABCD")


def test_sentinels_and_impossible_values_are_refused():
    load = register(type="i32", unit="N", invalid=[0x7FFFFFFF], valid=[-10.0, 10.0])
    assert load.decode(load.encode(10, "ABCD"), "ABCD") == 10
    with pytest.raises(ValueError, match="no valid value"):
        load.decode([0x7FFF, 0xFFFF], "ABCD")
    with pytest.raises(ValueError, match="11 N, outside -10 to 10"):
        load.decode([0, 11], "ABCD")


@pytest.mark.parametrize(("type_", "value"), [("u16", -1), ("u16", 65536), ("i16", 40000), ("u32", 2**32)])
def test_values_that_do_not_fit_are_refused_not_clipped(type_, value):
    with pytest.raises(ValueError, match=f"does not fit {type_}"):
        register(type=type_).encode(value, "ABCD")


def test_a_block_gives_its_values_by_name_and_names_the_bad_one():
    block = Block.model_validate(
        {
            "table": "input",
            "registers": {
                "load": {"address": 11, "type": "f32", "unit": "N"},
                "status": {"address": 10, "type": "u16"},
            },
        }
    )
    words = block.encode({"status": 5, "load": -118.625}, "ABCD")
    assert (block.address, block.count, words) == (10, 3, [5, 0xC2ED, 0x4000])
    assert block.decode(words, "ABCD") == {"status": 5, "load": -118.625}
    with pytest.raises(ValueError, match="load is no valid value"):
        block.decode([5, 0x7FC0, 0], "ABCD")
    assert block.decode([5, 0x7FC0, 0], "ABCD", names=["status"]) == {"status": 5}
