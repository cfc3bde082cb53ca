"""Read what a run file says about its channel devices and their signals."""

from dataclasses import dataclass, fields
from math import isfinite
from typing import Any

from dic.runfile import schema
from dic.runfile.layout import Unlike, channel_names, signals_of


@dataclass(frozen=True)
class RunSignal:
    """A signal of a channel device.

    Attributes
    ----------
    unit : str
    low, high : float
        Range in which a value is valid.
    delay_s, delay_std_s : float
        Time by which the values are later than the quantity, and its standard deviation.
    std : float
        Standard deviation of the noise of one value; 0 if it is unknown.
    quantity : str
        "load" or "displacement" if the signal is that of a load frame; otherwise empty.
    """

    unit: str
    low: float
    high: float
    delay_s: float
    delay_std_s: float
    std: float
    quantity: str


QUANTITIES = ("", "load", "displacement")
_NUMBERS = {field.name for field in fields(RunSignal) if field.type is float}
_TEXTS = {field.name for field in fields(RunSignal)} - _NUMBERS

Signals = dict[str, RunSignal]


def read_channels(file: Any) -> dict[str, Signals]:
    """Return the signals of each channel device of an open run file, by the device's and the signal's name.

    Raises `Unlike` if a signal is described in another way, or a quantity belongs to two signals.
    """
    found = {
        name: {
            signal: _read(signal, known)
            for signal, known in signals_of(file["entry"][schema.CHANNELS_GROUP][name]).items()
        }
        for name in channel_names(file)
    }
    names = [name for signals in found.values() for name in signals]
    taken = [signal.quantity for signals in found.values() for signal in signals.values() if signal.quantity]
    for what, values in (("a signal named", names), ("a signal for the", taken)):
        if len(set(values)) < len(values):
            raise Unlike(f"{what} {max(values, key=values.count)} twice")
    return found


def _read(name: str, known: Any) -> RunSignal:
    if not isinstance(known, dict) or not known.keys() >= _NUMBERS | _TEXTS:
        raise Unlike(f"the signal {name} without some of {', '.join(sorted(_NUMBERS | _TEXTS))}")
    if not all(isinstance(known[text], str) for text in _TEXTS) or known["quantity"] not in QUANTITIES:
        raise Unlike(f"the signal {name} with the unit {known['unit']!r} of {known['quantity']!r}")
    values: dict[str, Any] = {number: float(known[number]) for number in _NUMBERS}
    signal = RunSignal(**values, **{text: known[text] for text in _TEXTS})
    times = signal.delay_s, signal.delay_std_s, signal.std
    if not (signal.low < signal.high and all(isfinite(each) and each >= 0.0 for each in times)):
        raise Unlike(f"the signal {name} with an impossible range, delay or deviation")
    return signal
