"""The command `dic properties`, which computes material properties from the curve of a tensile test."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dic.commands.option_groups import option_group
from dic.commands.record_options import RecordOptions, record_options
from dic.files.writing import write_text
from dic.shell.console import say
from dic.shell.output_paths import FORCE, require_places

if TYPE_CHECKING:
    from dic import Curve, GaugeCurve, JoinedRecord, Properties, PropertySettings

_PATH = click.Path(path_type=Path)
_SHOWN = {"GPa": 1, "MPa": 1, "%": 3, "1": 4}
"""Decimals of the printed values by unit; small standard deviations get more."""
_MOST_DIGITS = 4


@dataclass(frozen=True)
class ColumnOptions:
    """Options that name the columns of the record."""

    load: str | None
    strain: str | None
    transverse: str | None
    time: str | None
    gauge_length_mm: float | None

    def read(self, path: Path) -> "Curve":
        """Read the record."""
        from dic import CurveError, read_curve

        if self.load is None or self.strain is None:
            missing = "--load" if self.load is None else "--strain"
            remedy = f"give {missing} COLUMN:UNIT, such as --load Load:kN --strain 3:%"
            raise CurveError(str(path), missing, "a column and its unit", "none", remedy)
        return read_curve(
            path,
            load=self.load,
            strain=self.strain,
            transverse=self.transverse,
            time=self.time,
            gauge_length_mm=self.gauge_length_mm,
        )


@dataclass(frozen=True)
class FieldOptions:
    """Options that choose gauges in a result file."""

    gauges_file: Path | None
    texts: tuple[str, ...]
    gauge: str | None
    transverse_gauge: str | None
    strain_kind: str | None
    camera: str | None

    def require_none(self, path: Path, record: RecordOptions) -> None:
        """Raise an error if an option is given that a table does not use."""
        from dic import CurveError

        given = {"--gauges": self.gauges_file, "--declare": self.texts, "--gauge": self.gauge}
        given |= {"--transverse-gauge": self.transverse_gauge, "--kind": self.strain_kind}
        given |= {"--camera": self.camera}
        idle = [option for option, value in given.items() if value]
        if idle:
            expected, remedy = "a result file of `dic correlate` or `dic process`", f"leave out {idle[0]}"
            raise CurveError(str(path), idle[0], expected, "another file", remedy)
        record.require_none("a result file of `dic correlate` beside it")

    def read(
        self, path: Path, columns: ColumnOptions, record: RecordOptions
    ) -> "tuple[GaugeCurve, JoinedRecord | None]":
        """Read the gauges, and join the machine's record to them."""
        from dic import CurveError, gauge_curve, measure_gauges, read_gauges

        idle = {"--strain": columns.strain, "--transverse": columns.transverse}
        for option, value in idle.items():
            if value is not None:
                remedy = f"leave out {option}, and name a gauge with --gauge"
                raise CurveError(str(path), option, "the table of a testing machine", "a result file", remedy)
        gauges = read_gauges(self.gauges_file, self.texts)
        name = self.gauge or gauges[0].name
        series = measure_gauges(path, gauges, camera=self.camera)
        series, joined = record.joined(series, columns.load, columns.time, name)
        found = gauge_curve(series, name, self.transverse_gauge, kind=self.strain_kind, camera=self.camera)
        return found, joined


@dataclass(frozen=True)
class TestOptions:
    """Options that describe the test and choose between rules."""

    area_mm2: float
    area_std_mm2: float | None
    load_std_percent: float | None
    strain_std_percent: float | None
    offset_percent: tuple[float, ...]
    window_mpa: tuple[float, float] | None
    hardening_percent: tuple[float, float]

    def settings(self) -> "PropertySettings":
        """Return the settings; Rp0.2 is always computed."""
        from dic import PropertySettings

        return PropertySettings(
            area_mm2=self.area_mm2,
            area_std_mm2=self.area_std_mm2,
            load_std_percent=self.load_std_percent,
            strain_std_percent=self.strain_std_percent,
            offsets_percent=tuple(dict.fromkeys((0.2, *self.offset_percent))),
            window_mpa=self.window_mpa,
            hardening_percent=self.hardening_percent,
        )


