"""Groups of command-line options; each group is passed to a command as one argument."""

from collections.abc import Callable
from dataclasses import fields
from functools import wraps
from typing import Any, TypeVar, cast

from dic.errors import MeasurementError, joined

Command = TypeVar("Command", bound=Callable[..., Any])
Option = Callable[[Any], Any]


def option_group(name: str, kind: type, *options: Option) -> Callable[[Command], Command]:
    """Return a decorator that adds options to a command and passes their values as one argument.

    Parameters
    ----------
    name : str
        Name of the argument.
    kind : type
        A dataclass with one field for each option.
    *options
        Results of `click.option`, in the order of the help text.
    """
    names = [field.name for field in fields(kind)]

    def add(command: Command) -> Command:
        @wraps(command)
        def called(*arguments: Any, **values: Any) -> Any:
            values[name] = kind(**{own: values.pop(own) for own in names})
            return command(*arguments, **values)

        decorated: Any = called
        for option in reversed(options):
            decorated = option(decorated)
        return cast(Command, decorated)

    return add


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
