"""Protocols: what a person declares in TOML, and the steps that follow from it."""

import math
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import BeforeValidator, Field, ValidationError, model_validator

from drivers.errors import ConfigurationError
from drivers.settings import Settings, mistakes_in, read_toml_text
from rig.errors import ProtocolError
from rig.protocol.plasticity import PlasticCriterion
from rig.protocol.step import Execute, ProtocolStep


class Sample(Settings):
    """The specimen's declared geometry."""

    name: str = Field(min_length=1, max_length=200)
    thickness_mm: float = Field(gt=0.0)
    width_mm: float = Field(gt=0.0)
    gauge_length_mm: float = Field(gt=0.0)


class Grid(Settings):
    """The calibration grid that the operator attaches; the default is the paper's, 10 mm x 10 mm."""

    lines_x: int = Field(default=21, ge=4, le=1000, description="number of lines crossed on a path along X")
    lines_y: int = Field(default=21, ge=4, le=1000, description="number of lines crossed on a path along Y")
    pitch_mm: float = Field(default=0.5, gt=0.0, description="distance of neighbouring lines")


class Images(Settings):
    """How many images each camera takes per step, and how long one may take."""

    per_step: int = Field(default=1, ge=1, le=1000)
    timeout_s: float = Field(default=5.0, gt=0.0, le=60.0)


class _Settle(Settings):
    dwell_s: float = Field(gt=0.0, description="how long the value must stay within its tolerance")
    timeout_s: float = Field(gt=0.0, description="from the command to the end of the dwell")
    poll_s: float = Field(default=0.1, gt=0.0, le=1.0, description="time between two readings")


class TensionSettle(_Settle):
    """When load and displacement count as settled."""

    load_tolerance_n: float = Field(gt=0.0)
    displacement_tolerance_mm: float = Field(gt=0.0)


class RotationSettle(_Settle):
    """When the angle counts as settled."""

    angle_tolerance_deg: float = Field(gt=0.0)


class Loading(Settings):
    """Increments of load until plastic deformation is evident."""

    increment_n: float = Field(gt=0.0)
    increments_max: int = Field(ge=2, le=1000, description="the run fails if none of these shows plasticity")
    rate_n_s: float = Field(gt=0.0)
    tare_max_n: float = Field(ge=0.0, description="the load at the reference may be zeroed up to this value")
    plastic: PlasticCriterion


class Stretching(Settings):
    """Increments of crosshead displacement until the total grip displacement; the last is the remainder."""

    increment_mm: float = Field(gt=0.0)
    total_mm: float = Field(gt=0.0, description="counted from the reference")
    speed_mm_s: float = Field(gt=0.0)


class Limits(Settings):
    """Limits that end the run at once, checked at every reading."""

    load_max_n: float = Field(gt=0.0)
    displacement_max_mm: float = Field(gt=0.0)
    break_load_drop: float = Field(
        gt=0.0, lt=1.0, description="fraction of the highest load; more is a break"
    )


def _known_kind(kind: object) -> object:
    # The error of a model would name only the kind of that model.
    if kind not in ("tension", "rotation"):
        raise ValueError("'tension' or 'rotation' is expected")
    return kind


class TensionProtocol(Settings):
    """The tension test: increments of load until plastic, then increments of displacement."""

    kind: Annotated[Literal["tension"], BeforeValidator(_known_kind)]
    title: str = Field(min_length=1, max_length=200)
    sample: Sample
    loading: Loading
    stretching: Stretching
    settle: TensionSettle
    grid: Grid = Grid()
    images: Images = Images()
    limits: Limits

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> "TensionProtocol":
        loading, stretching, settle, limits = self.loading, self.stretching, self.settle, self.limits
        highest_n = loading.increment_n * loading.increments_max + settle.load_tolerance_n
        farthest_mm = stretching.total_mm + settle.displacement_tolerance_mm
        times_s = {
            "loading.increment_n at loading.rate_n_s": loading.increment_n / loading.rate_n_s,
            "stretching.increment_mm at stretching.speed_mm_s": stretching.increment_mm
            / stretching.speed_mm_s,
        }
        mistakes = [
            f"{name} and settle.dwell_s take {time_s + settle.dwell_s:.4g} s together, "
            f"which must be less than settle.timeout_s, {settle.timeout_s:g}"
            for name, time_s in times_s.items()
            if time_s + settle.dwell_s >= settle.timeout_s
        ]
        mistakes += _too_fine("loading.increment_n", loading.increment_n, settle.load_tolerance_n)
        mistakes += _too_fine(
            "stretching.increment_mm", stretching.increment_mm, settle.displacement_tolerance_mm
        )
        if highest_n > limits.load_max_n:
            mistakes.append(
                f"limits.load_max_n must be at least {highest_n:g} "
                f"(loading.increments_max increments and the tolerance), got {limits.load_max_n:g}"
            )
        if farthest_mm > limits.displacement_max_mm:
            mistakes.append(
                f"limits.displacement_max_mm must be at least {farthest_mm:g} "
                f"(stretching.total_mm and the tolerance), got {limits.displacement_max_mm:g}"
            )
        if mistakes:
            raise ValueError("; ".join(mistakes))
        return self

    def steps(self) -> list[ProtocolStep]:
        """Plan for the worst case: all increments of load, and displacement from zero."""
        loads = [self._load_step(i) for i in range(1, self.loading.increments_max + 1)]
        return [ProtocolStep(0, "grid"), ProtocolStep(1, "reference"), *loads, *self._displacement_steps(0.0)]

    def follow(self, execute: Execute) -> None:
        """Call `execute` for each step in turn; the settled readings decide how many steps there are.

        Raises
        ------
        ProtocolError
            If no increment of load shows plastic deformation.
        """
        execute(ProtocolStep(0, "grid"))
        reading = execute(ProtocolStep(1, "reference"))
        loads_n, displacements_mm = [reading.load_n], [reading.displacement_mm]
        for number in range(1, self.loading.increments_max + 1):
            reading = execute(self._load_step(number))
            loads_n.append(reading.load_n)
            displacements_mm.append(reading.displacement_mm)
            if self._is_judged(number) and self.loading.plastic.is_evident(loads_n, displacements_mm):
                break
        else:
            fraction = self.loading.plastic.stiffness_fraction
            raise ProtocolError(
                f"loading to {loads_n[-1]:.0f} N",
                f"an increment of less than {fraction:g} of the highest stiffness",
                "none",
                f"check the specimen; if it did not yield, raise loading.increments_max above "
                f"{self.loading.increments_max}; if it did, raise loading.plastic.stiffness_fraction "
                f"above {fraction:g}",
            )
        for step in self._displacement_steps(reading.displacement_mm):
            execute(step)

    def _load_step(self, number: int) -> ProtocolStep:
        target_n = number * self.loading.increment_n
        conditional = any(self._is_judged(earlier) for earlier in range(1, number))
        return ProtocolStep(
            1 + number, "load", target_n, self.settle.load_tolerance_n, self.loading.rate_n_s, conditional
        )

    def _is_judged(self, number: int) -> bool:
        # Compare the commanded load: noise could move the measured load across the threshold.
        return number >= 2 and number * self.loading.increment_n > self.loading.plastic.judged_above_n

    def _displacement_steps(self, start_mm: float) -> list[ProtocolStep]:
        tolerance_mm = self.settle.displacement_tolerance_mm
        first = 2 + self.loading.increments_max
        return [
            ProtocolStep(first + i, "displacement", target_mm, tolerance_mm, self.stretching.speed_mm_s, True)
            for i, target_mm in enumerate(
                increments(start_mm, self.stretching.total_mm, self.stretching.increment_mm, tolerance_mm)
            )
        ]


