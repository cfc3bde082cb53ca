"""Numbers are read as instruments write them, and nothing else is taken for a number."""

import math

import pytest

from drivers.channels.text.fields import LineFields
from tests.drivers.channels.text.test_settings import made


def value(line: str, force: dict[str, object] | None = None, **changes: object) -> float:
    settings = made(force=force or {}, **changes)
    (number,) = LineFields(settings, list(settings.signals.values())).read(line)
    return number


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("12", 12.0),
        ("-12.5", -12.5),
        ("+1.234560E-03", 1.23456e-3),
        ("- 12.5", -12.5),  # as indicators show it
        (".5", 0.5),
        ("3.", 3.0),
    ],
)
def test_a_line_with_one_number_is_this_number(line, expected):
    assert value(line) == expected


@pytest.mark.parametrize("line", ["", "abc", "1,5", "nan", "inf", "1_000", "0x1F", "1e999", "1 2", "٣"])
def test_what_is_no_number_is_refused(line):
    with pytest.raises(ValueError, match="instead of"):
        value(line)


@pytest.mark.parametrize("line", ["OL", "+9.90000000E+37", "9.91E37", "-9.9E37", "-----", "99999"])
def test_what_means_no_value_is_no_number(line):
    assert math.isnan(value(line, invalid=["OL", "-----", "99999"]))


def test_an_overflow_without_the_pattern_is_no_number_too():
    force = {"pattern": "F= *(.*) N"}
    assert value("F=  12.5 N", force) == 12.5
    assert math.isnan(value("OL", force, invalid=["OL"]))
    with pytest.raises(ValueError, match=r"'F= 12\.5', which does not fit the pattern"):
        value("F= 12.5", force)


def test_a_decimal_comma_is_read_and_a_point_is_then_refused():
    form = {"decimal": ",", "separator": ";", "columns": 2}
    assert value("-1,25;7", {"column": 1}, **form) == -1.25
    with pytest.raises(ValueError, match=r"'1\.25' instead of a number"):
        value("1.25;7", {"column": 1}, **form)


@pytest.mark.parametrize(("separator", "line"), [("tab", "7\t1.5"), ("space", "7  \t 1.5"), ("; ", "7; 1.5")])
def test_columns_are_counted_from_one(separator, line):
    assert value(line, {"column": 2}, separator=separator) == 1.5


@pytest.mark.parametrize("line", ["1,2", "1,2,3,4"])
def test_a_line_with_a_column_too_few_or_too_many_is_refused(line):
    with pytest.raises(ValueError, match=f"with {line.count(',') + 1} columns instead of 3"):
        value(line, {"column": 1}, columns=3)
