"""The report's table of analysis settings, as in the iDICs Good Practices Guide."""

from collections.abc import Sequence

from dic.report.camera_images import ReportedImages, Results
from dic.report.fact_table import Fact, FactTable, table_of
from dic.report.hardware import results_file
from dic.report.tables import SOURCES, resolution_text
from dic.strain.measures import MEASURES
from dic.strain.strain import length_text


def analysis_table(images: Sequence[ReportedImages], result: Results) -> FactTable:
    """Return the settings of correlation and strain of each camera, as the results contain them."""
    origin, software = result.provenance, Fact()
    if origin is not None:
        name = origin.versions.partition(",")[0]
        software = Fact(name, results_file(result), "provenance", "versions of the command that measured")
    columns = [{"Software": software} | _settings(each, results_file(result)) for each in images]
    return table_of([each.camera for each in images], columns)


def _settings(images: ReportedImages, file: str) -> dict[str, Fact]:
    first = images.first_measured
    if first is None or first.measurement is None:
        return {}
    measurement = first.measurement
    settings, strain, field = measurement.settings, measurement.strain_settings, measurement.field
    smoothing = f"Gaussian, standard deviation {field.smoothing_px:.2g} px" if field.smoothing_px else "none"
    gauge, calibration, model = f"{measurement.gauge_px} px", images.calibration, "none"
    if calibration is not None:
        model = f"{calibration.model}, {calibration.grid.found} points"
        across, along = (length_text(measurement.gauge_px * each) for each in calibration.axes_mm_per_px)
        gauge += f", {across} × {along}"
    criterion = "zero-mean normalised sum of squared differences (ZNSSD), inverse compositional Gauss–Newton;"
    rows = {
        "Image filtering": (smoothing, "smoothing_px"),
        "Subset size": (f"{settings.subset_px} px", "subset_px"),
        "Step size": (f"{settings.step_px} px", "step_px"),
        "Subset shape function": (settings.shape, "shape"),
        "Matching criterion": (f"{criterion} points with ZNCC ≥ {settings.min_zncc:g}", "min_zncc"),
        "Interpolant": (f"B-spline of order {settings.order}", "order"),
        "Strain window": (SOURCES[strain.source].format(strain.window_points), "strain_window_points"),
        "Virtual strain gauge size": (gauge, "(window − 1) × step + subset, times the scale of the image"),
        "Spatial resolution": (resolution_text(measurement), "amplitude of a wave after subset and window"),
        "Strain formulation": (
            f"{MEASURES[strain.measure].title} in maps; engineering strain of gauges",
            "strain_measure",
        ),
        "Filtering of strain": ("none beyond the strain window", "strain_source"),
        "Points": (f"{int(field.active.sum())} in the region of interest", "number of active points"),
    }
    found = {name: Fact(text, file, f"series of {first.label}", rule) for name, (text, rule) in rows.items()}
    return found | {"Calibration": Fact(model, file, "calibration", "model and number of grid points")}
