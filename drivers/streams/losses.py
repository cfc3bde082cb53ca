"""Find the missing frames of a stream, from the camera's frame counter and from the frame times."""

import math
from collections import deque
from dataclasses import dataclass, replace
from enum import Enum

from drivers.interfaces import Frame

IN_A_ROW = 8
"""This number of consecutive late frames proves a loss of frames, even if the frame counter has no gap."""
DOUBTED = 128
"""An early frame disproves a `PAUSE` loss only if it comes within this number of frames after the loss.

Later frames can look early merely because the clocks of camera and computer drift apart.
"""
OVERTAKEN = 64
"""Smallest decrease of the frame counter that means a restart; a smaller one means a delayed frame."""


class LossKind(Enum):
    """Kind of evidence by which missing frames were detected."""

    GAP = "the camera's counter jumped"
    PAUSE = "more time went by than the camera's counter says"
    REPEAT = "the camera's counter did not grow"
    DAMAGED = "frames with an error flag"
    OVERFLOW = "the program did not take its frames in time"


@dataclass(frozen=True)
class Loss:
    """A group of consecutive missing frames."""

    kind: LossKind
    # sequence number of the first missing frame. For `LossKind.REPEAT`: the repeated number. For
    # `LossKind.PAUSE`: the number of the first late frame, with an error of up to eight.
    first: int
    # number of missing frames. A `LossKind.REPEAT` has the count 0, because the frame itself was received.
    count: int
    time_s: float  # time at which the loss was detected, in seconds on the rig's clock


class LossAccount:
    """Record of the missing frames of a stream. Every new frame is compared with the earlier frames.

    `interval_s` is the time between two frames, in seconds. It is infinite for a camera whose frames are
    triggered; time then tells nothing about losses, but the camera's counter does.
    """

    def __init__(self, interval_s: float) -> None:
        self._interval_s = interval_s
        self._last: Frame | None = None
        self._certain: list[Loss] = []
        # each PAUSE loss, and the delay of the frames before this loss
        self._pauses: list[tuple[Loss, float]] = []
        self._settled = 0
        self._delays: deque[tuple[int, float]] = deque(maxlen=2 * IN_A_ROW)

    def losses(self) -> tuple[Loss, ...]:
        """Return all losses in the order of detection."""
        pauses = [loss for loss, _ in self._pauses if loss.count]
        return tuple(sorted((*self._certain, *pauses), key=lambda loss: loss.time_s))

    def see(self, frame: Frame) -> bool:
        """Record the frames that are missing before `frame`. Return False if `frame` is a delayed frame.

        A delayed frame arrives after a frame with a higher number, because a network camera sent lost packets
        again. Frames are delivered in order, so a delayed frame is not delivered and stays recorded as
        missing or damaged.
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
        if math.isfinite(self._interval_s):
            self._compare_time(frame, began_anew=steps < 0)
        return True

    def add(self, kind: LossKind, first: int, count: int, frame: Frame) -> None:
        """Record a loss at the time of `frame`. Consecutive losses of kind `OVERFLOW` become one loss."""
        last = self._certain[-1] if self._certain else None
        if last is not None and last.kind is kind is LossKind.OVERFLOW and last.first + last.count == first:
            self._certain[-1] = replace(last, count=last.count + count)
        else:
            self._certain.append(Loss(kind, first, count, frame.received_s))

    def _is_told(self, number: int) -> bool:
        return any(loss.first <= number < loss.first + loss.count for loss in self._certain)

    def _compare_time(self, frame: Frame, *, began_anew: bool) -> None:
        """Find missing frames that the camera's frame counter does not show, from frames that come too late.

        The delay of a frame is its start of exposure minus the frame number times the frame interval. A time
        stamp can be late, but not early. Therefore the smallest delay of eight consecutive frames counts as
        the true delay. If the computer was slow and all eight time stamps were late, frames seem to be
        missing although none is. A later frame that is on time shows this mistake, and `_doubt` then reduces
        the number of missing frames.
        """
        delay_s = frame.exposed_s - frame.sequence * self._interval_s
        if began_anew:
            self._delays.clear()
        self._doubt(frame.sequence, delay_s)
        self._delays.append((frame.sequence, delay_s))
        if len(self._delays) < 2 * IN_A_ROW:
            return
        older, newer = list(self._delays)[:IN_A_ROW], list(self._delays)[IN_A_ROW:]
        # use the second smallest delay, because a camera that computes frame numbers from time may round one
        # up
        before_s = sorted(delay_s for _, delay_s in older)[1]
        after_s = min(delay_s for _, delay_s in newer)
        uncounted = round((after_s - before_s) / self._interval_s)
        if uncounted > 0:
            self._pauses.append((Loss(LossKind.PAUSE, newer[0][0], uncounted, frame.received_s), before_s))
            explained = [(number, delay_s + uncounted * self._interval_s) for number, delay_s in older]
            self._delays.extend(explained + newer)

    def _doubt(self, number: int, delay_s: float) -> None:
        """Reduce the frame count of `PAUSE` losses if a later frame came too early for these counts."""
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
