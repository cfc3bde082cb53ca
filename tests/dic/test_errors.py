import pickle

from dic.errors import CorrelationError, MeasurementError


def test_errors_come_back_whole_from_another_process() -> None:
    error = CorrelationError("a.png", "correlate", "texture", "none", "paint it")

    copy = pickle.loads(pickle.dumps(error))

    assert type(copy) is CorrelationError
    assert isinstance(copy, MeasurementError)
    assert str(copy) == "a.png: correlate: expected texture, got none; paint it"
