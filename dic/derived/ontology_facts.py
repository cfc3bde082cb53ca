"""Collects the data of a test that a file in terms of the Tensile Test Ontology contains beside its values.

A test has the name of its specimen or, if this name is not known, of its file. Several tests can have the
same name. So the identifier of the run, or a digest of the measured data, is a part of the name.
"""

from collections.abc import Iterable, Mapping
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any

from dic.exports.tensile_ontology import AboutTest
from dic.gauges.reading import Reading
from dic.gauges.series import GaugeSeries
from dic.properties.curve import Curve

Facts = Mapping[str, Mapping[str, Any]]
_DIGITS = 12
"""Number of hexadecimal digits of a digest in a name. The probability that any two of a million tests have
the same digits is 0.2 %.
"""


def about_curve(curve: Curve, facts: Facts, *, gauge_length_mm: float | None, iri: str) -> AboutTest:
    """Return the data of a test from the table of a testing machine.

    The digest is that of the loads, because one table can have the columns of several tests.

    Parameters
    ----------
    curve : Curve
    facts : mapping of str to mapping
        The tables of `StatedFacts`.
    gauge_length_mm : float or None
    iri : str
        Beginning of the IRIs.
    """
    name = _name(facts, Path(curve.source).name, _digest(map(float.hex, curve.load_n.tolist())))
    return AboutTest(name, facts, gauge_length_mm=gauge_length_mm, iri=iri)


def about_series(
    series: GaugeSeries, gauge: str, kind: str, facts: Facts, *, title: str = "", iri: str = ""
) -> AboutTest:
    """Return the data of a test from images, with a gauge as extensometer.

    The gauge length is given if it is known in mm. The run gives the specimen's name and the date, unless
    they are stated.

    Parameters
    ----------
    series : GaugeSeries
    gauge : str
        Name of the gauge or the channel along the specimen.
    kind : str
        "raw", "calibrated" or "corrected"; "measured" for a channel.
    facts : mapping of str to mapping
        The tables of `StatedFacts`.
    title : str, optional
        Name of a test whose specimen has no name. Default: the name of the result file.
    iri : str
        Beginning of the IRIs.
    """
    readings = (image.readings.get(gauge, {}).get(kind) for image in series.images)
    known = [one for one in readings if isinstance(one, Reading) and not one.reason]
    lengths = [one.length for one in known if one.unit == "mm"]
    facts = _with_run(series, facts)
    name = _name(facts, title or Path(series.source).name, _identity(series))
    extensometer = f"offaxis {version('offaxis')}, gauge {gauge}, {kind} strain"
    if gauge in series.channels:
        extensometer = gauge
    return AboutTest(name, facts, extensometer, lengths[0] if lengths else None, iri)


def _with_run(series: GaugeSeries, facts: Facts) -> Facts:
    """Return the facts, and in addition those that only the run states."""
    if series.run is None:
        return facts
    run = {"specimen": {"name": series.run.sample}, "laboratory": {"date": series.run.start_time[:10]}}
    return {**facts, **{table: {**own, **facts.get(table, {})} for table, own in run.items()}}


def _identity(series: GaugeSeries) -> str:
    """Return a text that is the same for all results from the same images, and for no other ones.

    It depends neither on the names of the images nor on which images could be measured, which may change
    with the settings.
    """
    if series.run is not None and series.run.run_id:
        return series.run.run_id
    # Result files of earlier versions have no contents, and some of them have no digests.
    contents = series.contents if any(series.contents) else ()
    found = sorted(contents or (image.digest for image in series.images if image.digest))
    if found:
        return _digest([series.reference_digest, *found])
    return _digest(repr(image.known.get("load_n")) for image in series.images)


def _digest(texts: Iterable[str]) -> str:
    return sha256(" ".join(texts).encode()).hexdigest()[:_DIGITS]


def _name(facts: Facts, file: str, identity: str) -> str:
    return f"{facts.get('specimen', {}).get('name') or file} {identity}".strip()
