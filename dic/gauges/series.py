"""The readings of gauges in all images of a series."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from dic.errors import GaugeError
from dic.gauges.declared import Gauge
from dic.gauges.placed import Readings
from dic.gauges.reading import Reading
from dic.typing import Float

if TYPE_CHECKING:
    from dic.gauges.channel import GaugeChannel
    from dic.records.joining import JoinedRecord
    from dic.runfile.reader import RunInfo

KINDS = ("corrected", "calibrated", "raw")
"""Kinds of strain, from the most accurate to the least accurate."""


@dataclass(frozen=True)
class GaugeImage:
    """The readings of all gauges in one image.

    Attributes
    ----------
    label : str
        The path of the image file, or the run's step to which the image belongs.
    readings : mapping of str to mapping of str to (Reading or Profile)
        Keyed by the gauge's name, and then by "raw", "calibrated" or "corrected". Empty if the image could
        not be measured.
    known : mapping of str to (str or float)
        Further data of the image. In a series: time_s and time_source. In a run: camera, step, the readings
        and the values of channels (`RunStep.known`).
    failure : str or None
        The reason why the image could not be measured.
    digest : str
        SHA-256 of the image's file or frames; "" if it is not known.
    """

    label: str
    readings: Readings = field(default_factory=dict)
    known: Mapping[str, Any] = field(default_factory=dict)
    failure: str | None = None
    digest: str = ""

    def best(self, gauge: str) -> tuple[str, Any]:
        """Return the best kind of strain for which the image has a reading of a gauge, and this reading."""
        own = self.readings[gauge]
        kind = next(kind for kind in KINDS if kind in own)
        return kind, own[kind]


@dataclass(frozen=True)
class GaugeSeries:
    """The readings of gauges in all images of a series.

    Attributes
    ----------
    source : str
        The result file, or "" for a series in memory.
    gauges : tuple of Gauge
    images : tuple of GaugeImage
    in_order : bool
        False if images that could not be measured may be at a wrong place in the list: result files of
        earlier versions list them at the end.
    run : RunInfo or None
        The run that the images belong to; None for a series of images.
    reference_digest : str
        SHA-256 of the file of the reference image; "" for a run or a series in memory.
    contents : tuple of str
        For each image, also if it could not be measured, a text that identifies its content; see
        `dic.results.job.content_of`. Empty for a run, a series in memory, or a file of an earlier version.
    reference : str
        Name of the reference image; "" for a run or a series in memory.
    joined : JoinedRecord or None
        How the record of a testing machine was joined to the images; None if none was.
    channels : mapping of str to GaugeChannel
        The channels of a run, by names such as "channels.oven".
    """

    source: str
    gauges: tuple[Gauge, ...]
    images: tuple[GaugeImage, ...]
    in_order: bool = True
    run: "RunInfo | None" = None
    reference_digest: str = ""
    contents: tuple[str, ...] = ()
    reference: str = ""
    joined: "JoinedRecord | None" = None
    channels: Mapping[str, "GaugeChannel"] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"GaugeSeries({', '.join(gauge.name for gauge in self.gauges)}; {len(self.images)} images)"

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of strain for which at least one image has readings, the best kind first."""
        present = {kind for image in self.images for own in image.readings.values() for kind in own}
        return tuple(kind for kind in KINDS if kind in present)

    @property
    def complete(self) -> bool:
        """True if every gauge has a reading of its best kind of strain in every image."""
        return all(
            image.failure is None and not any(image.best(gauge.name)[1].reason for gauge in self.gauges)
            for image in self.images
        )

    def strain(self, gauge: str, kind: str | None = None) -> tuple[Float, Float]:
        """Return the engineering strain of a gauge in all images, and its standard deviation.

        Parameters
        ----------
        gauge : str
            Name of a gauge that is not a line cut.
        kind : str, optional
            "raw", "calibrated" or "corrected". Default: the best kind that any image has.

        Returns
        -------
        strain, std : ndarray, shape (images,)
            NaN where there is no reading of this kind.

        Raises
        ------
        GaugeError
            If there is no such gauge or kind.
        """
        found = self._readings(gauge, kind)
        return np.array([one.strain for one in found]), np.array([one.strain_std for one in found])

    def _readings(self, gauge: str, kind: str | None) -> list[Reading]:
        if not self.kinds:
            remedy = "measure at least one image"
            raise GaugeError(
                self.source or "gauges", "read", "an image that could be measured", "none", remedy
            )
        names = [one.name for one in self.gauges if one.kind != "cut"]
        checks = ((gauge, names, "gauge"), (kind or self.kinds[0], list(self.kinds), "kind of strain"))
        for value, known, what in checks:
            if value not in known:
                expected, remedy = f"one of {', '.join(known)}", f"give {known[0] if known else 'another'}"
                raise GaugeError(self.source or "gauges", f"choose a {what}", expected, repr(value), remedy)
        chosen = kind or self.kinds[0]
        found = [image.readings.get(gauge, {}).get(chosen) for image in self.images]
        return [one if isinstance(one, Reading) else Reading("") for one in found]

    def as_dict(self) -> dict[str, Any]:
        """Return gauges and readings for JSON; `docs/gauges.md` explains the keys."""
        return {
            "results": self.source,
            "gauges": [declaration(gauge) for gauge in self.gauges],
            "images": [image_dict(image) for image in self.images],
        }


def declaration(gauge: Gauge) -> dict[str, Any]:
    """Return a gauge as it was declared, for JSON."""
    values = {item.name: getattr(gauge, item.name) for item in fields(gauge)}
    return {"name": gauge.name, "kind": gauge.kind} | {
        name: value for name, value in values.items() if value is not None and name != "name"
    }


def image_dict(image: GaugeImage) -> dict[str, Any]:
    """Return the readings of an image for JSON."""
    readings = {
        gauge: {kind: one.as_dict() for kind, one in own.items()} for gauge, own in image.readings.items()
    }
    known = {name: None if value != value else value for name, value in image.known.items()}
    return {"file": image.label} | known | {"gauges": readings, "error": image.failure}
