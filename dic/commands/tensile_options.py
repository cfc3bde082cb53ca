"""Options that describe a tensile test and the tables of a testing machine, and what they give."""

from collections.abc import Sequence
from pathlib import Path

import dic
from dic.commands.options import Chosen, option, options, use
from dic.errors import CurveError
from dic.properties import PropertySettings


@options
class TableColumns:
    """The columns of a testing machine's table."""

    load: str | None = option("--load", metavar="COLUMN:UNIT", help='Column of the load, such as "Load:kN".')
    strain: str | None = option(
        "--strain", metavar="COLUMN:UNIT", help='Column of the strain, such as "3:%".'
    )
    transverse: str | None = option(
        "--transverse", metavar="COLUMN:UNIT", help="Column of the strain across the specimen."
    )
    time: str | None = option("--time", metavar="COLUMN:UNIT", help="Column of the time, such as Time:s.")
    gauge_length_mm: float | None = option(
        "--gauge-length-mm", help="Gauge length, if the strain is an extension in mm."
    )


tensile_options = use("test", PropertySettings)


def tensile_settings(test: Chosen[PropertySettings], known_mm2: float | None = None) -> PropertySettings:
    """Return the settings of a tensile test. Rp0.2 is always among the properties.

    `known_mm2`: area that is used if the option is not given, such as the area in a run's protocol.

    Raises `CurveError` if the area is not known, or a setting is not possible.
    """
    area_mm2 = test.values["area_mm2"]
    area_mm2 = known_mm2 if area_mm2 is None else area_mm2
    if area_mm2 is None:
        expected, remedy = "the area of the cross-section", "give --area-mm2 120, width times thickness"
        raise CurveError("settings", "--area-mm2", expected, "none", remedy)
    offsets = tuple(dict.fromkeys((0.2, *test.values["offsets_percent"])))
    return test.settings(area_mm2=area_mm2, offsets_percent=offsets)


def stated_facts(file: Path | None) -> dic.report.StatedFacts:
    """Return the facts of a test that a file states; no facts without a file."""
    return dic.report.StatedFacts() if file is None else dic.report.read_stated_facts(file)


def require_iri(iri: str | None) -> None:
    """Raise an error if the beginning of the ontology's names is no IRI, before any work is done."""
    dic.exports.AboutTest("", iri=iri or "")


def ontology_line(path: Path, left_out: Sequence[str]) -> str:
    """Return a line that names the written file, and the properties that have no class in the ontology."""
    without = f"; the ontology has no class for {', '.join(left_out)}" if left_out else ""
    return f"ontology: {path}{without}"
