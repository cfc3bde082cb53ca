"""Options that choose gauges in a result file, for `dic properties` and `dic report`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import dic
from dic.commands.options import option, options, use
from dic.commands.record_options import RecordOptions
from dic.commands.shared_options import declare


@options
class FieldOptions:
    """Options that choose gauges in a result file."""

    gauges_file: Path | None = option("--gauges", help="TOML file of gauges, for a result file.")
    texts: tuple[str, ...] = declare()
    gauge: str | None = option(
        "--gauge", help="Name of the gauge along the specimen. Default: the first gauge."
    )
    transverse_gauge: str | None = option("--transverse-gauge", help="Name of the gauge across the specimen.")

    @property
    def declares(self) -> bool:
        """True if at least one gauge is declared."""
        return bool(self.gauges_file or self.texts)

    @property
    def given(self) -> dict[str, object]:
        """The values of the options, keyed by the options' names."""
        return {
            "--gauges": self.gauges_file,
            "--declare": self.texts,
            "--gauge": self.gauge,
            "--transverse-gauge": self.transverse_gauge,
        }

    def read(
        self,
        path: Path,
        record: RecordOptions,
        load: str | None,
        time: str | None,
        camera: str | None = None,
        gauges: Sequence[dic.gauges.Gauge] | None = None,
    ) -> tuple[dic.gauges.GaugeSeries, str, dic.records.JoinedRecord | None]:
        """Read the declared gauges, or `gauges` if none are declared, and the load of each image.

        Result: the series, the name of the gauge along the specimen, and the machine's record if one was
        joined to the images.
        """
        gauges = gauges or dic.read_gauges(self.gauges_file, self.texts)
        name = self.gauge or gauges[0].name
        series = dic.measure_gauges(path, gauges, camera=camera)
        series, joined = record.joined(series, load, time, name)
        return series, name, joined


field_options = use("field", FieldOptions)
