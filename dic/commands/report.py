"""The command `dic report`, which writes one HTML page from result files."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import click

import dic
from dic.commands.field_options import FieldOptions, field_options
from dic.commands.options import Chosen, gather, option, options, use
from dic.commands.record_options import RecordColumns, RecordOptions, record_options
from dic.commands.run_table import as_dict
from dic.commands.shared_options import force, ttl, ttl_iri
from dic.commands.tensile_options import (
    ontology_line,
    require_iri,
    stated_facts,
    tensile_options,
    tensile_settings,
)
from dic.errors import CurveError, RunFileError
from dic.files import read_text, write_text
from dic.properties import PropertySettings
from dic.shell.console import say
from dic.shell.output_paths import PATH, require_places


@options
class PropertyOptions(RecordColumns):
    """Options that let the report show material properties."""

    known_file: Path | None = option("--known", help="JSON file of true or certified values.")
    facts_file: Path | None = option(
        "--facts", help="TOML file of facts: specimen, machine, lenses, pattern."
    )
    fields_at: tuple[str, ...] = option(
        "--fields-at",
        multiple=True,
        metavar="POINT",
        help="Point of the curve whose field is shown: half, Rp02, ReH, Rm, last, strain=0.5 (%), stress=200"
        " (MPa) or image=NAME; may be repeated. Default: Rp02, half and Rm.",
    )
    static: tuple[str, ...] = option(
        "--static",
        multiple=True,
        metavar="NAME",
        help="Image or number of a step of the specimen at rest, for the noise floor; may be repeated.",
    )

    @property
    def is_given(self) -> bool:
        """True if at least one option is given."""
        return any(each not in (None, ()) for each in vars(self).values())

    def details(self, inputs: Sequence[Path | None]) -> dic.report.ReportDetails:
        """Return the options as `ReportDetails`; `inputs` are further input files of the test."""
        files = (*inputs, self.known_file, self.facts_file)
        given = tuple(path for path in files if path is not None)
        return dic.report.ReportDetails(stated_facts(self.facts_file), self.fields_at, self.static, given)

    def known(self) -> dict[str, float]:
        """Return the known values of `--known`, keyed by property."""
        if self.known_file is None:
            return {}
        expected, remedy = "a JSON object of values", 'write {"E_gpa": 73.1, "nu": 0.33}'
        try:
            content = json.loads(read_text(self.known_file))
        except ValueError as error:
            raise CurveError(str(self.known_file), "read", expected, str(error), remedy) from error
        if not isinstance(content, dict):
            raise CurveError(str(self.known_file), "read", expected, type(content).__name__, remedy)
        return content


@options
class PageOptions:
    """Options for the beginning of the page."""

    title: str = option("--title", default="", metavar="TEXT", help="Title. Default: what was measured.")
    image: str = option(
        "--image",
        default="",
        metavar="NAME",
        help="Image of a series whose strain is shown first. Default: the last one that was measured.",
    )


@options
class ReportOutputs:
    """Options that name the output files of `dic report`."""

    output: Path = option("-o", "--output", help="HTML file.", default=Path("report.html"))
    pdf: Path | None = option("--pdf", help="The same report as a PDF file; needs the extra offaxis[pdf].")
    json_file: Path | None = option("--json", help="JSON file of all values of the report.")
    ttl_file: Path | None = ttl()
    ttl_iri: str | None = ttl_iri()
    force: bool = force()

    def require_test(self, tests: Sequence[dic.report.TensileTest]) -> None:
        """Raise an error if there is no tensile test for a file of its values."""
        if self.ttl_file is not None and not tests:
            expected, remedy = "a tensile test", "declare a gauge with --declare, or leave out --ttl"
            raise RunFileError(str(self.ttl_file), "--ttl", expected, "none", remedy)

    def write_values(
        self,
        tests: Sequence[dic.report.TensileTest],
        results: Sequence[dic.pipeline.RunResult] | Sequence[dic.pipeline.SeriesResult],
    ) -> None:
        """Write all values of the report as JSON, and the values of a test after the ontology."""
        if self.json_file is not None:
            content = _values_of(results) | {
                "tests": [
                    each.as_dict() | {"tables": dic.report.tables_of_test(each, results)} for each in tests
                ]
            }
            write_text(self.json_file, json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False))
            say(f"values: {self.json_file}")
        if self.ttl_file is not None:
            left_out = dic.report.write_test_ontology(tests[0], self.ttl_file, iri=self.ttl_iri or "")
            say(ontology_line(self.ttl_file, left_out))


def _values_of(
    results: Sequence[dic.pipeline.RunResult] | Sequence[dic.pipeline.SeriesResult],
) -> dict[str, object]:
    runs = [as_dict(each) for each in results if isinstance(each, dic.pipeline.RunResult)]
    if runs:
        return {"runs": runs}
    return {
        "series": [
            dic.report.series_dict(each) for each in results if not isinstance(each, dic.pipeline.RunResult)
        ]
    }


@dataclass(frozen=True)
class Given:
    """The groups of options of `dic report` that choose what the page shows."""

    page: PageOptions
    field: FieldOptions
    about: PropertyOptions
    record: RecordOptions
    test: Chosen[PropertySettings]

    def gauges_alone(self, results: Sequence[Path]) -> dic.gauges.GaugeSeries | None:
        """Return the declared gauges of a series of images if no option asks for a test with a load."""
        if not self.field.declares or self._describe_test:
            return None
        if len(results) > 1 or not dic.pipeline.is_series_result(results[0]):
            return None
        self.record.require_none("a test with a machine's record")
        return self.field.read(results[0], self.record, None, None)[0]

    def tests(self, results: Sequence[Path]) -> list[dic.report.TensileTest]:
        """Return a list with the tensile test that the options describe; empty if none asks for a test."""
        field, about, record = self.field, self.about, self.record
        if not (any(field.given.values()) or self._describe_test):
            record.require_none("a test with a machine's record")
            return []
        if len(results) > 1:
            expected, remedy = "one result file beside the options of a test", "write a report of each"
            raise RunFileError(str(results[1]), "write report", expected, str(len(results)), remedy)
        settings = tensile_settings(self.test, _area_mm2(results[0]))
        across = field.transverse_gauge
        if field.declares:
            series, gauge, joined = field.read(results[0], record, about.load, about.time)
        else:
            gauges = dic.derived.whole_field_gauges(results[0])
            series, gauge, joined = field.read(results[0], record, about.load, about.time, gauges=gauges)
            across = across or gauges[1].name
        details, known = about.details([field.gauges_file, *record.files]), about.known()
        return [
            dic.tensile_test(series, gauge, across, settings, known=known, details=details, joined=joined)
        ]

    @property
    def _describe_test(self) -> bool:
        """True if an option other than a gauge is given that only a test with a load has."""
        area_mm2 = self.test.values["area_mm2"]
        return bool(self.about.is_given or self.record.record_file or area_mm2 is not None)


@click.command()
@click.argument("results", type=PATH, nargs=-1, required=True)
@use("page", PageOptions)
@field_options
@use("about", PropertyOptions)
@record_options
@tensile_options
@use("outputs", ReportOutputs, needs={"--ttl-iri": ["--ttl"]})
@gather("given", Given)
def report(results: tuple[Path, ...], given: Given, outputs: ReportOutputs) -> None:
    """Write one self-contained HTML report from RESULTS.

    RESULTS are the result files of one or more runs, from `dic process`, or of one or more series of images,
    from `dic correlate`. If gauges, a machine's record or an area are given, RESULTS is one tensile test, and
    the report also contains its material properties, from each camera without and with the correction. The
    load comes from the run, or from the machine's table with --record. The area comes from the run, or from
    --area-mm2. Without declared gauges, the strain is the mean over the whole measured field, with the axis
    of the test upwards in the image. Gauges of a series without a load are drawn against the number of the
    image.
    """
    about = given.about
    require_places(
        [*results, given.field.gauges_file, about.known_file, about.facts_file, *given.record.files],
        [outputs.output, outputs.pdf, outputs.json_file, outputs.ttl_file],
        force=outputs.force,
    )
    require_iri(outputs.ttl_iri)
    if outputs.pdf is not None:
        dic.report.require_pdf(outputs.pdf)
    gauges = given.gauges_alone(results)
    tests = [] if gauges is not None else given.tests(results)
    outputs.require_test(tests)
    loaded = _write(results, tests, gauges, given.page, outputs)
    outputs.write_values(tests, loaded)
    say(f"report: {', '.join(str(path) for path in (outputs.output, outputs.pdf) if path is not None)}")


def _write(
    results: Sequence[Path],
    tests: Sequence[dic.report.TensileTest],
    gauges: dic.gauges.GaugeSeries | None,
    page: PageOptions,
    outputs: ReportOutputs,
) -> Sequence[dic.pipeline.RunResult] | Sequence[dic.pipeline.SeriesResult]:
    """Write the page on the result files of runs, or of series, as HTML and PDF, and return the results."""
    series = [path for path in results if dic.pipeline.is_series_result(path)]
    if series and len(series) < len(results):
        raise RunFileError(
            str(series[0]),
            "write report",
            "runs alone, or series of images alone",
            "a series beside a run",
            "write a report of each",
        )
    output, pdf = outputs.output, outputs.pdf
    if series:
        measured = [dic.load_series_result(path) for path in series]
        dic.write_series_report(
            measured, output, tests=tests, gauges=gauges, image=page.image, title=page.title, pdf=pdf
        )
        return measured
    if page.image:
        expected, remedy = "the result file of a series", "leave out --image, or give --fields-at image=STEP"
        raise RunFileError(str(results[0]), "choose an image", expected, "that of a run", remedy)
    runs = [dic.load_run_result(path) for path in results]
    dic.write_report(runs, output, tests=tests, title=page.title, pdf=pdf)
    return runs


def _area_mm2(results: Path) -> float | None:
    """Return the area of a run's specimen; None for a series of images, or if the protocol states none."""
    if dic.pipeline.is_series_result(results):
        return None
    info = dic.load_run_result(results).info
    area_mm2 = info.width_mm * info.thickness_mm
    return area_mm2 if area_mm2 == area_mm2 else None
