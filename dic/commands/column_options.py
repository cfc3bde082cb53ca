"""Options that name the columns of a testing machine's table, for `dic properties` and `dic campaign`."""

import click

COLUMN_OPTIONS = (
    click.option("--load", metavar="COLUMN:UNIT", help='Column of the load, such as "Load:kN".'),
    click.option("--strain", metavar="COLUMN:UNIT", help='Column of the strain, such as "3:%".'),
    click.option("--transverse", metavar="COLUMN:UNIT", help="Column of the strain across the specimen."),
    click.option("--time", metavar="COLUMN:UNIT", help="Column of the time, such as Time:s."),
    click.option("--gauge-length-mm", type=float, help="Gauge length, if the strain is an extension in mm."),
)
