"""`dic calibrate`: computes a calibration from images of a calibration target."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from dic.commands.option_groups import all_of, option_group
from dic.commands.target_options import TargetOptions, target_options

if TYPE_CHECKING:
    from dic import Calibration, KnownCamera

_FILE = click.Path(path_type=Path)


@dataclass(frozen=True)
class CameraOptions:
    """Known properties of the camera."""

    focal_px: float | None
    focal_std_px: float
    distance_mm: float | None
    distance_std_mm: float
    principal_px: tuple[float, float] | None
    principal_std_px: float | None

    def read(self) -> "KnownCamera":
        """Return the options as the library's type."""
        from dic import KnownCamera

        return KnownCamera(**vars(self))


@dataclass(frozen=True)
class OutputOptions:
    """Output of the command."""

    output: Path | None
    points_file: Path | None
    plot_file: Path | None
    json_file: Path | None


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
@option_group(
    "camera",
    CameraOptions,
    click.option("--focal-px", type=float, help="Focal length, if known."),
    click.option("--focal-std-px", type=float, default=0.0, help="Its standard deviation.  [default: exact]"),
    click.option("--distance-mm", type=float, help="From the lens's pinhole to the grid's centre, if known."),
    click.option(
        "--distance-std-mm", type=float, default=0.0, help="Its standard deviation.  [default: exact]"
    ),
    click.option(
        "--principal-px",
        type=float,
        nargs=2,
        help="X and Y where the optical axis meets the sensor.  [default: the middle, to 1 % of the width]",
    ),
    click.option("--principal-std-px", type=float, help="Its standard deviation.  [default: exact if given]"),
)
@option_group(
    "outputs",
    OutputOptions,
    click.option("-o", "--output", type=_FILE, help="Calibration file, HDF5."),
    click.option("--points", "points_file", type=_FILE, help="Grid points as CSV: X_mm, Y_mm, u_px, v_px."),
    click.option("--plot", "plot_file", type=_FILE, help="Picture of the points and both residuals, PNG."),
    click.option("--json", "json_file", type=_FILE, help="What is printed, for programs."),
)
def calibrate(
    images: tuple[Path, ...],
    target: TargetOptions,
    model: Literal["bicubic", "pinhole", "recommended"],
    camera: CameraOptions,
    outputs: OutputOptions,
) -> None:
    """Find the calibration target in the first of IMAGES and fit the map from pixels to millimetres.

    The camera may look at the target from anywhere. A mark on it or --x-axis says which way X points; without
    either it is the direction closest to the image's right. The origin is the target's centre.

    Beside the paper's bicubic map a pinhole camera is fitted. More images by the same camera, with the grid
    tilted otherwise, tell its focal length when it looks nearly straight; the first defines the plane.
    """
    from dic import calibrate_images, plot_calibration, save_calibration
    from dic.commands.calibration_text import summarise, text
    from dic.shell.output_paths import require_places

    shown, known = all_of(target.read, camera.read)
    files = [outputs.output, outputs.points_file, outputs.plot_file, outputs.json_file]
    require_places(images, files)
    calibration = calibrate_images(
        images, shown, x_axis=target.x_axis, origin_px=target.origin_px, known=known, model=model
    )
    if outputs.output is not None:
        save_calibration(calibration, outputs.output)
    if outputs.points_file is not None:
        write_points(outputs.points_file, calibration)
    if outputs.plot_file is not None:
        plot_calibration(calibration, images[0], outputs.plot_file)
    summary = summarise(calibration)
    if outputs.json_file is not None:
        content = json.dumps(summary, indent=1, ensure_ascii=False)
        outputs.json_file.write_text(content, encoding="utf-8")
    click.echo(text(summary))
    for warning in calibration.grid.warnings:
        click.echo(f"warning: {images[0]}: {warning}", err=True)


def write_points(path: Path, calibration: "Calibration") -> None:
    """Write the grid points as CSV, in mm to 0.1 nm and px to 1e-5."""
    grid = calibration.grid
    rows = ["X_mm,Y_mm,u_px,v_px"]
    rows += [
        f"{x:.7f},{y:.7f},{u:.5f},{v:.5f}" for (x, y), (u, v) in zip(grid.xy_mm, grid.uv_px, strict=True)
    ]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
