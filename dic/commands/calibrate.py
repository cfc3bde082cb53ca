"""The command `dic calibrate`, which computes a calibration from images of a calibration target."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Literal

import click

import dic
from dic.commands.calibration_text import summarise, text
from dic.commands.options import Chosen, all_of, option, options, use
from dic.commands.target_options import TargetOptions, target_options
from dic.files import write_text
from dic.shell.console import say
from dic.shell.output_paths import FORCE, PATH, require_hdf5, require_places


@options
class CameraOptions:
    """Options that give known values of the camera."""

    focal_px: float | None = option("--focal-px", help="Focal length in px, if known.")
    focal_std_px: float = option(
        "--focal-std-px", default=0.0, help="Standard deviation of the focal length.  [default: 0, exact]"
    )
    distance_mm: float | None = option(
        "--distance-mm", help="Distance from the pinhole to the grid's centre, if known."
    )
    distance_std_mm: float = option(
        "--distance-std-mm", default=0.0, help="Standard deviation of the distance.  [default: 0, exact]"
    )
    principal_px: tuple[float, float] | None = option(
        "--principal-px",
        type=float,
        nargs=2,
        help="Principal point x y, where the optical axis meets the sensor.  [default: the image's middle]",
    )
    principal_std_px: float | None = option(
        "--principal-std-px",
        help="Standard deviation of the principal point.  [default: 0 if given, else 1 % of the width]",
    )

    def read(self) -> dic.calibration.KnownCamera:
        """Return the options as a `KnownCamera`."""
        return dic.calibration.KnownCamera(**vars(self))


@options
class CalibrationOutputOptions:
    """Options that name the output files of `dic calibrate`."""

    output: Path | None = option("-o", "--output", help="Calibration file, HDF5.")
    points_file: Path | None = option("--points", help="CSV file of the grid points, mm and px.")
    plot_file: Path | None = option("--plot", help="PNG file with the grid points and the models' residuals.")
    json_file: Path | None = option("--json", help="JSON file of the printed results.")


@click.command()
@click.argument("images", type=PATH, nargs=-1, required=True)
@target_options
@click.option(
    "--model",
    type=click.Choice(["bicubic", "pinhole", "recommended"]),
    default="bicubic",
    show_default=True,
    help="Map that the calibration uses: the paper's bicubic map, the pinhole model, or the better of both.",
)
@click.option(
    "--plate-mm",
    type=float,
    default=0.0,
    help="Distance of the specimen's surface behind the target's lines, such as the thickness of the plate"
    " that carries them.  [default: 0]",
)
@use("camera", CameraOptions)
@use("grid", dic.calibration.GridAccuracy, title="Target")
@use("outputs", CalibrationOutputOptions)
@FORCE
def calibrate(
    images: tuple[Path, ...],
    target: TargetOptions,
    model: Literal["bicubic", "pinhole", "recommended"],
    plate_mm: float,
    camera: CameraOptions,
    grid: Chosen[dic.calibration.GridAccuracy],
    outputs: CalibrationOutputOptions,
    force: bool,
) -> None:
    """Find the calibration target in the first of IMAGES and fit the map from pixels to millimetres.

    The camera may look at the target from any direction. The direction of X follows from a mark on the target
    or from --x-axis. Without a mark and without --x-axis, X is the axis direction closest to the image's
    right. The origin of X and Y is the target's centre.

    A pinhole model is fitted in addition to Helm and Deaner's bicubic map. If the camera looks nearly
    straight at the target, further images of the tilted target by the same camera determine the focal length.
    The target's plane in the first image is the plane of the measurement. If the specimen's surface lies
    behind this plane, give the distance with --plate-mm.
    """
    shown, known, accuracy = all_of(target.read, camera.read, grid.settings)
    files = [outputs.output, outputs.points_file, outputs.plot_file, outputs.json_file]
    require_places(images, files, force=force)
    require_hdf5(outputs.output, "give --points for a table of the grid, or --json for the values")
    calibration = dic.calibrate_images(
        images,
        shown,
        x_axis=target.x_axis,
        origin_px=target.origin_px,
        known=known,
        accuracy=accuracy,
        model=model,
        plate_mm=plate_mm,
        region_px=target.region,
    )
    if outputs.output is not None:
        dic.save_calibration(calibration, outputs.output)
    if outputs.points_file is not None:
        write_points(outputs.points_file, calibration)
    if outputs.plot_file is not None:
        dic.calibration.plot_calibration(calibration, images[0], outputs.plot_file)
    summary = summarise(calibration)
    if outputs.json_file is not None:
        content = json.dumps(summary, indent=1, ensure_ascii=False)
        write_text(outputs.json_file, content)
    say(text(summary))
    for warning in calibration.grid.warnings:
        say(f"warning: {images[0]}: {warning}", err=True)


def write_points(path: Path, calibration: dic.Calibration) -> None:
    """Write the grid points to a CSV file, rounded to 1e-7 mm and 1e-5 px."""
    grid = calibration.grid
    rows = ["X_mm,Y_mm,u_px,v_px"]
    rows += [
        f"{x:.7f},{y:.7f},{u:.5f},{v:.5f}" for (x, y), (u, v) in zip(grid.xy_mm, grid.uv_px, strict=True)
    ]
    write_text(path, "\n".join(rows) + "\n")
