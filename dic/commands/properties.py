"""The command `dic properties`, which computes material properties from the curve of a tensile test."""

from __future__ import annotations

import json
from collections.abc import Mapping, Set
from pathlib import Path
from typing import Any

import click

import dic
from dic.commands.field_options import FieldOptions, field_options
from dic.commands.gauge_text import joined_line
from dic.commands.options import Chosen, option, options, use
from dic.commands.record_options import RecordOptions, record_options
from dic.commands.shared_options import force, ttl, ttl_iri
from dic.commands.tensile_options import (
    TableColumns,
    ontology_line,
    require_iri,
    stated_facts,
    tensile_options,
    tensile_settings,
)
from dic.errors import CurveError
from dic.files import write_text
from dic.properties import PropertySettings
from dic.shell.console import say
from dic.shell.output_paths import PATH, require_places

_SHOWN = {"GPa": 1, "MPa": 1, "%": 3, "1": 4}
"""Decimals of a printed value, keyed by unit; a small standard deviation needs more decimals."""
_MOST_DIGITS = 4


@options
class ColumnOptions(TableColumns):
    """Options that name the columns of a testing machine's table."""

    stress: str | None = option(
        "--stress", metavar="COLUMN:UNIT", help='Column of the stress instead of the load, such as "2:MPa".'
    )

    def require_results(self, path: Path) -> None:
        """Raise an error if an option is given that has no effect on a result file."""
        given = {
            "--strain": self.strain,
            "--stress": self.stress,
            "--transverse": self.transverse,
            "--gauge-length-mm": self.gauge_length_mm,
        }
        for name, value in given.items():
            if value is not None:
                remedy = f"leave out {name}, and name a gauge with --gauge"
                raise CurveError(str(path), name, "the table of a testing machine", "a result file", remedy)

    def read(self, path: Path, area_mm2: float) -> dic.properties.Curve:
        """Read the curve of a tensile test from the testing machine's table `path`."""
        if self.strain is None:
            remedy = "give --strain COLUMN:UNIT, such as --load Load:kN --strain 3:%"
            raise CurveError(str(path), "--strain", "a column and its unit", "none", remedy)
        return dic.read_curve(
            path,
            load=self.load,
            strain=self.strain,
            transverse=self.transverse,
            time=self.time,
            gauge_length_mm=self.gauge_length_mm,
            stress=self.stress,
            area_mm2=area_mm2,
        )


@options
class StrainChoice:
    """Options that choose between the strains of a result file."""

    strain_kind: str | None = option(
        "--kind", help="Strain: raw, calibrated or corrected. Default: the best kind."
    )
    camera: str | None = option("--camera", help="Camera of a run.")


@options
class PropertyOutputs:
    """Options that name the output files of `dic properties`."""

    plot_file: Path | None = option("--plot", help="PNG file of the curve with elastic line and marks.")
    json_file: Path | None = option("--json", help="JSON file of all values.")
    ttl_file: Path | None = ttl()
    ttl_iri: str | None = ttl_iri()
    facts_file: Path | None = option("--facts", help="TOML file for --ttl: laboratory, specimen, machine.")
    force: bool = force()

    def write(
        self,
        found: dic.properties.Properties,
        content: dict[str, Any],
        about: dic.exports.AboutTest,
        *,
        unknown: Set[str],
    ) -> None:
        """Write all files, and print which values the ontology cannot contain; `unknown` keys are null."""
        if self.json_file is not None:
            content = content | found.as_dict() | dict.fromkeys(unknown)
            write_text(self.json_file, json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False))
        if self.plot_file is not None:
            dic.properties.plot_properties(found, self.plot_file)
        if self.ttl_file is not None:
            say(ontology_line(self.ttl_file, dic.exports.write_tensile_ontology(found, self.ttl_file, about)))


