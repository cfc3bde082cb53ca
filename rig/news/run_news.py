"""All news of one run: the two files, the message at the end of the run, and the HTTP interface."""

import math
import socket
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Any

from drivers.clock import SystemClock
from drivers.interfaces import Frame
from rig.devices import Rig
from rig.engine.engine import Engine
from rig.engine.status import EngineStatus, LogEntry, News, Outcome, State
from rig.news import wording
from rig.news.bulletin import Bulletin
from rig.news.files import STALE_ENDING_S, STALE_S, EventFile, Heartbeat, events_path, heartbeat_path
from rig.news.http_server import TOKEN_VARIABLE, HttpPlace, HttpServer
from rig.news.images_now import ImagesNow
from rig.news.message import Messenger, message_of_end, split_command
from rig.news.wording import About
from rig.notifying import NewsSettings
from rig.protocol.step import RigReading
from rig.recorder import RunHeader, StepRecord

_NO_STATUS = EngineStatus(State.IDLE, None, 0, 0, None)
_NOT_YET = "the run has not begun"
IMAGES_EVERY_S = 1.0
"""Shortest real time in s between two events of steps of an acquisition."""
_FILES_S = 2.0
"""Real time in s for writing the last lines of each news file."""


@dataclass(frozen=True)
class NewsOptions:
    """Settings of the news of a run from the command line. A setting that is None is taken from the rig file.

    Attributes
    ----------
    notify : str or None
    http : int or None
        These settings are described for `NewsSettings`.
    say : callable
        Called with each line about the HTTP interface before the run begins.
    on_continue : callable
        Function that is called before a continued run moves anything, with the `Earlier` run and the present
        reading of the machine.
    on_begin : callable
        Function that is called with the engine before its run begins. With the engine, another thread can
        pause or abort the run.
    """

    notify: str | None = None
    http: int | None = None
    say: Callable[[str], None] = lambda _: None
    on_continue: Callable[[Any, RigReading], None] = lambda earlier, start: None
    on_begin: Callable[[Engine], None] = lambda engine: None

    def merged(self, settings: NewsSettings) -> NewsSettings:
        """Return the settings of the rig file, replaced by those options that are not None."""
        given = {"notify": self.notify, "http": self.http}
        return settings.model_copy(update={name: value for name, value in given.items() if value is not None})


