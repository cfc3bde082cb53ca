"""Comparison of a result file with the result file of another program."""

from typing import Any

from dic.comparison.difference import Comparison, compare
from dic.comparison.peer import PeerField
from dic.comparison.picture import draw_comparison
from dic.comparison.read import read_peer
from dic.errors import RunFileError
from dic.files.writing import write_figure
from dic.pipeline.measured_images import CameraView, MeasuredImage, only_camera
from dic.pipeline.result_file import Loaded, Results, with_results
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

    def work(loaded: Loaded) -> tuple[Comparison, Any]:
        view = only_camera(loaded.views, camera, loaded.result_file or "results")
        chosen = _chosen(view, image, loaded.result_file or "results")
        if chosen.measurement is None:
            expected, got = "an image that could be measured", str(chosen.failure)
            raise RunFileError(chosen.label, "compare", expected, got, "give the number of another image")
        found = compare(chosen.measurement, other)
        if not found.common:
            remedy = "compare results of the same reference image"
            raise RunFileError(other.source, "compare", "points of the measured region", "none", remedy)
        return found, None if picture is None else draw_comparison(found, view.series.reference)

    comparison, figure = with_results(results, work, local_strain=True)
    if figure is not None and picture is not None:
        write_figure(figure, picture, _DPI)
    return comparison


def _chosen(view: CameraView, image: int | None, name: str) -> MeasuredImage:
    """Return the image to compare."""
    images = view.series.images
    if image is None and len(images) == 1:
        image = 1
    if image is None or not 1 <= image <= len(images):
        expected, remedy = f"a number from 1 to {len(images)}", f"give --image {len(images)}"
        got = "none" if image is None else str(image)
        raise RunFileError(name, "choose an image", expected, got, remedy)
    return images[image - 1]
