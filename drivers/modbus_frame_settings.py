"""What a rig file says about a Modbus load frame."""

from typing import Self

from pydantic import Field, field_validator, model_validator

from drivers.interfaces import FrameLimits
from drivers.settings import Settings


class ModbusFrameSettings(Settings):
    """Address, limits and times of a load frame.

    Attributes
    ----------
    address : str
        ``host:port``, or ``@name`` of a simulated rig's server.
    map : str
        A shipped register map's name, or the path of a map.
    unit : int
        Modbus unit identifier.
    load_min_n, load_max_n, displacement_min_mm, displacement_max_mm : float
    speed_max_mm_s, load_rate_max_n_s : float
        Limits, also written to the machine and read back.
    watchdog_s : float
        The machine holds by itself when it is not read for so long while it moves; 0 switches that off.
    stale_after_s : float
        Readings whose sample counter has stood still for longer are refused.
    reply_timeout_s : float
        How long an answer may take.
    """

    address: str
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
        host, colon, port = address.rpartition(":")
        if not address.startswith("@") and not (
            host and colon and port.isdecimal() and 0 < int(port) < 65536
        ):
            raise ValueError("expected host:port, or @name in a simulated rig")
        return address

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.load_min_n >= self.load_max_n or self.displacement_min_mm >= self.displacement_max_mm:
            raise ValueError("every minimum must be below its maximum")
        return self

    @property
    def limits(self) -> FrameLimits:
        """The limits as one value."""
        return FrameLimits(
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
