"""Choices for the report of a tensile test: stated facts, strain fields, images at rest, input files."""

from dataclasses import dataclass, field

from dic.report.stated_facts import StatedFacts
from dic.typing import PathLike


@dataclass(frozen=True)
class ReportDetails:
    """The user's choices for the report of a tensile test, beside the properties.

    Attributes
    ----------
    facts : StatedFacts
        Facts that only the user knows, from `read_stated_facts`.
    fields_at : tuple of str
        Points of the curve whose fields are shown: "half", "Rp02", "ReH", "Rm", "last", "strain=PERCENT",
        "stress=MPA" or "image=NAME". If empty: the points Rp02, half and Rm that the curve has.
    static : tuple of str
        Names of images, or numbers of steps, in which the specimen is at rest as in the reference image. The
        noise floor is measured in these images.
    inputs : tuple of path
        Input files of the test other than the result file, such as the machine's record. The report states
        the digests of these files.
    """

    facts: StatedFacts = field(default_factory=StatedFacts)
    fields_at: tuple[str, ...] = ()
    static: tuple[str, ...] = ()
    inputs: tuple[PathLike, ...] = ()
