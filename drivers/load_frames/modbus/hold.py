"""Send the hold command to a load frame on Modbus, and repeat it until the machine confirms the hold."""

from drivers.clock import Clock
from drivers.errors import DeviceError, DeviceTimeout
from drivers.lines.stop_deadline import StopDeadline, StopTimes
from drivers.load_frames.modbus.command_sequence import CommandSequence
from drivers.load_frames.modbus.registers.map import RegisterMap
from drivers.load_frames.modbus.registers.mapped_device import MappedDevice


def hold_until_confirmed(
    device: MappedDevice, register_map: RegisterMap, sequence: CommandSequence, times: StopTimes, clock: Clock
) -> None:
    """Repeat the hold command until the machine has executed the command and stands still.

    `device` gives access to the machine with urgent requests, which no other request delays. `sequence` gives
    each attempt a new number. Raise `DeviceTimeout` if the machine does not confirm the hold before the
    deadline.
    """
    deadline = StopDeadline(clock, times.deadline_s)
    status, command = register_map.status, register_map.commands.hold
    got = "silence"
    while not deadline.passed:
        try:
            number = sequence.draw()
            device.write(
                register_map.blocks.command, {"command": command, "sequence": number}, "send a command"
            )
            # do not read load and displacement, because a broken load cell must not prevent the confirmation
            values = device.read_status("hold")
            sequence.follow(int(values["executed"]))
            bits = int(values["status"])
            # check the executed number too: older motion commands are ignored only after an executed hold
            executed = values["executed"] == number
            if executed and bits >> status.hold & 1 and not bits >> status.moving & 1:
                return
            got = "a crosshead in motion" if executed else "a hold that was not executed"
        except DeviceError as error:
            got = f"{error.got} instead of {error.expected}"
        clock.sleep(times.poll_s)
    raise DeviceTimeout(device.name, "hold", "a confirmed hold", got, "press the emergency stop")
