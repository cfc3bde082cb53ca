"""A picture of the stress-strain curve with elastic line, offset lines and marks at the properties."""

from typing import Any

import numpy as np

from dic.errors import require_kind
from dic.files.writing import write_figure
from dic.properties.properties import Properties, offset_key
from dic.typing import PathLike

_MARKS = {
    "ReH_mpa": ("ReH", "^", "#d55e00"),
    "ReL_mpa": ("ReL", "v", "#009e73"),
    "Rm_mpa": ("Rm", "s", "#000000"),
}
"""Label, symbol and colour of each mark; the colours of Okabe and Ito suit colour-blind people."""
_LINE, _OFFSET = "#0072b2", "#cc79a7"


def draw_properties(properties: Properties) -> Any:
    """Return a matplotlib figure: the whole curve, and its beginning with the elastic line."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 5.2), layout="constrained")
    whole, beginning = figure.subplots(1, 2)
    record, elastic = properties.record, properties.elastic
    foot = elastic.foot if elastic is not None else 0.0
    strain, stress = 100 * (record.strain - foot), record.strained_stress
    for axes in (whole, beginning):
        axes.plot(strain, stress, color="0.45", linewidth=1.2, label="record")
        axes.set(xlabel="strain after correction of the foot, %", ylabel="stress, MPa")
        axes.grid(alpha=0.3)
    _mark(whole, properties, strain, ("Rm_mpa", "ReH_mpa", "ReL_mpa"))
    whole.set_title("whole record of strain")
    if elastic is None:
        beginning.set_title("no elastic line was found")
        whole.legend(loc="lower right")
        return figure
    reach = _reach(properties, strain)
    inside = (strain <= reach) & (np.arange(len(strain)) <= max(int(np.argmax(stress)), 1))
    top = 1.12 * float(stress[inside].max())
    slope = elastic.line.slope / 100.0
    beginning.plot(
        [0, top / slope], [0, top], color=_LINE, linewidth=1, label=_text(properties, "E_gpa", "E")
    )
    part = slice(elastic.line.first, elastic.line.stop)
    beginning.plot(strain[part], stress[part], color=_LINE, linewidth=4, alpha=0.5, label="window of E")
    for offset in properties.settings.offsets_percent:
        _draw_offset(beginning, properties, offset, top)
    _mark(beginning, properties, strain, ("ReH_mpa", "ReL_mpa"))
    beginning.set(xlim=(-0.03 * reach, reach), ylim=(min(0.0, float(stress.min())), top), title="beginning")
    for axes in (whole, beginning):
        axes.legend(loc="lower right")
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


def _reach(properties: Properties, strain: Any) -> float:
    """Return the strain in % up to which the beginning of the curve is drawn."""
    ends = [2.0 * max(properties.settings.offsets_percent)]
    for offset in properties.settings.offsets_percent:
        at = properties.values[offset_key(offset)].window.get("strain_percent")
        ends += [2.0 * at] if at is not None else []
    if properties.plateau is not None:
        ends.append(1.25 * float(strain[properties.plateau.last]))
    return float(min(max(ends), strain.max()))


def _draw_offset(axes: Any, properties: Properties, offset: float, top: float) -> None:
    elastic = properties.elastic
    if elastic is None:
        return
    key = offset_key(offset)
    slope = elastic.line.slope / 100.0
    axes.plot([offset, offset + top / slope], [0, top], "--", color=_OFFSET, linewidth=1)
    value = properties.values[key]
    if value.value is not None:
        label = _text(properties, key, f"Rp{offset:g}")
        axes.plot(value.window["strain_percent"], value.value, "o", color=_OFFSET, label=label)


def _mark(axes: Any, properties: Properties, strain: Any, names: tuple[str, ...]) -> None:
    for name in names:
        value = properties.values[name]
        label, sign, colour = _MARKS[name]
        at = value.window.get("point")
        if value.value is None or at is None:
            continue
        text = _text(properties, name, label)
        if at < len(strain):
            axes.plot(strain[at], value.value, sign, color=colour, label=text)
        else:
            axes.axhline(
                value.value, color=colour, linewidth=0.8, linestyle=":", label=f"{text}, strain not known"
            )


def _text(properties: Properties, name: str, label: str) -> str:
    value = properties.values[name]
    return f"{label} = {value.value:.1f} {value.unit}"
