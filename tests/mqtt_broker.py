"""A broker by others (amqtt), and a publisher with faults, for tests of the MQTT driver.

As a program, ``python -m tests.mqtt_broker PORT [PASSWORD_FILE]`` is the broker itself.
"""

import asyncio
import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import pytest

from simulators.wire.faults import MQTT, FaultPanel
from tests.places import ROOT

LOCALHOST = "127.0.0.1"
START_S = 30.0
QOS = 1


def require_packages() -> None:
    """Skip the test if the driver's library or the broker is not installed."""
    pytest.importorskip("paho.mqtt.client", reason="paho-mqtt of the extra [mqtt] is not installed")
    pytest.importorskip("amqtt.broker", reason="the broker amqtt is not installed")


class Broker:
    """A broker in a process of its own, at a port that stays the same when it is started again."""

    def __init__(self, password_file: str = "") -> None:
        with socket.create_server((LOCALHOST, 0)) as free:
            self.port: int = free.getsockname()[1]
        self.address = f"{LOCALHOST}:{self.port}"
        self._password_file = password_file
        self._process: subprocess.Popen[bytes] | None = None
        self.start()

    def start(self) -> None:
        """Start the broker, and wait until it accepts connections. Do nothing if it runs."""
        if self._process is not None:
            return
        command = [sys.executable, "-m", "tests.mqtt_broker", str(self.port), self._password_file]
        null = subprocess.DEVNULL
        self._process = subprocess.Popen(command, cwd=ROOT, stdin=null, stdout=null, stderr=null)
        end_s = time.monotonic() + START_S
        while time.monotonic() < end_s:
            try:
                socket.create_connection((LOCALHOST, self.port), 1.0).close()
                return
            except OSError:
                assert self._process.poll() is None, "the broker ended"
                time.sleep(0.02)
        raise AssertionError("the broker does not start")

    def kill(self) -> None:
        """Kill the broker; a repeated call does nothing."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()

    close = kill


class Publisher:
    """Publishes texts of values, when it is told to or `rate_hz` times per second of real time.

    ``texts()`` returns the topics and their texts.
    """

    def __init__(self, broker: Broker, texts: Callable[[], dict[str, str]]) -> None:
        from paho.mqtt.client import Client
        from paho.mqtt.enums import CallbackAPIVersion

        self.texts = texts
        self.faults = FaultPanel(MQTT)
        self.faults.when("unplug", broker.kill, broker.start)
        self._before: dict[str, str] = {}
        self._ending = threading.Event()
        self._thread: threading.Thread | None = None
        self._client: Any = Client(CallbackAPIVersion.VERSION2)
        self._client.reconnect_delay_set(1, 1)
        self._client.connect(LOCALHOST, broker.port)
        self._client.loop_start()

    def go_on(self, rate_hz: float) -> None:
        """Publish `rate_hz` times per second from now on."""
        self._thread = threading.Thread(target=self._run, args=(1.0 / rate_hz,), daemon=True)
        self._thread.start()

    def _run(self, period_s: float) -> None:
        due_s = time.monotonic() + period_s
        while not self._ending.wait(max(0.0, due_s - time.monotonic())):
            due_s += period_s
            if self._client.is_connected():
                self.publish()

    def publish(self, *, retain: bool = False) -> None:
        """Publish the present texts, with the effects of the faults."""
        texts = self.texts()
        for topic, present in texts.items():
            text = self._before.get(topic, present) if self.faults.take("stale") is not None else present
            if self.faults.take("drop") is not None:
                continue
            if self.faults.take("corrupt") is not None:
                text = "?" + text
            if (seconds := self.faults.take("delay")) is not None:
                self._ending.wait(float(seconds))
            for _ in range(2 if self.faults.take("duplicate") is not None else 1):
                self._client.publish(topic, text, QOS, retain)
        self._before = texts

    def close(self) -> None:
        """End the publisher; a repeated call does nothing."""
        self._ending.set()
        if self._thread is not None:
            self._thread.join()
        client, self._client = self._client, None
        if client is not None:
            client.disconnect()
            client.loop_stop()


def clocked(topic: str, values: dict[str, float], begun_s: float) -> dict[str, str]:
    """Return a message in JSON with a time in ms; a value that is NaN is none."""
    numbers = {name: None if value != value else value for name, value in values.items()}
    return {topic: json.dumps({"ms": 1000.0 * (time.monotonic() - begun_s), "values": numbers})}


async def _serve(port: int, password_file: str) -> None:
    from amqtt.broker import Broker as AmqttBroker

    plugin = "amqtt.plugins.authentication."
    plugins = {plugin + "AnonymousAuthPlugin": {"allow_anonymous": True}}
    if password_file:
        plugins = {plugin + "FileAuthPlugin": {"password_file": password_file}}
    listeners = {"default": {"type": "tcp", "bind": f"{LOCALHOST}:{port}"}}
    broker = AmqttBroker({"listeners": listeners, "plugins": plugins})
    await broker.start()
    await asyncio.Event().wait()


if __name__ == "__main__":
    asyncio.run(_serve(int(sys.argv[1]), sys.argv[2]))
