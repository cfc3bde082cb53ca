"""The command `dic gauges`, which reads gauges in the results of a measurement without correlating again."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click

import dic
from dic.commands.gauge_text import gauge_lines, joined_line
from dic.commands.options import option, options, telling, use
from dic.commands.record_options import LoadedRecord, loaded_record_options
from dic.commands.shared_options import A_GAUGE, comma, force
from dic.files import write_text
from dic.gauges import GAUGES
from dic.settings import enumerated
from dic.shell.console import fail, say
from dic.shell.output_paths import PATH, require_places


@options
class GaugeOutputs:
    """Options that name the output files of `dic gauges`."""

    output: Path | None = option("-o", "--output", help="CSV table with one line per image.")
    decimal_comma: bool = comma()
    json_file: Path | None = option("--json", help="JSON file of all readings.")
    picture: Path | None = option("--picture", help="Picture of the gauges on the reference image.")
    force: bool = force()

    @contextmanager
    def kept(
        self, results: Path, gauges: tuple[dic.gauges.Gauge, ...], camera: str | None
    ) -> Iterator[dic.derived.KeptReadings | None]:
        """Keep finished readings beside the first output file until all files are written; without one, not.

        The same command goes on with them if it was killed.
        """
        output = self.output or self.json_file or self.picture
        if output is None:
            yield None
            return
        path = output.with_name(f".{output.name}.readings.partial")
        with dic.derived.KeptReadings(path, results, gauges, camera) as readings:
            yield readings
            readings.done()

    def files(self, gauges: tuple[dic.gauges.Gauge, ...]) -> list[Path | None]:
        """Return the paths of all files to write."""
        tables = [] if self.output is None else dic.gauges.gauge_table_files(self.output, gauges)
        return [*tables, self.json_file, self.picture]


@click.command()
@click.argument("results", type=PATH)
@click.argument("gauges_file", type=PATH, metavar="[GAUGES]", required=False)
@click.option("--declare", "--gauge", "texts", multiple=True, metavar="TEXT", help=A_GAUGE)
@click.option("--camera", help="Camera of a run. Default: all, if all gauges are in millimetres.")
@loaded_record_options
@use("outputs", GaugeOutputs, needs={"--decimal-comma": ("-o", "--output")})
@telling(kinds=enumerated(dict.fromkeys(kind.plural for kind in GAUGES.values())))
def gauges(
    results: Path,
    gauges_file: Path | None,
    texts: tuple[str, ...],
    camera: str | None,
    record: LoadedRecord,
    outputs: GaugeOutputs,
) -> None:
    """Read {kinds} in all images of RESULTS.

    RESULTS is a result file of `dic correlate` or `dic process`. GAUGES is a TOML file that declares gauges
    by name. No image is correlated again. For each gauge the command prints the best strain: corrected strain
    if it exists, else calibrated, else raw strain. With --record, the CSV table and the JSON file also
    contain the load of a testing machine.

    Exit status: 0 if every gauge has a reading in every image, 1 if a reading is missing, 2 if the gauges or
    the results cannot be used.
    """
    declared = dic.read_gauges(gauges_file, texts)
    require_places([results, gauges_file, *record.files], outputs.files(declared), force=outputs.force)
    with outputs.kept(results, declared, camera) as kept:
        found, joined = record.joined_to(dic.measure_gauges(results, declared, camera=camera, kept=kept))
        for line in gauge_lines(found):
            say(line)
        if joined is not None:
            say(joined_line(joined))
        if outputs.output is not None:
            dic.gauges.write_gauge_table(found, outputs.output, decimal_comma=outputs.decimal_comma)
        if outputs.json_file is not None:
            content = found.as_dict() | ({} if joined is None else {"record": joined.as_dict()})
            write_text(outputs.json_file, json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False))
        if outputs.picture is not None:
            dic.derived.write_gauge_picture(results, declared, outputs.picture, camera=camera)
            say(f"picture: {outputs.picture}")
    for image in found.images:
        if image.failure is not None:
            fail(f"{image.label}: {image.failure}" if image.label not in image.failure else image.failure)
    click.get_current_context().exit(0 if found.complete else 1)
