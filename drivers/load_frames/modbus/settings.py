"""Rig-file settings of a Modbus load frame."""

from typing import Literal, Self

from pydantic import Field, field_validator, model_validator

from drivers.errors import ConfigurationError
from drivers.interfaces import LoadFrameLimits
from drivers.load_frames.modbus.bus.address import SERIAL_UNITS, ModbusAddress, address_mistake
from drivers.load_frames.modbus.registers.map import load_map
from drivers.settings import Settings


class ModbusLoadFrameSettings(Settings):
    """Address, limits and times of a load frame.

    Attributes
    ----------
    address : str
        ``host:port`` for Modbus TCP, ``rtu://host:port`` for a gateway of RTU frames over TCP, the path
        of a serial port for Modbus RTU, or ``@name`` of a simulated rig's server.
    baud : int
    parity : str
    stop_bits : int
        Only for a serial port; the defaults are those of the specification.
    map : str
        A shipped register map's name, or the path of a map.
    unit : int
        Modbus unit identifier.
    connections : int
        Over TCP: 2, so that a hold has its own connection, or 1 if the machine accepts only one.
    load_min_n, load_max_n, displacement_min_mm, displacement_max_mm : float
    speed_max_mm_s, load_rate_max_n_s : float
        Limits, also written to the machine and read back.
    watchdog_s : float
        A moving machine holds by itself if it is not read for this time; 0 switches the watchdog off.
    stale_after_s : float
        Readings whose sample counter has stood still for longer are refused.
    reply_timeout_s : float
        Time limit for an answer; for a hold 1 s at most.
    """

    address: str
    baud: int = Field(default=19_200, ge=300, le=4_000_000)
    parity: Literal["N", "E", "O"] = "E"
    stop_bits: Literal[1, 2] = 1
    connections: Literal[1, 2] = 2
    map: str = "generic"
    unit: int = Field(default=1, ge=0, le=255)
    load_min_n: float = -100.0
    load_max_n: float = Field(gt=0)
    displacement_min_mm: float = -1.0
    displacement_max_mm: float = Field(gt=0)
    speed_max_mm_s: float = Field(default=1.0, gt=0)
    load_rate_max_n_s: float = Field(default=1000.0, gt=0)
    watchdog_s: float = Field(default=2.0, ge=0, le=60)
    stale_after_s: float = Field(default=0.5, gt=0)
    reply_timeout_s: float = Field(default=1.0, gt=0, le=60)

    @field_validator("address")
    @classmethod
    def _reachable(cls, address: str) -> str:
        if not address.startswith("@") and (mistake := address_mistake(address)):
            raise ValueError(mistake)
        return address

    @field_validator("map")
    @classmethod
    def _sound(cls, name: str) -> str:
        # checked here, so that mistakes of the map are reported with all others before a device is opened
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
        if place.rtu and "connections" in self.model_fields_set:
            raise ValueError(
                "connections belong to Modbus TCP; remove them: a line is one, and a hold goes first"
            )
        if place.rtu and self.unit not in SERIAL_UNITS:
            raise ValueError("a unit from 1 to 247 is expected on a serial line: nobody answers a broadcast")
        return self

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.load_min_n >= self.load_max_n or self.displacement_min_mm >= self.displacement_max_mm:
            raise ValueError("every minimum must be below its maximum")
        return self

    def place(self, address: str) -> ModbusAddress:
        """The machine's address, after ``@name`` was looked up."""
        return ModbusAddress(address, self.baud, self.parity, self.stop_bits)

    @property
    def limits(self) -> LoadFrameLimits:
        """The limits as one value."""
        return LoadFrameLimits(
            load_min_n=self.load_min_n,
            load_max_n=self.load_max_n,
            displacement_min_mm=self.displacement_min_mm,
            displacement_max_mm=self.displacement_max_mm,
            speed_max_mm_s=self.speed_max_mm_s,
            load_rate_max_n_s=self.load_rate_max_n_s,
        )

    @property
    def limits_by_register(self) -> dict[str, float]:
        """The limits by their names in a register map."""
        return {
            "load_min": self.load_min_n,
            "load_max": self.load_max_n,
            "displacement_min": self.displacement_min_mm,
            "displacement_max": self.displacement_max_mm,
            "speed_max": self.speed_max_mm_s,
            "load_rate_max": self.load_rate_max_n_s,
        }
