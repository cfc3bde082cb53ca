from . import (
    assessment as assessment,
    calibration as calibration,
    campaigns as campaigns,
    comparison as comparison,
    correlation as correlation,
    derived as derived,
    drawing as drawing,
    errors as errors,
    example as example,
    exports as exports,
    gauges as gauges,
    image as image,
    live as live,
    out_of_plane as out_of_plane,
    pictures as pictures,
    pipeline as pipeline,
    properties as properties,
    quality as quality,
    records as records,
    report as report,
    results as results,
    runfile as runfile,
    specimen as specimen,
    strain as strain,
    study as study,
    targets as targets,
    workers as workers,
)
from .calibration.calibration import Calibration as Calibration
from .calibration.file import (
    load_calibration as load_calibration,
    save_calibration as save_calibration,
)
from .correlation.correlator import Correlator as Correlator
from .correlation.settings import (
    CorrelationSettings as CorrelationSettings,
    ReferenceSettings as ReferenceSettings,
)
from .derived.animation import write_animation as write_animation
from .derived.compared import compare_results as compare_results
from .derived.export import export_results as export_results
from .derived.export_tables import (
    to_pandas as to_pandas,
    to_xarray as to_xarray,
)
from .derived.gauge_series import measure_gauges as measure_gauges
from .errors import MeasurementError as MeasurementError
from .gauges.file import read_gauges as read_gauges
from .image.given import read_region as read_region
from .image.pages import list_images as list_images
from .image.read import read_image as read_image
from .out_of_plane.motion import Motion as Motion
from .pictures.maps import write_maps as write_maps
from .pipeline.correction_settings import CorrectionSettings as CorrectionSettings
from .pipeline.images import (
    measure_images as measure_images,
    measure_series as measure_series,
)
from .pipeline.measured import measure as measure
from .pipeline.result_file import (
    load_run_result as load_run_result,
    load_series_result as load_series_result,
)
from .pipeline.run import process_run as process_run
from .pipeline.strain_anew import (
    strain_of_run as strain_of_run,
    strain_of_series as strain_of_series,
)
from .pipeline.target_images import calibrate_images as calibrate_images
from .properties.curve import read_curve as read_curve
from .properties.properties import material_properties as material_properties
from .quality.quality import assess_quality as assess_quality
from .report.page import write_report as write_report
from .report.series_page import write_series_report as write_series_report
from .report.tensile_record import tensile_test as tensile_test
from .specimen.find import find_specimen as find_specimen
from .strain.settings import StrainSettings as StrainSettings
from .study.study import study_settings as study_settings
from .workers.local import LocalWorkers as LocalWorkers

__version__: str
