"""If two programs command one load frame, as from two computers, each notices the other and holds."""

import struct
from collections.abc import Iterator
from contextlib import closing

import pytest

from drivers.clock import VirtualClock
from drivers.errors import DeviceFault
from drivers.load_frames.modbus.command_sequence import LEAP_MAX, CommandSequence
from drivers.load_frames.modbus.load_frame import ModbusLoadFrame, open_frame
from tests.drivers.load_frames.modbus.watched_port import COMMAND_ADDRESS, settings

FOREIGN = "a command of another program"


@pytest.fixture
def other(port, context) -> Iterator[ModbusLoadFrame]:
    with closing(open_frame(settings(port.address), context)) as opened:
        yield opened


def test_the_first_of_two_programs_notices_the_second_at_its_next_reading(frame, other, device):
    frame.go_to_displacement(1.0, 0.1)
    with pytest.raises(DeviceFault, match=FOREIGN):
        other.go_to_displacement(2.0, 0.1)
    other.hold()
    assert device.read().holding
    with pytest.raises(DeviceFault, match=FOREIGN):
        frame.read()


def test_the_second_of_two_programs_notices_the_first(frame, other, device):
    other.go_to_displacement(1.0, 0.1)
    with pytest.raises(DeviceFault, match=FOREIGN):
        frame.read()
    frame.hold()
    assert device.read().holding
    with pytest.raises(DeviceFault, match=FOREIGN):
        other.read()


def test_both_give_the_same_number_of_commands_and_still_tell_each_other_apart(frame, other, port):
    """When all programs counted on from the machine's number, a foreign command passed as the own one."""
    frame.tare()
    lost = iter([True])

    def lose(request: bytes, answer):
        return None if request[0] == 16 and len(request) > 20 and next(lost, False) else answer()

    port.tamper = lose
    with pytest.raises(DeviceFault, match=FOREIGN):
        other.go_to_displacement(1.0, 0.1)


def test_no_motion_follows_until_the_load_frame_was_opened_again(frame, other, port, context, device):
    other.hold()
    with pytest.raises(DeviceFault, match=FOREIGN):
        frame.read()
    frame.hold()
    with pytest.raises(DeviceFault, match=FOREIGN):
        frame.go_to_displacement(0.1, 0.1)
    with closing(open_frame(settings(port.address), context)) as again:
        again.go_to_displacement(0.1, 0.1)
        assert device.read().moving


def test_a_hold_that_meets_foreign_numbers_does_not_make_them_its_own(frame, port, device):
    """The hold goes on from the foreign number; the next reading must fail nevertheless."""
    port.answer(1, struct.pack(">BHHBHffffH", 16, COMMAND_ADDRESS, 10, 20, 1, 0, 0, 0, 0, 20_000))
    frame.hold()
    assert device.read().holding
    with pytest.raises(DeviceFault, match=FOREIGN):
        frame.read()


def test_the_first_number_is_newer_than_the_machines_and_hardly_ever_the_same():
    firsts = [(CommandSequence(65_000).draw() - 65_000) % 2**16 for _ in range(200)]
    assert all(0 < first <= LEAP_MAX for first in firsts)
    # 200 of 8192 numbers: two equal ones are usual, ten are not
    assert len(set(firsts)) > 190


def test_a_reading_from_before_a_hold_is_no_restart_when_it_is_judged_after_it():
    """A hold is confirmed on a thread of its own."""
    sequence = CommandSequence(7, leap=100)
    held = sequence.draw()
    sequence.follow(held)
    sequence.check(7)
    sequence.check(held)
    with pytest.raises(ValueError, match="a restarted machine"):
        sequence.check(7)


def test_time_does_not_matter_to_a_foreign_command(frame, other, clock: VirtualClock):
    other.hold()
    clock.sleep(3600.0)
    with pytest.raises(DeviceFault, match=FOREIGN):
        frame.read()
