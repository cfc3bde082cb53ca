"""The error for an image that does not show the given kind of target."""

from dic.errors import CalibrationError


class TargetNotSeen(CalibrationError):
    """The image shows nothing of the given kind of target, so that it may show another target."""
