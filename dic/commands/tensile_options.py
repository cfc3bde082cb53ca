"""Options that describe a tensile test, for `dic properties` and `dic report`."""

from dic.commands.options import Chosen, use
from dic.errors import CurveError
from dic.properties import PropertySettings

tensile_options = use("test", PropertySettings)


def tensile_settings(test: Chosen[PropertySettings], known_mm2: float | None = None) -> PropertySettings:
    """Return the settings of a tensile test. Rp0.2 is always among the properties.

    `known_mm2`: area that is used if the option is not given, such as the area in a run's protocol.

    Raises `CurveError` if the area is not known, or a setting is not possible.
    """
    area_mm2 = test.values["area_mm2"]
    area_mm2 = known_mm2 if area_mm2 is None else area_mm2
    if area_mm2 is None:
        expected, remedy = "the area of the cross-section", "give --area-mm2 120, width times thickness"
        raise CurveError("settings", "--area-mm2", expected, "none", remedy)
    offsets = tuple(dict.fromkeys((0.2, *test.values["offsets_percent"])))
    return test.settings(area_mm2=area_mm2, offsets_percent=offsets)
