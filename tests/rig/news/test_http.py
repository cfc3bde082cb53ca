"""The HTTP interface gives the right answers, refuses foreign requests, and executes an abort at once."""

import json
import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from http.client import HTTPConnection
from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.interfaces import Frame
from rig.errors import ProtocolError
from rig.news.bulletin import Bulletin
from rig.news.http_api import STREAMS_MAX, RunControl, RunView
from rig.news.http_connections import CONNECTIONS_MAX, WAITING_MAX, BoundedConnection
from rig.news.http_server import TOKEN_VARIABLE, HttpPlace, HttpServer
from rig.news.thumbnail import thumbnail
from rig.news.wording import About

ABOUT = About("run-1", "/data/run.h5", "A test", "tension", True, ("left", "right"))


@dataclass
class Served:
    """A served run without an engine, which records the requested aborts."""

    place: HttpPlace
    bulletin: Bulletin
    aborts: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)
    """Requests for a pause, for going on, for images and their end, and answers."""
    refusal: str = ""
    drawing: threading.Event = field(default_factory=threading.Event)
    may_draw: threading.Event = field(default_factory=threading.Event)

    def control(self) -> RunControl:
        def note(what: str) -> str:
            self.asked.append(what)
            return self.refusal

        return RunControl(
            self.aborts.append,
            lambda reason: note(f"pause {reason}"),
            lambda: note("continue"),
            lambda word: note(f"answer {word}"),
            lambda: note("image"),
            lambda: note("end"),
        )

    def post(self, path: str) -> tuple[int, dict]:
        status, _, body = self.ask("POST", path, Authorization=f"Bearer {self.place.token}")
        return status, json.loads(body)

    def thumbnail(self, camera: str, width_px: int, kind: str) -> bytes | None:
        self.drawing.set()
        assert self.may_draw.wait(60.0)
        return None if camera == "right" else f"{camera} {width_px} {kind}".encode()

    def ask(self, method: str, path: str, **headers: str) -> tuple[int, dict[str, str], bytes]:
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        with closing(HTTPConnection("127.0.0.1", self.place.port, timeout=60.0)) as connection:
            connection.request(method, path, headers=named)
            answer = connection.getresponse()
            found = {name.lower(): value for name, value in answer.getheaders()}
            return answer.status, found, answer.read()

    def abort(self, **headers: str) -> int:
        token = f"Bearer {self.place.token}"
        return self.ask("POST", "/v1/abort", **{"Authorization": token, **headers})[0]

    def raw(self, text: str) -> socket.socket:
        """Send text to the interface, and return the connection without reading an answer."""
        line = socket.create_connection(("127.0.0.1", self.place.port), 60.0)
        line.sendall(text.replace("\n", "\r\n").encode())
        return line


@pytest.fixture
def served() -> Iterator[Served]:
    place, bulletin = HttpPlace(0), Bulletin(ABOUT)
    made = Served(place, bulletin)
    view = RunView(
        ABOUT,
        bulletin,
        lambda: {"state": "moving"},
        made.thumbnail,
        made.control(),
        place.token,
        place.port,
    )
    server = HttpServer(place, view)
    server.start()
    made.may_draw.set()
    yield made
    made.may_draw.set()
    bulletin.close()
    server.stop()
    assert not server._thread.is_alive()


def test_every_answer_has_the_version_and_says_that_the_run_is_simulated(served):
    for method, path, status in (
        ("GET", "/v1/", 200),
        ("GET", "/v1/status", 200),
        ("GET", "/v1/events?since=0", 200),
        ("GET", "/v1/nothing", 404),
        ("POST", "/v1/status", 405),
        ("POST", "/v1/abort", 401),
        ("POST", "/v1/pause", 401),
        ("GET", "/v1/pause", 405),
        ("GET", "/v1/image", 405),
        ("POST", "/v1/end", 401),
        ("GET", "/v1/cameras/right/thumbnail.png", 404),
    ):
        found, headers, body = served.ask(method, path)
        assert found == status, path
        assert headers["x-offaxis-simulated"] == "true"
        table = json.loads(body)
        assert (table["v"], table["run"], table["simulated"]) == (1, "run-1", True)
        assert (status < 400) == ("error" not in table)


def test_events_are_answered_from_a_number_on(served):
    for place in range(3):
        served.bulletin.add({"event": "log", "place": place})
    table = json.loads(served.ask("GET", "/v1/events?since=1")[2])
    assert ([event["place"] for event in table["events"]], table["last"]) == ([1, 2], 3)
    for wrong in ("since=-1", "since=x", "since=1&follow=maybe"):
        assert served.ask("GET", f"/v1/events?{wrong}")[0] == 400


