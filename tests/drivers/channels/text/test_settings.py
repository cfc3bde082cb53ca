"""Mistakes in the table of a text instrument are found when the rig file is read, each with one sentence."""

import pytest
from pydantic import ValidationError

from drivers.channels.text.settings import TextChannelSettings

FORCE = {"unit": "N", "range": [-100.0, 100.0]}
GOOD = {"address": "/dev/ttyUSB0", "query": "READ?", "rate_hz": 10, "signals": {"force": FORCE}}


def made(*, force: dict[str, object] | None = None, **changes: object) -> TextChannelSettings:
    table = {**GOOD, **changes}
    if force is not None:
        table["signals"] = {"force": {**FORCE, **force}}
    return TextChannelSettings.model_validate({k: v for k, v in table.items() if v is not None})


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"force": {"pattern": "F=("}}, "a regular expression is expected, but"),
        ({"force": {"pattern": "F=.*"}}, "one group .* is expected, around the number, got 0"),
        ({"force": {"pattern": "(F)=(.*)"}}, "got 2; write .* for other brackets"),
        ({"force": {"pattern": "(.*)", "column": 1}}, "contradict each other"),
        ({"force": {"column": 0}}, "greater than or equal to 1"),
        ({"force": {"scale": 0.0}}, "scale must not be 0"),
        ({"identification": {"query": "*IDN?", "pattern": "["}}, "a regular expression is expected"),
        ({"query": None}, "query is missing for force; add it, or stream = true"),
        ({"rate_hz": None}, "Field required"),
        ({"stream": True}, "a stream needs no query"),
        ({"counter": {"column": 2}, "force": {"column": 1}}, "a counter belongs to a stream"),
        ({"separator": ",", "decimal": ","}, "separator and decimal are both a comma"),
        ({"separator": " "}, 'written "space"'),
        ({"columns": 2, "force": {"column": 3}}, "column must be at most columns, 2, got 3"),
        ({"signals": {"force": FORCE, "travel": FORCE}}, "two values have the same place"),
        ({"address": "socket://10.0.0.5:5025", "baud": 9600}, "baud belong to a serial port"),
        ({"address": "visa://GPIB0::8::INSTR", "baud": 9600}, "baud belong to a serial port"),
        ({"visa_library": "@sim"}, "visa_library belongs to an address visa://"),
        ({"address": "visa://ASRL1::INSTR", "query": None, "stream": True}, "a stream and an echo need"),
        ({"opening": ["UNIT µm"]}, "cannot be sent as ascii"),
        ({"pause_s": 1.0}, "Extra inputs are not permitted"),
        (
            {
                "time": {"column": 1, "unit": "ms"},
                "signals": {"force": {**FORCE, "column": 2}, "travel": {**FORCE, "query": "T?"}},
            },
            "the device's time belongs to one query",
        ),
    ],
)
def test_a_mistake_is_one_sentence(changes, said):
    with pytest.raises(ValidationError, match=said):
        made(**changes)


def test_signals_with_the_same_query_share_an_answer():
    settings = made(
        signals={
            "force": {**FORCE, "column": 1},
            "heat": {**FORCE, "query": "TEMP?"},
            "travel": {**FORCE, "column": 2},
        }
    )
    assert settings.queries == {"READ?": ["force", "travel"], "TEMP?": ["heat"]}
