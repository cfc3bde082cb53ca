"""Messages to and from worker processes: objects arrive equal, and an early end is an error."""

import io

import numpy as np
import pytest

from dic.workers.pipes import packed, receive, send, unpacked


def sent(value: object) -> io.BytesIO:
    pipe = io.BytesIO()
    send(pipe, packed(value))
    pipe.seek(0)
    return pipe


def test_objects_arrive_equal_and_their_arrays_can_be_written():
    rng = np.random.default_rng(2)
    arrays = [rng.normal(size=(30, 20, 2)), np.asfortranarray(rng.normal(size=(3, 4))), np.empty((0, 5))]
    value = {"arrays": arrays, "view": arrays[0][::3, 1], "text": "µε", "none": None}
    found = unpacked(receive(sent(value)))
    assert (found["text"], found["none"]) == ("µε", None)
    for one, other in zip([*arrays, value["view"]], [*found["arrays"], found["view"]], strict=True):
        np.testing.assert_array_equal(one, other)
        assert one.dtype == other.dtype
        other += 1.0


def test_arrays_are_sent_from_where_they_are():
    values = np.zeros((100, 100))
    content, array = packed((values, "text"))
    assert len(content) < 1000
    values[3, 4] = 7.0
    assert unpacked([content, array])[0][3, 4] == 7.0


def test_message_that_ends_too_early_is_the_end_of_the_other_process():
    whole = sent(np.zeros(100)).getvalue()
    for count in (0, 4, 20, len(whole) - 1):
        with pytest.raises(EOFError):
            receive(io.BytesIO(whole[:count]))
