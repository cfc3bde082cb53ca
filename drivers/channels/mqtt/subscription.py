"""A connection to an MQTT broker that keeps the messages of some topics, and connects again by itself.

The package paho-mqtt of the extra `mqtt` is imported only when a subscription is made.
"""

import threading
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.channels.mqtt.settings import MqttChannelSettings
from drivers.clock import Clock
from drivers.errors import DeviceFault, LinkLost

BACKLOG = 100_000
"""Largest number of messages that wait to be read. Older messages are lost, and counted."""
KEEP_ALIVE_S = 5
RECONNECT_S = (1, 4)
"""Shortest and longest wait before a new connection, in s."""
QOS = 1
_REFUSED = 0x80


@dataclass(frozen=True)
class ArrivedMessage:
    """A message of a topic, the time of its arrival on the rig's clock, and the messages lost before."""

    topic: str
    payload: bytes
    arrived_s: float
    lost: int


class Subscription:
    """The messages of the topics of a table. The constructor connects and subscribes.

    Raise `LinkLost` if the broker cannot be reached, and `DeviceFault` if it refuses.
    """

    def __init__(self, name: str, settings: MqttChannelSettings, clock: Clock) -> None:
        self._name, self._settings, self._clock = name, settings, clock
        self._changed = threading.Condition()
        self._messages: deque[ArrivedMessage] = deque()
        self._last: dict[str, bytes] = {}
        self._lost = 0
        self._subscribed, self._refusal, self._trouble = False, "", "no connection yet"
        self._client: Any = self._made()
        host, port = settings.place
        try:
            self._client.connect(host, port, KEEP_ALIVE_S)
        except (OSError, ValueError) as error:
            raise self._link_lost(str(error)) from error
        self._client.loop_start()
        try:
            self._wait_for_subscription()
        except BaseException:
            self.close()
            raise

    def take(self, timeout_s: float) -> list[ArrivedMessage]:
        """Return all messages. Wait up to `timeout_s` of real time if there is none.

        Raise `LinkLost` if there is no connection after this time, and `DeviceFault` if the broker refuses.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._messages or self._refusal, timeout_s)
            messages = list(self._messages)
            self._messages.clear()
        if not messages:
            self._require_connection()
        return messages

    def close(self) -> None:
        """End the connection. A repeated call has no effect."""
        client, self._client = self._client, None
        if client is not None:
            client.disconnect()
            client.loop_stop()
            # the client closes its last sockets when nobody refers to it any more
            client.on_connect = client.on_disconnect = client.on_subscribe = client.on_message = None
        with self._changed:
            self._subscribed, self._trouble = False, "the connection was closed"

    def _made(self) -> Any:
        try:
            from paho.mqtt.client import Client
            from paho.mqtt.enums import CallbackAPIVersion
        except ImportError as error:
            remedy = 'install it with: pip install "offaxis[mqtt]"'
            raise LinkLost(self._name, "open", "the package paho-mqtt", f"none ({error})", remedy) from error
        settings = self._settings
        client = Client(CallbackAPIVersion.VERSION2, settings.client_id, clean_session=True)
        client.connect_timeout = settings.reply_timeout_s
        client.reconnect_delay_set(*RECONNECT_S)
        try:
            if settings.user is not None and settings.password_file is not None:
                client.username_pw_set(settings.user, Path(settings.password_file).read_text().strip())
            if settings.tls:
                client.tls_set(settings.ca_file)
        except (OSError, UnicodeDecodeError) as error:
            remedy = "check password_file and ca_file"
            raise DeviceFault(self._name, "open", "readable files", str(error), remedy) from error
        client.on_connect, client.on_disconnect = self._connected, self._disconnected
        client.on_subscribe, client.on_message = self._confirmed, self._arrived
        return client

    def _wait_for_subscription(self) -> None:
        with self._changed:
            self._changed.wait_for(lambda: self._subscribed or self._refusal, self._settings.reply_timeout_s)
        self._require_connection()

    def _require_connection(self) -> None:
        if self._refusal:
            remedy = "check topic, user and password, and the broker's rights"
            raise DeviceFault(self._name, "subscribe", "acceptance by the broker", self._refusal, remedy)
        if not self._subscribed:
            raise self._link_lost(self._trouble)

    def _link_lost(self, got: str) -> LinkLost:
        remedy = "check address, network and broker"
        return LinkLost(self._name, "connect to the broker", "a connection", got, remedy)

    def _connected(self, client: Any, _: Any, __: Any, reason: Any, ___: Any) -> None:
        if reason.is_failure:
            self._set(refusal=str(reason))
            return
        client.subscribe([(topic, QOS) for topic in self._settings.topics])

    def _confirmed(self, _: Any, __: Any, ___: Any, reasons: Any, ____: Any) -> None:
        refused = [
            topic
            for topic, reason in zip(self._settings.topics, reasons, strict=False)
            if reason.value >= _REFUSED
        ]
        if refused:
            self._set(refusal=f"a refusal of {', '.join(refused)}")
        else:
            self._set(subscribed=True)

    def _disconnected(self, _: Any, __: Any, ___: Any, reason: Any, ____: Any) -> None:
        self._set(subscribed=False, trouble=f"a broken connection ({reason})")

    def _set(self, *, subscribed: bool = False, refusal: str = "", trouble: str = "") -> None:
        with self._changed:
            self._subscribed = subscribed
            self._refusal = refusal or self._refusal
            self._trouble = trouble or self._trouble
            self._changed.notify_all()

    def _arrived(self, _: Any, __: Any, message: Any) -> None:
        # the broker sends what it has kept after each connection
        if message.retain and (not self._settings.retained or message.topic in self._last):
            return
        # a message with quality of service 1 may be sent twice, and is then marked
        if message.dup and self._last.get(message.topic) == message.payload:
            return
        self._last[message.topic] = message.payload
        with self._changed:
            if len(self._messages) >= BACKLOG:
                self._lost += 1 + self._messages.popleft().lost
            lost, self._lost = self._lost, 0
            self._messages.append(ArrivedMessage(message.topic, message.payload, self._clock.now_s(), lost))
            self._changed.notify_all()
