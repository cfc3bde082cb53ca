"""The command `dic campaign`, which compares tensile tests of several specimens."""

from __future__ import annotations

import json
from pathlib import Path

import click

import dic
from dic.commands.campaign_text import campaign_lines
from dic.commands.options import Chosen, option, options, use
from dic.commands.shared_options import comma, force
from dic.commands.tensile_options import TableColumns, tensile_options, tensile_settings
from dic.errors import CurveError
from dic.files import write_text
from dic.properties import PropertySettings
from dic.shell.console import fail, say
from dic.shell.output_paths import PATH, require_places

_FILE_NAME = "campaign.toml"


@options
class EqualTables(TableColumns):
    """Options that describe the columns of all tables in a folder, if there is no campaign.toml."""

    files: str | None = option(
        "--files", metavar="PATTERN", help="Tables in FOLDER without a TOML file. Default: all CSV files."
    )


@options
class CampaignOutputs:
    """Options that name the output files of `dic campaign`."""

    report: Path | None = option("--report", help="HTML file with all tables and the curves.")
    pdf: Path | None = option("--pdf", help="The same report as a PDF file; needs the extra offaxis[pdf].")
    csv_file: Path | None = option("--csv", help="CSV table with a line per specimen, and the mean.")
    decimal_comma: bool = comma()
    plot_file: Path | None = option("--plot", help="Picture of all curves, such as curves.png.")
    json_file: Path | None = option("--json", help="JSON file of all values.")
    force: bool = force()

    @property
    def files(self) -> list[Path]:
        """The paths of all output files."""
        given = (self.report, self.pdf, self.csv_file, self.plot_file, self.json_file)
        return [path for path in given if path is not None]


@click.command()
@click.argument("folder", type=PATH)
@use("tables", EqualTables)
@tensile_options
@use("outputs", CampaignOutputs, needs={"--decimal-comma": ("--csv",), "--pdf": ("--report",)})
def campaign(
    folder: Path, tables: EqualTables, test: Chosen[PropertySettings], outputs: CampaignOutputs
) -> None:
    """Compare tensile tests of several specimens: values, mean, scatter, outliers, r̄ and Δr.

    FOLDER is a folder, or a TOML file. The file campaign.toml in the folder describes the specimens: tables
    of a testing machine, or result files of `dic correlate` and `dic process`. Without this file, all tables
    in FOLDER have the same columns and area, which the options name. A test that fails is reported, and the
    others are compared.

    Exit status: 0 if E was found for every specimen, 1 if not, 2 if no test could be evaluated.
    """
    specimens = _specimens(folder, tables, test, outputs)
    read = [Path(specimen.file) for specimen in specimens]
    about = folder if folder.suffix.lower() == ".toml" else folder / _FILE_NAME
    require_places([about, *read], outputs.files, force=outputs.force)
    if outputs.pdf is not None:
        dic.report.require_pdf(outputs.pdf)
    found = dic.campaigns.measure_campaign(specimens)
    for line in list(campaign_lines(found)):
        say(line)
    if outputs.csv_file is not None:
        dic.campaigns.write_campaign_table(found, outputs.csv_file, decimal_comma=outputs.decimal_comma)
    if outputs.json_file is not None:
        content = {"folder": str(folder)} | found.as_dict()
        write_text(outputs.json_file, json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False))
    if outputs.plot_file is not None:
        dic.report.plot_campaign(found, outputs.plot_file)
    if outputs.report is not None:
        dic.report.write_campaign_report(
            found, outputs.report, title=about.resolve().parent.name, pdf=outputs.pdf
        )
        say(f"report: {outputs.report}")
    for failed in found.failures:
        fail(f"specimen {failed.name!r}: {failed.failure}")
    whole = not found.failures and all(each.elastic is not None for each in found.found.values())
    click.get_current_context().exit(0 if whole else 1)


def _specimens(
    folder: Path, tables: EqualTables, test: Chosen[PropertySettings], outputs: CampaignOutputs
) -> tuple[dic.campaigns.CampaignSpecimen, ...]:
    """Return the specimens that the TOML file or the options describe."""
    if folder.suffix.lower() == ".toml" or (folder / _FILE_NAME).exists():
        given = {**vars(tables), **test.values}
        usual = {"offsets_percent": (), "hardening_percent": (10.0, 20.0)}
        idle = [name for name, value in given.items() if value is not None and value != usual.get(name)]
        if idle:
            name = f"--{idle[0].replace('_', '-')}"
            expected, remedy = f"{_FILE_NAME} alone", f"leave out {name}, and write it into {_FILE_NAME}"
            raise CurveError(str(folder), name, expected, "both", remedy)
        return dic.campaigns.read_campaign(folder)
    if tables.load is None or tables.strain is None:
        missing = "--load" if tables.load is None else "--strain"
        expected = f"{_FILE_NAME} in the folder, or a column and its unit"
        remedy = f"write {_FILE_NAME}, or give {missing} COLUMN:UNIT, such as --load Load:kN --strain 3:%"
        raise CurveError(str(folder), missing, expected, "none", remedy)
    columns = dic.campaigns.CurveColumns(
        tables.load, tables.strain, tables.transverse, tables.time, tables.gauge_length_mm
    )
    pattern = "*.csv" if tables.files is None else tables.files
    return dic.campaigns.list_specimens(
        folder, columns, tensile_settings(test), pattern=pattern, leave_out=outputs.files
    )
