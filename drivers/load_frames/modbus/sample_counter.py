"""Check with the machine's sample counter that a reading is new."""

WIDE = 2**32
GOES_ROUND_S = 10.0
"""Longest time in s between two readings after which a 16-bit counter still shows a restart of the machine.

A machine with 3000 samples per second counts about half of the 16-bit range in this time.
"""


class Freshness:
    """Check that the machine's sample counter increases from reading to reading.

    `stale_after_s` is the longest time, in seconds, for which the counter may have the same value. `modulus`
    is the number of values of the counter. After the largest value the counter continues at 0.
    """

    def __init__(self, stale_after_s: float, modulus: int) -> None:
        self._stale_after_s = stale_after_s
        self._modulus = modulus
        self._sample: int | None = None
        self._grown_s = 0.0
        self._checked_s = 0.0
        self._restarted = False

    def check(self, sample: int, now_s: float) -> None:
        """Compare the sample counter of a reading with the counter of the previous reading.

        Raise `ValueError` if the counter has the same value for too long, or has decreased. A decrease means
        that the machine was restarted. Every later check then fails too.
        """
        # While the operator attaches the grid, nothing is read, and a 16-bit counter can overflow.
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
