"""Read single values of a run file: its format, texts, numbers and JSON objects."""

import json
import re
from importlib.metadata import version
from pathlib import Path
from typing import Any

from dic.errors import RunFileError
from dic.runfile import schema
from dic.runfile.layout import Unlike

_WRITER = re.compile(r"\boffaxis [\w.+!]+")


def read_scalars(group: Any, layout: schema.Group) -> dict[str, Any]:
    """Return the single values of a group as a dict: texts as str, numbers as float."""
    return {
        item.name: float(group[item.name][()]) if item.text_bytes is None else read_text(group[item.name])
        for item in layout.items
        if item not in schema.LATER or item.name in group
    }


def read_object(text: str) -> dict[str, Any] | None:
    """Return a JSON object; None for an empty text."""
    if not text:
        return None
    found = json.loads(text)
    if not isinstance(found, dict):
        raise Unlike("an earlier run that is no JSON object")
    return found


def read_text(dataset: Any, place: int | tuple[()] = ()) -> str:
    """Return a text of fixed length, which is filled up with zeros in the file."""
    return str(bytes(dataset[place]).rstrip(b"\0").decode())


def require_version(path: Path, file: Any) -> None:
    """Raise an error if an open run file has a format that this program does not know.

    Raises
    ------
    RunFileError
        Names the version of offaxis that wrote the file.
    """
    found = file.attrs["file_format_version"]
    if found == schema.VERSION:
        return
    said = _WRITER.search(read_text(file["entry"]["versions"]) if "entry/versions" in file else "")
    writer = said[0] if said else "an unknown version of offaxis"
    raise RunFileError(
        str(path),
        "read run",
        f"format {schema.VERSION} of run files, which offaxis {version('offaxis')} reads",
        f"format {found}, written by {writer}",
        f"read it with {said[0] if said else 'that version'} or a newer one",
    )
