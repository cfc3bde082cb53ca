"""Off-axis two-dimensional digital image correlation: images in, calibrated fields and strains out.

This package exports all public names. Each name is loaded from its module at its first use:

>>> import dic
>>> series = dic.measure_images("reference.tif", ["deformed.tif"], calibration="calibration.h5")
>>> series.images[0].mean.exx

Images are arrays of shape (height, width) or files. Results are frozen dataclasses. A measurement that fails
raises a `MeasurementError`, whose message is one sentence that ends with a remedy.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dic.assessment.assessment import Assessment, assess_method
    from dic.assessment.plots import plot_assessment
    from dic.calibration.bicubic import BicubicMap
    from dic.calibration.calibration import Calibration
    from dic.calibration.file import load_calibration, save_calibration
    from dic.calibration.pinhole.camera import Pinhole
    from dic.calibration.pinhole.prior import KnownCamera
    from dic.calibration.plot import plot_calibration
    from dic.calibration.residuals import Residuals
    from dic.campaigns.campaign import Campaign, SpecimenTest, compare_specimens
    from dic.campaigns.file import list_specimens, read_campaign
    from dic.campaigns.specimen import CampaignSpecimen, CurveColumns, GaugeChoice, measure_campaign
    from dic.campaigns.table import write_campaign_table
    from dic.comparison.difference import Comparison, Difference
    from dic.comparison.peer import PeerField
    from dic.comparison.read import read_peer
    from dic.correlation.correlator import Correlator
    from dic.correlation.field import Field
    from dic.correlation.initial_guess import rigid_motion
    from dic.correlation.series import Series
    from dic.correlation.settings import CorrelationSettings, ReferenceSettings
    from dic.correlation.status import Status
    from dic.derived.animation import Animation, write_animation
    from dic.derived.compared import compare_results
    from dic.derived.export import Export, export_results
    from dic.derived.export_tables import to_pandas, to_xarray
    from dic.derived.gauge_record import GaugeCurve, ImageClock, gauge_curve, join_record
    from dic.derived.gauge_series import measure_gauges, write_gauge_picture
    from dic.derived.whole_field import whole_field_gauges
    from dic.drawing.page import write_drawing_page
    from dic.errors import (
        CalibrationError,
        CorrelationError,
        CurveError,
        GaugeError,
        ImageError,
        MeasurementError,
        OutputError,
        RunFileError,
        WorkerError,
    )
    from dic.example.copy import write_example
    from dic.exports.formats import EXPORTS
    from dic.exports.tensile_ontology import AboutTest, write_tensile_ontology
    from dic.gauges.cut_plot import plot_cuts
    from dic.gauges.declared import Gauge
    from dic.gauges.file import read_gauges
    from dic.gauges.kinds import (
        GAUGES,
        Extensometer,
        LineCut,
        PointGauge,
        StrainGauge,
        TransverseExtensometer,
    )
    from dic.gauges.plot import plot_gauges
    from dic.gauges.reading import Profile, Reading
    from dic.gauges.series import GaugeImage, GaugeSeries
    from dic.gauges.table import gauge_table_files, write_gauge_table
    from dic.image.given import read_region
    from dic.image.pages import list_images
    from dic.image.read import read_image
    from dic.out_of_plane.alignment import Alignment, load_alignment, save_alignment
    from dic.out_of_plane.correct import Corrections
    from dic.out_of_plane.correction import Correction
    from dic.out_of_plane.diagnosis import Sensitivity
    from dic.out_of_plane.motion import Motion
    from dic.out_of_plane.plane import Plane
    from dic.out_of_plane.two_cameras import TwoCameraStep
    from dic.pictures.contact_sheet import write_contact_sheet
    from dic.pictures.maps import write_maps
    from dic.pictures.panels import map_scale
    from dic.pictures.settings import MapSettings, PlotSettings
    from dic.pipeline.correction_settings import CorrectionSettings, SurfaceSettings
    from dic.pipeline.corrections import JointCorrections, RunCorrections, corrected_rotation
    from dic.pipeline.images import measure_images, measure_series
    from dic.pipeline.measured import measure
    from dic.pipeline.measured_images import MeasuredImage, MeasuredSeries
    from dic.pipeline.result import CameraResult, RunResult, SeriesResult
    from dic.pipeline.result_file import load_run_result, load_series_result
    from dic.pipeline.result_writer import save_run_result
    from dic.pipeline.run import process_run
    from dic.pipeline.run_reference import RunReference, run_reference
    from dic.pipeline.run_source import RunSource
    from dic.pipeline.series_image import SeriesImage
    from dic.pipeline.strain_anew import strain_of_run, strain_of_series
    from dic.pipeline.target_images import calibrate_images
    from dic.properties.anisotropy import planar_anisotropy
    from dic.properties.curve import Curve, read_curve
    from dic.properties.plot import plot_properties
    from dic.properties.properties import Properties, material_properties
    from dic.properties.settings import PropertySettings
    from dic.properties.shared_error import with_shared_error
    from dic.properties.value import PropertyValue
    from dic.quality.findings import quality_findings
    from dic.quality.plot import plot_quality
    from dic.quality.quality import Quality, assess_quality
    from dic.records.joining import JoinedRecord
    from dic.records.machine import MachineRecord, read_image_times, read_machine_record
    from dic.report.campaign_page import plot_campaign, write_campaign_report
    from dic.report.conditions import tables_of_test
    from dic.report.details import ReportDetails
    from dic.report.ontology import write_test_ontology
    from dic.report.page import write_report
    from dic.report.series_page import write_series_report
    from dic.report.stated_facts import StatedFacts, read_stated_facts
    from dic.report.tensile_test import TensileTest, tensile_test
    from dic.results.csv import write_csv
    from dic.results.place import ResultPlace
    from dic.results.strain_table import write_strain_table
    from dic.runfile.reader import RunInfo, RunStep
    from dic.specimen.find import Specimen, find_specimen
    from dic.specimen.write import RegionFiles, region_files, write_region
    from dic.strain.displacement import Displacement, Noise
    from dic.strain.measurement import Measurement
    from dic.strain.resolution import strain_resolution_px
    from dic.strain.settings import StrainSettings
    from dic.strain.strain import MeanStrain, StrainField, gauge_text
    from dic.study.plot import plot_study
    from dic.study.result import StudiedSettings, Study
    from dic.study.study import study_settings
    from dic.study.sweep import Sweep
    from dic.study.wave import Wave
    from dic.targets.find import find_target
    from dic.targets.kinds import (
        TARGETS,
        AsymmetricDotTarget,
        CharucoTarget,
        CheckerboardTarget,
        DotTarget,
        LineGridTarget,
        Target,
    )
    from dic.targets.points import GridPoints
    from dic.targets.sheet.draw import draw_target
    from dic.workers.cluster import ClusterWorkers
    from dic.workers.local import LocalWorkers

    __version__: str

__all__ = [
    "EXPORTS", "GAUGES", "TARGETS", "AboutTest", "Alignment", "Animation", "Assessment",
    "AsymmetricDotTarget", "BicubicMap", "Calibration", "CalibrationError", "CameraResult", "Campaign",
    "CampaignSpecimen", "CharucoTarget", "CheckerboardTarget", "ClusterWorkers", "Comparison", "Correction",
    "CorrectionSettings", "Corrections", "CorrelationError", "CorrelationSettings", "Correlator", "Curve",
    "CurveColumns", "CurveError", "Difference", "Displacement", "DotTarget", "Export", "Extensometer",
    "Field", "Gauge", "GaugeChoice", "GaugeCurve", "GaugeError", "GaugeImage", "GaugeSeries", "GridPoints",
    "ImageClock", "ImageError", "JoinedRecord", "JointCorrections", "KnownCamera", "LineCut",
    "LineGridTarget", "LocalWorkers", "MachineRecord", "MapSettings", "MeanStrain", "MeasuredImage",
    "MeasuredSeries", "Measurement", "MeasurementError", "Motion", "Noise", "OutputError", "PeerField",
    "Pinhole", "Plane", "PlotSettings", "PointGauge", "Profile", "Properties", "PropertySettings",
    "PropertyValue", "Quality", "Reading", "ReferenceSettings", "RegionFiles", "ReportDetails", "Residuals",
    "ResultPlace", "RunCorrections", "RunFileError", "RunInfo", "RunReference", "RunResult", "RunSource",
    "RunStep", "Sensitivity", "Series", "SeriesImage", "SeriesResult", "Specimen", "SpecimenTest",
    "StatedFacts", "Status", "StrainField", "StrainGauge", "StrainSettings", "StudiedSettings", "Study",
    "SurfaceSettings", "Sweep", "Target", "TensileTest", "TransverseExtensometer", "TwoCameraStep", "Wave",
    "WorkerError", "__version__", "assess_method", "assess_quality", "calibrate_images", "compare_results",
    "compare_specimens", "corrected_rotation", "draw_target", "export_results", "find_specimen",
    "find_target", "gauge_curve", "gauge_table_files", "gauge_text", "join_record", "list_images",
    "list_specimens", "load_alignment", "load_calibration", "load_run_result", "load_series_result",
    "map_scale", "material_properties", "measure", "measure_campaign", "measure_gauges", "measure_images",
    "measure_series", "planar_anisotropy", "plot_assessment", "plot_calibration", "plot_campaign",
    "plot_cuts", "plot_gauges", "plot_properties", "plot_quality", "plot_study", "process_run",
    "quality_findings", "read_campaign", "read_curve", "read_gauges", "read_image", "read_image_times",
    "read_machine_record", "read_peer", "read_region", "read_stated_facts", "region_files", "rigid_motion",
    "run_reference", "save_alignment", "save_calibration", "save_run_result", "strain_of_run",
    "strain_of_series", "strain_resolution_px", "study_settings", "tables_of_test", "tensile_test",
    "to_pandas", "to_xarray", "whole_field_gauges", "with_shared_error", "write_animation",
    "write_campaign_report", "write_campaign_table", "write_contact_sheet", "write_csv",
    "write_drawing_page", "write_example", "write_gauge_picture", "write_gauge_table", "write_maps",
    "write_region", "write_report", "write_series_report", "write_strain_table", "write_tensile_ontology",
    "write_test_ontology",
]  # fmt: skip

_NAMES_OF = {
    "dic.assessment.assessment": ("Assessment", "assess_method"),
    "dic.assessment.plots": ("plot_assessment",),
    "dic.calibration.bicubic": ("BicubicMap",),
    "dic.calibration.calibration": ("Calibration",),
    "dic.calibration.file": ("load_calibration", "save_calibration"),
    "dic.calibration.pinhole.camera": ("Pinhole",),
    "dic.calibration.pinhole.prior": ("KnownCamera",),
    "dic.calibration.plot": ("plot_calibration",),
    "dic.calibration.residuals": ("Residuals",),
    "dic.campaigns.campaign": ("Campaign", "SpecimenTest", "compare_specimens"),
    "dic.campaigns.file": ("list_specimens", "read_campaign"),
    "dic.campaigns.specimen": ("CampaignSpecimen", "CurveColumns", "GaugeChoice", "measure_campaign"),
    "dic.campaigns.table": ("write_campaign_table",),
    "dic.comparison.difference": ("Comparison", "Difference"),
    "dic.comparison.peer": ("PeerField",),
    "dic.comparison.read": ("read_peer",),
    "dic.correlation.correlator": ("Correlator",),
    "dic.correlation.field": ("Field",),
    "dic.correlation.initial_guess": ("rigid_motion",),
    "dic.correlation.series": ("Series",),
    "dic.correlation.settings": ("CorrelationSettings", "ReferenceSettings"),
    "dic.correlation.status": ("Status",),
    "dic.drawing.page": ("write_drawing_page",),
    "dic.errors": (
        "CalibrationError", "CorrelationError", "CurveError", "GaugeError", "ImageError",
        "MeasurementError", "OutputError", "RunFileError", "WorkerError",
    ),
    "dic.example.copy": ("write_example",),
    "dic.exports.formats": ("EXPORTS",),
    "dic.exports.tensile_ontology": ("AboutTest", "write_tensile_ontology"),
    "dic.gauges.cut_plot": ("plot_cuts",),
    "dic.gauges.declared": ("Gauge",),
    "dic.gauges.file": ("read_gauges",),
    "dic.gauges.kinds": (
        "GAUGES", "Extensometer", "LineCut", "PointGauge", "StrainGauge", "TransverseExtensometer",
    ),
    "dic.gauges.plot": ("plot_gauges",),
    "dic.gauges.reading": ("Profile", "Reading"),
    "dic.gauges.series": ("GaugeImage", "GaugeSeries"),
    "dic.gauges.table": ("gauge_table_files", "write_gauge_table"),
    "dic.image.given": ("read_region",),
    "dic.image.pages": ("list_images",),
    "dic.image.read": ("read_image",),
    "dic.out_of_plane.alignment": ("Alignment", "load_alignment", "save_alignment"),
    "dic.out_of_plane.correct": ("Corrections",),
    "dic.out_of_plane.motion": ("Motion",),
    "dic.out_of_plane.correction": ("Correction",),
    "dic.out_of_plane.diagnosis": ("Sensitivity",),
    "dic.out_of_plane.plane": ("Plane",),
    "dic.out_of_plane.two_cameras": ("TwoCameraStep",),
    "dic.pictures.contact_sheet": ("write_contact_sheet",),
    "dic.pictures.maps": ("write_maps",),
    "dic.pictures.panels": ("map_scale",),
    "dic.pictures.settings": ("MapSettings", "PlotSettings"),
    "dic.derived.animation": ("Animation", "write_animation"),
    "dic.derived.compared": ("compare_results",),
    "dic.derived.export": ("Export", "export_results"),
    "dic.derived.export_tables": ("to_pandas", "to_xarray"),
    "dic.derived.gauge_record": ("GaugeCurve", "ImageClock", "gauge_curve", "join_record"),
    "dic.derived.whole_field": ("whole_field_gauges",),
    "dic.derived.gauge_series": ("measure_gauges", "write_gauge_picture"),
    "dic.pipeline.images": ("measure_images", "measure_series"),
    "dic.pipeline.measured": ("measure",),
    "dic.pipeline.run": ("process_run",),
    "dic.pipeline.correction_settings": ("CorrectionSettings", "SurfaceSettings"),
    "dic.pipeline.corrections": ("JointCorrections", "RunCorrections", "corrected_rotation"),
    "dic.pipeline.run_reference": ("RunReference", "run_reference"),
    "dic.pipeline.result": ("CameraResult", "RunResult", "SeriesResult"),
    "dic.pipeline.result_file": ("load_run_result", "load_series_result"),
    "dic.pipeline.result_writer": ("save_run_result",),
    "dic.pipeline.run_source": ("RunSource",),
    "dic.pipeline.series_image": ("SeriesImage",),
    "dic.pipeline.measured_images": ("MeasuredImage", "MeasuredSeries"),
    "dic.pipeline.strain_anew": ("strain_of_run", "strain_of_series"),
    "dic.pipeline.target_images": ("calibrate_images",),
    "dic.properties.anisotropy": ("planar_anisotropy",),
    "dic.properties.curve": ("Curve", "read_curve"),
    "dic.properties.plot": ("plot_properties",),
    "dic.properties.properties": ("Properties", "material_properties"),
    "dic.properties.settings": ("PropertySettings",),
    "dic.properties.shared_error": ("with_shared_error",),
    "dic.properties.value": ("PropertyValue",),
    "dic.quality.findings": ("quality_findings",),
    "dic.quality.plot": ("plot_quality",),
    "dic.quality.quality": ("Quality", "assess_quality"),
    "dic.records.joining": ("JoinedRecord",),
    "dic.records.machine": ("MachineRecord", "read_image_times", "read_machine_record"),
    "dic.report.campaign_page": ("plot_campaign", "write_campaign_report"),
    "dic.report.conditions": ("tables_of_test",),
    "dic.report.details": ("ReportDetails",),
    "dic.report.ontology": ("write_test_ontology",),
    "dic.report.page": ("write_report",),
    "dic.report.series_page": ("write_series_report",),
    "dic.report.stated_facts": ("StatedFacts", "read_stated_facts"),
    "dic.report.tensile_test": ("TensileTest", "tensile_test"),
    "dic.results.csv": ("write_csv",),
    "dic.results.place": ("ResultPlace",),
    "dic.results.strain_table": ("write_strain_table",),
    "dic.runfile.reader": ("RunInfo", "RunStep"),
    "dic.specimen.find": ("Specimen", "find_specimen"),
    "dic.specimen.write": ("RegionFiles", "region_files", "write_region"),
    "dic.strain.displacement": ("Displacement", "Noise"),
    "dic.strain.measurement": ("Measurement",),
    "dic.strain.resolution": ("strain_resolution_px",),
    "dic.strain.settings": ("StrainSettings",),
    "dic.strain.strain": ("MeanStrain", "StrainField", "gauge_text"),
    "dic.study.plot": ("plot_study",),
    "dic.study.result": ("StudiedSettings", "Study"),
    "dic.study.study": ("study_settings",),
    "dic.study.sweep": ("Sweep",),
    "dic.study.wave": ("Wave",),
    "dic.targets.find": ("find_target",),
    "dic.targets.kinds": (
        "TARGETS", "AsymmetricDotTarget", "CharucoTarget", "CheckerboardTarget", "DotTarget",
        "LineGridTarget", "Target",
    ),
    "dic.targets.points": ("GridPoints",),
    "dic.targets.sheet.draw": ("draw_target",),
    "dic.workers.cluster": ("ClusterWorkers",),
    "dic.workers.local": ("LocalWorkers",),
}  # fmt: skip
_MODULE_OF = {name: module for module, names in _NAMES_OF.items() for name in names}


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


if not TYPE_CHECKING:  # if type checkers saw this function, they would accept any name

    def __getattr__(name: str) -> Any:
        """Load a public name from its module when it is first used (PEP 562)."""
        if name == "__version__":
            from importlib.metadata import version

            value = version("offaxis")
        elif name in _MODULE_OF:
            value = getattr(import_module(_MODULE_OF[name]), name)
        else:
            raise AttributeError(f"module 'dic' has no attribute {name!r}")
        globals()[name] = value
        return value
