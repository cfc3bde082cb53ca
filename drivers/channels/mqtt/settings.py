"""Rig-file settings of an MQTT broker's topics as measured channels."""

from collections.abc import Iterator, Mapping
from typing import Annotated, Literal, Self, TypeAlias

from pydantic import AfterValidator, Field, model_validator

from drivers.channels.device_time import TimeUnit
from drivers.channels.settings import ChannelSettings, SignalSettings
from drivers.settings import LONGEST_PATH, Settings

PORT, TLS_PORT = 1883, 8883


def one_topic(text: str) -> str:
    """Check that a text names one topic. Raise `ValueError` for pydantic."""
    if "+" in text or "#" in text:
        raise ValueError("the name of one topic is expected, without + and #")
    return text


Topic: TypeAlias = Annotated[str, Field(min_length=1, max_length=500), AfterValidator(one_topic)]
JsonPath: TypeAlias = Annotated[str, Field(min_length=1, max_length=200)]


class MqttTimeSettings(Settings):
    """The place of the publisher's time in a message: a path in JSON, and its unit or ISO 8601."""

    json_path: JsonPath = Field(alias="json")
    unit: TimeUnit | Literal["iso"]


class MqttSignalSettings(SignalSettings):
    """A signal: its topic, if it is not that of the device, and the place of its number in the message.

    Without `json` the whole message is the number.
    """

    topic: Topic | None = None
    json_path: JsonPath | None = Field(
        default=None, alias="json", description="keys of the number, such as sensors.0.value"
    )


class MqttChannelSettings(ChannelSettings):
    """Settings of a broker and of the topics that are read, the table `[channels.NAME]`."""

    signals: Mapping[str, MqttSignalSettings] = Field(min_length=1, max_length=64)
    address: str = Field(min_length=1, max_length=LONGEST_PATH)  # host or host:port
    topic: Topic | None = None  # the topic of all signals that name none
    # longest time without a message on any of the topics
    stale_after_s: float = Field(gt=0.0, le=86_400.0)
    rate_hz: float = Field(default=0.0, ge=0.0, le=10_000.0)  # messages per second, if they come regularly
    # True to take the value that the broker has kept from before, although nobody knows how old it is
    retained: bool = False
    client_id: str = Field(default="", max_length=23)  # an empty text lets the broker choose it
    user: str | None = Field(default=None, min_length=1, max_length=200)
    password_file: str | None = Field(default=None, min_length=1, max_length=LONGEST_PATH)
    tls: bool = False
    ca_file: str | None = Field(default=None, min_length=1, max_length=LONGEST_PATH)
    # texts of a message, or of a value in JSON, that mean "no value"; null in JSON always means this
    invalid: list[str] = Field(default_factory=list, max_length=32)
    time: MqttTimeSettings | None = None
    reply_timeout_s: float = Field(default=2.0, gt=0.0, le=60.0)  # longest wait for the broker

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        mistakes = list(self._mistakes())
        if mistakes:
            raise ValueError("; ".join(mistakes))
        return self

    def _mistakes(self) -> Iterator[str]:
        host, port = self.place
        if not host or not 0 < port < 2**16:
            yield f"address: host or host:port is expected, got {self.address!r}"
        if lacking := [name for name, signal in self.signals.items() if not (signal.topic or self.topic)]:
            yield f"topic is missing for {', '.join(lacking)}; add it"
        elif self.time is not None and len(self.topics) > 1:
            yield "a time belongs to one topic with all signals; remove time, or make a table per topic"
        if (self.user is None) != (self.password_file is None):
            yield "user and password_file belong together; add the one that is missing"
        if self.ca_file is not None and not self.tls:
            yield "ca_file belongs to tls = true; add it"

    @property
    def place(self) -> tuple[str, int]:
        """Host and port of the broker. The port is 0 if it is no number."""
        host, colon, port = self.address.rpartition(":")
        if not colon or port.endswith("]"):
            return self.address.strip("[]"), TLS_PORT if self.tls else PORT
        return host.strip("[]"), int(port) if port.isascii() and port.isdecimal() and len(port) < 6 else 0

    @property
    def topics(self) -> dict[str, list[str]]:
        """The names of the signals of each topic."""
        found: dict[str, list[str]] = {}
        for name, signal in self.signals.items():
            found.setdefault(signal.topic or self.topic or "", []).append(name)
        return found
