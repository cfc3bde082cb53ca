"""The register layouts of the simulators agree with the drivers' maps, which were written separately."""

import struct

import pytest

from drivers.load_frames.modbus.registers.map import load_map
from simulators.load_frame.layout import GENERIC, LAYOUTS, RegisterBlock, RegisterLayout, SimulatedRegister


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_layout_and_the_drivers_map_say_the_same(name):
    layout, register_map = LAYOUTS[name], load_map(name)
    assert layout.word_order == register_map.word_order
    assert register_map.request_max <= layout.request_max
    for block_name in (
        "state",
        "status",
        "identity",
        "command",
        "setpoints",
        "limits",
        "watchdog",
        "heartbeat",
    ):
        block, mapped = getattr(layout, block_name), getattr(register_map.blocks, block_name)
        assert (block is None) == (mapped is None)
        if block is not None:
            here = [(register.kind, register.scale) for register in block.registers]
            there = [(register.type, register.scale) for register in mapped.registers.values()]
            if (name, block_name) == ("generic", "state"):
                # ours counts ms, the map's scale makes seconds of them
                here[-2] = ("u32", 0.001)
            assert (block.address, block.count, here) == (mapped.address, mapped.count, there)
            ours = "input" if block in layout.readable and not layout.one_table else "holding"
            assert mapped.table == ours


def ordered(word_order: str) -> RegisterLayout:
    return RegisterLayout(
        **{
            name: getattr(GENERIC, name)
            for name in (
                "state", "identity", "command", "limits", "watchdog", "heartbeat", "bits", "commands"
            )
        },
        word_order=word_order,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("word_order", "data"),
    [("ABCD", "3f9d70a4"), ("CDAB", "70a43f9d"), ("BADC", "9d3fa470"), ("DCBA", "a4709d3f")],
)
def test_word_orders(word_order, data):
    # 1.23 as IEEE 754 single precision is 0x3F9D70A4
    layout, block = ordered(word_order), RegisterBlock(0, (SimulatedRegister("x", "f32"),))
    assert layout.encode(block, {"x": 1.23}).hex() == data
    assert layout.decode(block, bytes.fromhex(data))["x"] == struct.unpack(">f", bytes.fromhex("3f9d70a4"))[0]


@pytest.mark.parametrize(
    ("kind", "scale", "value", "raw"),
    [
        ("i32", 0.1, -12.34, (-123).to_bytes(4, "big", signed=True)),
        ("i32", 0.1, 1e12, b"\x7f\xff\xff\xff"),  # beyond the register: its end
        ("i32", 0.1, -1e12, b"\x80\x00\x00\x00"),
        ("i32", 0.1, float("nan"), b"\x7f\xff\xff\xff"),  # a broken wire
        ("u16", 0.001, 2.0, b"\x07\xd0"),
        ("u16", 1.0, 65_537, b"\x00\x01"),  # a counter goes round
    ],
)
def test_whole_numbers_with_a_scale(kind, scale, value, raw):
    assert GENERIC.encode(RegisterBlock(0, (SimulatedRegister("x", kind, scale),)), {"x": value}) == raw
