"""Settings: each is declared once, with its default, its bounds, its unit and one sentence.

A class of settings is a frozen data class of pydantic. Its checks, its documentation, the options of the
commands, the settings file and the reference of the commands are derived from its fields.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, fields
from functools import wraps
from inspect import Parameter, Signature, signature
from numbers import Integral, Real
from types import UnionType
from typing import Annotated, Any, NamedTuple, TypeVar, Union, cast, dataclass_transform, get_args, get_origin

from pydantic import BeforeValidator, ConfigDict, Field, ValidationError
from pydantic.dataclasses import dataclass

from dic.errors import MeasurementError, joined
from dic.keywords import named_settings

_Class = TypeVar("_Class", bound=type)
_CONFIG = ConfigDict(strict=True, extra="forbid", arbitrary_types_allowed=True)


def _plain(value: Any) -> Any:
    """Return a number of NumPy as a number of Python; text, True and False are no numbers here."""
    if isinstance(value, bool) or not isinstance(value, Real):
        return value
    return int(value) if isinstance(value, Integral) else float(value)


def _no_truth_value(value: Any) -> Any:
    if isinstance(value, bool):
        raise ValueError("a number is expected")
    return _plain(value)


Whole = Annotated[int, BeforeValidator(_no_truth_value)]
"""A whole number; pydantic alone would refuse those of NumPy."""
Number = Annotated[float, BeforeValidator(_no_truth_value)]
"""A real number."""


def _as_tuple(value: Any) -> Any:
    return tuple(map(_plain, value)) if isinstance(value, list | tuple) else value


Pair = Annotated[tuple[float, float], BeforeValidator(_as_tuple)]
"""Two real numbers."""
Numbers = Annotated[tuple[float, ...], BeforeValidator(_as_tuple)]
"""Any number of real numbers."""
Names = Annotated[tuple[str, ...], BeforeValidator(_as_tuple)]
"""Any number of names."""


class Declared(NamedTuple):
    """What is declared of a setting in addition to its type, its default and its bounds."""

    what: str
    """Name of the setting in messages."""
    sentence: str
    """What the setting is, in one sentence: the help of its option, and the comment in a settings file."""
    expected: str
    remedy: str
    """The possible values, and a value that works, for messages."""
    more: str = ""
    """Further sentences for the documentation in Python."""
    option: str = ""
    """Name of the option; "" for the name of the field without its unit."""
    example: str = ""
    """A value as text in TOML, for a setting without a default."""
    metavar: str = ""
    """The values of the option in the help text; "" for those that its type gives."""
    unit: str = ""
    """Unit of the value that messages show."""
    read: Callable[[str], Any] | None = None
    """Function that returns the value of the option's text; it raises a ValueError for another text."""
    several: bool = False
    """True if the option may be repeated."""

    @staticmethod
    def text(value: Any) -> Any:
        """Return the value of an option as its help text shows it: names with commas between them."""
        is_names = isinstance(value, tuple) and all(isinstance(each, str) for each in value)
        return ",".join(value) if is_names else value


def number_or_text(text: str) -> float | str:
    """Return a number, or the text itself if it is none."""
    try:
        return float(text)
    except ValueError:
        return text


def names_of(text: str) -> tuple[str, ...]:
    """Return the names in a text with commas between them."""
    return tuple(name.strip() for name in text.split(","))


def place_of(text: str) -> tuple[float, float]:
    """Return X and Y of the text "X,Y"; one number is Y."""
    x, y = numbers if len(numbers := [float(part) for part in text.split(",")]) == 2 else (0.0, *numbers)
    return x, y


def setting(
    what: str,
    sentence: str,
    *,
    default: Any = ...,
    expected: str,
    remedy: str,
    among: Iterable[Any] | None = None,
    check: Callable[[Any], bool] | None = None,
    **further: Any,
) -> Any:
    """Declare a setting as a field of a class of settings.

    `what`, `sentence`, `expected`, `remedy`: as for `Declared`. `default`: default of the setting. Without
    one, the setting must be given. `among`: the possible values, such as the names of a registry. `check`:
    function that returns True for a possible value. `**further`: further attributes of `Declared`, and bounds
    of pydantic: ge, gt, le, lt.
    """
    own = {name: further.pop(name) for name in Declared._fields if name in further}
    declared = Declared(what, sentence, expected, remedy, **own)
    extra: Any = {"declared": declared, "among": None if among is None else list(among), "check": check}
    return Field(default, description=sentence, json_schema_extra=extra, **further)


def one_of(names: Iterable[str]) -> str:
    """Return the names as text for `expected`: "one of a, b, c"."""
    return f"one of {', '.join(names)}"


def either(names: Iterable[Any]) -> str:
    """Return the names as text for a sentence: "a, b or c"."""
    return enumerated(names, "or")


def enumerated(names: Iterable[Any], word: str = "and") -> str:
    """Return the names as text for a sentence: "a, b and c"."""
    *others, last = map(str, names)
    return f"{', '.join(others)} {word} {last}" if others else last


