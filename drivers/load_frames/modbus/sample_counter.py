"""Is a machine's reading new? Its own sample counter tells."""

WIDE = 2**32
GOES_ROUND_S = 10.0
"""How long a narrow counter may go unread and still tell a restart: 16 bits at 3 kHz are then half round."""


class Freshness:
    """Memory of a sample counter.

    Parameters
    ----------
    stale_after_s : float
        How long the counter may stand still.
    modulus : int
        Where the counter begins again at 0.
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
            If it has stood still too long, or has gone back: the machine was restarted, and stays suspect.
        """
        # While the operator is at the grid nobody reads, and a narrow counter goes round.
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
