"""Verify the measured channels of a run file: samples that are missing, repeated or out of their range."""

import tomllib
from dataclasses import dataclass

import numpy as np

from dic.runfile.reader import RunFile
from dic.runfile.schema import value_of
from rig.samples import GAUGE_PREFIX


@dataclass(frozen=True)
class ChannelCheck:
    """Number of samples of a channel device in the file, of lost ones, and of those out of their range."""

    samples: int
    lost: int
    outside: int


def check_channels(run: RunFile, problems: list[str]) -> dict[str, ChannelCheck]:
    """Check the samples of all channel devices, and append each problem to `problems`."""
    return {name: _check(run, name, problems) for name in run.channels}


def missing_channels(run: RunFile) -> list[str]:
    """Return one sentence for each channel device of the rig file that the run file does not have."""
    try:
        declared = tomllib.loads(run.info.configuration).get("channels", {})
    except (tomllib.TOMLDecodeError, RecursionError):
        return []
    names = declared if isinstance(declared, dict) else {}
    return [f"channels.{name}: its samples are missing" for name in names if name not in run.channels]


def _check(run: RunFile, name: str, problems: list[str]) -> ChannelCheck:
    columns = run.columns(f"channels/{name}")
    steps = np.diff(columns["number"])
    lost, repeated = int((steps[steps > 1] - 1).sum()), int((steps < 1).sum())
    outside = 0
    for signal, known in run.channels[name].items():
        values = columns[value_of(signal)]
        # Write the comparison so that NaN is outside, except of a live gauge, which has no value then.
        empty = np.isnan(values) & signal.startswith(GAUGE_PREFIX)
        bad = int(np.count_nonzero(~((values >= known.low) & (values <= known.high) | empty)))
        outside += bad
        if bad and run.info.status == "completed":
            problems.append(f"channels.{signal}: {bad} samples are out of its range, but the run went on")
    if lost:
        problems.append(f"channels.{name}: {lost} samples are missing in {int((steps > 1).sum())} gaps")
    if repeated:
        problems.append(f"channels.{name}: {repeated} samples are not later than the one before")
    if not len(steps) and run.steps:
        problems.append(f"channels.{name}: there are no samples")
    return ChannelCheck(len(columns["number"]), lost, outside)
