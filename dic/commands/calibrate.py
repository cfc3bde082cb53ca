"""`dic calibrate`: one image of a line grid in, a calibration out."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from dic.calibration import Calibration

_FILE = click.Path(path_type=Path)
_MM_TO_UM = 1000.0


class _Lines(click.ParamType[tuple[int, int]]):
    """A number of lines along X and along Y, such as 21x21."""

    name = "NxM"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        if isinstance(value, tuple):
            return value
        parts = str(value).lower().replace("×", "x").split("x")
        if len(parts) != 2 or not all(part.isascii() and part.isdigit() for part in parts):
            self.fail(f"expected the lines along X and along Y, such as 21x21, got {value!r}", param, ctx)
        return int(parts[0]), int(parts[1])


@click.command()
@click.argument("image", type=_FILE)
@click.option("--lines", type=_Lines(), default="21x21", show_default=True, help="Lines along X and Y.")
@click.option("--pitch-mm", type=float, default=0.5, show_default=True, help="Distance of the lines.")
@click.option("-o", "--output", type=_FILE, help="Calibration file, HDF5.")
@click.option("--points", "points_file", type=_FILE, help="Grid points as CSV: X_mm, Y_mm, u_px, v_px.")
@click.option("--plot", "plot_file", type=_FILE, help="Picture of the points and residuals, PNG.")
@click.option("--json", "json_file", type=_FILE, help="What is printed, for programs.")
def calibrate(
    image: Path,
    lines: tuple[int, int],
    pitch_mm: float,
    output: Path | None,
    points_file: Path | None,
    plot_file: Path | None,
    json_file: Path | None,
) -> None:
    """Find the line grid in IMAGE and fit the map from pixels to millimetres.

    The camera may look at the grid from anywhere. X is the grid's direction closest to the image's right,
    Y the one closest to its top, the origin is the grid's centre.
    """
    from dic.calibration import Calibration
    from dic.commands.places import require_places
    from dic.grid import find_grid
    from dic.images import read_image

    _require_length(pitch_mm)
    require_places([image], [output, points_file, plot_file, json_file])
    grey = read_image(image)
    grid = find_grid(grey, lines, pitch_mm, source=str(image))
    calibration = Calibration.fit(grid, grey.shape, source=str(image))
    if output is not None:
        calibration.save(output)
    if points_file is not None:
        write_points(points_file, calibration)
    if plot_file is not None:
        from dic.calibration_plot import plot_calibration

        plot_calibration(plot_file, calibration, grey)
    summary = summarise(calibration)
    if json_file is not None:
        json_file.write_text(json.dumps(summary, indent=1), encoding="utf-8")
    click.echo(_text(summary))
    for warning in grid.warnings:
        click.echo(f"warning: {warning}", err=True)


def _require_length(pitch_mm: float) -> None:
    """Refuse what is no distance of lines, or so far from one that squares of it overflow."""
    from dic.errors import CalibrationError

    if not 1e-6 <= pitch_mm <= 1e6:
        raise CalibrationError(
            "settings",
            "pitch",
            expected="a positive pitch, from 1e-06 to 1e+06 mm",
            got=f"{pitch_mm:g} mm",
            remedy="correct --pitch-mm",
        )


def write_points(path: Path, calibration: "Calibration") -> None:
    """Write the grid points as CSV, in mm to 0.1 nm and px to 1e-5."""
    grid = calibration.grid
    rows = ["X_mm,Y_mm,u_px,v_px"]
    rows += [
        f"{x:.7f},{y:.7f},{u:.5f},{v:.5f}" for (x, y), (u, v) in zip(grid.xy_mm, grid.uv_px, strict=True)
    ]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


def summarise(calibration: "Calibration") -> dict[str, Any]:
    """Return what the command prints, by name and unit."""
    grid = calibration.grid
    outline = calibration.outline_px
    x, y = outline[:, 0], outline[:, 1]
    height, width = calibration.image_shape
    return {
        "image": calibration.source,
        "width_px": width,
        "height_px": height,
        "lines": list(grid.lines),
        "pitch_mm": grid.pitch_mm,
        "found": grid.found,
        "expected": grid.expected,
        "rms_px": calibration.rms_px,
        "max_px": calibration.max_px,
        "rms_um": calibration.rms_mm * _MM_TO_UM,
        "max_um": calibration.max_mm * _MM_TO_UM,
        "mm_per_px": calibration.mm_per_px,
        "area_px2": float(abs((x * (y[[*range(1, len(y)), 0]] - y[[-1, *range(len(y) - 1)]])).sum()) / 2),
        "outline_px": outline.round(3).tolist(),
        "warnings": list(grid.warnings),
    }


def _text(summary: dict[str, Any]) -> str:
    share = summary["area_px2"] / (summary["width_px"] * summary["height_px"])
    return "\n".join(
        [
            f"{summary['image']}: {summary['found']} of {summary['expected']} intersections",
            f"  residual  rms {summary['rms_px']:.4f} px ({summary['rms_um']:.3f} µm), "
            f"maximum {summary['max_px']:.4f} px ({summary['max_um']:.3f} µm)",
            f"  scale     {summary['mm_per_px'] * _MM_TO_UM:.3f} µm/px at the middle of the grid",
            f"  area      {summary['area_px2']:.0f} px², {share:.0%} of the image; "
            "points outside it are flagged",
        ]
    )
