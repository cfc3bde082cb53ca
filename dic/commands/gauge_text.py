"""The lines that `dic gauges`, `dic correlate` and `dic process` print about gauges."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import dic
from dic.files import left_out_text, shown

_NAME_WIDTH, _CELL_WIDTH, _MOST_WIDTH = 24, 19, 100


def gauge_lines(series: dic.gauges.GaugeSeries) -> Iterator[str]:
    """Yield a line about each gauge, and a table of all gauges' strains, at most 100 characters wide.

    If there are many gauges, the table has several parts.
    """
    for gauge in series.gauges:
        yield f"{gauge.name}: {_about(series.images, gauge.name, gauge.kind)}"
    names = [gauge.name for gauge in series.gauges if gauge.kind != "cut"]
    labels = [_label(image) for image in series.images]
    width = min(_NAME_WIDTH, max(map(len, ("image", *labels))))
    each = max(1, (_MOST_WIDTH - width - 3) // (_CELL_WIDTH + 1))
    for first in range(0, len(names), each):
        some = names[first : first + each]
        heading = " ".join(f"{_cut(name, _CELL_WIDTH):>{_CELL_WIDTH}}" for name in some)
        yield f"{'image':<{width}} {heading}  µε"
        printed = shown(len(labels)) if series.run is not None else range(len(labels))
        for k, (image, label) in enumerate(zip(series.images, labels, strict=True)):
            if k not in printed and k - 1 in printed:
                yield left_out_text(len(labels), "the table of gauges has")
            if k in printed and image.failure is None:
                cells = " ".join(f"{_cell(image.best(name)[1]):>{_CELL_WIDTH}}" for name in some)
                yield f"{_cut(label, width):<{width}} {cells}"


def joined_line(joined: dic.records.JoinedRecord) -> str:
    """Return a line that says how a machine's record was joined to the images."""
    return f"load: {joined.text}"


def gauges_dict(series: dic.gauges.GaugeSeries) -> dict[str, Any]:
    """Return `gauges` and `gauge_readings` for the JSON file of a command that measures images."""
    content = series.as_dict()
    return {"gauges": content["gauges"], "gauge_readings": content["images"]}


def _about(images: Sequence[dic.gauges.GaugeImage], name: str, kind: str) -> str:
    """Return a gauge's kind of strain, length and number of points, from the first image with a reading."""
    measured = [image.best(name) for image in images if image.failure is None]
    read = [one for one in measured if not one[1].reason]
    if not read:
        return f"{kind}, no reading" + (f": {measured[0][1].reason}" if measured else "")
    best, first = read[0]
    if kind == "cut":
        length = f"{first.distance[-1]:.6g} {first.distance_unit}"
        return f"{kind}, {best}, {len(first.distance)} places over {length}"
    lines = "" if first.lines is None else f", {first.lines} lines"
    return f"{kind}, {best}, gauge length {first.length:.6g} {first.unit}{lines}, {first.points} points"


def _label(image: dic.gauges.GaugeImage) -> str:
    parts = [str(image.known[key]) for key in ("camera", "step") if key in image.known]
    return " ".join(parts) or Path(image.label).name


def _cell(reading: Any) -> str:
    if reading.reason:
        return "–"
    strain, std = 1e6 * reading.strain, 1e6 * reading.strain_std
    digits = 1 if std < 9.5 else 0
    return f"{strain:z.{digits}f}" + ("" if std != std else f" ± {std:.{digits}f}")


def _cut(text: str, width: int) -> str:
    return text if len(text) <= width else "…" + text[1 - width :]
