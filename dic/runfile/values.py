"""Read single values of a run file: its format, texts, numbers and JSON objects."""

import json
from pathlib import Path
from typing import Any

from dic.hdf5.version import require_version
from dic.runfile import schema
from dic.runfile.layout import Unlike


def read_scalars(group: Any, layout: schema.GroupLayout) -> dict[str, Any]:
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


def require_known(path: Path, file: Any) -> None:
    """Refuse an open run file of an unknown format, and name the program that wrote it."""
    written_by = read_text(file["entry"]["versions"]) if "entry/versions" in file else ""
    found = file.attrs["file_format_version"]
    require_version(path, "read run", "run", found, schema.VERSION, written_by)
