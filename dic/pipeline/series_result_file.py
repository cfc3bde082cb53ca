"""The result file of a series of images: it holds all results of `dic correlate -o`."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py

from dic.calibration.calibration import Calibration
from dic.calibration.file import read_calibration, write_calibration
from dic.errors import RunFileError
from dic.files.lazy import Computed
from dic.hdf5.open import NotReadable, open_hdf5
from dic.out_of_plane.correction import Correction
from dic.out_of_plane.diagnosis import Sensitivity
from dic.pipeline.series_result import MeasuredImage, MeasuredSeries
from dic.results.loading import Result, load_result, use_result
from dic.results.provenance import Provenance
from dic.results.reader import read_corrections, read_measurements, read_provenance
from dic.results.schema import FORMAT, VERSION
from dic.results.writer import ResultWriter
from dic.typing import Grey, PathLike

_SERIES = "series"


@dataclass(frozen=True)
class SeriesResult:
    """The results of a series of images, from a result file of `dic correlate`.

    Attributes
    ----------
    source : str
        Path of the result file.
    series : MeasuredSeries
        The images are read from the file when they are used.
    calibration : Calibration or None
    provenance : Provenance
    """

    source: str
    series: MeasuredSeries
    calibration: Calibration | None
    provenance: Provenance

    def __repr__(self) -> str:
        return f"SeriesResult of {self.source}, {len(self.series.images)} images"


def write_set_up(
    writer: ResultWriter,
    reference: Grey,
    calibration: Calibration | None,
    failures: Sequence[tuple[str, str]],
) -> None:
    """Write what a report needs beside the measured images of a series, after the last image.

    Parameters
    ----------
    writer : ResultWriter
        The writer, which has written at least one image.
    reference : ndarray of float32, shape (height, width)
    calibration : Calibration or None
    failures : sequence of (str, str)
        The name of each image that could not be measured, and the reason.
    """
    group = writer.group(_SERIES)
    stored = group.create_dataset(
        "reference", data=reference, shuffle=True, compression="gzip", compression_opts=1
    )
    stored.attrs["units"] = "grey level"
    for k, name in enumerate(("failed_label", "failure")):
        group.create_dataset(name, data=[one[k] for one in failures], dtype=h5py.string_dtype())
    if calibration is not None:
        write_calibration(writer.group("calibration"), calibration)


def is_series_result(path: PathLike) -> bool:
    """Return True if the file is a result file that `dic correlate` wrote."""
    try:
        with open_hdf5(Path(path)) as file:
            return file.attrs.get("file_format") == FORMAT and _SERIES in file
    except (NotReadable, OSError):
        return False


def load_series_result(path: PathLike) -> SeriesResult:
    """Read the result file of `dic correlate`. Nothing is computed again.

    The file stays open. The fields of an image are read from it when they are used, so a long series need not
    fit into memory.

    Raises
    ------
    RunFileError
        If the file is missing or cut off, or is not the result file of a series.
    """
    path = Path(path)

    def read(file: Any) -> SeriesResult:
        result = _read(path, file)
        for _ in result.series.images:
            pass
        return result

    return load_result(path, read, _refusal)


def use_series_result(path: PathLike, use: Callable[[SeriesResult], Result]) -> Result:
    """Return what `use` makes of the displacements of a series, and close the file.

    The local strains are not read, and must not be used.

    Raises
    ------
    RunFileError
        As for `load_series_result`.
    """
    path = Path(path)
    return use_result(path, lambda file: use(_read(path, file, local_strain=False)), _refusal)


def _read(path: Path, file: Any, *, local_strain: bool = True) -> SeriesResult:
    origin, group = read_provenance(file), file.get(_SERIES)
    if file.attrs.get("file_format") != FORMAT or group is None:
        raise _refusal(path, "an HDF5 file of another kind")
    if file.attrs["file_format_version"] != VERSION:
        raise _refusal(path, f"version {file.attrs['file_format_version']}, newer than this program")
    if origin is None or "reference" not in group:
        raise _refusal(path, "a file of an earlier version, which holds no reference image")
    calibration = read_calibration(file["calibration"]) if "calibration" in file else None
    measurements = read_measurements(group, calibration, local_strain=local_strain)
    corrections: Sequence[Correction | None] = [None] * len(measurements)
    if "corrected_mean" in group:
        corrections = read_corrections(group, measurements)
    labels, reasons = (group[name].asstr()[:] for name in ("failed_label", "failure"))
    failures = [
        MeasuredImage(str(label), failure=str(why)) for label, why in zip(labels, reasons, strict=True)
    ]

    def image(k: int) -> MeasuredImage:
        if k >= len(measurements):
            return failures[k - len(measurements)]
        return MeasuredImage(measurements[k].label, measurements[k], corrections[k])

    images = Computed(len(measurements) + len(failures), image)
    sensitivity = None if calibration is None else Sensitivity.of(calibration)
    series = MeasuredSeries(group["reference"][:], images, sensitivity=sensitivity)
    return SeriesResult(str(path), series, calibration, origin)


def _refusal(path: Path, got: str) -> RunFileError:
    expected = f"a result file of version {VERSION} from `dic correlate`"
    return RunFileError(str(path), "read results", expected, got, "make it with `dic correlate … -o FILE`")
