"""The base class of all kinds of workers, and workers in this process."""

from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import AbstractContextManager
from typing import ParamSpec, TypeVar

from dic.image.threads import limited_to

Given = ParamSpec("Given")
Result = TypeVar("Result")


class Workers(Executor):
    """A Python executor that states how many functions it can run at the same time.

    At the end of a `with` block, functions whose results nobody has requested are cancelled.

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
    """Return a context manager within which this process uses only one processor."""
    return limited_to(1)
