"""A thread that runs errands which may take longer than the call that waits for them."""

import queue
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Errand(Generic[T]):
    """Runs one function at a time on a thread of its own. A later call fetches a result that came too late.

    `name` is the name of the thread.
    """

    def __init__(self, name: str) -> None:
        self._todo: queue.SimpleQueue[Callable[[], T] | None] = queue.SimpleQueue()
        self._done: queue.SimpleQueue[tuple[list[T], BaseException | None]] = queue.SimpleQueue()
        self.is_running = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def result(self, function: Callable[[], T], timeout_s: float) -> T:
        """Return the result of the running errand, or begin with `function` if none is running.

        Raise the exception of the errand, and `TimeoutError` if it has not ended within `timeout_s`.
        """
        if not self.is_running:
            self._todo.put(function)
            self.is_running = True
        try:
            results, error = self._done.get(timeout=min(max(0.0, timeout_s), threading.TIMEOUT_MAX))
        except queue.Empty:
            raise TimeoutError(f"an errand that takes longer than {timeout_s:g} s") from None
        self.is_running = False
        if error is not None:
            raise error
        return results[0]

    def close(self, timeout_s: float) -> None:
        """End the thread when its errand has ended. Wait for this for `timeout_s` at most."""
        self._todo.put(None)
        self._thread.join(timeout_s)

    def _run(self) -> None:
        while (function := self._todo.get()) is not None:
            results: list[T] = []
            error: BaseException | None = None
            # every exception belongs to the thread that waits for the result
            try:
                results.append(function())
            except BaseException as caught:
                error = caught
            self._done.put((results, error))
