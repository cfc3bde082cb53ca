"""The command `dic settings`, which writes a settings file with every default explained."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import click

import dic
from dic.commands.options import is_option_of
from dic.commands.settings_file import SETTINGS, Setting, toml_text
from dic.errors import RunFileError
from dic.settings import default_of
from dic.shell.console import say
from dic.shell.output_paths import PATH

_WIDTH = 98
_USERS = ("correlate", "process", "strain")
_HEAD = """\
# Settings of a measurement: dic correlate, dic process, dic strain --settings FILE.
# Options on the command line win over this file. A key that is left out has its default.
"""


@click.command()
@click.argument("results", type=PATH, required=False)
def settings(results: Path | None) -> None:
    """Write a settings file with every default explained, to standard output.

    RESULTS is a result file of `dic correlate`, `dic process` or `dic strain`. With RESULTS, the settings
    file has the settings with which RESULTS was made. Use it as: dic settings > settings.toml
    """
    say(settings_text({} if results is None else settings_of(_job_of(results))))


def settings_text(values: Mapping[str, Any]) -> str:
    """Return a settings file as text: the given values by table and key, and defaults for all others.

    `values`: values by "table.key".
    """
    lines, table = [_HEAD.rstrip()], ""
    for setting in SETTINGS:
        if setting.table != table:
            table = setting.table
            lines.append(f"\n[{table}]")
        about = f"{setting.declared.sentence} Used by {', '.join(f'dic {name}' for name in _users(setting))}."
        lines += [f"# {line}" for line in textwrap.wrap(about, _WIDTH)]
        value = values.get(f"{table}.{setting.key}", default_of(setting.kind, setting.name))
        # Write a setting without a default as a comment.
        known = isinstance(value, str | int | float | list | tuple)
        text = toml_text(value) if known else setting.declared.example
        lines.append(f"{'' if known else '# '}{setting.key} = {text}")
    return "\n".join(lines)


def settings_of(job: dic.results.Job) -> dict[str, Any]:
    """Return the settings with which a result was computed, keyed by "table.key" of a settings file."""
    fields, strains = json.loads(job.fields), json.loads(job.strains)
    tables = {"correlation": fields, "strain": strains["strain"]}
    tables["correction"] = strains.get("correcting") or strains["motion"]
    if "kind" in tables["correction"]:
        tables["correction"]["motion"] = tables["correction"]["kind"]
    tables["correction"]["plate_mm"] = strains.get("plate_mm")
    found = {f"{each.table}.{each.key}": tables[each.table].get(each.key) for each in SETTINGS}
    return {name: value for name, value in found.items() if value is not None}


def _users(setting: Setting) -> list[str]:
    """Return the commands that have the option of a setting."""
    commands = {name: getattr(import_module(f"dic.commands.{name}"), name) for name in _USERS}
    return [
        name
        for name, command in commands.items()
        if any(is_option_of(parameter, setting.kind, setting.name) for parameter in command.params)
    ]


def _job_of(results: Path) -> dic.results.Job:
    load = dic.load_series_result if dic.pipeline.is_series_result(results) else dic.load_run_result
    origin = load(results).provenance
    if origin is None or origin.job is None:
        expected, got = "a result file with its settings", "one of an earlier version"
        raise RunFileError(str(results), "read settings", expected, got, "measure the images again")
    return origin.job
