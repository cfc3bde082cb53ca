"""A picture of the stress-strain curve with the elastic line, the offset lines and the named values."""

from typing import Any

import numpy as np

from dic.errors import require_kind
from dic.files.writing import write_figure
from dic.properties.properties import Properties, offset_key
from dic.typing import Float, PathLike

_NAMES = {"ReH_mpa": "ReH", "ReL_mpa": "ReL", "Rm_mpa": "Rm"}
_MARKS = {"ReH_mpa": ("^", "#d55e00"), "ReL_mpa": ("v", "#009e73"), "Rm_mpa": ("s", "#000000")}
"""Symbol and colour of each mark; the colours of Okabe and Ito suit colour-blind people."""
_LINE, _OFFSET, _RECORD = "#0072b2", "#cc79a7", "0.45"
_SHAPES = "oDP*X"
"""Symbols of the marks of several offset strengths."""
_BOX = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0}
_BELOW = (12.0, -16.0)
"""Distance of a name from its mark to the right and upwards, points: the area below the curve is free."""
_BETWEEN = 15.0
"""Distance of the names of several marks from each other, points."""
_MOST_DOTS = 200
"""The points of longer records are not marked one by one."""


def draw_properties(properties: Properties) -> Any:
    """Return a matplotlib figure: the whole curve, and its beginning with the elastic line."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 5.2), layout="constrained")
    whole, beginning = figure.subplots(1, 2)
    record, elastic = properties.record, properties.elastic
    foot = elastic.foot if elastic is not None else 0.0
    strain, stress = 100 * (record.strain - foot), record.strained_stress
    for axes in (whole, beginning):
        points = {"marker": ".", "markersize": 4} if len(strain) <= _MOST_DOTS else {}
        axes.plot(strain, stress, color=_RECORD, linewidth=1.2, **points)
        axes.set(xlabel="strain after correction of the foot, %", ylabel="stress, MPa")
        axes.grid(alpha=0.3)
    whole.set(title="whole record of strain", ylim=_with_room(stress, 0.12))
    _mark(whole, properties, strain, ("Rm_mpa",))
    if elastic is None:
        beginning.set_title("no elastic line was found")
        return figure
    _draw_beginning(beginning, properties, strain, stress)
    return figure


def plot_properties(properties: Properties, path: PathLike) -> None:
    """Write the figure of a stress-strain curve and its properties as a PNG file.

    Parameters
    ----------
    properties : Properties
        From `material_properties`.
    path : path
    """
    require_kind("properties", properties, Properties, "compute them with dic.material_properties")
    write_figure(draw_properties(properties), path, 120, "png")


def _draw_beginning(axes: Any, properties: Properties, strain: Float, stress: Float) -> None:
    """Draw the elastic line, its window, the offset lines and the marks of yielding, each with its name."""
    elastic = properties.elastic
    if elastic is None:
        return
    reach = _reach(properties, strain)
    inside = (strain <= reach) & (np.arange(len(strain)) <= max(int(np.argmax(stress)), 1))
    low, top = _with_room(stress[inside], 0.15)
    slope = elastic.line.slope / 100.0
    axes.plot([0, top / slope], [0, top], color=_LINE, linewidth=1)
    part = slice(elastic.line.first, elastic.line.stop)
    axes.plot(strain[part], stress[part], color=_LINE, linewidth=4, alpha=0.5)
    axes.set(xlim=(-0.03 * reach, reach), ylim=(low, top), title="beginning")
    middle = 0.4 * float(stress[part].max())
    name = f"{_text(properties, 'E_gpa', 'E')}\n(thick: its window)"
    _name(axes, (middle / slope, middle), name, _LINE, (14.0, 0.0))
    for order, offset in enumerate(sorted(properties.settings.offsets_percent)):
        _draw_offset(axes, properties, offset, top, order)
    _mark(axes, properties, strain, ("ReH_mpa", "ReL_mpa"))


def _with_room(stress: Float, share: float) -> tuple[float, float]:
    """Return the limits of an axis of stress, with room for names above the curve."""
    low, high = min(0.0, float(stress.min())), float(stress.max())
    return low - 0.02 * (high - low), high + share * (high - low)


def _reach(properties: Properties, strain: Float) -> float:
    """Return the strain in % up to which the beginning of the curve is drawn."""
    ends = [2.0 * max(properties.settings.offsets_percent)]
    for offset in properties.settings.offsets_percent:
        at = properties.values[offset_key(offset)].window.get("strain_percent")
        ends += [2.0 * at] if at is not None else []
    if properties.plateau is not None:
        ends.append(1.25 * float(strain[properties.plateau.last]))
    return float(min(max(ends), strain.max()))


def _draw_offset(axes: Any, properties: Properties, offset: float, top: float, order: int) -> None:
    elastic = properties.elastic
    if elastic is None:
        return
    key = offset_key(offset)
    slope = elastic.line.slope / 100.0
    axes.plot([offset, offset + top / slope], [0, top], "--", color=_OFFSET, linewidth=1)
    value = properties.values[key]
    if value.value is not None:
        at = (value.window["strain_percent"], value.value)
        axes.plot(*at, _SHAPES[order % len(_SHAPES)], color=_OFFSET)
        away = _BELOW[0], _BELOW[1] - _BETWEEN * order
        _name(axes, at, _text(properties, key, f"Rp{offset:g}"), _OFFSET, away)


def _mark(axes: Any, properties: Properties, strain: Float, names: tuple[str, ...]) -> None:
    """Draw the marks of extreme stresses, each with its name."""
    for name in names:
        value = properties.values[name]
        sign, colour = _MARKS[name]
        at = value.window.get("point")
        if value.value is None or at is None:
            continue
        text = _text(properties, name, _NAMES[name])
        if at < len(strain):
            axes.plot(strain[at], value.value, sign, color=colour)
            # Nothing lies above a maximum, and nothing below a minimum after it.
            away = _BELOW if name == "ReL_mpa" else (0.0, 9.0)
            _name(axes, (strain[at], value.value), text, colour, away)
        else:
            axes.axhline(value.value, color=colour, linewidth=0.8, linestyle=":")
            place = (0.5 * float(strain.max()), value.value)
            _name(axes, place, f"{text}, strain not known", colour, (0.0, 9.0))


def _name(axes: Any, at: tuple[float, float], text: str, colour: str, away_pt: tuple[float, float]) -> None:
    """Write a name beside a place of the chart, on the side where the name stays inside the axes."""
    low, high = axes.get_xlim()
    share = (at[0] - low) / (high - low)
    side = "left" if share < 0.25 else "right" if share > 0.75 else "center"
    if away_pt[0]:  # beside its mark
        side = "left" if share < 0.8 else "right"
        away_pt = (away_pt[0] if side == "left" else -away_pt[0], away_pt[1])
    axes.annotate(
        text, at, away_pt, textcoords="offset points", color=_ink(colour), ha=side, va="center", bbox=_BOX,
        fontsize=9,
    )  # fmt: skip


def _ink(colour: str) -> str:
    """Return a colour that is dark enough for text."""
    return {_OFFSET: "#8f3f6c", "#009e73": "#00704f"}.get(colour, colour)


def _text(properties: Properties, name: str, label: str) -> str:
    value = properties.values[name]
    return f"{label} = {value.value:.1f} {value.unit}"
