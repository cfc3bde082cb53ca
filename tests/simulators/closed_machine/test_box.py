"""The registers, contacts and outputs of the box at a closed machine."""

import struct

import pytest

from simulators.closed_machine.box import AnalogueBox
from simulators.closed_machine.modbus import AnalogueBoxServer
from tests.drivers.box import ByHand

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3


@pytest.fixture
def hand():
    hand = ByHand()
    hand.inputs = {"force": 2.5, "crosshead": -1.5, "extensometer": 10.5}
    hand.pulses, hand.high = 0x12345, True
    return hand


@pytest.fixture
def box(clock, hand):
    return AnalogueBox(clock, hand)


def words(box, function, first, count):
    answer = box.answer(struct.pack(">BHH", function, first, count))
    assert answer[:2] == bytes([function, 2 * count])
    return list(struct.unpack(f">{count}H", answer[2:]))


@pytest.mark.parametrize("function", [3, 4])
def test_voltages_stand_in_both_word_orders_and_as_counts(box, function):
    plain, swapped = words(box, function, 0, 6), words(box, function, 20, 6)
    assert struct.unpack(">3f", struct.pack(">6H", *plain)) == (2.5, -1.5, 10.5)
    assert [swapped[place ^ 1] for place in range(6)] == plain
    assert words(box, function, 40, 3) == [7500, 2**16 - 4500, 31_500]
    assert words(box, function, 60, 4) == [1, 0x2345, 0x2345, 1]


def test_contacts_tell_trigger_and_program(box, hand):
    assert box.answer(bytes([2, 0, 0, 0, 2])) == bytes([2, 1, 0b01])
    hand.high, hand.running = False, True
    assert box.answer(bytes([2, 0, 0, 0, 2])) == bytes([2, 1, 0b10])


def test_coils_are_switched_by_both_functions_and_their_edges_are_kept(box, clock):
    clock.sleep(1.0)
    assert box.answer(bytes([5, 0, 3, 0xFF, 0])) == bytes([5, 0, 3, 0xFF, 0])
    clock.sleep(1.0)
    assert box.answer(bytes([5, 0, 3, 0xFF, 0])) == bytes([5, 0, 3, 0xFF, 0])
    assert box.answer(bytes([15, 0, 2, 0, 3, 1, 0b101])) == bytes([15, 0, 2, 0, 3])
    assert box.answer(bytes([1, 0, 0, 0, 8])) == bytes([1, 1, 0b10100])
    assert box.edges == [(1.0, 3, True), (2.0, 2, True), (2.0, 3, False), (2.0, 4, True)]
    assert box.executed[0] == (1.0, "output 3 on")


def test_output_registers_are_written_by_both_functions(box):
    assert box.answer(struct.pack(">BHH", 6, 1000, 7)) == struct.pack(">BHH", 6, 1000, 7)
    many = struct.pack(">BHHB2H", 16, 1002, 2, 4, 8, 9)
    assert box.answer(many) == many[:5]
    assert words(box, 3, 1000, 4) == [7, 0, 8, 9]
    assert [(number, on) for _, number, on in box.edges] == [(1000, True), (1002, True), (1003, True)]


@pytest.mark.parametrize(
    ("request_hex", "code"),
    [
        ("04 0000 0007", ILLEGAL_ADDRESS),
        ("04 0005 0010", ILLEGAL_ADDRESS),
        ("04 0000 0000", ILLEGAL_ADDRESS),
        ("02 0001 0002", ILLEGAL_ADDRESS),
        ("05 0008 ff00", ILLEGAL_ADDRESS),
        ("05 0000 0001", ILLEGAL_VALUE),
        ("06 0000 0001", ILLEGAL_ADDRESS),
        ("10 03e8 0002 02 0001", ILLEGAL_VALUE),
        ("10 03eb 0002 04 0001 0002", ILLEGAL_ADDRESS),
        ("0f 0000 0009 01 ff", ILLEGAL_VALUE),
        ("0f 0000", ILLEGAL_VALUE),
        ("04 0000", ILLEGAL_VALUE),
        ("2b 0e01 00", ILLEGAL_FUNCTION),
    ],
)
def test_impossible_requests_are_refused(box, request_hex, code):
    request = bytes.fromhex(request_hex)
    assert box.answer(request) == bytes([request[0] | 0x80, code])
    assert box.edges == []


def test_faults_of_the_inputs_show_in_every_register(clock, hand):
    server = AnalogueBoxServer(AnalogueBox(clock, hand))
    try:
        server.faults.switch_on("broken-sensor")
        raw = struct.pack(">6H", *words(server.box, 4, 0, 6))
        assert struct.unpack(">3f", raw) == 3 * (-9999.0,)
        assert words(server.box, 4, 40, 3) == 3 * [0x8000]
        server.faults.clear()
        server.faults.switch_on("overflow")
        raw = struct.pack(">6H", *words(server.box, 4, 0, 6))
        assert struct.unpack(">3f", raw) == (10.5, -10.5, 10.5)
        server.faults.clear()
        assert words(server.box, 4, 40, 1) == [7500]
        assert words(server.box, 4, 60, 4) == [1, 0x2345, 0x2345, 1]
    finally:
        server.close()
