import copy
from typing import Any

import pytest

from drivers.errors import ConfigurationError
from drivers.load_frames.modbus.registers.map import load_map, parse_map, shipped_maps
from drivers.settings import read_toml
from tests.places import ROOT

GENERIC = read_toml(ROOT / "drivers/load_frames/modbus/maps" / "generic.toml")


@pytest.fixture
def table() -> dict[str, Any]:
    return copy.deepcopy(GENERIC)


def mistakes(table: dict[str, Any]) -> list[str]:
    with pytest.raises(ConfigurationError) as caught:
        parse_map(table, "map.toml")
    return caught.value.mistakes


@pytest.mark.parametrize("name", shipped_maps())
def test_every_shipped_map_is_sound(name):
    register_map = load_map(name)
    blocks = [getattr(register_map.blocks, block) for block in type(register_map.blocks).model_fields]
    assert all(block.count <= register_map.request_max for block in blocks if block is not None)


def test_a_map_is_read_by_its_path(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(
        (ROOT / "drivers/load_frames/modbus/maps/generic.toml").read_text().replace("generic", "own")
    )
    assert load_map(str(path)).vendor == "own"


def test_a_missing_map_is_told():
    with pytest.raises(ConfigurationError, match=r"neither a file nor a shipped map \(generic, "):
        load_map("/nowhere/map.toml")


def test_an_overlap_inside_a_block(table):
    table["blocks"]["state"]["registers"]["sample"]["address"] = 2
    found = mistakes(table)
    assert "blocks.state: status at 3 overlaps sample, to 3" in found


def test_a_gap_inside_a_block(table):
    del table["blocks"]["state"]["registers"]["spare"]
    assert mistakes(table) == [
        "blocks.state: 7 to 7, between result and load, are not declared; declare them or make two blocks"
    ]


def test_blocks_that_overlap(table):
    table["blocks"]["watchdog"]["registers"]["timeout"]["address"] = 65
    assert mistakes(table) == ["blocks.heartbeat: holding 66 overlaps blocks.watchdog, to 66"]


def test_the_same_address_in_two_tables_is_no_overlap(table):
    blocks = parse_map(table, "map.toml").blocks
    assert (blocks.state.table, blocks.state.registers["revision"].address) == ("input", 0)
    assert (blocks.command.table, blocks.command.registers["command"].address) == ("holding", 0)


def test_a_block_too_long_for_one_request(table):
    table["request_max"] = 16
    assert mistakes(table) == ["blocks.state: 20 registers, more than 16 in one request"]


def test_a_wrong_unit(table):
    table["blocks"]["state"]["registers"]["load"]["unit"] = "mm"
    assert mistakes(table) == [
        "blocks.state.registers.load.unit: must be 'N', got 'mm'; convert by scale",
    ]


def test_a_set_speed_in_another_unit_than_the_driver_compares(table):
    table["blocks"]["state"]["registers"]["set_speed"]["unit"] = "mm"
    assert mistakes(table) == [
        "blocks.state.registers.set_speed.unit: must be 'mm/s', got 'mm'; convert by scale"
    ]


def test_a_change_of_speed_must_differ_from_the_other_commands(table):
    """A command that begins a motion may not serve as one that only changes its speed."""
    table["commands"]["change_speed"] = table["commands"]["go_to_displacement"]
    assert mistakes(table) == ["commands: every command must have a value of its own"]


def test_a_written_block_in_the_input_table(table):
    table["blocks"]["heartbeat"] = {
        "table": "input",
        "registers": {"heartbeat": {"address": 66, "type": "u16"}},
    }
    assert mistakes(table) == ["blocks.heartbeat.table: must be 'holding', because it is written"]


def test_a_counter_that_cannot_count(table):
    table["blocks"]["heartbeat"]["registers"]["heartbeat"]["type"] = "i16"
    assert mistakes(table) == ["blocks.heartbeat.registers.heartbeat.type: must be u16, got 'i16'"]


def test_a_sentinel_that_its_type_cannot_show(table):
    table["blocks"]["state"]["registers"]["fault"]["invalid"] = [-1]
    assert len(mistakes(table)) == 1
    assert "-1 never stands in u16" in mistakes(table)[0]


def test_a_block_of_more_than_one_register_cannot_be_written_singly(table):
    table["blocks"]["watchdog"]["single"] = True
    assert mistakes(table) == ["blocks.watchdog.single: one register is expected, got 2"]


def test_set_points_that_stand_apart_are_looked_for_there(table):
    command = table["blocks"]["command"]["registers"]
    apart = {name: command.pop(name) for name in ("displacement", "speed", "load")}
    command["sequence"]["address"] = 1
    command.pop("load_rate")
    for name, address in zip(apart, (100, 102, 104), strict=True):
        apart[name]["address"] = address
    table["blocks"]["setpoints"] = {"table": "holding", "registers": apart}
    assert mistakes(table) == ["blocks.setpoints.registers.load_rate: is missing; add it"]


def test_two_commands_of_one_value(table):
    table["commands"]["tare"] = table["commands"]["hold"]
    assert len(mistakes(table)) == 1


def test_two_status_bits_in_one_place(table):
    table["status"]["hold"] = table["status"]["moving"]
    assert len(mistakes(table)) == 1


def test_all_mistakes_of_a_map_are_reported_together(table):
    table["colour"] = "red"
    table["word_order"] = "DBCA"
    del table["blocks"]["identity"]
    state = table["blocks"]["state"]["registers"]
    state["load"]["unit"] = "kN"
    state["sample"]["address"] = 2
    del state["executed"]
    table["blocks"]["watchdog"]["registers"]["timeout"]["address"] = 65
    found = "\n".join(mistakes(table))
    for where in (
        "colour",
        "word_order",
        "blocks.identity",
        "load.unit",
        "overlaps sample",
        "executed",
        "overlaps blocks.watchdog",
    ):
        assert where in found


def test_a_bit_that_the_status_has_not_got(table):
    """It is never set: a machine in motion would be taken for one that stands."""
    table["status"] |= {"moving": 16, "faults": {"watchdog": 17}}
    assert mistakes(table) == [
        "status.moving: the register has bits 0 to 15, got 16",
        "status.faults.watchdog: the register has bits 0 to 15, got 17",
    ]
    # in the register that counts
    apart = read_toml(ROOT / "drivers/load_frames/modbus/maps" / "separate-words.toml")
    apart["status"]["moving"] = 16
    assert mistakes(apart) == ["status.moving: the register has bits 0 to 15, got 16"]


@pytest.mark.parametrize(
    ("block", "name", "change", "mistake"),
    [
        ("state", "status", {"type": "i16"}, "type: must be u16 or u32, got 'i16'"),
        ("state", "executed", {"scale": 0.1}, "scale: must be 1, got 0.1"),
        ("state", "revision", {"scale": 10.0}, "scale: must be 1, got 10"),
        ("command", "command", {"type": "i16"}, "type: must be u16, got 'i16'"),
        ("command", "command", {"scale": 2.0}, "scale: must be 1, got 2"),
        ("identity", "serial", {"type": "f32"}, "type: must be u16 or u32 or i16 or i32, got 'f32'"),
    ],
)
def test_a_number_that_is_no_measurement_stands_as_it_is(table, block, name, change, mistake):
    """A hold whose command word does not fit its register could never be sent."""
    table["blocks"][block]["registers"][name] |= change
    assert mistakes(table) == [f"blocks.{block}.registers.{name}.{mistake}"]


def test_names_of_the_driver_mean_nothing_in_other_blocks(table):
    """A heartbeat must be a plain u16 where the driver writes it, but not among the readings."""
    table["blocks"]["state"]["registers"]["heartbeat"] = {"address": 20, "type": "f32", "unit": "N"}
    blocks = parse_map(table, "map.toml").blocks
    # 1.5 N as IEEE 754 writes it, in the two words behind the 20 of the map
    assert blocks.state.decode([0] * 20 + [0x3FC0, 0], "ABCD", {"heartbeat"}) == {"heartbeat": 1.5}
    assert blocks.heartbeat.registers["heartbeat"].type == "u16"


@pytest.mark.parametrize("number", ["one", "0", "0x10", "-1", "01"])
def test_a_meaning_of_a_number_that_is_none(table, number):
    table["results"][number] = "something"
    assert mistakes(table) == [
        f"results: a decimal number above 0 is expected before each meaning, got {number}"
    ]


@pytest.mark.parametrize(("block", "most"), [("limits", 123), ("state", 125)])
def test_a_block_longer_than_modbus_allows(table, block, most):
    """MODBUS Application Protocol V1.1b3: 125 registers are read at once (6.3), 123 written (6.12)."""
    registers = table["blocks"][block]["registers"]
    first = max(each["address"] for each in registers.values()) + 2
    start = min(each["address"] for each in registers.values())
    if block == "limits":
        for name in ("watchdog", "heartbeat"):
            for each in table["blocks"][name]["registers"].values():
                each["address"] += 1000
    else:
        for each in table["blocks"]["identity"]["registers"].values():
            each["address"] += 1000
    for address in range(first, start + most):
        registers[f"spare_{address}"] = {"address": address, "type": "u16"}
    parse_map(table, "map.toml")
    registers["last"] = {"address": start + most, "type": "u16"}
    assert mistakes(table) == [f"blocks.{block}: {most + 1} registers, more than {most} in one request"]
