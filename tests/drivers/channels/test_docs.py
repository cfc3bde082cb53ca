"""The rig files in the documentation of text instruments and brokers read the lines that are shown there."""

import re
import tomllib
from contextlib import closing
from typing import Any

import pytest

from drivers.channels.mqtt.payload import Payload
from drivers.channels.mqtt.settings import MqttChannelSettings
from drivers.channels.text.driver import open_channels
from drivers.channels.text.fields import LineFields
from drivers.channels.text.settings import TextChannelSettings
from drivers.clock import SystemClock
from drivers.interfaces import OpenContext
from tests.drivers.channels.text.serial_sender import Sender
from tests.places import DOCS

PAGE = (DOCS / "text-instruments.md").read_text()
BLOCKS = [tomllib.loads(text) for text in re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)]
CHANNELS = [table["channels"] for table in BLOCKS if "channels" in table]
LINES = re.findall(r"```text\n(\d.*?)```", PAGE, re.DOTALL)[0].split()


def settings(name: str, **signals: Any) -> TextChannelSettings:
    (table,) = (each[name] for each in CHANNELS if name in each and "driver" in each[name])
    assert table["driver"] == "text-channels"
    table = {key: value for key, value in table.items() if key != "driver"}
    return TextChannelSettings.model_validate({**table, **({"signals": signals} if signals else {})})


@pytest.mark.parametrize("name", ["arduino", "meter", "indicator", "supply"])
def test_the_tables_are_right(name):
    assert settings(name).declared


def test_the_calibration_of_the_page_is_right():
    (calibrated,) = (
        each["arduino"]["signals"]
        for each in CHANNELS
        if "arduino" in each and "driver" not in each["arduino"]
    )
    device = settings("arduino", **calibrated)
    force = device.signals["force"]
    assert 88_070 * force.scale + force.offset == pytest.approx(9.81, abs=0.02)
    assert 83_860 * force.scale + force.offset == pytest.approx(0.0, abs=0.02)


@pytest.mark.realtime
def test_the_lines_of_the_sketch_are_read_over_a_serial_port():
    with closing(Sender()) as arduino:
        table = settings("arduino").model_dump(exclude_unset=True) | {"address": arduino.path, "start_s": 0.0}
        with arduino.saying_soon("14,187,83914", LINES[0]):
            context = OpenContext("channels.arduino", SystemClock())
            device = open_channels(TextChannelSettings.model_validate(table), context)
        with closing(device):
            arduino.say(*LINES[1:])
            SystemClock().sleep(0.2)
            found = device.read(2.0)
    assert found.values.ravel().tolist() == [83_911.0, 83_921.0]
    assert found.device_s[-1] == 20.915


def test_the_answer_of_the_indicator_is_read():
    device = settings("indicator")
    assert LineFields(device, list(device.signals.values())).read("GS   12,34 kg") == [12.34]


def test_the_message_of_the_publisher_is_read():
    page = (DOCS / "channels.md").read_text()
    (text,) = (
        block for block in re.findall(r"```toml\n(.*?)```", page, re.DOTALL) if "mqtt-channels" in block
    )
    table = tomllib.loads(text)["channels"]["shop"]
    assert table.pop("driver") == "mqtt-channels"
    device = MqttChannelSettings.model_validate(table)
    message = re.search(r"here of (\{.*\})", text)[1].encode()
    payload = Payload(list(device.signals.values()), device.time, device.invalid)
    assert payload.read(message) == ([12.5], 1.2)
