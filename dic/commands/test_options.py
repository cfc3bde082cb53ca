"""Options that describe a tensile test, for `dic properties` and `dic report`."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import click

from dic.commands.option_groups import option_group

if TYPE_CHECKING:
    from dic import PropertySettings


@dataclass(frozen=True)
class TestOptions:
    """Options for the specimen's area, the uncertainties, and the rules of the evaluation."""

    area_mm2: float | None
    area_std_mm2: float | None
    load_std_percent: float | None
    strain_std_percent: float | None
    offset_percent: tuple[float, ...]
    window_mpa: tuple[float, float] | None
    hardening_percent: tuple[float, float]

    def settings(self, known_mm2: float | None = None) -> "PropertySettings":
        """Return the settings. Rp0.2 is always among the properties.

        Parameters
        ----------
        known_mm2 : float, optional
            Area that is used if the option is not given, such as the area in a run's protocol.

        Raises
        ------
        CurveError
            If the area is not known, or a setting is not possible.
        """
        from dic import CurveError, PropertySettings

        area_mm2 = known_mm2 if self.area_mm2 is None else self.area_mm2
        if area_mm2 is None:
            expected, remedy = "the area of the cross-section", "give --area-mm2 120, width times thickness"
            raise CurveError("settings", "--area-mm2", expected, "none", remedy)
        return PropertySettings(
            area_mm2=area_mm2,
            area_std_mm2=self.area_std_mm2,
            load_std_percent=self.load_std_percent,
            strain_std_percent=self.strain_std_percent,
            offsets_percent=tuple(dict.fromkeys((0.2, *self.offset_percent))),
            window_mpa=self.window_mpa,
            hardening_percent=self.hardening_percent,
        )


test_options = option_group(
    "test",
    TestOptions,
    click.option("--area-mm2", type=float, help="Area of the cross-section before the test, mm²."),
    click.option("--area-std-mm2", type=float, help="Standard deviation of the area, mm²."),
    click.option(
        "--load-std-percent", type=float, help="Standard deviation of the load cell, % of the load."
    ),
    click.option(
        "--strain-std-percent",
        type=float,
        help="Standard deviation of the strain's calibration, % of the strain.",
    ),
    click.option(
        "--offset-percent",
        type=float,
        multiple=True,
        help="Another offset of Rp beside 0.2 %; may be repeated.",
    ),
    click.option(
        "--window-mpa",
        type=(float, float),
        metavar="LOW HIGH",
        help="Fit E between two stresses instead of in the objective window.",
    ),
    click.option(
        "--hardening-percent",
        type=(float, float),
        default=(10.0, 20.0),
        show_default=True,
        metavar="LOW HIGH",
        help="Strains between which n and r are fitted, %.",
    ),
)
