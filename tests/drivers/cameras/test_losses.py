"""Tests of `LossAccount` with given frame numbers and frame times."""

from datetime import UTC, datetime

import numpy as np

from drivers.interfaces import Frame
from drivers.streams.losses import IN_A_ROW, Loss, LossAccount, LossKind

INTERVAL_S = 0.02
PICTURE = np.zeros((1, 1), np.uint8)
DATE = datetime(2026, 1, 1, tzinfo=UTC)


def frame(sequence: int, exposed_s: float) -> Frame:
    return Frame(PICTURE, exposed_s, exposed_s + INTERVAL_S, DATE, sequence, 0, 1000.0, 1.0)


def account(delays: list[float], first: int = 0) -> tuple[LossAccount, list[bool]]:
    """Return the account of frames without a gap in their numbers, each late by the given number of
    intervals."""
    losses = LossAccount(INTERVAL_S)
    numbers = range(first, first + len(delays))
    return losses, [
        losses.see(frame(number, (number + delay) * INTERVAL_S))
        for number, delay in zip(numbers, delays, strict=True)
    ]


def summed(losses: tuple[Loss, ...]) -> dict[LossKind, int]:
    return {kind: sum(loss.count for loss in losses if loss.kind is kind) for kind in LossKind}


def test_time_that_no_counter_explains_is_frames_that_were_not_counted():
    losses, _ = account([0.0] * 20 + [3.0] * 200)
    (loss,) = losses.losses()
    assert (loss.kind, loss.count) == (LossKind.PAUSE, 3)
    assert 20 <= loss.first < 20 + IN_A_ROW


def test_what_only_looked_lost_is_taken_back_however_slowly_the_frames_are_on_time_again():
    for way_back in ([0.0], [0.3, 0.0], [0.45, 0.3, 0.15, 0.0]):
        delays = [0.0] * 20 + [0.6] * 30
        for delay in way_back:
            delays += [delay] * 10
        losses, _ = account(delays)
        assert losses.losses() == ()


def test_of_what_looked_lost_so_much_is_taken_back_as_time_denies():
    losses, _ = account([0.0] * 20 + [3.7] * 30 + [3.0] * 10)
    assert summed(losses.losses())[LossKind.PAUSE] == 3
    losses, _ = account([0.0] * 20 + [1.0] * 20 + [2.7] * 20 + [2.0] * 20)
    assert summed(losses.losses())[LossKind.PAUSE] == 2


def test_a_camera_that_is_faster_than_it_says_hides_no_old_loss():
    drift = -0.001 * np.arange(2000)
    losses, _ = account(list(drift + np.where(np.arange(2000) < 100, 0.0, 1.0)))
    assert summed(losses.losses())[LossKind.PAUSE] == 1


def test_a_slow_camera_loses_nothing():
    losses, _ = account(list(0.001 * np.arange(3000)))
    assert losses.losses() == ()


def test_a_frame_that_later_ones_have_overtaken_is_dropped_once_it_was_told_missing():
    losses = LossAccount(INTERVAL_S)
    taken = [losses.see(frame(number, number * INTERVAL_S)) for number in (1, 2, 4, 5, 3, 6)]
    assert taken == [True, True, True, True, False, True]
    assert [(loss.kind, loss.first, loss.count) for loss in losses.losses()] == [(LossKind.GAP, 3, 1)]


def test_a_counter_that_begins_anew_costs_no_frame():
    for last in (10, 63, 64, 1000):
        losses = LossAccount(INTERVAL_S)
        numbers = [*range(last + 1), *range(40)]
        assert all(losses.see(frame(number, at * INTERVAL_S)) for at, number in enumerate(numbers))
        assert [(loss.kind, loss.count) for loss in losses.losses()] == [(LossKind.REPEAT, 0)]


def test_an_overtaken_frame_that_nobody_missed_is_told():
    losses = LossAccount(INTERVAL_S)
    taken = [losses.see(frame(number, number * INTERVAL_S)) for number in (1, 2, 3, 2, 4)]
    assert taken == [True, True, True, False, True]
    assert [(loss.kind, loss.first, loss.count) for loss in losses.losses()] == [(LossKind.REPEAT, 2, 0)]


def test_a_counter_that_begins_anew_takes_back_no_loss_of_before():
    losses, _ = account([0.0] * 100 + [2.0] * 60)
    for number in range(200):
        losses.see(frame(number, (170.0 + number) * INTERVAL_S))
    assert summed(losses.losses())[LossKind.PAUSE] == 2


def test_two_losses_by_time_are_denied_one_after_the_other():
    delays = [0.0] * 20 + [1.0] * 20 + [2.0] * 20
    assert summed(account(delays)[0].losses())[LossKind.PAUSE] == 2
    assert summed(account([*delays, 1.0])[0].losses())[LossKind.PAUSE] == 1
    assert summed(account([*delays, 1.2, 2.0])[0].losses())[LossKind.PAUSE] == 1
    assert account([*delays, 0.0])[0].losses() == ()
    # two of which each alone could be, but not both
    assert summed(account([0.0] * 20 + [0.6] * 20 + [1.2] * 20 + [1.15])[0].losses())[LossKind.PAUSE] == 1


def test_a_number_that_is_rounded_up_beside_late_frames_is_no_loss():
    # a camera that numbers by the time: one frame, late by 0.6, bears the next number
    delays = [0.2] * 20 + [-0.4] + [0.2, 0.3, 0.4] * 10
    assert account(delays)[0].losses() == ()
