"""A failure in real time is excused only if the computer could not keep the time."""

import itertools
from collections.abc import Sequence

import pytest

from tests import realtime
from tests.realtime import PROBES_AFTER_FAILURE, Probe, excuse_for_failure

GOOD, BUSY = Probe(0.1, 0.95), Probe(0.1, 0.4)


def measured(
    patch: pytest.MonkeyPatch,
    probes: Sequence[Probe],
    own_share: float = 0.0,
    taken_s: float = 0.0,
    lasted_s: float = 1.0,
) -> str:
    """Return the excuse after these probes, while the test's own programs use a part of a processor."""
    left = iter(probes)
    seconds = itertools.count()
    patch.setattr(realtime, "probe", lambda: next(left))
    patch.setattr(realtime.time, "monotonic", lambda: float(next(seconds)))
    used_s = itertools.count(step=own_share * 2 * PROBES_AFTER_FAILURE)
    patch.setattr(realtime, "programs_s", lambda: next(used_s))
    return excuse_for_failure(taken_s, lasted_s)


def test_failure_on_a_computer_that_is_always_busy_is_excused_with_figures(monkeypatch):
    assert "get 40 % of a processor" in measured(monkeypatch, [BUSY] * PROBES_AFTER_FAILURE)


def test_failure_is_one_if_the_computer_was_idle_once(monkeypatch):
    assert measured(monkeypatch, [*[BUSY] * (PROBES_AFTER_FAILURE - 1), GOOD]) == ""


def test_failure_is_one_if_the_test_s_own_programs_keep_the_computer_busy(monkeypatch):
    assert measured(monkeypatch, [BUSY] * PROBES_AFTER_FAILURE, own_share=1.0) == ""


def test_processor_time_that_the_host_took_during_the_test_is_an_excuse(monkeypatch):
    assert "took 0.05 s of processor time" in measured(monkeypatch, [GOOD], taken_s=0.05)
    assert measured(monkeypatch, [GOOD], taken_s=realtime.TAKEN_MIN_S / 2) == ""
    assert measured(monkeypatch, [GOOD], taken_s=0.05, lasted_s=10.0) == ""


def test_late_threads_alone_make_a_probe_bad():
    assert not Probe(realtime.LATE_MAX_MS * 1.1, 1.0).good
    assert GOOD.good
