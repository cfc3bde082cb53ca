"""`dic correlate`: image files in, displacements and strains out."""

import json
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dic.commands.strain_options import strain_options

if TYPE_CHECKING:
    from dic.calibration.calibration import Calibration
    from dic.correlation.series import Series
    from dic.pipeline.series_corrections import CorrectedSeries
    from dic.pipeline.series_files import SeriesOutputs
    from dic.strain.strain import StrainSettings

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
@click.option(
    "--shape",
    default="auto",
    show_default=True,
    help="Shape function: affine, quadratic, or auto (quadratic with --motion rigid, affine else).",
)
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
    "--hint",
    "hint_text",
    help="Expected rigid motion of every image: degrees, counter-clockwise, about the image's centre;"
    ' or "degrees,right,down" with a shift in px.',
)
@click.option(
    "--motion",
    default="free",
    show_default=True,
    help="What the specimen does, to correct calibrated strain for motion out of the grid's plane:"
    " rigid (a rotation), tension, or free (unknown: no correction).",
)
@click.option("--poisson-ratio", default=0.33, show_default=True, help="Of the specimen, for its bending.")
@click.option("--alignment", "alignment_file", type=_FILE, help="Of an earlier rotation on this fixture.")
@click.option("--save-alignment", type=_FILE, help="Keep the alignment that --motion rigid solves, JSON.")
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
    hint_text: str | None,
    motion: str,
    poisson_ratio: float,
    alignment_file: Path | None,
    save_alignment: Path | None,
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
    from dic.calibration.file import load_calibration
    from dic.commands.region import read_region
    from dic.correlation.series import Series
    from dic.correlation.settings import CorrelationSettings
    from dic.image.read import read_image
    from dic.out_of_plane.alignment import load_alignment
    from dic.pipeline.series_corrections import CorrectedSeries
    from dic.pipeline.series_files import SeriesFiles, SeriesOutputs
    from dic.shell.console import fail, say
    from dic.shell.output_paths import require_places
    from dic.strain.strain import StrainSettings, gauge_text

    if shape == "auto":
        # Seen off-axis, a subset that turns does not stay affine.
        shape = "quadratic" if motion == "rigid" else "affine"
    settings = CorrelationSettings(
        subset_px=subset, step_px=step, shape=shape, order=spline, min_zncc=min_zncc
    )
    strain = StrainSettings(measure=strain_measure, window_points=strain_window, source=strain_from)
    files = SeriesFiles(output, csv_folder, maps_folder, deformed)
    drawn = [path for path in map(Path, polygons) if path.is_file()]
    inputs = [reference, *deformed, calibration_file, roi, *drawn, alignment_file]
    require_places(inputs, [json_file, save_alignment, *files.all()])
    calibration = None if calibration_file is None else load_calibration(calibration_file)
    alignment = None if alignment_file is None else load_alignment(alignment_file)
    corrected = CorrectedSeries(motion, calibration, poisson_ratio, alignment)
    if save_alignment is not None:
        _require_rotation(save_alignment, motion)
    image = read_image(reference)
    if calibration is not None:
        _require_calibration_fits(calibration, image.shape, str(reference))
    hint = None if hint_text is None else _read_hint(hint_text, image.shape)
    region = read_region(roi, polygons, image.shape)
    series = Series(image, region, settings, incremental=incremental)

    gauge_px = strain.gauge_px(settings)
    say(gauge_text(gauge_px, None if calibration is None else gauge_px * calibration.mm_per_px))
    with SeriesOutputs(image, settings, files) as results:
        measured = _Measured(series, calibration, strain, corrected, results)
        measured.all(deformed, hint)
        content = {"reference": str(reference), "settings": vars(settings), "images": measured.summaries}
        content |= corrected.finish()
        results.write_corrections(corrected.corrections)
    if json_file is not None:
        content |= {"failures": measured.failures}
        json_file.write_text(json.dumps(content, indent=1), encoding="utf-8")
    if save_alignment is not None:
        _save_alignment(save_alignment, corrected)
    for sentence in measured.bad:
        fail(sentence)
    context.exit(2 if measured.failures else 1 if measured.bad else 0)