@click.command()
@click.argument("curve", type=PATH)
@use("columns", ColumnOptions)
@field_options
@use("choice", StrainChoice)
@record_options
@tensile_options
@use("outputs", PropertyOutputs, needs={"--ttl-iri": ["--ttl"], "--facts": ["--ttl"]})
def properties(
    curve: Path,
    columns: ColumnOptions,
    field: FieldOptions,
    choice: StrainChoice,
    record: RecordOptions,
    test: Chosen[PropertySettings],
    outputs: PropertyOutputs,
) -> None:
    """Compute E, Rp0.2, ReH, ReL, Rm, elongations, Poisson's ratio, r and n from a tensile test.

    CURVE is the table of a testing machine: text with any separator, decimal points or commas, and lines of
    text at the top. Or CURVE is a result file of `dic correlate` or `dic process`, in which gauges are read.
    The load then comes from the run, or from the machine's table with --record. Each value has a standard
    deviation, and flags that name the objections to it.

    Exit status: 0 if E was found, 1 if not, 2 if the record cannot be used.
    """
    area_unknown = columns.stress is not None and test.values["area_mm2"] is None
    settings = tensile_settings(test, 1.0 if area_unknown else None)
    inputs = [curve, field.gauges_file, outputs.facts_file, *record.files]
    require_places(inputs, [outputs.plot_file, outputs.json_file, outputs.ttl_file], force=outputs.force)
    require_iri(outputs.ttl_iri)
    facts, iri = stated_facts(outputs.facts_file).tables, outputs.ttl_iri or ""
    content: dict[str, Any] = {"curve": str(curve)}
    if dic.derived.is_results(curve):
        columns.require_results(curve)
        series, gauge, joined = field.read(curve, record, columns.load, columns.time, choice.camera)
        across = field.transverse_gauge
        read = dic.derived.gauge_curve(series, gauge, across, kind=choice.strain_kind, camera=choice.camera)
        found = read.judged(dic.material_properties(read.curve, settings))
        images = read.curve.measured
        content |= {"strain_kind": read.kind, "images": images, "left_out": read.left_out}
        content |= {} if joined is None else {"record": joined.as_dict()}
        say(f"{read.kind} strain of {images} images, {read.left_out} without a reading")
        if joined is not None:
            say(joined_line(joined))
        about = dic.derived.about_series(series, gauge, read.kind, facts, iri=iri)
    else:
        _require_no_gauges(curve, field.given, choice, record)
        if area_unknown and outputs.ttl_file is not None:
            remedy = "give --area-mm2 120, width times thickness"
            expected = "the area of the cross-section for --ttl"
            raise CurveError("settings", "--area-mm2", expected, "none", remedy)
        table = columns.read(curve, settings.area_mm2)
        found = dic.material_properties(table, settings)
        about = dic.derived.about_curve(table, facts, gauge_length_mm=columns.gauge_length_mm, iri=iri)
    _say_all(found)
    outputs.write(found, content, about, unknown={"area_mm2"} if area_unknown else set())
    click.get_current_context().exit(0 if found.elastic is not None else 1)


def _require_no_gauges(
    path: Path, given: Mapping[str, object], choice: StrainChoice, record: RecordOptions
) -> None:
    """Raise an error if CURVE is a table and an option is given that has an effect on result files only."""
    given = {**given, "--kind": choice.strain_kind, "--camera": choice.camera}
    idle = [option for option, value in given.items() if value]
    if idle:
        expected, remedy = "a result file of `dic correlate` or `dic process`", f"leave out {idle[0]}"
        raise CurveError(str(path), idle[0], expected, "another file", remedy)
    record.require_none("a result file of `dic correlate` beside it")


def _say_all(found: dic.properties.Properties) -> None:
    """Print a line for each value, and the objections to the value below this line."""
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
    for text in found.time_texts:
        say(text)
    if found.not_counted:
        say(f"± is one standard deviation, without that of: {', '.join(found.not_counted)}")
    for flag in found.flags:
        say(flag)