@click.command()
@click.argument("curve", type=_PATH)
@option_group(
    "columns",
    ColumnOptions,
    click.option("--load", metavar="COLUMN:UNIT", help='Column of the load, such as "Load:kN".'),
    click.option("--strain", metavar="COLUMN:UNIT", help='Column of the strain, such as "3:%".'),
    click.option("--transverse", metavar="COLUMN:UNIT", help="Column of the strain across the specimen."),
    click.option("--time", metavar="COLUMN:UNIT", help="Column of the time, such as Time:s."),
    click.option("--gauge-length-mm", type=float, help="Gauge length, if the strain is an extension in mm."),
)
@option_group(
    "field",
    FieldOptions,
    click.option("--gauges", "gauges_file", type=_PATH, help="TOML file of gauges, for a result file."),
    click.option(
        "--declare",
        "texts",
        multiple=True,
        metavar="TEXT",
        help="A gauge as text, as in `dic gauges --gauge`.",
    ),
    click.option("--gauge", help="Name of the gauge along the specimen. Default: the first one."),
    click.option("--transverse-gauge", help="Name of the gauge across the specimen."),
    click.option("--kind", "strain_kind", help="raw, calibrated or corrected. Default: the best there is."),
    click.option("--camera", help="Camera of a run."),
)
@record_options
@option_group(
    "test",
    TestOptions,
    click.option(
        "--area-mm2", type=float, required=True, help="Area of the cross-section before the test, mm²."
    ),
    click.option("--area-std-mm2", type=float, help="Standard deviation of the area, mm²."),
    click.option(
        "--load-std-percent", type=float, help="Standard deviation of the load cell, % of the load."
    ),
    click.option(
        "--strain-std-percent",
        type=float,
        help="Standard deviation of the strain's calibration, % of the strain.",
    ),
    click.option(
        "--offset-percent",
        type=float,
        multiple=True,
        help="Another offset of Rp beside 0.2 %; may be repeated.",
    ),
    click.option(
        "--window-mpa",
        type=(float, float),
        metavar="LOW HIGH",
        help="Fit E between two stresses instead of in the objective window.",
    ),
    click.option(
        "--hardening-percent",
        type=(float, float),
        default=(10.0, 20.0),
        show_default=True,
        metavar="LOW HIGH",
        help="Strains between which n and r are fitted, %.",
    ),
)
@click.option("--plot", "plot_file", type=_PATH, help="PNG file of the curve with elastic line and marks.")
@click.option("--json", "json_file", type=_PATH, help="JSON file of all values.")
@FORCE
def properties(
    curve: Path,
    columns: ColumnOptions,
    field: FieldOptions,
    record: RecordOptions,
    test: TestOptions,
    plot_file: Path | None,
    json_file: Path | None,
    force: bool,
) -> None:
    """Compute E, Rp0.2, ReH, ReL, Rm, elongations, Poisson's ratio, r and n from a tensile test.

    CURVE is the table of a testing machine: text with any separator, decimal points or commas, and lines of
    text at the top. Or CURVE is a result file of `dic correlate` or `dic process`, in which gauges are read;
    the load comes from the run, or from the machine's table with --record. Each value has a standard
    deviation, and flags that say what speaks against it.

    Exit status: 0 if E was found, 1 if not, 2 if the record cannot be used.
    """
    from dic import material_properties, plot_properties, with_shared_error
    from dic.pipeline.gauge_series import is_results

    settings = test.settings()
    require_places([curve, field.gauges_file, *record.files], [plot_file, json_file], force=force)
    content: dict[str, Any] = {"curve": str(curve)}
    if is_results(curve):
        read, joined = field.read(curve, columns, record)
        found = material_properties(read.curve, settings)
        found = with_shared_error(found, read.shared_std)
        content |= {"strain_kind": read.kind, "images": len(read.curve.strain), "left_out": read.left_out}
        content |= {} if joined is None else {"record": joined.as_dict()}
        say(f"{read.kind} strain of {len(read.curve.strain)} images, {read.left_out} without a reading")
    else:
        field.require_none(curve, record)
        found = material_properties(columns.read(curve), settings)
    if json_file is not None:
        content |= found.as_dict()
        write_text(json_file, json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False))
    _say_all(found)
    if plot_file is not None:
        plot_properties(found, plot_file)
    click.get_current_context().exit(0 if found.elastic is not None else 1)


def _say_all(found: "Properties") -> None:
    """Print a line for each value, and what speaks against it below."""
    for name, value in found.values.items():
        symbol = name.partition("_")[0]
        if value.value is None:
            say(f"{symbol:<6}{'–':>9}  {value.flags[0]}")
            continue
        digits = _SHOWN[value.unit]
        while value.std and digits < _MOST_DIGITS and round(value.std, digits) == 0.0:
            digits += 1
        unit = "" if value.unit == "1" else f" {value.unit}"
        std = f" ± {value.std:.{digits}f}" if value.std is not None else ""
        say(f"{symbol:<6}{value.value:>9.{digits}f}{std}{unit}")
        for flag in value.flags:
            say(f"{'':<17}{flag}")
    if found.not_counted:
        say(f"± is one standard deviation, without that of: {', '.join(found.not_counted)}")
    for flag in found.flags:
        say(flag)
