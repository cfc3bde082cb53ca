"""Plan or run a protocol on a rig. The commands `rig plan` and `rig run` call these functions."""

from collections.abc import Callable, Iterable
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path

from drivers.errors import ConfigurationError
from rig.devices import Rig, require_interlocks
from rig.engine.devices import OnQuestion, unannounced
from rig.engine.engine import Engine
from rig.engine.signals import aborting_on_signals
from rig.engine.status import EngineStatus, Outcome
from rig.facts import confirm, facts_of_file, narrowed
from rig.garbage import short_searches
from rig.guardian.announced import guarded_rig
from rig.guardian.guardian import Guardian
from rig.guardian.machines import cautions
from rig.limits.run_limits import slowed
from rig.live.opening import open_live
from rig.live.signals import RECORDED, channels_record
from rig.live.values import LiveMeasurement
from rig.news.run_news import NewsOptions, RunNews
from rig.plan import Plan, make_plan, require_feasible
from rig.protocol.protocol import Protocol, live_table_of, read_protocol, read_protocol_text
from rig.recorder import Recorder, StepRecord
from rig.recorder.header import channel_records, interlock_records, make_header
from rig.recorder.room import make_room
from rig.resume import FinishedPart, read_earlier, require_same_folder, require_unchanged
from rig.rigfile import RigFile, read_rig

_NO_OPTIONS = NewsOptions()


@dataclass(frozen=True)
class _ReadFiles:
    """The protocol file and the rig file of a run. `definition` is the text of the protocol file."""

    protocol: Protocol
    definition: str
    rig_file: RigFile


def plan_protocol(protocol_path: str | Path, rig_path: str | Path | None = None) -> Plan:
    """Plan a protocol for a rig without opening any device.

    Parameters
    ----------
    protocol_path, rig_path : str or Path
        The protocol and the rig file. Without a rig file, the plan leaves out all values that depend on the
        rig.

    Raises
    ------
    ConfigurationError
        If one of the two files has mistakes. The message lists the mistakes of both files.
    """
    if rig_path is None:
        return make_plan(read_protocol(protocol_path))
    files = _read_both(protocol_path, rig_path)
    made = make_plan(files.protocol, facts_of_file(files.rig_file), files.rig_file.limits)
    mounting = files.protocol.mounting.over(files.rig_file.mounting)
    return replace(made, cautions=cautions(files.rig_file), mounting=mounting)


def run_protocol(
    protocol_path: str | Path,
    rig_path: str | Path,
    run_path: str | Path,
    *,
    on_status: Iterable[Callable[[EngineStatus], None]] = (),
    on_step: Iterable[Callable[[StepRecord], None]] = (),
    on_progress: Callable[[bool], None] = lambda _: None,
    on_question: OnQuestion = unannounced,
    continues: str | Path | None = None,
    news: NewsOptions = _NO_OPTIONS,
) -> Outcome:
    """Run a protocol on a rig. Write a run file, and beside it a file of events and a heartbeat file.

    Call this function from the main thread. A signal, such as SIGINT from Ctrl-C, aborts the run.

    Parameters
    ----------
    protocol_path, rig_path : str or Path
        The protocol and the rig file.
    run_path : str or Path
        The new run file. An existing file is refused, except that of a run which recorded nothing: see
        `rig.recorder.room.make_room`.
    on_status, on_step : iterable of callable, optional
        Listeners, as described for `Engine`.
    on_progress, on_question : callable, optional
        Functions as described for `Engine`.
    continues : str or Path, optional
        The file of an earlier run that ended early and is continued. The new run file must be in its folder.
    news : NewsOptions, optional
        Settings for message and HTTP interface that replace those in the table ``[news]`` of the rig file.

    Raises
    ------
    ConfigurationError
        If one of the two files has mistakes. The message lists the mistakes of both files.
    ProtocolError, ContinueError, RecordingError, DeviceError
        If the run cannot begin. No device has moved before such an error.
    """
    files, run_path = _read_both(protocol_path, rig_path), Path(run_path)
    earlier = None if continues is None else _read_earlier_run(Path(continues), files, run_path)
    protocol = files.protocol if earlier is None else earlier.protocol
    if aside := make_room(run_path):
        news.say(f"{run_path} is a run that recorded nothing; it is kept as {aside}")
    facts = facts_of_file(files.rig_file)
    require_feasible(make_plan(protocol, facts, files.rig_file.limits), run_path.parent)
    rig_file = slowed(narrowed(files.rig_file, protocol), protocol)
    log = run_path.with_suffix(".guardian.log")
    with RunNews(news.merged(files.rig_file.news), run_path, news.say) as told:
        with guarded_rig(rig_file, log) as (rig, guardian), ExitStack() as opened:
            require_feasible(make_plan(protocol, confirm(facts, rig), rig.limits), run_path.parent)
            require_interlocks(rig)
            continued = "" if earlier is None else _tell_continuing(earlier, protocol, rig, news)
            live = _open_live(protocol, files.rig_file, rig, opened)
            engine = Engine(
                _often_enough(protocol, files.rig_file, guardian),
                rig,
                _begin_recording(files, rig, run_path, told, continued),
                on_status=on_status,
                on_step=on_step,
                on_progress=_both(guardian.progress, on_progress),
                on_question=on_question,
                on_news=[told.add],
                earlier=None if earlier is None else earlier.readings,
            )
            if live is not None:
                engine.measure_gauges_with(live)
            told.connect(engine)
            news.on_begin(engine)
            with short_searches(), aborting_on_signals(engine), guardian.watched(engine.abort):
                outcome = engine.run()
            if not outcome.unsafe:
                guardian.done()
        # Take `lost_devices` only now, because a device may have hung while it was closed.
        return told.end(replace(outcome, lost_devices=rig.lost_devices))


