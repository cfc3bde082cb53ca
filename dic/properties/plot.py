"""A picture of the stress-strain curve with the elastic line, the offset lines and the named values."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from dic.errors import require_kind
from dic.files.writing import write_figure
from dic.properties.elastic import Elastic
from dic.properties.properties import Properties, offset_key
from dic.typing import Float, PathLike

_NAMES = {"ReH_mpa": "ReH", "ReL_mpa": "ReL", "Rm_mpa": "Rm"}
_MARKS = {"ReH_mpa": ("^", "#d55e00"), "ReL_mpa": ("v", "#009e73"), "Rm_mpa": ("s", "#000000")}
"""Symbol and colour of each mark; the colours of Okabe and Ito suit colour-blind people."""
_LINE, _OFFSET, _RECORD = "#0072b2", "#cc79a7", "0.45"
_SHAPES = "oDP*X"
"""Symbols of the marks of several offset strengths."""
_BOX = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0}
_BESIDE = (14.0, 0.0)
"""Distance of a name to the right of the elastic line, points."""
_RIGHT_SHARE, _BELOW_SHARE, _LINE_SHARE = 0.98, 0.1, 0.075
"""Right end of names, distance of the highest name below the lowest mark, and distance between two names, as
shares of the axes."""
_MOST_DOTS = 200
"""The points of longer records are not marked one by one."""


@dataclass(frozen=True)
class _Mark:
    """A mark in the chart: its place (strain in %, stress in MPa), its name and its colour."""

    at: tuple[float, float]
    text: str
    colour: str


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
    # Rm may be larger than all stresses with a strain.
    strength = properties.values["Rm_mpa"].value
    shown = stress if strength is None else np.append(stress, strength)
    whole.set(title="whole record of strain", ylim=_with_room(shown, 0.12))
    for mark in _draw_extreme(whole, properties, strain, "Rm_mpa"):
        _name_above(whole, mark)
    if elastic is None:
        beginning.set_title("no elastic line was found")
        return figure
    _draw_beginning(beginning, properties, elastic, strain, stress)
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


def _draw_beginning(
    axes: Any, properties: Properties, elastic: Elastic, strain: Float, stress: Float
) -> None:
    """Draw the elastic line, its window, the offset lines and the marks of yielding, each with its name."""
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
    axes.annotate(
        name, (middle / slope, middle), _BESIDE, textcoords="offset points", color=_LINE, va="center",
        bbox=_BOX, fontsize=9,
    )  # fmt: skip
    marks = []
    for order, offset in enumerate(sorted(properties.settings.offsets_percent)):
        marks += _draw_offset(axes, properties, offset, (slope, top), order)
    for extreme in ("ReH_mpa", "ReL_mpa"):
        marks += _draw_extreme(axes, properties, strain, extreme)
    _name_below(axes, marks)


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


def _draw_offset(
    axes: Any, properties: Properties, offset: float, line: tuple[float, float], order: int
) -> list[_Mark]:
    """Draw the line of an offset with the slope and up to the stress of `line`, and its intersection."""
    key, (slope, top) = offset_key(offset), line
    axes.plot([offset, offset + top / slope], [0, top], "--", color=_OFFSET, linewidth=1)
    value = properties.values[key]
    if value.value is None:
        return []
    at = (value.window["strain_percent"], value.value)
    axes.plot(*at, _SHAPES[order % len(_SHAPES)], color=_OFFSET)
    return [_Mark(at, _text(properties, key, f"Rp{offset:g}"), _OFFSET)]


def _draw_extreme(axes: Any, properties: Properties, strain: Float, name: str) -> list[_Mark]:
    """Draw the mark of an extreme stress."""
    value = properties.values[name]
    sign, colour = _MARKS[name]
    at = value.window.get("point")
    if value.value is None:
        return []
    text = _text(properties, name, _NAMES[name])
    if at is not None and at < len(strain):
        axes.plot(strain[at], value.value, sign, color=colour)
        return [_Mark((float(strain[at]), value.value), text, colour)]
    axes.axhline(value.value, color=colour, linewidth=0.8, linestyle=":")
    return [_Mark((0.5 * float(strain.max()), value.value), f"{text}, strain not known", colour)]


def _name_below(axes: Any, marks: list[_Mark]) -> None:
    """Write the names of marks one below the other in the free area below the curve, with lines to the marks.

    The mark farthest to the right has the highest name, so that the lines do not cross.
    """
    low, high = axes.get_ylim()
    highest = min((mark.at[1] - low) / (high - low) for mark in marks) - _BELOW_SHARE if marks else 0.0
    for order, mark in enumerate(sorted(marks, key=lambda one: -one.at[0])):
        place = (_RIGHT_SHARE, highest - order * _LINE_SHARE)
        axes.annotate(
            mark.text, mark.at, place, textcoords="axes fraction", color=_ink(mark.colour), ha="right",
            va="center", bbox=_BOX, fontsize=9,
            arrowprops={"arrowstyle": "-", "color": mark.colour, "linewidth": 0.7, "shrinkB": 4.0},
        )  # fmt: skip


def _name_above(axes: Any, mark: _Mark) -> None:
    """Write the name of a mark above it, on the side where the name stays inside the axes."""
    low, high = axes.get_xlim()
    share = (mark.at[0] - low) / (high - low)
    side = "left" if share < 0.25 else "right" if share > 0.75 else "center"
    axes.annotate(
        mark.text, mark.at, (0.0, 9.0), textcoords="offset points", color=_ink(mark.colour), ha=side,
        va="center", bbox=_BOX, fontsize=9,
    )  # fmt: skip


def _ink(colour: str) -> str:
    """Return a colour that is dark enough for text."""
    return {_OFFSET: "#8f3f6c", "#009e73": "#00704f"}.get(colour, colour)


def _text(properties: Properties, name: str, label: str) -> str:
    value = properties.values[name]
    return f"{label} = {value.value:.1f} {value.unit}"
