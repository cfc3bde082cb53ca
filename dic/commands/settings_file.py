"""The settings file: one strict TOML file with the settings of all commands that measure."""

import json
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import click

from dic import CorrelationSettings, Motion, ReferenceSettings, StrainSettings
from dic.calibration import GridAccuracy
from dic.commands.options import is_option_of
from dic.errors import CorrelationError, MeasurementError, joined
from dic.files import read_text
from dic.pipeline import SurfaceSettings
from dic.settings import Declared, declared_in
from dic.shell.output_paths import PATH

TABLES: dict[str, tuple[type, ...]] = {
    "correlation": (CorrelationSettings, ReferenceSettings),
    "strain": (StrainSettings,),
    "correction": (Motion, SurfaceSettings, GridAccuracy),
}
"""The classes whose settings each table of the file has, in the order in which `dic settings` writes them."""

KEYS = {"correction": {"kind": "motion"}}
"""Keys of the file that differ from the names of the settings, by table."""


@dataclass(frozen=True)
class Setting:
    """A setting of the settings file."""

    table: str
    key: str
    """The table and the key of the setting in the file."""
    kind: type
    """The class of settings."""
    name: str
    """Name of the setting in its class."""
    declared: Declared

    def refusal(self, value: Any) -> MeasurementError | None:
        """Return the error for a value in the file; None for a possible value."""
        try:
            self.kind(**{self.name: value})
        except MeasurementError as error:
            return error
        return None


SETTINGS = tuple(
    Setting(table, KEYS.get(table, {}).get(name, name), kind, name, declared)
    for table, kinds in TABLES.items()
    for kind in kinds
    for name, declared in declared_in(kind).items()
)
"""All settings."""


def read_settings(path: Path) -> dict[tuple[type, str], Any]:
    """Read a settings file; return the values by class of settings and name.

    Raises `CorrelationError` if the file cannot be read, or has unknown keys or values of a wrong type. The
    message names all mistakes together.
    """
    try:
        content = tomllib.loads(read_text(path))
    except FileNotFoundError as error:
        raise _refused(path, "no such file", "write one with `dic settings > settings.toml`") from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or " ".join(str(error).split())
        raise _refused(path, f"a file that cannot be read ({reason})", "correct it") from error
    errors = list(_errors(path, content))
    if errors:
        raise joined(errors)
    return {
        (setting.kind, setting.name): content[setting.table][setting.key]
        for setting in SETTINGS
        if setting.key in content.get(setting.table, {})
    }


def _errors(path: Path, content: dict[str, Any]) -> Iterator[MeasurementError]:
    known = {(setting.table, setting.key): setting for setting in SETTINGS}
    tables = {setting.table: None for setting in SETTINGS}
    for table, values in content.items():
        if table not in tables or not isinstance(values, dict):
            yield _unknown(path, f"[{table}]", table, [*tables], "the tables")
            continue
        for key, value in values.items():
            setting = known.get((table, key))
            if setting is None:
                keys = [own for of_table, own in known if of_table == table]
                yield _unknown(path, f"{table}.{key}", key, keys, f"the keys of [{table}]")
            elif (error := setting.refusal(value)) is not None:
                yield CorrelationError(str(path), f"{table}.{key}", error.expected, repr(value), error.remedy)


def _unknown(path: Path, place: str, name: str, names: list[str], what: str) -> MeasurementError:
    near = get_close_matches(name, names, 1)
    remedy = f"did you mean {near[0]}" if near else f"leave {place} out"
    return CorrelationError(str(path), place, f"one of {what}: {', '.join(names)}", name, remedy)


def _refused(path: Path, got: str, remedy: str) -> MeasurementError:
    return CorrelationError(str(path), "read settings", "a settings file, TOML", got, remedy)


_FILE = "dic.settings_file"
"""Key under which the context of a click command stores the path of the settings file."""


def _use(context: click.Context, _: click.Parameter, path: Path | None) -> Path | None:
    """Use the values of the file as defaults, so that options on the command line have priority."""
    if path is not None:
        values = read_settings(path)
        defaults = {
            parameter.name: value
            for parameter in context.command.params
            for (kind, name), value in values.items()
            if parameter.name is not None and is_option_of(parameter, kind, name)
        }
        context.default_map = {**(context.default_map or {}), **defaults}
        context.meta[_FILE] = path
    return path


def used_settings_file() -> Path | None:
    """Return the settings file that the running command uses."""
    found: Path | None = click.get_current_context().meta.get(_FILE)
    return found


settings_option = click.option(
    "--settings",
    "settings_file",
    type=PATH,
    is_eager=True,
    expose_value=False,
    callback=_use,
    help="Settings file, TOML, such as `dic settings` writes. The command line has priority.",
)
"""The option that reads a settings file before all other options."""


def toml_text(value: Any) -> str:
    """Return a value as text in TOML."""
    return json.dumps(list(value) if isinstance(value, tuple) else value, ensure_ascii=False)
