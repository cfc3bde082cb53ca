"""The driver's messages equal a recorded exchange of the vendor's client, byte for byte."""

import ast
import re
import socket
from pathlib import Path

import pytest

from drivers.lines.channel import open_channel
from drivers.stages.zaber.port import BAUD, ZaberPort
from drivers.stages.zaber.protocol import decode
from simulators.wire.tcp_server import TcpServer

# made by `record_zaber_motion`
LINES = (Path(__file__).parent / "data" / "zaber-motion.txt").read_text().splitlines()
MESSAGES = [ast.literal_eval(line[2:]) for line in LINES if line[0] in "<>"]
EXCHANGES = list(zip(MESSAGES[::2], MESSAGES[1::2], strict=True))
REQUEST = re.compile(rb"/(\d+) (\d+) (\d\d) ?(.*):[0-9A-F]{2}\n")


def test_the_conversation_is_one_of_questions_and_answers():
    assert [line[0] for line in LINES] == ["#", *"><" * (len(LINES) // 2)]
    assert len(EXCHANGES) > 20


@pytest.fixture
def replayed():
    """A port to a stage that knows only the recorded answers, and only for the recorded questions."""
    heard: list[bytes] = []

    def converse(connection: socket.socket) -> None:
        for question, answer in EXCHANGES:
            heard.append(connection.recv(300))
            if heard[-1] != question:
                return
            connection.sendall(answer)

    server = TcpServer(converse, "127.0.0.1", 0)
    port = ZaberPort("stage", open_channel(f"socket://{server.address}", BAUD, 5.0), 5.0)
    # the recorded client counts from 0
    port._next_id = 99
    yield port, heard
    port.close()
    server.close()


def test_we_say_what_the_vendors_client_says_and_understand_what_it_is_answered(replayed):
    port, heard = replayed
    for question, answer in EXCHANGES:
        match = REQUEST.fullmatch(question)
        assert match is not None
        address, axis, number = (int(match[i]) for i in (1, 2, 3))
        reply = port.ask(address, axis, match[4].decode())
        assert heard[-1] == question
        assert reply == decode(answer.rstrip())
        assert (reply.address, reply.axis, reply.id) == (address, axis, number)


def test_what_the_client_saw_as_refused_busy_and_warned_we_see_too():
    seen = {question: decode(answer.rstrip()) for question, answer in EXCHANGES}
    by_command = {REQUEST.fullmatch(question)[4]: reply for question, reply in seen.items() if reply}
    assert by_command[b"move abs 1000000000"].data == "BADDATA"
    assert not by_command[b"get no.such.setting"].accepted
    assert by_command[b"home"].busy
    assert by_command[b"home"].flag == "WR"
    assert by_command[b"stop"].flag == "NI"
