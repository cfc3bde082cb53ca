"""What the report shows of a tensile test beside its values: stated facts, fields, images at rest, files."""

from dataclasses import dataclass, field

from dic.report.stated_facts import StatedFacts
from dic.typing import PathLike


@dataclass(frozen=True)
class ReportDetails:
    """What the report shows of a tensile test beside its values.

    Attributes
    ----------
    facts : StatedFacts
        What only the user knows, from `read_stated_facts`.
    fields_at : tuple of str
        Points of the curve whose fields are shown: "half", "Rp02", "ReH", "Rm", "last", "strain=PERCENT",
        "stress=MPA" or "image=NAME". Empty for Rp02, half and Rm, as far as the curve has them.
    static : tuple of str
        Names of images, or numbers of steps, in which the specimen is at rest as in the reference image. The
        noise floor is measured in them.
    inputs : tuple of path
        Files that the test was computed from beside the result file, such as the machine's record. The report
        states their digests.
    """

    facts: StatedFacts = field(default_factory=StatedFacts)
    fields_at: tuple[str, ...] = ()
    static: tuple[str, ...] = ()
    inputs: tuple[PathLike, ...] = ()
