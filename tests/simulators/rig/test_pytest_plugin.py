"""Tests of the pytest plugin in a test suite outside of this project."""

import re
from typing import Any

from tests.places import DOCS

pytest_plugins = ["pytester"]

THEIR_TESTS = """
import socket

import pytest

addresses = []


def test_a_rig_on_simulated_time(virtual_rig):
    virtual_rig.stage.move_to(6400)
    virtual_rig.clock.sleep(10.0)
    assert virtual_rig.stage.angle_deg() == pytest.approx(1.0)
    host, port = virtual_rig.addresses["load_frame"].split(":")
    with socket.create_connection((host, int(port)), 10.0) as client:
        client.sendall(bytes.fromhex("0001 0000 0006 01 04 0000 0001"))
        assert client.recv(100)[-2:] == b"\\x00\\x01"
        virtual_rig.faults.switch_on("load_frame.exception:4")
        client.sendall(bytes.fromhex("0002 0000 0006 01 04 0000 0001"))
        assert client.recv(100)[-2:] == b"\\x84\\x04"


@pytest.mark.virtual_rig(real_time=True, load_frame_map="scaled-integers")
def test_a_rig_with_settings(virtual_rig):
    before_s = virtual_rig.clock.now_s()
    virtual_rig.clock.sleep(0.01)
    assert virtual_rig.clock.now_s() >= before_s + 0.01


def test_a_rig_is_gone_with_its_test(virtual_rig):
    addresses.append(virtual_rig.addresses["load_frame"])
    host, port = addresses[0].split(":")
    socket.create_connection((host, int(port)), 10.0).close()


def test_as_the_next_one_sees():
    host, port = addresses[0].split(":")
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection((host, int(port)), 10.0)


@pytest.mark.virtual_rig("generic")
def test_a_rig_with_a_setting_without_its_name(virtual_rig):
    pass


@pytest.mark.virtual_rig(sed=1)
def test_a_rig_with_a_mistake(virtual_rig):
    pass
"""


def test_a_virtual_rig_for_other_peoples_tests(pytester):
    pytester.makepyfile(THEIR_TESTS)
    result = pytester.runpytest("--strict-markers", "-p", "no:cacheprovider")
    result.assert_outcomes(passed=4, errors=2)
    result.stdout.fnmatch_lines(["*expected settings by name*", "*sed*"])


THEIR_PROGRAM = """
import os
import select


def my_program(address):
    if not address.startswith("/"):
        return stretch(address)
    line = os.open(address, os.O_RDWR | os.O_NOCTTY)
    try:
        os.write(line, b"/1 home\\n")
        if not select.select([line], [], [], 0.1)[0]:
            raise TimeoutError
    finally:
        os.close(line)


def stretch(address):
    from drivers.clock import SystemClock
    from drivers.interfaces import OpenContext
    from drivers.registry import find_driver

    spec, clock = find_driver("modbus-frame"), SystemClock()
    settings = spec.settings(
        address=address, map="separate-words", load_max_n=5000.0, displacement_max_mm=2.0
    )
    frame = spec.open(settings, OpenContext("load_frame", clock))
    frame.go_to_displacement(0.6, 1.0)
    while frame.read().moving:
        clock.sleep(0.02)
    frame.close()
"""


def test_the_examples_of_the_documentation_run(pytester, capsys):
    page = (DOCS / "simulators.md").read_text(encoding="utf-8")
    with_fixture, *alone = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert alone
    pytester.makepyfile(THEIR_PROGRAM + with_fixture)
    pytester.runpytest("--strict-markers", "-p", "no:cacheprovider").assert_outcomes(passed=2)
    capsys.readouterr()
    for example in alone:
        names: dict[str, Any] = {}
        exec(compile(example, "simulators.md", "exec"), names)
        assert capsys.readouterr().out.startswith("/")
        for server in names.values():
            if hasattr(server, "close") and not isinstance(server, type):
                server.close()


def test_the_fixture_says_what_it_is(pytester):
    result = pytester.runpytest("--fixtures", "-p", "no:cacheprovider")
    assert result.ret == 0
    result.stdout.fnmatch_lines(["*virtual_rig*", "*addresses, clock, scene, faults*"])
