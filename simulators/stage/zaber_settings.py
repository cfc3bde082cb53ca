"""The settings of a Zaber stage, for the commands ``get`` and ``set``.

Source: Zaber ASCII Protocol Manual (https://www.zaber.com/protocol-manual), chapter Settings.
"""

from collections.abc import Callable

from simulators.stage.device import StageDevice, StageRefusedError

# In the protocol, a speed is a number of microsteps/s times 1.6384, and an acceleration is a number of
# microsteps/s² times 1.6384e-4.
SPEED_UNIT = 1.6384
ACCELERATION_UNIT = 1.6384e-4
FIRMWARE, BUILD, DEVICE_ID = "7.38", 16451, 50081
CYCLE_DEG = 360

Reading = Callable[[], object]


class ZaberDeviceSettings:
    """The settings of one Zaber device and of its axis.

    `address` is the Zaber address of the device. `serial` is the serial number that the device reports.
    `always_checksum` is the setting `comm.checksum`. If True, every answer has a checksum, even if the
    message has none.
    """

    def __init__(self, device: StageDevice, address: int, serial: int) -> None:
        self._device = device
        self.address = address
        self.always_checksum = False
        self._approach: int | None = None
        self._of_device: dict[str, Reading] = {
            "comm.address": lambda: self.address,
            "comm.checksum": lambda: int(self.always_checksum),
            "comm.packet.size.max": lambda: 80,
            "comm.word.size.max": lambda: 50,
            "comm.command.packets.max": lambda: 1,
            "comm.alert": lambda: 0,
            "comm.protocol": lambda: 2,
            "device.hw.modified": lambda: 0,
            "deviceid": lambda: DEVICE_ID,
            "system.access": lambda: 1,
            "system.axiscount": lambda: 1,
            "system.serial": lambda: serial,
            "system.temperature": lambda: 31.5,
            "system.uptime": lambda: 1000,
            "system.voltage": lambda: 48.0,
            "version": lambda: FIRMWARE,
            "version.build": lambda: BUILD,
        }
        self._of_axis: dict[str, Reading] = {
            "pos": lambda: device.position,
            "vel": lambda: round(device.speed_deg_s * device.microsteps_per_deg * SPEED_UNIT),
            "maxspeed": lambda: round(device.speed_microsteps_s * SPEED_UNIT),
            "accel": lambda: round(device.acceleration_microsteps_s2 * ACCELERATION_UNIT),
            "limit.min": lambda: device.limit_min,
            "limit.max": lambda: device.limit_max,
            "limit.cycle.dist": lambda: CYCLE_DEG * device.microsteps_per_deg,
            "limit.approach.maxspeed": self._approach_speed,
            "resolution": lambda: 64,
            "driver.enabled": lambda: int(device.enabled),
            "driver.temperature": lambda: 35.0,
        }

    def get(self, axis: int, name: str) -> str:
        """Return the value of a setting; raise `StageRefusedError` if the axis has no such setting.

        Axis 0 is the device.
        """
        if name in self._of_device:
            if axis:
                raise StageRefusedError("DEVICEONLY")
            return str(self._of_device[name]())
        if name in self._of_axis:
            return str(self._of_axis[name]())
        raise StageRefusedError("BADCOMMAND")

    def set(self, axis: int, name: str, value: int) -> None:
        """Set a value; raise `StageRefusedError` if the setting is read-only or unknown, or out of range."""
        if axis and name in self._of_device:
            raise StageRefusedError("DEVICEONLY")
        device = self._device
        match name:
            case "maxspeed" if value > 0:
                device.speed_microsteps_s = value / SPEED_UNIT
            case "limit.approach.maxspeed" if value > 0:
                self._approach = value
            case "accel" if value > 0:
                device.acceleration_microsteps_s2 = value / ACCELERATION_UNIT
            case "limit.min" if value < device.limit_max:
                device.limit_min = value
            case "limit.max" if value > device.limit_min:
                device.limit_max = value
            case "pos":
                device.set_position(value)
            case "comm.checksum" if value in (0, 1):
                self.always_checksum = bool(value)
            case "comm.address" if 1 <= value <= 99:
                self.address = value
            case _ if name in self._of_axis or name in self._of_device:
                raise StageRefusedError("BADDATA")
            case _:
                raise StageRefusedError("BADCOMMAND")

    def _approach_speed(self) -> int:
        return self._approach or round(self._device.speed_microsteps_s * SPEED_UNIT)
