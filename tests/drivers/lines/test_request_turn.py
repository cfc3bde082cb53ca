import select
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from drivers.lines.request_turn import RequestTurn


@pytest.fixture
def turn():
    made = RequestTurn()
    yield made
    made.close()


def test_whoever_is_interrupted_while_waiting_for_an_urgent_turn_takes_nobody_elses(turn, monkeypatch):
    def interrupted() -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(turn, "_overtake", interrupted)
        with pytest.raises(KeyboardInterrupt), turn.urgent():
            pass

    def ordinary() -> str:
        with turn.ordinary():
            return "had a turn"

    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(ordinary).result(60.0) == "had a turn"


def test_no_ordinary_request_begins_while_an_urgent_one_waits(turn):
    order = []
    begun, waiting = threading.Event(), threading.Event()

    def first() -> None:
        with turn.ordinary():
            begun.set()
            assert waiting.wait(60.0)

    def urgent() -> None:
        with turn.urgent():
            order.append("urgent")

    def late() -> None:
        with turn.ordinary():
            order.append("ordinary")

    with ThreadPoolExecutor(3) as pool:
        requests = [pool.submit(first)]
        assert begun.wait(60.0)
        requests.append(pool.submit(urgent))
        # readable as soon as the urgent one waits
        assert select.select([turn.wake], [], [], 10.0)[0]
        requests.append(pool.submit(late))
        waiting.set()
        for request in requests:
            request.result(60.0)
    assert order == ["urgent", "ordinary"]
