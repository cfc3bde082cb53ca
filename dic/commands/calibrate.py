"""`dic calibrate`: images of a calibration target in, a calibration out."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dic.commands.target_options import target_options

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dic.calibration.calibration import Calibration

_FILE = click.Path(path_type=Path)


@click.command()
@click.argument("images", type=_FILE, nargs=-1, required=True)
@target_options
@click.option(
    "--model",
    type=click.Choice(["bicubic", "pinhole", "recommended"]),
    default="bicubic",
    show_default=True,
    help="Which map the calibration uses: the paper's bicubic one, the pinhole camera's, or the better one.",
)
@click.option("--focal-px", type=float, help="Focal length, if known.")
@click.option("--focal-std-px", type=float, default=0.0, help="Its standard deviation.  [default: exact]")
@click.option("--distance-mm", type=float, help="From the lens's pinhole to the grid's centre, if known.")
@click.option("--distance-std-mm", type=float, default=0.0, help="Its standard deviation.  [default: exact]")
@click.option(
    "--principal-px",
    type=float,
    nargs=2,
    help="X and Y where the optical axis meets the sensor.  [default: the middle, to 1 % of the width]",
)
@click.option("--principal-std-px", type=float, help="Its standard deviation.  [default: exact if given]")
@click.option("-o", "--output", type=_FILE, help="Calibration file, HDF5.")
@click.option("--points", "points_file", type=_FILE, help="Grid points as CSV: X_mm, Y_mm, u_px, v_px.")
@click.option("--plot", "plot_file", type=_FILE, help="Picture of the points and both residuals, PNG.")
@click.option("--json", "json_file", type=_FILE, help="What is printed, for programs.")
def calibrate(
    images: tuple[Path, ...],
    lines: tuple[int, int] | None,
    squares: tuple[int, int] | None,
    dots: tuple[int, int] | None,
    pitch_mm: float,
    marker_mm: float | None,
    dictionary: str,
    x_axis: str | float | None,
    origin_px: tuple[float, float] | None,
    model: str,
    output: Path | None,
    points_file: Path | None,
    plot_file: Path | None,
    json_file: Path | None,
    **known: Any,
) -> None:
    """Find the calibration target in the first of IMAGES and fit the map from pixels to millimetres.

    The camera may look at the target from anywhere. A mark on it or --x-axis says which way X points; without
    either it is the direction closest to the image's right. The origin is the target's centre.

    Beside the paper's bicubic map a pinhole camera is fitted. More images by the same camera, with the grid
    tilted otherwise, tell its focal length when it looks nearly straight; the first defines the plane.
    """
    from dic.calibration.calibration import Calibration
    from dic.calibration.file import save_calibration
    from dic.calibration.pinhole.prior import KnownCamera
    from dic.commands.calibration_text import summarise, text
    from dic.commands.target_options import read_target
    from dic.shell.output_paths import require_places
    from dic.targets.find import find_target

    target = read_target(lines, squares, dots, pitch_mm, marker_mm, dictionary)
    require_places(images, [output, points_file, plot_file, json_file])
    camera = KnownCamera(**known)
    greys = _read_images(images)
    first = find_target(greys[0], target, str(images[0]), x_axis=x_axis, origin_px=origin_px)
    # the others tell the lens only: how their axes are named does not matter
    others = zip(images[1:], greys[1:], strict=True)
    grids = [first, *(find_target(other, target, str(path)) for path, other in others)]
    calibration = Calibration.fit(grids, greys[0].shape, str(images[0]), known=camera)
    if model == "recommended":
        calibration = calibration.using(calibration.recommended)
    elif model == "pinhole":
        calibration = calibration.using("pinhole")
    if output is not None:
        save_calibration(calibration, output)
    if points_file is not None:
        write_points(points_file, calibration)
    if plot_file is not None:
        from dic.calibration.plot import plot_calibration

        plot_calibration(plot_file, calibration, greys[0])
    summary = summarise(calibration)
    if json_file is not None:
        json_file.write_text(json.dumps(summary, indent=1, ensure_ascii=False), encoding="utf-8")
    click.echo(text(summary))
    for path, grid in zip(images, grids, strict=True):
        for warning in grid.warnings:
            click.echo(f"warning: {path}: {warning}", err=True)


def _read_images(images: tuple[Path, ...]) -> list["NDArray[np.float32]"]:
    """Return the images; one camera gives images of one size."""
    from dic.errors import CalibrationError
    from dic.image.read import read_image

    greys = [read_image(path) for path in images]
    for path, grey in zip(images, greys, strict=True):
        if grey.shape != greys[0].shape:
            height, width = greys[0].shape
            raise CalibrationError(
                str(path),
                "calibrate",
                f"images by one camera, {width} × {height} px as the first",
                f"{grey.shape[1]} × {grey.shape[0]} px",
                "calibrate each camera by itself",
            )
    return greys


def write_points(path: Path, calibration: "Calibration") -> None:
    """Write the grid points as CSV, in mm to 0.1 nm and px to 1e-5."""
    grid = calibration.grid
    rows = ["X_mm,Y_mm,u_px,v_px"]
    rows += [
        f"{x:.7f},{y:.7f},{u:.5f},{v:.5f}" for (x, y), (u, v) in zip(grid.xy_mm, grid.uv_px, strict=True)
    ]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
