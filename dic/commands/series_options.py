"""The command-line options of `dic correlate`, in groups."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from pathlib import Path

import dic
from dic import Motion
from dic.commands.map_options import MapOutputs
from dic.commands.options import Chosen, option, options, use
from dic.commands.shared_options import (
    COMMA_NEEDS,
    comma,
    csv,
    fields_from,
    force,
    gauges,
    json_file,
    write_mask,
)
from dic.errors import CorrelationError
from dic.files import file_sha256
from dic.shell.output_paths import require_hdf5, require_places


@options
class RegionOptions:
    """Options for the region to measure."""

    roi: Path | None = option(
        "--roi",
        common=True,
        help="Mask image, white in the region to measure, or region file: TOML, JSON, CSV, or .roi or .zip of"
        " ImageJ. Default: the specimen, found by its speckles.",
    )
    polygons: tuple[str, ...] = option(
        "--polygon",
        multiple=True,
        help='Polygon of the region: "x,y x,y x,y ..." in px, or a region file. May be repeated.'
        " A polygon inside another is a hole. With --roi, the region is the intersection.",
    )
    write_mask: Path | None = write_mask()

    def files(self) -> list[Path | None]:
        """Return the paths of the file of `--roi` (or None) and of the region files that `read` reads."""
        return [self.roi, *(Path(text) for text in self.polygons if is_file(text))]

    def outputs(self) -> tuple[Path, ...]:
        """Return the paths of the files that `--write-mask` asks for."""
        return () if self.write_mask is None else dic.specimen.region_files(self.write_mask)

    def read(self, shape: tuple[int, int]) -> dic.typing.Mask | None:
        """Return the region to measure for images of `shape` (height, width); None without these options."""
        region = dic.read_region(self.roi, self.polygons, shape)
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


region_options = use("region", RegionOptions)


@options
class StartOptions:
    """Options for the calibration and the first guess of each image."""

    calibration_file: Path | None = option(
        "--calibration", help="Calibration file, for results in mm.", common=True
    )
    hint_text: str | None = option(
        "--hint",
        help="Expected rigid motion of every image: degrees counter-clockwise about the image's centre,"
        ' or "degrees,right,down" with a shift in px.',
    )

    static: tuple[str, ...] = option(
        "--static",
        multiple=True,
        metavar="IMAGE",
        help="Still image of the undeformed specimen before the test, or a folder, pattern or stack of them."
        " May be repeated. Errors by haze, vibration or a warming camera then enter the standard deviations.",
    )

    def still_images(self) -> list[Path]:
        """Return the images of `--static`."""
        return dic.list_images(*self.static) if self.static else []

    def require_static(self) -> None:
        """Raise an error if there are still images but no calibration."""
        if self.static and self.calibration_file is None:
            expected, remedy = "a calibration, with which strain is corrected", "give --calibration cal.h5"
            raise CorrelationError("settings", "use still images", expected, "--static without one", remedy)

    def hint(self, shape: tuple[int, int]) -> dic.typing.Float | None:
        """Return the expected motion from `--hint` as a homography, or None if the option was not given."""
        motion = self.motion()
        if motion is None:
            return None
        angle_deg, right_px, down_px = motion
        return dic.correlation.rigid_motion(
            angle_deg, (right_px, down_px), ((shape[1] - 1) / 2, (shape[0] - 1) / 2)
        )

    def motion(self) -> tuple[float, float, float] | None:
        """Return angle and shift of `--hint`; raise an error for another text, before any image is read."""
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


start_options = use("start", StartOptions, title="Input")


@options
class AlignmentOptions:
    """Options for the alignment of a specimen on a rotation stage."""

    alignment_file: Path | None = option(
        "--alignment", help="Alignment file from an earlier rotation on this fixture."
    )
    save_alignment: Path | None = option(
        "--save-alignment", help="JSON file for the alignment that --motion rigid solves."
    )

    def read(self, assumed: Chosen[Motion]) -> Motion:
        """Return the assumed motion with the alignment of the options."""
        known = None if self.alignment_file is None else dic.out_of_plane.load_alignment(self.alignment_file)
        return assumed.settings(alignment=known)

    def require_rotation(self, motion: str) -> None:
        """Raise an error if an alignment is to be saved but the motion is not a rotation.

        The alignment (tilt of specimen and stage axis relative to the grid) can only be determined from a
        rotation of the specimen.
        """
        if self.save_alignment is not None and motion != "rigid":
            raise CorrelationError(
                str(self.save_alignment),
                "save alignment",
                "--motion rigid",
                motion,
                "leave --save-alignment out, because only a rotation determines an alignment",
            )

    def save(self, alignment: dic.out_of_plane.Alignment | None) -> None:
        """Write the rotation stage's alignment to the file of `--save-alignment`, if this option is given."""
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
        dic.out_of_plane.save_alignment(alignment, self.save_alignment)