class RunNews:
    """The news of one run, as a context manager. `add` is the engine's listener for all reports.

    The files of news are beside the run file. `say` is described for `NewsOptions`. Raise `ProtocolError` if
    the command of `notify` is not found, or the HTTP interface cannot be served, and `RecordingError` if a
    file of news cannot be written.
    """

    def __init__(self, settings: NewsSettings, run_path: Path, say: Callable[[str], None]) -> None:
        if settings.notify is not None:
            split_command(settings.notify)
        self._settings = settings
        self._run_path = run_path
        self._say = say
        self._place = None if settings.http is None else HttpPlace(settings.http)
        self._about: About | None = None
        self._events: EventFile | None = None
        self._shown: tuple[State, object] | None = None
        self._told_s = 0.0
        self._image_told_s = -math.inf
        self._abort_reason: str | None = None
        self._outcome: Outcome | None = None
        self._server: HttpServer | None = None
        self._messenger: Messenger | None = None
        self._engine: Engine | None = None
        self._bits: dict[str, int] = {}
        self._images: ImagesNow | None = None
        self._first_s = math.nan
        self._host = socket.gethostname()

    def __enter__(self) -> "RunNews":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        """End the news. After an exception, the run counts as failed."""
        if self._engine is not None and self._outcome is None:
            status = self._engine.status
            reason = "" if error is None else str(error) or type(error).__name__
            self.end(Outcome("failed", reason, status.steps_done))
        if self._engine is None:
            self._forget()
        if self._place is not None:
            self._place.close()

    def begin(self, rig: Rig, header: RunHeader, kind: str) -> None:
        """Open the news files and the HTTP interface. Call this method before the run file is created."""
        about = About(
            run_id=header.run_id,
            run_file=str(self._run_path.absolute()),
            title=header.title,
            kind=kind,
            simulated=header.simulated,
            cameras=tuple(rig.cameras),
        )
        self._bits = {name: camera.info.bits for name, camera in rig.cameras.items()}
        self._about = about
        self._bulletin = Bulletin(about)
        self._heartbeat = Heartbeat(heartbeat_path(self._run_path), self._heartbeat_table)
        self._events = EventFile(events_path(self._run_path), self._bulletin)
        if self._settings.notify is not None:
            self._messenger = Messenger(self._settings, about)
        if self._place is not None:
            self._serve(self._place, about)

    def connect(self, engine: Engine) -> None:
        """Begin to publish the news of a run of `engine`."""
        assert self._about is not None
        self._engine = engine
        self._images = ImagesNow(engine)
        if self._abort_reason is not None:
            engine.abort(self._abort_reason)
        self._told_s = SystemClock().now_s()
        self._bulletin.add(wording.started(self._about, engine.status.steps_planned))
        assert self._events is not None
        self._events.start()
        self._heartbeat.start()
        self._heartbeat.beat()

    def add(self, news: News) -> None:
        """Publish one report of the engine. The engine calls this method on a separate thread."""
        self._told_s = SystemClock().now_s()
        if isinstance(news, EngineStatus):
            if math.isnan(self._first_s) and news.reading is not None:
                self._first_s = news.reading.time_s
            self._heartbeat.beat()
            if (news.state, news.step) != self._shown:
                self._shown = (news.state, news.step)
                self._bulletin.add(wording.state_changed(news))
        elif isinstance(news, LogEntry):
            self._bulletin.add(wording.logged(news))
        elif news.step.kind != "acquired" or self._told_s - self._image_told_s >= IMAGES_EVERY_S:
            # An acquisition may have many images in a second, so tell only some of them.
            self._image_told_s = self._told_s if news.step.kind == "acquired" else self._image_told_s
            self._bulletin.add(wording.step_finished(news))
        if isinstance(news, StepRecord) and news.step.kind == "reference" and self._images is not None:
            self._images.keep_reference()

    def end(self, outcome: Outcome) -> Outcome:
        """Publish the end of the run. Return the outcome with a sentence for each failure in sending news."""
        assert self._about is not None
        assert self._engine is not None
        assert self._events is not None
        self._outcome = outcome
        self._bulletin.add(wording.ended(outcome))
        self._bulletin.close()
        self._heartbeat.end()
        failures = self._events.finish(_FILES_S) + self._heartbeat.finish(_FILES_S)
        if self._server is not None:
            self._server.stop()
        told = replace(outcome, lost_listeners=(*outcome.lost_listeners, *failures))
        if self._messenger is not None:
            planned = self._engine.status.steps_planned
            failures = self._messenger.send(message_of_end(self._about, told, planned))
            told = replace(told, lost_listeners=(*told.lost_listeners, *failures))
        return told

    def _forget(self) -> None:
        """Close everything that `begin` has opened, because no run has begun."""
        if self._server is not None:
            self._server.stop()
        if self._messenger is not None:
            self._messenger.cancel()
        if self._events is not None:
            self._events.close()

    def _serve(self, place: HttpPlace, about: About) -> None:
        # These imports are slow and stop all threads, so make them before the run and only if needed.
        from rig.news.http_api import RunControl, RunView
        from rig.news.thumbnail import Format, thumbnail

        def picture(camera: str, width_px: int, kind: Format) -> bytes | None:
            images: dict[str, Frame] = {} if self._engine is None else self._engine.newest_images
            frame = images.get(camera)
            if frame is None:
                return None
            return thumbnail(frame, self._bits[camera], width_px, kind, simulated=about.simulated)

        control = RunControl(
            self._abort, self._pause, self._go_on, self._answer, self._image, self._end_images
        )
        view = RunView(about, self._bulletin, self._status, picture, control, place.token, place.port)
        self._server = HttpServer(place, view)
        self._server.start()
        self._say(f"{about.mark}HTTP: {place.url}status")
        self._say(
            f"to abort: curl -X POST -H 'Authorization: Bearer {place.token}' {place.url}abort "
            f"(another token: {TOKEN_VARIABLE})"
        )

    def _status(self) -> dict[str, Any]:
        """Return the present status for the HTTP interface, from any thread."""
        return {
            **self._present(),
            "abort_requested": self._abort_reason,
            "age_s": round(SystemClock().now_s() - self._told_s, 3),
            "last_event": self._bulletin.last,
            "outcome": None if self._outcome is None else wording.ended(self._outcome),
        }

    def _present(self) -> dict[str, Any]:
        """Return what the heartbeat and the HTTP interface both tell, without taking time."""
        assert self._about is not None
        engine, images = self._engine, self._images
        status = _NO_STATUS if engine is None else engine.status
        ended = self._outcome is not None
        running_s = math.nan if status.reading is None else status.reading.time_s - self._first_s
        return {
            **wording.status_table(status),
            "title": self._about.title,
            "kind": self._about.kind,
            "run_file": self._about.run_file,
            "cameras": list(self._about.cameras),
            "images": {} if images is None else wording.images_table(images.latest),
            "running_s": wording.number(running_s),
            "waiting_for_operator": engine is not None and engine.waiting_for_operator,
            "question": None if engine is None else wording.question_table(engine.question),
            "pause_requested": engine is not None and engine.pause_requested,
            "stale_after_s": None if ended else STALE_ENDING_S if status.state.ending else STALE_S,
        }

    def _heartbeat_table(self) -> dict[str, Any]:
        assert self._images is not None
        assert self._about is not None
        outcome = self._outcome
        self._images.now(at_once=outcome is not None)
        return {
            **wording.head(self._about),
            **self._present(),
            "ended": outcome is not None,
            "status": None if outcome is None else outcome.status,
            "reason": None if outcome is None else outcome.reason,
            "host": self._host,
            "http": None if self._place is None else self._place.url,
        }

    def _abort(self, reason: str) -> None:
        self._abort_reason = self._abort_reason or reason
        if self._engine is not None:
            self._engine.abort(reason)

    def _pause(self, reason: str) -> str:
        by = "HTTP" + (f": {reason}" if reason else "")
        return _NOT_YET if self._engine is None else self._engine.pause(by)

    def _go_on(self) -> str:
        return _NOT_YET if self._engine is None else self._engine.go_on("HTTP")

    def _answer(self, word: str) -> str:
        return _NOT_YET if self._engine is None else self._engine.answer(word, "HTTP")

    def _image(self) -> str:
        return _NOT_YET if self._engine is None else self._engine.request_image()

    def _end_images(self) -> str:
        return _NOT_YET if self._engine is None else self._engine.request_end()
