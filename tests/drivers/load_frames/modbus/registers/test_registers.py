import math
import struct

import pytest

from drivers.load_frames.modbus.registers.registers import Block, Register

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
        register().decode(list(struct.unpack(">HH", struct.pack(">f", value))), "ABCD")
    with pytest.raises(ValueError, match="no valid value"):
        register().encode(value, "ABCD")


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


def test_what_the_machine_cannot_mean_is_not_written_either():
    speed = register(type="u16", scale=0.01, unit="mm/s", invalid=[0xFFFF], valid=[0.0, 700.0])
    assert speed.encode(1.5, "ABCD") == [150]
    for value in (655.35, 700.1):
        with pytest.raises(ValueError, match=r"no valid value|outside|does not fit"):
            speed.encode(value, "ABCD")
    with pytest.raises(ValueError, match="300 mm/s, outside 0 to 200"):
        register(type="u16", scale=0.01, unit="mm/s", valid=[0.0, 200.0]).encode(300.0, "ABCD")


def test_a_float_at_the_end_of_its_range_is_written_although_it_is_rounded_beyond():
    """5.3 in single precision is 5.30000019."""
    assert register(unit="mm", valid=[0.0, 5.3]).encode(5.3, "ABCD") == [0x40A9, 0x999A]


@pytest.mark.parametrize(
    ("type_", "scale", "unit", "value"),
    [("u16", 0.001, "s", 0.0004), ("u32", 1e-4, "mm/s", 4e-5), ("f32", 1.0, "N/s", 1e-46)],
)
def test_a_rate_or_time_too_small_for_its_register_is_not_written_as_0(type_, scale, unit, value):
    """A watchdog of 0 s is none, and some machines take a speed of 0 for the greatest."""
    small = register(type=type_, scale=scale, unit=unit)
    with pytest.raises(ValueError, match=f"would be 0 in {type_}"):
        small.encode(value, "ABCD")
    assert small.encode(0.0, "ABCD") == [0] * small.size
    # a place so near zero is zero
    assert register(type="i32", scale=1e-4, unit="mm").encode(4e-5, "ABCD") == [0, 0]


def test_the_negative_zero_is_written_as_zero():
    """A machine that shows it as the other one would seem not to have taken it."""
    assert register().encode(-0.0, "ABCD") == [0, 0]


@pytest.mark.parametrize("raw", [0x7F7FFFFF, 10**39])
def test_a_sentinel_of_a_float_is_its_number_not_its_bits(raw):
    with pytest.raises(ValueError, match=f"{raw} never stands in f32"):
        register(invalid=[raw])
    with pytest.raises(ValueError, match="no valid value"):
        register(invalid=[-9999]).decode([0xC61C, 0x3C00], "ABCD")


def test_registers_without_a_value_stay_as_they_are():
    block = Block.model_validate(
        {
            "table": "holding",
            "registers": {"spare": {"address": 0, "type": "u16"}, "load": {"address": 1, "type": "f32"}},
        }
    )
    assert block.encode({"load": -118.625}, "ABCD", [7, 8, 9]) == [7, 0xC2ED, 0x4000]
    assert block.encode({"load": -118.625}, "ABCD") == [0, 0xC2ED, 0x4000]
    with pytest.raises(ValueError, match="load: 1e\\+39  does not fit f32"):
        block.encode({"load": 1e39}, "ABCD")
