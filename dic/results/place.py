"""The place of a result file, and what a measurement may do with the results that are there."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class ResultPlace:
    """The place of a result file, and what may be done with earlier results.

    Attributes
    ----------
    path : Path
        The result file. If it already contains the same results, it is not written again.
    replace : bool
        True if other results at this place may be replaced.
    fields_from : Path, optional
        A result file whose fields are used instead of a correlation. Default: `path`, if it contains the
        fields of this measurement.
    inputs : tuple of Path
        Files from which the caller took settings, such as a settings file. The provenance of the results
        names these files with their digests.
    """

    path: Path
    replace: bool = True
    fields_from: Path | None = None
    inputs: tuple[Path, ...] = ()
