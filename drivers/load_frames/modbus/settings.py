"""Rig-file settings of a load frame on Modbus."""

from dataclasses import astuple, fields
from typing import Literal, Self

from pydantic import Field, field_validator, model_validator

from drivers.errors import ConfigurationError
from drivers.interfaces import LoadFrameLimits
from drivers.load_frames.modbus.bus.address import ModbusAddress, ModbusPlaceSettings
from drivers.load_frames.modbus.registers.map import load_map
from drivers.load_frames.modbus.registers.map_mistakes import NEEDED


class ModbusLoadFrameSettings(ModbusPlaceSettings):
    """Address, limits and times of a load frame, as given in the rig file.

    Attributes
    ----------
    echo : bool
        True if the RS-485 adapter of a two-wire RTU line also receives what it sends.
    map : str
        Name of a register map in this package, or path of a register map.
    connections : int
        Number of Modbus TCP connections that the machine accepts. With 3, ordinary requests, hold commands
        and the guardian process each have a connection. With 2 and a guardian, ordinary requests and hold
        commands share a connection, and a hold command goes first. With 1, a guardian owns the connection and
        passes all requests.
    load_min_n, load_max_n, displacement_min_mm, displacement_max_mm : float
    speed_max_mm_s, load_rate_max_n_s : float
        Limits of load, displacement, speed and load rate, also written to the machine and read back.
    watchdog_s : float
        A moving machine stops and holds if the program does not read it for this time, in seconds.
    watchdog : str, optional
        ``off: REASON`` switches the watchdog off. Every plan and every start of a run prints the reason.
    stale_after_s : float
        A reading is refused if the sample counter has not increased for longer than this time, in seconds.
    reply_timeout_s : float
        Longest wait for an answer, in seconds. For a hold command the wait is 1 s at most.
    """

    echo: bool = False
    connections: Literal[1, 2, 3] = 3
    map: str = "generic"
    load_min_n: float = -100.0
    load_max_n: float = Field(gt=0)
    displacement_min_mm: float = -1.0
    displacement_max_mm: float = Field(gt=0)
    speed_max_mm_s: float = Field(default=1.0, gt=0)
    load_rate_max_n_s: float = Field(default=1000.0, gt=0)
    watchdog_s: float = Field(default=2.0, ge=0, le=60)
    watchdog: str | None = None
    stale_after_s: float = Field(default=0.5, gt=0)
    reply_timeout_s: float = Field(default=0.25, gt=0, le=60)

    @field_validator("map")
    @classmethod
    def _sound(cls, name: str) -> str:
        # load the register map now, so that its mistakes are reported before a device is opened
        try:
            load_map(name)
        except ConfigurationError as error:
            raise ValueError(f"{error.source}: {'; '.join(error.mistakes)}") from error
        return name

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        place = self.place(self.address)
        line = self.model_fields_set & {"baud", "parity", "stop_bits"}
        if line and not (place.serial or self.address.startswith("@")):
            raise ValueError(f"{', '.join(sorted(line))} belong to a serial port; remove them")
        if self.echo and not (place.rtu or self.address.startswith("@")):
            raise ValueError("`echo` belongs to Modbus RTU on a two-wire line; remove it")
        if place.rtu and "connections" in self.model_fields_set:
            raise ValueError(
                "`connections` is for Modbus TCP only; remove it: on a serial line a hold goes first anyway"
            )
        return self

    @model_validator(mode="after")
    def _watched(self) -> Self:
        if self.watchdog is None:
            if self.watchdog_s == 0:
                raise ValueError(
                    "watchdog_s = 0 would switch the watchdog off: give a time such as 2.0, or say why it "
                    'is off with watchdog = "off: REASON" instead'
                )
        elif not self.watchdog_off:
            raise ValueError('watchdog: "off: REASON" is expected; a time belongs into watchdog_s')
        elif "watchdog_s" in self.model_fields_set:
            raise ValueError("watchdog_s belongs to a watchdog that is on; remove watchdog_s or watchdog")
        return self

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.load_min_n >= self.load_max_n or self.displacement_min_mm >= self.displacement_max_mm:
            raise ValueError("every minimum must be below its maximum")
        return self

    def place(self, address: str, relay: str = "") -> ModbusAddress:
        """Return the machine's address with the relay and the settings of its line.

        The setting `address` must not be ``@name``.
        """
        return ModbusAddress(address, self.baud, self.parity, self.stop_bits, relay, self.echo)

    @property
    def watchdog_off(self) -> str:
        """The reason why the watchdog is off, or an empty text if it is on."""
        word, _, reason = (self.watchdog or "").partition(":")
        return reason.strip() if word.strip() == "off" else ""

    @property
    def watchdog_timeout_s(self) -> float:
        """The time in s that is written to the machine. The value 0 switches the watchdog off."""
        return 0.0 if self.watchdog_off else self.watchdog_s

    @property
    def changes_speed(self) -> bool:
        """True if the register map has the command that changes the speed of a motion."""
        return load_map(self.map).commands.change_speed is not None

    @property
    def limits(self) -> LoadFrameLimits:
        """All limits of the machine in one object."""
        return LoadFrameLimits(**{each.name: getattr(self, each.name) for each in fields(LoadFrameLimits)})

    @property
    def limits_by_register(self) -> dict[str, float]:
        """All limits of the machine, keyed by their names in a register map."""
        # the registers are named in the order of the attributes of `LoadFrameLimits`
        return dict(zip(NEEDED["limits"], astuple(self.limits), strict=True))


def cautions(settings: ModbusLoadFrameSettings) -> list[str]:
    """Return one sentence for each dangerous setting."""
    if not settings.watchdog_off:
        return []
    return [
        f"the machine's own watchdog is off ({settings.watchdog_off}): if this computer hangs or its network "
        "fails, a motion goes on until the emergency stop is pressed"
    ]
