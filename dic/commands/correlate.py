"""`dic correlate`: image files in, displacements and strains out."""

import json
from collections import Counter
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dic.commands.strain_options import strain_options

if TYPE_CHECKING:
    from dic.calibration import Calibration
    from dic.measurement import Measurement

_FILE = click.Path(path_type=Path)


@click.command()
@click.argument("reference", type=_FILE)
@click.argument("deformed", type=_FILE, nargs=-1, required=True)
@click.option(
    "--calibration", "calibration_file", type=_FILE, help="From `dic calibrate`; gives millimetres."
)
@click.option("--subset", default=31, show_default=True, help="Width of the subsets, odd, px.")
@click.option("--step", default=10, show_default=True, help="Distance of the points, px.")
@click.option("--spline", default=5, show_default=True, help="Order of the interpolation, 3 or 5.")
@click.option("--shape", default="affine", show_default=True, help="Shape function, affine or quadratic.")
@click.option("--min-zncc", default=0.8, show_default=True, help="Points that correlate less are left out.")
@strain_options
@click.option(
    "--roi", type=_FILE, help="Mask image, white where to measure. Default: wherever there is texture."
)
@click.option(
    "--polygon",
    "polygons",
    multiple=True,
    help='Region as a polygon: "x,y x,y x,y ..." in pixels, or a TOML, JSON or CSV file. May be repeated:'
    " one inside another is a hole. With --roi, what lies in both.",
)
@click.option(
    "--incremental",
    default="auto",
    show_default=True,
    help="New reference: auto (when the correlation drops), never, or always (each image before).",
)
@click.option(
    "--motion",
    help="Expected rigid motion of every image, a hint: degrees, counter-clockwise, about the image's centre;"
    ' or "degrees,right,down" with a shift in px.',
)
@click.option("-o", "--output", type=_FILE, help="Result file, HDF5.")
@click.option("--csv", "csv_folder", type=_FILE, help="Folder for one CSV per image.")
@click.option("--maps", "maps_folder", type=_FILE, help="Folder for one PNG with maps per image.")
@click.option("--json", "json_file", type=_FILE, help="What is printed, for programs.")
@click.pass_context
def correlate(
    context: click.Context,
    reference: Path,
    deformed: tuple[Path, ...],
    calibration_file: Path | None,
    subset: int,
    step: int,
    spline: int,
    shape: str,
    min_zncc: float,
    strain_measure: str,
    strain_window: int,
    strain_from: str,
    roi: Path | None,
    polygons: tuple[str, ...],
    incremental: str,
    motion: str | None,
    output: Path | None,
    csv_folder: Path | None,
    maps_folder: Path | None,
    json_file: Path | None,
) -> None:
    """Correlate DEFORMED images with the REFERENCE image.

    An image that cannot be measured is named and left out; the others are measured and kept.
    Ctrl-C ends the series after the image at hand, and what was measured is kept. Status: 0, 1 if an image
    was measured badly, 2 if one could not be measured.
    """
    from dic.calibration import Calibration
    from dic.commands.console import fail, progress, say, stopping_between
    from dic.commands.mask import read_region
    from dic.commands.places import require_places
    from dic.errors import MeasurementError
    from dic.images import read_image
    from dic.measurement import measure
    from dic.series import Series
    from dic.settings import CorrelationSettings
    from dic.strain import StrainSettings, gauge_text

    settings = CorrelationSettings(
        subset_px=subset, step_px=step, shape=shape, order=spline, min_zncc=min_zncc
    )
    strain = StrainSettings(measure=strain_measure, window_points=strain_window, source=strain_from)
    files = _SeriesFiles(output, csv_folder, maps_folder, deformed)
    drawn = [path for path in map(Path, polygons) if path.is_file()]
    require_places([reference, *deformed, calibration_file, roi, *drawn], [json_file, *files.all()])
    calibration = None if calibration_file is None else Calibration.load(calibration_file)
    image = read_image(reference)
    if calibration is not None:
        _require_calibration_fits(calibration, image.shape, str(reference))
    hint = None if motion is None else _read_motion(motion, image.shape)
    region = read_region(roi, polygons, image.shape)
    series = Series(image, region, settings, incremental=incremental)

    gauge_px = strain.gauge_px(settings)
    say(gauge_text(gauge_px, None if calibration is None else gauge_px * calibration.mm_per_px))
    results = _Outputs(image, settings, files)
    summaries, failures, bad = [], [], []
    with results, progress("correlating", len(deformed)) as advance, stopping_between() as stopped:
        for number, path in enumerate(deformed):
            if stopped():
                rest = f"stopped by a signal, {len(deformed) - number} of {len(deformed)} images not measured"
                failures.append({"file": str(path), "error": rest})
                fail(f"{path}: {rest}; those before it are kept")
                break
            try:
                field = series.correlate(read_image(path), hint=hint)
                measurement = measure(str(path), field, calibration, settings, strain)
                results.write(number, measurement)
            except MeasurementError as error:
                failures.append({"file": str(path), "error": str(error)})
                fail(f"{path}: {error}" if str(path) not in str(error) else str(error))
                continue
            finally:
                advance()
            summaries.append(measurement.summary() | {"updates": series.updates, "good": measurement.good})
            say(_line(summaries[-1]))
            if measurement.objection is not None:
                bad.append(f"{path}: measured, but {measurement.objection}")
    if json_file is not None:
        content = {"reference": str(reference), "settings": vars(settings), "images": summaries}
        json_file.write_text(json.dumps(content | {"failures": failures}, indent=1), encoding="utf-8")
    for sentence in bad:
        fail(sentence)
    context.exit(2 if failures else 1 if bad else 0)


