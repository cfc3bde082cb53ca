"""The table `[live]` of a protocol: gauges that are measured in every frame while the test runs."""

import re
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

from pydantic import Field, PrivateAttr, ValidationInfo, field_validator, model_validator

from drivers.settings import LONGEST_PATH, Settings

if TYPE_CHECKING:
    import dic
    from dic.gauges import Gauge
    from dic.live import LiveSettings

FOLDER = "folder"
"""Key of pydantic's context: the folder of the protocol's file, to which paths in the table are relative."""

_CORRELATION = (
    "subset_px", "step_px", "shape", "order", "min_zncc", "tolerance_px", "max_iterations", "smoothing_px",
)  # fmt: skip
_LIVE = (
    "least_share", "most_saturated", "least_contrast", "most_strain_per_s", "confirming_frames", "most_age_s",
    "room_px", "most_iterations", "search_px",
)  # fmt: skip


class LiveTable(Settings):
    """The gauges, and the settings of their measurement. Settings without a value have the default of dic."""

    gauges: list[str] = Field(
        default=[], max_length=50, description="gauges, each written as for the option --declare of dic"
    )
    gauges_file: str | None = Field(
        default=None, min_length=1, max_length=LONGEST_PATH, description="TOML file with further gauges"
    )
    camera: str | None = Field(
        default=None, description="camera whose values limits and control use; default: the most certain one"
    )
    grid_from: str | None = Field(
        default=None,
        min_length=1,
        max_length=LONGEST_PATH,
        description="earlier run file of the same cameras whose grid images calibrate them",
    )
    motion: Literal["tension", "free"] = Field(
        default="tension", description="motion of the specimen; free: strains are not corrected"
    )
    poisson_ratio: float | None = None
    field_every_s: float = Field(
        default=0.5, ge=0.05, le=60.0, description="time between the starts of two solved fields"
    )

    strain_max: float | None = Field(default=None, gt=0.0, description="largest strain of any gauge")
    strain_min: float | None = Field(default=None, lt=0.0, description="smallest strain of any gauge")

    subset_px: int | None = None
    step_px: int | None = None
    shape: str | None = None
    order: int | None = None
    min_zncc: float | None = None
    tolerance_px: float | None = None
    max_iterations: int | None = None
    smoothing_px: float | str | None = None

    least_share: float | None = None
    most_saturated: float | None = None
    least_contrast: float | None = None
    most_strain_per_s: float | None = None
    confirming_frames: int | None = None
    most_age_s: float | None = None
    room_px: int | None = None
    most_iterations: int | None = None
    search_px: int | None = None

    _folder: Path | None = PrivateAttr(default=None)
    _declared: "tuple[Gauge, ...]" = PrivateAttr(default=())

    @field_validator(*_CORRELATION, *_LIVE, "poisson_ratio", mode="plain")
    @classmethod
    def _accepted_by_dic(cls, value: Any, info: ValidationInfo) -> Any:
        import dic
        from dic.live import LiveSettings

        name = str(info.field_name)
        made: Any = dic.CorrectionSettings if name == "poisson_ratio" else dic.CorrelationSettings
        try:
            (LiveSettings if name in _LIVE else made)(**{name: value})
        except dic.MeasurementError as error:
            raise ValueError(f"{error.expected} is expected; {error.remedy}") from error
        return value

    @field_validator("gauges", mode="after")
    @classmethod
    def _are_gauges(cls, texts: list[str]) -> list[str]:
        _checked(_read(None, texts) if texts else ())
        return texts

    @field_validator("gauges_file", mode="after")
    @classmethod
    def _is_file_of_gauges(cls, name: str | None, info: ValidationInfo) -> str | None:
        folder = _folder_of(info)
        if name is not None and folder is not None:
            _checked(_read(folder / name, ()))
        return name

    @field_validator("grid_from", mode="after")
    @classmethod
    def _is_run_file(cls, name: str | None, info: ValidationInfo) -> str | None:
        folder = _folder_of(info)
        if name is not None and folder is not None and not (folder / name).is_file():
            raise ValueError(f"an earlier run file is expected, there is none at {folder / name}")
        return name

    @model_validator(mode="after")
    def _read_gauges(self, info: ValidationInfo) -> Self:
        self._folder = _folder_of(info)
        if not self.gauges and self.gauges_file is None:
            raise ValueError(
                "at least one gauge is expected; add one, such as "
                'gauges = ["axial=extensometer unit=mm start=0,-3 end=0,3 patch=1"]'
            )
        path = None if self._folder is None or self.gauges_file is None else self._folder / self.gauges_file
        if self.gauges or path is not None:
            self._declared = _read(path, self.gauges)
        return self

    @property
    def declared(self) -> "tuple[Gauge, ...]":
        """The gauges. Those of `gauges_file` are missing if the protocol was read from a run file."""
        return self._declared

    @property
    def names(self) -> list[str]:
        """The names of the gauges."""
        return [gauge.name for gauge in self._declared]

    @property
    def grid_run(self) -> Path | None:
        """The earlier run file with the images of the grid; None if this test's own images calibrate."""
        return None if self.grid_from is None else (self._folder or Path()) / self.grid_from

    def correlation(self) -> "dic.CorrelationSettings":
        """Return the settings of the correlation."""
        import dic

        return dic.CorrelationSettings(**self._given(_CORRELATION))

    def live(self) -> "LiveSettings":
        """Return the settings that decide whether a value is valid."""
        from dic.live import LiveSettings

        return LiveSettings(**self._given(_LIVE))

    def mistakes(self, cameras: Collection[str], signals: Collection[str]) -> list[str]:
        """Return one sentence for each name that does not fit the rig's cameras and signals."""
        found = [
            f"live.gauges: a name is expected that no signal of the rig has, got {name!r}; rename the gauge"
            for name in self.names
            if name in signals
        ]
        if self.camera is not None and self.camera not in cameras:
            known = ", ".join(cameras)
            found.append(f"live.camera: a camera of the rig is expected ({known}), got {self.camera!r}")
        return found

    def _given(self, names: tuple[str, ...]) -> dict[str, Any]:
        return {name: value for name in names if (value := getattr(self, name)) is not None}


def unknown_gauges(table: LiveTable | None, gauges: Collection[str]) -> list[str]:
    """Return one sentence for each name that other tables use and no live gauge has."""
    known = [] if table is None else table.names
    choice = ", ".join(known) or "there is none"
    return [
        f"a gauge of the table [live] is expected ({choice}), got {name!r}; declare it"
        for name in sorted(set(gauges) - set(known))
    ]


def _folder_of(info: ValidationInfo) -> Path | None:
    return (info.context or {}).get(FOLDER)


def _read(path: Path | None, texts: list[str] | tuple[()]) -> "tuple[Gauge, ...]":
    import dic

    try:
        return dic.read_gauges(path, texts)
    except dic.MeasurementError as error:
        raise ValueError(str(error)) from error


def _checked(gauges: "tuple[Gauge, ...]") -> None:
    """Raise a ValueError that names all gauges that cannot be live ones."""
    mistakes = [
        f"{gauge.name}: the names of live gauges have letters, digits and _ only; rename it"
        for gauge in gauges
        if not re.fullmatch(r"\w{1,40}", gauge.name) or not gauge.name.isidentifier()
    ]
    mistakes += [
        f"{gauge.name}: a gauge with a strain is expected, a {gauge.kind} has none; declare another kind"
        for gauge in gauges
        if gauge.kind == "cut"
    ]
    if mistakes:
        raise ValueError("; ".join(mistakes))
