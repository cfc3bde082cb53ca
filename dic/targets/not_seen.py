"""The error if an image does not show a target of the given kind; `dic.targets.seen` names what it shows."""

from dic.errors import CalibrationError


class TargetNotSeen(CalibrationError):
    """The image shows nothing of the given kind of target, so that it may show another target."""
