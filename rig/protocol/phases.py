"""The phases of a protocol of the kind "phases", as models of the tables `[[phases]]` in the protocol
file."""

from typing import Annotated, Literal, TypeAlias

from pydantic import Discriminator, Field, model_validator

from drivers.settings import Settings
from rig.protocol.criteria import Until

HOURS_MAX = 30 * 24
CYCLES_MAX = 20_000
IfPassed: TypeAlias = Literal["go-on", "go-back", "fail"]
"""What a motion to a higher value does if its target has been passed already: the phase is left out, the
motion goes back to the target, or the run ends."""
_SECONDS_MAX = HOURS_MAX * 3600.0


def _at_most_one(table: Settings, *names: str) -> None:
    given = [name for name in names if getattr(table, name) not in (None, False)]
    if len(given) > 1:
        raise ValueError(f"only one of {' and '.join(given)} is expected; remove the others")


class LoadImages(Settings):
    """The times of images during a motion to a load. By default they are taken once, at the end."""

    every_n: float | None = Field(
        default=None, gt=0.0, description="increment after which the motion stops and settles"
    )
    every_s: float | None = Field(default=None, gt=0.0, description="time between images during the motion")
    never: bool = False

    @model_validator(mode="after")
    def _one(self) -> "LoadImages":
        _at_most_one(self, "every_n", "every_s", "never")
        return self


class DisplacementImages(Settings):
    """The times of images during a motion to a displacement. By default they are taken once, at the end."""

    every_mm: float | None = Field(
        default=None, gt=0.0, description="increment after which the motion stops and settles"
    )
    every_s: float | None = Field(default=None, gt=0.0, description="time between images during the motion")
    never: bool = False

    @model_validator(mode="after")
    def _one(self) -> "DisplacementImages":
        _at_most_one(self, "every_mm", "every_s", "never")
        return self


class AngleImages(Settings):
    """The times of images during a turn to an angle. By default they are taken once, at the end."""

    every_deg: float | None = Field(
        default=None, gt=0.0, description="increment after which the motion stops and settles"
    )


class HoldImages(Settings):
    """The times of images during a hold. Images are always taken at its end."""

    every_s: float | None = Field(
        default=None, gt=0.0, description="time between images, counted from the start of the hold"
    )


class CycleImages(Settings):
    """The cycles with images, which are taken at both ends. The first and last cycle always have images."""

    every_cycles: int = Field(default=1, ge=1)


class LoadUntil(Until):
    """The event that ends a phase before its target."""

    @model_validator(mode="after")
    def _exactly_one(self) -> "LoadUntil":
        _at_most_one(self, "plastic", "load_drop")
        if self.plastic is None and self.load_drop is None:
            raise ValueError("plastic or load_drop is expected; add one of them")
        return self


class CyclesUntil(Settings):
    """The event that ends the cycles before the last cycle."""

    load_drop: float = Field(
        gt=0.0, lt=1.0, description="fraction by which the load at the higher end of a cycle must drop"
    )
    if_never: Literal["fail", "go-on"] = "fail"


class Preload(Settings):
    """A small load under which the reference images are taken. Only the first phase may be a preload."""

    do: Literal["preload"]
    load_n: float = Field(gt=0.0)
    rate_n_s: float = Field(gt=0.0)


class ToLoad(Settings):
    """A motion to a higher load."""

    do: Literal["to-load"]
    load_n: float = Field(gt=0.0)
    rate_n_s: float = Field(gt=0.0)
    images: LoadImages = LoadImages()
    until: LoadUntil | None = None
    if_passed: IfPassed = "go-on"


class ToDisplacement(Settings):
    """A motion to a larger displacement, counted from the reference."""

    do: Literal["to-displacement"]
    displacement_mm: float = Field(gt=0.0)
    speed_mm_s: float = Field(gt=0.0)
    images: DisplacementImages = DisplacementImages()
    until: LoadUntil | None = None
    if_passed: IfPassed = "go-on"


class Hold(Settings):
    """A hold at constant load (creep), displacement (relaxation) or angle (rest)."""

    do: Literal["hold"]
    keep: Literal["load", "displacement", "angle"]
    duration_s: float = Field(gt=0.0, le=_SECONDS_MAX)
    rate_n_s: float | None = Field(
        default=None, gt=0.0, description="rate at which a load that drifts is corrected"
    )
    images: HoldImages = HoldImages()

    @model_validator(mode="after")
    def _rate_with_load(self) -> "Hold":
        if self.keep == "load" and self.rate_n_s is None:
            raise ValueError("rate_n_s is missing; add it, because a load that drifts is corrected at a rate")
        if self.keep != "load" and self.rate_n_s is not None:
            raise ValueError('rate_n_s belongs to keep = "load" only; remove it')
        return self


class Cycles(Settings):
    """Cycles between two loads or between two displacements."""

    do: Literal["cycles"]
    count: int = Field(ge=1, le=CYCLES_MAX)
    low_n: float | None = Field(default=None, ge=0.0)
    high_n: float | None = Field(default=None, gt=0.0)
    rate_n_s: float | None = Field(default=None, gt=0.0)
    low_mm: float | None = None
    high_mm: float | None = None
    speed_mm_s: float | None = Field(default=None, gt=0.0)
    images: CycleImages = CycleImages()
    until: CyclesUntil | None = None

    @model_validator(mode="after")
    def _one_quantity(self) -> "Cycles":
        of_load = {"low_n": self.low_n, "high_n": self.high_n, "rate_n_s": self.rate_n_s}
        of_way = {"low_mm": self.low_mm, "high_mm": self.high_mm, "speed_mm_s": self.speed_mm_s}
        given = [[name for name, value in keys.items() if value is not None] for keys in (of_load, of_way)]
        if [len(names) for names in given] not in ([3, 0], [0, 3]):
            raise ValueError(
                f"{', '.join(of_load)}, or {', '.join(of_way)} are expected, got "
                f"{', '.join(given[0] + given[1]) or 'none of them'}"
            )
        low, high = self.ends
        if not low < high:
            raise ValueError(f"the lower end must be below the higher end, got {low:g} and {high:g}")
        return self

    @property
    def ends(self) -> tuple[float, float]:
        """The lower and the higher end, in N or mm."""
        low = self.low_n if self.low_mm is None else self.low_mm
        high = self.high_n if self.high_mm is None else self.high_mm
        assert low is not None
        assert high is not None
        return low, high


class Unload(Settings):
    """A motion back to a lower load."""

    do: Literal["unload"]
    load_n: float = Field(default=0.0, ge=0.0)
    rate_n_s: float = Field(gt=0.0)
    images: LoadImages = LoadImages()


class Rotate(Settings):
    """A turn of the stage to an angle, counted from the reference at 0 degrees."""

    do: Literal["rotate"]
    angle_deg: float
    images: AngleImages = AngleImages()


Phase: TypeAlias = Preload | ToLoad | ToDisplacement | Hold | Cycles | Unload | Rotate
PhaseTable: TypeAlias = Annotated[Phase, Discriminator("do")]
