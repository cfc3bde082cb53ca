"""What all kinds of workers have in common."""

from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import AbstractContextManager
from typing import ParamSpec, TypeVar

from dic.image.threads import limited_to

Given = ParamSpec("Given")
Result = TypeVar("Result")


class Workers(Executor):
    """An executor that says how much it can do at the same time.

    At the end of a `with` block, results for which nobody has waited are given up.

    Attributes
    ----------
    count : int
        Number of functions that can run at the same time.
    """

    count: int

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.shutdown(wait=False, cancel_futures=True)


class ThreadWorker(Workers):
    """One thread of this process, so that this process can do something else at the same time."""

    count = 1

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1)

    def submit(
        self, fn: Callable[Given, Result], /, *args: Given.args, **kwargs: Given.kwargs
    ) -> Future[Result]:
        """Run a function in the thread."""
        return self._pool.submit(fn, *args, **kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the thread after the function that runs; see `concurrent.futures.Executor`."""
        self._pool.shutdown(wait, cancel_futures=cancel_futures)


def one_processor() -> AbstractContextManager[None]:
    """Within a `with` block, let this process use one processor only."""
    return limited_to(1)