class _Measured:
    """The images of a series, measured one after the other, and what is said of them.

    Attributes
    ----------
    summaries : list of dict
        Of the images that were measured.
    failures : list of dict
        Of those that could not be: `file` and `error`.
    bad : list of str
        One sentence per image that was measured badly.
    """

    def __init__(
        self,
        series: "Series",
        calibration: "Calibration | None",
        strain: "StrainSettings",
        corrected: "CorrectedSeries",
        results: "SeriesOutputs",
    ) -> None:
        self._series, self._corrected, self._results = series, corrected, results
        self._how = calibration, strain
        self.summaries: list[dict[str, Any]] = []
        self.failures: list[dict[str, str]] = []
        self.bad: list[str] = []

    def all(self, deformed: tuple[Path, ...], hint: Any) -> None:
        """Measure the images until the last, or a signal."""
        from dic.errors import MeasurementError
        from dic.shell.console import fail, stopping_between
        from dic.shell.progress import progress

        with progress("correlating", len(deformed)) as bar, stopping_between() as stopped:
            for number, path in enumerate(deformed):
                if stopped():
                    left = len(deformed) - number
                    rest = f"stopped by a signal, {left} of {len(deformed)} images not measured"
                    self.failures.append({"file": str(path), "error": rest})
                    fail(f"{path}: {rest}; those before it are kept")
                    break
                try:
                    self._image(number, path, hint)
                except MeasurementError as error:
                    self.failures.append({"file": str(path), "error": str(error)})
                    fail(f"{path}: {error}" if str(path) not in str(error) else str(error))
                finally:
                    bar.advance()

    def _image(self, number: int, path: Path, hint: Any) -> None:
        from dic.image.read import read_image
        from dic.shell.console import say
        from dic.strain.measurement import measure

        field = self._series.correlate(read_image(path), hint=hint)
        measurement = measure(field, *self._how, label=str(path))
        self._results.write(number, measurement)
        summary = measurement.summary() | {"updates": self._series.updates, "good": measurement.good}
        self._corrected.add(summary, measurement)
        self.summaries.append(summary)
        say(_line(summary))
        if measurement.objection is not None:
            self.bad.append(f"{path}: measured, but {measurement.objection}")


def _require_rotation(path: Path, motion: str) -> None:
    from dic.errors import CorrelationError

    if motion != "rigid":
        raise CorrelationError(
            str(path), "save alignment", "--motion rigid", motion, "only a rotation tells an alignment"
        )


def _save_alignment(path: Path, corrected: "CorrectedSeries") -> None:
    from dic.errors import CorrelationError
    from dic.out_of_plane.alignment import save_alignment

    if corrected.alignment is None:
        raise CorrelationError(
            str(path),
            "save alignment",
            "one that --motion rigid has solved",
            "none: see why the images were not corrected",
            "correlate a rotation of at least 5° with a calibration",
        )
    save_alignment(corrected.alignment, path)


def _read_hint(text: str, shape: tuple[int, ...]) -> Any:
    from dic.correlation.initial_guess import rigid_motion
    from dic.errors import CorrelationError

    try:
        numbers = [float(part) for part in text.split(",")]
        angle_deg, right_px, down_px = numbers if len(numbers) == 3 else (*numbers, 0.0, 0.0)
        if not all(map(isfinite, numbers)):
            raise ValueError
    except ValueError as error:
        raise CorrelationError(
            "settings", "hint", 'degrees, or "degrees,right,down"', text, "correct the setting"
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
            f"{width} × {height} px like the grid image",
            f"{shape[1]} × {shape[0]} px",
            "calibrate with an image of the same camera and format",
        )


def _line(summary: dict[str, Any]) -> str:
    share = 100.0 * summary["converged"] / max(1, summary["points"])
    parts = [
        f"{Path(summary['file']).name}: {summary['converged']} of {summary['points']} points ({share:.1f} %)"
    ]
    for kind in ("raw", "calibrated"):
        if kind in summary:
            parts.append(f"{kind} " + _strain_text(summary[kind]))
    if summary.get("corrected", {"method": "none"})["method"] != "none":
        from dic.pipeline.series_corrections import corrected_text

        parts.append(corrected_text(summary["corrected"]))
    parts.append(f"rotation {summary['raw']['rotation_deg'] or 0.0:.3f}°, start from {summary['start']}")
    if summary["updates"]:
        parts.append(f"over {summary['updates']} new references")
    return "; ".join(parts)


def _strain_text(strain: dict[str, Any]) -> str:
    values = (strain["exx"], strain["eyy"], strain["exy"])
    return "exx, eyy, exy " + ", ".join("–" if v is None else f"{1e6 * v:z.0f}" for v in values) + " µε"
