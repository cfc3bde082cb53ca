"""Opening sets the machine's watchdog, and readings reset it. It holds the machine when readings stop."""

import re
from contextlib import closing

import pytest

from drivers.errors import DeviceFault
from drivers.load_frames.modbus.load_frame import SPEC, open_frame
from tests.drivers.load_frames.modbus.watched_port import Answer, is_command, settings


def test_a_watchdog_that_the_machine_does_not_take_is_refused(port, context):
    port.tamper = lambda request, answer: request[:5] if request[:3] == b"\x10\x00\x40" else answer()
    with pytest.raises(DeviceFault, match=r"set watchdog: expected timeout 2, got timeout 0 on reading back"):
        open_frame(settings(port.address), context)


def test_settings_that_somebody_else_has_changed_are_noticed_before_motion(frame, device, port):
    device.set_watchdog(0.0)
    with pytest.raises(DeviceFault, match="expected the watchdog this program has set, got another setting"):
        frame.go_to_displacement(1.0, 0.1)
    assert port.commands == []


def test_the_watchdog_holds_when_nobody_reads_while_moving(frame, device, clock):
    frame.go_to_displacement(5.0, 0.1)
    clock.sleep(10.0)
    state = frame.read()
    assert state.faults == ("watchdog",)
    assert state.holding
    # 2 s of silence at 0.1 mm/s, and one control period
    assert device.displacement_mm() == pytest.approx(0.2, abs=0.0021)
    frame.go_to_displacement(1.0, 0.1)
    assert frame.read().faults == ()


def test_reading_feeds_the_watchdog(frame, clock):
    frame.go_to_displacement(2.0, 0.1)
    for _ in range(15):
        clock.sleep(1.0)
        assert frame.read().moving
    assert frame.read().displacement_mm == pytest.approx(1.5, abs=0.0021)


def test_the_watchdog_is_fed_before_a_motion(frame, port):
    """Some count all the time: after a long pause such a machine would stop at once."""
    seen: list[str] = []

    def watch(request: bytes, answer: Answer) -> bytes | None:
        if request[:3] == b"\x10\x00\x42":
            seen.append("heartbeat")
        if is_command(request):
            seen.append("command")
        return answer()

    port.tamper = watch
    frame.go_to_displacement(0.1, 0.1)
    assert seen == ["heartbeat", "command"]


def test_a_link_says_what_it_was_used_for(frame, port):
    port.tamper = lambda request, answer: b"\x90\x04" if request[0] == 16 else answer()
    with pytest.raises(DeviceFault, match=r"feed the watchdog: write holding registers 66 to 66: .*failure"):
        frame.read()


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"watchdog_s": 0.0}, 'say why it is off with watchdog = "off: REASON" instead'),
        ({"watchdog_s": 0}, "watchdog_s = 0 would switch the watchdog off"),
        ({"watchdog": "off"}, '"off: REASON" is expected'),
        ({"watchdog": "off: "}, '"off: REASON" is expected'),
        ({"watchdog": "2.0"}, "a time belongs into watchdog_s"),
        ({"watchdog": "off: it trips", "watchdog_s": 2.0}, "remove watchdog_s or watchdog"),
    ],
)
def test_a_watchdog_is_switched_off_in_words_only(given, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        settings("10.0.0.8:502", **given)


def test_a_watchdog_that_is_off_is_written_so_and_is_a_caution(port, device, context):
    device.set_watchdog(3.0)
    off = settings(port.address, watchdog="off: the controller trips on every pause")
    with closing(open_frame(off, context)):
        assert device.watchdog_s == 0.0
    assert SPEC.cautions is not None
    (sentence,) = SPEC.cautions(off)
    assert "watchdog is off (the controller trips on every pause)" in sentence
    assert SPEC.cautions(settings(port.address)) == []
