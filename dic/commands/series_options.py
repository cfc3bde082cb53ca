"""The command-line options of `dic correlate`, in groups."""

from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

import click

from dic.commands.correlation_options import (
    COMMA_NEEDS,
    comma_option,
    csv_option,
    fields_from_option,
    gauges_option,
    hinge_mm,
    hinge_option,
    incremental_option,
    poisson_option,
    shift_option,
    write_mask_option,
)
from dic.commands.map_options import MapOptions, map_group
from dic.commands.option_groups import all_of, option_group
from dic.shell.output_paths import FORCE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dic import Alignment, Gauge, Motion, ResultPlace, StrainSettings
    from dic.derived.series_files import SeriesFiles
    from dic.pipeline.set_up import SeriesSetUp
    from dic.typing import Float, Mask

_FILE = click.Path(path_type=Path)


@dataclass(frozen=True)
class RegionOptions:
    """Options for the region to measure."""

    roi: Path | None
    polygons: tuple[str, ...]
    write_mask: Path | None

    def files(self) -> list[Path | None]:
        """Return the paths of the file of `--roi` (or None) and of the region files that `read` reads."""
        return [self.roi, *(Path(text) for text in self.polygons if is_file(text))]

    def outputs(self) -> "tuple[Path, ...]":
        """Return the paths of the files that `--write-mask` asks for."""
        from dic import region_files

        return () if self.write_mask is None else region_files(self.write_mask)

    def read(self, shape: tuple[int, int]) -> "Mask | None":
        """Return the region to measure for images of `shape` (height, width); None without these options."""
        from dic import read_region

        region = read_region(self.roi, self.polygons, shape)
        if region is not None:
            # Nobody changes this mask, so the correlation needs no copy of it.
            region.setflags(write=False)
        return region


def is_file(text: str) -> bool:
    """Return True if a text names an existing file; a typed polygon may be too long for a file name."""
    try:
        return Path(text).is_file()
    except OSError:
        return False


region_options = option_group(
    "region",
    RegionOptions,
    click.option(
        "--roi",
        type=_FILE,
        help="Mask image, white in the region to measure, or region file: TOML, JSON, CSV, or .roi or .zip of"
        " ImageJ. Default: the specimen, found by its speckles.",
    ),
    click.option(
        "--polygon",
        "polygons",
        multiple=True,
        help='Polygon of the region: "x,y x,y x,y ..." in px, or a region file. May be repeated.'
        " A polygon inside another is a hole. With --roi, the region is the intersection.",
    ),
    write_mask_option,
)


@dataclass(frozen=True)
class StartOptions:
    """Options for the first guess of each image: when to take a new reference, and an expected motion."""

    incremental: str
    hint_text: str | None

    def check(self) -> None:
        """Raise an error for invalid values, before any image is read."""
        from dic import Series

        all_of(lambda: Series.require_incremental(self.incremental), self._motion)

    def hint(self, shape: tuple[int, int]) -> "Float | None":
        """Return the expected motion from `--hint` as a homography, or None if the option was not given."""
        from dic import rigid_motion

        motion = self._motion()
        if motion is None:
            return None
        angle_deg, right_px, down_px = motion
        return rigid_motion(angle_deg, (right_px, down_px), ((shape[1] - 1) / 2, (shape[0] - 1) / 2))

    def _motion(self) -> tuple[float, float, float] | None:
        from dic import CorrelationError

        if self.hint_text is None:
            return None
        try:
            numbers = [float(part) for part in self.hint_text.split(",")]
            angle_deg, right_px, down_px = numbers if len(numbers) == 3 else (*numbers, 0.0, 0.0)
            if not all(map(isfinite, numbers)):
                raise ValueError
        except ValueError as error:
            expected = 'degrees, or "degrees,right,down"'
            raise CorrelationError("settings", "hint", expected, self.hint_text, "give --hint 30") from error
        return angle_deg, right_px, down_px


start_options = option_group(
    "start",
    StartOptions,
    incremental_option,
    click.option(
        "--hint",
        "hint_text",
        help="Expected rigid motion of every image: degrees counter-clockwise about the image's centre,"
        ' or "degrees,right,down" with a shift in px.',
    ),
)


