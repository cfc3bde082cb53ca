"""Call the listeners of a run; a listener that fails disturbs neither the run nor other listeners."""

from collections.abc import Callable, Iterable
from typing import Generic, TypeVar

T = TypeVar("T")


class Listeners(Generic[T]):
    """Callables that are told the same news, one after the other, on the engine's thread.

    A listener that raises is not called again, because its later output would lack the news that it missed.

    Parameters
    ----------
    listeners : iterable of callable
    """

    def __init__(self, listeners: Iterable[Callable[[T], None]]) -> None:
        self._listeners = list(listeners)

    def tell(self, news: T, *, ending: bool) -> list[str]:
        """Tell all listeners; return one sentence for each that raised.

        Parameters
        ----------
        news : T
        ending : bool
            Whether the run is ending; no exception may interrupt the safe state then. Otherwise
            `KeyboardInterrupt` and `SystemExit` are raised again, because they ask for the end of the run.
        """
        failures = []
        for listener in tuple(self._listeners):
            try:
                listener(news)
            except BaseException as error:
                if not (ending or isinstance(error, Exception)):
                    raise
                self._listeners.remove(listener)
                name = getattr(listener, "__qualname__", type(listener).__qualname__)
                failures.append(f"listener {name}: {type(error).__name__}: {error}; it is not called again")
        return failures
