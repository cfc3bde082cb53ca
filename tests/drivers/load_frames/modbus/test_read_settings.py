"""The settings that a load frame reports are those in its registers, whatever the rig file says."""

from dataclasses import replace

import pytest

from drivers.interfaces import OpenContext
from drivers.load_frames.modbus.load_frame import open_frame
from drivers.load_frames.modbus.registers.map import load_map
from drivers.load_frames.modbus.registers.mapped_device import MappedDevice
from simulators.load_frame.device import LoadFrameDevice
from tests.drivers.load_frames.modbus.watched_port import Port, settings


def test_reports_what_the_machine_was_set_to_and_not_what_the_rig_file_says(
    port: Port, device: LoadFrameDevice, context: OpenContext
):
    frame = open_frame(settings(port.address), context)
    try:
        assert frame.read_settings()["load_max_n"] == 12000.0
        device.set_limits(replace(device.limits, load_max_n=800.0))
        device.set_watchdog(0.75)
        found = frame.read_settings()
        assert (found["load_max_n"], found["watchdog_s"]) == (800.0, 0.75)
        assert found["firmware"] == frame.info.firmware
    finally:
        frame.close()


class _Words:
    """A link to registers that never change."""

    name = "frame"

    def __init__(self, words: list[int]) -> None:
        self._words = words

    def read(self, table: str, address: int, count: int, *, urgent: bool = False) -> list[int]:
        return self._words[:count]


@pytest.mark.parametrize(("word", "known"), [(0x7FFF, {"timeout"}), (7, {"timeout", "spare"})])
def test_an_unused_register_without_a_valid_value_is_left_out(word, known):
    register_map = load_map("generic")
    block = register_map.blocks.watchdog
    spare = type(block.registers["timeout"])(address=66, type="u16", invalid=[0x7FFF])
    block = block.model_copy(update={"registers": {**block.registers, "spare": spare}})
    device = MappedDevice(_Words([0x4000, 0, word]), register_map)
    assert device.read_valid(block, "read settings", {"timeout"}).keys() == known
