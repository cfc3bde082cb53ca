"""Groups of command-line options; each group is passed to a command as one argument."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from functools import wraps
from typing import Any, TypeVar, cast

import click
from click.core import ParameterSource

from dic.errors import CorrelationError, MeasurementError, joined

Command = TypeVar("Command", bound=Callable[..., Any])
Option = Callable[[Any], Any]


def option_group(
    name: str, kind: type, *options: Option, needs: Mapping[str, Sequence[str]] | None = None
) -> Callable[[Command], Command]:
    """Return a decorator that adds options to a command and passes their values as one argument.

    Parameters
    ----------
    name : str
        Name of the argument.
    kind : type
        A dataclass with one field for each option.
    *options
        Results of `click.option`, in the order of the help text.
    needs : mapping of str to sequence of str, optional
        Maps an option, such as ``"--decimal-comma"``, to other options of which it needs at least one. If the
        option is given without any of these, the command raises an error.
    """
    names = [field.name for field in fields(kind)]

    def add(command: Command) -> Command:
        @wraps(command)
        def called(*arguments: Any, **values: Any) -> Any:
            _require_effect(needs or {})
            values[name] = kind(**{own: values.pop(own) for own in names})
            return command(*arguments, **values)

        decorated: Any = called
        for option in reversed(options):
            decorated = option(decorated)
        return cast(Command, decorated)

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


def as_in_results(command: click.Command, names: Sequence[str]) -> None:
    """Remove the defaults of options, so that an option that is not given has the value from RESULTS."""
    for parameter in command.params:
        if isinstance(parameter, click.Option) and parameter.name in names:
            parameter.default, parameter.show_default = None, "as in RESULTS"


def all_of(*parts: Callable[[], Any]) -> list[Any]:
    """Call the functions `parts` and return their results; raise all their errors as one error.

    Raises
    ------
    MeasurementError
    """
    results, errors = [], []
    for part in parts:
        try:
            results.append(part())
        except MeasurementError as error:
            errors.append(error)
    if errors:
        raise joined(errors)
    return results
