"""An errand that takes longer than a call is fetched by a later call, and its exception too."""

import threading

import pytest

from drivers.lines.errand import Errand


@pytest.fixture
def errand():
    opened: Errand[int] = Errand("test")
    yield opened
    opened.close(5.0)


def test_a_result_comes_with_the_call_or_with_a_later_one(errand):
    assert errand.result(lambda: 1, 5.0) == 1
    gate = threading.Event()

    def slow() -> int:
        gate.wait(5.0)
        return 2

    for _ in range(2):
        with pytest.raises(TimeoutError):
            errand.result(slow, 0.01)
    assert errand.is_running
    gate.set()
    # the running errand counts, not the function of this call
    assert errand.result(lambda: 3, 5.0) == 2
    assert errand.result(lambda: 3, 5.0) == 3


def test_an_exception_belongs_to_the_call_that_waits(errand):
    with pytest.raises(ZeroDivisionError):
        errand.result(lambda: 1 // 0, 5.0)
    assert errand.result(lambda: 1, 5.0) == 1
