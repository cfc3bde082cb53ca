"""Unknown keyword arguments of Python's users: the message names the argument that was probably meant."""

from collections.abc import Callable, Sequence
from dataclasses import fields
from difflib import get_close_matches
from functools import wraps
from inspect import signature
from typing import Any, ParamSpec, TypeVar

_Given = ParamSpec("_Given")
_Result = TypeVar("_Result")
_Class = TypeVar("_Class", bound=type)


def named_settings(cls: _Class) -> _Class:
    """Let a data class name the setting that an unknown keyword resembles, such as subset_px for subset.

    The class raises a `TypeError` if a keyword is unknown.
    """
    of_class: Any = cls
    of_class.__init__ = _checked(of_class.__init__, cls.__name__, {})
    return cls


def takes_settings(**groups: type) -> Callable[[Callable[_Given, _Result]], Callable[_Given, _Result]]:
    """Let a function say where a setting belongs that is given to the function itself.

    `**groups`: the class of the settings that each of these arguments takes.
    """

    def decorate(function: Callable[_Given, _Result]) -> Callable[_Given, _Result]:
        return _checked(function, function.__name__, groups)

    return decorate


def _checked(
    call: Callable[_Given, _Result], name: str, groups: dict[str, type]
) -> Callable[_Given, _Result]:
    known = [own for own in signature(call).parameters if own != "self"]
    homes = {own: f"{own}=…" for own in known}
    for argument, cls in groups.items():
        of_class: Any = cls
        homes |= {field.name: f"{argument}={cls.__name__}({field.name}=…)" for field in fields(of_class)}

    @wraps(call)
    def checked(*args: _Given.args, **given: _Given.kwargs) -> _Result:
        for keyword in given:
            if keyword not in known:
                raise TypeError(_sentence(name, keyword, known, homes))
        return call(*args, **given)

    return checked


def _sentence(name: str, keyword: str, known: Sequence[str], homes: dict[str, str]) -> str:
    near = [own for own in homes if own.startswith(f"{keyword}_")] or get_close_matches(keyword, homes, 1)
    remedy = f"did you mean {homes[near[0]]}" if near else f"leave {keyword} out"
    return f"{name}: expected the arguments {', '.join(known)}, got {keyword!r}; {remedy}"