def test_events_are_streamed_until_the_run_ends(served):
    served.bulletin.add({"event": "started"})
    with closing(HTTPConnection("127.0.0.1", served.place.port, timeout=60.0)) as connection:
        connection.request("GET", "/v1/events")
        stream = connection.getresponse()
        assert stream.getheader("content-type").startswith("application/x-ndjson")
        assert json.loads(stream.readline())["event"] == "started"
        served.bulletin.add({"event": "ended"})
        served.bulletin.close()
        assert json.loads(stream.readline())["event"] == "ended"
        assert stream.read() == b""


def test_an_abort_needs_the_token_and_may_be_repeated(served):
    assert served.ask("POST", "/v1/abort")[0] == 401
    assert served.abort(Authorization="Bearer no-such-token") == 401
    assert served.ask("GET", f"/v1/abort?token={served.place.token}")[0] == 405
    assert served.aborts == []
    assert served.abort() == 202
    path = "/v1/abort?reason=smoke%0Ain+the+room"
    assert served.ask("POST", path, Authorization=f"Bearer {served.place.token}")[0] == 202
    assert served.aborts == ["an abort by HTTP", "an abort by HTTP: smokein the room"]


def test_a_pause_going_on_and_an_answer_need_the_token_and_tell_why_they_are_refused(served):
    for place in ("pause", "continue", "answer?word=off", "image", "end"):
        assert served.ask("POST", f"/v1/{place}")[0] == 401
        assert served.ask("POST", f"/v1/{place}", Authorization="Bearer no-such-token")[0] == 401
        assert served.ask("POST", f"/v1/{place}", Origin="http://evil.example")[0] == 403
    assert served.asked == []
    assert served.post("/v1/pause?reason=the+lamp%0Aflickers")[0] == 202
    assert served.post("/v1/continue")[1]["state"] == "moving"
    assert served.post("/v1/answer?word=off")[0] == 202
    assert served.asked == ["pause the lampflickers", "continue", "answer off"]
    assert "expected the word of the question" in served.post("/v1/answer")[1]["error"]
    served.refusal = "the run is not paused"
    status, table = served.post("/v1/continue")
    assert (status, table["error"]) == (409, "the run is not paused")


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "evil.example:80"},
        {"Host": "127.0.0.1"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "http://localhost:1"},
        {"Sec_Fetch_Site": "cross-site"},
        {"Sec_Fetch_Site": "same-site"},
    ],
)
def test_pages_of_other_origins_are_refused_even_with_the_token(served, headers):
    assert served.abort(**headers) == 403
    assert served.aborts == []
    status, answered, _ = served.ask("GET", "/v1/status", **headers)
    assert status == 403
    assert "access-control-allow-origin" not in answered


def test_a_browser_is_not_allowed_to_send_the_token_from_another_page(served):
    """A browser asks with OPTIONS before it sends the header Authorization to another origin."""
    asked = {
        "Access_Control_Request_Method": "POST",
        "Access_Control_Request_Headers": "authorization",
    }
    for origin in ({}, {"Origin": "http://evil.example"}):
        status, headers, _ = served.ask("OPTIONS", "/v1/abort", **asked, **origin)
        assert status in (403, 405)
        assert not any(name.startswith("access-control") for name in headers)


def test_two_names_of_the_host_at_once_are_refused(served):
    text = f"GET /v1/status HTTP/1.1\nHost: localhost:{served.place.port}\nHost: evil.example\n\n"
    with closing(served.raw(text)) as line:
        assert line.recv(100).split()[1] in (b"400", b"403")


def test_the_interface_is_bound_to_this_computer_alone(served):
    assert served.place.socket.getsockname()[0] == "127.0.0.1"


def test_an_abort_is_behind_nothing(served):
    """Clients that do not read, half a request, a missing body and slow pictures do not delay an abort."""
    host = f"Host: 127.0.0.1:{served.place.port}"
    for place in range(3000):
        served.bulletin.add({"event": "log", "message": "x" * 500, "place": place})
    served.may_draw.clear()
    with ExitStack() as lines:
        for _ in range(STREAMS_MAX):
            lines.enter_context(closing(served.raw(f"GET /v1/events HTTP/1.1\n{host}\n\n")))
        for _ in range(20):
            lines.enter_context(closing(served.raw(f"GET /v1/status HTTP/1.1\n{host}\nX-Half: ")))
        for _ in range(4):
            lines.enter_context(
                closing(served.raw(f"GET /v1/cameras/left/thumbnail.png HTTP/1.1\n{host}\n\n"))
            )
        assert served.drawing.wait(60.0)
        token = f"Authorization: Bearer {served.place.token}"
        text = f"POST /v1/abort HTTP/1.1\n{host}\n{token}\nContent-Length: 1000000\n\n"
        aborting = lines.enter_context(closing(served.raw(text)))
        assert aborting.recv(1000).split()[1] == b"202"
        assert served.aborts == ["an abort by HTTP"]
        assert served.abort() == 202
        assert not served.may_draw.is_set()


