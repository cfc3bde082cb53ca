"""Driver for a tensile load frame on Modbus TCP or RTU. A register map describes the machine."""

from drivers.interfaces import OpenContext
from drivers.lines.addresses import resolve_address
from drivers.lines.call_time import CallTime
from drivers.lines.stop_deadline import STOP_TIMES, StopTimes
from drivers.load_frames.modbus.bus.link import ModbusLink
from drivers.load_frames.modbus.find import FINDER
from drivers.load_frames.modbus.frame import ModbusLoadFrame
from drivers.load_frames.modbus.guard import GUARD
from drivers.load_frames.modbus.registers.map import load_map
from drivers.load_frames.modbus.registers.mapped_device import MappedDevice
from drivers.load_frames.modbus.settings import ModbusLoadFrameSettings, cautions
from drivers.load_frames.modbus.speed_frame import ModbusSpeedFrame
from drivers.registry import DriverSpec


def open_frame(
    settings: ModbusLoadFrameSettings, context: OpenContext, hold_times: StopTimes = STOP_TIMES
) -> ModbusLoadFrame:
    """Connect, identify the machine, write its limits and read them back. No motion is started.

    If the register map has the command `change_speed`, the load frame is a `ModbusSpeedFrame`.

    Raise `DeviceError` if the machine does not answer, or does not accept a limit, and `ConfigurationError`
    if the register map has mistakes.
    """
    register_map = load_map(settings.map)
    place = settings.place(resolve_address(settings.address, context), context.relay)
    shared = place.rtu or settings.connections - (1 if context.guarded else 0) < 2
    name = f"{context.name} ({place.text})"
    call_time = CallTime(context.call_timeout_s, patience_s=context.patience_s)
    links = [
        ModbusLink(name, place, settings.unit, settings.reply_timeout_s, hold_times.answer_s, call_time)
        for _ in range(1 if shared else 2)
    ]
    work, safety = MappedDevice(links[0], register_map), MappedDevice(links[-1], register_map, urgent=True)
    try:
        with call_time.opening(settings.reply_timeout_s):
            made = ModbusLoadFrame if register_map.commands.change_speed is None else ModbusSpeedFrame
            return made(settings, context, register_map, work, safety, hold_times, call_time)
    except BaseException:
        work.close()
        safety.close()
        raise


SPEC = DriverSpec(
    kind="load_frame",
    settings=ModbusLoadFrameSettings,
    open=open_frame,
    find=FINDER,
    guard=GUARD,
    cautions=cautions,
)
