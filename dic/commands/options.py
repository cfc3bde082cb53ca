"""Groups of options: each option is declared once, as a field of a class, and a command gets the whole group.

The fields of a group are declared with `option`. A class of settings (`dic.settings`) is a group, too: its
options are derived from what is declared of its settings.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import wraps
from pathlib import Path
from types import MappingProxyType
from typing import Any, Generic, TypeVar, cast, dataclass_transform, get_args, get_type_hints

import click
from click.core import ParameterSource

from dic.errors import CorrelationError, all_of as all_of
from dic.settings import Declared, declared_in, default_of
from dic.shell.console import say
from dic.shell.output_paths import PATH

Command = TypeVar("Command", bound=Callable[..., Any])
Settings = TypeVar("Settings")
_Class = TypeVar("_Class", bound=type)

_COMMON, _GROUP, _SETTING = "dic_common", "dic_group", "dic_setting"
"""Attributes of an option: whether `--help` lists it, the heading of its group, and the setting it gives."""


def option(*names: str, help: str, common: bool = False, default: Any = None, **further: Any) -> Any:
    """Declare an option as a field of a group.

    `*names`: names of the option, such as "-o", "--output". `help`: the help text. `common`: True if `--help`
    lists the option; `--help-all` lists all. `**further`: further arguments of `click.option`.
    """
    how = {"names": names, "help": help, "common": common, "default": default, **further}
    return field(metadata={"option": how})


@dataclass_transform(frozen_default=True)
def options(cls: _Class) -> _Class:
    """Make a class of `option` fields a group of options."""
    return cast(_Class, dataclass(frozen=True)(cls))


@dataclass(frozen=True)
class Chosen(Generic[Settings]):
    """The options of a class of settings that a command was given."""

    kind: type[Settings]
    """The class of settings."""
    values: Mapping[str, Any]
    """The values by the names of the settings; None without the option and without a default."""

    def settings(self, known: Settings | None = None, **further: Any) -> Settings:
        """Return the settings; a value that is not given comes from `known`, or is the default."""
        given = {name: value for name, value in self.values.items() if value not in (None, ())} | further
        return self.kind(**given) if known is None else replace(cast(Any, known), **given)


def use(
    argument: str,
    kind: type,
    *,
    title: str = "",
    needs: Mapping[str, Sequence[str]] | None = None,
    only: Sequence[str] = (),
    prefix: str = "",
    common: Sequence[str] = (),
    named: Mapping[str, str] = MappingProxyType({}),
    defaults: Mapping[str, Any] = MappingProxyType({}),
) -> Callable[[Command], Command]:
    """Return a decorator that adds a group of options to a command and passes their values as one argument.

    `argument`: name of the argument. For a class of settings it is a `Chosen`. `kind`: a class that `options`
    or `settings_class` has made. `title`: heading of the group in the help text. `needs`: maps an option,
    such as ``"--decimal-comma"``, to other options of which it needs at least one. If the option is given
    without any of these, the command raises an error. `only`: names of the settings that become options.
    Default: all. `prefix`: text at the beginning of the options of a class of settings, such as "map-".
    `common`: names of the settings that `--help` lists. `named`, `defaults`: other names of options and other
    defaults, for this command, by the names of the settings.
    """
    declared = declared_in(kind) if hasattr(kind, "__pydantic_fields__") else None
    if declared is None:
        made = {each.name: _of_field(argument, kind, each) for each in fields(kind)}
    else:
        names = [name for name in declared if not only or name in only]
        made = {
            name: _of_setting(
                f"{argument}_{name}",
                named.get(name, f"--{prefix}{_option_name(name, declared[name])}"),
                declared[name],
                defaults.get(name, default_of(kind, name)),
                pair=_is_pair(get_type_hints(kind)[name]),
                common=name in common,
            )
            for name in names
        }
    of_group = title or argument.replace("_", " ").capitalize()

    def add(command: Command) -> Command:
        @wraps(command)
        def called(*arguments: Any, **values: Any) -> Any:
            _require_effect(needs or {})
            own = {name: values.pop(f"{argument}_{name}") for name in made}
            values[argument] = kind(**own) if declared is None else Chosen(kind, own)
            return command(*arguments, **values)

        decorated: Any = called
        for name, add_option in reversed(made.items()):
            decorated = add_option(decorated)
            setattr(decorated.__click_params__[-1], _GROUP, of_group)
            setattr(decorated.__click_params__[-1], _SETTING, (kind, name))
        return cast(Command, decorated)

    return add


def telling(**texts: str) -> Callable[[Command], Command]:
    """Return a decorator that puts texts, such as the names of a registry, into a command's help text."""

    def add(command: Command) -> Command:
        command.__doc__ = (command.__doc__ or "").format(**texts)
        return command

    return add


class Grouped(click.Command):
    """A command whose `--help` lists the options that most people need; `--help-all` lists all in groups."""

    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__(*given, **named)
        sentence = "Show all options, in groups."
        self.params.append(
            click.Option(
                ["--help-all"],
                is_flag=True,
                is_eager=True,
                expose_value=False,
                callback=_print_all,
                help=sentence,
            )
        )

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options below the headings of their groups."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            record, every = parameter.get_help_record(ctx), ctx.meta.get(_ALL, False)
            group = getattr(parameter, _GROUP, "Other")
            of_help = not {"--help", "--help-all"}.isdisjoint(parameter.opts)
            if isinstance(parameter, click.Argument):
                continue
            if record is not None and (every or of_help or getattr(parameter, _COMMON, False)):
                groups.setdefault("Help" if of_help else group, []).append(record)
        for heading, records in groups.items():
            with formatter.section(heading):
                formatter.write_dl(records)