def test_no_more_streams_than_a_few(served):
    host = f"Host: 127.0.0.1:{served.place.port}"
    with ExitStack() as lines:
        for _ in range(STREAMS_MAX):
            line = lines.enter_context(closing(served.raw(f"GET /v1/events HTTP/1.1\n{host}\n\n")))
            assert b"200" in line.recv(100)
            # The first event shows that the stream is being followed.
        served.bulletin.add({"event": "log"})
        assert served.ask("GET", "/v1/events")[0] == 503
        assert served.ask("GET", "/v1/events?since=0")[0] == 200


def test_thumbnails_are_served_by_name_and_width(served):
    status, headers, body = served.ask("GET", "/v1/cameras/left/thumbnail.jpg?width=100")
    assert (status, headers["content-type"], body) == (200, "image/jpeg", b"left 100 jpg")
    assert served.ask("GET", "/v1/cameras/left/thumbnail.png")[2] == b"left 320 png"
    for wrong in ("left/thumbnail.gif", "nobody/thumbnail.png", "..%2fleft/thumbnail.png"):
        assert served.ask("GET", f"/v1/cameras/{wrong}")[0] == 404


@pytest.mark.parametrize("kind", ["png", "jpg"])
@pytest.mark.parametrize("bits", [8, 12])
def test_a_thumbnail_is_small_and_marked_if_it_is_simulated(kind, bits):
    half = 1 << (bits - 1)
    image = np.full((600, 900), half, np.uint8 if bits == 8 else np.uint16)
    frame = Frame(image, 0.0, 0.0, datetime(2026, 1, 1, tzinfo=UTC), 1, 0, 1.0, 1.0)
    plain, marked = (
        cv2.imdecode(
            np.frombuffer(thumbnail(frame, bits, 300, kind, simulated=simulated), np.uint8),
            cv2.IMREAD_UNCHANGED,
        )
        for simulated in (False, True)
    )
    assert plain.shape == marked.shape == (200, 300)
    assert abs(float(plain.mean()) - 127.5) < 2.0
    assert plain.std() < 1.0
    assert marked[:40].max() > 240
    assert marked[:40].min() < 15
    assert abs(float(marked[60:].mean()) - 127.5) < 2.0


@pytest.mark.parametrize("shape", [(6, 8), (2000, 16), (16, 2000)])
def test_a_picture_of_any_shape_has_a_thumbnail(shape):
    frame = Frame(np.zeros(shape, np.uint8), 0.0, 0.0, datetime(2026, 1, 1, tzinfo=UTC), 1, 0, 1.0, 1.0)
    assert thumbnail(frame, 8, 320, "png", simulated=True).startswith(b"\x89PNG")


def test_a_port_in_use_is_refused_before_the_run(served):
    with pytest.raises(ProtocolError, match="name another port with --http, such as 0"):
        HttpPlace(served.place.port)


def test_a_token_may_come_from_the_environment(monkeypatch):
    monkeypatch.setenv(TOKEN_VARIABLE, "a-token-of-a-console")
    place = HttpPlace(0)
    place.close()
    assert place.token == "a-token-of-a-console"
    monkeypatch.setenv(TOKEN_VARIABLE, "short")
    with pytest.raises(ProtocolError, match="give a longer token"):
        HttpPlace(0)


def test_missing_libraries_are_named_with_the_command_that_installs_them(monkeypatch):
    monkeypatch.setattr("rig.news.http_server.find_spec", lambda name: None)
    with pytest.raises(ProtocolError, match=r"pip install 'offaxis\[http\]', or leave out --http"):
        HttpPlace(0)


def descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def test_half_requests_leave_descriptors_for_the_run_and_room_for_an_abort(served):
    before = descriptors()
    with ExitStack() as lines:
        for _ in range(3 * CONNECTIONS_MAX):
            lines.enter_context(closing(served.raw("GET /v1/status HTTP/1.1\nHost: ")))
        assert served.abort() == 202
        # both ends of each connection are in this process; the server's are bounded
        assert descriptors() - before <= 4 * CONNECTIONS_MAX + WAITING_MAX
    assert len(served.aborts) == 1


def test_half_a_request_is_closed_when_its_time_is_over(served, monkeypatch):
    monkeypatch.setattr(BoundedConnection, "request_s", 0.2)
    with closing(served.raw("GET /v1/status HTTP/1.1\nHost: ")) as line, suppress(ConnectionResetError):
        # the end of the connection, or its reset
        assert line.recv(1) == b""
