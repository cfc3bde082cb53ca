"""Errors of a measurement. The message of each error is one sentence that ends with a remedy."""

import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from numbers import Integral, Real
from typing import Any, get_args

__all__ = [
    "CalibrationError",
    "CorrelationError",
    "CurveError",
    "GaugeError",
    "ImageError",
    "ImageWarning",
    "MeasurementError",
    "OutputError",
    "RunFileError",
    "WorkerError",
    "WorkerWarning",
    "all_of",
    "each_warning_once",
    "joined",
]


class MeasurementError(Exception):
    """A measurement failed because of its images, grid, points or settings.

    Parameters
    ----------
    source : str
        The file, image, point or setting that the error is about.
    step : str
        The step that failed.
    expected, got : str
        The input that the failed step needs, and the input that the step got.
    remedy : str
        The remedy for the user, with the name of the setting or file and a value that works.
    """

    def __init__(self, source: str, step: str, expected: str, got: str, remedy: str) -> None:
        # `Exception` gets all five arguments, so that pickle can pass the error on from another process.
        super().__init__(source, step, expected, got, remedy)
        self.source, self.step = source, step
        self.expected, self.got, self.remedy = expected, got, remedy

    def at(self, source: str) -> "MeasurementError":
        """Return the same error about another source, such as the place of a setting in a file."""
        return type(self)(source, self.step, self.expected, self.got, self.remedy)

    def __str__(self) -> str:
        return f"{self.source}: {self.step}: expected {self.expected}, got {self.got}; {self.remedy}"


class ImageError(MeasurementError):
    """An image file is missing, damaged, or not an image that can be measured."""


class ImageWarning(UserWarning):
    """A warning that only a part of an image file's content is used, or that the image is turned."""


class WorkerWarning(UserWarning):
    """A warning that others can use the workers of a cluster, and with them this user's computers."""


_collected: ContextVar[list[tuple[str, str]] | None] = ContextVar("collected", default=None)
"""Warnings about images that are collected and not given; None if they are given."""


@contextmanager
def collected_warnings() -> Iterator[list[tuple[str, str]]]:
    """Collect warnings about image files as arguments of `warn_of_image`, to give them elsewhere."""
    notes: list[tuple[str, str]] = []
    before = _collected.set(notes)
    try:
        yield notes
    finally:
        _collected.reset(before)


_given: ContextVar[set[str] | None] = ContextVar("given", default=None)
"""Warnings about images that were given in the present series; None outside of a series."""


@contextmanager
def each_warning_once() -> Iterator[None]:
    """Give each warning about image files only for the first file of a series; can be used as a decorator."""
    before = _given.set(set() if _given.get() is None else _given.get())
    try:
        yield
    finally:
        _given.reset(before)


def warn_of_image(path: object, note: str) -> None:
    """Give an `ImageWarning` about a file; within `each_warning_once`, only for the first file."""
    given, collected = _given.get(), _collected.get()
    if collected is not None:
        collected.append((str(path), note))
    elif given is None:
        warnings.warn(f"{path}: {note}", ImageWarning, stacklevel=3)
    elif note not in given:
        given.add(note)
        warnings.warn(f"{path}: {note} (said once for the series)", ImageWarning, stacklevel=3)


class CalibrationError(MeasurementError):
    """No grid was found, or a calibration could not be computed, read or applied."""


class CorrelationError(MeasurementError):
    """Images could not be correlated."""


class CurveError(MeasurementError):
    """A record of load and strain cannot be read, or is not a tensile test."""


class GaugeError(MeasurementError):
    """A gauge is declared wrongly, or the results have no points at its place."""


class OutputError(MeasurementError):
    """A result file cannot be written to the given place."""


class RunFileError(MeasurementError):
    """A run file or result file is missing, damaged or incomplete."""


class WorkerError(MeasurementError):
    """The processes that correlate images cannot be started or used, or end again and again."""


Check = tuple[bool, str, str, object, str]
"""One check of a setting: True for a good value, the setting's name, expected value, given value, remedy."""


def require_all(error: type[MeasurementError], source: str, checks: Iterable[Check]) -> None:
    """Raise one error that reports all failed checks together.

    Parameters
    ----------
    error : type
        Class of the error to raise.
    source : str
        The group of the checked values, such as "settings".
    checks : iterable of Check
    """
    failed = [
        error(source, name, expected, str(got), remedy)
        for passed, name, expected, got, remedy in checks
        if not passed
    ]
    if failed:
        raise joined(failed)


def joined(errors: Sequence[MeasurementError]) -> MeasurementError:
    """Return one error of the first error's class, with a message that contains all messages."""
    first, *others = errors
    remedy = ". ".join([first.remedy, *(str(error) for error in others)])
    return type(first)(first.source, first.step, first.expected, first.got, remedy)


def all_of(*parts: Callable[[], Any]) -> list[Any]:
    """Call the functions `parts` and return their results; raise all their errors as one error.

    Raises
    ------
    MeasurementError
    """
    results, errors = [], []
    for part in parts:
        try:
            results.append(part())
        except MeasurementError as error:
            errors.append(error)
    if errors:
        raise joined(errors)
    return results


def is_whole(value: object) -> bool:
    """Return True if the setting is a whole number; text, True and False are not numbers here."""
    return isinstance(value, Integral) and not isinstance(value, bool)


def is_number(value: object) -> bool:
    """Return True if the setting is a real number; text, True and False are not numbers here."""
    return isinstance(value, Real) and not isinstance(value, bool)


MEASURE_FIRST = "measure first: dic.measure(field)"
"""Remedy if a function that needs a measurement gets something else, such as a field of displacements."""


def require_kind(name: str, value: object, kind: Any, remedy: str) -> None:
    """Raise an error if an argument has a wrong type.

    Parameters
    ----------
    name : str
        Name of the argument.
    value : object
    kind : type or union of types
    remedy : str

    Raises
    ------
    CorrelationError
    """
    if not isinstance(value, kind):
        expected = " or ".join(_kind(part) for part in get_args(kind) or (kind,))
        raise CorrelationError("arguments", name, expected, _kind(type(value)), remedy)


def _kind(kind: type) -> str:
    article = "an" if kind.__name__[0] in "AEIOUaeiou" else "a"
    return "None" if kind is type(None) else f"{article} {kind.__name__}"