def read_set_up(
    calibration_file: Path | None, strain: dic.StrainSettings, motion: Motion
) -> dic.pipeline.SeriesSetUp:
    """Read the calibration file, and return the inputs from which a series' strains are computed."""
    if calibration_file is None:
        return dic.pipeline.SeriesSetUp(strain, motion)
    return dic.pipeline.SeriesSetUp(
        strain, motion, dic.load_calibration(calibration_file), file_sha256(calibration_file)
    )


alignment_options = use("alignment", AlignmentOptions, title="Motion")
motion_options = use(
    "assumed",
    Motion,
    title="Motion",
    only=("kind", "poisson_ratio", "shift_std_um", "tilt_axis_mm", "thickness_mm", "fixed_face"),
    common=("kind",),
)


@options
class SeriesOutputOptions:
    """Options that name the output files of `dic correlate`."""

    output: Path | None = option("-o", "--output", help="Result file, HDF5.", common=True)
    csv_folder: Path | None = csv()
    gauges_file: Path | None = gauges()
    decimal_comma: bool = comma()
    json_file: Path | None = json_file()
    force: bool = force()
    fields_from: Path | None = fields_from()

    def require_places(
        self, inputs: Sequence[Path | None], written: Sequence[Path | None], new_folders: Sequence[Path]
    ) -> None:
        """Raise an error if an output file cannot be written; an unfinished result may be continued."""
        # Allow an existing result file: whether it can be used is known only after reading the reference.
        own = [] if self.output is None else [*dic.results.outputs_of(self.output), self.output]
        require_places(inputs, written, force=self.force, replaceable=own, new_folders=new_folders)
        require_hdf5(self.output, "give --csv FOLDER for tables, --json for the values, --maps for pictures")

    def place(self, written: Sequence[Path | None]) -> dic.results.ResultPlace | None:
        """Return the place of the result file, and whether existing results may be replaced or used.

        The other files that the command writes are `written`.
        """
        if self.output is None:
            return None
        others = tuple(path for path in written if path is not None)
        return dic.results.ResultPlace(self.output, self.force, self.fields_from, outputs=others)

    def gauges(self) -> tuple[dic.gauges.Gauge, ...]:
        """Return the gauges of `--gauges`; none without this option."""
        return () if self.gauges_file is None else dic.read_gauges(self.gauges_file)

    def files(
        self, deformed: list[Path], gauges: tuple[dic.gauges.Gauge, ...], maps: MapOutputs
    ) -> dic.derived.SeriesFiles:
        """Return the paths of the output files for the deformed images, except the file of `--json`."""
        folders, sheets = (self.csv_folder, maps.folder), maps.contact_sheets()
        return dic.derived.SeriesFiles(self.output, *folders, deformed, maps.file_format, sheets, gauges)


output_options = use("outputs", SeriesOutputOptions, needs=COMMA_NEEDS | {"--fields-from": ["-o"]})
