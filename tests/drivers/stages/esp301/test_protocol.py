"""The driver understands the answers in the ESP301's manual, and refuses lines that are not answers."""

import pytest

from drivers.stages.esp301.protocol import (
    QueuedError,
    read_bits,
    read_error,
    read_name,
    read_number,
    read_switch,
)


def test_the_manuals_examples_of_answers_are_understood():
    assert read_error("0, 451322, NO ERROR DETECTED") == QueuedError(0, "NO ERROR DETECTED")
    assert str(read_error("108, 9512, MOTOR NOT CONNECTED")) == "error 108 (motor not connected)"
    assert (read_number("-0.0250"), read_number("1.5E-3"), read_switch("1")) == (-0.025, 0.0015, True)


@pytest.mark.parametrize("line", ["", "nan", "12,5", "0, NO ERROR", "ESP301 Version 3.0.1 6/1/99", "1 2"])
def test_what_is_no_answer_is_told(line):
    for read in (read_error, read_number, read_switch):
        with pytest.raises(ValueError, match="instead of"):
            read(line)


def test_errors_belong_to_the_controller_or_to_an_axis():
    assert QueuedError(4, "EMERGENCY STOP ACTIVATED").fails(1)
    assert QueuedError(106, "POSITIVE SOFTWARE LIMIT DETECTED").fails(1)
    assert not QueuedError(206, "POSITIVE SOFTWARE LIMIT DETECTED").fails(1)
    # noise on the line is no fault of the stage
    assert not QueuedError(6, "COMMAND DOES NOT EXIST").fails(1)


@pytest.mark.parametrize("number", [0, 2, 3, 4, 5, 8, 9, 18, 19, 20, 21, 22, 23, 29])
def test_errors_of_hardware_and_search_fail_the_motion(number):
    assert QueuedError(100 + number, "").fails(1)
    assert not QueuedError(100 + number, "").may_refuse(1)


@pytest.mark.parametrize("number", [1, 10, 11, 15, 30])
def test_errors_of_a_command_that_was_not_taken_fail_no_motion(number):
    assert not QueuedError(100 + number, "").fails(1)


def test_hexadecimal_settings_are_read_as_the_manual_writes_them():
    assert (read_bits("123H"), read_bits("0F25H"), read_bits("5")) == (0x123, 0xF25, 5)
    with pytest.raises(ValueError, match="instead of"):
        read_bits("5.0")


def test_the_version_is_no_stages_name():
    assert read_name("TS50DC.5, SN1263") == "TS50DC.5, SN1263"
    with pytest.raises(ValueError, match="instead of a stage's name"):
        read_name("ESP301 Version 3.0.1 6/1/99")
