"""Tests that every driver of an output that gives pulses must pass."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import pytest

from drivers.clock import Clock
from drivers.errors import DeviceError, DeviceFault, DeviceTimeout, LinkLost
from drivers.signals import TriggerOutput
from drivers.testing.common import Handle, assert_error_in_time, assert_says_all, needed, wait_until

Edge = tuple[float, bool]
_PULSES = 5


@dataclass(frozen=True)
class TriggerBench:
    """A newly opened trigger output, with functions that observe its line and cause faults.

    Attributes
    ----------
    trigger : TriggerOutput
    clock : Clock
        The clock of the run.
    edges : callable
        ``edges()`` returns all changes of the line since the device was opened, the oldest first: the time on
        `clock`, and True at the begin of a pulse.
    width_s : float
        Length of a pulse.
    tolerance_s : float
        Largest difference between the length of a pulse and `width_s`.
    reopen : callable, optional
        ``reopen()`` opens the device a second time while its line is in the state of a pulse, as a killed
        program leaves it.
    lose_answers, lose_one_answer, restore : callable, optional
        ``lose_answers()`` loses all answers of the device, ``lose_one_answer()`` only the next one.
        ``restore()`` restores normal operation.
    unplug : callable, optional
        ``unplug()`` disconnects the device.
    lose_writes : callable, optional
        ``lose_writes()`` makes the device confirm what it does not do.
    """

    trigger: TriggerOutput
    clock: Clock
    edges: Callable[[], Sequence[Edge]]
    width_s: float
    tolerance_s: float
    reopen: Callable[[], TriggerOutput] | None = None
    lose_answers: Handle | None = None
    lose_one_answer: Handle | None = None
    restore: Handle | None = None
    unplug: Handle | None = None
    lose_writes: Handle | None = None

    def assert_ends(self) -> None:
        """Wait until the line is at rest."""
        wait_until(lambda: not self.high, self.clock, within_s=60.0)
        # The driver may need a moment to see that the pulse has ended.
        self.clock.sleep(10 * self.width_s)

    def give(self) -> None:
        """Give a pulse and wait for its end."""
        self.trigger.pulse()
        self.assert_ends()

    @property
    def high(self) -> bool:
        """True during a pulse."""
        edges = self.edges()
        return bool(edges) and edges[-1][1]

    @property
    def begun(self) -> int:
        """Number of pulses that have begun."""
        return sum(high for _, high in self.edges())


class TriggerContract:
    """Tests of an output that gives pulses: inherit from this class and define a fixture `bench`.

    The fixture yields a `TriggerBench`, and closes the device after the test.
    """

    def test_tells_what_it_is(self, bench: TriggerBench) -> None:
        """Vendor and model are needed for the run file."""
        assert bench.trigger.info.vendor
        assert bench.trigger.info.model

    def test_opening_gives_no_pulse(self, bench: TriggerBench) -> None:
        """A pulse that nobody asked for would start or mark something in the other machine."""
        bench.clock.sleep(1.0)
        assert list(bench.edges()) == []

    def test_each_call_gives_one_pulse_of_the_right_length(self, bench: TriggerBench) -> None:
        """A pulse must have begun when the call returns, and must end by itself."""
        for number in range(1, _PULSES + 1):
            asked_s = bench.clock.now_s()
            bench.trigger.pulse()
            assert bench.begun == number
            bench.assert_ends()
            (begun_s, _), (ended_s, _) = bench.edges()[-2:]
            assert asked_s <= begun_s
            assert ended_s - begun_s == pytest.approx(bench.width_s, rel=0.0, abs=bench.tolerance_s)
        assert [high for _, high in bench.edges()] == _PULSES * [True, False]

    def test_two_pulses_are_never_one(self, bench: TriggerBench) -> None:
        """A pulse during a pulse must be refused, or begin after it."""
        given = 0
        refused: list[DeviceFault] = []
        for _ in range(2):
            try:
                bench.trigger.pulse()
                given += 1
            except DeviceFault as fault:
                assert_says_all(fault)
                refused.append(fault)
        bench.assert_ends()
        assert given + len(refused) == 2
        assert bench.begun == given >= 1

    def test_a_lost_answer_gives_no_second_pulse(self, bench: TriggerBench) -> None:
        """The driver must find out whether the pulse was given, and not give it twice."""
        needed(bench.lose_one_answer, "lose one answer")()
        try:
            bench.trigger.pulse()
        except DeviceError as error:
            assert_says_all(error)
        bench.assert_ends()
        assert bench.begun == 1

    def test_silence_is_told_in_time_and_overcome(self, bench: TriggerBench) -> None:
        """Without an answer, `pulse` must raise an error in time. Later it must work again."""
        lose, restore = needed(bench.lose_answers, "lose answers"), needed(bench.restore, "restore")
        lose()
        assert_error_in_time(bench.trigger.pulse, DeviceTimeout)
        restore()
        self._works_again(bench)

    def test_a_device_that_is_gone_gives_an_error(self, bench: TriggerBench) -> None:
        """If the cable is unplugged, `pulse` must raise an error; when it is back, `pulse` must work."""
        unplug, restore = needed(bench.unplug, "unplug"), needed(bench.restore, "restore")
        unplug()
        assert_error_in_time(bench.trigger.pulse, DeviceError)
        restore()
        self._works_again(bench)

    @staticmethod
    def _works_again(bench: TriggerBench) -> None:
        for _ in range(100):
            begun = bench.begun
            try:
                bench.give()
            except DeviceError:
                # the end of the pulse that failed may still be under way
                bench.clock.sleep(bench.width_s)
                continue
            assert bench.begun == begun + 1
            return
        pytest.fail("it never gave a pulse again")

    def test_a_pulse_that_was_not_given_is_an_error(self, bench: TriggerBench) -> None:
        """The driver must not trust a confirmation alone."""
        needed(bench.lose_writes, "confirm what it does not do")()
        with pytest.raises(DeviceError) as raised:
            bench.trigger.pulse()
        assert_says_all(raised.value)

    def test_closing_leaves_the_line_at_rest(self, bench: TriggerBench) -> None:
        """Closing must also end a pulse; closing twice is harmless. Later calls must raise `LinkLost`."""
        bench.trigger.pulse()
        bench.trigger.close()
        assert not bench.high
        assert bench.begun == 1
        bench.trigger.close()
        with pytest.raises(LinkLost) as lost:
            bench.trigger.pulse()
        assert_says_all(lost.value)
        assert bench.begun == 1

    def test_opening_ends_the_pulse_of_a_killed_program(self, bench: TriggerBench) -> None:
        """A program may end during a pulse. The next opening must put the line at rest."""
        again = needed(bench.reopen, "open a device whose line is in a pulse")()
        try:
            assert bench.begun == 1, "the line was never in the state of a pulse"
            assert not bench.high
        finally:
            again.close()