@dataclass(frozen=True)
class MotionOptions:
    """Options for the motion of the specimen that the correction of calibrated strain assumes."""

    motion: str
    poisson_ratio: float
    shift_std_um: float | None
    hinge_text: str | None
    alignment_file: Path | None
    save_alignment: Path | None

    def read(self) -> "Motion":
        """Return the options as a `Motion`."""
        from dic import Motion, load_alignment

        known = None if self.alignment_file is None else load_alignment(self.alignment_file)
        hinge = hinge_mm(self.hinge_text)
        return Motion(self.motion, self.poisson_ratio, known, self.shift_std_um, hinge)

    def require_rotation(self) -> None:
        """Raise an error if an alignment is to be saved but the motion is not a rotation.

        The alignment (tilt of specimen and stage axis relative to the grid) can only be determined from a
        rotation of the specimen.
        """
        from dic import CorrelationError

        if self.save_alignment is not None and self.motion != "rigid":
            raise CorrelationError(
                str(self.save_alignment),
                "save alignment",
                "--motion rigid",
                self.motion,
                "leave --save-alignment out, because only a rotation determines an alignment",
            )

    def save(self, alignment: "Alignment | None") -> None:
        """Write the rotation stage's alignment to the file of `--save-alignment`, if this option is given."""
        from dic import CorrelationError, save_alignment

        if self.save_alignment is None:
            return
        if alignment is None:
            raise CorrelationError(
                str(self.save_alignment),
                "save alignment",
                "an alignment that --motion rigid has solved",
                "none: see why the images were not corrected",
                "correlate a rotation of at least 5° with a calibration",
            )
        save_alignment(alignment, self.save_alignment)


def read_set_up(calibration_file: Path | None, strain: "StrainSettings", motion: "Motion") -> "SeriesSetUp":
    """Read the calibration file, and return the inputs from which a series' strains are computed."""
    from dic import load_calibration
    from dic.files.digest import file_sha256
    from dic.pipeline.set_up import SeriesSetUp

    if calibration_file is None:
        return SeriesSetUp(strain, motion)
    return SeriesSetUp(strain, motion, load_calibration(calibration_file), file_sha256(calibration_file))


motion_options = option_group(
    "motion",
    MotionOptions,
    click.option(
        "--motion",
        default="free",
        show_default=True,
        help="Motion of the specimen, to correct calibrated strain for motion out of the grid's plane:"
        " rigid (a rotation), tension, or free (unknown, no correction).",
    ),
    poisson_option,
    shift_option,
    hinge_option,
    click.option(
        "--alignment",
        "alignment_file",
        type=_FILE,
        help="Alignment file from an earlier rotation on this fixture.",
    ),
    click.option(
        "--save-alignment", type=_FILE, help="JSON file for the alignment that --motion rigid solves."
    ),
)


@dataclass(frozen=True)
class OutputOptions:
    """Options that name the output files of `dic correlate`."""

    output: Path | None
    csv_folder: Path | None
    gauges_file: Path | None
    decimal_comma: bool
    maps: MapOptions
    json_file: Path | None
    force: bool
    fields_from: Path | None

    def place(self, written: "Sequence[Path | None]") -> "ResultPlace | None":
        """Return the place of the result file, and whether existing results may be replaced or used.

        The other files that the command writes are `written`.
        """
        from dic import ResultPlace

        if self.output is None:
            return None
        others = tuple(path for path in written if path is not None)
        return ResultPlace(self.output, self.force, self.fields_from, outputs=others)

    def gauges(self) -> "tuple[Gauge, ...]":
        """Return the gauges of `--gauges`; none without this option."""
        from dic import read_gauges

        return () if self.gauges_file is None else read_gauges(self.gauges_file)

    def files(self, deformed: list[Path], gauges: "tuple[Gauge, ...]") -> "SeriesFiles":
        """Return the paths of the output files for the deformed images, except the file of `--json`."""
        from dic.derived.series_files import SeriesFiles

        maps = self.maps
        sheets = maps.contact_sheets()
        folders = self.csv_folder, maps.folder
        return SeriesFiles(self.output, *folders, deformed, maps.file_format, sheets, gauges)


output_options = option_group(
    "outputs",
    OutputOptions,
    click.option("-o", "--output", type=_FILE, help="Result file, HDF5."),
    csv_option,
    gauges_option,
    comma_option,
    map_group,
    click.option("--json", "json_file", type=_FILE, help="JSON file of the printed results."),
    FORCE,
    fields_from_option,
    needs=COMMA_NEEDS | {"--fields-from": ["-o"]},
)
