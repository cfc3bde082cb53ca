"""Options that several commands share: settings of correlation and strain, and output files."""

from functools import partial

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


# Each of these declares an option as a field of a group.
csv = partial(
    option,
    "--csv",
    help="Folder for CSV files: strain.csv with one line per image, and one file of points per image.",
    common=True,
)
gauges = partial(
    option,
    "--gauges",
    help="TOML file of gauges to read in each image. --csv and --json then also write the readings.",
)
comma = partial(
    option,
    "--decimal-comma",
    help="Write CSV files with decimal commas, and semicolons between the cells.",
)
json_file = partial(option, "--json", help="JSON file of the printed results.")
fields_from = partial(
    option,
    "--fields-from",
    help="Result file of the same images with the same settings of the correlation: its displacement fields"
    " are used, and nothing is correlated. Default: the file of -o, if it is such a file.",
)
force = partial(option, "--force", help="Replace output files that exist already.")
write_mask = partial(
    option,
    "--write-mask",
    help="PNG file for the mask of the measured region; polygons (.toml) and a picture to check them"
    " (-overlay.png) are written beside it.",
)
ttl = partial(option, "--ttl", help="Turtle file of the values after the Tensile Test Ontology.")
ttl_iri = partial(
    option,
    "--ttl-iri",
    metavar="IRI",
    help="Beginning of the names in this file. Default: the place of the file.",
)
