"""The result file of a series of images: it contains all results of `dic correlate -o`."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from dic.calibration.calibration import Calibration
from dic.calibration.file import read_calibration, write_calibration
from dic.errors import RunFileError
from dic.files.lazy import Computed
from dic.hdf5.open import NotReadable, open_hdf5
from dic.image.threads import bands_of
from dic.image.times import ImageTime
from dic.out_of_plane.alignment import Alignment
from dic.out_of_plane.correction import Correction
from dic.out_of_plane.diagnosis import Sensitivity
from dic.pipeline.series_result import MeasuredImage, MeasuredSeries
from dic.results.alignment import read_alignment, write_alignment
from dic.results.fields import StoredFields, read_reference
from dic.results.job import Outcome, read_outcomes, write_outcomes
from dic.results.loading import Result, load_result, require_known, use_result
from dic.results.provenance import Provenance
from dic.results.reader import read_corrections, read_measurements, read_provenance
from dic.results.schema import FORMAT, VERSION
from dic.results.shapes import require_shapes
from dic.results.unfinished import FinishedImage
from dic.results.writer import ResultWriter
from dic.runfile.schema import FORMAT as RUN_FORMAT
from dic.typing import PathLike

_SERIES, _CAMERAS = "series", "cameras"

_ROWS = 512
"""Number of rows of the reference that are converted and written at a time, if chunks are not higher."""


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
    outcomes : list of Outcome
        The outcome of each image, in the order of the series; empty for files of earlier versions.
    fields : StoredFields
        The fields of the images that were correlated, in the order of the series.
    """

    source: str
    series: MeasuredSeries
    calibration: Calibration | None
    provenance: Provenance
    outcomes: list[Outcome]
    fields: StoredFields

    def __repr__(self) -> str:
        return f"SeriesResult of {self.source}, {len(self.series.images)} images"

    @property
    def reference_name(self) -> str:
        """Name of the reference image: the first of the input files."""
        return next(iter(self.provenance.inputs), "")

    @property
    def correlated(self) -> Sequence[FinishedImage]:
        """The correlated images in the order of the series; each is read when it is used."""
        return self.fields.images(self.outcomes)


def write_set_up(
    writer: ResultWriter,
    reference: NDArray[Any],
    calibration: Calibration | None,
    outcomes: Sequence[Outcome],
    alignment: Alignment | None,
) -> None:
    """After the last image, write the data that a report needs in addition to the measured images.

    Parameters
    ----------
    writer : ResultWriter
        The writer, which has written at least one image.
    reference : ndarray, shape (height, width)
        Grey levels, which are stored as float32.
    calibration : Calibration or None
    outcomes : sequence of Outcome
        The outcome of each image of the series.
    alignment : Alignment or None
        The rotation stage's alignment, if the images have solved it.
    """
    group = writer.group(_SERIES)
    stored = group.create_dataset(
        "reference", reference.shape, np.float32, shuffle=True, compression="gzip", compression_opts=1
    )
    # Convert some rows at a time. Each write fills whole chunks, because a chunk is compressed as a whole.
    chunk = stored.chunks[0]
    for rows in bands_of(len(reference), chunk * max(1, _ROWS // chunk)):
        stored[rows] = reference[rows].astype(np.float32)
    stored.attrs["units"] = "grey level"
    failures = [(each.label, each.failure) for each in outcomes if each.failure is not None]
    for k, name in enumerate(("failed_label", "failure")):
        group.create_dataset(name, data=[one[k] for one in failures], dtype=h5py.string_dtype())
    write_outcomes(group, outcomes)
    if alignment is not None:
        write_alignment(group, alignment)
    if calibration is not None:
        write_calibration(writer.group("calibration"), calibration)


def is_series_result(path: PathLike) -> bool:
    """Return True if a result file is one of `dic correlate`, and False if it is one of `dic process`.

    Raises
    ------
    RunFileError
        If the file is not a result file of these commands, or cannot be read.
    """
    remedy = "name another file"
    try:
        with open_hdf5(Path(path)) as file:
            found = file.attrs.get("file_format")
            if found == FORMAT and (_SERIES in file or _CAMERAS in file):
                return _SERIES in file
    except (NotReadable, OSError) as error:
        got = str(error)
    else:
        got = "an HDF5 file of another kind"
        if found == FORMAT:
            got = "a result file that lacks some of its data"
        elif found == RUN_FORMAT:
            got, remedy = "a run file", f"measure it with `dic process {path}`"
    expected = "a result file of `dic correlate -o` or `dic process`"
    raise RunFileError(str(path), "read results", expected, got, remedy)


def load_series_result(path: PathLike) -> SeriesResult:
    """Read the result file of `dic correlate`. Nothing is computed again.

    The file stays open. The fields of an image are read from the file when they are used, so a long series
    need not fit into memory.

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


def use_series_result(
    path: PathLike, use: Callable[[SeriesResult], Result], *, local_strain: bool = False
) -> Result:
    """Call `use` with the results of a series, close the file, and return what `use` returned.

    Without `local_strain`, the local strains are not read, and must not be used.

    Raises
    ------
    RunFileError
        As for `load_series_result`.
    """
    path = Path(path)
    return use_result(path, lambda file: use(_read(path, file, local_strain=local_strain)), _refusal)


def _read(path: Path, file: Any, *, local_strain: bool = True) -> SeriesResult:
    if file.attrs.get("file_format") == FORMAT:
        require_known(path, file)
    group = file.get(_SERIES)
    if file.attrs.get("file_format") != FORMAT or group is None:
        raise _refusal(path, "an HDF5 file of another kind")
    origin = read_provenance(file)
    if origin is None or "reference" not in group:
        raise _refusal(path, "a file of an earlier version, which holds no reference image")
    require_shapes(group, group["reference"])
    calibration = read_calibration(file["calibration"]) if "calibration" in file else None
    measurements = read_measurements(group, calibration, local_strain=local_strain)
    corrections: Sequence[Correction | None] = [None] * len(measurements)
    if "corrected_mean" in group:
        corrections = read_corrections(group, measurements)
    outcomes = read_outcomes(group)
    places = _places(outcomes or _older_outcomes(group, len(measurements)))

    def image(k: int) -> MeasuredImage:
        row = places[k]
        if isinstance(row, Outcome):
            return MeasuredImage(row.label, failure=row.failure, time=row.time)
        time = outcomes[k].time if outcomes else ImageTime()
        return MeasuredImage(measurements[row].label, measurements[row], corrections[row], time=time)

    images = Computed(len(places), image)
    sensitivity = None if calibration is None else Sensitivity.of(calibration)
    series = MeasuredSeries(read_reference(group), images, read_alignment(group), sensitivity)
    return SeriesResult(str(path), series, calibration, origin, outcomes, StoredFields(group))


def _older_outcomes(group: Any, measured: int) -> list[Outcome]:
    """Return the outcomes of a file of an earlier version, which lists failures without their positions."""
    labels, reasons = (group[name].asstr()[:] for name in ("failed_label", "failure"))
    failures = [Outcome(str(label), "", str(why)) for label, why in zip(labels, reasons, strict=True)]
    return [Outcome("", "")] * measured + failures


def _places(outcomes: Sequence[Outcome]) -> list[int | Outcome]:
    """Return the row number of each image; for an image that failed and has no row, its outcome."""
    rows = count()
    return [next(rows) if each.failure is None else each for each in outcomes]


def _refusal(path: Path, got: str) -> RunFileError:
    expected = f"a result file of version {VERSION} from `dic correlate`"
    return RunFileError(str(path), "read results", expected, got, "make it with `dic correlate … -o FILE`")
