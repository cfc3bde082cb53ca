"""Mistakes in the table of a broker are found when the rig file is read; messages are read as declared."""

import math

import pytest
from pydantic import ValidationError

from drivers.channels.mqtt.payload import Payload
from drivers.channels.mqtt.settings import MqttChannelSettings

FORCE = {"unit": "N", "range": [-100.0, 100.0]}
GOOD = {"address": "broker.lab", "stale_after_s": 2.0, "topic": "a/b", "signals": {"force": FORCE}}


def made(**changes: object) -> MqttChannelSettings:
    table = {key: value for key, value in {**GOOD, **changes}.items() if value is not None}
    return MqttChannelSettings.model_validate(table)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"topic": "a/+/b"}, r"one topic is expected, without \+ and #"),
        ({"topic": None}, "topic is missing for force"),
        ({"stale_after_s": None}, "Field required"),
        ({"address": "broker:mqtt"}, "host or host:port is expected, got 'broker:mqtt'"),
        ({"address": "broker:0"}, "host or host:port is expected"),
        ({"user": "lab"}, "user and password_file belong together"),
        ({"ca_file": "/etc/ca.pem"}, "ca_file belongs to tls = true"),
        (
            {
                "time": {"json": "t", "unit": "s"},
                "signals": {"force": {**FORCE, "json": "f"}, "heat": {**FORCE, "topic": "c", "json": "h"}},
            },
            "a time belongs to one topic",
        ),
        ({"time": {"json": "t", "unit": "hours"}}, "Input should be"),
    ],
)
def test_a_mistake_is_one_sentence(changes, said):
    with pytest.raises(ValidationError, match=said):
        made(**changes)


@pytest.mark.parametrize(
    ("address", "tls", "place"),
    [
        ("broker.lab", False, ("broker.lab", 1883)),
        ("broker.lab", True, ("broker.lab", 8883)),
        ("10.0.0.5:1884", False, ("10.0.0.5", 1884)),
        ("[::1]", False, ("::1", 1883)),
        ("[::1]:1884", False, ("::1", 1884)),
    ],
)
def test_the_port_has_its_usual_number(address, tls, place):
    assert made(address=address, tls=tls).place == place


def read(message: bytes, path: str | None = None, time: dict[str, str] | None = None) -> tuple[float, float]:
    settings = made(signals={"force": {**FORCE, "json": path} if path else FORCE}, time=time)
    (number,), time_s = Payload(list(settings.signals.values()), settings.time, ["off"]).read(message)
    return number, time_s


@pytest.mark.parametrize(
    ("message", "path", "number"),
    [
        (b"12.5", None, 12.5),
        (b" -3e2\n", None, -300.0),
        (b'{"force": 12.5}', "force", 12.5),
        (b'{"force": "12.5"}', "force", 12.5),
        (b'{"sensors": [{"value": 1}, {"value": 2}]}', "sensors.1.value", 2.0),
    ],
)
def test_a_number_is_read_from_its_place(message, path, number):
    assert read(message, path)[0] == number


@pytest.mark.parametrize(
    ("message", "path"), [(b"off", None), (b'{"force": null}', "force"), (b'{"force": "off"}', "force")]
)
def test_what_means_no_value_is_no_number(message, path):
    assert math.isnan(read(message, path)[0])


@pytest.mark.parametrize(
    ("message", "path", "said"),
    [
        (b"twelve", None, "'twelve' instead of a number"),
        (b"NaN", None, "'NaN' instead of a number"),
        (b"\xff\xfe", None, "instead of a number"),
        (b"12.5", "force", "'12.5' without 'force'"),
        (b"{", "force", "'{', which is no JSON"),
        (b"[" * 60_000, "force", "which is no JSON"),
        (b'{"travel": 1}', "force", "without 'force'"),
        (b'{"force": true}', "force", "instead of a number at 'force'"),
        (b'{"force": 1e999}', "force", "instead of a number at 'force'"),
        (b'{"force": ' + b"1" * 400 + b"}", "force", "instead of a number at 'force'"),
        (b"1" * 70_000, None, "a message of 70000 bytes, which is too long"),
    ],
)
def test_another_form_is_shown(message, path, said):
    with pytest.raises(ValueError, match=said):
        read(message, path)


@pytest.mark.parametrize(
    ("time", "unit", "seconds"),
    [
        ("1500", "ms", 1.5),
        ('"1970-01-01T00:00:02.5Z"', "iso", 2.5),
        ('"1970-01-01T01:00:02+01:00"', "iso", 2.0),
    ],
)
def test_the_publishers_time_is_read(time, unit, seconds):
    message = f'{{"t": {time}, "force": 1}}'.encode()
    assert read(message, "force", {"json": "t", "unit": unit})[1] == pytest.approx(seconds)


@pytest.mark.parametrize(
    ("time", "unit", "said"),
    [
        ('"noon"', "iso", "without a date and time at 't'"),
        ('"2026-01-01T00:00:00"', "iso", "no time zone"),
        ("12", "iso", "without a time at 't'"),
        ("null", "s", "without a time at 't'"),
    ],
)
def test_a_time_in_another_form_is_shown(time, unit, said):
    with pytest.raises(ValueError, match=said):
        read(f'{{"t": {time}, "force": 1}}'.encode(), "force", {"json": "t", "unit": unit})
