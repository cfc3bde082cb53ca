"""Options that name the columns of a testing machine's table, for `dic properties` and `dic campaign`."""

from dic.commands.options import option, options


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
