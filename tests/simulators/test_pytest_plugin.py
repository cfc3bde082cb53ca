"""The plugin as somebody else's test suite meets it: by being installed."""

pytest_plugins = ["pytester"]

THEIR_TESTS = """
import socket

import pytest


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


@pytest.mark.virtual_rig(sed=1)
def test_a_rig_with_a_mistake(virtual_rig):
    pass
"""


def test_a_virtual_rig_for_other_peoples_tests(pytester):
    pytester.makepyfile(THEIR_TESTS)
    result = pytester.runpytest("--strict-markers", "-p", "no:cacheprovider")
    result.assert_outcomes(passed=2, errors=1)
    result.stdout.fnmatch_lines(["*sed*"])


def test_the_fixture_says_what_it_is(pytester):
    result = pytester.runpytest("--fixtures", "-p", "no:cacheprovider")
    assert result.ret == 0
    result.stdout.fnmatch_lines(["*virtual_rig*", "*addresses, clock, scene, faults*"])
