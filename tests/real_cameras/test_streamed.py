"""The check of a kernel's counter and stamps: it passes series of a slow computer, and finds wrong ones."""

from collections.abc import Callable

import numpy as np
import pytest

from tests.real_cameras.streamed import assert_counter_keeps_time

RATE_HZ = 30.0
Series = tuple[np.ndarray, np.ndarray]


def filmed(busy: float) -> Series:
    """Every third frame as the kernel's camera counts and stamps it; `busy` is the share of late ones."""
    random = np.random.default_rng(5)
    due = np.arange(40.0) * 3
    drawn = due + random.uniform(0.0, 0.1, len(due))
    drawn += np.where(random.random(len(due)) < busy, random.uniform(0.0, 0.9, len(due)), 0.0)
    # counted when it is drawn, stamped a little later, and once much later
    stamped = drawn + random.uniform(0.0, 0.02, len(due))
    stamped[20] += 1.2
    return np.floor(drawn + 0.5).astype(int), stamped / RATE_HZ


def early(series: Series) -> None:
    series[1][10] -= 1 / RATE_HZ


def exchanged(series: Series) -> None:
    series[1][[10, 11]] = series[1][[11, 10]]


def off_from_the_middle(series: Series) -> None:
    series[0][20:] += 1


def neighbours(series: Series) -> None:
    """Each stamp is that of a neighbour."""
    series[1][:] = np.roll(series[1], 1)


def drifting(series: Series) -> None:
    series[1][:] *= 1.02


@pytest.mark.parametrize("busy", [0.0, 0.1, 0.6])
def test_late_frames_of_a_busy_computer_pass(busy: float) -> None:
    assert_counter_keeps_time(*filmed(busy), RATE_HZ)


@pytest.mark.parametrize("spoil", [early, exchanged, off_from_the_middle, neighbours, drifting])
@pytest.mark.parametrize("busy", [0.0, 0.1])
def test_wrong_numbers_and_stamps_are_found(spoil: Callable[[Series], None], busy: float) -> None:
    series = filmed(busy)
    spoil(series)
    with pytest.raises(AssertionError):
        assert_counter_keeps_time(*series, RATE_HZ)
