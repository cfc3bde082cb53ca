"""The table [mounting] of a protocol and of a rig file: how the grid and the specimen are mounted."""

from pydantic import Field, field_validator

from dic.runfile.schema import FixedFace
from drivers.settings import Settings

_FARTHEST_MM = 1e4


class Mounting(Settings):
    """What is known about the position of the specimen's surface, to correct motion out of the plane.

    A value in the protocol replaces the value in the rig file.
    """

    plate_mm: float | None = Field(
        default=None,
        ge=-100.0,
        le=100.0,
        description="distance of the specimen's surface behind the grid's lines",
    )
    tilt_axis_mm: float | list[float] | None = Field(
        default=None, description="X and Y, or Y alone, of the grips' hinge in the grid's axes"
    )
    shift_std_um: float | None = Field(
        default=None,
        ge=0.0,
        le=1e4,
        description="standard deviation of the specimen's shift towards the camera since the reference",
    )
    fixed_face: FixedFace | None = Field(
        default=None, description="what the grips hold in place while the specimen becomes thinner"
    )

    @field_validator("tilt_axis_mm", mode="after")
    @classmethod
    def _is_place(cls, value: float | list[float] | None) -> float | list[float] | None:
        numbers = value if isinstance(value, list) else [0.0 if value is None else value]
        if (isinstance(value, list) and len(value) != 2) or any(abs(v) > _FARTHEST_MM for v in numbers):
            raise ValueError(
                f"X and Y of the grips' hinge in mm, at most {_FARTHEST_MM:g} mm away, are expected, such as "
                f"[0, -30], got {value}"
            )
        return value

    @property
    def hinge_mm(self) -> tuple[float, float] | None:
        """X and Y of the grips' hinge in the grid's axes, or None if no hinge is declared."""
        if isinstance(self.tilt_axis_mm, list):
            x, y = self.tilt_axis_mm
            return x, y
        return None if self.tilt_axis_mm is None else (0.0, self.tilt_axis_mm)

    def facts(self) -> list[str]:
        """Return one text for each declared value."""
        hinge = self.hinge_mm
        return [
            *([] if self.plate_mm is None else [f"surface {self.plate_mm:g} mm behind the grid's lines"]),
            *([] if hinge is None else [f"hinge of the grips at {hinge[0]:g}, {hinge[1]:g} mm"]),
            *([] if self.shift_std_um is None else [f"shift known to {self.shift_std_um:g} µm"]),
            *([] if self.fixed_face is None else [f"grips hold the specimen's {self.fixed_face}"]),
        ]

    def over(self, other: "Mounting") -> "Mounting":
        """Return the values of this table, completed by those of `other` for keys that are missing here."""
        own = self.model_dump(exclude_none=True)
        return Mounting(**other.model_dump(exclude_none=True) | own)
