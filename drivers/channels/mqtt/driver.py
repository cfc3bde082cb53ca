"""The driver `mqtt-channels`: topics of an MQTT broker as signals."""

import math

from drivers.channels.device_time import DeviceTime
from drivers.channels.mqtt.payload import Payload
from drivers.channels.mqtt.settings import MqttChannelSettings
from drivers.channels.mqtt.subscription import ArrivedMessage, Subscription
from drivers.channels.sample_queue import RestartedError, SampleQueue
from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.interfaces import DeviceInfo, OpenContext
from drivers.lines.addresses import resolve_address
from drivers.lines.call_time import CallTime
from drivers.registry import DriverSpec
from drivers.signals import Samples

BURST_S = 0.003
"""Messages that arrive this soon after another one may have waited together on their way."""


class _Topic:
    """A topic, and its part of the next sample: the values, and the earliest time of their measurement."""

    def __init__(self, payload: Payload, names: list[str], now_s: float) -> None:
        self.payload, self.names = payload, names
        self.part: tuple[dict[str, float], float] | None = None
        self.heard_s = now_s
        self._before_s = now_s

    def hear(self, values: list[float], arrived_s: float, oldest_s: float) -> None:
        """Take values that arrived at `arrived_s` and were not measured before `oldest_s`."""
        if arrived_s > self.heard_s + BURST_S:
            self._before_s = self.heard_s
        self.heard_s = arrived_s
        self.part = dict(zip(self.names, values, strict=True)), max(self._before_s, oldest_s)


class MqttChannels:
    """A `ChannelDevice` whose signals are topics. A sample is complete when each topic has a new message.

    Without a time in the messages, a sample is as old as the message before, at most.
    """

    def __init__(self, settings: MqttChannelSettings, context: OpenContext) -> None:
        address = resolve_address(settings.address, context)
        self._settings = settings.model_copy(update={"address": address})
        self._name = f"{context.name} ({address})"
        self._clock, self._patience_s = context.clock, context.patience_s
        self.signals, self.rate_hz = settings.declared, settings.rate_hz
        # a run ends after this time without a sample
        self.silence_s = settings.stale_after_s
        self.info = DeviceInfo(
            "MQTT", ", ".join(settings.topics)[:200], "", simulated=address != settings.address
        )
        now_s = self._clock.now_s()
        self._topics = {
            topic: _Topic(
                Payload([settings.signals[name] for name in names], settings.time, settings.invalid),
                names,
                now_s,
            )
            for topic, names in settings.topics.items()
        }
        self._time = None if settings.time is None else DeviceTime(1.0)
        self._queue = SampleQueue(self._settings, has_time=settings.time is not None)
        self._bad = ""
        self._closed = False
        self._subscription = Subscription(self._name, self._settings, self._clock)

    def read(self, timeout_s: float) -> Samples:
        """Return the next samples: one, or all that have come if the messages have a time.

        Raise `DeviceTimeout` if a topic is silent, `LinkLost` without a connection, and `DeviceFault` if the
        publisher's clock went back, or the broker refuses.
        """
        if self._closed:
            raise LinkLost(self._name, "read", "a connection", "the connection was closed", "open it again")
        call_time = CallTime(timeout_s, patience_s=self._patience_s)
        with call_time.call():
            while not self._queue:
                try:
                    messages = self._subscription.take(call_time.left_s)
                except LinkLost as lost:
                    # a connection that comes back in time has lost nothing but samples
                    if self._stale():
                        raise
                    raise self._silence(timeout_s, lost.got) from lost
                for message in messages:
                    self._add(message)
                if not messages:
                    raise self._silence(timeout_s)
        try:
            return self._queue.take()
        except RestartedError as restart:
            remedy = "find out why the publisher's clock was set back"
            raise DeviceFault(self._name, "read", "a time that increases", str(restart), remedy) from restart

    def close(self) -> None:
        """End the connection. A repeated call has no effect."""
        self._closed = True
        self._subscription.close()

    def _add(self, message: ArrivedMessage) -> None:
        """Add a message to its sample, unless it came twice or has another form."""
        topic, arrived_s = self._topics[message.topic], message.arrived_s
        self._queue.lose(message.lost)
        try:
            values, time_s = topic.payload.read(message.payload)
        except ValueError as error:
            self._bad = f"{error} on {message.topic}"
            self._queue.lose()
            return
        device_s, restart = math.nan, ""
        if self._time is not None:
            if self._time.is_repeated(time_s):
                return
            device_s = self._time.seconds(time_s, arrived_s)
            restart = self._time.restart
        topic.hear(values, arrived_s, arrived_s - self._settings.stale_after_s)
        parts = [each.part for each in self._topics.values() if each.part is not None]
        if len(parts) < len(self._topics):
            return
        complete = {name: value for part, _ in parts for name, value in part.items()}
        values = [complete[name] for name in self._settings.signals]
        self._queue.add(values, min(earliest_s for _, earliest_s in parts), arrived_s, device_s, restart)
        for each in self._topics.values():
            each.part = None

    def _silence(self, timeout_s: float, lost: str = "") -> DeviceTimeout:
        bad, self._bad = self._bad, ""
        old, stale_s = self._stale(), self._settings.stale_after_s
        expected = f"a message within {stale_s if old else timeout_s:g} s"
        got = lost or bad or f"silence on {', '.join(old or self._topics)}"
        remedy = "check the publisher, the names of the topics, and the places of the numbers in the messages"
        return DeviceTimeout(self._name, "read", expected, got, remedy)

    def _stale(self) -> list[str]:
        """Return the topics that have been silent for too long."""
        oldest_s = self._clock.now_s() - self._settings.stale_after_s
        return [name for name, topic in self._topics.items() if topic.heard_s < oldest_s]


SPEC = DriverSpec(kind="channels", settings=MqttChannelSettings, open=MqttChannels)
