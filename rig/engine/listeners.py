"""Telling a run's listeners what happens: any number of them, and none can hurt the run or another."""

from collections.abc import Callable, Iterable
from typing import Generic, TypeVar

T = TypeVar("T")


class Listeners(Generic[T]):
    """Callables that are told the same news, one after the other, on the engine's thread.

    A listener that raises is told no more: what it missed would be missing from all that it shows later.

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
            Whether the run is ending: then nothing may break into the safe state. Before, `KeyboardInterrupt`
            and `SystemExit` are raised again: somebody wants the run to end.
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
                failures.append(f"listener {name}: {type(error).__name__}: {error}; it is told no more")
        return failures
