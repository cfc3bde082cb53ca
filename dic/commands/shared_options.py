"""Options that several commands share: settings of correlation and strain, and output files."""

from functools import partial
from typing import Any

from dic import CorrelationSettings, ReferenceSettings, StrainSettings
from dic.commands.options import option, use
from dic.gauges import GAUGES
from dic.settings import either

correlation_options = use(
    "correlation", CorrelationSettings, title="Correlation", common=("subset_px", "step_px")
)
reference_options = use("references", ReferenceSettings, title="Correlation")
strain_options = use("strain", StrainSettings, common=("measure", "window_points"))

A_GAUGE = (
    f"A gauge of the kind {either(GAUGES)},"
    ' such as "axial=extensometer start=400,200 end=400,800 patch=40". May be repeated.'
)
declare = partial(option, "--declare", multiple=True, metavar="TEXT", help=A_GAUGE)
declare_or_gauge = partial(option, "--declare", "--gauge", multiple=True, metavar="TEXT", help=A_GAUGE)
"""For commands in which `--gauge` declared a gauge, too; elsewhere it names one."""
COMMA_NEEDS = {"--decimal-comma": ["--csv"]}
"""Argument `needs` of `use`: `comma` has an effect only with one of these options."""


def csv() -> Any:
    """Declare the option for a folder of tables."""
    sentence = "Folder for CSV files: strain.csv with one line per image, and one file of points per image."
    return option("--csv", help=sentence, common=True)


def gauges() -> Any:
    """Declare the option for gauges that are read in each image."""
    sentence = "TOML file of gauges to read in each image. --csv and --json then also write the readings."
    return option("--gauges", help=sentence)


def comma() -> Any:
    """Declare the option for decimal commas."""
    return option(
        "--decimal-comma", help="Write CSV files with decimal commas, and semicolons between the cells."
    )


def json_file(sentence: str = "JSON file of the printed results.") -> Any:
    """Declare the option for a file for programs."""
    return option("--json", help=sentence)


def fields_from() -> Any:
    """Declare the option for a result file whose fields are used."""
    sentence = (
        "Result file of the same images with the same settings of the correlation: its displacement fields"
        " are used, and nothing is correlated. Default: the file of -o, if it is such a file."
    )
    return option("--fields-from", help=sentence)


def force() -> Any:
    """Declare the option that lets files be replaced."""
    return option("--force", help="Replace output files that exist already.")


def write_mask() -> Any:
    """Declare the option for a mask of the measured region."""
    sentence = (
        "PNG file for the mask of the measured region; polygons (.toml) and a picture to check them"
        " (-overlay.png) are written beside it."
    )
    return option("--write-mask", help=sentence)


def ttl() -> Any:
    """Declare the option for a file after the Tensile Test Ontology."""
    return option("--ttl", help="Turtle file of the values after the Tensile Test Ontology.")


def ttl_iri() -> Any:
    """Declare the option for the beginning of the names in this file."""
    sentence = "Beginning of the names in this file. Default: the place of the file."
    return option("--ttl-iri", metavar="IRI", help=sentence)