@dataclass_transform(frozen_default=True, field_specifiers=(setting,))
def settings_class(error: type[MeasurementError]) -> Callable[[_Class], _Class]:
    """Return a decorator that makes a class of settings out of fields that `setting` declares.

    The class raises `error` with one sentence for each wrong value, all together. A method `__post_init__`
    checks what several settings must fulfil together.
    """

    def decorate(cls: _Class) -> _Class:
        made: Any = dataclass(frozen=True, config=_CONFIG)(cls)
        made.__init__ = _in_sentences(made.__init__, made, error)
        made.__doc__ = f"{cls.__doc__}\n{_attributes(made, error)}"
        return cast(_Class, named_settings(made))

    return decorate


def declared_in(cls: type) -> Mapping[str, Declared]:
    """Return what is declared of the settings of a class, by their names."""
    return {name: extra["declared"] for name, extra in _extras(cls).items()}


def default_of(cls: type, name: str) -> Any:
    """Return the default of a setting; None if it has none."""
    (found,) = (each for each in fields(cast(Any, cls)) if each.name == name)
    if found.default_factory is not MISSING:
        return found.default_factory()
    default = getattr(found.default, "default", found.default)
    return None if default in (MISSING, ...) or "Undefined" in type(default).__name__ else default


def _extras(cls: type) -> dict[str, Any]:
    of_class: Any = cls
    found = {name: info.json_schema_extra for name, info in of_class.__pydantic_fields__.items()}
    return {name: extra for name, extra in found.items() if extra is not None}


def _in_sentences(init: Any, cls: type, error: type[MeasurementError]) -> Any:
    """Return the function `__init__` of a class; it raises `error` for wrong values."""
    names = [each.name for each in fields(cast(Any, cls))]

    @wraps(init)
    def checked(self: Any, *args: Any, **given: Any) -> None:
        values = dict(zip(names, args, strict=False)) | given
        wrong: dict[str, Any] = {}
        made = False
        try:
            init(self, *args, **given)
            made = True
        except ValidationError as found:
            missing = [each for each in found.errors() if each["type"] == "missing" and len(each["loc"]) == 1]
            if missing or len(args) > len(names):
                raise TypeError(f"{cls.__name__}: {_first_of(missing)} is missing") from None
            wrong = {_name(each["loc"][0], names): each["input"] for each in found.errors()}
        for name, extra in _extras(cls).items():
            # Beside a wrong value there is no object, and the other values are checked as they were given.
            value = getattr(self, name) if made else values.get(name)
            if name in values and name not in wrong and not _is_possible(value, extra):
                wrong[name] = values[name]
        if wrong:
            # The whole value is shown, also if one element of it is wrong.
            refusals = [_refusal(error, cls, name, values[name]) for name in names if name in wrong]
            raise joined(refusals)

    own = Parameter("self", Parameter.POSITIONAL_OR_KEYWORD)
    # The function `__init__` of pydantic takes any arguments.
    of_function: Any = checked
    of_function.__signature__ = Signature([own, *signature(cls).parameters.values()])
    return checked


def _first_of(missing: Any) -> str:
    return str(missing[0]["loc"][0]) if missing else "the place of an argument"


def _name(place: int | str, names: list[str]) -> str:
    return names[place] if isinstance(place, int) else place


def _is_possible(value: Any, extra: Mapping[str, Any]) -> bool:
    among, check = extra["among"], extra["check"]
    try:
        return (among is None or value in among) and (check is None or check(value))
    except (TypeError, AttributeError):
        # The value is of another type, which pydantic converts if all values are possible.
        return True


def _refusal(error: type[MeasurementError], cls: type, name: str, value: Any) -> MeasurementError:
    declared = declared_in(cls)[name]
    got = f"{_shown(value)} {declared.unit}".rstrip()
    return error("settings", declared.what, declared.expected, got, declared.remedy)


def _shown(value: Any) -> str:
    if isinstance(value, Mapping):
        return " ".join(f"{name}={','.join(map(str, each))}" for name, each in value.items())
    if isinstance(value, tuple | list) and all(isinstance(each, str) for each in value):
        return ", ".join(value) or "none"
    return str(value)


def _attributes(cls: type, error: type[MeasurementError]) -> str:
    """Return the sections of a docstring that describe the settings and their errors."""
    lines, kinds = ["", "Attributes", "----------"], cls.__annotations__
    for name, declared in declared_in(cls).items():
        default = default_of(cls, name)
        lines.append(f"{name} : {kind_text(kinds[name])}, default {default!r}")
        lines.append(f"    {declared.sentence} {declared.more}".rstrip())
        lines.append(f"    Possible: {declared.expected}.")
    lines += [
        "",
        "Raises",
        "------",
        error.__name__,
        "    If a value is not possible; the message names all.",
    ]
    return "\n".join(f"    {line}".rstrip() for line in lines)


def kind_text(kind: Any) -> str:
    """Return the type of a setting as text, such as "int" or "float or str"."""
    if get_origin(kind) is Annotated:
        kind = get_args(kind)[0]
    if get_origin(kind) in (Union, UnionType):
        return " or ".join(map(kind_text, get_args(kind)))
    if get_origin(kind) is tuple:
        return f"tuple of {kind_text(get_args(kind)[0])}"
    return "None" if kind is type(None) else str(getattr(kind, "__name__", kind))
