"""Check by the machine's sample counter that a reading is new."""

WIDE = 2**32
GOES_ROUND_S = 10.0
"""Longest time between readings in which a 16-bit counter still shows a restart: half a turn at 3 kHz."""


class Freshness:
    """Memory of a sample counter.

    Parameters
    ----------
    stale_after_s : float
        How long the counter may stand still.
    modulus : int
        The counter wraps to 0 at this value.
    """

    def __init__(self, stale_after_s: float, modulus: int) -> None:
        self._stale_after_s = stale_after_s
        self._modulus = modulus
        self._sample: int | None = None
        self._grown_s = 0.0
        self._checked_s = 0.0
        self._restarted = False

    def check(self, sample: int, now_s: float) -> None:
        """Compare a reading's counter with the last one.

        Raises
        ------
        ValueError
            If the counter stands still too long, or has gone back. After a step back, which means a restart
            of the machine, every later check fails.
        """
        # No readings while the operator works at the grid: a 16-bit counter can wrap in that time.
        unread = self._modulus < WIDE and now_s - self._checked_s > GOES_ROUND_S
        self._checked_s = now_s
        if self._sample is None or (unread and sample != self._sample and not self._restarted):
            self._sample, self._grown_s = sample, now_s
            return
        growth = (sample - self._sample) % self._modulus
        if self._restarted or growth > self._modulus // 2:
            self._restarted = True
            raise ValueError(f"a restarted machine (sample counter {sample} after {self._sample})")
        if growth > 0:
            self._sample, self._grown_s = sample, now_s
        elif now_s - self._grown_s > self._stale_after_s:
            raise ValueError(f"sample {sample} again after {now_s - self._grown_s:.3g} s")
