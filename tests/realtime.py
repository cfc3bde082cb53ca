"""Tests with the mark `realtime` run only if the computer can keep their deadlines. A plugin of pytest.

Such a test needs two processors' worth of computing at any moment, and threads that wake in time from short
sleeps. Before each of them a probe of less than 100 ms measures both.

- If no probe of a few seconds is good, the computer is too busy, and the test is skipped with the figures.
- If a test fails, ten more probes are made. Only if not one of the ten is good, and if the test's own threads
  and programs are not the reason, the test is skipped with its message and the figures. On an idle computer a
  failure is a failure.
- A virtual machine's host may take the processors for a moment that no probe meets, and Linux counts this
  time. A test that failed while it was taken is skipped in the same way.

The number of tests skipped in this way is printed at the end of a run.
"""

import hashlib
import os
import time
from collections.abc import Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

LATE_MAX_MS = 2.0
"""Nine of ten sleeping threads must wake within this time; the shortest tested deadline is 5 ms."""
SHARE_MIN = 0.8
"""Each of two threads must get this part of a processor: a deadline of 50 ms leaves no more to lose."""
SLEEPS = 20
SPIN_S = 0.05
PATIENCE_S = 3.0
"""Time to wait for a good probe, once in a run: a short job of the system may be over then."""
PROBES_AFTER_FAILURE = 10
OURS_MAX = 0.5
"""Part of a processor that the test's own threads and programs may use while a failure is excused."""
TAKEN_MIN_S, TAKEN_MIN = 0.02, 0.01
"""Processor time taken by the host that excuses a failure: two ticks, because one may be rounding, and
this part of the test's duration, because a little is taken at any time."""
REASON = "the computer is too busy for real time"

_tired = pytest.StashKey[bool]()


@dataclass(frozen=True)
class Probe:
    """How late a thread wakes from 1 ms of sleep, and the part of a processor that two threads got."""

    late_ms: float
    share: float
    used_s: float = 0.0
    """Processor time of the probe itself."""

    @property
    def good(self) -> bool:
        """True if the tests can keep their deadlines."""
        return self.late_ms <= LATE_MAX_MS and self.share >= SHARE_MIN

    def __str__(self) -> str:
        return (
            f"threads wake {self.late_ms:.1f} ms late and get {100 * self.share:.0f} % of a processor, "
            f"expected {LATE_MAX_MS:g} ms at most and {100 * SHARE_MIN:.0f} % at least"
        )


def probe() -> Probe:
    """Measure the computer for less than 100 ms if it is idle."""
    late_ms = []
    for _ in range(SLEEPS):
        before_s = time.perf_counter()
        time.sleep(0.001)
        late_ms.append(1000.0 * (time.perf_counter() - before_s) - 1.0)
    # one thread for each of two processors, or both for the only one
    count = min(2, len(os.sched_getaffinity(0)))
    with ThreadPoolExecutor(count) as pool:
        given = list(pool.map(_computed, range(count)))
    share = min(used_s / took_s for used_s, took_s in given)
    return Probe(sorted(late_ms)[int(0.9 * SLEEPS)], share, sum(used_s for used_s, _ in given))


def _computed(_: int) -> tuple[float, float]:
    """Compute for `SPIN_S`, without Python's lock; return the processor time for it, and the real time."""
    data = bytes(1 << 18)
    began_s, used_s = time.perf_counter(), time.thread_time()
    while time.perf_counter() < began_s + SPIN_S:
        hashlib.sha256(data).digest()
    return time.thread_time() - used_s, time.perf_counter() - began_s


def probes(most: int = 0, for_s: float = 0.0) -> Iterator[Probe]:
    """Yield a number of probes, or those of a time; at least one."""
    end_s = time.monotonic() + for_s
    made = 0
    while made == 0 or made < most or time.monotonic() < end_s:
        made += 1
        yield probe()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test with the mark `realtime` before its fixtures start programs if it is too busy."""
    if item.get_closest_marker("realtime"):
        patience_s = 0.3 if item.config.stash.get(_tired, False) else PATIENCE_S
        for found in probes(for_s=patience_s):
            if found.good:
                break
        else:
            item.config.stash[_tired] = True
            pytest.skip(f"{REASON}: {found}")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    if not item.get_closest_marker("realtime"):
        return (yield)
    begun_s, before_s = time.monotonic(), taken_by_host_s()
    try:
        return (yield)
    except (Exception, pytest.fail.Exception) as failure:
        taken_s, lasted_s = taken_by_host_s() - before_s, time.monotonic() - begun_s
        if excuse := excuse_for_failure(taken_s, lasted_s):
            pytest.skip(f"{REASON}: {excuse}; the test failed: {failure!r:.500}")
        raise


def taken_by_host_s() -> float:
    """Return the processor time in s that the host took from this virtual machine; 0 if there is none."""
    try:
        values = Path("/proc/stat").read_text().split("\n", 1)[0].split()
    except OSError:
        return 0.0
    return int(values[8]) / os.sysconf("SC_CLK_TCK") if len(values) > 8 else 0.0


def excuse_for_failure(taken_s: float, lasted_s: float) -> str:
    """Return the figures of a computer that could not keep the time; empty if a failure has no excuse.

    `taken_s`: processor time in s that the machine's host took during the test, which lasted `lasted_s`.
    """
    if taken_s >= max(TAKEN_MIN_S, TAKEN_MIN * lasted_s):
        return f"its host took {taken_s:.2f} s of processor time during the {lasted_s:.1f} s of the test"
    before_s, used_s = time.monotonic(), time.process_time() + programs_s()
    for found in probes(most=PROBES_AFTER_FAILURE):
        if found.good:
            return ""
        used_s += found.used_s
    ours = (time.process_time() + programs_s() - used_s) / (time.monotonic() - before_s)
    return "" if ours > OURS_MAX else str(found)


def programs_s() -> float:
    """Return the processor time in s of all living programs that this process or these programs started."""
    parents: dict[int, tuple[int, float]] = {}
    for folder in Path("/proc").glob("[0-9]*"):
        # a process may end meanwhile
        with suppress(OSError):
            values = (folder / "stat").read_text().rpartition(")")[2].split()
            parents[int(folder.name)] = int(values[1]), int(values[11]) + int(values[12])
    ours, found = {os.getpid()}, True
    while found:
        found = {pid for pid, (parent, _) in parents.items() if parent in ours} - ours
        ours |= found
    ticks = sum(parents[pid][1] for pid in ours - {os.getpid()} if pid in parents)
    return ticks / os.sysconf("SC_CLK_TCK")


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Print the number of skipped tests, which a log of many lines would hide."""
    skipped = [each for each in terminalreporter.stats.get("skipped", []) if REASON in str(each.longrepr)]
    if skipped:
        terminalreporter.section("real time")
        terminalreporter.write_line(f"{len(skipped)} tests of real time skipped: {REASON}", yellow=True)
