"""The table of noise floors in a report, as in the iDICs Good Practices Guide."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dic.errors import CurveError
from dic.gauges.reading import Reading
from dic.pipeline.measured_images import MeasuredImage
from dic.report.camera_images import ReportedImages
from dic.report.numbers import fixed
from dic.report.states import names_of
from dic.report.tensile_record import TensileTest
from dic.strain.measurement import Measurement
from dic.strain.strain import StrainField
from dic.typing import Float

_MICRO = 1e6
_NOT_MEASURED = "not measured"
_PREDICTED = "predicted: standard deviation that the noise and the interpolation of the images cause, in"
_OVER_POINTS = (
    f"{_PREDICTED} the step, median over the points; measured: standard deviation over the points, root mean"
    " square over the images at rest; bias: mean over points and images at rest"
)
_OVER_IMAGES = (
    f"{_PREDICTED} the step; measured: standard deviation over the images at rest;"
    " bias: mean over these images"
)
_MOST_STDS = 4.0
"""A larger strain of an image at rest, divided by its standard deviation, is doubted."""
_QUANTITIES: dict[str, tuple[str, str, int]] = {
    "u": ("displacement u", "px", 4),
    "v": ("displacement v", "px", 4),
    "exx": ("local εxx", "µε", 1),
    "eyy": ("local εyy", "µε", 1),
    "exy": ("local εxy", "µε", 1),
}
"""Name, unit and number of decimals of each quantity of interest."""


@dataclass(frozen=True)
class NoiseRow:
    """A row of the table of noise floors: a quantity, its predicted and measured noise, and its bias."""

    quantity: str
    unit: str
    digits: int
    """Number of decimals in the report."""
    predicted: float
    measured: float
    bias: float
    """NaN if the value is not known."""
    predicted_from: str
    """The image whose noise was predicted; "" if there is none."""
    images: int
    """Number of images at rest."""
    of_gauge: bool = False
    """True for the strain of a gauge, which has one value in an image."""

    @property
    def texts(self) -> list[str]:
        """Predicted noise, measured noise and bias as texts."""
        # A single image has no scatter of the one value of a gauge.
        single = "needs two images" if self.of_gauge and self.images == 1 else _NOT_MEASURED
        return [
            fixed(self.predicted, self.digits),
            fixed(self.measured, self.digits) if np.isfinite(self.measured) else single,
            fixed(self.bias, self.digits) if np.isfinite(self.bias) else _NOT_MEASURED,
        ]


@dataclass(frozen=True)
class NoiseFloor:
    """The noise floors of one camera."""

    camera: str
    static: list[str]
    """Names of the images at rest."""
    rows: list[NoiseRow]
    doubts: list[str]
    """One sentence for each image at rest whose gauges measured a strain."""
    file: str = ""
    """The result file."""

    def as_list(self) -> list[dict[str, Any]]:
        """Return each row for JSON, with null for an unknown value."""
        return [
            {
                "name": row.quantity,
                "camera": self.camera or None,
                "unit": row.unit,
                **{key: _plain(getattr(row, key)) for key in ("predicted", "measured", "bias")},
                "file": self.file or None,
                "step": row.predicted_from or None,
                "images_at_rest": self.static,
                "rule": _OVER_IMAGES if row.of_gauge else _OVER_POINTS,
            }
            for row in self.rows
        ]


def _plain(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def noise_floor_of(images: ReportedImages, test: TensileTest, file: str = "") -> NoiseFloor | None:
    """Return the noise floor of each quantity; None if the camera measured nothing.

    The predicted noise is the standard deviation that noise and interpolation of the images cause: the median
    over the points of the first measured image. The measured noise is the standard deviation over the points
    in images of the specimen at rest, as root mean square over these images. The bias is the mean over the
    points in these images.

    Raises `CurveError` if the user named an image at rest that is not a measured image of the results.
    """
    first = images.first_measured
    if first is None:
        return None
    places = [_static_place(images, name) for name in test.details.static]
    rows = [*_field_rows(images, first, places), *_gauge_rows(images, test, places)]
    readings = [(images.labels[place], _gauges_at(images, test, place)) for place in places]
    doubts = [doubt for label, found in readings if (doubt := doubt_of_rest(label, found))]
    return NoiseFloor(images.camera, [label for label, _ in readings], rows, doubts, file)


def doubt_of_rest(label: str, readings: Mapping[str, Reading]) -> str:
    """Return a sentence if a gauge measured a strain in an image that is named as at rest; else "".

    The strain of a specimen at rest is zero. A strain of more than four times its standard deviation is
    neither noise nor one of the errors that the standard deviation contains.

    `label`: name of the image. `readings`: readings in this image, by the gauges' names.
    """
    sizes = {
        name: abs(one.strain) / one.strain_std
        for name, one in readings.items()
        if np.isfinite(one.strain) and one.strain_std > 0.0
    }
    name = max(sizes, key=lambda each: sizes[each], default="")
    if sizes.get(name, 0.0) <= _MOST_STDS:
        return ""
    value, std = (fixed(_MICRO * each, 1) for each in (readings[name].strain, readings[name].strain_std))
    return (
        f"{label} may not be at rest: the strain of gauge “{name}” is {value} µε, and its standard deviation"
        f" is {std} µε."
    )


def _static_place(images: ReportedImages, name: str) -> int:
    found = [k for k, label in enumerate(images.labels) if name in names_of(label)]
    if len(found) == 1 and images.series.images[found[0]].measurement is not None:
        return found[0]
    got = f"{name!r}, which was not measured" if found else f"no image named {name!r}"
    got = got if len(found) < 2 else f"{len(found)} images named {name!r}"
    remedy = f"give --static {images.labels[0]}, or leave it out"
    raise CurveError("settings", "--static", "the name of one measured image", got, remedy)


def _field_rows(images: ReportedImages, first: MeasuredImage, places: Sequence[int]) -> Iterator[NoiseRow]:
    at_rest = [images.series.images[place] for place in places]
    # The prediction and the observation must be of the same kind of strain.
    kind = _kind_of([first, *at_rest])
    spreads: dict[str, list[float]] = {name: [] for name in _QUANTITIES}
    means: dict[str, list[float]] = {name: [] for name in _QUANTITIES}
    for image in at_rest:
        for name, values in _values(image, kind).items():
            known = values[np.isfinite(values)]
            if known.size > 1:
                spreads[name].append(float(known.std(ddof=1)))
                means[name].append(float(known.mean()))
    predicted = _predicted(first, kind)
    for name, (title, unit, digits) in _QUANTITIES.items():
        measured, bias = np.nan, np.nan
        if spreads[name]:
            measured = float(np.sqrt(np.mean(np.square(spreads[name]))))
            bias = float(np.mean(means[name]))
        named = title if unit == "px" else f"{title}, {kind}"
        yield NoiseRow(named, unit, digits, predicted[name], measured, bias, first.label, len(places))


def _kind_of(images: Sequence[MeasuredImage]) -> str:
    """Return the best kind of strain that all of the measured images have."""
    if all(one.correction is not None and one.correction.declined is None for one in images):
        return "corrected"
    calibrated = all(one.measurement is not None and one.measurement.calibrated for one in images)
    return "calibrated" if calibrated else "raw"


def _strain(image: MeasuredImage, measurement: Measurement, kind: str) -> StrainField:
    """Return the local strain of an image: the corrected strain, or that of its measurement."""
    return image.strain if kind == "corrected" else measurement.strain


def _values(image: MeasuredImage, kind: str) -> dict[str, Float]:
    """Return displacement in px and local strain in µε at the points of an image, NaN where unknown."""
    if image.measurement is None:
        return {}
    raw, strain = image.measurement.raw, _strain(image, image.measurement, kind)
    u, v = np.moveaxis(np.where(raw.valid[..., None], raw.vector, np.nan), -1, 0)
    return {"u": u, "v": v} | {name: _MICRO * getattr(strain, name) for name in ("exx", "eyy", "exy")}


def _predicted(image: MeasuredImage, kind: str) -> dict[str, float]:
    """Return the standard deviations that the images cause, as medians over the points (px and µε)."""
    measurement = image.measurement
    if measurement is None:
        return dict.fromkeys(_QUANTITIES, float("nan"))
    field, strain = measurement.field, _strain(image, measurement, kind)
    found = {"u": _median(field.std_u_px), "v": _median(field.std_v_px)}
    for name in ("exx", "eyy", "exy"):
        by_images = getattr(strain, f"{name}_std_images")
        found[name] = _MICRO * _median(getattr(strain, f"{name}_std") if by_images is None else by_images)
    return found


def _median(values: Float) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")


def _gauge_kind(test: TensileTest, camera: str) -> str:
    """Return the best kind of strain that the gauges of a camera have."""
    return next((one.read.kind for one in reversed(test.columns) if one.camera == camera), "raw")


def _gauges_at(images: ReportedImages, test: TensileTest, place: int) -> dict[str, Reading]:
    """Return the readings in one image, by the names of the gauges."""
    kind, shown = _gauge_kind(test, images.camera), test.series_of(images.camera).images
    if place >= len(shown):
        return {}
    found = {name: kinds.get(kind) for name, kinds in shown[place].readings.items()}
    return {name: one for name, one in found.items() if isinstance(one, Reading)}


def _gauge_rows(images: ReportedImages, test: TensileTest, places: Sequence[int]) -> Iterator[NoiseRow]:
    """Yield the noise floors of the gauges' strains: predicted, and observed in the images at rest."""
    series, kind = test.series_of(images.camera), _gauge_kind(test, images.camera)
    for gauge in series.gauges:
        found = [image.readings.get(gauge.name, {}).get(kind) for image in series.images]
        readings = [
            (one, image.label)
            for one, image in zip(found, series.images, strict=True)
            if isinstance(one, Reading)
        ]
        if not readings:
            continue
        stds = [
            (one.strain_std_images, label) for one, label in readings if np.isfinite(one.strain_std_images)
        ]
        predicted, label = stds[0] if stds else (np.nan, "")
        at_rest = [found[place] for place in places if place < len(found)]
        values = _MICRO * np.array([one.strain for one in at_rest if isinstance(one, Reading)])
        measured = float(values.std(ddof=1)) if values.size > 1 else np.nan
        bias = float(values.mean()) if values.size else np.nan
        name = f"strain of gauge “{gauge.name}”, {kind}"
        yield NoiseRow(name, "µε", 1, _MICRO * predicted, measured, bias, label, len(values), of_gauge=True)
