"""Tests of the number of threads, and of the division of rows into bands for the threads."""

import os
import threading

import numpy as np
import pytest

from dic.image.threads import balanced_bands, bands_of, in_parallel, limited_to, one_ahead, processors


def test_processors_are_those_that_the_program_may_use():
    allowed = os.sched_getaffinity(0)
    try:
        os.sched_setaffinity(0, {min(allowed)})
        assert processors() == 1
    finally:
        os.sched_setaffinity(0, allowed)
    assert processors() == len(allowed)


def test_processors_are_counted_where_the_system_cannot_limit_a_program(monkeypatch):
    monkeypatch.delattr(os, "sched_getaffinity")
    assert processors() == os.cpu_count()


@pytest.mark.parametrize("rows", [1, 63, 64, 65, 200])
def test_bands_cover_every_row_once(rows):
    covered = np.concatenate([np.arange(rows)[band] for band in bands_of(rows, 64)])
    np.testing.assert_array_equal(covered, np.arange(rows))


def test_even_bands_share_out_the_work_and_leave_no_row_with_work_out():
    weights = np.random.default_rng(3).integers(0, 50, 300)
    weights[100:180] = 0
    bands = balanced_bands(weights, 16)
    shares = [weights[band].sum() for band in bands]
    assert sum(shares) == weights.sum()
    assert len(bands) == 16
    assert max(shares) < weights.sum() / 16 + 2 * weights.max()


def test_no_work_needs_no_band():
    assert balanced_bands(np.zeros(20, np.int64), 4) == []
    assert balanced_bands(np.zeros(0, np.int64), 4) == []


def test_an_error_in_a_thread_is_seen():
    def fail(band):
        raise ValueError(band.start)

    with pytest.raises(ValueError, match="0"):
        in_parallel(fail, bands_of(200, 64), 3)


@pytest.mark.parametrize("limit", [1, 2])
def test_next_item_is_made_while_the_caller_works_only_with_a_second_processor(limit):
    made, asked = [], threading.Event()

    def items():
        for k in range(4):
            made.append((k, threading.get_ident()))
            if k == 1:
                asked.set()
            yield k

    with limited_to(limit):
        following = one_ahead(items())
        assert next(following) == 0
        if limit == 2 and processors() == 2:
            assert asked.wait(10.0)
        assert asked.is_set() == (processors() == 2)
        assert list(following) == [1, 2, 3]
        assert (made[0][1] == threading.get_ident()) == (processors() == 1)


def test_error_of_an_item_reaches_the_caller_after_the_items_before():
    def items():
        yield 0
        raise ValueError("second")

    following = one_ahead(items())
    assert next(following) == 0
    with pytest.raises(ValueError, match="second"):
        next(following)