_ALL = "dic.help_all"


def _print_all(context: click.Context, _: click.Parameter, asked: bool) -> None:
    if asked:
        context.meta[_ALL] = True
        say(context.get_help())
        context.exit()


def gather(argument: str, kind: type) -> Callable[[Command], Command]:
    """Return a decorator that passes the groups of a command as one argument, a data class of groups."""
    names = [each.name for each in fields(kind)]

    def add(command: Command) -> Command:
        @wraps(command)
        def called(*arguments: Any, **values: Any) -> Any:
            values[argument] = kind(**{name: values.pop(name) for name in names})
            return command(*arguments, **values)

        return cast(Command, called)

    return add


def _of_field(argument: str, kind: type, declared: Any) -> Callable[[Any], Any]:
    """Return the decorator that adds the option of a field."""
    how = dict(declared.metadata["option"])
    names, common, hint = how.pop("names"), how.pop("common"), get_type_hints(kind)[declared.name]
    kinds = [each for each in (get_args(hint) or (hint,)) if each is not type(None)]
    if hint is bool:
        how.update(is_flag=True, default=False)
    elif "type" not in how:
        how["type"] = PATH if kinds[0] is Path else kinds[0]
    if how["default"] is None:
        del how["default"]
    elif hint is not bool:
        how.setdefault("show_default", True)
    return _adding((*names, f"{argument}_{declared.name}"), how, common=common)


class _Value(click.ParamType[Any]):
    """A value of a setting whose text a function reads; a text that it cannot read stays as it is."""

    def __init__(self, name: str, read: Callable[[str], Any]) -> None:
        self.name, self._read = name, read

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if not isinstance(value, str):
            return value
        try:
            return self._read(value)
        except ValueError:
            # The class of settings refuses the text in its own words.
            return value


def _option_name(name: str, declared: Declared) -> str:
    return declared.option.removeprefix("--") or name.replace("_", "-")


def _of_setting(
    parameter: str, name: str, declared: Declared, default: Any, *, pair: bool, common: bool
) -> Callable[[Any], Any]:
    """Return the decorator that adds the option of a setting."""
    how: dict[str, Any] = {"help": declared.sentence}
    if declared.metavar:
        how["metavar"] = declared.metavar
    if declared.read is not None:
        how["type"] = _Value(declared.metavar or "text", declared.read)
    else:
        how["type"] = float if default is None or isinstance(default, tuple) else type(default)
    if declared.several:
        how["multiple"] = True
    elif pair and declared.read is None:
        how["type"] = (float, float)
    if default is not None and not declared.several:
        how.update(default=declared.text(default), show_default=True)
    return _adding((name, parameter), how, common=common)


def _is_pair(hint: Any) -> bool:
    """Return True for the type of two numbers, or of two numbers or None."""
    return any(get_args(each) == (float, float) for each in (hint, *get_args(hint)))


def _adding(names: Sequence[str], how: Mapping[str, Any], *, common: bool) -> Callable[[Any], Any]:
    def add(command: Any) -> Any:
        decorated = click.option(*names, **how)(command)
        setattr(decorated.__click_params__[-1], _COMMON, common)
        return decorated

    return add


def _require_effect(needs: Mapping[str, Sequence[str]]) -> None:
    context = click.get_current_context()
    given = {
        option
        for parameter in context.command.params
        if parameter.name and context.get_parameter_source(parameter.name) is ParameterSource.COMMANDLINE
        for option in parameter.opts
    }
    idle = [option for option, partners in needs.items() if option in given and not given & set(partners)]
    if idle:
        # If there are options that would make all idle options effective, name only these options.
        shared = [name for name in needs[idle[0]] if all(name in needs[option] for option in idle)]
        partners = " or ".join(shared or dict.fromkeys(name for option in idle for name in needs[option]))
        options = ", ".join(idle)
        raise CorrelationError(
            "settings", options, f"{partners} beside it", "none", f"give {partners}, or leave out {options}"
        )


def is_option_of(parameter: click.Parameter, kind: type, name: str) -> bool:
    """Return True if a parameter is the option of a setting; classes may share the setting itself."""
    own, own_name = getattr(parameter, _SETTING, (None, ""))
    if own is None or own_name != name:
        return False
    of_both = [declared_in(each).get(name) for each in (own, kind) if hasattr(each, "__pydantic_fields__")]
    return (len(of_both) == 2 and of_both[0] is of_both[1]) or own is kind


def as_in_results(command: click.Command, *arguments: str) -> None:
    """Remove the defaults of groups, so that an option that is not given has the value from RESULTS."""
    for parameter in command.params:
        of_group = parameter.name is not None and parameter.name.startswith(tuple(f"{a}_" for a in arguments))
        if isinstance(parameter, click.Option) and of_group:
            parameter.default, parameter.show_default = None, "as in RESULTS"