class Rotation(Settings):
    """Increments of angle from the reference at 0 degrees; the last one is the remainder."""

    increment_deg: float = Field(gt=0.0)
    total_deg: float = Field(gt=0.0)


class RotationProtocol(Settings):
    """The rotation test: rigid rotation of the specimen in increments."""

    kind: Annotated[Literal["rotation"], BeforeValidator(_known_kind)]
    title: str = Field(min_length=1, max_length=200)
    sample: Sample
    rotation: Rotation
    settle: RotationSettle
    grid: Grid = Grid()
    images: Images = Images()

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> "RotationProtocol":
        tolerance_deg = self.settle.angle_tolerance_deg
        if mistakes := _too_fine("rotation.increment_deg", self.rotation.increment_deg, tolerance_deg):
            raise ValueError("; ".join(mistakes))
        return self

    def steps(self) -> list[ProtocolStep]:
        """Plan every step; nothing depends on the specimen."""
        tolerance_deg = self.settle.angle_tolerance_deg
        targets_deg = increments(0.0, self.rotation.total_deg, self.rotation.increment_deg, tolerance_deg)
        turns = [
            ProtocolStep(2 + i, "rotation", target, tolerance_deg) for i, target in enumerate(targets_deg)
        ]
        return [ProtocolStep(0, "grid"), ProtocolStep(1, "reference"), *turns]

    def follow(self, execute: Execute) -> None:
        """Call `execute` for each step in turn."""
        for step in self.steps():
            execute(step)


Protocol: TypeAlias = TensionProtocol | RotationProtocol


def increments(start: float, total: float, increment: float, tolerance: float) -> list[float]:
    """Return the targets from `start` in equal increments; the last target is `total` itself.

    A remainder within `tolerance` makes no step of its own.

    Examples
    --------
    >>> increments(4.2, 5.0, 0.3, 0.002)
    [4.5, 4.8, 5.0]
    """
    count = math.ceil((total - start - tolerance) / increment)
    return [start + i * increment for i in range(1, count)] + ([total] if count > 0 else [])


def _too_fine(name: str, increment: float, tolerance: float) -> list[str]:
    # A smaller increment could settle before anything has moved.
    if increment > 2.0 * tolerance:
        return []
    return [f"{name} must be more than twice its settle tolerance, {tolerance:g}, got {increment:g}"]


def read_protocol(path: str | Path) -> Protocol:
    """Read a protocol from TOML.

    Raises
    ------
    ConfigurationError
        If the file cannot be read or has mistakes; all of them are listed.
    """
    return read_protocol_text(path)[0]


def read_protocol_text(path: str | Path) -> tuple[Protocol, str]:
    """Return a protocol and the text of its file, read once; raises like `read_protocol`."""
    table, text = read_toml_text(Path(path))
    try:
        return parse_protocol(table), text
    except ValidationError as error:
        raise ConfigurationError(str(path), mistakes_in(error)) from error


def parse_protocol(table: dict[str, Any]) -> Protocol:
    """Check the content of a protocol file; raises pydantic's `ValidationError` with all mistakes."""
    # An unknown kind must not hide the other mistakes: the tables then decide which model checks the file.
    kind = table.get("kind")
    if kind == "rotation" or (kind != "tension" and "rotation" in table):
        return RotationProtocol.model_validate(table)
    return TensionProtocol.model_validate(table)
