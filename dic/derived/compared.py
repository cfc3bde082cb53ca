"""Comparison of a result file with the result file of another program."""

from pathlib import Path
from typing import Any

from dic.comparison.difference import Comparison, compare
from dic.comparison.peer import PeerField
from dic.comparison.picture import draw_comparison
from dic.comparison.read import read_peer
from dic.derived.export import Results, sources_of
from dic.errors import RunFileError
from dic.files.writing import write_figure
from dic.pipeline.measured_images import MeasuredImage, MeasuredSeries
from dic.pipeline.result import RunResult, SeriesResult
from dic.pipeline.result_file import use_results
from dic.typing import PathLike

_DPI = 130


def compare_results(
    results: Results,
    peer: PeerField | PathLike,
    *,
    image: int | None = None,
    camera: str | None = None,
    picture: PathLike | None = None,
) -> Comparison:
    """Compare raw displacements and strains of an image with the results of another program.

    `docs/exports.md` describes the comparison, and the axes and signs of each program.

    Parameters
    ----------
    results : path, MeasuredSeries, SeriesResult or RunResult
        A result file of `dic correlate` or `dic process`, or the results that `dic` has read from such a
        file.
    peer : PeerField or path
        The result of `read_peer`, or a result file of DICe, Ncorr or OpenCorr.
    image : int, optional
        Number of the image in the results, from 1. Needed if the results have several images.
    camera : str, optional
        Camera of a run. Needed if the run has several cameras.
    picture : path, optional
        File for a picture of both results and their difference. The ending of the name determines the format.

    Raises
    ------
    RunFileError
        If a file cannot be read; if the choice of an image or a camera is missing; or if the results have no
        common point.
    OSError
        If the picture cannot be written.
    """
    other = peer if isinstance(peer, PeerField) else read_peer(peer)

    def work(loaded: MeasuredSeries | SeriesResult | RunResult) -> tuple[Comparison, Any]:
        chosen, reference = _chosen(loaded, image, camera)
        if chosen.measurement is None:
            expected, got = "an image that could be measured", str(chosen.failure)
            raise RunFileError(chosen.label, "compare", expected, got, "give the number of another image")
        found = compare(chosen.measurement, other)
        if not found.common:
            remedy = "compare results of the same reference image"
            raise RunFileError(other.source, "compare", "points of the measured region", "none", remedy)
        return found, None if picture is None else draw_comparison(found, reference)

    if isinstance(results, str | Path):
        comparison, figure = use_results(results, work, local_strain=True)
    else:
        comparison, figure = work(results)
    if figure is not None and picture is not None:
        write_figure(figure, picture, _DPI)
    return comparison


def _chosen(
    loaded: MeasuredSeries | SeriesResult | RunResult, image: int | None, camera: str | None
) -> tuple[MeasuredImage, Any]:
    """Return the image to compare, and the reference image."""
    sources = sources_of(loaded, camera)
    if len(sources) != 1:
        names = [source.camera for source in sources]
        expected, remedy = f"one of {', '.join(names)}", f"give --camera {names[0]}"
        raise RunFileError(_name(loaded), "choose a camera", expected, "none", remedy)
    images = sources[0].images
    if image is None and len(images) == 1:
        image = 1
    if image is None or not 1 <= image <= len(images):
        expected, remedy = f"a number from 1 to {len(images)}", f"give --image {len(images)}"
        got = "none" if image is None else str(image)
        raise RunFileError(_name(loaded), "choose an image", expected, got, remedy)
    if isinstance(loaded, RunResult):
        return images[image - 1], loaded.series(sources[0].camera).reference
    series = loaded if isinstance(loaded, MeasuredSeries) else loaded.series
    return images[image - 1], series.reference


def _name(loaded: MeasuredSeries | SeriesResult | RunResult) -> str:
    """Return the name of a result file for error messages."""
    if isinstance(loaded, MeasuredSeries):
        return "results"
    return (loaded.file or loaded.source) if isinstance(loaded, RunResult) else loaded.source
