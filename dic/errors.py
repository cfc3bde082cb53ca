"""What can go wrong with a measurement, said in one sentence that says what to do."""


class MeasurementError(Exception):
    """Images, grid or points could not give what was asked.

    Parameters
    ----------
    source : str
        The file, image or point the sentence is about.
    step : str
        What was being done.
    expected, got : str
        What should have been there, and what was.
    remedy : str
        What to do about it.
    """

    def __init__(self, source: str, step: str, expected: str, got: str, remedy: str) -> None:
        # The arguments are kept as they are, so that an error survives the way back from another process.
        super().__init__(source, step, expected, got, remedy)
        self.source, self.step = source, step
        self.expected, self.got, self.remedy = expected, got, remedy

    def __str__(self) -> str:
        return f"{self.source}: {self.step}: expected {self.expected}, got {self.got}; {self.remedy}"


class ImageError(MeasurementError):
    """An image file is missing, damaged, or no image that can be measured."""


class CalibrationError(MeasurementError):
    """No grid was found, or a calibration could not be computed, read or applied."""


class CorrelationError(MeasurementError):
    """Images could not be correlated."""


class OutputError(MeasurementError):
    """Results cannot go where they were told to."""


class RunFileError(MeasurementError):
    """A run file or result file is missing, damaged, or lacks what is needed."""
