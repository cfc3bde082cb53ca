"""Begin the record of the measured channels before a run, and end it after the last image."""

from drivers.signals import ChannelDevice
from rig.engine.context import RunContext

_POLL_S = 0.02
_AFTER_S = 0.2
"""The record reaches at least this time in s beyond the last image, for the mean of the samples around it."""
_LAST_SAMPLES_S = 3.0
"""Longest wait in s for the samples of the last image, added to the longest delay of a signal."""


def begin_channels(run: RunContext) -> None:
    """Begin to read all channel devices, and wait until each of them has given a sample.

    Raise `DeviceError` if a device fails or gives none, and `Aborted` if the end of the run is requested.
    """
    run.channels.begin()
    while not run.channels.are_ready:
        run.calls.pause(_POLL_S)


def follow_channels(run: RunContext, last_image_s: float) -> None:
    """Wait until the samples reach the last image, whose loads come later by the delays of the signals.

    `last_image_s` is the end of its exposure. A warning tells if they do not come.
    """
    delays_s = [_longest_delay_s(device) for device in run.rig.channels.values()]
    until_s, begun_s = last_image_s + _AFTER_S, run.clock.now_s()
    most_s = max(delays_s, default=0.0) + _LAST_SAMPLES_S
    while not run.channels.have_passed(until_s):
        if run.clock.now_s() - begun_s > most_s:
            run.log("warning", "the samples of the channels end before the last image")
            return
        run.read()
        run.calls.pause(_POLL_S)


def end_channels(run: RunContext) -> None:
    """End the record. A device whose driver hangs is lost, so that it is not closed."""
    run.rig.lost.update(run.channels.end())


def _longest_delay_s(device: ChannelDevice) -> float:
    return max((signal.delay_s for signal in device.signals), default=0.0)
