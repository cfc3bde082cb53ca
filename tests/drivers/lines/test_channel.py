import os
import socket
import tty
from concurrent.futures import ThreadPoolExecutor

import pytest

from drivers.errors import LinkLost
from drivers.lines.channel import SerialChannel, TcpChannel, open_device
from simulators.wire.tcp_server import TcpServer


@pytest.fixture
def address():
    """The address of a server that accepts a connection and sends nothing."""
    server = TcpServer(lambda connection: connection.recv(1) and None, "127.0.0.1", 0)
    yield server.address
    server.close()


@pytest.mark.parametrize(
    "url", ["socket://a..b:1", f"socket://{'a' * 70}:1", "socket://:1", "socket://host:x"]
)
def test_what_is_no_address_is_told(url):
    with pytest.raises(LinkLost, match="stage: open port: expected a connection, got"):
        open_device("stage", url, 9600, 1.0)


@pytest.mark.parametrize("path", ["/dev/null", "/tmp", "", "/dev/ttyNone"])
def test_what_is_no_serial_port_is_told(path):
    with pytest.raises(LinkLost, match="stage: open port: expected a free serial port, got"):
        open_device("stage", path, 9600, 1.0)


def test_what_cannot_be_delivered_is_dropped_before_anybody_believes_the_device_stands(address):
    host, _, port = address.partition(":")
    channel = TcpChannel(host, int(port), 0.75)
    # milliseconds, tcp(7); a command is given up after three answers' time
    assert channel._socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == 1500
    channel.close()


def test_a_peer_that_never_falls_silent_is_no_device(address, monkeypatch):
    host, _, port = address.partition(":")
    channel = TcpChannel(host, int(port), 1.0)
    monkeypatch.setattr(channel, "receive", lambda deadline_s: b"x")
    with pytest.raises(ConnectionAbortedError, match="never stops sending"):
        channel.drain()
    channel.close()


def test_what_a_line_does_not_take_is_given_up_in_time():
    near, far = os.openpty()
    tty.setraw(far)
    channel = SerialChannel(os.ttyname(far), 9600, "N", 1, 0.1)
    with (
        ThreadPoolExecutor(1) as pool,
        pytest.raises(TimeoutError, match="a port that accepts no bytes for"),
    ):
        # more than any system keeps for a reader that does not come
        pool.submit(channel.send, bytes(2**20)).result(60.0)
    channel.close()
    os.close(near)
    os.close(far)


def test_what_has_left_is_sent_however_late():
    near, far = os.openpty()
    tty.setraw(far)
    channel = SerialChannel(os.ttyname(far), 9600, "N", 1, 1e-9)
    channel.send(b"stop")
    assert os.read(near, 10) == b"stop"
    channel.close()
    os.close(near)
    os.close(far)
