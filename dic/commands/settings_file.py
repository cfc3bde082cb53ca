"""The settings file: one strict TOML file with the settings of all commands that measure."""

import json
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import click

from dic.errors import CorrelationError, MeasurementError, joined
from dic.files.reading import read_text


def _same(value: Any) -> Any:
    return value


def _hinge(value: Any) -> str:
    return ",".join(f"{number:g}" for number in value)


@dataclass(frozen=True)
class Setting:
    """A setting of the settings file, and the command-line option that has the same meaning.

    Attributes
    ----------
    table, key : str
        The table and the key of the setting in the file.
    parameter : str
        Name of the option's value in a command.
    kinds : tuple of type
        Types that the value may have in the file. The type list means a pair of numbers.
    example : str
        A value as text in TOML, for a setting without a default.
    to_option : callable
        Function that converts the value in the file to the value of the option.
    """

    table: str
    key: str
    parameter: str
    kinds: tuple[type, ...]
    example: str = ""
    to_option: Callable[[Any], Any] = _same

    @property
    def expected(self) -> str:
        """The allowed values in the file, as text."""
        names = {int: "a whole number", float: "a number", str: "text", list: "two numbers [X, Y]"}
        any_number = float in self.kinds
        return " or ".join(names[kind] for kind in self.kinds if not (any_number and kind is int))

    def allows(self, value: Any) -> bool:
        """Return True if a value in the file has the right type."""
        if isinstance(value, list):
            pair = len(value) == 2 and all(type(number) in (int, float) for number in value)
            return list in self.kinds and pair
        return type(value) in self.kinds


_NUMBER = (int, float)
SETTINGS = (
    Setting("correlation", "subset_px", "subset", (int,)),
    Setting("correlation", "step_px", "step", (int,)),
    Setting("correlation", "shape", "shape", (str,)),
    Setting("correlation", "order", "spline", (int,)),
    Setting("correlation", "min_zncc", "min_zncc", _NUMBER),
    Setting("correlation", "smoothing_px", "smoothing", (str, int, float), to_option=str),
    Setting("correlation", "incremental", "incremental", (str,)),
    Setting("strain", "measure", "strain_measure", (str,)),
    Setting("strain", "window_points", "strain_window", (int,)),
    Setting("strain", "source", "strain_from", (str,)),
    Setting("correction", "motion", "motion", (str,)),
    Setting("correction", "poisson_ratio", "poisson_ratio", _NUMBER),
    Setting("correction", "shift_std_um", "shift_std_um", _NUMBER, "30.0"),
    Setting("correction", "tilt_axis_mm", "hinge_text", (list,), "[0.0, -30.0]", _hinge),
    Setting("correction", "plate_mm", "plate_mm", _NUMBER, "1.0"),
)
"""All settings, in the order in which `dic settings` writes them."""


def read_settings(path: Path) -> dict[str, Any]:
    """Read a settings file; return the values of options by the options' names in commands.

    Raises
    ------
    CorrelationError
        If the file cannot be read, or has unknown keys or values of a wrong type. The message names all
        mistakes together.
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
        setting.parameter: setting.to_option(content[setting.table][setting.key])
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
            elif not setting.allows(value):
                remedy = f"see `dic settings` for {table}.{key}"
                yield CorrelationError(str(path), f"{table}.{key}", setting.expected, repr(value), remedy)


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
        context.default_map = {**(context.default_map or {}), **read_settings(path)}
        context.meta[_FILE] = path
    return path


def used_settings_file() -> Path | None:
    """Return the settings file that the running command uses."""
    found: Path | None = click.get_current_context().meta.get(_FILE)
    return found


settings_option = click.option(
    "--settings",
    "settings_file",
    type=click.Path(path_type=Path),
    is_eager=True,
    expose_value=False,
    callback=_use,
    help="Settings file, TOML, such as `dic settings` writes. The command line has priority.",
)
"""The option that reads a settings file before all other options."""


def toml_text(value: Any) -> str:
    """Return a value as text in TOML."""
    return json.dumps(list(value) if isinstance(value, tuple) else value, ensure_ascii=False)
