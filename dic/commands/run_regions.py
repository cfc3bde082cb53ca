"""The options of `dic process` that name what to measure in the images of a run, and where its grid is."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import dic
from dic.commands.options import all_of, option, options, use
from dic.commands.series_options import is_file
from dic.errors import CorrelationError


@options
class RunRegionOptions:
    """Options for the region to measure, each with the name of the camera that it belongs to."""

    rois: tuple[str, ...] = option(
        "--roi",
        common=True,
        multiple=True,
        metavar="CAMERA=FILE",
        help="Region to measure in a camera's images: mask image, white in the region, or region file: TOML,"
        " JSON, CSV, or .roi or .zip of ImageJ. Once for each camera. Default: the specimen, found by its"
        " speckles.",
    )
    polygons: tuple[str, ...] = option(
        "--polygon",
        multiple=True,
        metavar="CAMERA=REGION",
        help='Polygon of a camera\'s region: "x,y x,y x,y ..." in px, or a region file. May be repeated.'
        " A polygon inside another is a hole. With --roi, the region is the intersection.",
    )

    grid_from: Path | None = option(
        "--grid-from",
        metavar="RUN",
        help="Take the images of the grid from this run file, because the RUN has none: the same cameras"
        " stood in the same places. Default: the RUN itself.",
    )

    @property
    def files(self) -> list[Path]:
        """The files that the options name."""
        grid = [] if self.grid_from is None else [self.grid_from]
        rois = [Path(text.partition("=")[2]) for text in self.rois]
        places = [text.partition("=")[2] for text in self.polygons]
        return grid + rois + [Path(place) for place in places if is_file(place)]

    def source(self, run: Path) -> dic.pipeline.RunSource:
        """Return a run file with the regions of the options.

        Raises `CorrelationError` if an option lacks the camera or the region, or if a camera has two files.
        All such mistakes are named together.
        """
        rois, polygons = all_of(
            partial(self._by_camera, "--roi", self.rois, most=1),
            partial(self._by_camera, "--polygon", self.polygons),
        )
        return dic.pipeline.RunSource(
            run,
            {
                camera: partial(
                    dic.read_region, next(iter(rois.get(camera, [])), None), polygons.get(camera, [])
                )
                for camera in {**rois, **polygons}
            },
            self.grid_from,
        )

    @staticmethod
    def _by_camera(option: str, texts: tuple[str, ...], most: int | None = None) -> dict[str, list[str]]:
        """Return the values of an option by camera; raise an error if a camera has more than `most`."""
        found: dict[str, list[str]] = {}
        value = "FILE" if most else "REGION"
        for text in texts:
            camera, _, given = text.partition("=")
            if not (camera and given):
                remedy = f"name the camera that the region belongs to: {option} on_axis={value}"
                raise CorrelationError("settings", option, f"CAMERA={value}", text, remedy)
            found.setdefault(camera, []).append(given)
        for camera, several in found.items():
            if most is not None and len(several) > most:
                remedy = "give further regions by --polygon, or draw all in one file"
                raise CorrelationError(
                    "settings", option, f"one file for {camera}", " and ".join(several), remedy
                )
        return found


region_options = use("region", RunRegionOptions)
