"""What a broker keeps, refuses and loses, and topics that fall silent."""

import math
from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Any

import pytest

from drivers.channels.mqtt.driver import SPEC
from drivers.clock import SystemClock
from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.interfaces import OpenContext
from tests.mqtt_broker import Broker, Publisher

FORCE = {"unit": "N", "range": [-100.0, 100.0]}
READ_S = 5.0
pytestmark = pytest.mark.realtime


@pytest.fixture
def texts() -> dict[str, str]:
    return {"m/force": "1"}


@pytest.fixture
def publisher(broker: Broker, texts: dict[str, str]) -> Iterator[Publisher]:
    broker.start()
    with closing(Publisher(broker, lambda: dict(texts))) as opened:
        yield opened


@pytest.fixture
def opened(broker: Broker) -> Iterator[Callable[..., Any]]:
    devices = []

    def open_with(**changes: object) -> Any:
        table = {
            "address": broker.address,
            "stale_after_s": 0.5,
            "topic": "m/force",
            "signals": {"force": FORCE},
        }
        settings = SPEC.settings.model_validate({**table, **changes})
        devices.append(SPEC.open(settings, OpenContext("channels.shop", SystemClock())))
        return devices[-1]

    yield open_with
    for device in devices:
        device.close()


def read_all(device: Any) -> None:
    """Read until there is an error; what came before is still delivered."""
    while True:
        device.read(0.2)


@pytest.mark.parametrize("retained", [False, True])
def test_what_the_broker_has_kept_counts_only_if_it_is_declared(opened, publisher, texts, retained):
    publisher.publish(retain=True)
    SystemClock().sleep(0.1)
    device = opened(retained=retained)
    if retained:
        assert device.read(READ_S).values == 1.0
    else:
        with pytest.raises(DeviceTimeout, match=r"a message within 0\.2 s, got silence on m/force"):
            device.read(0.2)
    texts["m/force"] = "2"
    publisher.publish()
    assert device.read(READ_S).values == 2.0


def test_a_sample_is_complete_when_every_topic_has_a_new_message(opened, publisher, texts):
    table = {"force": {**FORCE, "topic": "m/force"}, "heat": {**FORCE, "topic": "m/heat"}}
    device = opened(signals=table)
    publisher.publish()
    with pytest.raises(DeviceTimeout):
        device.read(0.2)
    texts |= {"m/force": "3", "m/heat": "20"}
    publisher.publish()
    sample = device.read(READ_S)
    assert sample.values.tolist() == [[3.0, 20.0]]
    del texts["m/heat"]
    SystemClock().sleep(0.6)
    publisher.publish()
    with pytest.raises(DeviceTimeout, match=r"a message within 0\.5 s, got silence on m/heat;"):
        device.read(0.2)


def test_a_message_in_another_form_is_a_lost_sample_and_shown(opened, publisher, texts):
    device = opened()
    publisher.publish()
    assert device.read(READ_S).first == 0
    texts["m/force"] = "?"
    publisher.publish()
    with pytest.raises(DeviceTimeout, match=r"got '\?' instead of a number on m/force; check the publisher"):
        device.read(0.3)
    texts["m/force"] = "2"
    publisher.publish()
    assert device.read(READ_S).first == 2


def test_a_publishers_clock_that_was_set_back_is_told_once(opened, publisher, texts):
    device = opened(time={"json": "t", "unit": "s"}, signals={"force": {**FORCE, "json": "f"}})
    for time_s in (100.0, 101.0, 101.0, 50.0, 51.0):
        texts["m/force"] = f'{{"t": {time_s}, "f": 1}}'
        publisher.publish()
    SystemClock().sleep(0.3)
    samples = device.read(READ_S)
    # the same time twice is the same message
    assert samples.device_s.tolist() == [100.0, 101.0]
    assert samples.asked_s == -math.inf
    with pytest.raises(DeviceFault, match="a clock that went back from 101 to 50 s"):
        device.read(READ_S)
    after = device.read(READ_S).device_s
    assert (after > 101.0).all()
    assert after[1] - after[0] == pytest.approx(1.0)


def test_a_broker_that_comes_back_in_time_costs_only_samples(opened, publisher, broker):
    device = opened(stale_after_s=30.0)
    publisher.go_on(50.0)
    device.read(READ_S)
    broker.kill()
    SystemClock().sleep(0.2)
    with pytest.raises(DeviceTimeout, match="a broken connection"):
        read_all(device)
    broker.start()
    # the client tries again after one second
    assert device.read(15.0).values == 1.0


def test_a_broker_that_does_not_come_back_is_a_lost_connection(opened, publisher, broker):
    device = opened()
    publisher.go_on(50.0)
    device.read(READ_S)
    SystemClock().sleep(0.2)
    broker.kill()
    SystemClock().sleep(0.7)
    with pytest.raises(LinkLost, match="a connection, got a broken connection"):
        read_all(device)
    broker.start()


def test_no_broker_is_one_sentence(opened):
    with pytest.raises(LinkLost, match=r"connect to the broker: .*refused; check address"):
        opened(address="127.0.0.1:1")


def test_a_wrong_password_is_one_sentence_and_the_right_one_is_taken(opened, tmp_path):
    argon2 = pytest.importorskip("pwdlib", reason="the broker's library for passwords is not installed")
    users, password = tmp_path / "users", tmp_path / "password"
    users.write_text(f"lab:{argon2.PasswordHash.recommended().hash('right')}\n")
    password.write_text("wrong\n")
    with closing(Broker(str(users))) as guarded:
        table = {"address": guarded.address, "user": "lab", "password_file": str(password)}
        with pytest.raises(DeviceFault, match=r"acceptance by the broker, got .*check topic, user"):
            opened(**table)
        password.write_text("right\n")
        assert opened(**table).info.vendor == "MQTT"
    with pytest.raises(DeviceFault, match=r"readable files, got .*No such file.*; check password_file"):
        opened(user="lab", password_file=str(tmp_path / "none"))
