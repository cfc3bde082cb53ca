"""Read and validate TOML files written by people. All mistakes in a file are reported together."""

import errno
import json
import re
import stat
import tomllib
import unicodedata
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError, field_validator

from drivers.errors import ConfigurationError


class Settings(BaseModel):
    """Base class of settings from TOML. Unknown keys, wrong types, NaN and infinity are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    @field_validator("*", mode="after")
    @classmethod
    def _without_control_characters(cls, value: Any) -> Any:
        # Refuse control characters: a null character would cut off the text in a run file, and a line break
        # would break the printed tables.
        if isinstance(value, str) and any(unicodedata.category(sign) == "Cc" for sign in value):
            raise ValueError("a text without control characters is expected")
        return value


_SHOWN_MAX = 80

LONGEST_PATH = 1000
"""Largest number of characters in an address or a path. The system allows 4096, too many for a person to
read."""

MOST_BYTES = 2**20
"""Largest accepted size of a TOML file in bytes. A usual protocol or rig file is a thousand times smaller."""


def read_toml(path: Path) -> dict[str, Any]:
    """Return the content of a TOML file.

    Raise `ConfigurationError` if the file is missing, unreadable or not valid TOML. For invalid TOML, the
    message gives line and column.
    """
    return read_toml_text(path)[0]


def read_toml_text(path: Path) -> tuple[dict[str, Any], str]:
    """Return the content of a TOML file, and its unchanged text. The errors are those of `read_toml`."""
    try:
        # Do not use `Path.read_text`: this function would convert all line ends to line feeds.
        text = _content(path).decode()
        if text.startswith("\ufeff"):
            raise ConfigurationError(str(path), ["has a byte order mark; save it as UTF-8 without one"])
        return tomllib.loads(text), text
    except OSError as error:
        raise ConfigurationError(str(path), [f"cannot be read: {error.strerror or error}"]) from error
    except UnicodeDecodeError as error:
        raise ConfigurationError(str(path), ["is not UTF-8 text; save it as UTF-8"]) from error
    except ValueError as error:
        # the text is not valid TOML, or a number has more digits than Python converts
        raise ConfigurationError(str(path), [f"is not valid TOML: {error}"]) from error
    except RecursionError as error:
        raise ConfigurationError(str(path), ["is nested too deeply to be read"]) from error


def _content(path: Path) -> bytes:
    """Return the content of a regular file. Refuse pipes and devices, because reading them may never end."""
    found = path.stat()
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, "Not a file, but a folder, a pipe or a device")
    if found.st_size > MOST_BYTES:
        raise OSError(errno.EFBIG, f"Larger than {MOST_BYTES} bytes")
    with path.open("rb") as file:
        return file.read(MOST_BYTES)


def toml_table(names: Sequence[str], table: Mapping[str, Any]) -> str:
    """Return a table as TOML text. Values may be texts, numbers, booleans, and lists or tables of these."""
    heading = ".".join(map(_toml_key, names))
    return "\n".join([f"[{heading}]", *(f"{_toml_key(k)} = {_toml_value(v)}" for k, v in table.items())])


def _toml_key(key: str) -> str:
    return key if re.fullmatch("[A-Za-z0-9_-]+", key) else _toml_value(key)


def _toml_value(value: object) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_toml_key(k)} = {_toml_value(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml_value, value)) + "]"
    # texts, numbers and booleans look the same in JSON and in TOML
    return json.dumps(value, ensure_ascii=False)


def mistakes_in(error: ValidationError, prefix: str = "") -> list[str]:
    """Return one sentence per pydantic error, with the place, the expected value and the actual value."""
    sentences = []
    for finding in error.errors(include_url=False):
        where = ".".join(str(part) for part in finding["loc"])
        where = ".".join(part for part in (prefix, where) if part) or "(top level)"
        if finding["type"] == "extra_forbidden":
            sentences.append(f"{where}: unknown key; remove it or correct its name")
        elif finding["type"] == "missing":
            sentences.append(f"{where}: is missing; add it")
        elif finding["type"] in ("model_type", "dict_type"):
            sentences.append(f"{where}: a table is expected, got {shown(finding['input'])}")
        else:
            message = finding["msg"].removeprefix("Value error, ")
            message = message[:1].lower() + message[1:]
            got = finding["input"]
            but = "" if isinstance(got, (dict, list)) else f", got {shown(got)}"
            sentences.append(f"{where}: {message}{but}")
    return sentences


def shown(value: object) -> str:
    """Return a value as text for an error message, on one line and cut off if it is long."""
    text = repr(value)
    return text if len(text) <= _SHOWN_MAX else f"{text[:_SHOWN_MAX]}…"
