from .correction_settings import (
    CorrectionSettings as CorrectionSettings,
    SurfaceSettings as SurfaceSettings,
)
from .corrections import (
    JointCorrections as JointCorrections,
    MeasuredStep as MeasuredStep,
    RunCorrections as RunCorrections,
    corrected_rotation as corrected_rotation,
)
from .grid_images import GridImages as GridImages
from .image_task import load_correlation as load_correlation
from .image_timing import ImageTiming as ImageTiming
from .images import (
    measure_images as measure_images,
    measure_series as measure_series,
)
from .measured import measure as measure
from .measured_images import (
    MeasuredImage as MeasuredImage,
    MeasuredSeries as MeasuredSeries,
)
from .measuring import Measuring as Measuring
from .reference_image import (
    RunReference as RunReference,
    run_reference as run_reference,
)
from .result import (
    CameraResult as CameraResult,
    RunResult as RunResult,
    SeriesResult as SeriesResult,
)
from .result_file import (
    is_series_result as is_series_result,
    load_run_result as load_run_result,
    load_series_result as load_series_result,
)
from .result_writer import save_run_result as save_run_result
from .reuse import job_of_fields as job_of_fields
from .run import process_run as process_run
from .run_source import RunSource as RunSource, list_run_files as list_run_files
from .series_camera import SeriesCamera as SeriesCamera
from .series_image import FileDigests as FileDigests, KnownImage as KnownImage, SeriesImage as SeriesImage
from .series_sources import SeriesSources as SeriesSources, files_of as files_of
from .set_up import SeriesSetUp as SeriesSetUp, strain_of_job as strain_of_job
from .static_images import static_errors as static_errors
from .strain_anew import (
    series_anew as series_anew,
    strain_of_run as strain_of_run,
    strain_of_series as strain_of_series,
)
from .target_images import calibrate_images as calibrate_images
