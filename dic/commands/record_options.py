"""Options for the record of a testing machine, for `dic gauges` and `dic properties`."""

from __future__ import annotations

from pathlib import Path

import dic
from dic.commands.options import option, options, use
from dic.errors import CurveError

_FOUND = "auto"


@options
class RecordColumns:
    """Options that name columns of the testing machine's record."""

    load: str | None = option(
        "--load", metavar="COLUMN:UNIT", help="Column of the load in the machine's record."
    )
    time: str | None = option(
        "--time", metavar="COLUMN:UNIT", help="Column of the time in the machine's record."
    )


@options
class RecordOptions:
    """Options for the testing machine's record, and for how the record is joined to the images."""

    record_file: Path | None = option(
        "--record", help="Table of the testing machine: its load at each image."
    )
    displacement: str | None = option(
        "--displacement", metavar="COLUMN:UNIT", help="Column of the displacement in the record."
    )
    join: str | None = option(
        "--join",
        help="How lines are assigned to images: name, row or time. Default: time if the times of the"
        " images are given, name with --image-column, otherwise row. --join time without given times uses"
        " those of the image files.",
    )
    image_column: str | None = option("--image-column", metavar="COLUMN", help="Column of the images' names.")
    image_interval_s: float | None = option(
        "--image-interval-s", help="Time between two images; the reference is at 0."
    )
    image_times: Path | None = option("--image-times", help="Table with the name and the time of each image.")
    image_time: str | None = option(
        "--image-time", metavar="COLUMN:UNIT", help="Column of the times in that table."
    )
    offset_s: str | None = option(
        "--offset-s",
        metavar="NUMBER|auto",
        help="Machine's time minus image's time; auto finds it from load and strain. Default: 0, up to one"
        " interval between images wrong.",
    )
    offset_std_s: float | None = option(
        "--offset-std-s", help="Standard deviation of the offset. Default: a given offset is exact."
    )
    clock_rate: str | None = option(
        "--clock-rate",
        metavar="NUMBER|auto",
        help="Seconds of the machine's clock in one of the images' clock; auto finds it from load and strain."
        " Default: 1, up to 1 % wrong.",
    )
    clock_rate_std_percent: float | None = option(
        "--clock-rate-std-percent", help="Standard deviation of this rate, %. Default: a given rate is exact."
    )
    offset_gauge: str | None = option(
        "--offset-gauge",
        metavar="NAME",
        help="Gauge along the specimen for auto. Default: the first that is not transverse.",
    )

    @property
    def files(self) -> list[Path | None]:
        """The files that these options name: the record, and the table of image times."""
        return [self.record_file, self.image_times]

    def joined(
        self, series: dic.gauges.GaugeSeries, load: str | None, time: str | None, gauge: str | None = None
    ) -> tuple[dic.gauges.GaugeSeries, dic.records.JoinedRecord | None]:
        """Return the series with the machine's load; without a record, return the series unchanged.

        Raises `CurveError` if the record cannot be read or does not fit the images, or an option has no
        effect.
        """
        if self.record_file is None:
            self.require_none("--record beside it", load=load, time=time)
            return series, None
        record = self._read(load, time)
        by_time = self.image_interval_s is not None or self.image_times is not None
        join = self.join or ("time" if by_time else "name" if self.image_column else "row")
        self._require_effect(join)
        return dic.derived.join_record(
            series, record, join, clock=self._clock(), gauge=self.offset_gauge or gauge
        )

    def _require_effect(self, join: str) -> None:
        """Raise an error for an option that this way of joining does not use."""
        idle: dict[str, bool] = {}
        if join in ("name", "row"):
            times = {"--image-interval-s": self.image_interval_s, "--image-times": self.image_times}
            idle = {option: value is not None for option, value in times.items()}
            clock = ("offset_s", "offset_std_s", "clock_rate", "clock_rate_std_percent", "offset_gauge")
            idle |= {f"--{name.replace('_', '-')}": getattr(self, name) is not None for name in clock}
        if self.image_times is None:
            idle["--image-time"] = self.image_time is not None
            idle["--image-column"] = self.image_column is not None and join != "name"
        found = _FOUND in (self.offset_s, self.clock_rate)
        idle.setdefault("--offset-gauge", self.offset_gauge is not None and not found)
        for name in [name for name, given in idle.items() if given]:
            needs = {
                "--offset-gauge": "--offset-s auto or --clock-rate auto, and --join time",
                "--image-time": "--image-times",
                "--image-column": "--join name or --image-times",
            }.get(name, "--join time")
            raise CurveError("settings", name, needs, f"--join {join}", f"leave out {name}")

    def require_none(self, expected: str, **others: object) -> None:
        """Raise an error if one of these options or of `others` is given."""
        for name, value in (others | vars(self)).items():
            if value is not None:
                option = "--record" if name == "record_file" else f"--{name.replace('_', '-')}"
                remedy = f"name the machine's record with --record, or leave out {option}"
                raise CurveError("settings", option, expected, "none", remedy)

    def _read(self, load: str | None, time: str | None) -> dic.records.MachineRecord:
        if self.record_file is None or load is None:
            remedy = "give --load COLUMN:UNIT, such as --load Load:kN"
            raise CurveError(
                str(self.record_file), "--load", "the column of the load and its unit", "none", remedy
            )
        # If there is a table of image times, the column of names is a column of that table.
        image = None if self.image_times is not None else self.image_column
        return dic.records.read_machine_record(
            self.record_file, load=load, displacement=self.displacement, time=time, image=image
        )

    def _clock(self) -> dic.derived.ImageClock:
        times_s = None
        if self.image_times is not None:
            if self.image_column is None or self.image_time is None:
                expected, remedy = "--image-column and --image-time", "name the columns of names and of times"
                raise CurveError(str(self.image_times), "--image-times", expected, "not both", remedy)
            times_s = dic.records.read_image_times(
                self.image_times, image=self.image_column, time=self.image_time
            )
        offset_s, offset_std_s = _declared("--offset-s", self.offset_s, self.offset_std_s, 0.0)
        rate, rate_std = _declared("--clock-rate", self.clock_rate, self.clock_rate_std_percent, 1.0)
        return dic.derived.ImageClock(self.image_interval_s, times_s, offset_s, offset_std_s, rate, rate_std)


def _declared(
    name: str, text: str | None, std: float | None, usual: float
) -> tuple[float | None, float | None]:
    """Return a value that the user declares, or None to find it, and its standard deviation.

    A value that is given without a standard deviation is exact.
    """
    if text is None:
        return usual, std
    if text == _FOUND:
        return None, std
    try:
        return float(text), std or 0.0
    except ValueError as error:
        expected, remedy = "a number, or auto", f"give {name} {usual:g}"
        raise CurveError("settings", name, expected, repr(text), remedy) from error


@options
class LoadedRecord(RecordOptions, RecordColumns):
    """Options for the machine's record and its columns, for commands without columns of another table."""

    def joined_to(
        self, series: dic.gauges.GaugeSeries
    ) -> tuple[dic.gauges.GaugeSeries, dic.records.JoinedRecord | None]:
        """Return the result of `joined` with the columns of these options."""
        return self.joined(series, self.load, self.time)


record_options = use("record", RecordOptions)
loaded_record_options = use("record", LoadedRecord)