def _read_motion(text: str, shape: tuple[int, ...]) -> Any:
    from dic.errors import CorrelationError
    from dic.seeds import rigid_motion

    try:
        numbers = [float(part) for part in text.split(",")]
        angle_deg, right_px, down_px = numbers if len(numbers) == 3 else (*numbers, 0.0, 0.0)
        if not all(map(isfinite, numbers)):
            raise ValueError
    except ValueError as error:
        raise CorrelationError(
            "settings",
            "motion",
            expected='degrees, or "degrees,right,down"',
            got=text,
            remedy="correct the setting",
        ) from error
    centre = (shape[1] - 1) / 2, (shape[0] - 1) / 2
    return rigid_motion(angle_deg, (right_px, down_px), centre)


def _require_calibration_fits(calibration: "Calibration", shape: tuple[int, ...], source: str) -> None:
    from dic.errors import CalibrationError

    if tuple(calibration.image_shape) != tuple(shape):
        height, width = calibration.image_shape
        raise CalibrationError(
            source,
            "apply calibration",
            expected=f"{width} × {height} px like the grid image",
            got=f"{shape[1]} × {shape[0]} px",
            remedy="calibrate with an image of the same camera and format",
        )


class _SeriesFiles:
    """The names of the files a series leaves behind, each only if it was asked for.

    Images of the same name, from several folders or given twice, are told apart by their number.
    """

    def __init__(
        self,
        output: Path | None,
        csv_folder: Path | None,
        maps_folder: Path | None,
        deformed: tuple[Path, ...],
    ) -> None:
        for folder in (csv_folder, maps_folder):
            if folder is not None:
                folder.mkdir(parents=True, exist_ok=True)
        stems = Counter(path.stem for path in deformed)
        names = [
            f"{number:04d}_{path.stem}" if stems[path.stem] > 1 else path.stem
            for number, path in enumerate(deformed, 1)
        ]
        self.output = output
        self.csv = [] if csv_folder is None else [csv_folder / f"{name}.csv" for name in names]
        self.maps = [] if maps_folder is None else [maps_folder / f"{name}.png" for name in names]

    def all(self) -> list[Path]:
        """Return every file of the series."""
        return [*([] if self.output is None else [self.output]), *self.csv, *self.maps]


class _Outputs:
    """Writes the files of a series, image by image."""

    def __init__(self, image: Any, settings: Any, files: _SeriesFiles) -> None:
        from dic.results import ResultWriter

        self._image, self._settings, self._files = image, settings, files
        self._writer = None if files.output is None else ResultWriter(files.output)

    def __enter__(self) -> None:
        if self._writer is not None:
            self._writer.__enter__()

    def __exit__(self, *error: Any) -> None:
        if self._writer is not None:
            self._writer.__exit__(*error)

    def write(self, number: int, measurement: "Measurement") -> None:
        """Write the measurement of the image `number` to every file that was asked for."""
        from dic.csv_files import write_csv
        from dic.maps import write_maps

        if self._writer is not None:
            self._writer.add("series", measurement, self._settings)
        if self._files.csv:
            write_csv(self._files.csv[number], measurement.field, measurement.calibrated)
        if self._files.maps:
            name = Path(measurement.label).name
            title = f"{name}, subset {self._settings.subset_px} px, step {self._settings.step_px} px"
            write_maps(self._files.maps[number], measurement, self._image, title)


def _line(summary: dict[str, Any]) -> str:
    share = 100.0 * summary["converged"] / max(1, summary["points"])
    parts = [
        f"{Path(summary['file']).name}: {summary['converged']} of {summary['points']} points ({share:.1f} %)"
    ]
    for kind in ("raw", "calibrated"):
        if kind in summary:
            parts.append(f"{kind} " + _strain_text(summary[kind]))
    parts.append(f"rotation {summary['raw']['rotation_deg'] or 0.0:.3f}°, start from {summary['start']}")
    if summary["updates"]:
        parts.append(f"over {summary['updates']} new references")
    return "; ".join(parts)


def _strain_text(strain: dict[str, Any]) -> str:
    values = (strain["exx"], strain["eyy"], strain["exy"])
    return "exx, eyy, exy " + ", ".join("–" if v is None else f"{1e6 * v:.0f}" for v in values) + " µε"
