"""The echo of a two-wire adapter is dropped where it is declared, and named where it is not."""

from collections.abc import Iterator

import pytest

from drivers.errors import DeviceTimeout, LinkLost
from drivers.load_frames.modbus.bus.link import ModbusLink
from tests.drivers.load_frames.modbus.bus.slaves import LONG_S, SHORT_S, Slave, framed, linked


@pytest.fixture
def echoed(slave: Slave) -> Iterator[ModbusLink]:
    yield from linked(slave, LONG_S, echo=True)


@pytest.fixture
def hastily_echoed(slave: Slave) -> Iterator[ModbusLink]:
    yield from linked(slave, SHORT_S, echo=True)


def test_echo_that_is_declared_is_dropped(slave, echoed):
    slave.answer = lambda request: request + framed("01 04 02 000A")
    assert [echoed.read("input", 8, 1) for _ in range(3)] == [[10]] * 3
    # a write of one register is answered by the same bytes as its echo
    slave.answer = lambda request: request * 2
    echoed.write(1, [3], single=True)
    assert len(slave.requests) == 4


def test_write_whose_echo_alone_comes_back_is_no_answer(slave, hastily_echoed):
    slave.answer = lambda request: request
    with pytest.raises(DeviceTimeout):
        hastily_echoed.write(1, [3], single=True)


@pytest.mark.parametrize("answer", [framed("01 04 02 000A"), b""])
def test_echo_that_is_not_declared_is_named_with_the_setting(slave, hasty, answer):
    slave.answer = lambda request: request + answer
    with pytest.raises(DeviceTimeout, match="the adapter echoes, so set echo = true"):
        hasty.read("input", 8, 1)


def test_echo_that_comes_byte_by_byte_is_named_too(slave, hasty):
    """The beginning of a request can look like a whole, damaged answer: its third byte is no length."""
    slave.answer = lambda request: request[:-3]
    with pytest.raises(DeviceTimeout) as caught:
        hasty.read("input", 8, 1)
    assert "damaged frame" not in str(caught.value)


def test_missing_echo_is_named(slave, echoed):
    slave.answer = lambda request: framed("01 04 02 000A")
    with pytest.raises(LinkLost, match="no echo of the request, although `echo = true`"):
        echoed.read("input", 8, 1)
