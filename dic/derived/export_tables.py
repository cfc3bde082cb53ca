"""Results as a table of pandas or a dataset of xarray, for users of Python."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dic.derived.export import ExportSource, sources_of
from dic.errors import OutputError, RunFileError
from dic.exports.image import FIXED, ExportImage, long_name, units
from dic.pipeline.measured_images import only_camera
from dic.pipeline.result_file import Loaded, Results, with_results

if TYPE_CHECKING:
    import pandas
    import xarray

_GRID = ("y_px", "x_px")


def to_pandas(results: Results, *, camera: str | None = None, raw_strain: bool = False) -> "pandas.DataFrame":
    """Return a table of pandas with one line for each point of the region in each image.

    Parameters
    ----------
    results : path, MeasuredSeries, SeriesResult or RunResult
        A result file of `dic correlate` or `dic process`, or the results that `dic` has read from such a
        file.
    camera : str, optional
        Camera of a run. Default: all cameras.
    raw_strain : bool
        True to return also the raw local strains `raw_exx` …, as for `export_results`.

    Returns
    -------
    pandas.DataFrame
        Columns image (number, from 1), label, camera of a run, x_px, y_px, and the values that
        `docs/exports.md` describes. `attrs["units"]` maps the names of the values to their units.

    Raises
    ------
    OutputError
        If pandas is not installed.
    RunFileError
        If the results cannot be read, or a run has no such camera.
    """
    pandas = _package("pandas", "to_pandas")
    frames, names = [], dict[str, None]()
    found = _images(results, camera, raw_strain=raw_strain)
    sources = [source for source, _ in found]
    for source, image in found:
        points = image.points
        rows, columns = np.nonzero(points.active)
        own: dict[str, Any] = {"image": image.number, "label": points.label}
        own |= {"camera": source.camera} if source.camera else {}
        places = {"x_px": points.x_px[columns], "y_px": points.y_px[rows]}
        values = {name: value[points.active] for name, value in points.values.items()}
        frames.append(pandas.DataFrame({**own, **image.known, **places, **values}))
        names |= dict.fromkeys(frames[-1].columns)
    table = pandas.concat(frames, ignore_index=True)[list(names)]
    channels = {name: unit for source in sources for name, unit in source.channels.items()}
    named = (name for name in names if name not in ("image", "label", "camera"))
    table.attrs["units"] = units(named) | {name: unit for name, unit in channels.items() if name in names}
    return table


def to_xarray(results: Results, *, camera: str | None = None, raw_strain: bool = False) -> "xarray.Dataset":
    """Return a dataset of xarray with the dimensions image, y_px and x_px.

    The dataset contains all images in memory. For a long series write a file with `export_results(…,
    ["netcdf"])`, and open it with `xarray.open_dataset`, which reads only the data that are used.

    Parameters
    ----------
    results, camera, raw_strain
        As for `to_pandas`. If a run has several cameras, one of them must be chosen.

    Returns
    -------
    xarray.Dataset
        The values that `docs/exports.md` describes, with the attributes units and long_name.

    Raises
    ------
    OutputError
        If xarray is not installed.
    RunFileError
        As for `to_pandas`, and if a run has several cameras and none is chosen.
    """
    package = _package("xarray", "to_xarray")
    found = _images(results, camera, raw_strain=raw_strain, of_one_camera=True)
    first = found[0][1].points
    names = dict.fromkeys(name for _, image in found for name in image.points.values)
    known = dict.fromkeys(name for _, image in found for name in image.known)
    fields: dict[str, Any] = {"active": (_GRID, first.active)}
    for name in names:
        if name in FIXED:
            known_places = (image.points.values.get(name) for _, image in found)
            fields[name] = _GRID, next(places for places in known_places if places is not None)
        else:
            values = [_masked(image, name, first.active.shape) for _, image in found]
            fields[name] = ("image", *_GRID), np.stack(values)
    for name in known:
        fields[name] = ("image",), np.array([image.known.get(name, np.nan) for _, image in found])
    fields["label"] = ("image",), [image.points.label for _, image in found]
    along = {"image": [image.number for _, image in found], "x_px": first.x_px, "y_px": first.y_px}
    series = found[0][0].series(first.measurement)
    dataset: xarray.Dataset = package.Dataset(fields, along, dict(series.about))
    for name in (*names, *known, *_GRID):
        dataset[name].attrs.update({"units": series.unit_of(name), "long_name": long_name(name)})
    return dataset


_Found = list[tuple[ExportSource, ExportImage]]


def _images(results: Results, camera: str | None, *, raw_strain: bool, of_one_camera: bool = False) -> _Found:
    """Return all images that could be measured, with the series to which each belongs."""

    def collect(loaded: Loaded) -> _Found:
        if of_one_camera:
            only_camera(loaded.views, camera, "results")
        sources = sources_of(loaded, camera)
        found = [(source, image) for source in sources for image in source.exported(raw_strain=raw_strain)]
        if not found:
            remedy = "measure the images again"
            raise RunFileError("results", "read images", "at least one that was measured", "none", remedy)
        return found

    return with_results(results, collect, local_strain=True)


def _masked(image: ExportImage, name: str, shape: tuple[int, ...]) -> NDArray[Any]:
    """Return one quantity at all points; NaN outside the region and where a value is missing."""
    values = image.points.values.get(name)
    if values is None:
        return np.full(shape, np.nan)
    return np.where(image.points.active, values, np.nan) if values.dtype.kind == "f" else values


def _package(name: str, function: str) -> Any:
    try:
        return import_module(name)
    except ImportError as error:
        expected, remedy = f"the package {name}", f"install it: pip install {name}"
        raise OutputError(function, "import", expected, "none", remedy) from error
