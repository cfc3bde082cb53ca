"""Why the value of a live gauge must not be used for limits and control."""

from enum import Enum


class Reason(Enum):
    """The reason why a value is not valid; `NONE` for a valid value. The text is for people."""

    NONE = ""
    NOT_MEASURED = "no frame was measured yet"
    REPEATED = "the frame repeats the one before, or is no later than it"
    SATURATED = "too many saturated pixels"
    FAINT = "most of the contrast is gone: the lens is covered, or the light has changed"
    OUTSIDE = "the gauge has left the image or the calibrated area"
    LOW_CORRELATION = "the correlation is too low: the pattern is covered, blurred, torn or badly lit"
    POINTS_LOST = "too few points have a displacement"
    JUMP = "the strain changed faster than is credible"
    NO_VALUE = "the gauge has no value of this kind"
    NO_MOTION = "the motion out of the plane is not known yet"
    DECLINED = "the field could not be corrected for motion out of the plane"
    CAMERAS_DISAGREE = "the two cameras do not show the same motion: was a camera moved?"
    OLD = "the motion out of the plane was solved too long ago"

    def __bool__(self) -> bool:
        """Return True for a reason, False for `NONE`."""
        return self is not Reason.NONE
