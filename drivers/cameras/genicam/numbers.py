"""Frame numbers that go on when the counter of a GigE Vision camera starts again."""

SHORT_COUNTER = 0xFFFF
"""Largest frame number of GigE Vision 1.x: the camera's frame counter has 16 bits and skips 0."""


class FrameNumbers:
    """Frame numbers that also increase when the camera's 16-bit counter starts again.

    If the camera's counter repeats or decreases, the frame number also repeats or decreases. The number of
    overflows is computed from the time between two frames.

    Parameters
    ----------
    interval_s : float
        Time between two frames, in seconds; infinite if it is not known. The counter is then taken to have
        started again at most once between two frames.
    """

    def __init__(self, interval_s: float) -> None:
        self._interval_s = interval_s
        self._last_id: int | None = None
        self._number = 0
        self._last_arrived_s = 0.0

    def number(self, id: int, arrived_s: float) -> int:
        """Return the number of a frame with the camera's number `id`, which arrived at `arrived_s`."""
        if self._last_id is None:
            self._number = id
        else:
            step = id - self._last_id
            if max(id, self._last_id) <= SHORT_COUNTER:
                by_time = (arrived_s - self._last_arrived_s) / self._interval_s
                step += SHORT_COUNTER * round((by_time - step) / SHORT_COUNTER)
            self._number += step
        self._last_id, self._last_arrived_s = id, arrived_s
        return self._number