def _read_earlier_run(path: Path, files: _ReadFiles, run_path: Path) -> FinishedPart:
    """Read the earlier run, and require that the new run file is in the same folder."""
    earlier = read_earlier(path, files.definition, files.rig_file.text)
    require_same_folder(earlier, run_path)
    return earlier


def _tell_continuing(earlier: FinishedPart, protocol: Protocol, rig: Rig, news: NewsOptions) -> str:
    """Require that the machine is where the earlier run left it. Return the JSON about the earlier run."""
    start = require_unchanged(earlier, protocol, rig)
    news.on_continue(earlier, start)
    return earlier.record(start)


def _begin_recording(files: _ReadFiles, rig: Rig, run_path: Path, told: RunNews, continued: str) -> Recorder:
    """Open the news files, then create the run file and write the rig's cautions into it."""
    header = make_header(files.protocol, files.definition, files.rig_file, rig, continued)
    told.begin(rig, header, files.protocol.kind)
    table = live_table_of(files.protocol)
    recorder = Recorder(
        run_path,
        header,
        {name: camera.info for name, camera in rig.cameras.items()},
        stage=None if rig.stage is None else rig.stage.info,
        load_frame=None if rig.load_frame is None else rig.load_frame.info,
        interlocks=interlock_records(rig),
        channels=channel_records(rig) | ({} if table is None else {RECORDED: channels_record(table)}),
        settings=files.rig_file.recording,
    )
    for caution in cautions(files.rig_file):
        recorder.event(rig.clock.now_s(), "warning", "rig", caution)
    return recorder


def _open_live(protocol: Protocol, rig_file: RigFile, rig: Rig, opened: ExitStack) -> LiveMeasurement | None:
    """Open the measurement of live gauges, which ends with `opened`; None without live gauges."""
    table = live_table_of(protocol)
    if table is None:
        return None
    signals = [signal.name for device in rig.channels.values() for signal in device.signals]
    if mistakes := table.mistakes(rig.cameras, signals):
        raise ConfigurationError(protocol.title, mistakes)
    live = open_live(
        table,
        {name: camera.info for name, camera in rig.cameras.items()},
        rig.clock,
        grid=protocol.grid,
        mounting=protocol.mounting.over(rig_file.mounting),
        thickness_mm=protocol.sample.thickness_mm,
    )
    return opened.enter_context(closing(live))


def _both(first: Callable[[bool], None], second: Callable[[bool], None]) -> Callable[[bool], None]:
    def call(moving: bool) -> None:
        first(moving)
        second(moving)

    return call


def _often_enough(protocol: Protocol, rig_file: RigFile, guardian: Guardian) -> Protocol:
    """Return the protocol with a `poll_s` so short that the guardian gets enough signs of progress."""
    if not guardian.relays:
        return protocol
    poll_s = min(protocol.settle.poll_s, rig_file.guardian.poll_max_s)
    settle = protocol.settle.model_copy(update={"poll_s": poll_s})
    return protocol.model_copy(update={"settle": settle})


def _read_both(protocol_path: str | Path, rig_path: str | Path) -> _ReadFiles:
    """Read the protocol and the rig file. Raise one `ConfigurationError` with the mistakes of both files."""
    try:
        protocol, definition = read_protocol_text(protocol_path)
    except ConfigurationError as error:
        try:
            read_rig(rig_path)
        except ConfigurationError as other:
            mistakes = [f"{e.source}: {mistake}" for e in (error, other) for mistake in e.mistakes]
            raise ConfigurationError(f"{protocol_path} and {rig_path}", mistakes) from other
        raise
    return _ReadFiles(protocol, definition, read_rig(rig_path))
