"""Read the declarations of gauges from a TOML file, or from the options of a command."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from typing import Any

from dic.errors import GaugeError, MeasurementError, joined
from dic.files.toml import read_toml
from dic.gauges.declared import Gauge
from dic.gauges.kinds import GAUGES
from dic.typing import PathLike

_EXAMPLE = 'write [[gauge]], name = "axial", kind = "extensometer", start, end and patch'
_TYPED = "axial=extensometer start=400,200 end=400,800 patch=40"


def read_gauges(path: PathLike | None = None, texts: Sequence[str] = ()) -> tuple[Gauge, ...]:
    """Read the gauges that a TOML file and texts declare.

    The file has a table ``[[gauge]]`` for each gauge, with `name`, `kind` and the attributes of the kind's
    class. A key `unit` at the top of the file is the unit of all gauges. `docs/gauges.md` has an example.

    Parameters
    ----------
    path : path, optional
    texts : sequence of str
        Further gauges, such as ``"axial=extensometer start=400,200 end=400,800 patch=40"``. Corners of a
        polygon are separated by semicolons: ``corners=100,100;300,100;200,300``.

    Raises
    ------
    GaugeError
        If there is no gauge, the file cannot be read, or there are unknown keys, repeated names or impossible
        values. The message names all mistakes of the file, or of the texts, together.
    """
    gauges = (*(() if path is None else _gauges_in(path)), *_gauges_of(texts))
    if not gauges:
        remedy = f"name a TOML file, or declare one: --declare '{_TYPED}'"
        raise GaugeError("settings", "gauges", "at least one gauge", "none", remedy)
    require_names(gauges)
    return gauges


def gauge_text(gauge: Gauge) -> str:
    """Return the table ``[[gauge]]`` that declares a gauge in a TOML file."""
    values = {"name": gauge.name, "kind": gauge.kind} | {
        item.name: getattr(gauge, item.name) for item in fields(gauge) if item.name != "name"
    }
    defaults = {item.name: item.default for item in fields(gauge)} | {"kind": MISSING, "name": MISSING}
    # Text, numbers and lists of numbers are written alike in JSON and in TOML.
    lines = [f"{key} = {json.dumps(value)}" for key, value in values.items() if value != defaults[key]]
    return "\n".join(["[[gauge]]", *lines])


def _gauges_in(path: PathLike) -> tuple[Gauge, ...]:
    source = str(path)
    content = read_toml(path, GaugeError, "read gauges", _EXAMPLE)
    unit, tables = content.pop("unit", None), content.pop("gauge", None)
    errors: list[MeasurementError] = [
        GaugeError(source, "top of the file", "unit and [[gauge]]", key, "remove this key") for key in content
    ]
    if not isinstance(tables, list) or not tables or not all(isinstance(one, dict) for one in tables):
        errors.append(GaugeError(source, "read gauges", "a table [[gauge]] for each gauge", "none", _EXAMPLE))
        raise joined(errors)
    common = {} if unit is None else {"unit": unit}
    return _all_of([(f"{source}, gauge {k}", common | table) for k, table in enumerate(tables, 1)], errors)


def _gauges_of(texts: Sequence[str]) -> tuple[Gauge, ...]:
    tables, errors = [], []
    for text in texts:
        words = text.split()
        pairs = [word.partition("=") for word in words]
        if not words or not all(name and equals and value for name, equals, value in pairs):
            expected = "NAME=KIND KEY=VALUE …"
            errors.append(GaugeError("settings", "gauge", expected, repr(text), f"give --declare '{_TYPED}'"))
            continue
        (name, _, kind), *others = pairs
        values = {"name": name, "kind": kind} | {key: _typed_value(value) for key, _, value in others}
        tables.append((f"gauge {name}", values))
    return _all_of(tables, errors)


def require_names(gauges: Sequence[Gauge]) -> None:
    """Raise a `GaugeError` if two gauges have the same name."""
    if errors := _doubled([gauge.name for gauge in gauges]):
        raise joined(errors)


def _all_of(
    tables: Sequence[tuple[str, Mapping[str, Any]]], errors: Sequence[MeasurementError]
) -> tuple[Gauge, ...]:
    """Return the gauges that tables declare; a single error reports all mistakes and where they are."""
    gauges, found = [], list(errors)
    for place, table in tables:
        try:
            gauges.append(_gauge(place, table))
        except MeasurementError as error:
            found.append(error)
    found += _doubled([str(table.get("name")) for _, table in tables if "name" in table])
    if found:
        raise joined(found)
    return tuple(gauges)


def _gauge(place: str, table: Mapping[str, Any]) -> Gauge:
    kind = table.get("kind")
    if not isinstance(kind, str) or kind not in GAUGES:
        got = "none" if kind is None else repr(kind)
        raise GaugeError(place, "kind", f"one of {', '.join(GAUGES)}", got, 'give kind = "extensometer"')
    made = GAUGES[kind]
    known = {item.name: item for item in fields(made)}
    values = {key: value for key, value in table.items() if key != "kind"}
    errors: list[MeasurementError] = [
        GaugeError(place, f"keys of kind {kind}", f"one of {', '.join(known)}", key, "correct or remove it")
        for key in values
        if key not in known
    ]
    errors += [
        GaugeError(place, f"keys of kind {kind}", name, "none", f"add {name}")
        for name, item in known.items()
        if item.default is MISSING and name not in values
    ]
    if errors:
        raise joined(errors)
    return made(**values)


def _doubled(names: Sequence[str]) -> list[MeasurementError]:
    twice = sorted({name for name in names if names.count(name) > 1})
    return [
        GaugeError("gauges", "name", "a name of its own for each gauge", f"{name!r} twice", "rename one")
        for name in twice
    ]


def _typed_value(text: str) -> Any:
    """Convert an option's text to a number, a pair or a list of pairs; return any other text unchanged."""
    if ";" in text:
        return [_typed_value(part) for part in text.split(";") if part]
    if "," in text:
        return [_typed_value(part) for part in text.split(",")]
    for convert in (int, float):
        try:
            return convert(text)
        except ValueError:
            continue
    return text
