"""Adds the gauge to the data of a test that a file in terms of the Tensile Test Ontology contains."""

from dataclasses import replace
from importlib.metadata import version

from dic.exports.tensile_ontology import AboutTest
from dic.gauges.reading import Reading
from dic.gauges.series import GaugeSeries


def with_gauge(about: AboutTest, series: GaugeSeries, gauge: str, kind: str) -> AboutTest:
    """Return the data of a test with a gauge as extensometer, and the gauge length if it is known in mm.

    Parameters
    ----------
    about : AboutTest
    series : GaugeSeries
    gauge : str
        Name of the gauge along the specimen.
    kind : str
        "raw", "calibrated" or "corrected".
    """
    found = (image.readings.get(gauge, {}).get(kind) for image in series.images)
    readings = [one for one in found if isinstance(one, Reading) and not one.reason]
    lengths = [one.length for one in readings if one.unit == "mm"]
    name = f"offaxis {version('offaxis')}, gauge {gauge}, {kind} strain"
    return replace(about, extensometer=name, gauge_length_mm=lengths[0] if lengths else None)
