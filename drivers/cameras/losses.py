"""Missing frames of a stream, from the camera's counter and, where that is not sufficient, from the time."""

from collections import deque
from dataclasses import dataclass, replace
from enum import Enum

from drivers.interfaces import Frame

IN_A_ROW = 8
"""Number of consecutive late frames that prove frames missing without a gap in the counter."""
DOUBTED = 128
"""An on-time frame withdraws a `PAUSE` loss only within this many frames; later, a fast clock could, too."""
OVERTAKEN = 64
"""A smaller step back of the counter may be a delayed frame; a larger step is a restart."""


class LossKind(Enum):
    """Evidence for missing frames."""

    GAP = "the camera's counter jumped"
    PAUSE = "more time went by than the camera's counter says"
    REPEAT = "the camera's counter did not grow"
    DAMAGED = "frames with an error flag"
    OVERFLOW = "the program did not take its frames in time"


@dataclass(frozen=True)
class Loss:
    """Consecutive missing frames.

    Attributes
    ----------
    kind : LossKind
    first : int
        Sequence number of the first missing frame; for `LossKind.REPEAT` that of the frame with the repeated
        number; for `LossKind.PAUSE` that of the first late frame, to within eight.
    count : int
        Number of missing frames; 0 if the counter did not increase, since the frame itself was received.
    time_s : float
        Time of detection, on the rig's clock.
    """

    kind: LossKind
    first: int
    count: int
    time_s: float


class LossAccount:
    """Compares every frame with those before it.

    Parameters
    ----------
    interval_s : float
        Time between frames.
    """

    def __init__(self, interval_s: float) -> None:
        self._interval_s = interval_s
        self._last: Frame | None = None
        self._certain: list[Loss] = []
        # losses that the counter does not show, each with the delay before the loss
        self._pauses: list[tuple[Loss, float]] = []
        self._settled = 0
        self._delays: deque[tuple[int, float]] = deque(maxlen=2 * IN_A_ROW)

    def losses(self) -> tuple[Loss, ...]:
        """Return all losses in the order of detection."""
        pauses = [loss for loss, _ in self._pauses if loss.count]
        return tuple(sorted((*self._certain, *pauses), key=lambda loss: loss.time_s))

    def see(self, frame: Frame) -> bool:
        """Record the frames missing before a frame; False for a frame that arrives after later frames.

        A network camera has sent the packets of such a frame again. The frame stays recorded as missing or
        damaged, because frames are delivered in order.
        """
        last = self._last
        if last is None:
            steps = 1
        else:
            steps = frame.sequence - last.sequence
            if -OVERTAKEN < steps < 0 and frame.exposed_s < last.exposed_s:
                if not self._is_told(frame.sequence):
                    self.add(LossKind.REPEAT, frame.sequence, 0, frame)
                return False
            if steps > 1:
                self.add(LossKind.GAP, last.sequence + 1, steps - 1, frame)
            elif steps < 1:
                self.add(LossKind.REPEAT, frame.sequence, 0, frame)
        self._last = frame
        self._compare_time(frame, began_anew=steps < 0)
        return True

    def add(self, kind: LossKind, first: int, count: int, frame: Frame) -> None:
        """Record a loss at the time of a frame; consecutive overflows are merged."""
        last = self._certain[-1] if self._certain else None
        if last is not None and last.kind is kind is LossKind.OVERFLOW and last.first + last.count == first:
            self._certain[-1] = replace(last, count=last.count + count)
        else:
            self._certain.append(Loss(kind, first, count, frame.received_s))

    def _is_told(self, number: int) -> bool:
        return any(loss.first <= number < loss.first + loss.count for loss in self._certain)

    def _compare_time(self, frame: Frame, *, began_anew: bool) -> None:
        """Find missing frames that the camera did not count, from the time that the counter does not explain.

        A frame can be late, but not early: the least delay of several consecutive frames is the true one. If
        all of them were late, a later frame corrects the loss.
        """
        delay_s = frame.exposed_s - frame.sequence * self._interval_s
        if began_anew:
            self._delays.clear()
        self._doubt(frame.sequence, delay_s)
        self._delays.append((frame.sequence, delay_s))
        if len(self._delays) < 2 * IN_A_ROW:
            return
        older, newer = list(self._delays)[:IN_A_ROW], list(self._delays)[IN_A_ROW:]
        # use the second least delay: a camera that derives numbers from time may have rounded one number up
        before_s = sorted(delay_s for _, delay_s in older)[1]
        after_s = min(delay_s for _, delay_s in newer)
        uncounted = round((after_s - before_s) / self._interval_s)
        if uncounted > 0:
            self._pauses.append((Loss(LossKind.PAUSE, newer[0][0], uncounted, frame.received_s), before_s))
            explained = [(number, delay_s + uncounted * self._interval_s) for number, delay_s in older]
            self._delays.extend(explained + newer)

    def _doubt(self, number: int, delay_s: float) -> None:
        """Reduce `PAUSE` losses if a frame arrives too early for them."""
        later = 0
        for index in range(len(self._pauses) - 1, self._settled - 1, -1):
            loss, before_s = self._pauses[index]
            if number - loss.first > DOUBTED:
                self._settled = index + 1
                return
            most = round((delay_s - before_s) / self._interval_s) - later
            loss = replace(loss, count=max(0, min(loss.count, most)))
            self._pauses[index] = loss, before_s
            later += loss.count
