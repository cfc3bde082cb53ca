"""Settings of live gauges: when a value may be used, and how far points are followed."""

from dic.errors import GaugeError
from dic.settings import Number, Whole, setting, settings_class


@settings_class(GaugeError)
class LiveSettings:
    """Settings of live gauges."""

    least_share: Number = setting(
        "least share of points",
        "Smallest share of a gauge's points with a displacement for a valid value.",
        default=0.8,
        expected="from 0.5 to 1",
        remedy="give 0.8",
        more="Below one half there is no value at all, as offline.",
        ge=0.5,
        le=1.0,
    )
    most_saturated: Number = setting(
        "most saturated pixels",
        "Largest share of saturated pixels around a gauge's points, above the share in the reference.",
        default=0.02,
        expected="from 0 to 1",
        remedy="give 0.02",
        ge=0.0,
        le=1.0,
    )
    least_contrast: Number = setting(
        "least contrast",
        "Smallest contrast around a gauge's points, as a share of that in the reference.",
        default=0.3,
        expected="from 0 to 1",
        remedy="give 0.3",
        more="The contrast is the standard deviation of the grey levels.",
        ge=0.0,
        le=1.0,
    )
    most_strain_per_s: Number = setting(
        "greatest strain rate",
        "Greatest strain rate that is credible, 1/s: a strain that changes faster is not valid.",
        default=0.05,
        expected="above 0",
        remedy="give about five times the strain rate that the machine can cause in the gauge, such as 0.05",
        more="A change by six standard deviations of the noise is always credible.",
        unit="1/s",
        gt=0.0,
    )
    confirming_frames: Whole = setting(
        "confirming frames",
        "Number of frames in succession that must agree with one another before a jump is believed.",
        default=5,
        expected="a whole number, at least 1",
        remedy="give 5",
        ge=1,
    )
    most_age_s: Number = setting(
        "greatest age of a correction",
        "Greatest age of the motion out of the plane with which a strain is corrected, s.",
        default=5.0,
        expected="above 0 s",
        remedy="give 5, several times the interval at which the field is solved",
        unit="s",
        gt=0.0,
    )
    room_px: Whole = setting(
        "room",
        "Distance around the expected places of subsets within which they are followed, px.",
        default=6,
        expected="from 2 to 100 px",
        remedy="give 6, more if the specimen moves by more than some px from frame to frame",
        ge=2,
        le=100,
    )
    most_iterations: Whole = setting(
        "iterations",
        "Largest number of iterations at a point in one frame.",
        default=15,
        expected="a whole number, at least 3",
        remedy="give 15",
        more="It bounds the time of a frame in which all points fail.",
        ge=3,
    )
    search_px: Whole = setting(
        "search",
        "Distance within which one lost point is searched in each frame, px; 0 for no search.",
        default=24,
        expected="from 0 to 100 px",
        remedy="give 24",
        ge=0,
        le=100,
    )
