"""Plan or run a protocol on a rig. The commands `rig plan` and `rig run` call these functions."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from drivers.errors import ConfigurationError
from rig.devices import Rig, open_rig
from rig.engine.devices import OnQuestion, unannounced
from rig.engine.engine import Engine
from rig.engine.signals import aborting_on_signals
from rig.engine.status import Outcome, Status
from rig.facts import confirm, facts_of_file, narrowed
from rig.guardian.announced import announce
from rig.guardian.guardian import Guardian, guarded
from rig.guardian.lock import machines_locked
from rig.guardian.machines import cautions
from rig.limits.run_limits import slowed
from rig.news.run_news import NewsOptions, RunNews
from rig.plan import Plan, make_plan, require_feasible
from rig.protocol.protocol import Protocol, read_protocol, read_protocol_text
from rig.recorder import Recorder, RunHeader, StepRecord, run_file_exists
from rig.recorder.header import make_header
from rig.resume import read_earlier, require_same_folder, require_unchanged
from rig.rigfile import RigFile, read_rig
from rig.threads import Bounded

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
    return replace(made, cautions=cautions(files.rig_file))


def run_protocol(
    protocol_path: str | Path,
    rig_path: str | Path,
    run_path: str | Path,
    *,
    on_status: Iterable[Callable[[Status], None]] = (),
    on_step: Iterable[Callable[[StepRecord], None]] = (),
    on_progress: Callable[[bool], None] = lambda _: None,
    on_question: OnQuestion = unannounced,
    continues: str | Path | None = None,
    news: NewsOptions = _NO_OPTIONS,
) -> Outcome:
    """Run a protocol on a rig, write one run file, and beside it a file of events and a heartbeat file.

    Call this function from the main thread. A signal, such as SIGINT from Ctrl-C, aborts the run.

    Parameters
    ----------
    protocol_path, rig_path : str or Path
        The protocol and the rig file.
    run_path : str or Path
        The new run file. An existing file is refused.
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
    protocol = files.protocol
    if run_path.exists():
        raise run_file_exists(run_path)
    earlier = None
    if continues is not None:
        earlier = read_earlier(Path(continues), protocol, files.definition, files.rig_file.text)
        require_same_folder(earlier, run_path)
    facts = facts_of_file(files.rig_file)
    require_feasible(make_plan(protocol, facts, files.rig_file.limits), run_path.parent)
    rig_file = slowed(narrowed(files.rig_file, protocol), protocol)
    log = run_path.with_suffix(".guardian.log")
    with RunNews(news.merged(files.rig_file.news), run_path, news.say) as told:
        with (
            machines_locked(rig_file) as locks,
            guarded(rig_file, locks, log) as guardian,
            open_rig(rig_file, guardian.relays) as opened,
        ):
            rig = announce(opened, guardian)
            require_feasible(make_plan(protocol, confirm(facts, rig), rig.limits), run_path.parent)
            for name, interlock in rig.interlocks.items():
                first = Bounded(f"interlocks.{name}", "read", interlock.device.read)
                state = first.result(rig.call_timeout_s, "check the interlock and its cable")
                interlock.require_good(name, state, "before the start")
            continued = ""
            if earlier is not None:
                start = require_unchanged(earlier, protocol, rig)
                news.on_continue(earlier, start)
                continued = earlier.record(start)
            header = make_header(protocol, files.definition, files.rig_file, rig, continued)
            told.begin(rig, header, protocol.kind)
            recorder = _create_run_file(run_path, header, files.rig_file, rig)
            for caution in cautions(files.rig_file):
                recorder.event(rig.clock.now_s(), "warning", "rig", caution)

            def progress(moving: bool) -> None:
                guardian.progress(moving)
                on_progress(moving)

            engine = Engine(
                _often_enough(protocol, files.rig_file, guardian),
                rig,
                recorder,
                on_status=on_status,
                on_step=on_step,
                on_progress=progress,
                on_question=on_question,
                on_news=[told.add],
                earlier=None if earlier is None else earlier.readings,
            )
            told.connect(engine)
            with aborting_on_signals(engine), guardian.watched(engine.abort):
                outcome = engine.run()
            if not outcome.unsafe:
                guardian.done()
        # Closing the devices may have added lost devices.
        return told.end(replace(outcome, lost_devices=opened.lost_devices))


def _often_enough(protocol: Protocol, rig_file: RigFile, guardian: Guardian) -> Protocol:
    """Return the protocol with a `poll_s` so short that the guardian gets enough signs of progress."""
    if not guardian.relays:
        return protocol
    poll_s = min(protocol.settle.poll_s, rig_file.guardian.poll_max_s)
    settle = protocol.settle.model_copy(update={"poll_s": poll_s})
    return protocol.model_copy(update={"settle": settle})


def _read_both(protocol_path: str | Path, rig_path: str | Path) -> _ReadFiles:
    """Read the protocol and the rig file; raise one `ConfigurationError` with the mistakes of both files."""
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


def _create_run_file(run_path: Path, header: RunHeader, rig_file: RigFile, rig: Rig) -> Recorder:
    return Recorder(
        run_path,
        header,
        {name: camera.info for name, camera in rig.cameras.items()},
        stage=None if rig.stage is None else rig.stage.info,
        load_frame=None if rig.load_frame is None else rig.load_frame.info,
        settings=rig_file.recording,
    )
