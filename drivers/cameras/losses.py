"""Which frames of a stream are missing: by the camera's counter, and by the time where that is not enough."""

from collections import deque
from dataclasses import dataclass, replace
from enum import Enum

from drivers.interfaces import Frame

IN_A_ROW = 8
"""So many frames must all come late before time says that some were not counted."""
DOUBTED = 128
"""For so many frames a later one that is on time takes this back; then a fast camera's clock could, too."""
OVERTAKEN = 64
"""A counter that goes back by less may be a frame that comes late; by more it began anew."""


class LossKind(Enum):
    """How it is known that frames are missing."""

    GAP = "the camera's counter jumped"
    PAUSE = "more time went by than the camera's counter says"
    REPEAT = "the camera's counter did not grow"
    DAMAGED = "frames with an error flag"
    OVERFLOW = "the program did not take its frames in time"


@dataclass(frozen=True)
class Loss:
    """Missing frames in a row.

    Attributes
    ----------
    kind : LossKind
    first : int
        Sequence number of the first one missing; for `LossKind.REPEAT` that of the frame at which it was
        noticed, for `LossKind.PAUSE` that of the first frame that came late, to within eight.
    count : int
        How many; 0 for a counter that did not grow, since the frame itself is there.
    time_s : float
        When it was noticed, on the rig's clock.
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
        From one frame to the next.
    """

    def __init__(self, interval_s: float) -> None:
        self._interval_s = interval_s
        self._last: Frame | None = None
        self._certain: list[Loss] = []
        # frames not counted, each with the delay before it
        self._pauses: list[tuple[Loss, float]] = []
        self._settled = 0
        self._delays: deque[tuple[int, float]] = deque(maxlen=2 * IN_A_ROW)

    def losses(self) -> tuple[Loss, ...]:
        """Return all losses in the order in which they were noticed."""
        pauses = [loss for loss, _ in self._pauses if loss.count]
        return tuple(sorted((*self._certain, *pauses), key=lambda loss: loss.time_s))

    def see(self, frame: Frame) -> bool:
        """Note what is missing before a frame; False for one that the next ones have overtaken.

        Such a frame's packets were sent again by a network camera. It was counted as missing, or came damaged
        before, and stays so: frames are delivered in order.
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
        """Note a loss at the time of a frame; overflows in a row are one."""
        last = self._certain[-1] if self._certain else None
        if last is not None and last.kind is kind is LossKind.OVERFLOW and last.first + last.count == first:
            self._certain[-1] = replace(last, count=last.count + count)
        else:
            self._certain.append(Loss(kind, first, count, frame.received_s))

    def _is_told(self, number: int) -> bool:
        return any(loss.first <= number < loss.first + loss.count for loss in self._certain)

    def _compare_time(self, frame: Frame, *, began_anew: bool) -> None:
        """Find frames that the camera did not count, by the time that the counter leaves unexplained.

        A frame may come late, but not early: the least delay of some frames in a row tells their true pace.
        If they all were late, a later one will show it.
        """
        delay_s = frame.exposed_s - frame.sequence * self._interval_s
        if began_anew:
            self._delays.clear()
        self._doubt(frame.sequence, delay_s)
        self._delays.append((frame.sequence, delay_s))
        if len(self._delays) < 2 * IN_A_ROW:
            return
        older, newer = list(self._delays)[:IN_A_ROW], list(self._delays)[IN_A_ROW:]
        # not the least: the number of one may be rounded up, by a camera that numbers by the time
        before_s = sorted(delay_s for _, delay_s in older)[1]
        after_s = min(delay_s for _, delay_s in newer)
        uncounted = round((after_s - before_s) / self._interval_s)
        if uncounted > 0:
            self._pauses.append((Loss(LossKind.PAUSE, newer[0][0], uncounted, frame.received_s), before_s))
            explained = [(number, delay_s + uncounted * self._interval_s) for number, delay_s in older]
            self._delays.extend(explained + newer)

    def _doubt(self, number: int, delay_s: float) -> None:
        """Take back what was said missing by its time, if a frame has come too early for that."""
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
