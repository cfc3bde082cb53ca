"""A tensile test in the report: properties from each camera and kind of strain, and known values."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from dic.derived.gauge_record import GaugeCurve, gauge_curve
from dic.errors import CurveError, is_number
from dic.gauges.series import GaugeSeries, declaration
from dic.properties.properties import Properties, material_properties, offset_key
from dic.properties.settings import PropertySettings
from dic.records.joining import JoinedRecord
from dic.report.stated_facts import StatedFacts
from dic.results.provenance import Provenance
from dic.typing import Float, PathLike

_PROOF = "proof strength, plastic extension of {:g} %"
SYMBOLS = {
    "E_gpa": ("E", "modulus of elasticity"),
    "nu": ("ν", "Poisson's ratio"),
    "Rp02_mpa": ("Rp0,2", _PROOF.format(0.2)),
    "ReH_mpa": ("ReH", "upper yield strength"),
    "ReL_mpa": ("ReL", "lower yield strength"),
    "Ae_percent": ("Ae", "yield point extension"),
    "Rm_mpa": ("Rm", "tensile strength"),
    "Ag_percent": ("Ag", "plastic extension at the largest force"),
    "Agt_percent": ("Agt", "total extension at the largest force"),
    "A_percent": ("A", "elongation at the break"),
    "r": ("r", "plastic strain ratio"),
    "n": ("n", "strain hardening exponent"),
}
"""Symbol (ISO 6892-1, ISO 10113 or ISO 10275) and name of each property."""
_UNCORRECTED = {"calibrated": "calibrated, uncorrected", "raw": "raw, uncorrected", "corrected": "corrected"}


def symbols_of(settings: PropertySettings) -> dict[str, tuple[str, str]]:
    """Return symbol and name of each property of a test, also of offset strengths that the user added."""
    more = [offset for offset in settings.offsets_percent if offset_key(offset) not in SYMBOLS]
    added = {offset_key(each): (f"Rp{each:g}".replace(".", ","), _PROOF.format(each)) for each in more}
    place = list(SYMBOLS).index("Rp02_mpa") + 1
    known = list(SYMBOLS.items())
    return dict(known[:place]) | added | dict(known[place:])


@dataclass(frozen=True)
class ReportDetails:
    """The user's choices for the report of a tensile test, beside the properties.

    Attributes
    ----------
    facts : StatedFacts
        Facts that only the user knows, from `read_stated_facts`.
    fields_at : tuple of str
        Points of the curve whose fields are shown: "half", "Rp02", "ReH", "Rm", "last", "strain=PERCENT",
        "stress=MPA" or "image=NAME". If empty: the points Rp02, half and Rm that the curve has.
    static : tuple of str
        Names of images, or numbers of steps, in which the specimen is at rest as in the reference image. The
        noise floor is measured in these images.
    inputs : tuple of path
        Input files of the test other than the result file, such as the machine's record. The report states
        the digests of these files.
    """

    facts: StatedFacts = field(default_factory=StatedFacts)
    fields_at: tuple[str, ...] = ()
    static: tuple[str, ...] = ()
    inputs: tuple[PathLike, ...] = ()


@dataclass(frozen=True)
class TensileColumn:
    """The properties from one camera and one kind of strain."""

    camera: str
    """Name of the camera; "" for a series of images."""
    read: GaugeCurve
    labels: tuple[str, ...]
    """The image or step of each point of the curve."""
    digests: tuple[str, ...]
    """SHA-256 of the image file, or of the frames of the step, of each point; "" if it is not known."""
    properties: Properties

    @property
    def kind_text(self) -> str:
        """The kind of strain in words, such as "calibrated"."""
        return _UNCORRECTED[self.read.kind]

    @property
    def label(self) -> str:
        """Heading of the column: the camera and the kind of strain."""
        return ", ".join(part for part in (self.camera, self.kind_text) if part)

    def as_dict(self) -> dict[str, Any]:
        """Return the properties and the stress-strain curve of the column as a dict for JSON."""
        curve, found = self.read.curve, self.properties.as_dict()
        symbols = symbols_of(self.properties.settings)
        values = {name: found[name] | {"symbol": symbols[name][0]} for name in self.properties.values}
        across = [None] * len(self.labels) if curve.transverse is None else _plain(curve.transverse)
        loads, digests = curve.load_n.tolist(), [digest or None for digest in self.digests]
        rows = zip(self.labels, digests, loads, _plain(curve.strain), across, strict=True)
        names = ("image", "sha256", "load_n", "strain", "transverse_strain")
        return {
            "camera": self.camera or None,
            "strain_kind": self.read.kind,
            "left_out": self.read.left_out,
            "values": values,
            **{name: found[name] for name in ("necking", "fits", "not_counted", "flags")},
            "std_by_join": found.get("std_by_join"),
            "std_by_delay": found.get("std_by_delay"),
            "curve": [dict(zip(names, row, strict=True)) for row in rows],
        }


def _plain(values: Float) -> list[float | None]:
    """Return numbers for JSON, with None instead of NaN."""
    return [None if value != value else value for value in values.tolist()]


@dataclass(frozen=True)
class TensileTest:
    """A tensile test for the report.

    Attributes
    ----------
    title : str
    series : GaugeSeries
    gauge, transverse : str, str or None
        Names of the gauges along and across the specimen.
    settings : PropertySettings
    columns : tuple of TensileColumn
        The columns of each camera, from the least accurate kind of strain to the best.
    known : mapping of str to float
        True or certified values, keyed by the properties' keys; empty if no values are known.
    details : ReportDetails
    provenance : Provenance
        The command that computed the properties, its versions, and the digests of the files that it read.
    joined : JoinedRecord or None
        How the machine's record was joined to the images; None if the results contain the loads.
    """

    title: str
    series: GaugeSeries
    gauge: str
    transverse: str | None
    settings: PropertySettings
    columns: tuple[TensileColumn, ...]
    known: Mapping[str, float]
    details: ReportDetails
    provenance: Provenance
    joined: JoinedRecord | None = None

    @property
    def main(self) -> TensileColumn:
        """The column that the figure of the elastic line shows: the best strain of the last camera."""
        return self.columns[-1]

    def series_of(self, camera: str) -> GaugeSeries:
        """Return the readings of one camera; "" is the camera of a series of images."""
        return _of_camera(self.series, camera)

    def as_dict(self) -> dict[str, Any]:
        """Return the test as a dict for JSON."""
        settings = {"area_mm2": self.settings.area_mm2, "area_std_mm2": self.settings.area_std_mm2}
        settings |= {"load_std_percent": self.settings.load_std_percent}
        return {
            "title": self.title,
            "results": self.series.source,
            "gauges": [declaration(gauge) for gauge in self.series.gauges],
            "gauge": self.gauge,
            "transverse_gauge": self.transverse,
            "S0_mm2": self.settings.area_mm2,
            "settings": settings,
            "joined": None if self.joined is None else self.joined.as_dict(),
            "known": dict(self.known),
            "stated_facts": self.details.facts.as_dict(),
            "provenance": {
                "command": self.provenance.command,
                "versions": self.provenance.versions,
                "inputs": dict(self.provenance.inputs),
            },
            "columns": [column.as_dict() for column in self.columns],
        }


def tensile_test(
    series: GaugeSeries,
    gauge: str,
    transverse: str | None,
    settings: PropertySettings,
    *,
    known: Mapping[str, float] | None = None,
    title: str = "",
    details: ReportDetails | None = None,
    joined: JoinedRecord | None = None,
) -> TensileTest:
    """Compute the material properties of a test from every camera and kind of strain.

    Parameters
    ----------
    series : GaugeSeries
        A series with the load of each image. The load comes from a run, or from `join_record`.
    gauge, transverse : str, str or None
        Names of the gauges along and across the specimen.
    settings : PropertySettings
    known : mapping of str to float, optional
        True or certified values, keyed by the properties' keys, to show beside the measured values.
    title : str, optional
        Default: the name of the result file.
    details : ReportDetails, optional
        What the report shows beside the values.
    joined : JoinedRecord, optional
        How the machine's record was joined to the images, from `join_record`.

    Raises
    ------
    CurveError, GaugeError
        If the series is no tensile test, or the name of a gauge is unknown.
    OSError
        If a file of `details.inputs` cannot be read.
    """
    details = details or ReportDetails()
    known = dict(known or {})
    for name, value in known.items():
        if name not in SYMBOLS or not is_number(value):
            expected = f"numbers named {', '.join(SYMBOLS)}"
            remedy = "correct the name or the value, or leave it out"
            raise CurveError("known values", name, expected, repr(value), remedy)
    cameras = list(dict.fromkeys(str(image.known.get("camera", "")) for image in series.images))
    cameras.sort(key=lambda camera: camera != "on_axis")  # the other cameras are compared with on_axis
    columns = []
    for camera in cameras:
        part = _of_camera(series, camera)
        # Raw strain contains the same information as calibrated strain, but it is less accurate, so leave it
        # out.
        kinds = [kind for kind in reversed(part.kinds) if kind != "raw"] or ["raw"]
        columns += [_column(part, camera, gauge, transverse, settings, kind) for kind in kinds]
    name = title or Path(series.source).name
    origin = Provenance.of(_files(series, details))
    return TensileTest(
        name, series, gauge, transverse, settings, tuple(columns), known, details, origin, joined
    )


def _files(series: GaugeSeries, details: ReportDetails) -> list[Path]:
    """Return the result file, if there is one, and the other files that the test was computed from."""
    results = [Path(series.source)] if Path(series.source).is_file() else []
    return [*results, *map(Path, details.inputs)]


def _of_camera(series: GaugeSeries, camera: str) -> GaugeSeries:
    own = tuple(image for image in series.images if str(image.known.get("camera", "")) == camera)
    return replace(series, images=own)


def _column(
    series: GaugeSeries,
    camera: str,
    gauge: str,
    transverse: str | None,
    settings: PropertySettings,
    kind: str,
) -> TensileColumn:
    read = gauge_curve(series, gauge, transverse, kind=kind)
    found = read.judged(material_properties(read.curve, settings))
    known = {str(image.known.get("step", image.label)): image.digest for image in series.images}
    digests = tuple(known[label] for label in read.labels)
    return TensileColumn(camera, read, read.labels, digests, found)
