"""Behaviour that only a very large number of commands shows."""

from collections.abc import Mapping

from drivers.clock import VirtualClock
from drivers.lines.stop_deadline import STOP_TIMES
from drivers.load_frames.modbus.commands import LoadFrameCommands
from drivers.load_frames.modbus.registers.map import load_map
from drivers.load_frames.modbus.registers.registers import Block, Number
from drivers.load_frames.modbus.settings import ModbusLoadFrameSettings


class Listener:
    """A machine that accepts every request and records the values of its heartbeat register."""

    name = "frame"

    def __init__(self) -> None:
        self.beats: list[int] = []

    def read_state(self, step: str) -> dict[str, Number]:
        return {"executed": 0}

    def set(self, block: Block, values: Mapping[str, Number], step: str) -> None:
        block.encode(values, "ABCD")

    def write(self, block: Block, values: Mapping[str, Number], step: str, *, harmless: bool = False) -> None:
        self.beats += block.encode(values, "ABCD")

    def shares_link(self, other: object) -> bool:
        return True


def test_the_heartbeat_goes_round_and_always_changes():
    """A run over night has more heartbeats than 16 bits can count."""
    machine = Listener()
    settings = ModbusLoadFrameSettings(address="host:502", load_max_n=100.0, displacement_max_mm=1.0)
    commands = LoadFrameCommands(settings, VirtualClock(), load_map("generic"), machine, machine, STOP_TIMES)  # type: ignore[arg-type]
    for _ in range(2**16 + 2):
        commands.stay_in_charge()
    assert all(beat != after for beat, after in zip(machine.beats, machine.beats[1:], strict=False))
    assert set(machine.beats) == set(range(2**16))
