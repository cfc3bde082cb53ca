"""Read protocols from TOML files."""

import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias

from pydantic import ValidationError

from drivers.errors import ConfigurationError
from drivers.settings import mistakes_in, read_toml_text
from rig.protocol.acquire import AcquireProtocol
from rig.protocol.base import KINDS
from rig.protocol.live_table import FOLDER, LiveTable
from rig.protocol.phased import PhasesProtocol
from rig.protocol.rotation import RotationProtocol
from rig.protocol.tension import TensionProtocol

Protocol: TypeAlias = TensionProtocol | RotationProtocol | PhasesProtocol | AcquireProtocol
_MODELS: dict[object, type[Protocol]] = dict(
    zip(KINDS, (TensionProtocol, RotationProtocol, PhasesProtocol, AcquireProtocol), strict=True)
)


def read_protocol(path: str | Path) -> Protocol:
    """Read a protocol from TOML.

    Raises
    ------
    ConfigurationError
        If the file cannot be read or has mistakes. The message lists all mistakes.
    """
    return read_protocol_text(path)[0]


def read_protocol_text(path: str | Path) -> tuple[Protocol, str]:
    """Return a protocol and the text of its file. Raise the same errors as `read_protocol`."""
    table, text = read_toml_text(Path(path))
    if "kind" not in table and ("rig" in table or "cameras" in table):
        raise ConfigurationError(str(path), ["expected a protocol, got a rig file; give it with --rig"])
    try:
        return parse_protocol(table, Path(path).parent), text
    except ValidationError as error:
        raise ConfigurationError(str(path), [_in_the_file(mistake) for mistake in mistakes_in(error)]) from (
            error
        )


def parse_protocol(table: dict[str, Any], folder: Path | None = None) -> Protocol:
    """Check the content of a protocol file. Raise pydantic's `ValidationError` with all mistakes.

    `folder` is that of the file. Without it, files that the protocol names are not read.
    """
    # If the kind is unknown, choose the model by the tables in the file, so that other mistakes are reported
    # too.
    kind = table.get("kind")
    if kind not in KINDS:
        kind = next((name for name in ("phases", "rotation", "acquire") if name in table), "tension")
    return _MODELS[kind].model_validate(table, context={FOLDER: folder})


def live_table_of(protocol: Protocol) -> LiveTable | None:
    """Return the table `[live]` of a protocol, None without one."""
    return protocol.live if isinstance(protocol, PhasesProtocol | AcquireProtocol) else None


def recorded_protocol(definition: str, kinds: Sequence[str]) -> Protocol:
    """Return the protocol of a run file from its text and the kinds of its finished steps.

    Runs of earlier versions have no still images, although their protocols do not leave them out. Raise
    `TOMLDecodeError`, `RecursionError` or pydantic's `ValidationError` for the text of another version.
    """
    table = tomllib.loads(definition)
    images = table.setdefault("images", {})
    if len(kinds) > 2 and "static" not in kinds and isinstance(images, dict):
        images["still"] = 0
    return parse_protocol(table)


def _in_the_file(mistake: str) -> str:
    """Name the phase that has a mistake by its number in the file, counted from 1, and by its key `do`."""
    mistake = re.sub(r"^phases\.(\d+)\.([a-z-]+)\.", lambda m: f"phase {int(m[1]) + 1} ({m[2]}): ", mistake)
    mistake = re.sub(r"^phases\.(\d+)(?=[.:])", lambda m: f"phase {int(m[1]) + 1}", mistake)
    return re.sub(r"^grid\.(lines|checkerboard|charuco|dots|asymmetric-dots)(?=[.:])", "grid", mistake)
