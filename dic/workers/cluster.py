"""Workers of a Dask cluster, on this computer or on others."""

import logging
import pickle
import warnings
from collections.abc import Callable
from concurrent.futures import Future
from ipaddress import ip_address
from threading import Lock
from typing import Any

from dic.errors import MeasurementError, WorkerError, WorkerWarning
from dic.image.memory import keep_freed_memory
from dic.image.threads import limited_to
from dic.workers.workers import Given, Result, Workers

_WAIT_S = 20


def open_to_others(address: str) -> bool:
    """Return whether programs of other computers may use a scheduler that listens at this address.

    Dask's scheduler and workers run the pickled functions that they get. With TLS they take them only from
    holders of a certificate; "inproc" is within one process.
    """
    scheme, _, place = address.rpartition("://")
    if scheme not in ("", "tcp", "ws"):
        return False
    host = place.rpartition(":")[0].strip("[]")
    try:
        return not ip_address(host).is_loopback
    except ValueError:
        return host != "localhost"


class ClusterWorkers(Workers):
    """The workers of a Dask cluster. Each worker runs one function at a time, with all its threads.

    If a worker is lost, Dask gives its function to another worker.

    Parameters
    ----------
    address : str
        Address of the cluster's scheduler, such as "tcp://192.168.1.5:8786".

    Raises
    ------
    WorkerError
        If Dask is not installed, if no scheduler answers, or if the scheduler has no worker.
    """

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client
        except ImportError as error:
            remedy = "install it with pip install 'offaxis[cluster]'"
            raise WorkerError("--scheduler", "import", "the package distributed", "none", remedy) from error
        # Silence Dask's log, because errors are reported in one sentence.
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        try:
            with warnings.catch_warnings():
                # Ignore Dask's warnings about different Python versions: every task compares the versions
                # that matter.
                warnings.simplefilter("ignore")
                self._client = Client(address, timeout=_WAIT_S, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            remedy = "start one with `dask scheduler`, and give its address, such as tcp://localhost:8786"
            got = _one_line(error) or type(error).__name__
            raise WorkerError(address, "connect", "the scheduler of a Dask cluster", got, remedy) from error
        try:
            self._client.wait_for_workers(1, timeout=_WAIT_S)
        except TimeoutError as error:
            self._client.close()
            remedy = f"start workers with `dask worker {address}`"
            raise WorkerError(address, "find workers", "at least one worker", "none", remedy) from error
        listening = str(self._client.scheduler_info()["address"])
        if open_to_others(listening):
            warnings.warn(
                f"the scheduler at {listening} takes tasks from all who reach it, and its workers run "
                "them as their user; start it with --host 127.0.0.1, or with TLS if it needs other computers",
                WorkerWarning,
                stacklevel=2,
            )
        self._address, self._pool = address, self._client.get_executor(pure=False)
        self.count = len(self._client.ncores())

    def submit(
        self, fn: Callable[Given, Result], /, *args: Given.args, **kwargs: Given.kwargs
    ) -> Future[Result]:
        """Run a function on one of the workers; it and its arguments must be picklable."""
        # Give Dask bytes, because it would search other arguments for its own objects.
        task = pickle.dumps((fn, args, kwargs), protocol=5)
        try:
            begun = self._pool.submit(_run, task)
        except Exception as error:
            # Dask has no error class for a lost scheduler.
            raise _no_answer(self._address, f"{type(error).__name__}: {_one_line(error)}") from error
        return _Answer(begun, self._address)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Disconnect from the cluster, whose workers continue to work for other programs."""
        self._pool.shutdown(wait and not cancel_futures)
        self._client.close()


class _Answer(Future[Any]):
    """The answer to a task; errors of the cluster are reported in one sentence."""

    def __init__(self, begun: Future[Any], address: str) -> None:
        super().__init__()
        self._begun, self._address = begun, address
        begun.add_done_callback(self._take)

    def cancel(self) -> bool:
        """Withdraw the task, even if a worker has already begun it."""
        # Withdraw this answer first, because `_take` may run in another thread at the same time.
        withdrawn = super().cancel()
        self._begun.cancel()
        return withdrawn

    def _take(self, begun: Future[Any]) -> None:
        if not self.set_running_or_notify_cancel():
            return
        if begun.cancelled():
            # Nobody in this program has withdrawn the task.
            self.set_exception(_no_answer(self._address, "none, because the scheduler has ended"))
            return
        error = begun.exception()
        if error is None:
            self.set_result(begun.result())
        elif isinstance(error, MeasurementError):
            self.set_exception(error)
        else:
            got = f"{type(error).__name__}: {_one_line(error)}"
            remedy = "see the logs of the workers, and give the same command again to go on"
            self.set_exception(WorkerError(self._address, "correlate", _ANSWER, got, remedy))


_ANSWER = "an answer of a worker"


def _no_answer(address: str, got: str) -> WorkerError:
    remedy = "start the scheduler and its workers again, and give the same command to go on"
    return WorkerError(address, "correlate", _ANSWER, got, remedy)


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())


_alone = Lock()
"""Locked while a worker runs a function, because a function uses all threads of the worker."""


def _run(task: bytes) -> Any:
    """Run a pickled function with its arguments, on as many processors as the worker has threads."""
    from distributed import get_worker

    keep_freed_memory()
    with _alone, limited_to(get_worker().state.nthreads):
        function, arguments, named = pickle.loads(task)
        return function(*arguments, **named)
