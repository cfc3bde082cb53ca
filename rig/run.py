"""Make a plan or a run file from a protocol and a rig file: what `rig plan` and `rig run` do."""

import hashlib
import platform
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import h5py

from drivers.errors import ConfigurationError
from rig.devices import Rig, open_rig
from rig.engine.engine import Engine
from rig.engine.signals import aborting_on_signals
from rig.engine.status import Outcome, Status
from rig.facts import confirm, facts_of_file
from rig.plan import Plan, make_plan, require_feasible
from rig.protocol.protocol import Protocol, read_protocol, read_protocol_text
from rig.recorder import Recorder, RunHeader, StepRecord, run_file_exists
from rig.rigfile import RigFile, read_rig


@dataclass(frozen=True)
class _ReadFiles:
    """The two files of a run, each read once; `definition` is the text of the protocol's file."""

    protocol: Protocol
    definition: str
    rig_file: RigFile


def plan_protocol(protocol_path: str | Path, rig_path: str | Path | None = None) -> Plan:
    """Plan a protocol for a rig; nothing is opened.

    Parameters
    ----------
    protocol_path, rig_path : str or Path
        The protocol and the rig file. Without a rig file the plan holds only what is the same on every rig.

    Raises
    ------
    ConfigurationError
        If one of the two files has mistakes; those of both are listed.
    """
    if rig_path is None:
        return make_plan(read_protocol(protocol_path))
    files = _read_both(protocol_path, rig_path)
    return make_plan(files.protocol, facts_of_file(files.rig_file))


def run_protocol(
    protocol_path: str | Path,
    rig_path: str | Path,
    run_path: str | Path,
    *,
    on_status: Iterable[Callable[[Status], None]] = (),
    on_step: Iterable[Callable[[StepRecord], None]] = (),
) -> Outcome:
    """Run a protocol on a rig and write one run file; signals abort the run. Call it from the main thread.

    Parameters
    ----------
    protocol_path, rig_path : str or Path
        The protocol and the rig file.
    run_path : str or Path
        The run file; it must not exist.
    on_status, on_step : iterable of callable, optional
        As for `Engine`.

    Raises
    ------
    ConfigurationError
        If one of the two files has mistakes; those of both are listed.
    ProtocolError, RecordingError, DeviceError
        If the run cannot begin; no device has moved then.
    """
    files, run_path = _read_both(protocol_path, rig_path), Path(run_path)
    protocol = files.protocol
    if run_path.exists():
        raise run_file_exists(run_path)
    facts = facts_of_file(files.rig_file)
    require_feasible(make_plan(protocol, facts), run_path.parent)
    with open_rig(files.rig_file) as rig:
        require_feasible(make_plan(protocol, confirm(facts, rig)), run_path.parent)
        recorder = _create_run_file(run_path, files, rig)
        engine = Engine(protocol, rig, recorder, on_status=on_status, on_step=on_step)
        with aborting_on_signals(engine):
            return engine.run()


def _read_both(protocol_path: str | Path, rig_path: str | Path) -> _ReadFiles:
    """Read protocol and rig file; the mistakes of both are reported together as one `ConfigurationError`."""
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


def _create_run_file(run_path: Path, files: _ReadFiles, rig: Rig) -> Recorder:
    start = rig.clock.utc()
    definition, configuration = files.definition, files.rig_file.text
    digest = hashlib.sha256((definition + configuration).encode()).hexdigest()
    header = RunHeader(
        title=files.protocol.title,
        run_id=f"{start:%Y%m%dT%H%M%SZ}-{digest[:8]}",
        definition=definition,
        configuration=configuration,
        start=start,
        versions=_versions(),
        sample=files.protocol.sample,
        grid=files.protocol.grid,
        simulated=rig.simulated,
    )
    return Recorder(
        run_path,
        header,
        {name: camera.info for name, camera in rig.cameras.items()},
        stage=None if rig.stage is None else rig.stage.info,
        load_frame=None if rig.load_frame is None else rig.load_frame.info,
    )


def _versions() -> str:
    packages = {name: version(name) for name in ("offaxis", "numpy", "h5py", "pydantic")}
    programs = {"python": platform.python_version(), "hdf5": h5py.version.hdf5_version}
    return "\n".join(f"{name} {number}" for name, number in (packages | programs).items())
